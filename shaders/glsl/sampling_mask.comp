#version 460
#extension GL_GOOGLE_include_directive : require
// Pass 2, sampling_mask: chooses the pixels that are traced this frame, and lists them for real and for
// virtual surfaces (IPRT §2, "sparse sampling mask").
// In: tiles, changes, guide now and a frame ago, motion of virtual surfaces, frames. Out: mask (paths; 0 nothing there, -1 not traced), list,
// arguments; irradiance of pixels that nothing will fill.
#include "common.glsl"
#include "parts.glsl"
#include "bind/images.glsl"
#include "append.glsl"
#include "tiles.glsl"
#include "changes.glsl"
#include "turn.glsl"
#include "mask.glsl"
#include "guide.glsl"
#include "light_code.glsl"
#include "history.glsl"
layout(local_size_x = 8, local_size_y = 8) in;

layout(constant_id = 1) const int LAYER = 0;
layout(constant_id = 15) const uint DENSE = 0;            // 1: every pixel is traced
layout(constant_id = 24) const uint BY_DISCONTINUITY = 0; // 1: the mask is made by edges, not by turns
layout(constant_id = 37) const uint EARLY = 0;            // 1: new virtual surfaces have several paths
layout(constant_id = 25) const uint MARK_UNTRACED = 0;    // 1: nothing will fill untraced pixels, so they are marked as unknown here

layout(push_constant, scalar) uniform Push {
    uint history_valid;
    uint short_history;
    float sharp_roughness;
    float mask_cosine;   // of the angle between normals
    float mask_distance; // from the tangent plane, relative to the distance
    float history_change;
    float early_paths;
    float early_history;
} push;

// Returns the rays for 16 pixels: 16 if the 3×3 neighbours leave the surface, 4 if the 5×5 do, else 1.
uint discontinuity_share(ivec2 p, int layer, uvec4 guide) {
    vec3 position = guide_position(guide), normal = guide_normal(guide);
    float most = push.mask_distance * length(position - in_view.view.position);
    uint share = 1u;
    for (int y = -2; y <= 2; y++) {
        for (int x = -2; x <= 2; x++) {
            ivec2 q = p + ivec2(x, y);
            if (!neighbour(q)) continue;
            uvec4 other = imageLoad(in_guide, ivec3(q, layer));
            bool same = guide_id(other) == guide_id(guide) && guide_off_plane(position, normal, other) <= most
                && dot(guide_normal(other), normal) >= push.mask_cosine * (127.0 * 127.0);
            if (same) continue;
            if (max(abs(x), abs(y)) < 2) return 16u;
            share = 4u;
        }
    }
    return share;
}

// Returns how many paths the histories of a surface hold; 0 if it has none.
vec2 history_length(ivec2 p, int layer, uvec4 guide) {
    if (push.history_valid == 0u) return vec2(0.0);
    if (STANDS == STILL) return imageLoad(in_frames, ivec3(p, LIGHT_NOW(layer))).xy;
    vec4 motion = motion_at(p, layer, guide);
    if (motion.z <= 0.0) return vec2(0.0);
    ivec2 q = ivec2(floor(vec2(p) + 0.5 + motion.xy));
    return history_weight(q, layer, motion, guide) > 0.0 ? imageLoad(in_frames, ivec3(q, LIGHT_BEFORE(layer))).xy : vec2(0.0);
}

// Returns how many paths a surface gets in this frame.
float path_count(ivec2 p, int layer, uvec4 guide) {
    bool turn = DENSE != 0u || tile_is_dense(layer)
        || in_turn(p, BY_DISCONTINUITY != 0u ? discontinuity_share(p, layer, guide) : in_view.view.rays_per_16)
        || (layer == VIRTUAL && guide_roughness(guide) < push.sharp_roughness);
    float most = EARLY != 0u && layer == VIRTUAL ? push.early_paths : 1.0;
    if (turn && most <= 1.0) return 1.0;
    if (push.short_history == 0u) return turn ? 1.0 : 0.0;
    // Newly seen surfaces trace every pixel until they have some history.
    vec2 limit = history_limit(p, layer, push.history_change), length = history_length(p, layer, guide), left = min(length, limit);
    // Where light changes all the time, no history grows long.
    float young = push.early_history * most / push.early_paths;
    if (EARLY != 0u && min(length.x, length.y) < young && min(limit.x, limit.y) >= 2.0 * push.early_history) return most;
    return turn || min(left.x, left.y) < float(push.short_history) ? 1.0 : 0.0;
}

void main() {
    ivec2 p;
    bool inside = tile_pixel(LAYER, p);
    uvec4 guide = imageLoad(in_guide, ivec3(p, LAYER));
    bool present = inside && in_view.view.instance_count + in_view.view.light_count > 0u && guide_id(guide) != NO_SURFACE;
    float paths = present ? path_count(p, LAYER, guide) : 0.0;
    bool trace = paths > 0.0;
    if (inside) imageStore(out_mask, ivec3(p, LAYER), vec4((present && !trace ? -1.0 : paths) / MOST_PATHS));
    if (MARK_UNTRACED != 0u && present && !trace) imageStore(out_irradiance, ivec3(p, LAYER), LIGHT_UNKNOWN);
    append_pixels(bvec2(LAYER == REAL && trace, LAYER == VIRTUAL && trace), p);
}
