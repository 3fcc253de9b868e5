#version 460
#extension GL_GOOGLE_include_directive : require
// Pass 4, interpolate: pixels that were not traced take the mean of traced neighbours on the same surface
// (joint bilateral: plane distance, normal, object id, roughness). In: tiles, mask, position, normal,
// motion.w (id). In/out: irradiance_a, irradiance_b, only untraced pixels written.
#include "common.glsl"
#include "parts.glsl"
#include "bind/images.glsl"
#include "list.glsl"
#include "edge_stop.glsl"
layout(local_size_x = 8, local_size_y = 8) in;

layout(push_constant, scalar) uniform Push { int radius; } push;

void main() {
    if (list_group() >= in_arguments.word[LIST_TILES + 3u]) return;
    uint tile = in_tiles.item[list_group()];
    ivec2 p = ivec2(tile & 0x7fffu, (tile >> 15u) & 0x7fffu) * 8 + ivec2(gl_LocalInvocationID.xy);
    int layer = int(tile >> 30u);
    if (any(greaterThanEqual(p, ivec2(in_view.view.size)))) return;
    if (imageLoad(in_mask, ivec3(p, layer)).x != 2.0) return;
    vec4 position = imageLoad(in_position, ivec3(p, layer)), normal = imageLoad(in_normal, ivec3(p, layer));
    float id = imageLoad(in_motion, ivec3(p, layer)).w;
    float pixel = position.w * pixel_angle();
    vec4 a = vec4(0.0), b = vec4(0.0);
    float total = 0.0;
    for (int y = -push.radius; y <= push.radius; y++) {
        for (int x = -push.radius; x <= push.radius; x++) {
            ivec2 q = p + ivec2(x, y);
            if (!neighbour(q) || imageLoad(in_mask, ivec3(q, layer)).x != 1.0) continue;
            vec4 n = imageLoad(in_normal, ivec3(q, layer));
            float distance2 = float(x * x + y * y);
            float w = geometry_weight(position, normal, id, imageLoad(in_position, ivec3(q, layer)), n, imageLoad(in_motion, ivec3(q, layer)).w, pixel * sqrt(distance2));
            w *= exp(-distance2 / float(push.radius * push.radius)) * exp(-8.0 * abs(n.w - normal.w));
            a += w * imageLoad(irradiance_a, ivec3(q, layer));
            if (has_b(layer)) b += w * imageLoad(irradiance_b, ivec3(q, layer));
            total += w;
        }
    }
    // Without a traced neighbour on this surface nothing is known (w < 0). temporal fills that from its
    // history, and atrous from its neighbours.
    bool known = total > 1e-6;
    imageStore(irradiance_a, ivec3(p, layer), known ? vec4(a.rgb / total, 0.0) : vec4(vec3(0.0), -1.0));
    if (has_b(layer)) imageStore(irradiance_b, ivec3(p, layer), known ? b / total : vec4(0.0));
}
