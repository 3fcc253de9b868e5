#version 460
#extension GL_GOOGLE_include_directive : require
// unknown_light: the share of the light of each pixel's surface that comes out of space which the capture never
// saw. It is no part of the frame, and made when it is asked for.
// In: guide, depth, angles, pyramid with far sides, radiance. Out: of the radiance that cosine-distributed
// rays bring, the share of those that meet a skirt, or pass a skirt's far side before they meet anything.
#include "common.glsl"
#include "parts.glsl"
#include "bind/images.glsl"
#include "panorama.glsl"
#include "trace.glsl"
#include "guide.glsl"
layout(local_size_x = 8, local_size_y = 8) in;
layout(set = 0, binding = 90, r32f) uniform writeonly image2D out_unknown;

const uint RAYS = 16u;

void main() {
    ivec2 p = ivec2(gl_GlobalInvocationID.xy);
    if (any(greaterThanEqual(p, ivec2(in_view.view.size)))) return;
    int layer = VIRTUAL_SURFACES != 0u && imageLoad(in_real_coverage, p).x < 0.5 ? VIRTUAL : REAL;
    uvec4 guide = imageLoad(in_guide, ivec3(p, layer));
    vec3 at = guide_position(guide), normal = guide_unit_normal(guide);
    vec3 origin = at + normal * ((layer == REAL ? 2e-3 : 1e-4) * length(at));
    Random random = random_begin(uvec2(p), 7u);
    vec2 turn = random_next2(random);
    float all = 0.0, unknown = 0.0;
    if (guide.w >> 24 != NO_SURFACE) {
        for (uint k = 0u; k < RAYS; k++) {
            // The R2 sequence (Roberts 2018), turned.
            vec3 d = sample_cosine(normal, fract(turn + float(k) * vec2(0.7548776662, 0.5698402910)));
            PanoramaHit hit = panorama_trace(origin, d, 0.0, FAR);
            lamps_meet(origin, d, hit);
            vec3 radiance = hit_radiance(hit);
            bool unseen = is_skirt(hit) || panorama_unknown(origin, d, 0.0, hit.t);
            all += luminance(radiance);
            unknown += unseen ? luminance(radiance) : 0.0;
        }
    }
    imageStore(out_unknown, p, vec4(all > 0.0 ? unknown / all : 0.0));
}
