// What a lobe sends from one direction to another, and back: the BSDF without its cosine, both ways.
#version 460
#extension GL_GOOGLE_include_directive : require
#include "common.glsl"
#include "parts.glsl"
#include "scene.glsl"
#include "bsdf.glsl"
layout(local_size_x = 64) in;
layout(set = 0, binding = 40, scalar) writeonly buffer Samples { vec4 value[]; } out_samples; // there, back, cosines

layout(push_constant, scalar) uniform Push { vec3 normal; vec3 to_eye; float roughness; float anisotropy; uint lobe; uint per_thread; } push;

void main() {
    uint i = gl_GlobalInvocationID.x;
    Surface s;
    s.normal = s.geometric = s.clearcoat_normal = push.normal;
    s.roughness = s.clearcoat_roughness = s.sheen_roughness = push.roughness;
    s.f0 = vec3(0.04);
    s.f90 = 1.0;
    s.tangent = basis(push.normal)[0];
    s.anisotropy = push.anisotropy;
    Lobes l = lambert_lobes();
    l.coat = l.sheen = vec3(1.0);
    Random random = random_begin(uvec2(i % 64u, i / 64u), 0u);
    for (uint k = 0u; k < push.per_thread; k++) {
        vec3 a = sample_cosine(push.normal, random_next2(random)), b = sample_cosine(push.normal, random_next2(random));
        float density, cosine_a = dot(push.normal, a), cosine_b = dot(push.normal, b);
        float there = bsdf_evaluate(s, l, push.lobe, a, b, density).g / cosine_b, back = bsdf_evaluate(s, l, push.lobe, b, a, density).g / cosine_a;
        out_samples.value[i * push.per_thread + k] = vec4(there, back, cosine_a, cosine_b);
    }
}
