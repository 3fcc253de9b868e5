#version 460
#extension GL_GOOGLE_include_directive : require
// unknown: what a camera off the capture point sees that the capture never saw. It serves the window and is
// no part of the frame.
// In: depth, angles, pyramid with far sides. Out: 1 where the ray through a pixel's centre passes a skirt's
// far side before it meets anything, or meets a skirt; 0 elsewhere.
#include "common.glsl"
#include "panorama.glsl"
#include "trace.glsl"
layout(local_size_x = 8, local_size_y = 8) in;

layout(set = 0, binding = 30, r32f) uniform writeonly image2D out_unknown;

void main() {
    ivec2 p = ivec2(gl_GlobalInvocationID.xy);
    if (any(greaterThanEqual(p, ivec2(in_view.view.size)))) return;
    vec3 origin = view_origin(vec2(p) + 0.5), d = view_direction(vec2(p) + 0.5);
    bool unknown = false;
    if (length(origin) >= 1e-5) { // from the capture point itself everything was seen
        PanoramaHit hit = panorama_trace(origin, d, 0.0, FAR);
        unknown = is_skirt(hit) || panorama_unknown(origin, d, 0.0, hit.t);
    }
    imageStore(out_unknown, p, vec4(unknown));
}
