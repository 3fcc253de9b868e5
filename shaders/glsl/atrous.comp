#version 460
#extension GL_GOOGLE_include_directive : require
// Pass 5, atrous: one level of an edge-avoiding B3-spline filter with steps 1, 2, 4 … (Dammertz et al. 2010),
// of 3×3 or 5×5 taps. Plane distance, normal and object guide it. So does luminance, relative to the standard
// deviation of the accumulated mean, as in SVGF (Schied et al. 2017, eq. 3–5). E_R and ΔE share one set of
// weights, taken from ΔE. The Lambert and the GGX lobe of virtual surfaces have their own, and the GGX lobe's
// radius shrinks with roughness.
// In: tiles, guide, light, or irradiance if the paper's order puts this before temporal; frames. Out: light; after the
// last level tile_light.
#include "common.glsl"
#include "parts.glsl"
#include "bind/images.glsl"
#include "tiles.glsl"
#include "guide.glsl"
#include "light_code.glsl"
#include "light_units.glsl"
layout(local_size_x = 8, local_size_y = 8) in;
layout(constant_id = 1) const int LAYER = 0;
layout(constant_id = 10) const int RADIUS = 1;
layout(constant_id = 12) const uint RAW = 0;   // 1: the input is one frame's, and has no deviation
layout(constant_id = 13) const uint FIRST = 1; // 1: the first level, of step 1

layout(constant_id = 31) const uint BRIEF = 0;  // 1: the first level reads light in brief
layout(constant_id = 33) const uint LAST = 1;   // 1: the last level, whose result is rounded by chance, so that it has no steps
layout(constant_id = 36) const uint RESTS = 0; // 1: the last level, which says how noisy a tile of real surfaces is

layout(push_constant, scalar) uniform Push {
    int step_size;
    float sigma_luminance; // FAR: luminance is ignored
    float unseen; // the share of its light by which a real surface may differ unseen
} push;

const float KERNEL[2][3] = float[2][3](float[3](0.5, 0.25, 0.0), float[3](0.375, 0.25, 0.0625));

Light light_at(ivec2 q) {
    uvec4 code = imageLoad(in_light, ivec3(q, LAYER));
    return BRIEF != 0u || FIRST == 0u ? brief_unpack(code) : light_unpack(code);
}

// About exp(-x), at a third of its cost: (1 - x/8)^8.
vec2 falling(vec2 x) {
    vec2 y = max(vec2(0.0), 1.0 - x * 0.125);
    y *= y; y *= y;
    return y * y;
}

// Returns the deviations of the centre, smoothed over 3×3 as in SVGF.
vec2 smooth_deviation(ivec2 p) {
    vec2 variance = vec2(0.0);
    float total = 0.0;
    [[unroll]] for (int y = -1; y <= 1; y++) {
        [[unroll]] for (int x = -1; x <= 1; x++) {
            ivec2 q = p + ivec2(x, y);
            bool inside = neighbour(q);
            vec2 deviation = light_at(q).deviation;
            float w = (x == 0 ? 0.5 : 0.25) * (y == 0 ? 0.5 : 0.25);
            if (!inside || deviation.x < 0.0 || guide_id(imageLoad(in_guide, ivec3(q, LAYER))) == NO_SURFACE) continue;
            variance += w * deviation * deviation;
            total += w;
        }
    }
    return sqrt(variance / max(total, 1e-6));
}

