// How deep the thing is whose edge hides what lies behind it. A skirt hangs from that edge. The capture shows
// how wide the thing is. A post is as deep as it is wide, and what is wider is flatter: a cupboard of 0.9 m is 0.3 m
// deep.
//
// The last four bits of a depth hold this as a class: two classes double it. They move a depth by a millionth of
// itself.

uint edge_class(float metres) {
    // From 1/64 m on, rounded down: 1, 1.5, 2, 3, 4, ... times that.
    return (floatBitsToUint(max(metres, 0.0157)) - 0x3c800000u) >> 22u;
}

const uint EDGE_AT_POLE = 8u; // 1/4 m: a pole has no width of its own
const uint EDGE_ON_PLANE = 15u; // no edge: a plane goes on there at a grazing angle

float with_edge_class(float depth, uint bits) {
    return in_view.view.edge_depth != 0u && depth > 0.0 ? uintBitsToFloat((floatBitsToUint(depth) & ~15u) | bits) : depth;
}

// Says whether a triangle with this smallest and largest depth is a skirt.
bool is_skirt(float near, float far, float most_ratio, bool edge_depth) {
    return far > near * most_ratio && !(edge_depth && (floatBitsToUint(near) & 15u) == EDGE_ON_PLANE);
}

// Returns how far from the centre a skirt with this nearest depth can be hit.
float skirt_reach(float near, bool edge_depth, float thickness) {
    uint bits = floatBitsToUint(near) & 15u;
    return near + (edge_depth ? uintBitsToFloat(0x3c800000u + (bits << 22u)) : thickness);
}
