#version 460
#extension GL_GOOGLE_include_directive : require
// Pass 3, irradiance: one path per traced surface (IPRT eq. 1, N = 1). Real surfaces get E_R, and ΔE = E_RV −
// E_R from the same random numbers (W/m² up to the capture's scale). Virtual surfaces get E of the Lambert
// lobe and the radiance of the GGX lobe. Rays see real surfaces relit, and virtual ones by paths of up to
// `bounces` vertices.
// In: list, position, normal, hit; panorama, scene, relit panorama. Out: irradiance_a (E_R | E; w unused),
// irradiance_b (ΔE | GGX radiance; w distance of the hit, metres).
#include "common.glsl"
#include "parts.glsl"
#include "bind/images.glsl"
#include "panorama.glsl"
#include "trace.glsl"
#include "scene.glsl"
#include "brdf.glsl"
#include "relit.glsl"
#include "light.glsl"
#include "list.glsl"
layout(local_size_x = 64) in;
layout(push_constant, scalar) uniform Push { float screen_thickness; float screen_stride; float screen_jitter; uint march_steps; } push;
layout(constant_id = 1) const uint LAYER = 0;
layout(constant_id = 4) const uint REAL_TRACER = 0;
layout(constant_id = 5) const uint VIRTUAL_TRACER = 0;
const uint MARCH = 1u;     // value of REAL_TRACER
const uint DIRECTION = 2u; // value of REAL_TRACER
const uint SCREEN = 1u;    // value of VIRTUAL_TRACER

#include "march.glsl"
#include "screen.glsl"

// Returns what a ray meets of the real scene. Direction-only light is infinitely far.
PanoramaHit real_trace(vec3 origin, vec3 d) {
    if (REAL_TRACER == DIRECTION) return PanoramaHit(FAR, panorama_uv(d), FREE, vec3(0.0));
    if (REAL_TRACER == MARCH) return panorama_march(origin, d, push.march_steps);
    return panorama_trace(origin, d, 0.0, FAR);
}

// Returns the virtual surface that a ray meets before t_max.
SceneHit virtual_trace(vec3 origin, vec3 d, float t_max, inout Random random) {
    if (VIRTUAL_TRACER == SCREEN) return screen_trace(origin, d, t_max, random_next(random));
    return scene_trace(origin, d, t_max);
}

vec3 hit_radiance(PanoramaHit hit) { return panorama_bilinear(hit.uv); }

// A ray drawn from a lobe and the panorama's lights together. One of the two strategies is drawn, and the
// weight f·cos/p is that of their mixture (Veach and Guibas 1995, one-sample balance heuristic). `real` is
// what the ray meets of the real scene.
struct Ray {
    vec3 d;
    vec3 weight;
    PanoramaHit real;
};

// Aims at a light. Returns false if the direction drawn is behind the surface.
bool toward_light(vec3 x, vec3 normal, inout Random random, out vec3 d, out vec3 target, out bool far) {
    vec2 u = random_next2(random);
    vec3 centre = light_sample(u, random_next2(random));
    ivec2 texel;
    float distance = surface_distance(centre, texel);
    far = distance <= 0.0 || REAL_TRACER == DIRECTION;
    target = centre * distance;
    d = far ? centre : normalize(target - x);
    return dot(d, normal) > 0.0;
}

// A drawn light counts only if the ray meets it first.
bool meets(PanoramaHit hit, vec3 x, vec3 d, vec3 target, bool far) {
    if (far) return hit.kind == FREE;
    vec3 miss = x + d * hit.t - target;
    return hit.kind == SURFACE && dot(miss, miss) < 1e-4 * dot(target, target);
}

// A Lambert lobe of albedo 1 (f·cos = cos/π), or the GGX lobe of a surface.
Ray draw(vec3 x, vec3 normal, bool specular, Surface s, Lobes l, vec3 to_eye, inout Random random) {
    Ray ray;
    ray.weight = vec3(0.0);
    bool mirror = specular && s.roughness * s.roughness < MIRROR_ALPHA;
    float share = mirror || DIRECTIONS == BRDF ? 0.0 : in_lights.share;
    bool light = random_next(random) < share, far = false;
    vec3 target = vec3(0.0), mirror_weight = vec3(0.0);
    bool possible = true;
    if (light) possible = toward_light(x, normal, random, ray.d, target, far);
    else {
        vec2 u = random_next2(random);
        if (specular) {
            ray.d = brdf_sample_specular(s, l, to_eye, u, mirror_weight);
            possible = dot(ray.d, s.geometric) > 0.0;
        } else ray.d = sample_cosine(normal, u);
    }
    ray.real = PanoramaHit(FAR, vec2(0.0), FREE, vec3(0.0));
    if (!possible) return ray;
    ray.real = real_trace(x, ray.d);
    if (mirror) { ray.weight = mirror_weight; return ray; }
    if (light && !meets(ray.real, x, ray.d, target, far)) return ray;
    float density;
    vec3 f;
    if (specular) f = brdf_specular(s, l, to_eye, ray.d, density);
    else { density = max(dot(ray.d, normal), 0.0) / PI; f = vec3(density); }
    float p = (1.0 - share) * density + (share > 0.0 ? share * light_density(x, ray.d, ray.real) : 0.0);
    if (p > 0.0) ray.weight = f / p;
    return ray;
}

