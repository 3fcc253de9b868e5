// out = in + amount, elementwise.
#version 460
#extension GL_EXT_scalar_block_layout : require
layout(local_size_x = 64) in;
layout(set = 0, binding = 0, scalar) readonly buffer In { float values[]; } in_values;
layout(set = 0, binding = 1, scalar) writeonly buffer Out { float values[]; } out_values;
layout(push_constant, scalar) uniform Push { uint count; float amount; } push;

void main() {
    uint i = gl_GlobalInvocationID.x;
    if (i < push.count) out_values.values[i] = in_values.values[i] + push.amount;
}
