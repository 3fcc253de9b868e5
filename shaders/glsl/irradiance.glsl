// What the dispatches of irradiance share: directions, what they are worth, and what arrives along them.
#include "common.glsl"
#include "parts.glsl"
#include "bind/images.glsl"
#include "panorama.glsl"
#include "trace.glsl"
#include "scene.glsl"
#include "bsdf.glsl"
#include "punctual.glsl"
#include "guide.glsl"
#include "past.glsl"
#include "light_code.glsl"
#include "light_units.glsl"
#include "relit.glsl"
#include "light.glsl"
#include "list.glsl"
layout(push_constant, scalar) uniform Push {
    float screen_thickness; float screen_stride; float screen_jitter;
    uint march_steps;
    float least_share;  // of the rays that meet no object, see traced_share
    uint history_valid;
    uint still;
    float path_limit;
    uint packed; // 1: in_past holds the surfaces of the last frame; 0: the guide does
} push;
layout(constant_id = 1) const int LAYER = 0;
layout(constant_id = 37) const uint EARLY = 0; // 1: a virtual surface may have several paths a frame, as many as mask says
layout(constant_id = 26) const uint ROULETTE = 0; // 1: not all rays that meet no object are traced
layout(constant_id = 4) const uint REAL_TRACER = 0;
layout(constant_id = 5) const uint VIRTUAL_TRACER = 0;
layout(constant_id = 51) const uint PATH_LIMIT = 0; // 1: no path brings more than path_limit
layout(constant_id = 50) const uint PICTURED = 0; // 1: smooth surfaces see real ones lit as the last picture has them
const uint MARCH = 1u;     // value of REAL_TRACER
const uint DIRECTION = 2u; // value of REAL_TRACER
const uint SCREEN = 1u;    // value of VIRTUAL_TRACER

#include "march.glsl"
#include "screen.glsl"

// Returns what a ray meets of the real scene. Direction-only light is infinitely far.
// Free lamps are met from `near`, which lies nearer to the surface that the ray leaves.
PanoramaHit real_trace(vec3 origin, vec3 near, vec3 d) {
    if (REAL_TRACER == DIRECTION) return PanoramaHit(FAR, panorama_uv(d), FREE, vec3(0.0));
    PanoramaHit hit;
    if (REAL_TRACER == MARCH) hit = panorama_march(origin, d, push.march_steps);
    else hit = panorama_trace(origin, d, 0.0, FAR);
    lamps_meet(near, d, hit);
    return hit;
}

// Returns the virtual surface that a ray meets before t_max. One from the camera passes backs of what has one side.
SceneHit virtual_trace(vec3 origin, vec3 d, float t_max, bool from_camera, inout Random random) {
    if (VIRTUAL_TRACER == SCREEN) return screen_trace(origin, d, t_max, random_next(random));
    return scene_trace_from(origin, d, t_max, from_camera);
}

// Returns the same as the mixed scene lights it. A lamp shines as it did.
vec3 hit_relit(PanoramaHit hit) {
    vec3 radiance = hit_radiance(hit);
    return is_lamp(hit) ? radiance : relit(hit.uv, radiance);
}

// Adds the light of a real surface at a point as the last picture shows it, which is sharper than the map. Returns how
// much of the pixels around that place show this surface.
float pictured_light(vec3 point, inout Light light) {
    vec3 there = project_previous(point);
    if (there.z <= 0.0) return 0.0;
    vec2 at = there.xy - 0.5;
    ivec2 i = ivec2(floor(at));
    vec2 f = at - vec2(i);
    float total = 0.0;
    [[unroll]] for (int k = 0; k < 4; k++) {
        ivec2 o = ivec2(k & 1, k >> 1), q = i + o;
        float w = (o.x == 1 ? f.x : 1.0 - f.x) * (o.y == 1 ? f.y : 1.0 - f.y);
        if (!neighbour(q)) continue;
        uvec4 past = push.packed != 0u ? imageLoad(in_past, ivec3(q, REAL)) : past_pack(imageLoad(in_guide, ivec3(q, REAL)), 0.0);
        Light last = result_unpack(imageLoad(in_light, ivec3(q, REAL)));
        bool same = guide_id(past_guide(past)) == REAL_SURFACE && abs(past_distance(past) - there.z) < 0.03 * there.z;
        if (!same || last.deviation.x < 0.0) continue;
        light.a += w * last.a;
        light.b += w * last.b;
        total += w;
    }
    return total;
}

