// How change shortens histories. If a share c of the light changes in each frame, a history of n frames is wrong by
// about n·c/2, so n is at most history_change·(1 − c)/c. A video changes at once, and what it changes much is
// forgotten sooner.

// Returns the most frames of E_R and ΔE, or of the two lobes of a virtual surface, that may be accumulated.
vec2 history_limit(ivec2 p, int layer, float history_change) {
    if (OBJECT_MOTION == 0u) return vec2(FAR);
    uvec2 tiles = tile_count(), tile = uvec2(p) / 8u;
    vec2 by = in_changes.item[uint(layer) * tiles.x * tiles.y + tile.y * tiles.x + tile.x].zw;
    by.x *= max(1.0, by.x / 0.05);
    vec2 change = clamp(vec2(layer == REAL ? by.x : by.x + by.y, by.x + by.y), vec2(1e-6), vec2(1.0));
    return history_change * (1.0 - change) / change;
}
