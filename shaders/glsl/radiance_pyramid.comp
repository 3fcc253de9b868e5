#version 460
#extension GL_GOOGLE_include_directive : require
// Per video frame, radiance_pyramid: one mip level of the panorama's radiance, the area-weighted mean of the
// texels below. Any size will do, not only powers of two. In: the finer level. Out: the coarser.
#include "halves.glsl"
layout(local_size_x = 8, local_size_y = 8) in;
layout(set = 0, binding = 60, rgba32f) uniform readonly image2D in_level;
layout(set = 0, binding = 61, rgba32f) uniform writeonly image2D out_level;
// The same of a panorama of 16-bit floats.
layout(set = 0, binding = 62, rgba16f) uniform readonly image2D in_half_level;
layout(set = 0, binding = 63, rgba16f) uniform writeonly image2D out_half_level;

void main() {
    ivec2 p = ivec2(gl_GlobalInvocationID.xy), size = imageSize(out_level), fine = imageSize(in_level);
    if (HALVES != 0u) { size = imageSize(out_half_level); fine = imageSize(in_half_level); }
    if (any(greaterThanEqual(p, size))) return;
    vec2 scale = vec2(fine) / vec2(size);
    vec2 from = vec2(p) * scale, to = vec2(p + 1) * scale;
    vec4 sum = vec4(0.0);
    float total = 0.0;
    for (int y = int(from.y); y < min(fine.y, int(ceil(to.y))); y++) {
        for (int x = int(from.x); x < min(fine.x, int(ceil(to.x))); x++) {
            vec2 overlap = min(vec2(x + 1, y + 1), to) - max(vec2(x, y), from);
            float w = max(overlap.x, 0.0) * max(overlap.y, 0.0);
            sum += w * (HALVES != 0u ? from_halves(imageLoad(in_half_level, ivec2(x, y))) : imageLoad(in_level, ivec2(x, y)));
            total += w;
        }
    }
    if (HALVES != 0u) imageStore(out_half_level, p, to_halves(sum.rgb / total, 1.0));
    else imageStore(out_level, p, sum / total);
}
