#version 460
#extension GL_GOOGLE_include_directive : require
// Pass 2, sampling_mask: chooses the pixels that are traced this frame. It lists them for real and for
// virtual surfaces, with the 8×8 tiles that the later passes visit (IPRT §2, "sparse sampling mask").
// In: position, normal, coverage, motion; history: position, normal, motion, length. Out: mask (0 nothing
// there, 1 traced, 2 interpolated), lists, arguments; irradiance_a, _b of pixels that nothing will fill.
#include "common.glsl"
#include "parts.glsl"
#include "bind/images.glsl"
#include "list.glsl"
#include "history.glsl"
layout(local_size_x = 8, local_size_y = 8) in;

layout(push_constant, scalar) uniform Push {
    uint dense;
    uint history_valid;
    uint short_history;
    float sharp_roughness;
    uint by_discontinuity;
    float mask_cosine;   // of the angle between normals
    float mask_distance; // from the tangent plane, relative to the distance
    uint mark_untraced;  // 1: nothing will fill untraced pixels, so they are marked as unknown here
} push;

shared uint group_count[2];
shared uint group_base[2];
shared uint active_count[2];

// A 4×4 ordered dither, in which the ranks of every power-of-two share are spread evenly.
const uvec4 RANK[4] = uvec4[4](uvec4(0u, 8u, 2u, 10u), uvec4(12u, 4u, 14u, 6u), uvec4(3u, 11u, 1u, 9u), uvec4(15u, 7u, 13u, 5u));

// Says which of the 4×4 pixels are traced in a frame: so many of 16, and all of them in turn.
bool in_turn(ivec2 p, uint share) {
    uint rank = RANK[p.y & 3][p.x & 3];
    return (rank + 16u - (in_view.view.frame * share) % 16u) % 16u < share;
}

bool shows(ivec2 p, int layer) {
    if (VIRTUAL_SURFACES == 0u) return layer == REAL;
    float coverage = imageLoad(in_real_coverage, p).x;
    return layer == REAL ? coverage > 0.0 : coverage < 1.0;
}

// Returns the rays for 16 pixels: 16 if the 3×3 neighbours leave the surface, 4 if the 5×5 do, else 1.
uint discontinuity_share(ivec2 p, int layer) {
    vec4 position = imageLoad(in_position, ivec3(p, layer));
    vec3 normal = imageLoad(in_normal, ivec3(p, layer)).xyz;
    float id = imageLoad(in_motion, ivec3(p, layer)).w;
    uint share = 1u;
    for (int y = -2; y <= 2; y++) {
        for (int x = -2; x <= 2; x++) {
            ivec2 q = p + ivec2(x, y);
            if (!neighbour(q)) continue;
            vec4 other = imageLoad(in_position, ivec3(q, layer));
            bool same = other.w > 0.0 && shows(q, layer) && imageLoad(in_motion, ivec3(q, layer)).w == id
                && dot(imageLoad(in_normal, ivec3(q, layer)).xyz, normal) >= push.mask_cosine
                && abs(dot(other.xyz - position.xyz, normal)) <= push.mask_distance * position.w;
            if (same) continue;
            if (max(abs(x), abs(y)) < 2) return 16u;
            share = 4u;
        }
    }
    return share;
}

bool traced(ivec2 p, int layer) {
    if (push.dense != 0u) return true;
    if (in_turn(p, push.by_discontinuity != 0u ? discontinuity_share(p, layer) : in_view.view.rays_per_16)) return true;
    if (layer == VIRTUAL && imageLoad(in_normal, ivec3(p, VIRTUAL)).w < push.sharp_roughness) return true;
    // Newly seen surfaces trace every pixel until they have some history.
    if (push.short_history == 0u || push.history_valid == 0u) return push.short_history > 0u;
    vec4 motion = imageLoad(in_motion, ivec3(p, layer));
    if (motion.z <= 0.0) return true;
    ivec2 q = ivec2(floor(vec2(p) + 0.5 + motion.xy));
    return history_weight(q, layer, motion, imageLoad(in_normal, ivec3(p, layer)).xyz) == 0.0
        || imageLoad(history_moments, ivec3(q, layer)).z < float(push.short_history);
}

void append(uint list, uint count, uint per_group) {
    // An indirect dispatch needs groups. They grow with the count that this group has just added.
    uint total = atomicAdd(out_arguments.word[list + 3u], count) + count;
    uint groups = (total + per_group - 1u) / per_group;
    atomicMax(out_arguments.word[list], min(groups, GROUPS_PER_ROW));
    atomicMax(out_arguments.word[list + 1u], (groups + GROUPS_PER_ROW - 1u) / GROUPS_PER_ROW);
    group_base[list / 4u % 2u] = total - count;
}

void main() {
    ivec2 p = ivec2(gl_GlobalInvocationID.xy);
    uint local = gl_LocalInvocationIndex;
    if (local < 2u) { group_count[local] = 0u; active_count[local] = 0u; }
    if (gl_WorkGroupID.xy == uvec2(0u) && local == 0u) {
        out_arguments.word[LIST_REAL + 2u] = 1u;
        out_arguments.word[LIST_VIRTUAL + 2u] = 1u;
        out_arguments.word[LIST_TILES + 2u] = 1u;
    }
    barrier();
    bool inside = all(lessThan(p, ivec2(in_view.view.size)));
    uint slot[2];
    bool trace[2];
    trace[VIRTUAL] = false;
    int layers = VIRTUAL_SURFACES != 0u ? 2 : 1;
    for (int layer = 0; layer < layers; layer++) {
        trace[layer] = false;
        if (!inside) continue;
        bool present = in_view.view.instance_count > 0u && imageLoad(in_position, ivec3(p, layer)).w > 0.0 && shows(p, layer);
        if (present) {
            atomicAdd(active_count[layer], 1u);
            trace[layer] = traced(p, layer);
            if (trace[layer]) slot[layer] = atomicAdd(group_count[layer], 1u);
        }
        imageStore(out_mask, ivec3(p, layer), vec4(present ? (trace[layer] ? 1.0 : 2.0) : 0.0));
        if (push.mark_untraced != 0u && present && !trace[layer]) {
            imageStore(out_irradiance_a, ivec3(p, layer), vec4(vec3(0.0), -1.0));
            if (has_b(layer)) imageStore(out_irradiance_b, ivec3(p, layer), vec4(0.0));
        }
    }
    barrier();
    if (local == 0u) {
        if (group_count[REAL] > 0u) append(LIST_REAL, group_count[REAL], 64u);
        if (group_count[VIRTUAL] > 0u) append(LIST_VIRTUAL, group_count[VIRTUAL], 64u);
        for (uint layer = 0u; layer < 2u; layer++) {
            if (active_count[layer] == 0u) continue;
            uint total = atomicAdd(out_arguments.word[LIST_TILES + 3u], 1u) + 1u;
            atomicMax(out_arguments.word[LIST_TILES], min(total, GROUPS_PER_ROW));
            atomicMax(out_arguments.word[LIST_TILES + 1u], (total + GROUPS_PER_ROW - 1u) / GROUPS_PER_ROW);
            out_tiles.item[total - 1u] = gl_WorkGroupID.x | (gl_WorkGroupID.y << 15u) | (layer << 30u);
        }
    }
    barrier();
    uint pixels = in_view.view.size.x * in_view.view.size.y;
    for (int layer = 0; layer < layers; layer++)
        if (trace[layer]) out_list.item[uint(layer) * pixels + group_base[layer] + slot[layer]] = uint(p.x) | (uint(p.y) << 16u);
}
