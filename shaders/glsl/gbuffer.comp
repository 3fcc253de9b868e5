#version 460
#extension GL_GOOGLE_include_directive : require
#ifdef RAY_QUERY
#extension GL_EXT_ray_query : require
#endif
// Pass 1, gbuffer: primary visibility of panorama and objects at each pixel's centre (IPRT §2,
// "preprocessing"). If no object is inserted, it writes L_cam alone. For a map of irradiance it writes real
// surfaces alone.
// In: panorama radiance, depth and normals; the scene; reflected of the last frame. Out: guide of
// the real surface; L_cam (radiance); hit, and the list of pixels that hit an object; M at the centre goes to
// camera_radiance.w, and coverage refines it. Without objects in view: the tiles.
#include "common.glsl"
#include "parts.glsl"
#include "bind/images.glsl"
#include "append.glsl"
#include "tiles.glsl"
#include "panorama.glsl"
#include "trace.glsl"
#include "scene.glsl"
#include "guide.glsl"
#include "past.glsl"
#include "gbuffer.glsl"
layout(local_size_x = 8, local_size_y = 8) in;
layout(constant_id = 39) const uint PAST = 0; // 1: later passes ask what the last frame showed
layout(constant_id = 28) const uint KEPT = 0; // 1: what is real is kept from the last frame, and objects where nothing moves

void main() {
    ivec2 p = ivec2(gl_GlobalInvocationID.xy);
    bool inside = KEPT != 0u ? tile_pixel(REAL, p) : all(lessThan(p, ivec2(in_view.view.size)));
    vec2 pixel = vec2(p) + 0.5;
    vec3 origin = view_origin(pixel), d = view_direction(pixel);
    RealPoint real;
    if (KEPT == 0u) real = real_surface(origin, d);
    bool met = false;
    float passes = 1.0; // of the light of what is real
    if (SHOWN != 0u) {
        bool changed = KEPT == 0u;
        if (VIRTUAL_SURFACES != 0u) {
            if (KEPT != 0u) {
                uvec4 known = imageLoad(guide, ivec3(p, REAL));
                real.t = guide_has_position(known) ? distance(guide_position(known), origin) : FAR;
            }
            SceneHit found = primary_trace(origin, d, real.t, pixel_angle(), passes);
            met = inside && found.instance != NONE;
            // Few pixels show objects, and stores cost much: only what has changed is written.
            uvec4 had = inside ? imageLoad(hit, p) : uvec4(NONE, 0u, 0u, 0u);
            bool lost = had.x != NONE && !met;
            if (PAST != 0u && inside && (had.x != NONE || had.y == HAD_HIT)) {
                float reflected = REFLECTIONS != 0u ? imageLoad(in_reflected, p).z : 0.0;
                imageStore(out_past, ivec3(p, VIRTUAL), past_pack(imageLoad(guide, ivec3(p, VIRTUAL)), reflected));
            }
            if (met) imageStore(hit, p, uvec4(found.instance, found.triangle, floatBitsToUint(found.barycentric)));
            else if (lost || (had.x == NONE && had.y == HAD_HIT)) imageStore(hit, p, uvec4(NONE, lost ? HAD_HIT : 0u, 0u, 0u));
            if (lost) write_no_virtual(p);
            changed = met || had.x != NONE;
            if (inside && lost) imageStore(guide, ivec3(p, VIRTUAL), uvec4(0u));
        }
        if (inside && (KEPT == 0u || changed)) {
            vec3 radiance = KEPT != 0u ? imageLoad(camera_radiance, p).rgb : panorama_filtered(real.uv, pixel_angle());
            // From elsewhere, what was behind a lamp is seen beside it.
            if (KEPT == 0u && OFF_CENTRE != 0u && !real.lamp) radiance = without_lamps(panorama_direction(real.uv), radiance);
            imageStore(camera_radiance, p, vec4(radiance, met ? passes : 1.0));
        }
        if (LIT == 0u) return;
    }
    if (KEPT != 0u) {
        append_pixels(bvec2(false, met), p);
        return;
    }
    // A free lamp hides objects and is not lit itself.
    bool has_real = inside && real.t < FAR && !real.lamp;
    if (inside) {
        if (PAST != 0u) imageStore(out_past, ivec3(p, REAL), past_pack(imageLoad(guide, ivec3(p, REAL)), 0.0));
        vec3 normal = imageLoad(in_panorama_normal, real.texel).xyz;
        if (dot(normal, d) > 0.0) normal = -normal; // a camera off the centre sees it from behind
        uvec4 seen = guide_pack(origin + d * min(real.t, 1e15), normal, 1.0, has_real ? REAL_SURFACE : NO_SURFACE);
        imageStore(guide, ivec3(p, REAL), real.t < FAR ? seen : uvec4(0u));
    }
    if (VIRTUAL_SURFACES != 0u) append_pixels(bvec2(false, met), p);
    else append_tile(p / 8, has_real, false, false);
}
