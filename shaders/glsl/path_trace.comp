#version 460
#extension GL_GOOGLE_include_directive : require
// The oracle of scene truth, path_trace: one sample a pixel of the light transport in a complete scene
// (rendering equation, all bounces), added to sums. The balance heuristic (Veach 1997) combines light
// sampling and BRDF sampling. Both sides of a triangle emit, as elsewhere. A ray that leaves the scene brings
// nothing. The radiance of a pixel is (reflected + other) / samples. The split serves the denoiser:
// `reflected` is what the surface at the pixel's centre reflects, and `other` is emission seen directly and
// all that other surfaces in the pixel send.
// In: scene, lights, punctual. In/out (sums over the samples of a batch): reflected, other, albedo;
// centre (written by sample 0).
#include "common.glsl"
#include "parts.glsl"
#include "scene.glsl"
#include "bsdf.glsl"
#include "punctual.glsl"
layout(local_size_x = 8, local_size_y = 8) in;

// A triangle that shines. It is drawn with a probability proportional to area · luminance. `below` is the
// probability of all lights before it.
struct Light { uint instance; uint triangle; float below; uint padding; };

layout(set = 0, binding = 70, scalar) readonly buffer Lights { Light light[]; } in_lights;
layout(set = 0, binding = 71, rgba32f) uniform image2D reflected; // w: how many samples met the centre's surface
layout(set = 0, binding = 72, rgba32f) uniform image2D other;     // w: squared luminance of `reflected`'s samples
layout(set = 0, binding = 73, rgba32f) uniform image2D albedo;    // Lambert albedo; w: squared luminance of radiance
layout(set = 0, binding = 74, rgba32f) uniform image2D centre;    // normal and distance (m, 0: nothing) of the centre

layout(push_constant, scalar) uniform Push {
    uint first_row;
    uint rows;
    uint light_count;
    float inverse_power; // 1 / Σ area · luminance
    uint bounces;        // the most bounces
    uint roulette;       // bounces after which paths may be ended at random
    uint sampling;       // MIS, LIGHTS or LOBES
    uint fresh;          // 1: the sums start anew
} push;

// --- Owen-scrambled Sobol points, two dimensions at a time (Burley 2020, "Practical Hash-based Owen
// Scrambling") ---

uint scramble(uint x, uint seed) {
    x = bitfieldReverse(x);
    x ^= x * 0x3d20adeau;
    x += seed;
    x *= (seed >> 16u) | 1u;
    x ^= x * 0x05526c56u;
    x ^= x * 0x53a22864u;
    return bitfieldReverse(x);
}

vec2 sobol(uint index, uint seed) {
    index = scramble(index, hash(seed));
    uint x = bitfieldReverse(index), y = x;
    y ^= y << 16u; // the second dimension's matrix is Pascal's triangle modulo 2
    y ^= (y & 0x00ff00ffu) << 8u;
    y ^= (y & 0x0f0f0f0fu) << 4u;
    y ^= (y & 0x33333333u) << 2u;
    y ^= (y & 0x55555555u) << 1u;
    uvec2 p = uvec2(scramble(x, hash(seed ^ 0x68bc21ebu)), scramble(y, hash(seed ^ 0x02e5be93u)));
    return vec2(p >> 8u) * (1.0 / 16777216.0);
}

struct Sampler { uint seed; uint dimension; Random random; };

// Draws well-spread points over a pixel's samples for the first dimensions, and random ones for deep bounces.
vec2 draw(inout Sampler s) {
    s.dimension++;
    return s.dimension <= 12u ? sobol(in_view.view.frame, s.seed + s.dimension * 0x9e3779b9u) : random_next2(s.random);
}

// --- light ---

// Which strategies find the surfaces that shine: both, or one alone. Tests compare all three.
const uint MIS = 0u;
const uint LIGHTS = 1u;
const uint LOBES = 2u;

const uint LIGHT_CANDIDATES = 4u;

// Returns the density, per area, with which light sampling finds a point.
float light_density(SceneHit point) {
    return luminance(hit_material(point).emissive) * push.inverse_power;
}

// Returns the light whose share of [0, 1) holds u.
uint light_at(float u) {
    uint low = 0u, high = push.light_count; // in [low, high)
    while (high - low > 1u) {
        uint middle = (low + high) / 2u;
        if (in_lights.light[middle].below <= u) low = middle; else high = middle;
    }
    return low;
}

