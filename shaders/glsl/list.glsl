// Compacted work: lists of pixels, and of the tiles of 8×8 pixels that hold any surface. Lists of real and of
// virtual surfaces follow each other, and so do their indirect arguments (x groups, y groups, 1, items). x is at
// most GROUPS_PER_ROW.
#ifndef LIST_GLSL
#define LIST_GLSL
const uint GROUPS_PER_ROW = 32768u;
uint list_group() { return gl_WorkGroupID.y * GROUPS_PER_ROW + gl_WorkGroupID.x; }

uvec2 tile_count() { return (in_view.view.size + 7u) / 8u; }
#endif
