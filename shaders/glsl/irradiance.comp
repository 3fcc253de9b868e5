#version 460
#extension GL_GOOGLE_include_directive : require
#ifdef RAY_QUERY
#extension GL_EXT_ray_query : require
#endif
// Pass 3, irradiance: one path per traced surface (IPRT eq. 1, N = 1), or several from
// virtual ones that are new. Real surfaces get E_R, and ΔE = E_RV −
// E_R from the same random numbers (W/m² up to the capture's scale). Virtual surfaces get E of the
// Lambert lobe and the radiance of all others. Rays see real surfaces relit, and virtual ones by paths of up
// to `bounces` vertices.
// In: list, or what aim left of it; guide, hit, real_coverage, albedo_virtual; panorama, scene, relit
// panorama. Out: irradiance (E_R and ΔE | E and the rest).
#include "irradiance.glsl"
#include "reflection.glsl"
#include "mask.glsl"
#include "color_code.glsl"
layout(local_size_x = 64) in;

void real_surface_light(ivec2 p) {
    Random random = random_begin(uvec2(p), uint(REAL));
    RealStart from = real_start(p);
    Aim aim = real_aim(p, from, random);
    Ray ray = real_ray(aim, from);
    // Light of the capture, and how the mixed scene changes it.
    vec3 radiance = vec3(0.0), change = vec3(0.0);
    vec2 units = in_view.view.light_units;
    if (ray.weight.x > 0.0 || (EMITTERS != 0u && aim.emitter)) {
        SceneHit hit = virtual_trace(from.off_virtual, ray.d, ray.real.t, false, random);
        vec3 weight = mixed_weight(ray, aim, hit);
        float factor = 1.0;
        if (ROULETTE != 0u && hit.instance == NONE) {
            float share = traced_share(p);
            factor = chosen(p, share) ? 1.0 / share : 0.0;
        }
        radiance = (PI * factor) * ray.weight * hit_radiance(ray.real);
        change = (PI * factor) * weight * incoming(from.off_virtual, ray, hit, Passage(true, 0.0, WIDEST_SPREAD, vec3(0.0)), random) - radiance;
        if (PATH_LIMIT != 0u && is_by_chance(aim)) {
            vec2 limit = path_limit(p, REAL) / units;
            radiance = limited(radiance, limit.x);
            change = limited(change, limit.y);
        }
    }
    if (PUNCTUAL != 0u)
        change += PI * punctual(from.off_real, from.off_virtual, real_lambert(from), lambert_lobes(), DIFFUSE, vec3(0.0), random);
    if (FAULT == FAULT_ENERGY_CLAMP) {
        float least = min(1.0, 0.3 / max(luminance(max(radiance, radiance + change)), 1e-20));
        radiance *= least;
        change *= least;
    }
    Light light = Light(units.x * radiance, units.y * change, vec2(0.0));
    imageStore(out_irradiance, ivec3(p, REAL), light_pack(light));
}

// A virtual surface in the picture.
struct Seen {
    Surface surface;
    Lobes lobes;
    vec3 from_eye;
    float own; // its part of what is virtual in the pixel
    uint instance;
    bool varied; // other points of the pixel show something else
    vec3 albedo_ratio; // k_V over that of the pixel
    vec2 limit; // of what a path brings to each lobe
};

// What a smooth surface reflects: how far from it, 0 if that is not known, and where it was a frame ago, relative to now.
struct Reflected { float t; vec3 moved; };

// Moves to another point of the pixel, if an object is there: what a smooth, bent surface shows differs from point to
// point, and at an edge there are several surfaces. `albedo` is the mean k_V, by which composite multiplies.
void other_point(ivec2 p, uint path, vec3 albedo, inout Seen seen) {
    vec2 at = vec2(p) + first_numbers(p, 3u, path).xy;
    vec3 origin = view_origin(at), d = view_direction(at);
    SceneHit hit = scene_closest_seen(origin, d, 0.0, FAR);
    if (hit.instance == NONE || (ALPHA != 0u && hit_alpha(hit, d, hit.t * pixel_angle()) <= 0.0)) return;
    seen.instance = hit.instance;
    seen.from_eye = d;
    seen.surface = scene_surface(hit, d, hit.t * pixel_angle());
    seen.lobes = bsdf_lobes(seen.surface, -d);
    seen.albedo_ratio = min(seen.lobes.diffuse / max(albedo, 1e-4), 16.0);
}

