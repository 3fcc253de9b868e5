// Directions drawn from a lobe, each with the density that is claimed for it.
#version 460
#extension GL_GOOGLE_include_directive : require
#include "common.glsl"
#include "parts.glsl"
#include "scene.glsl"
#include "bsdf.glsl"
layout(local_size_x = 64) in;
layout(set = 0, binding = 40, scalar) writeonly buffer Samples { vec4 value[]; } out_samples; // direction, density

layout(push_constant, scalar) uniform Push { vec3 normal; vec3 to_eye; float roughness; float anisotropy; uint lobe; uint per_thread; } push;

void main() {
    uint i = gl_GlobalInvocationID.x;
    Surface s;
    s.normal = s.geometric = s.clearcoat_normal = push.normal;
    s.roughness = s.clearcoat_roughness = s.sheen_roughness = push.roughness;
    s.f0 = vec3(1.0);
    s.f90 = 1.0;
    s.tangent = basis(push.normal)[0];
    s.anisotropy = push.anisotropy;
    Lobes l = lambert_lobes();
    l.coat = l.sheen = vec3(1.0);
    Random random = random_begin(uvec2(i % 64u, i / 64u), 0u);
    for (uint k = 0u; k < push.per_thread; k++) {
        vec3 sharp;
        vec3 d = bsdf_sample(s, l, push.lobe, push.to_eye, vec3(random_next2(random), 0.0), sharp);
        float density;
        bsdf_evaluate(s, l, push.lobe, push.to_eye, d, density);
        out_samples.value[i * push.per_thread + k] = vec4(d, density);
    }
}
