// Compacted work. Indirect arguments are (x groups, y groups, 1, items). x is at most GROUPS_PER_ROW.
const uint GROUPS_PER_ROW = 32768u;
const uint LIST_REAL = 0u;
const uint LIST_VIRTUAL = 4u;
const uint LIST_TILES = 8u;
uint list_group() { return gl_WorkGroupID.y * GROUPS_PER_ROW + gl_WorkGroupID.x; }
