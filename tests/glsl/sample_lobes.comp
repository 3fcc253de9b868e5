// Directions drawn from the two lobes, each with the density that is claimed for it.
#version 460
#extension GL_GOOGLE_include_directive : require
#include "common.glsl"
#include "parts.glsl"
#include "scene.glsl"
#include "brdf.glsl"
layout(local_size_x = 64) in;
layout(set = 0, binding = 40, scalar) writeonly buffer Samples { vec4 value[]; } out_samples; // direction, density

layout(push_constant, scalar) uniform Push { vec3 normal; vec3 to_eye; float roughness; uint specular; uint per_thread; } push;

void main() {
    uint i = gl_GlobalInvocationID.x;
    Surface s;
    s.normal = push.normal;
    s.geometric = push.normal;
    s.roughness = push.roughness;
    s.f0 = vec3(1.0);
    s.f90 = 1.0;
    Lobes l = Lobes(vec3(0.0), vec3(1.0), 1.0);
    Random random = random_begin(uvec2(i % 64u, i / 64u), 0u);
    for (uint k = 0u; k < push.per_thread; k++) {
        vec2 u = random_next2(random);
        vec3 d, mirror;
        float density;
        if (push.specular != 0u) {
            d = brdf_sample_specular(s, l, push.to_eye, u, mirror);
            brdf_specular(s, l, push.to_eye, d, density);
        } else {
            d = sample_cosine(push.normal, u);
            density = max(dot(d, push.normal), 0.0) / PI; // as irradiance.comp takes it
        }
        out_samples.value[i * push.per_thread + k] = vec4(d, density);
    }
}
