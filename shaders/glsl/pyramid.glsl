// The pyramid of boxes that rays walk. A leaf is 2×2 quads. A node of level 0 holds the boxes of 2×2 leaves,
// one of level n those of 2×2 nodes of level n - 1, up to a single node. Leaf row y holds the quads under
// vertex rows 2y and 2y + 1 of in_depth. A node is three texels: its origin (m) and the exponents of its
// grid's steps; then bounds of the four children in steps, a byte each: least x, y, z, greatest x | greatest
// y, z, then for each order of the children (`first_child` in trace.glsl) four bits: which of them, in that
// order, hold anything. Far sides have nodes of their own behind the others.

// What the number of a node follows from.
struct PyramidShape { uint area; uint last_column; uint room; };

PyramidShape pyramid_shape() {
    uvec2 size = in_view.view.pyramid_size;
    return PyramidShape(in_view.view.pyramid_area, size.x - 1u, size.x + size.y + 4u);
}

// Returns the number of a node. The formula leaves each level at least the room that it needs, without a
// table (`PyramidShape` in passes/panorama.rs).
uint pyramid_node(PyramidShape shape, uint level, uint x, uint y) {
    return shape.area - (shape.area >> (2u * level)) + level * shape.room + y * ((shape.last_column >> level) + 1u) + x;
}

// Returns the first texel of a node.
ivec2 pyramid_texel(uint node) { return ivec2((node & 1023u) * 3u, node >> 10u); }
