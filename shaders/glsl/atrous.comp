#version 460
#extension GL_GOOGLE_include_directive : require
// Pass 5, atrous: one level of an edge-avoiding 5×5 B3-spline filter with steps 1, 2, 4, 8, 16 (Dammertz et
// al. 2010). The fifth level spans 65×65. Plane distance, normal and object id guide it. So does luminance,
// relative to the standard deviation of the accumulated mean, as in SVGF (Schied et al. 2017, eq. 3–5). E_R
// and ΔE share one set of weights, taken from ΔE. The Lambert and the GGX lobe of virtual surfaces have their
// own, and the GGX lobe's radius shrinks with roughness.
// In: tiles, a, b (w: variance), or irradiance_a, _b if the paper's order puts this before temporal;
// position, normal, motion.w (id), moments. Out: a, b.
#include "common.glsl"
#include "parts.glsl"
#include "bind/images.glsl"
#include "list.glsl"
#include "edge_stop.glsl"
layout(local_size_x = 8, local_size_y = 8) in;

layout(push_constant, scalar) uniform Push {
    int step_size;
    float sigma_luminance; // FAR: luminance is ignored
    uint raw;              // 1: the input is one frame's, and its w is no variance
} push;

const float KERNEL[3] = float[3](0.375, 0.25, 0.0625);

void main() {
    if (list_group() >= in_arguments.word[LIST_TILES + 3u]) return;
    uint tile = in_tiles.item[list_group()];
    ivec2 p = ivec2(tile & 0x7fffu, (tile >> 15u) & 0x7fffu) * 8 + ivec2(gl_LocalInvocationID.xy);
    int layer = int(tile >> 30u);
    if (any(greaterThanEqual(p, ivec2(in_view.view.size)))) return;
    if (imageLoad(in_mask, ivec3(p, layer)).x == 0.0) return;

    vec4 a = imageLoad(in_a, ivec3(p, layer)), b = has_b(layer) ? imageLoad(in_b, ivec3(p, layer)) : vec4(0.0);
    if (push.raw != 0u) b.w = 0.0;
    vec4 position = imageLoad(in_position, ivec3(p, layer)), normal = imageLoad(in_normal, ivec3(p, layer));
    float id = imageLoad(in_motion, ivec3(p, layer)).w;
    vec2 luma = vec2(luminance(a.rgb), luminance(b.rgb));
    // A short history has no variance of its own: the first level then ignores luminance and measures the
    // variance.
    bool young = push.step_size == 1 && (push.raw != 0u || imageLoad(in_moments, ivec3(p, layer)).z < 12.0);
    bool known = a.w >= 0.0;
    bool measure = young || !known;

    // The centre's variance is smoothed over 3×3, as in SVGF.
    vec2 variance = vec2(0.0);
    float variance_total = 0.0;
    for (int y = -1; y <= 1; y++) {
        for (int x = -1; x <= 1; x++) {
            ivec2 q = p + ivec2(x, y);
            if (!neighbour(q) || imageLoad(in_mask, ivec3(q, layer)).x == 0.0) continue;
            float w = (x == 0 ? 0.5 : 0.25) * (y == 0 ? 0.5 : 0.25);
            vec2 v = vec2(imageLoad(in_a, ivec3(q, layer)).w, has_b(layer) ? imageLoad(in_b, ivec3(q, layer)).w : 0.0);
            if (v.x < 0.0) continue;
            variance += w * v;
            variance_total += w;
        }
    }
    variance /= max(variance_total, 1e-6);
    vec2 inverse = measure || push.sigma_luminance >= FAR || FAULT == FAULT_FILTER_BLIND ? vec2(0.0) : 1.0 / (push.sigma_luminance * sqrt(variance) + 1e-6);

    // A mirror is not filtered at all. A lobe of roughness ½ or more is filtered with the whole kernel.
    float lobe = layer == VIRTUAL ? 64.0 * normal.w * normal.w : 1e6;
    float pixel = position.w * pixel_angle();
    vec3 sum_a = vec3(0.0), sum_b = vec3(0.0);
    // A pixel that has no neighbour on its surface (noise in depth, a sliver) takes its neighbours' light
    // whatever their surface.
    vec3 loose_a = vec3(0.0), loose_b = vec3(0.0);
    float loose_total = 0.0, geometry_total = 0.0;
    vec2 total = vec2(0.0), variance_sum = vec2(0.0), first = vec2(0.0), second = vec2(0.0);
    for (int y = -2; y <= 2; y++) {
        for (int x = -2; x <= 2; x++) {
            ivec2 q = p + ivec2(x, y) * push.step_size;
            if (!neighbour(q) || imageLoad(in_mask, ivec3(q, layer)).x == 0.0) continue;
            vec4 qa = imageLoad(in_a, ivec3(q, layer));
            if (qa.w < 0.0) continue;
            vec4 qb = has_b(layer) ? imageLoad(in_b, ivec3(q, layer)) : vec4(0.0);
            if (push.raw != 0u) qb.w = 0.0;
            vec4 qn = imageLoad(in_normal, ivec3(q, layer));
            float reach = length(vec2(x, y)) * float(push.step_size);
            float g = x == 0 && y == 0 ? 1.0 : geometry_weight(position, normal, id, imageLoad(in_position, ivec3(q, layer)), qn, imageLoad(in_motion, ivec3(q, layer)).w, pixel * reach);
            float k = KERNEL[abs(x)] * KERNEL[abs(y)];
            loose_a += k * qa.rgb;
            loose_b += k * qb.rgb;
            loose_total += k;
            g *= k;
            geometry_total += g;
            vec2 ql = vec2(luminance(qa.rgb), luminance(qb.rgb));
            vec2 w = g * exp(-abs(ql - luma) * inverse);
            if (layer == REAL) w.x = w.y;
            else w.y *= exp(-reach / max(lobe, 1e-3)) * exp(-16.0 * abs(qn.w - normal.w));
            sum_a += w.x * qa.rgb;
            sum_b += w.y * qb.rgb;
            total += w;
            variance_sum += w * w * vec2(qa.w, qb.w);
            first += w * ql;
            second += w * ql * ql;
        }
    }
    if (total.x <= 1e-12 || total.y <= 1e-12) {
        imageStore(out_a, ivec3(p, layer), known ? a : vec4(vec3(0.0), -1.0));
        if (has_b(layer)) imageStore(out_b, ivec3(p, layer), b);
        return;
    }
    if (layer == REAL && push.step_size == 1 && geometry_total < 1.2 * KERNEL[0] * KERNEL[0]) {
        imageStore(out_a, ivec3(p, layer), vec4(loose_a / loose_total, a.w));
        if (has_b(layer)) imageStore(out_b, ivec3(p, layer), vec4(loose_b / loose_total, b.w));
        return;
    }
    vec2 out_variance = variance_sum / (total * total);
    if (measure) {
        vec2 mean = first / total;
        out_variance = max(out_variance, max(second / total - mean * mean, vec2(0.0)) * 0.15); // the kernel's Σw²
    }
    imageStore(out_a, ivec3(p, layer), vec4(sum_a / total.x, out_variance.x));
    if (has_b(layer)) imageStore(out_b, ivec3(p, layer), vec4(sum_b / total.y, out_variance.y));
}
