// Writes the workgroup counts of a following indirect dispatch, counting by atomics.
#version 460
#extension GL_EXT_scalar_block_layout : require
layout(local_size_x = 1) in;
layout(set = 0, binding = 0, scalar) buffer Arguments { uint groups[]; } arguments;

void main() {
    atomicAdd(arguments.groups[0], 1u);
    arguments.groups[1] = 1u;
    arguments.groups[2] = 1u;
}