// Traces a path from a virtual surface.
void virtual_path(ivec2 p, uint path, Seen seen, inout Random random, inout vec3 lambert, inout vec3 rest, inout Reflected reflected) {
    uint instance = seen.instance;
    path_color = WHITE;
    if (seen.varied) other_point(p, path, color_unpack(imageLoad(in_albedo_virtual, p).x), seen);
    Surface s = seen.surface;
    Lobes l = seen.lobes;
    vec3 origin = surface_origin(s), numbers = first_numbers(p, uint(VIRTUAL), path);
    float choice = random_next(random);
    bool behind = false;
    if (ALPHA != 0u && SPECULAR != 0u) {
        behind = choice >= seen.own;
        choice = min(behind ? (choice - seen.own) / max(1.0 - seen.own, 1e-6) : choice / seen.own, 0.99999994);
    }
    uint lobe = bsdf_choose(l, choice);
    l.diffuse = seen.albedo_ratio; // composite knows the rest of it
    Aim drawn = aim(origin, origin, s, l, lobe, -seen.from_eye, numbers, random);
    if (behind) {
        drawn.d = seen.from_eye;
        drawn.possible = drawn.sharp = true;
        drawn.light = drawn.emitter = false;
        drawn.sharp_weight = vec3(1.0);
    }
    if (TRANSMISSION != 0u || ALPHA != 0u) origin = surface_origin_along(s, drawn.d);
    Ray ray = trace(drawn, origin, origin, s, l, lobe, -seen.from_eye);
    vec3 factor = vec3((lobe == DIFFUSE && !behind ? PI : 1.0) / (behind ? 1.0 : bsdf_probability(l, lobe)));
    if (!behind && !bsdf_leaves(s, lobe, ray.d)) factor = vec3(0.0);
    vec3 radiance = vec3(0.0);
    if (factor.x > 0.0 && (largest(ray.weight) > 0.0 || (EMITTERS != 0u && drawn.emitter))) {
        SceneHit hit = virtual_trace(origin, ray.d, ray.real.t, behind, random);
        vec3 weight = factor * mixed_weight(ray, drawn, hit);
        if (REFLECTIONS != 0u && seen.instance == instance && (lobe == GLOSSY || lobe == COAT) && !behind && !drawn.light && !drawn.emitter) {
            reflected.t = hit.instance != NONE ? hit.t : ray.real.t;
            reflected.moved = hit.instance != NONE ? point_motion(in_instances.instance[hit.instance], origin + ray.d * hit.t) : vec3(0.0);
        }
        // Where paths start all over the pixel, each stands for less of it.
        float angle = pixel_angle() * (seen.varied ? 0.5 : 1.0);
        Passage passage = Passage(false, distance(s.position, view_origin(vec2(p) + 0.5)) * angle, angle, vec3(0.0));
        if (!behind) passage = passage_by(passage, s, lobe, ray.d);
        if (!behind || hit.instance != NONE) radiance = weight * incoming(origin, ray, hit, passage, random);
    }
    if (PATH_LIMIT != 0u && is_by_chance(drawn)) radiance = limited(radiance, lobe == DIFFUSE && !behind ? seen.limit.x : seen.limit.y);
    if (PUNCTUAL != 0u && !behind) {
        vec3 x = surface_origin(s), lamps = punctual(x, x, s, l, lobe, -seen.from_eye, random);
        radiance += (lobe == DIFFUSE ? PI : 1.0) / bsdf_probability(l, lobe) * lamps;
    }
    if (FAULT == FAULT_ENERGY_CLAMP) radiance *= min(1.0, 0.3 / max(luminance(radiance), 1e-20));
    if (lobe == DIFFUSE && !behind) lambert += radiance;
    else rest += radiance;
}

void virtual_surface_light(ivec2 p) {
    Random random = random_begin(uvec2(p), uint(VIRTUAL));
    uvec4 id = imageLoad(in_hit, p);
    SceneHit on = SceneHit(0.0, id.x, id.y, uintBitsToFloat(id.zw));
    vec3 ray = scene_point(on) - view_origin(vec2(p) + 0.5);
    on.t = length(ray);
    Seen seen;
    seen.from_eye = ray / on.t;
    seen.surface = scene_surface(on, seen.from_eye, on.t * pixel_angle());
    seen.lobes = bsdf_lobes(seen.surface, -seen.from_eye);
    // Of what is virtual in the pixel this surface is a part, if it is half transparent. What lies behind it is
    // the rest, as far as it is virtual: M knows the real part.
    seen.own = 1.0;
    if (ALPHA != 0u && SPECULAR != 0u) seen.own = min(seen.surface.alpha / max(1.0 - imageLoad(in_real_coverage, p).x, 1e-4), 1.0);
    bool smooth_coat = CLEARCOAT != 0u && seen.surface.clearcoat > 0.0 && seen.surface.clearcoat_roughness < SMOOTH;
    bool is_smooth = SPECULAR != 0u && (seen.surface.roughness < SMOOTH || smooth_coat);
    seen.instance = id.x;
    seen.varied = VIRTUAL_TRACER != SCREEN && (is_smooth || (imageLoad(in_albedo_virtual, p).x & FLAG) != 0u);
    seen.albedo_ratio = vec3(1.0);
    seen.limit = PATH_LIMIT != 0u ? path_limit(p, VIRTUAL) / in_view.view.light_units.y : vec2(FAR);
    uint paths = EARLY != 0u ? uint(max(mask_at(ivec3(p, VIRTUAL)), 1.0)) : 1u;
    vec3 lambert = vec3(0.0), rest = vec3(0.0);
    Reflected reflected = Reflected(0.0, vec3(0.0));
    if (EARLY == 0u) virtual_path(p, 0u, seen, random, lambert, rest, reflected);
    else for (uint path = 0u; path < paths; path++) virtual_path(p, path, seen, random, lambert, rest, reflected);
    if (REFLECTIONS != 0u) {
        vec4 texel = vec4(0.0);
        if (is_smooth) {
            if (reflected.t <= 0.0) reflected.t = real_distance(seen.surface.position, reflect(seen.from_eye, seen.surface.normal));
            texel = reflection_motion(vec2(p) + 0.5, seen.surface, on, seen.from_eye, reflected.t, reflected.moved);
        }
        imageStore(out_reflected, p, texel);
    }
    float unit = in_view.view.light_units.y / float(paths);
    imageStore(out_irradiance, ivec3(p, VIRTUAL), light_pack(Light(unit * lambert, unit * rest, vec2(0.0))));
}

void main() {
    uint k = list_group() * 64u + gl_LocalInvocationIndex;
    if (k >= in_arguments.word[LAYER * 4 + 3]) return;
    uint item = in_list.item[uint(LAYER) * in_view.view.size.x * in_view.view.size.y + k];
    ivec2 p = ivec2(item & 0xffffu, item >> 16u);
    if (LAYER == REAL) real_surface_light(p);
    else virtual_surface_light(p);
}