// Returns what hit_relit does, by what the last picture shows of the surface that a ray met.
vec3 hit_pictured(vec3 point, PanoramaHit hit) {
    Light light = Light(vec3(0.0), vec3(0.0), vec2(0.0));
    float total = push.history_valid != 0u && hit.kind == SURFACE ? pictured_light(point, light) : 0.0;
    if (total < 0.25) return hit_relit(hit);
    light.a /= total;
    light.b /= total;
    light_decode(REAL, light);
    return relight(hit_radiance(hit), light.a, light.b);
}

// A ray drawn from a lobe and the panorama's lights together. One of the two strategies is drawn, and the
// weight f·cos/p is that of their mixture (Veach and Guibas 1995, one-sample balance heuristic). `real` is
// what the ray meets of the real scene.
struct Ray {
    vec3 d;
    vec3 weight;       // of what of the real scene it meets
    PanoramaHit real;
    vec3 f;            // what the weight is made of
    float density;
    float emitters;    // the share of rays that are drawn from the emitters
};

// Aims at a light: at a free lamp by what it sends here, or at one of the table. Returns false if the direction
// drawn is behind the surface. `kind` is the lamp's as a hit, 0 for the table's lights.
bool toward_light(vec3 x, vec3 near, vec3 normal, vec2 u, inout Random random, out vec3 d, out vec3 target, out bool far, out uint kind) {
    kind = 0u;
    if (FREE_LAMPS != 0u) {
        float lamps = lamps_weight(near, normal), share = lamps / max(lamps + in_lights.total, 1e-30), left = u.x * (lamps + in_lights.total);
        if (u.x < share) {
            uint k = 0u;
            // Rounding may leave a little over, which the last lamp that shines here gets.
            for (uint i = 0u; i < lamp_count(); i++) {
                float weight = lamp_weight(i, near, normal);
                if (weight > 0.0 && left >= 0.0) {
                    k = i;
                    u.x = min(left / weight, 0.9999999);
                }
                left -= weight;
            }
            kind = LAMP + k;
            d = lamp_sample(k, near, u);
            target = in_lamps.lamp[k].center;
            far = false;
            return dot(d, normal) > 0.0;
        }
        if (in_lights.total <= 0.0) {
            // Nothing but the lamps is brighter than the mean, and none is over this horizon.
            d = target = normal;
            far = true;
            return false;
        }
        u.x = min((u.x - share) / max(1.0 - share, 1e-7), 0.9999999);
    }
    vec3 centre = light_sample(u, random_next2(random));
    ivec2 texel;
    float distance = surface_distance(centre, texel);
    far = distance <= 0.0 || REAL_TRACER == DIRECTION;
    target = centre * distance;
    d = far ? centre : normalize(target - x);
    return dot(d, normal) > 0.0;
}

// A drawn light counts only if the ray meets it first.
bool meets(PanoramaHit hit, vec3 x, vec3 d, vec3 target, bool far, uint kind) {
    if (FREE_LAMPS != 0u && kind != 0u) return hit.kind == kind;
    if (far) return hit.kind == FREE;
    vec3 miss = x + d * hit.t - target;
    return hit.kind == SURFACE && dot(miss, miss) < 1e-4 * dot(target, target);
}

// Returns the density of toward_light per solid angle about x, for what a ray from there met.
float lights_density(vec3 x, vec3 near, vec3 normal, vec3 d, PanoramaHit hit) {
    if (FREE_LAMPS == 0u) return light_density(x, d, hit);
    float all = max(lamps_weight(near, normal) + in_lights.total, 1e-30);
    if (!is_lamp(hit)) return in_lights.total / all * light_density(x, d, hit);
    uint k = min(hit.kind - LAMP, MOST_LAMPS - 1u);
    return lamp_weight(k, near, normal) / all * lamp_density(k, near, d);
}

