// Samples halfway between texel centres, and across the seam and the poles.
#version 460
layout(local_size_x = 1) in;
layout(set = 0, binding = 0) uniform sampler2D in_panorama;
layout(set = 0, binding = 1, rgba32f) uniform writeonly image2D out_samples;
layout(set = 0, binding = 2, r32ui) uniform uimage2D out_count;

void main() {
    ivec2 p = ivec2(gl_GlobalInvocationID.xy);
    vec2 size = vec2(textureSize(in_panorama, 0));
    vec2 uv[4] = vec2[](vec2(1.0, 0.5) / size, vec2(0.0, 0.5) / size, vec2(0.5, 0.0) / size, vec2(0.5) / size);
    float lod = p.x == 3 ? 1.0 : 0.0;
    imageStore(out_samples, p, textureLod(in_panorama, uv[p.x], lod));
    imageAtomicAdd(out_count, ivec2(0), 1u);
}
