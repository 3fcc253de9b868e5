#version 460
#extension GL_GOOGLE_include_directive : require
// Traces any rays against the panorama's surface. `iprt bench --rays` times it, and a test compares it with
// an oracle.
// In: rays (m), depth, angles, pyramid. Out: answers.
#include "common.glsl"
#include "panorama.glsl"
#include "trace.glsl"
#include "march.glsl"
layout(local_size_x = 64) in;
layout(constant_id = 0) const uint FAR_SIDES = 0; // 1: the pyramid has far sides, and answers say what is unknown
layout(constant_id = 1) const uint MARCH_STEPS = 0; // above 0: rays are marched in this many steps

struct TracedRay { vec3 origin; float t_min; vec3 direction; float t_max; };
struct RayAnswer { float t; uint kind; vec2 uv; vec3 normal; uint unknown; };

layout(set = 0, binding = 30, scalar) readonly buffer Rays { TracedRay ray[]; } in_rays;
layout(set = 0, binding = 31, scalar) writeonly buffer Answers { RayAnswer answer[]; } out_answers;

layout(push_constant, scalar) uniform Push { uint count; } push;

void main() {
    uint k = gl_GlobalInvocationID.x;
    if (k >= push.count) return;
    TracedRay ray = in_rays.ray[k];
    PanoramaHit hit;
    if (MARCH_STEPS > 0u) hit = panorama_march(ray.origin, ray.direction, MARCH_STEPS);
    else hit = panorama_trace(ray.origin, ray.direction, ray.t_min, ray.t_max);
    lamps_meet(ray.origin, ray.direction, hit);
    bool unknown = FAR_SIDES != 0u && panorama_unknown(ray.origin, ray.direction, ray.t_min, hit.t);
    out_answers.answer[k] = RayAnswer(hit.t, hit.kind, hit.uv, hit.normal, uint(unknown));
}
