#version 460
#extension GL_GOOGLE_include_directive : require
// Pass 1, gbuffer: primary visibility of panorama and objects at each pixel's centre (IPRT §2,
// "preprocessing"). If no object is inserted, it writes L_cam alone. For a map of irradiance it writes real
// surfaces alone.
// In: panorama radiance, depth and normals; the scene. Out: position (m), normal, motion (pixels), L_cam
// (radiance), k_V, emission, hit, for the real and the virtual surface. M at the centre goes to
// camera_radiance.w, and coverage refines it.
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
    vec2 pixel = vec2(p) + 0.5;
    vec3 d = view_direction(pixel);
    RealPoint real = real_surface(d);
    if (SHOWN != 0u) {
        vec3 radiance = panorama_filtered(real.uv, pixel_angle());
        if (LIT == 0u) { imageStore(out_camera_radiance, p, vec4(radiance, 1.0)); return; }
        float coverage = 1.0;
        if (VIRTUAL_SURFACES != 0u) {
            SceneHit hit = scene_trace(in_view.view.position, d, FAULT == FAULT_REAL_IGNORED ? FAR : real.t);
            if (hit.instance != NONE) {
                coverage = 0.0;
                write_virtual(p, hit, d);
            } else write_no_virtual(p);
        }
        imageStore(out_camera_radiance, p, vec4(radiance, coverage));
    }
    bool has_real = real.t < FAR;
    vec3 point = in_view.view.position + d * (has_real ? real.t : 0.0);
    vec3 normal = imageLoad(in_panorama_normal, real.texel).xyz;
    if (dot(normal, d) > 0.0) normal = -normal; // a camera off the centre sees it from behind
    imageStore(out_position, ivec3(p, REAL), vec4(point, has_real ? real.t : 0.0));
    imageStore(out_normal, ivec3(p, REAL), vec4(has_real ? normal : vec3(0.0), 1.0));
    imageStore(out_motion, ivec3(p, REAL), has_real ? motion_of(pixel, point, 0.0) : vec4(0.0));
}
