#version 460
#extension GL_GOOGLE_include_directive : require
// Pass 5, temporal: accumulation along motion vectors, with disocclusion tests. The history is clamped to the
// mean and spread of this frame's neighbourhood.
// In: tiles, mask, irradiance_a/b of this frame (or what atrous made of them, if it comes first), position,
// normal, motion now and a frame ago, history_*. Out: accumulated a, b (w: variance of the mean), moments (x,
// y: second moments of the luminances of a and b; z: history length, frames; w: hit distance, metres).
#include "common.glsl"
#include "parts.glsl"
#include "bind/images.glsl"
#include "list.glsl"
#include "history.glsl"
layout(local_size_x = 8, local_size_y = 8) in;
layout(constant_id = 2) const uint CLAMP = 1;

layout(push_constant, scalar) uniform Push { uint history_valid; uint filtered; float clamp_spread; } push;

void main() {
    if (list_group() >= in_arguments.word[LIST_TILES + 3u]) return;
    uint tile = in_tiles.item[list_group()];
    ivec2 p = ivec2(tile & 0x7fffu, (tile >> 15u) & 0x7fffu) * 8 + ivec2(gl_LocalInvocationID.xy);
    int layer = int(tile >> 30u);
    if (any(greaterThanEqual(p, ivec2(in_view.view.size)))) return;
    float mask = imageLoad(in_mask, ivec3(p, layer)).x;
    if (mask == 0.0) {
        imageStore(out_moments, ivec3(p, layer), vec4(0.0));
        return;
    }
    vec4 motion = imageLoad(in_motion, ivec3(p, layer));
    vec3 normal = imageLoad(in_normal, ivec3(p, layer)).xyz;
    vec4 a = imageLoad(in_irradiance_a, ivec3(p, layer)), b = has_b(layer) ? imageLoad(in_irradiance_b, ivec3(p, layer)) : vec4(0.0);
    bool fresh = push.filtered != 0u ? a.w >= 0.0 : mask == 1.0; // a filtered pixel counts like a traced one
    bool known = fresh || a.w >= 0.0;
    if (!known) { a = vec4(0.0); b = vec4(0.0); }
    vec2 luma = vec2(luminance(a.rgb), luminance(b.rgb));
    vec4 moments = vec4(luma * luma, fresh ? 1.0 : known ? 0.5 : 0.0, b.w);

    vec3 old_a = vec3(0.0), old_b = vec3(0.0);
    vec4 old_moments = vec4(0.0);
    float total = 0.0;
    if (push.history_valid != 0u && motion.z > 0.0) {
        vec2 at = vec2(p) + motion.xy;
        if (dot(motion.xy, motion.xy) < 1e-6) at = vec2(p); // a still pixel is not resampled
        ivec2 i = ivec2(floor(at));
        vec2 f = at - vec2(i);
        for (int k = 0; k < 4; k++) {
            ivec2 o = ivec2(k & 1, k >> 1);
            float w = (o.x == 1 ? f.x : 1.0 - f.x) * (o.y == 1 ? f.y : 1.0 - f.y);
            ivec2 q = i + o;
            if (w <= 0.0 || !neighbour(q)) continue;
            vec4 m = imageLoad(history_moments, ivec3(q, layer));
            w *= m.z > 0.0 ? history_weight(q, layer, motion, normal) : 0.0;
            if (w <= 0.0) continue;
            old_a += w * imageLoad(history_a, ivec3(q, layer)).rgb;
            if (has_b(layer)) old_b += w * imageLoad(history_b, ivec3(q, layer)).rgb;
            old_moments += w * m;
            total += w;
        }
    }
    if (total > 0.01) {
        known = true;
        old_a /= total; old_b /= total; old_moments /= total;
        if (CLAMP != 0u) {
            vec3 mean_a = vec3(0.0), mean_b = vec3(0.0), square_a = vec3(0.0), square_b = vec3(0.0);
            float count = 0.0;
            for (int y = -2; y <= 2; y++) {
                for (int x = -2; x <= 2; x++) {
                    ivec2 q = p + ivec2(x, y);
                    if (!neighbour(q) || imageLoad(in_motion, ivec3(q, layer)).w != motion.w) continue;
                    float taken = imageLoad(in_mask, ivec3(q, layer)).x;
                    if (push.filtered != 0u ? taken == 0.0 : taken != 1.0) continue;
                    vec3 ca = imageLoad(in_irradiance_a, ivec3(q, layer)).rgb, cb = has_b(layer) ? imageLoad(in_irradiance_b, ivec3(q, layer)).rgb : vec3(0.0);
                    mean_a += ca; square_a += ca * ca;
                    mean_b += cb; square_b += cb * cb;
                    count += 1.0;
                }
            }
            if (count >= 4.0) {
                mean_a /= count; mean_b /= count;
                vec3 spread_a = push.clamp_spread * sqrt(max(square_a / count - mean_a * mean_a, vec3(0.0)));
                vec3 spread_b = push.clamp_spread * sqrt(max(square_b / count - mean_b * mean_b, vec3(0.0)));
                vec3 clamped_a = clamp(old_a, mean_a - spread_a, mean_a + spread_a), clamped_b = clamp(old_b, mean_b - spread_b, mean_b + spread_b);
                old_a = clamped_a;
                old_b = clamped_b;
            }
        }
        float length = fresh ? min(old_moments.z + 1.0, float(in_view.view.history_limit)) : old_moments.z;
        float blend = fresh ? 1.0 / max(length, 1.0) : 0.0; // an interpolated value adds nothing to a history
        a.rgb = mix(old_a, a.rgb, blend);
        b.rgb = mix(old_b, b.rgb, blend);
        moments = vec4(mix(old_moments.xy, moments.xy, blend), length, mix(old_moments.w, moments.w, blend));
        luma = vec2(luminance(a.rgb), luminance(b.rgb));
    }
    if (FAULT == FAULT_DRIFT) { a.rgb *= 1.2; b.rgb *= 1.2; }
    vec2 variance = max(moments.xy - luma * luma, vec2(0.0)) / max(moments.z, 1.0);
    imageStore(out_a, ivec3(p, layer), vec4(a.rgb, known ? variance.x : -1.0)); // negative: nothing is known here yet
    if (has_b(layer)) imageStore(out_b, ivec3(p, layer), vec4(b.rgb, variance.y));
    imageStore(out_moments, ivec3(p, layer), moments);
}
