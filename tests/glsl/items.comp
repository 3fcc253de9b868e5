// Sums fields of structs under scalar layout; a uniform block scales them. Knows its count by length() alone.
#version 460
#extension GL_EXT_scalar_block_layout : require
layout(local_size_x = 32, local_size_x_id = 0) in;
layout(constant_id = 0) const uint WIDTH = 32;
layout(constant_id = 1) const uint BONUS = 0;
struct Item { vec3 a; float b; uvec2 c; };
layout(set = 0, binding = 2, scalar) readonly buffer Items { Item items[]; } in_items;
layout(set = 0, binding = 5, scalar) uniform Scale { float scale; } in_scale;
layout(set = 0, binding = 7, scalar) writeonly buffer Sums { float sums[]; } out_sums;
layout(set = 0, binding = 9, scalar) readonly buffer Never { float never[]; } in_never;

void main() {
    uint i = gl_GlobalInvocationID.x;
    if (i >= uint(in_items.items.length())) return;
    Item item = in_items.items[i];
    float sum = item.a.x + item.a.y + item.a.z + item.b + float(item.c.x + item.c.y);
    out_sums.sums[i] = sum * in_scale.scale + float(BONUS) + float(WIDTH - gl_WorkGroupSize.x);
}
