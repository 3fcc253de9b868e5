#version 460
#extension GL_GOOGLE_include_directive : require
#ifdef RAY_QUERY
#extension GL_EXT_ray_query : require
#endif
// Pass 3, irradiance (first dispatch): of the traced real surfaces, lists those whose rays meet an object, and of
// the others as many as traced_share says.
// In: list, guide; light of the last frame; panorama, scene. Out: aimed; irradiance of
// what is not listed, 0.
#define APPEND_TO_AIMED
#include "irradiance.glsl"
#include "append.glsl"
layout(local_size_x = 64) in;

void main() {
    uint k = list_group() * 64u + gl_LocalInvocationIndex;
    bool inside = k < in_arguments.word[3];
    uint item = in_list.item[min(k, in_view.view.size.x * in_view.view.size.y - 1u)];
    ivec2 p = inside ? ivec2(item & 0xffffu, item >> 16u) : ivec2(0);
    Random random = random_begin(uvec2(p), uint(REAL));
    RealStart from = real_start(p);
    Aim aim = real_aim(p, from, random);
    bool met = aim.possible && scene_meets(from.off_virtual, aim.d, aim.light && !aim.far ? distance(aim.target, from.off_virtual) : FAR);
    bool traced = inside && aim.possible && (met || chosen(p, traced_share(p)));
    if (inside && !traced) imageStore(out_irradiance, ivec3(p, REAL), uvec4(0u));
    append_pixels(bvec2(traced, false), p);
}
