// The previous frame, and whether it holds a pixel's surface. sampling_mask and temporal ask the same
// question, so that each untraced pixel has a history.
#include "past.glsl"
// Since the last frame (`Stands` in passes/view.rs):
layout(constant_id = 11) const uint STANDS = 0;
const uint STEADY = 1u; // camera and objects stand still: a pixel's history is its own, if it is the same surface's
const uint STILL = 2u;  // the video, too

// Returns where a surface was in the last frame: xy in pixels from here, z its distance from the camera (m).
vec4 motion_at(ivec2 p, int layer, uvec4 guide) {
    if (STANDS == STEADY) return vec4(0.0, 0.0, length(guide_position(guide) - in_view.view.previous_position), 0.0);
    return layer == REAL ? motion_of(vec2(p) + 0.5, guide_position(guide), 0.0) : imageLoad(in_motion, p);
}

// Says whether a history texel was this surface: the same object, at the distance that this point then had,
// facing the same way. `q` wraps.
float history_weight(inout ivec2 q, int layer, vec4 motion, uvec4 guide) {
    if (!neighbour(q)) return 0.0;
    if (FAULT == FAULT_HISTORY_OF_OTHERS) return 1.0;
    // What stands still is not packed.
    uvec4 past = STANDS == STILL ? past_pack(imageLoad(in_guide, ivec3(q, layer)), 0.0) : imageLoad(in_past, ivec3(q, layer));
    uvec4 then = past_guide(past);
    if (guide_id(then) != guide_id(guide)) return 0.0;
    float distance = past_distance(past);
    // Before a steady camera depth that flickers is still the same surface.
    if (abs(distance - motion.z) > (STANDS == STEADY ? 0.15 : 0.03) * motion.z) return 0.0;
    return dot(guide_normal(then), guide_normal(guide)) > 0.85 * 127.0 * 127.0 ? 1.0 : 0.0;
}
