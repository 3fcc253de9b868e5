// What gbuffer and coverage share: the real surface that a primary ray meets, and the writing of a virtual one.
layout(constant_id = 0) const uint OFF_CENTRE = 0; // 1: primary rays are traced, not looked up
layout(constant_id = 9) const uint FILL_UNSEEN = 0; // 1: what lies behind an edge fills what the capture never saw

const uint HAD_HIT = 1u; // in `hit`, beside NONE: there was one a frame ago

#include "color_code.glsl"

struct RealPoint { float t; vec2 uv; ivec2 texel; bool lamp; };

// Finds what a primary ray shows where the capture saw nothing. A skirt shows the farthest of the texel that
// it hangs from and its neighbours. A ray that leaves behind an edge shows what it passed before the edge.
void fill_unseen(vec3 origin, vec3 d, uint kind, inout RealPoint r) {
    ivec2 size = ivec2(in_view.view.depth_size);
    if (kind != FREE) {
        ivec2 nearest = r.texel;
        float farthest = 0.0;
        for (int k = 0; k < 9; k++) {
            ivec2 texel = wrap_texel(nearest + ivec2(k % 3, k / 3) - 1, size);
            float depth = imageLoad(in_depth, texel + ivec2(0, 1)).x; // the first row is the pole's
            if (depth > farthest) { farthest = depth; r.texel = texel; }
        }
        r.uv = (vec2(r.texel) + 0.5) / vec2(size);
        return;
    }
    vec2 passed = panorama_uv(origin);
    for (int k = 1; k <= 96; k++) { // from 5 cm to 100 m in steps of 8 %
        vec3 point = origin + d * (0.05 * exp(0.08 * float(k)));
        vec2 uv = panorama_uv(point);
        float depth = imageLoad(in_depth, wrap_texel(ivec2(floor(uv * vec2(size))), size) + ivec2(0, 1)).x;
        if (depth > 0.0 && length(point) > depth * (1.0 + in_view.view.edge_ratio)) { r.uv = passed; return; }
        passed = uv;
    }
}

// Returns the real surface along a primary ray. t is FAR if there is none.
RealPoint real_surface(vec3 origin, vec3 d) {
    RealPoint r;
    r.lamp = false;
    if (OFF_CENTRE == 0u && LIT == 0u) {
        r.uv = panorama_uv(d);
        r.t = FAR;
    } else if (OFF_CENTRE == 0u || FAULT == FAULT_CAMERA_CENTRED) {
        r.uv = panorama_uv(d);
        r.t = surface_distance(d, r.texel);
        if (r.t <= 0.0) r.t = FAR;
        PanoramaHit hit = PanoramaHit(r.t, r.uv, FREE, vec3(0.0));
        lamps_meet(vec3(0.0), d, hit);
        r.lamp = is_lamp(hit);
        r.t = hit.t;
    } else {
        PanoramaHit hit = panorama_trace(origin, d, 0.0, FAR);
        lamps_meet(origin, d, hit);
        r.lamp = is_lamp(hit);
        if (r.lamp) hit.uv = panorama_uv(origin + d * hit.t);
        r.t = hit.t;
        r.uv = hit.uv;
        ivec2 size = ivec2(in_view.view.depth_size);
        r.texel = wrap_texel(ivec2(floor(hit.uv * vec2(size))), size);
        if (FILL_UNSEEN != 0u && (hit.kind == FREE || is_skirt(hit))) fill_unseen(origin, d, hit.kind, r);
    }
    return r;
}

// Returns the first virtual surface that is there at all along a primary ray before `t_max`, and what share of the
// light from behind passes all of them that lie before `t_max`. The ray widens by `angle` radians.
SceneHit primary_trace(vec3 origin, vec3 d, float t_max, float angle, out float passes) {
    if (FAULT == FAULT_REAL_IGNORED) t_max = FAR;
    SceneHit first = SceneHit(FAR, NONE, NONE, vec2(0.0));
    passes = 1.0;
    if (ALPHA == 0u) {
        SceneHit hit = scene_closest_seen(origin, d, 0.0, FAR);
        if (hit.instance == NONE || hit.t >= t_max) return first;
        passes = 0.0;
        return hit;
    }
    float t_min = 0.0;
    for (uint layer = 0u; layer < MOST_LAYERS; layer++) {
        SceneHit hit = scene_closest_seen(origin, d, t_min, t_max);
        if (hit.instance == NONE) break;
        float alpha = hit_alpha(hit, d, hit.t * angle);
        if (alpha > 0.0 && first.instance == NONE) first = hit;
        passes *= 1.0 - alpha;
        if (passes < 1.0 / 1024.0) { passes = 0.0; break; }
        t_min = hit.t;
    }
    return first;
}

#ifdef WRITES_VIRTUAL
// The surface that a ray from the camera along d met, in a pixel of which the share `opacity` is virtual.
void write_virtual(ivec2 p, SceneHit met, vec3 d, float opacity) {
    Surface s = scene_surface(met, d, met.t * pixel_angle());
    Lobes lobes = bsdf_lobes(s, -d);
    if (ALPHA != 0u) s.emissive *= min(s.alpha / max(opacity, 1e-4), 1.0);
    vec3 previous = s.position;
    if (OBJECT_MOTION != 0u) {
        TriangleGeometry tri = triangle_geometry(met.triangle);
        uint first = in_instances.instance[met.instance].previous;
        if (DEFORMATION != 0u && first != NONE) {
            uint item = (met.triangle - first) * 3u;
            tri = triangle_of(imageLoad(in_previous_triangles, table_texel(item)), imageLoad(in_previous_triangles, table_texel(item + 1u)),
                imageLoad(in_previous_triangles, table_texel(item + 2u)));
        }
        vec3 point = tri.v0 + tri.e1 * met.barycentric.x + tri.e2 * met.barycentric.y;
        previous = transform_point(in_instances.instance[met.instance].previous_object_to_world, point);
    }
    // Relative to where the ray meets the image, so that a surface seen beside the pixel's centre is followed.
    const float MOST = 65000.0;
    imageStore(out_motion, p, clamp(motion_of(vec2(p) + 0.5, previous, 0.0), -MOST, MOST));
    imageStore(out_albedo_virtual, p, uvec4(color_pack(lobes.diffuse) & ~FLAG));
    if (EMISSION != 0u) imageStore(out_emission, p, uvec4(color_pack(s.emissive)));
    imageStore(guide, ivec3(p, VIRTUAL), guide_pack(s.position, s.normal, s.roughness, guide_object(in_instances.instance[met.instance].id)));
}
#endif

void write_no_virtual(ivec2 p) {
    imageStore(out_mask, ivec3(p, VIRTUAL), vec4(0.0));
    imageStore(out_albedo_virtual, p, uvec4(0u));
    if (EMISSION != 0u) imageStore(out_emission, p, uvec4(0u));
}