// A direction that was drawn, and from what.
struct Aim {
    vec3 d;
    bool possible; // whether the lobe can send it
    bool light;    // drawn from the lights
    bool far;      // that light is infinitely far
    vec3 target;   // where that light is
    uint kind;     // of a free lamp as a hit, or 0
    bool sharp;    // the lobe has no density
    vec3 sharp_weight;
    float emitters; // the share of rays that are drawn from the emitters
    bool emitter;  // drawn from them
    uint instance; // of which it is this
    uint triangle;
};

// Returns the share of rays from x that aim at emitters: less where their light is little beside the panorama's, as
// of spheres of their size around their centre.
float emitter_share(vec3 x, bool sharp) {
    if (EMITTERS == 0u || sharp || in_emitters.count == 0u) return 0.0;
    const float MOST = 0.35;
    vec3 off = x - in_emitters.center;
    float light = 1.0 / (in_emitters.inverse_power * 4.0 * max(dot(off, off), in_emitters.radius * in_emitters.radius));
    return MOST * light / (light + 0.25 * in_emitters.surroundings);
}

// Aims at a point of an emitter.
void toward_emitter(vec3 x, float pick, vec2 u, inout Aim aim) {
    uint low = 0u, high = in_emitters.count; // in [low, high)
    while (high - low > 1u) {
        uint middle = (low + high) / 2u;
        if (in_emitters.entry[middle].below <= pick) low = middle; else high = middle;
    }
    aim.instance = in_emitters.entry[low].instance;
    aim.triangle = in_emitters.entry[low].triangle;
    float root = sqrt(u.x);
    vec3 point = scene_point(SceneHit(0.0, aim.instance, aim.triangle, vec2(1.0 - root, u.y * root)));
    aim.d = normalize(point - x);
}

// Returns the density of toward_emitter, per solid angle, for a surface that a ray along d met at t.
float emitter_density(Surface s, float t, vec3 d) {
    return s.shines * in_emitters.inverse_power * t * t / max(abs(dot(s.geometric, d)), 1e-6);
}

// Returns the share of rays that are drawn from the lights. Few of those fall into a narrow lobe, which finds what
// shines in it by itself.
float light_share(bool sharp, uint lobe, Surface s) {
    const float NARROW = 0.1; // the alpha of a lobe for which half of the share is left
    float alpha = 1.0;
    if (SPECULAR != 0u && lobe == GLOSSY) alpha = s.roughness * s.roughness;
    if (CLEARCOAT != 0u && lobe == COAT) alpha = s.clearcoat_roughness * s.clearcoat_roughness;
    float part = alpha < 1.0 && DIRECTIONS != LIGHT ? alpha / (alpha + NARROW) : 1.0;
    return sharp || DIRECTIONS == BRDF ? 0.0 : in_lights.share * part;
}

// Three numbers of a path's first ray: over the frames a pixel's additive sequence, which begins anywhere. Its steps
// were searched for so that 4 to 64 points in a row, and 4 to 64 points of every fourth frame, are spread evenly.
vec3 first_numbers(ivec2 p, uint layer, uint path) {
    uint x = hash(uint(p.x) + hash(uint(p.y) + hash(in_view.view.seed + hash(layer)))), y = hash(x), z = hash(y);
    const uint APART = 64u; // of the paths of one frame
    const uvec3 STEP = uvec3(0x6409ebebu, 0x2f075138u, 0x8ef7fcb5u); // 2³² times 0.39077639, 0.18370540, 0.55847148
    return vec3((uvec3(x, y, z) + (in_view.view.frame + path * APART) * STEP) >> 8u) * (1.0 / 16777216.0);
}

