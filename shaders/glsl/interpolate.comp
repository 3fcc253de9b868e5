#version 460
#extension GL_GOOGLE_include_directive : require
// Pass 4, interpolate: pixels that were not traced take the mean of traced neighbours on the same surface
// (joint bilateral: plane distance, normal, object, roughness). In: tiles, mask, guide. In/out: irradiance,
// only untraced pixels written.
#include "common.glsl"
#include "parts.glsl"
#include "bind/images.glsl"
#include "tiles.glsl"
#include "mask.glsl"
#include "guide.glsl"
#include "light_code.glsl"
layout(local_size_x = 8, local_size_y = 8) in;
layout(constant_id = 1) const int LAYER = 0;
layout(constant_id = 10) const int RADIUS = 2;

void main() {
    ivec2 p;
    if (!tile_pixel(LAYER, p)) return;
    if (mask_at(ivec3(p, LAYER)) >= 0.0) return;
    uvec4 guide = imageLoad(in_guide, ivec3(p, LAYER));
    vec3 position = guide_position(guide), normal = guide_normal(guide);
    float distance = length(position - in_view.view.position);
    Light sum = Light(vec3(0.0), vec3(0.0), vec2(0.0));
    float total = 0.0;
    for (int y = -RADIUS; y <= RADIUS; y++) {
        for (int x = -RADIUS; x <= RADIUS; x++) {
            ivec2 q = p + ivec2(x, y);
            if (!neighbour(q) || mask_at(ivec3(q, LAYER)) <= 0.0) continue;
            uvec4 other = imageLoad(in_guide, ivec3(q, LAYER));
            float distance2 = float(x * x + y * y);
            float apart = guide_off_plane(position, normal, other) / guide_tolerance(distance, sqrt(distance2));
            apart += distance2 / float(RADIUS * RADIUS) + 8.0 * abs(guide_roughness(other) - guide_roughness(guide));
            float w = guide_facing(guide, normal, other) * exp(-apart);
            Light light = light_unpack(imageLoad(irradiance, ivec3(q, LAYER)));
            sum.a += w * light.a;
            sum.b += w * light.b;
            total += w;
        }
    }
    // Without a traced neighbour on this surface nothing is known. temporal fills that from its history, and
    // atrous from its neighbours.
    Light mean = Light(sum.a / total, sum.b / total, vec2(0.0));
    imageStore(irradiance, ivec3(p, LAYER), total > 1e-6 ? light_pack(mean) : LIGHT_UNKNOWN);
}
