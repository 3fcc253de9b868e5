// Real surfaces whose light changes as one object moves along: what that object does to it is followed.

// Says whether a pixel's tile is followed.
bool is_followed(ivec2 p) {
    uvec2 tile = uvec2(p) / 8u;
    return in_followed.item[tile.y * tile_count().x + tile.x].w > 0.0;
}