// Draws from a lobe of a surface, or from the lights. Rays to virtual surfaces leave from `near`.
Aim aim(vec3 x, vec3 near, Surface s, Lobes l, uint lobe, vec3 to_eye, vec3 numbers, inout Random random) {
    Aim aim;
    aim.sharp = SPECULAR != 0u && bsdf_is_sharp(s, lobe);
    aim.emitters = emitter_share(near, aim.sharp);
    aim.emitter = EMITTERS != 0u && numbers.z < aim.emitters;
    if (EMITTERS != 0u) numbers.z = (numbers.z - aim.emitters) / (1.0 - aim.emitters);
    aim.light = !aim.emitter && numbers.z < light_share(aim.sharp, lobe, s);
    aim.far = false;
    aim.kind = 0u;
    aim.target = aim.sharp_weight = vec3(0.0);
    aim.possible = true;
    if (aim.emitter) {
        toward_emitter(near, random_next(random), numbers.xy, aim);
        aim.possible = dot(aim.d, s.normal) > 0.0 && dot(aim.d, s.geometric) > 0.0;
    } else if (aim.light) aim.possible = toward_light(x, near, s.normal, numbers.xy, random, aim.d, aim.target, aim.far, aim.kind);
    else {
        float third = TRANSMISSION != 0u ? random_next(random) : 0.0;
        aim.d = bsdf_sample(s, l, lobe, to_eye, vec3(numbers.xy, third), aim.sharp_weight);
        if (lobe != DIFFUSE) aim.possible = bsdf_leaves(s, lobe, aim.d);
    }
    return aim;
}

// Traces the real scene along it.
Ray trace(Aim aim, vec3 x, vec3 near, Surface s, Lobes l, uint lobe, vec3 to_eye) {
    Ray ray = Ray(aim.d, vec3(0.0), PanoramaHit(FAR, vec2(0.0), FREE, vec3(0.0)), vec3(0.0), 0.0, 0.0);
    if (!aim.possible) return ray;
    ray.real = real_trace(x, near, ray.d);
    if (aim.sharp) { ray.weight = aim.sharp_weight; return ray; }
    if (aim.light && !meets(ray.real, x, ray.d, aim.target, aim.far, aim.kind)) return ray;
    float density, share = light_share(aim.sharp, lobe, s);
    vec3 f = bsdf_evaluate(s, l, lobe, to_eye, ray.d, density);
    float p = (1.0 - share) * density + (share > 0.0 ? share * lights_density(x, near, s.normal, ray.d, ray.real) : 0.0);
    if (EMITTERS != 0u) {
        p *= 1.0 - aim.emitters;
        ray.f = f;
        ray.density = p;
        ray.emitters = aim.emitters;
        if (aim.emitter) return ray; // what was aimed at is no real surface
    }
    if (p > 0.0) ray.weight = f / p;
    return ray;
}

// Returns the weight of what a ray brings that met `hit` of the virtual scene first, but for emitted_share.
vec3 mixed_weight(Ray ray, Aim aim, SceneHit hit) {
    if (EMITTERS == 0u || !aim.emitter || ray.density <= 0.0) return ray.weight;
    return hit.instance == aim.instance && hit.triangle == aim.triangle ? ray.f / ray.density : vec3(0.0);
}

// What a ray brings that met a surface is worth less if rays are aimed at it, too.
float emitted_share(Ray ray, Surface s, float t) {
    if (EMITTERS == 0u || ray.density <= 0.0) return 1.0;
    return ray.density / (ray.density + ray.emitters * emitter_density(s, t, ray.d));
}

// Returns what lamps without a surface bring by one lobe, as far as nothing stands between.
vec3 punctual(vec3 x, vec3 near, Surface s, Lobes l, uint lobe, vec3 to_eye, inout Random random) {
    if (PUNCTUAL == 0u || SPECULAR != 0u && bsdf_is_sharp(s, lobe)) return vec3(0.0);
    PunctualChoice chosen = punctual_choose(near, s, l, to_eye, lobe, random);
    if (chosen.weight <= 0.0 || real_trace(x, near, chosen.d).t < chosen.distance * (1.0 - 1e-4)) return vec3(0.0);
    return virtual_trace(near, chosen.d, chosen.distance, false, random).instance == NONE ? chosen.brings : vec3(0.0);
}

const uint MOST_BOUNDARIES = 12u; // of glass, beside the bounces

// What a ray brings with it from where it starts. `wide`: it comes from a lobe that cannot show glass as it is. It passes
// glass on a straight line and takes its colour, because no lamp could be found through what bends rays.
struct Passage {
    bool wide;
    float width;  // of what it shows, metres, at its origin
    float spread; // how much wider per metre
    vec3 medium;  // extinction of the solid that it is in
};

// Of a ray that leaves a surface by a lobe. `from` is how it came there.
Passage passage_by(Passage from, Surface s, uint lobe, vec3 d) {
    return Passage(lobe == DIFFUSE || lobe == SHEEN_LOBE, from.width, max(from.spread, lobe_spread(s, lobe)), medium_after(from.medium, s, lobe, d));
}

