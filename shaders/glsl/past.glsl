// What is kept of the surfaces of the last frame, in 8 bytes: their distance from its camera (m), a float without its lower
// half; in that half how far from them that was which they reflected (m, 0: not known), HIDDEN and roughness. Then normal
// and object as in the guide.

uvec4 past_pack(uvec4 guide, float reflected) {
    uint distance = floatBitsToUint(length(guide_position(guide) - in_view.view.previous_position)) + 0x8000u;
    return uvec4((distance & 0xffff0000u) | (packHalf2x16(vec2(reflected, 0.0)) & 0x7ff0u) << 1 | (guide.y & HIDDEN) << 4 | (guide.x & 15u), guide.w, 0u, 0u);
}

float past_distance(uvec4 past) { return uintBitsToFloat(past.x & 0xffff0000u); }
float past_reflected(uvec4 past) { return unpackHalf2x16((past.x >> 1) & 0x7ff0u).x; }

// Returns a guide without a position.
uvec4 past_guide(uvec4 past) { return uvec4(past.x & 15u, (past.x >> 4) & HIDDEN, 0u, past.y); }
