// Pixels, or tiles of them, take turns in being traced.

// A 4×4 ordered dither, in which the ranks of every power-of-two share are spread evenly.
const uvec4 RANK[4] = uvec4[4](uvec4(0u, 8u, 2u, 10u), uvec4(12u, 4u, 14u, 6u), uvec4(3u, 11u, 1u, 9u), uvec4(15u, 7u, 13u, 5u));

// Says which of 4×4 are traced in a frame: `rays_per_16` of 16, and all of them in turn.
bool in_turn(ivec2 p, uint share) {
    uint rank = RANK[p.y & 3][p.x & 3];
    return (rank + 16u - (in_view.view.frame * share) % 16u) % 16u < share;
}
