#version 460
#extension GL_GOOGLE_include_directive : require
// Pass 1, gbuffer (second dispatch): the fraction M of each pixel that shows the real scene. Sub-pixel rays
// find it where the 3×3 neighbourhood holds both kinds of surface. A pixel whose centre is real but whose
// edge is virtual gets its virtual surface here, from the sub-pixel hit nearest to the centre.
// In: camera_radiance.w (M at the centre); panorama, scene. Out: coverage (0…1); position, normal, motion,
// k_V, emission, hit.
#include "common.glsl"
#include "parts.glsl"
#include "bind/images.glsl"
#include "panorama.glsl"
#include "trace.glsl"
#include "scene.glsl"
#include "brdf.glsl"
#include "gbuffer.glsl"
layout(local_size_x = 8, local_size_y = 8) in;

void main() {
    ivec2 p = ivec2(gl_GlobalInvocationID.xy);
    if (any(greaterThanEqual(p, ivec2(in_view.view.size)))) return;
    float centre = imageLoad(in_camera_radiance, p).w;
    float sum = 0.0, count = 0.0;
    for (int y = -1; y <= 1; y++) {
        for (int x = -1; x <= 1; x++) {
            ivec2 q = p + ivec2(x, y);
            if (!neighbour(q)) continue;
            sum += imageLoad(in_camera_radiance, q).w;
            count += 1.0;
        }
    }
    if (sum == 0.0 || sum == count) {
        imageStore(out_real_coverage, p, vec4(centre));
        return;
    }
    // The offsets are points of the R2 sequence (Roberts 2018).
    uint n = in_view.view.coverage_samples;
    float real_count = 0.0, nearest = FAR;
    SceneHit best;
    vec3 best_d;
    for (uint k = 0u; k < n; k++) {
        vec2 offset = fract(vec2(0.5) + float(k) * vec2(0.7548776662, 0.5698402910));
        vec3 d = view_direction(vec2(p) + offset);
        SceneHit hit = scene_trace(in_view.view.position, d, FAULT == FAULT_REAL_IGNORED ? FAR : real_surface(d).t);
        if (hit.instance == NONE) { real_count += 1.0; continue; }
        vec2 c = offset - 0.5;
        if (dot(c, c) < nearest) { nearest = dot(c, c); best = hit; best_d = d; }
    }
    imageStore(out_real_coverage, p, vec4(real_count / float(n)));
    if (centre == 1.0 && nearest < FAR) write_virtual(p, best, best_d);
}