// Returns light by one lobe, weighted against BRDF sampling of that lobe. Of a few points, spread over all
// lights, one is chosen by what it would bring (resampled importance sampling, Talbot et al. 2005). Only that
// one costs a ray.
vec3 direct(Surface s, Lobes l, vec3 to_eye, uint lobe, float pick, vec2 u, float choice) {
    if (push.light_count == 0u || push.sampling == LOBES) return vec3(0.0);
    vec3 origin = surface_origin(s), chosen = vec3(0.0), chosen_d = vec3(0.0);
    float chosen_distance = 0.0, chosen_weight = 0.0, total = 0.0;
    for (uint k = 0u; k < LIGHT_CANDIDATES; k++) {
        Light light = in_lights.light[light_at(fract(pick + float(k) / float(LIGHT_CANDIDATES)))];
        SceneHit point = SceneHit(0.0, light.instance, light.triangle, vec2(0.0));
        vec2 v = fract(u + float(k) * vec2(0.7548776662, 0.5698402910));
        float root = sqrt(v.x);
        point.barycentric = vec2(1.0 - root, v.y * root);
        TriangleGeometry tri = triangle_geometry(point.triangle);
        vec4 rows[3] = in_instances.instance[point.instance].object_to_world;
        vec3 to = transform_point(rows, tri.v0 + tri.e1 * point.barycentric.x + tri.e2 * point.barycentric.y) - origin;
        vec3 normal = cross(transform_direction(rows, tri.e1), transform_direction(rows, tri.e2));
        float distance = length(to);
        vec3 d = to / max(distance, 1e-12);
        float cosine = abs(dot(normal, d)) / length(normal);
        if (dot(d, s.geometric) <= 0.0 || cosine <= 0.0) continue;
        float by_light = light_density(point) * distance * distance / cosine;
        float by_lobe;
        vec3 value = bsdf_evaluate(s, l, lobe, to_eye, d, by_lobe);
        if (by_lobe <= 0.0) continue;
        Material m = hit_material(point);
        vec3 radiance = m.textures[SLOT_EMISSIVE] == NONE && (m.flags & UNLIT) == 0u ? m.emissive : scene_surface(point, d, 0.0).emissive;
        if ((m.flags & (MASKED | BLENDED)) != 0u) radiance *= hit_alpha(point, d, 0.0);
        vec3 brings = value * radiance / (by_light + (push.sampling == MIS ? by_lobe : 0.0));
        float weight = luminance(brings);
        total += weight;
        if (weight > 0.0 && choice * total < weight) {
            chosen = brings;
            chosen_d = d;
            chosen_distance = distance;
            chosen_weight = weight;
            choice = choice * total / weight;
        } else if (total > 0.0) choice = (choice * total - weight) / max(total - weight, 1e-30);
        choice = clamp(choice, 0.0, 0.99999994);
    }
    if (chosen_weight <= 0.0) return vec3(0.0);
    if (scene_trace(origin, chosen_d, chosen_distance * (1.0 - 1e-4) - 1e-4).instance != NONE) return vec3(0.0);
    return chosen * (total / (chosen_weight * float(LIGHT_CANDIDATES)));
}

// Returns light from lamps without a surface by one lobe. No lobe's sample can meet them, so there is nothing
// to weigh against.
vec3 punctual(Surface s, Lobes l, vec3 to_eye, uint lobe, inout Random random) {
    vec3 origin = surface_origin(s);
    PunctualChoice chosen = punctual_choose(origin, s, l, to_eye, lobe, random);
    if (chosen.weight <= 0.0 || scene_trace(origin, chosen.d, chosen.distance).instance != NONE) return vec3(0.0);
    return chosen.brings;
}

