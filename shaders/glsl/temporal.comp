#version 460
#extension GL_GOOGLE_include_directive : require
// Pass 5, temporal: accumulation along motion vectors, with disocclusion tests. The history is clamped to the
// mean and spread of this frame's neighbourhood.
// In: tiles, changes, mask, irradiance of this frame (or what atrous made of it, if it comes first), guide now and
// a frame ago, motion; of the last frame in_accumulated (accumulated itself where the layer stands), or a and b, and frames. Out: accumulated (a and b, with the
// deviations of the mean), frames; where that would not do a and b (w: second moment of the luminance).
#include "common.glsl"
#include "parts.glsl"
#include "bind/images.glsl"
#include "tiles.glsl"
#include "mask.glsl"
#include "changes.glsl"
#include "followed.glsl"
#include "guide.glsl"
#include "light_code.glsl"
#include "history.glsl"
layout(local_size_x = 8, local_size_y = 8) in;
layout(constant_id = 1) const int LAYER = 0;
layout(constant_id = 2) const uint CLAMP = 1;
layout(constant_id = 27) const uint LATTICE = 0;  // 1: the mask traces every second pixel of every second row
layout(constant_id = 31) const uint BRIEF = 0;    // 1: the history is kept in accumulated, in brief
layout(constant_id = 34) const uint INPUT_BRIEF = 0; // 1: this frame's light is in brief, as atrous leaves it
layout(constant_id = 38) const uint FOLLOWS = 0;  // 1: what an object does to the light of real surfaces is followed
layout(constant_id = 12) const uint FILTERED = 0; // 1: atrous came first, and every pixel counts as traced

layout(push_constant, scalar) uniform Push {
    uint history_valid;
    float clamp_spread;
    uint clamp_real; // 1: E_R is clamped, too
    float history_change;
} push;

const bool MOVES = STANDS != STILL && STANDS != STEADY;

// The history of a surface. `spread` holds second moments of the luminances, or with BRIEF variances.
struct History { vec3 a; vec3 b; vec2 spread; vec2 frames; };

const History NOTHING = History(vec3(0.0), vec3(0.0), vec2(0.0), vec2(0.0));

// The variance of a mean of n paths, in units of that of one. Spread evenly they err less, but not where light is rare.
vec2 of_mean(vec2 n) { return 1.0 / n; }

vec2 counted(vec2 frames) {
    vec2 limit = vec2(LAYER == REAL ? in_view.view.history_limit_real : in_view.view.history_limit, in_view.view.history_limit);
    return max(min(frames, limit), vec2(1.0));
}

void add(inout History sum, ivec2 q, int layer, float w) {
    ivec3 at = ivec3(q, layer);
    if (BRIEF != 0u) {
        ivec3 there = ivec3(q, LAYER);
        Light light = brief_unpack(MOVES ? imageLoad(in_accumulated, there) : imageLoad(accumulated, there));
        sum.a += w * light.a;
        sum.b += w * light.b;
        sum.spread += w * light.deviation * light.deviation; // of the mean, until it is known how many frames that is of
    } else {
        vec4 old_a = imageLoad(a, at), old_b = has_b(LAYER) ? imageLoad(b, at) : vec4(0.0);
        sum.a += w * old_a.rgb;
        sum.b += w * old_b.rgb;
        sum.spread += w * vec2(old_a.w, old_b.w);
    }
    sum.frames += w * imageLoad(frames, at).xy;
}

History divided(History sum, float total) {
    if (total <= 0.01) return NOTHING;
    History mean = History(sum.a / total, sum.b / total, sum.spread / total, sum.frames / total);
    if (BRIEF != 0u) mean.spread /= of_mean(counted(mean.frames));
    return mean;
}

Light light_of_frame(ivec3 at) {
    if (INPUT_BRIEF != 0u) return brief_unpack(imageLoad(in_irradiance, at));
    return light_unpack(imageLoad(in_irradiance, at));
}

const float SHARP = 0.1;     // rougher lobes meet things at many distances
const float RESAMPLED = 2.0; // frames

