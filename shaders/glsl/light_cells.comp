#version 460
#extension GL_GOOGLE_include_directive : require
// Per video frame, light_table (first dispatch): the mean luminance of each cell. Radiance is bilinear
// between texels, as rays see it, so a lamp's rim that reaches into neighbouring texels is drawn too.
// In: panorama radiance. Out: lights (weights hold luminance for now; luminances, and how they changed).
#include "common.glsl"
#include "panorama.glsl"
#include "light.glsl"
layout(local_size_x = 8, local_size_y = 8) in;

// Returns what a texel contributes to the mean over texels `from` to `to`: the integral of its bilinear
// weight. `from` and `to` are relative to its centre.
float hat(float from, float to) {
    vec2 t = clamp(vec2(from, to), -1.0, 1.0);
    vec2 integral = t - 0.5 * t * abs(t);
    return integral.y - integral.x;
}

void main() {
    ivec2 cell = ivec2(gl_GlobalInvocationID.xy);
    if (any(greaterThanEqual(cell, LIGHT_CELLS))) return;
    ivec2 size = ivec2(in_view.view.color_size);
    vec2 from = vec2(cell) * vec2(size) / vec2(LIGHT_CELLS), to = vec2(cell + 1) * vec2(size) / vec2(LIGHT_CELLS);
    ivec2 first = ivec2(floor(from - 0.5)), last = ivec2(floor(to + 0.5));
    float sum = 0.0;
    for (int y = first.y; y <= last.y; y++) {
        float row = hat(from.y - float(y) - 0.5, to.y - float(y) - 0.5);
        for (int x = first.x; x <= last.x; x++) {
            bool beyond = y < 0 || y >= size.y; // beyond the pole is the opposite meridian
            ivec2 texel = ivec2((x + size.x + (beyond ? size.x / 2 : 0)) % size.x, y < 0 ? -1 - y : beyond ? 2 * size.y - 1 - y : y);
            float weight = row * hat(from.x - float(x) - 0.5, to.x - float(x) - 0.5);
            if (weight > 0.0) {
                vec4 shown = panorama_texel(texel);
                vec3 radiance = shown.rgb * shown.w;
                if (FREE_LAMPS != 0u) radiance = without_lamps(panorama_direction((vec2(texel) + 0.5) / vec2(size)), radiance);
                sum += weight * max(luminance(radiance), 0.0);
            }
        }
    }
    float mean = sum / ((to.x - from.x) * (to.y - from.y));
    int at = cell.y * LIGHT_CELLS.x + cell.x;
    float before = lights.value[LIGHT_LUMINANCES_AT + at];
    lights.value[LIGHT_WEIGHTS_AT + at] = lights.value[LIGHT_LUMINANCES_AT + at] = mean;
    lights.value[LIGHT_CHANGES_AT + at] = mean - before;
}
