// Averages a texel with its left neighbour: storage images with layers, one level at a time.
#version 460
layout(local_size_x = 8, local_size_y = 8) in;
layout(set = 0, binding = 0, rgba16f) uniform readonly image2DArray in_level;
layout(set = 0, binding = 1, rgba16f) uniform writeonly image2DArray out_level;

void main() {
    ivec3 p = ivec3(gl_GlobalInvocationID);
    if (any(greaterThanEqual(p, imageSize(out_level)))) return;
    ivec3 left = ivec3(max(p.x - 1, 0), p.yz);
    imageStore(out_level, p, 0.5 * (imageLoad(in_level, p) + imageLoad(in_level, left)));
}