void main() {
    ivec2 p;
    if (!tile_pixel(LAYER, p)) return;
    ivec3 at = ivec3(p, LAYER);
    uvec4 guide = imageLoad(in_guide, ivec3(p, LAYER));
    if (guide_id(guide) == NO_SURFACE) return;
    Light light = light_at(p);
    bool known = light.deviation.x >= 0.0;
    vec3 position = guide_position(guide), normal = guide_normal(guide);
    float distance = length(position - in_view.view.position), roughness = guide_roughness(guide);
    vec2 luma = vec2(luminance(light.a), luminance(light.b));
    // A short history has no variance of its own: the first level then ignores luminance and measures the
    // variance.
    bool measure = FIRST != 0u && (RAW != 0u || imageLoad(in_frames, ivec3(p, LIGHT_NOW(LAYER))).y < 8.0) || !known;
    // How far luminance may be off: by the noise of both, so that what is bright by chance is shared out.
    vec2 within = vec2(FAR);
    float part = 0.0;
    if (push.sigma_luminance < FAR && FAULT != FAULT_FILTER_BLIND) {
        vec2 deviation = FIRST != 0u && RAW == 0u ? max(smooth_deviation(p), light.deviation) : light.deviation;
        // What nobody sees may be smoothed away, however well it is known, so that no grain is kept.
        vec2 unseen = vec2(LAYER == REAL ? push.unseen * luma.x * in_view.view.light_units.y / in_view.view.light_units.x : 0.0);
        part = 0.5 * push.sigma_luminance;
        if (!measure) within = part * deviation + unseen + 1e-6;
    }

    // A mirror is not filtered at all. A lobe of roughness ½ or more is filtered with the whole kernel.
    float inverse_lobe = 1.0 / max(64.0 * roughness * roughness, 1e-3);
    vec3 sum_a = vec3(0.0), sum_b = vec3(0.0);
    // A pixel that has no neighbour on its surface (noise in depth, a sliver) takes its neighbours' light
    // whatever their surface.
    vec3 loose_a = vec3(0.0), loose_b = vec3(0.0);
    float loose_total = 0.0, geometry_total = 0.0;
    vec2 total = vec2(0.0), variance_sum = vec2(0.0), first = vec2(0.0), second = vec2(0.0);
    [[unroll]] for (int y = -RADIUS; y <= RADIUS; y++) {
        [[unroll]] for (int x = -RADIUS; x <= RADIUS; x++) {
            ivec2 q = p + ivec2(x, y) * push.step_size;
            bool inside = neighbour(q);
            uvec4 other = imageLoad(in_guide, ivec3(q, LAYER));
            Light there = light_at(q);
            float k = KERNEL[RADIUS - 1][abs(x)] * KERNEL[RADIUS - 1][abs(y)];
            if (!inside || there.deviation.x < 0.0 || guide_id(other) == NO_SURFACE) k = 0.0;
            float reach = length(vec2(x, y)) * float(push.step_size), g = k, apart = 0.0;
            if (x != 0 || y != 0) {
                g *= guide_facing(guide, normal, other);
                apart = guide_off_plane(position, normal, other) * (1.0 / guide_tolerance(distance, reach)); // one division for all taps as far off
            }
            vec2 there_luma = vec2(luminance(there.a), luminance(there.b));
            vec2 far = apart + abs(there_luma - luma) / (within + part * max(there.deviation, vec2(0.0)));
            if (LAYER == VIRTUAL) far.y += reach * inverse_lobe + 16.0 * abs(guide_roughness(other) - roughness);
            vec2 w = LAYER == REAL ? vec2(g * falling(far.yy).y) : g * falling(far);
            if (FIRST != 0u && LAYER == REAL) {
                loose_a += k * there.a;
                loose_b += k * there.b;
                loose_total += k;
                geometry_total += g * exp(-apart);
            }
            sum_a += w.x * there.a;
            sum_b += w.y * there.b;
            total += w;
            if (RAW == 0u) variance_sum += w * w * there.deviation * there.deviation;
            if (FIRST != 0u) {
                first += w * there_luma;
                second += w * there_luma * there_luma;
            }
        }
    }
    float alone = KERNEL[RADIUS - 1][0] * KERNEL[RADIUS - 1][0];
    if (min(total.x, total.y) > 1e-12) {
        light.deviation = sqrt(variance_sum) / total;
        if (FIRST != 0u && measure) {
            vec2 mean = first / total;
            light.deviation = max(light.deviation, sqrt(max(second / total - mean * mean, vec2(0.0)) * 0.15)); // the kernel's Σw²
        }
        light.a = sum_a / total.x;
        light.b = sum_b / total.y;
        if (FIRST != 0u && LAYER == REAL && geometry_total < 1.2 * alone) {
            light.a = loose_a / loose_total;
            light.b = loose_b / loose_total;
        }
        known = true;
    }
    imageStore(out_light, at, known ? (LAST != 0u ? brief_pack_by_chance(light, hash(uint(p.x) | uint(p.y) << 16u)) : brief_pack(light)) : LIGHT_UNKNOWN);
    if (RESTS != 0u) {
        light_decode(LAYER, light);
        vec2 deviation = light.deviation / in_view.view.light_units;
        float real = max(luminance(light.a), 1e-20), effect = abs(luminance(light.b)) / real, left = max(1.0 + luminance(light.b) / real, 1e-3);
        // E_R errs, too, and the change with it
        float error = (deviation.y + effect * deviation.x) / (real * left);
        uvec2 tile = uvec2(p) / 8u;
        uint at_tile = 2u * (tile.y * tile_count().x + tile.x);
        atomicMax(tile_light.item[at_tile], floatBitsToUint(known ? error : FAR));
        atomicMax(tile_light.item[at_tile + 1u], floatBitsToUint(known ? effect : 1.0));
    }
}
