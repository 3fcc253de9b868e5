#version 460
#extension GL_GOOGLE_include_directive : require
// A pass as one would add it to the frame: where L_cam changes from a pixel to the next one on its right.
// In: camera_radiance. Out: edges, 1 where the luminances differ by more than `least`, else 0.
#include "common.glsl"
#include "bind/images.glsl"
layout(local_size_x = 8, local_size_y = 8) in;
layout(constant_id = 0) const uint STRIDE = 1;

layout(set = 0, binding = 80, r32f) uniform writeonly image2D out_edges;

layout(push_constant, scalar) uniform Push { float least; } push;

void main() {
    ivec2 p = ivec2(gl_GlobalInvocationID.xy), q = p + ivec2(STRIDE, 0);
    if (any(greaterThanEqual(p, ivec2(in_view.view.size)))) return;
    float here = luminance(imageLoad(in_camera_radiance, p).rgb);
    float there = q.x < int(in_view.view.size.x) ? luminance(imageLoad(in_camera_radiance, q).rgb) : here;
    imageStore(out_edges, p, vec4(abs(there - here) > push.least));
}
