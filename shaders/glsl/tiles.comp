#version 460
#extension GL_GOOGLE_include_directive : require
// Pass 2, sampling_mask (first dispatch): the tiles that the later passes visit. While a picture stands still,
// tiles of real surfaces take turns, and all pixels of a tile are traced in its turn.
// In: held_tiles. Out: tiles.
#include "common.glsl"
#include "bind/images.glsl"
#include "append.glsl"
#include "turn.glsl"
layout(local_size_x = 64) in;

layout(push_constant, scalar) uniform Push { uint turns; } push; // 1: tiles take turns

void main() {
    uvec2 tiles = tile_count();
    uint all = tiles.x * tiles.y, index = gl_GlobalInvocationID.x, layer = index / all, k = index - layer * all;
    uint tile = in_held_tiles.item[min(index, 2u * all - 1u)];
    bool wanted = layer < 2u && k < in_held_arguments.word[min(layer, 1u) * 4u + 3u];
    if (layer == uint(REAL) && push.turns != 0u) wanted = wanted && in_turn(ivec2(tile & 0xffffu, tile >> 16u), in_view.view.rays_per_16);
    if (!wanted) return;
    uint total = atomicAdd(out_tile_arguments.word[layer * 4u + 3u], 1u) + 1u;
    atomicMax(out_tile_arguments.word[layer * 4u], min(total, GROUPS_PER_ROW));
    atomicMax(out_tile_arguments.word[layer * 4u + 1u], (total + GROUPS_PER_ROW - 1u) / GROUPS_PER_ROW);
    out_tile_arguments.word[layer * 4u + 2u] = 1u;
    out_tiles.item[layer * all + total - 1u] = tile;
}
