#version 460
#extension GL_GOOGLE_include_directive : require
// Pass 1, gbuffer (third dispatch): the virtual surfaces at the centres of pixels, shaded.
// In: list, hit, real_coverage; the scene. Out: motion, guide, k_V, emission of virtual surfaces.
#include "common.glsl"
#include "parts.glsl"
#include "bind/images.glsl"
#include "list.glsl"
#include "panorama.glsl"
#include "trace.glsl"
#include "scene.glsl"
#include "bsdf.glsl"
#include "guide.glsl"
#define WRITES_VIRTUAL
#include "gbuffer.glsl"
layout(local_size_x = 64) in;

void main() {
    uint k = list_group() * 64u + gl_LocalInvocationIndex;
    if (k >= in_arguments.word[4 + 3]) return;
    uint item = in_list.item[in_view.view.size.x * in_view.view.size.y + k];
    ivec2 p = ivec2(item & 0xffffu, item >> 16u);
    uvec4 id = imageLoad(in_hit, p);
    vec3 d = view_direction(vec2(p) + 0.5);
    SceneHit met = SceneHit(0.0, id.x, id.y, uintBitsToFloat(id.zw));
    met.t = dot(scene_point(met) - view_origin(vec2(p) + 0.5), d);
    write_virtual(p, met, d, ALPHA != 0u ? 1.0 - imageLoad(in_real_coverage, p).x : 1.0);
}