// Returns what arrives along a ray, the mixed scene included: real surfaces relit, virtual ones by a path.
// The path's last vertex sees the real scene alone, so that no light is lost. `distance` is that of the first
// hit.
vec3 incoming(vec3 origin, Ray ray, inout Random random, out float distance) {
    SceneHit hit = virtual_trace(origin, ray.d, ray.real.t, random);
    distance = min(hit.t, ray.real.t);
    vec3 sum = vec3(0.0), throughput = vec3(1.0);
    float width = 0.0;
    for (uint bounce = 1u; hit.instance != NONE; bounce++) {
        width += 0.05 * hit.t;
        vec3 seen_along = VIRTUAL_TRACER == SCREEN ? screen_direction(hit, ray.d) : ray.d;
        Surface s = scene_surface(hit, seen_along, width);
        if (EMISSION != 0u) sum += throughput * s.emissive;
        vec3 to_eye = -seen_along;
        Lobes l = brdf_lobes(s, to_eye);
        bool specular = brdf_choose_specular(l, random);
        origin = surface_origin(s);
        ray = draw(origin, s.normal, specular, s, l, to_eye, random);
        if (dot(ray.d, s.geometric) <= 0.0) return sum;
        throughput *= ray.weight * (specular ? vec3(1.0 / l.specular_probability) : l.diffuse / (1.0 - l.specular_probability));
        if (max(throughput.r, max(throughput.g, throughput.b)) <= 0.0) return sum;
        hit.instance = NONE;
        if (INTERREFLECTION != 0u && bounce < in_view.view.bounces) hit = virtual_trace(origin, ray.d, ray.real.t, random);
    }
    return sum + throughput * relit(ray.real.uv, hit_radiance(ray.real));
}

void main() {
    uint k = list_group() * 64u + gl_LocalInvocationIndex;
    if (k >= in_arguments.word[LAYER * 4u + 3u]) return;
    uint item = in_list.item[LAYER * in_view.view.size.x * in_view.view.size.y + k];
    ivec2 p = ivec2(item & 0xffffu, item >> 16u);
    Random random = random_begin(uvec2(p), LAYER);
    vec4 point = imageLoad(in_position, ivec3(p, LAYER));
    float distance = 0.0;

    if (LAYER == uint(REAL)) {
        vec3 normal = imageLoad(in_normal, ivec3(p, REAL)).xyz;
        Surface none;
        Lobes no_lobes;
        // Rays start off the real surface by more than the steps of its depth. They start off a virtual
        // surface by almost nothing, so that a contact shadow begins at the contact.
        float off = FAULT == FAULT_RAYS_FROM_BELOW ? -2e-3 : 2e-3;
        Ray ray = draw(point.xyz + normal * (off * length(point.xyz)), normal, false, none, no_lobes, vec3(0.0), random);
        vec3 radiance = vec3(0.0), mixed = vec3(0.0);
        if (ray.weight.x > 0.0) {
            radiance = hit_radiance(ray.real);
            mixed = incoming(point.xyz + normal * 1e-4, ray, random, distance);
        }
        vec3 weight = PI * ray.weight;
        if (FAULT == FAULT_ENERGY_CLAMP) weight *= min(1.0, 0.3 / max(luminance(weight * max(radiance, mixed)), 1e-20));
        imageStore(out_irradiance_a, ivec3(p, REAL), vec4(weight * radiance, 0.0));
        imageStore(out_irradiance_b, ivec3(p, REAL), vec4(weight * (mixed - radiance), distance));
    } else {
        uvec4 id = imageLoad(in_hit, p);
        vec3 from_eye = (point.xyz - in_view.view.position) / point.w;
        SceneHit hit = SceneHit(point.w, id.x, id.y, uintBitsToFloat(id.zw));
        Surface s = scene_surface(hit, from_eye, point.w * pixel_angle());
        Lobes l = brdf_lobes(s, -from_eye);
        bool specular = brdf_choose_specular(l, random);
        vec3 origin = surface_origin(s);
        Ray ray = draw(origin, s.normal, specular, s, l, -from_eye, random);
        vec3 weight = ray.weight / (specular ? l.specular_probability : (1.0 - l.specular_probability) / PI);
        if (dot(ray.d, s.geometric) <= 0.0) weight = vec3(0.0);
        vec3 radiance = vec3(0.0);
        if (max(weight.r, max(weight.g, weight.b)) > 0.0) radiance = weight * incoming(origin, ray, random, distance);
        if (FAULT == FAULT_ENERGY_CLAMP) radiance *= min(1.0, 0.3 / max(luminance(radiance), 1e-20));
        imageStore(out_irradiance_a, ivec3(p, VIRTUAL), vec4(specular ? vec3(0.0) : radiance, 0.0));
        if (SPECULAR != 0u) imageStore(out_irradiance_b, ivec3(p, VIRTUAL), vec4(specular ? radiance : vec3(0.0), specular ? distance : 0.0));
    }
}
