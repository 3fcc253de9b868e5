#version 460
#extension GL_GOOGLE_include_directive : require
// Pass 5, temporal (first dispatch): the history of ΔE of real surfaces where an object takes it along (after Zeng et al.
// 2021). It is gathered before temporal changes histories in place.
// In: tiles, followed, guide now and a frame ago; of the last frame accumulated and frames. Out: followed_light (b, and
// for the deviation of a the number of frames; 0: not known).
#include "common.glsl"
#include "bind/images.glsl"
#include "tiles.glsl"
#include "followed.glsl"
#include "guide.glsl"
#include "light_code.glsl"
#include "history.glsl"
layout(local_size_x = 8, local_size_y = 8) in;

void main() {
    ivec2 p;
    if (!tile_pixel(REAL, p) || !is_followed(p)) return;
    uvec2 tile = uvec2(p) / 8u;
    uvec4 guide = imageLoad(in_guide, ivec3(p, REAL));
    vec4 motion = motion_of(vec2(p) + 0.5, guide_position(guide) - in_followed.item[tile.y * tile_count().x + tile.x].xyz, 0.0);
    vec2 at = vec2(p) + motion.xy, f = at - floor(at);
    Light sum = Light(vec3(0.0), vec3(0.0), vec2(0.0));
    float total = 0.0;
    [[unroll]] for (int k = 0; k < 4; k++) {
        ivec2 o = ivec2(k & 1, k >> 1), q = ivec2(floor(at)) + o;
        float w = (o.x == 1 ? f.x : 1.0 - f.x) * (o.y == 1 ? f.y : 1.0 - f.y);
        if (motion.z <= 0.0 || w <= 0.0 || history_weight(q, REAL, motion, guide) == 0.0) continue;
        float length = imageLoad(in_frames, ivec3(q, LIGHT_BEFORE(REAL))).y;
        if (length <= 0.0) continue;
        Light light = brief_unpack(imageLoad(in_accumulated, ivec3(q, REAL)));
        sum.b += w * light.b;
        sum.deviation += w * vec2(length, light.deviation.y);
        total += w;
    }
    bool known = total > 0.01;
    sum.b /= max(total, 1e-6);
    sum.deviation = known ? sum.deviation / total : vec2(0.0);
    // Where there is no surface the last frame's light stays.
    if (guide_id(guide) != NO_SURFACE) imageStore(out_followed_light, ivec3(p, REAL), brief_pack(sum));
}
