#version 460
#extension GL_GOOGLE_include_directive : require
// Pass 1, gbuffer (first dispatch, where the camera and all that is real stand still): lists the tiles that may show objects
// otherwise than the last frame. The others are kept as they are, and so is what they hold.
// In: movers, tile_holds. Out: tiles, held_tiles.
#include "common.glsl"
#include "parts.glsl"
#include "bind/images.glsl"
#include "bind/scene.glsl"
#include "append.glsl"
layout(local_size_x = 64) in;

// Says whether a cone around d, with an angle of that sine and cosine, meets a sphere.
bool cone_meets(vec3 off, float radius, vec3 d, vec2 angle) {
    float along = dot(off, d), beside = sqrt(max(dot(off, off) - along * along, 0.0));
    return beside * angle.y - along * angle.x <= radius; // how far the sphere's centre is outside of the cone
}

bool tile_is_touched(ivec2 tile) {
    vec2 middle = vec2(tile * 8) + 4.0, size = vec2(in_view.view.size);
    vec3 origin = view_origin(middle), d = view_direction(middle);
    // The tile and the pixels around it. The nearer to the middle of a picture, the wider a pixel.
    float wide = 7.1 * (projection() == EQUIRECT ? max(PI / size.y, 2.0 * PI / size.x) : 2.0 * max(in_view.view.tan_half.x / size.x, in_view.view.tan_half.y / size.y));
    vec2 angle = vec2(sin(min(wide, 1.5)), cos(min(wide, 1.5)));
    float apart = of_eye() ? 8.0 * abs(in_view.view.eye) * wide : 0.0; // how far the origins of its rays are at most
    bool met = false;
    for (uint i = 0u; i < in_view.view.touching_count; i++) {
        Mover m = in_movers.mover[in_view.view.mover_count + i];
        float radius = 1.01 * m.radius + apart;
        met = met || cone_meets(m.now - origin, radius, d, angle) || cone_meets(m.before - origin, radius, d, angle);
    }
    return met;
}

void main() {
    uvec2 tiles = tile_count();
    uint k = gl_GlobalInvocationID.x;
    if (k >= tiles.x * tiles.y) return;
    ivec2 tile = ivec2(k % tiles.x, k / tiles.x);
    uint holds = in_tile_holds.item[k];
    // What a surface reflects moves, though the surface does not.
    if ((holds & TILE_REFLECTS) != 0u || tile_is_touched(tile)) {
        uint total = atomicAdd(out_tile_arguments.word[3], 1u) + 1u;
        atomicMax(out_tile_arguments.word[0], min(total, GROUPS_PER_ROW));
        atomicMax(out_tile_arguments.word[1], (total + GROUPS_PER_ROW - 1u) / GROUPS_PER_ROW);
        out_tile_arguments.word[2] = 1u;
        out_tiles.item[total - 1u] = uint(tile.x) | uint(tile.y) << 16u;
        return;
    }
    for (uint layer = 0u; layer < 2u; layer++)
        if ((holds & (1u << layer)) != 0u) hold_tile(tile, layer);
}
