#version 460
#extension GL_GOOGLE_include_directive : require
#ifdef RAY_QUERY
#extension GL_EXT_ray_query : require
#endif
// Pass 1, gbuffer (last dispatch): pixels that show several surfaces, by rays through points of the pixel: M, and
// the means of k_V and of what the virtual surfaces emit. A pixel whose centre is real but whose edge is virtual
// gets its virtual surface here, from the hit nearest to the centre.
// In: list, camera_radiance.w; panorama, scene. Out: coverage (0…1); motion, guide, k_V,
// emission, hit of virtual surfaces; guide of real ones, marked where nothing of them is seen.
#include "common.glsl"
#include "parts.glsl"
#include "bind/images.glsl"
#include "list.glsl"
#include "panorama.glsl"
#include "trace.glsl"
#include "scene.glsl"
#include "bsdf.glsl"
#include "guide.glsl"
#define WRITES_VIRTUAL
#include "gbuffer.glsl"
#include "reflection.glsl"
layout(local_size_x = 64) in;

void main() {
    uint k = list_group() * 64u + gl_LocalInvocationIndex;
    if (k >= in_arguments.word[3]) return;
    uint item = in_list.item[k];
    ivec2 p = ivec2(item & 0xffffu, item >> 16u);
    // The offsets are points of the R2 sequence (Roberts 2018).
    uint n = in_view.view.coverage_samples;
    float real_count = 0.0, nearest = FAR;
    vec3 albedo = vec3(0.0), emitted = vec3(0.0);
    bool still = true; // what is seen here was here a frame ago
    SceneHit best;
    vec3 best_d;
    float angle = pixel_angle() * inversesqrt(float(n)); // of a point's share of the pixel
    for (uint k = 0u; k < n; k++) {
        vec2 offset = fract(vec2(0.5) + float(k) * vec2(0.7548776662, 0.5698402910));
        vec3 origin = view_origin(vec2(p) + offset), d = view_direction(vec2(p) + offset);
        float passes;
        SceneHit hit = primary_trace(origin, d, FAULT != FAULT_REAL_IGNORED ? real_surface(origin, d).t : FAR, angle, passes);
        real_count += passes;
        if (hit.instance == NONE) continue;
        Surface s = scene_surface(hit, d, hit.t * pixel_angle());
        albedo += (1.0 - passes) * bsdf_lobes(s, -d).diffuse;
        emitted += (ALPHA != 0u ? min(s.alpha, 1.0 - passes) : 1.0) * s.emissive;
        Instance instance = in_instances.instance[hit.instance];
        vec3 previous = s.position + point_motion(instance, s.position);
        vec2 motion = motion_of(vec2(p) + offset, previous, 0.0).xy;
        still = still && dot(motion, motion) < 1e-3 && (DEFORMATION == 0u || instance.previous == NONE);
        vec2 c = offset - 0.5;
        if (dot(c, c) < nearest) { nearest = dot(c, c); best = hit; best_d = d; }
    }
    imageStore(real_coverage, p, vec4(real_count / float(n)));
    if (real_count == 0.0) {
        uvec4 behind = imageLoad(guide, ivec3(p, REAL));
        behind.y |= HIDDEN;
        imageStore(guide, ivec3(p, REAL), behind);
        imageStore(out_mask, ivec3(p, REAL), vec4(0.0));
    }
    if (imageLoad(in_camera_radiance, p).w == 1.0 && nearest < FAR) {
        imageStore(out_hit, p, uvec4(best.instance, best.triangle, floatBitsToUint(best.barycentric)));
        write_virtual(p, best, best_d, 1.0 - real_count / float(n));
    }
    float virtual_count = float(n) - real_count;
    if (virtual_count <= 0.0) return;
    imageStore(out_albedo_virtual, p, uvec4((color_pack(albedo / virtual_count) & ~FLAG) | (still ? FLAG : 0u)));
    if (EMISSION != 0u) imageStore(out_emission, p, uvec4(color_pack(emitted / virtual_count)));
}
