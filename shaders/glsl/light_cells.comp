#version 460
#extension GL_GOOGLE_include_directive : require
// Per video frame, light_table (first dispatch): mean luminance of each cell. In: panorama radiance. Out: lights (weights hold luminance for now).
#define LIGHT_TABLE_WRITES
#include "common.glsl"
#include "panorama.glsl"
#include "light.glsl"
layout(local_size_x = 8, local_size_y = 8) in;

void main() {
    ivec2 cell = ivec2(gl_GlobalInvocationID.xy);
    if (any(greaterThanEqual(cell, LIGHT_CELLS))) return;
    ivec2 size = ivec2(in_view.view.color_size);
    ivec2 from = cell * size / LIGHT_CELLS, to = max((cell + 1) * size / LIGHT_CELLS, from + 1);
    float sum = 0.0;
    for (int y = from.y; y < to.y; y++)
        for (int x = from.x; x < to.x; x++) sum += luminance(imageLoad(in_panorama_radiance, ivec2(x, y)).rgb);
    lights.value[LIGHT_WEIGHTS_AT + cell.y * LIGHT_CELLS.x + cell.x] = sum / float((to.x - from.x) * (to.y - from.y));
}