// Says whether a history texel was as smooth a surface of the same object, facing the same way, and reflected what this
// one does: something at the distance that this then had. `q` wraps.
float reflection_weight(inout ivec2 q, vec4 reflected, uvec4 guide) {
    if (!neighbour(q)) return 0.0;
    uvec4 past = imageLoad(in_past, ivec3(q, VIRTUAL)), then = past_guide(past);
    if (guide_id(then) != guide_id(guide) || abs(guide_roughness(then) - guide_roughness(guide)) > 0.1) return 0.0;
    float distance = past_reflected(past);
    if (distance <= 0.0 || (guide_roughness(guide) < SHARP && abs(distance - reflected.w) > 0.1 * reflected.w)) return 0.0;
    return dot(guide_normal(then), guide_normal(guide)) > 0.85 * 127.0 * 127.0 ? 1.0 : 0.0;
}

// Returns the mean history around a place of the last frame: of this surface, or with REFLECTED of what it reflects.
History resample(vec2 at, vec4 motion, uvec4 guide, bool reflected) {
    History old = NOTHING;
    float total = 0.0;
    ivec2 i = ivec2(floor(at));
    vec2 f = at - vec2(i);
    [[unroll]] for (int k = 0; k < 4; k++) {
        ivec2 o = ivec2(k & 1, k >> 1), q = i + o;
        float w = (o.x == 1 ? f.x : 1.0 - f.x) * (o.y == 1 ? f.y : 1.0 - f.y);
        if (w <= 0.0 || (reflected ? reflection_weight(q, motion, guide) : history_weight(q, LAYER, motion, guide)) == 0.0) continue;
        if (imageLoad(frames, ivec3(q, LIGHT_BEFORE(LAYER))).x <= 0.0) continue;
        add(old, q, LIGHT_BEFORE(LAYER), w);
        total += w;
    }
    return divided(old, total);
}

// Returns the mean history of this surface, of length 0 if there is none.
History reproject(ivec2 p, uvec4 guide) {
    History old = NOTHING;
    if (push.history_valid == 0u) return old;
    float total = 1.0;
    if (STANDS == STILL) add(old, p, LIGHT_NOW(LAYER), 1.0);
    else if (STANDS == STEADY) {
        ivec2 q = p;
        total = history_weight(q, LAYER, motion_at(p, LAYER, guide), guide);
        if (imageLoad(frames, ivec3(p, LIGHT_NOW(LAYER))).x <= 0.0) total = 0.0;
        add(old, p, LIGHT_NOW(LAYER), total);
    } else {
        vec4 motion = motion_at(p, LAYER, guide);
        if (motion.z <= 0.0) return old;
        bool still = dot(motion.xy, motion.xy) < 1e-6; // a still pixel is not resampled
        return resample(vec2(p) + (still ? vec2(0.0) : motion.xy), motion, guide, false);
    }
    return divided(old, total);
}

