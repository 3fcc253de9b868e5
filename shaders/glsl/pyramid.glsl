// The pyramid of boxes that rays walk. A leaf is 2×2 quads. A node of level 0 holds the boxes of 2×2 leaves,
// one of level n those of 2×2 nodes of level n - 1, up to a single node. Leaf row y holds the quads under
// vertex rows 2y and 2y + 1 of in_depth. A node is three texels: its origin (m) and the exponents of its
// grid's steps; then bounds of the four children in steps, a byte each: least x, y, z, greatest x | greatest
// y, z, then a bit for each child that holds anything. Far sides have nodes of their own behind the others.
// Returns the number of a node. The formula leaves each level at least the room that it needs, without a
// table (`PyramidShape` in passes/panorama.rs).
uint pyramid_node(uint level, uint x, uint y) {
    uint area = in_view.view.pyramid_area, width = ((in_view.view.pyramid_size.x - 1u) >> level) + 1u;
    uint room = in_view.view.pyramid_size.x + in_view.view.pyramid_size.y + 4u;
    return area - (area >> (2u * level)) + level * room + y * width + x;
}
