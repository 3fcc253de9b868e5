// The previous frame, and whether it holds a pixel's surface. sampling_mask and temporal ask the same
// question, so that each untraced pixel has a history.
layout(constant_id = 11) const uint STILL = 0; // 1: camera, objects and video stand still since the last frame

// Says whether a history texel was this surface: the same object, at the distance that this point then had,
// facing the same way. `q` wraps.
float history_weight(inout ivec2 q, int layer, vec4 motion, uvec4 guide) {
    if (!neighbour(q)) return 0.0;
    uvec4 then = imageLoad(in_guide, ivec3(q, BEFORE(layer)));
    if (guide_id(then) != guide_id(guide)) return 0.0;
    float distance = length(guide_position(then) - in_view.view.previous_position);
    if (abs(distance - motion.z) > 0.03 * motion.z) return 0.0;
    return dot(guide_normal(then), guide_normal(guide)) > 0.85 * 127.0 * 127.0 ? 1.0 : 0.0;
}