void main() {
    ivec2 p = ivec2(gl_GlobalInvocationID.xy) + ivec2(0, push.first_row);
    ivec2 size = ivec2(in_view.view.size);
    if (p.x >= size.x || p.y >= size.y || gl_GlobalInvocationID.y >= push.rows) return;

    vec3 origin = in_view.view.position;
    vec4 middle;
    vec3 middle_d = view_direction(vec2(p) + 0.5);
    if (in_view.view.frame == 0u) {
        SceneHit hit = scene_trace_from(origin, middle_d, FAR, true);
        middle = vec4(0.0);
        if (hit.instance != NONE) middle = vec4(scene_surface(hit, middle_d, 0.0).normal, hit.t);
        imageStore(centre, p, middle);
    } else middle = imageLoad(centre, p);

    Sampler draws;
    // A pixel has one sequence for all samples. `frame` is the sample's index.
    draws.seed = hash(uint(p.x) + hash(uint(p.y) + hash(in_view.view.seed)));
    draws.dimension = 0u;
    draws.random = random_begin(uvec2(p), 2u);

    vec3 d = view_direction(vec2(p) + draw(draws));
    SceneHit hit = scene_trace_from(origin, d, FAR, true);
    vec3 seen = vec3(0.0), sum = vec3(0.0), first_albedo = vec3(0.0);
    vec3 throughput = vec3(1.0), medium = vec3(0.0);
    float importance = 1.0; // weight of the path after its first surface
    float by_lobe = 0.0;    // density of the direction just followed; 0 if light sampling cannot find it
    bool same = false;      // whether the sample meets the surface at the pixel's centre
    for (uint bounce = 0u; hit.instance != NONE; bounce++) {
        Surface s = scene_surface(hit, d, 0.0);
        throughput *= medium_passes(medium, s, hit.t);
        if (bounce == 0u) {
            seen = s.emissive;
            vec3 apart = s.position - (origin + middle_d * middle.w);
            same = middle.w > 0.0 && dot(s.normal, middle.xyz) > 0.9 && abs(dot(apart, middle.xyz)) < 0.01 * middle.w;
        } else if (s.emissive != vec3(0.0)) {
            float weight = 1.0;
            if (by_lobe > 0.0) {
                float by_light = light_density(hit) * hit.t * hit.t / max(abs(dot(s.geometric, d)), 1e-12);
                if (push.sampling == MIS) weight = by_lobe / (by_lobe + by_light);
                else if (push.sampling == LIGHTS && by_light > 0.0) weight = 0.0;
            }
            sum += throughput * s.emissive * weight;
        }
        if (bounce >= push.bounces) break;

        vec3 to_eye = -d, weight;
        Lobes l = bsdf_lobes(s, to_eye);
        if (bounce == 0u) first_albedo = l.diffuse;
        vec2 choice = draw(draws);
        vec2 light_u = draw(draws), direction_u = draw(draws);
        uint lobe = bsdf_choose(l, choice.x);
        float probability = bsdf_probability(l, lobe);
        bool sharp = bsdf_is_sharp(s, lobe);
        if (!sharp) {
            vec3 light = direct(s, l, to_eye, lobe, choice.y, light_u, random_next(draws.random));
            if (in_punctual.count > 0u) light += punctual(s, l, to_eye, lobe, draws.random);
            sum += throughput * light / probability;
        }

        d = bsdf_sample(s, l, lobe, to_eye, vec3(direction_u, random_next(draws.random)), weight);
        by_lobe = 0.0;
        if (!sharp) {
            weight = bsdf_evaluate(s, l, lobe, to_eye, d, by_lobe);
            weight = by_lobe > 0.0 ? weight / by_lobe : vec3(0.0);
        }
        if (!bsdf_leaves(s, lobe, d)) weight = vec3(0.0);
        if (push.light_count == 0u) by_lobe = 0.0;
        medium = medium_after(medium, s, lobe, d);
        throughput *= weight / probability;
        float most = max(weight.r, max(weight.g, weight.b));
        if (most <= 0.0) break;
        if (bounce > 0u) importance *= min(1.0, most);
        if (bounce >= push.roulette) {
            float survive = clamp(importance, 0.05, 0.95);
            if (random_next(draws.random) >= survive) break;
            throughput /= survive;
            importance = 1.0;
        }
        hit = scene_trace(surface_origin_along(s, d), d, FAR);
    }

    float l = luminance(sum), total = luminance(sum + seen);
    vec4 a = vec4(0.0), b = vec4(0.0), k = vec4(0.0);
    if (push.fresh == 0u) { a = imageLoad(reflected, p); b = imageLoad(other, p); k = imageLoad(albedo, p); }
    a += same ? vec4(sum, 1.0) : vec4(0.0);
    b += vec4(same ? seen : seen + sum, same ? l * l : 0.0);
    k += vec4(same ? first_albedo : vec3(0.0), total * total);
    imageStore(reflected, p, a);
    imageStore(other, p, b);
    imageStore(albedo, p, k);
}
