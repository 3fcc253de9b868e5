// The previous frame, and whether it holds a pixel's surface. sampling_mask and temporal ask the same
// question, so that each untraced pixel has a history.

// Says whether a history texel was this surface: the same object, at the distance that this point then had,
// facing the same way. `q` wraps.
float history_weight(inout ivec2 q, int layer, vec4 motion, vec3 normal) {
    if (!neighbour(q)) return 0.0;
    vec4 then = imageLoad(history_position, ivec3(q, layer));
    if (then.w <= 0.0 || imageLoad(history_motion, ivec3(q, layer)).w != motion.w) return 0.0;
    if (abs(then.w - motion.z) > 0.03 * motion.z) return 0.0;
    return dot(imageLoad(history_normal, ivec3(q, layer)).xyz, normal) > 0.85 ? 1.0 : 0.0;
}