// Returns what arrives along a ray, the mixed scene included: real surfaces relit, virtual ones by a path. `hit`
// is the virtual surface that the ray meets, if any. The path's last vertex sees the real scene alone, so that
// no light is lost.
vec3 incoming(vec3 origin, Ray ray, SceneHit hit, Passage passage, inout Random random) {
    vec3 sum = vec3(0.0), throughput = vec3(1.0);
    uint boundaries = 0u;
    for (uint bounce = 1u; hit.instance != NONE; bounce++) {
        passage.width += passage.spread * hit.t;
        vec3 seen_along = VIRTUAL_TRACER == SCREEN ? screen_direction(hit, ray.d) : ray.d;
        Surface s = scene_surface(hit, seen_along, passage.width);
        throughput *= medium_passes(passage.medium, s, hit.t) * emitted_share(ray, s, hit.t);
        if (EMISSION != 0u) sum += throughput * s.emissive;
        vec3 to_eye = -seen_along;
        Lobes l = bsdf_lobes(s, to_eye);
        uint lobe = bsdf_choose(l, random_next(random));
        // A straight line leaves a solid as it came in; what is refracted does, too, but at another angle.
        if (TRANSMISSION != 0u && passage.wide) {
            s.eta = min(s.eta, 1.0 / s.eta);
            s.dispersion = 0.0;
        }
        origin = surface_origin(s);
        if (PUNCTUAL != 0u) sum += throughput * punctual(origin, origin, s, l, lobe, to_eye, random) / bsdf_probability(l, lobe);
        vec3 numbers = vec3(random_next2(random), random_next(random));
        Aim next = aim(origin, origin, s, l, lobe, to_eye, numbers, random);
        if (TRANSMISSION != 0u && lobe == TRANSMITTED) {
            bool through = dot(next.d, s.geometric) < 0.0;
            origin = surface_origin_along(s, next.d);
            if (++boundaries <= MOST_BOUNDARIES) bounce--;
            if (passage.wide && through) {
                passage.medium = medium_after(passage.medium, s, lobe, next.d);
                throughput *= next.sharp_weight / bsdf_probability(l, lobe);
                origin = surface_origin_along(s, ray.d);
                ray.real.t = ray.real.t < FAR ? max(ray.real.t - hit.t, 0.0) : FAR;
                ray.density = 0.0; // what lies behind was not aimed at
                hit.instance = NONE;
                if (INTERREFLECTION != 0u && boundaries < 2u * MOST_BOUNDARIES) hit = virtual_trace(origin, ray.d, ray.real.t, false, random);
                continue;
            }
        }
        ray = trace(next, origin, origin, s, l, lobe, to_eye);
        if (!bsdf_leaves(s, lobe, ray.d)) { throughput = vec3(0.0); break; }
        passage = passage_by(passage, s, lobe, ray.d);
        hit.instance = NONE;
        if (INTERREFLECTION != 0u && bounce < in_view.view.bounces && ((EMITTERS != 0u && next.emitter) || largest(ray.weight) > 0.0))
            hit = virtual_trace(origin, ray.d, ray.real.t, false, random);
        throughput *= mixed_weight(ray, next, hit) / bsdf_probability(l, lobe);
        if (largest(throughput) <= 0.0) break;
    }
    if (PICTURED != 0u && !passage.wide) return sum + throughput * hit_pictured(origin + ray.d * ray.real.t, ray.real);
    return sum + throughput * hit_relit(ray.real);
}

// --- a real surface ---

struct RealStart { vec3 normal; vec3 off_real; vec3 off_virtual; };

// Returns where rays leave a real surface: by more than the steps of its depth for those through the real
// scene, and by almost nothing for those to objects, so that a contact shadow begins at the contact. The first also leave
// towards the capture point, as triangles that cut a corner off have other normals than its surfaces.
RealStart real_start(ivec2 p) {
    uvec4 guide = imageLoad(in_guide, ivec3(p, REAL));
    vec3 point = guide_position(guide), normal = guide_unit_normal(guide);
    float off = FAULT == FAULT_RAYS_FROM_BELOW ? -2e-3 : 2e-3;
    return RealStart(normal, point + (normal - normalize(point)) * (off * length(point)), point + normal * 1e-4);
}

