// Appends to lists. All threads of a group call these together.
#extension GL_KHR_shader_subgroup_basic : require
#extension GL_KHR_shader_subgroup_ballot : require
#include "list.glsl"
#ifdef APPEND_TO_AIMED
#define APPENDED out_aimed
#define APPENDED_ARGUMENTS out_aimed_arguments
#else
#define APPENDED out_list
#define APPENDED_ARGUMENTS out_arguments
#endif

shared uint append_count[2], append_first[2];

// Puts pixels into the lists of real and of virtual surfaces. Those of a group stay together, as rays that start
// side by side walk side by side.
void append_pixels(bvec2 wanted, ivec2 p) {
    uint local = gl_LocalInvocationIndex, slot[2];
    if (local < 2u) append_count[local] = 0u;
    barrier();
    [[unroll]] for (int layer = 0; layer < 2; layer++) {
        uvec4 ballot = subgroupBallot(wanted[layer]);
        uint count = subgroupBallotBitCount(ballot), first = 0u;
        if (count > 0u && subgroupElect()) first = atomicAdd(append_count[layer], count);
        slot[layer] = subgroupBroadcastFirst(first) + subgroupBallotExclusiveBitCount(ballot);
    }
    barrier();
    if (local < 2u && append_count[local] > 0u) {
        uint at = local * 4u, count = append_count[local];
        uint total = atomicAdd(APPENDED_ARGUMENTS.word[at + 3u], count) + count, groups = (total + 63u) / 64u;
        // An indirect dispatch needs groups. They grow with the count that has just been added.
        atomicMax(APPENDED_ARGUMENTS.word[at], min(groups, GROUPS_PER_ROW));
        atomicMax(APPENDED_ARGUMENTS.word[at + 1u], (groups + GROUPS_PER_ROW - 1u) / GROUPS_PER_ROW);
        APPENDED_ARGUMENTS.word[at + 2u] = 1u;
        append_first[local] = total - count;
    }
    barrier();
    uint pixels = in_view.view.size.x * in_view.view.size.y;
    [[unroll]] for (int layer = 0; layer < 2; layer++)
        if (wanted[layer]) APPENDED.item[uint(layer) * pixels + append_first[layer] + slot[layer]] = uint(p.x) | uint(p.y) << 16u;
}

// What a tile holds, of tile_holds: a bit for each layer, and this.
const uint TILE_REFLECTS = 4u; // a smooth virtual surface

// Puts a tile into the list of those in which a layer holds surfaces.
void hold_tile(ivec2 tile, uint layer) {
    uvec2 tiles = tile_count();
    uint place = atomicAdd(out_held_arguments.word[layer * 4u + 3u], 1u);
    out_held_tiles.item[layer * tiles.x * tiles.y + place] = uint(tile.x) | uint(tile.y) << 16u;
}

shared uint tile_holds[3];

// Puts a group's tile into the list of each layer of which a pixel in it shows a surface.
void append_tile(ivec2 tile, bool real, bool virtual_surface, bool reflects) {
    uint local = gl_LocalInvocationIndex;
    if (local < 3u) tile_holds[local] = 0u;
    barrier();
    if (real) tile_holds[REAL] = 1u;
    if (virtual_surface) tile_holds[VIRTUAL] = 1u;
    if (reflects) tile_holds[2] = 1u;
    barrier();
    if (local < 2u && tile_holds[local] != 0u) hold_tile(tile, local);
    if (local == 0u) out_tile_holds.item[uint(tile.y) * tile_count().x + uint(tile.x)] = tile_holds[0] + 2u * tile_holds[1] + TILE_REFLECTS * tile_holds[2];
}
