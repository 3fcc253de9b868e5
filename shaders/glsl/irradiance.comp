#version 460
#extension GL_GOOGLE_include_directive : require
// Pass 3, irradiance: one path per traced surface (IPRT eq. 1, N = 1).
// Real surfaces: E_R, and ΔE = E_RV − E_R from the same random numbers (W/m² up to the capture's scale). Virtual surfaces:
// E of the Lambert lobe, and the radiance of the GGX lobe. Rays see real surfaces relit, and virtual ones by paths of
// up to `bounces` vertices.
// In: list, position, normal, hit; panorama, scene, relit panorama. Out: irradiance_a (E_R | E; w unused), irradiance_b (ΔE | GGX radiance;
// w distance of the hit, metres).
#define TRACE_PANORAMA
#include "common.glsl"
#include "panorama.glsl"
#include "scene.glsl"
#include "brdf.glsl"
#include "relit.glsl"
#include "list.glsl"
layout(local_size_x = 64) in;
layout(constant_id = 1) const uint LAYER = 0;

layout(set = 0, binding = 30, rgba32f) uniform readonly image2DArray in_position;
layout(set = 0, binding = 31, rgba16f) uniform readonly image2DArray in_normal;
layout(set = 0, binding = 36, rgba32ui) uniform readonly uimage2D in_hit;
layout(set = 0, binding = 42, scalar) readonly buffer List { uint item[]; } in_list;
layout(set = 0, binding = 44, scalar) readonly buffer Arguments { uint word[]; } in_arguments;
layout(set = 0, binding = 45, rgba32f) uniform writeonly image2DArray out_irradiance_a;
layout(set = 0, binding = 46, rgba32f) uniform writeonly image2DArray out_irradiance_b;

vec3 hit_radiance(PanoramaHit hit) { return panorama_bilinear(hit.uv, 0); }

// A continuing direction at a virtual surface: its weight f·cos/p over both lobes, one of which is drawn.
vec3 scatter(Surface s, vec3 to_eye, inout Random random, out vec3 weight) {
    Lobes l = brdf_lobes(s, to_eye);
    bool specular = random_next(random) < l.specular_probability;
    vec2 u = random_next2(random);
    vec3 d;
    if (specular) {
        d = brdf_sample_specular(s, l, to_eye, u, weight);
        weight /= l.specular_probability;
    } else {
        d = sample_cosine(s.normal, u);
        weight = dot(d, s.geometric) > 0.0 ? l.diffuse / (1.0 - l.specular_probability) : vec3(0.0);
    }
    return d;
}

// What arrives from direction d, the mixed scene included: real surfaces relit, virtual ones by a path. The ray's last
// vertex sees the real scene alone, so that no light is lost. `distance`: of the first hit.
vec3 incoming(vec3 origin, vec3 d, PanoramaHit real, inout Random random, out float distance) {
    SceneHit hit = scene_trace(origin, d, real.t);
    distance = min(hit.t, real.t);
    if (hit.instance == NONE) return relit(real.uv, hit_radiance(real));
    vec3 sum = vec3(0.0), throughput = vec3(1.0);
    float width = 0.0;
    for (uint bounce = 1u;; bounce++) {
        width += 0.05 * hit.t;
        Surface s = scene_surface(hit, d, width);
        sum += throughput * s.emissive;
        vec3 weight;
        d = scatter(s, -d, random, weight);
        throughput *= weight;
        if (max(throughput.r, max(throughput.g, throughput.b)) <= 0.0) return sum;
        origin = surface_origin(s);
        real = panorama_trace(origin, d, 0.0, FAR);
        hit.instance = NONE;
        if (bounce < in_view.view.bounces) hit = scene_trace(origin, d, real.t);
        if (hit.instance == NONE) return sum + throughput * relit(real.uv, hit_radiance(real));
    }
}

void main() {
    uint k = list_group() * 64u + gl_LocalInvocationIndex;
    if (k >= in_arguments.word[LAYER * 4u + 3u]) return;
    uint item = in_list.item[LAYER * in_view.view.size.x * in_view.view.size.y + k];
    ivec2 p = ivec2(item & 0xffffu, item >> 16u);
    Random random = random_begin(uvec2(p), LAYER);
    vec4 point = imageLoad(in_position, ivec3(p, LAYER));
    float distance;

    if (LAYER == uint(REAL)) {
        vec3 normal = imageLoad(in_normal, ivec3(p, REAL)).xyz;
        vec3 d = sample_cosine(normal, random_next2(random));
        // off the real surface by more than the steps of its depth, off the virtual scene by next to nothing: a contact
        // shadow begins at the contact
        PanoramaHit real = panorama_trace(point.xyz + normal * (2e-3 * length(point.xyz)), d, 0.0, FAR);
        vec3 radiance = hit_radiance(real);
        vec3 mixed = incoming(point.xyz + normal * 1e-4, d, real, random, distance);
        imageStore(out_irradiance_a, ivec3(p, REAL), vec4(PI * radiance, 0.0));
        imageStore(out_irradiance_b, ivec3(p, REAL), vec4(PI * (mixed - radiance), distance));
    } else {
        uvec4 id = imageLoad(in_hit, p);
        vec3 eye = point.xyz - in_view.view.position;
        vec3 from_eye = eye / point.w;
        SceneHit hit = SceneHit(point.w, id.x, id.y, uintBitsToFloat(id.zw));
        Surface s = scene_surface(hit, from_eye, point.w * pixel_angle());
        Lobes l = brdf_lobes(s, -from_eye);
        bool specular = random_next(random) < l.specular_probability;
        vec2 u = random_next2(random);
        vec3 weight, d;
        if (specular) {
            d = brdf_sample_specular(s, l, -from_eye, u, weight);
            weight /= l.specular_probability;
        } else {
            d = sample_cosine(s.normal, u);
            weight = vec3(dot(d, s.geometric) > 0.0 ? PI / (1.0 - l.specular_probability) : 0.0);
        }
        vec3 radiance = vec3(0.0);
        distance = 0.0;
        if (max(weight.r, max(weight.g, weight.b)) > 0.0) {
            vec3 origin = surface_origin(s);
            radiance = weight * incoming(origin, d, panorama_trace(origin, d, 0.0, FAR), random, distance);
        }
        imageStore(out_irradiance_a, ivec3(p, VIRTUAL), vec4(specular ? vec3(0.0) : radiance, 0.0));
        imageStore(out_irradiance_b, ivec3(p, VIRTUAL), vec4(specular ? radiance : vec3(0.0), specular ? distance : 0.0));
    }
}