// A real surface as one that lobes start from.
Surface real_lambert(RealStart from) {
    Surface s;
    s.normal = s.geometric = from.normal;
    return s;
}

Aim real_aim(ivec2 p, RealStart from, inout Random random) {
    return aim(from.off_real, from.off_virtual, real_lambert(from), lambert_lobes(), DIFFUSE, vec3(0.0), first_numbers(p, uint(REAL), 0u), random);
}

Ray real_ray(Aim aim, RealStart from) {
    return trace(aim, from.off_real, from.off_virtual, real_lambert(from), lambert_lobes(), DIFFUSE, vec3(0.0));
}

// Finds what the last picture knew of a surface's light, in packed units, and of how many paths. Returns false if it
// showed the surface nowhere.
bool last_light(ivec2 p, int layer, out Light last, out vec2 paths) {
    vec4 motion = vec4(0.0, 0.0, 1.0, 0.0);
    if (push.still == 0u) motion = layer == REAL ? motion_of(vec2(p) + 0.5, guide_position(imageLoad(in_guide, ivec3(p, REAL))), 0.0) : imageLoad(in_motion, p);
    ivec2 q = push.still != 0u ? p : ivec2(floor(vec2(p) + 0.5 + motion.xy));
    if (push.history_valid == 0u || motion.z <= 0.0 || !neighbour(q)) return false;
    last = result_unpack(layer == REAL ? imageLoad(in_light, ivec3(q, REAL)) : imageLoad(in_virtual_light, ivec3(q, VIRTUAL)));
    if (PATH_LIMIT != 0u) paths = imageLoad(in_frames, ivec3(q, LIGHT_BEFORE(layer))).xy;
    return last.deviation.x >= 0.0 && guide_id(imageLoad(in_guide, ivec3(q, layer))) != NO_SURFACE;
}

// Returns the share of the rays from a pixel that are traced if they meet no object: all where objects changed
// much in the last frame, `least_share` where they changed nothing. What is not traced is made up for by the
// weight of what is.
float traced_share(ivec2 p) {
    Light last;
    vec2 paths;
    if (!last_light(p, REAL, last, paths)) return 1.0;
    light_decode(REAL, last);
    const float ALL = 0.04; // a relative change above which all rays are traced
    return clamp(luminance(abs(last.b)) / (ALL * max(luminance(last.a), 1e-20)), push.least_share, 1.0);
}

// Says whether a path may have met a light by chance: it did not aim at one.
bool is_by_chance(Aim aim) { return !aim.light && !(EMITTERS != 0u && aim.emitter); }

// Returns how much luminance a path may bring by chance to a and b, in packed units. One that is found once in many
// thousand would outshine its pixel. It may bring so much more than what is known of the light as that is a mean of paths:
// in the mean it never counts for much more than the rest, and the longer the history, the less is lost.
vec2 path_limit(ivec2 p, int layer) {
    const float EARLY_PATHS = 8.0;
    Light last;
    vec2 paths;
    if (!last_light(p, layer, last, paths)) {
        // The panorama's mean irradiance. What a mirror shows may be as bright as it is.
        const float MEAN = 0.07;
        float changed = layer == REAL ? 0.25 * MEAN * in_view.view.light_units.y / in_view.view.light_units.x : FAR;
        return push.path_limit * EARLY_PATHS * vec2(MEAN, changed);
    }
    vec2 known = vec2(luminance(abs(last.a)), luminance(abs(last.b)));
    // What no object changes now may be in a shadow next, and what is dark may be lit.
    known += layer == REAL ? vec2(0.0, 0.25 * known.x * in_view.view.light_units.y / in_view.view.light_units.x) : vec2(0.1);
    return push.path_limit * (paths + EARLY_PATHS) * known;
}

// Brings light to at most a limit of its luminance.
vec3 limited(vec3 light, float limit) { return light * min(1.0, limit / max(luminance(abs(light)), 1e-20)); }

bool chosen(ivec2 p, float share) {
    Random random = random_begin(uvec2(p), 2u);
    return random_next(random) < share;
}
