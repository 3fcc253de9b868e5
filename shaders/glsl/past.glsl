// What is kept of the surfaces of the last frame, in 8 bytes: their distance from its camera (m), with roughness and HIDDEN
// in the lowest bits, then normal and object as in the guide.

uvec4 past_pack(uvec4 guide) {
    uint distance = floatBitsToUint(length(guide_position(guide) - in_view.view.previous_position));
    return uvec4((distance & ~31u) | (guide.y & HIDDEN) << 4 | (guide.x & 15u), guide.w, 0u, 0u);
}

float past_distance(uvec4 past) { return uintBitsToFloat(past.x & ~31u); }

// Returns a guide without a position.
uvec4 past_guide(uvec4 past) { return uvec4(past.x & 15u, (past.x >> 4) & HIDDEN, 0u, past.y); }