void main() {
    ivec2 p;
    if (!tile_pixel(LAYER, p)) return;
    ivec3 at = ivec3(p, LAYER), kept = ivec3(p, LIGHT_NOW(LAYER));
    float mask = mask_at(at);
    if (mask == 0.0) {
        imageStore(frames, kept, vec4(0.0));
        return;
    }
    uvec4 guide = imageLoad(in_guide, ivec3(p, LAYER));
    Light light = light_of_frame(at);
    bool fresh = FILTERED != 0u ? light.deviation.x >= 0.0 : mask > 0.0;
    float paths = FILTERED != 0u ? 1.0 : max(mask, 1.0);
    bool known = fresh || light.deviation.x >= 0.0;
    if (!known) light = Light(vec3(0.0), vec3(0.0), vec2(0.0));
    vec2 luma = vec2(luminance(light.a), luminance(light.b)), spread = BRIEF != 0u ? vec2(0.0) : luma * luma;
    vec2 age = vec2(fresh ? paths : known ? 0.5 : 0.0);

    History old = reproject(p, guide);
    if (REFLECTIONS != 0u && MOVES && mask > 0.0 && push.history_valid != 0u) {
        // What a smooth surface reflects has a history where that was seen.
        vec4 reflected = imageLoad(in_reflected, p);
        if (reflected.z > 0.0) {
            bool still = dot(reflected.xy, reflected.xy) < 1e-6;
            History seen = resample(vec2(p) + (still ? vec2(0.0) : reflected.xy), reflected, guide, true);
            old.b = seen.b;
            old.spread.y = seen.spread.y;
            old.frames.y = seen.frames.y;
            // What is sharp has little noise, and each resampling blurs it.
            if (!still && guide_roughness(guide) < SHARP) old.frames.y = min(old.frames.y, RESAMPLED);
        }
    }
    if (FOLLOWS != 0u && LAYER == REAL && old.frames.y > 0.0 && is_followed(p)) {
        // Where the layer moves, it is where the new history goes.
        Light followed = brief_unpack(MOVES ? imageLoad(accumulated, at) : imageLoad(in_followed_light, at));
        if (followed.deviation.x > 0.0) {
            old.b = followed.b;
            old.frames.y = followed.deviation.x;
            old.spread.y = followed.deviation.y * followed.deviation.y / of_mean(counted(old.frames)).y;
        }
    }
    if (old.frames.x > 0.0) {
        if (CLAMP != 0u) {
            vec3 mean_a = vec3(0.0), mean_b = vec3(0.0), square_a = vec3(0.0), square_b = vec3(0.0);
            float count = 0.0;
            // Where the mask traces a lattice, no other neighbours need to be looked at.
            const ivec2 PHASE[4] = ivec2[4](ivec2(0, 0), ivec2(1, 1), ivec2(1, 0), ivec2(0, 1)); // as in_turn has it
            ivec2 first = LATTICE != 0u ? (p ^ PHASE[in_view.view.frame & 3u]) & 1 : ivec2(0);
            const int STEP = LATTICE != 0u ? 2 : 1, REACH = 2 / STEP;
            [[unroll]] for (int y = -REACH; y <= REACH; y++) {
                [[unroll]] for (int x = -REACH; x <= REACH; x++) {
                    ivec2 offset = first + STEP * ivec2(x, y), q = p + offset;
                    if (any(greaterThan(offset, ivec2(2))) || !neighbour(q)) continue;
                    float taken = mask_at(ivec3(q, LAYER));
                    if (FILTERED != 0u ? taken == 0.0 : taken <= 0.0) continue;
                    if (guide_id(imageLoad(in_guide, ivec3(q, LAYER))) != guide_id(guide)) continue;
                    Light other = light_of_frame(ivec3(q, LAYER));
                    mean_a += other.a; square_a += other.a * other.a;
                    mean_b += other.b; square_b += other.b * other.b;
                    count += 1.0;
                }
            }
            if (count >= 4.0) {
                mean_a /= count; mean_b /= count;
                vec3 spread_a = push.clamp_spread * sqrt(max(square_a / count - mean_a * mean_a, vec3(0.0)));
                vec3 spread_b = push.clamp_spread * sqrt(max(square_b / count - mean_b * mean_b, vec3(0.0)));
                if (LAYER == VIRTUAL || push.clamp_real != 0u) old.a = clamp(old.a, mean_a - spread_a, mean_a + spread_a);
                old.b = clamp(old.b, mean_b - spread_b, mean_b + spread_b);
            }
        }
        age = min(old.frames, history_limit(p, LAYER, push.history_change));
        if (fresh) age = max(min(age + paths, counted(vec2(FAR))), vec2(paths));
        vec2 blend = fresh ? paths / max(age, vec2(1.0)) : vec2(0.0); // an interpolated value adds nothing to a history
        vec2 luma_old = vec2(luminance(old.a), luminance(old.b));
        if (BRIEF != 0u) spread = (1.0 - blend) * (old.spread + blend * paths * (luma - luma_old) * (luma - luma_old)); // of one path
        else spread = mix(old.spread, spread, blend);
        light.a = mix(old.a, light.a, blend.x);
        light.b = mix(old.b, light.b, blend.y);
        known = true;
    }
    if (FAULT == FAULT_DRIFT) { light.a *= 1.2; light.b *= 1.2; }
    luma = vec2(luminance(light.a), luminance(light.b));
    vec2 variance = BRIEF != 0u ? spread : max(spread - luma * luma, vec2(0.0));
    light.deviation = sqrt(variance * of_mean(counted(age)));
    imageStore(frames, kept, vec4(age, 0.0, 0.0));
    if (BRIEF != 0u) {
        uint random = hash(in_view.view.frame + hash(uint(p.x) | uint(p.y) << 16u));
        imageStore(accumulated, at, known ? brief_pack_by_chance(light, random) : LIGHT_UNKNOWN);
    } else {
        imageStore(a, kept, vec4(light.a, spread.x));
        if (has_b(LAYER)) imageStore(b, kept, vec4(light.b, spread.y));
        imageStore(accumulated, at, known ? light_pack(light) : LIGHT_UNKNOWN);
    }
}
