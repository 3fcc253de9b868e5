#include "list.glsl"

const uint TILE_DENSE = 1u << 31; // of an item in `tiles`: all pixels are traced

bool tile_is_dense(int layer) {
    uvec2 tiles = tile_count();
    return (in_tiles.item[uint(layer) * tiles.x * tiles.y + list_group()] & TILE_DENSE) != 0u;
}

// Finds the pixel of a thread in a dispatch of 8×8 threads over one layer's tiles. Returns false beyond them.
bool tile_pixel(int layer, out ivec2 p) {
    uvec2 tiles = tile_count();
    uint k = list_group();
    uint tile = in_tiles.item[uint(layer) * tiles.x * tiles.y + k];
    p = ivec2(tile & 0xffffu, (tile & ~TILE_DENSE) >> 16u) * 8 + ivec2(gl_LocalInvocationID.xy);
    return k < in_tile_arguments.word[uint(layer) * 4u + 3u] && all(lessThan(p, ivec2(in_view.view.size)));
}
