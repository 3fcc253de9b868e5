#version 460
#extension GL_GOOGLE_include_directive : require
// Per video frame, normals (second dispatch). Of the planes fitted around it that explain its own depth, each
// texel takes the one that fits its neighbourhood best, so that a window across a crease or an edge does not
// bend the normal there. Depth that came in steps moves onto that plane, within its step.
// In: plane, depth. Out: normal (towards the centre), depth (m).
#include "common.glsl"
#include "panorama.glsl"
#include "edge_depth.glsl"
layout(local_size_x = 8, local_size_y = 8) in;

layout(push_constant, scalar) uniform Push { int radius; int stride; float step_disparity; float step_radial; float relative; } push;

void main() {
    ivec2 p = ivec2(gl_GlobalInvocationID.xy), size = ivec2(in_view.view.depth_size);
    if (any(greaterThanEqual(p, size))) return;
    // The poles are copied.
    float pole_scale = FAULT == FAULT_NO_POLES ? 0.0 : 1.0;
    if (p.y == 0) imageStore(out_depth, p, vec4(with_edge_class(pole_scale * vertex_depth(p.x, -1), EDGE_AT_POLE)));
    if (p.y == size.y - 1) imageStore(out_depth, p + ivec2(0, 2), vec4(with_edge_class(pole_scale * vertex_depth(p.x, size.y), EDGE_AT_POLE)));
    float depth = vertex_depth(p.x, p.y);
    vec3 direction = vertex_direction(p.x, p.y);
    vec3 best = direction;
    float best_cost = FAR;
    if (depth > 0.0) {
        float q = 1.0 / depth;
        float step_here = max(push.step_disparity, push.step_radial * q * q);
        float limit = step_here + push.relative * q;
        int offset = max(1, (2 * push.radius) / 3);
        for (int y = -1; y <= 1; y++) {
            for (int x = -1; x <= 1; x++) {
                ivec2 t = wrap_texel(p + ivec2(x * offset % size.x, y * offset), size);
                vec4 plane = imageLoad(in_plane, t);
                if (plane.w < 0.0) continue;
                float e = dot(plane.xyz, direction) - q;
                if (abs(e) > limit && !(x == 0 && y == 0)) continue;
                // This texel's own plane is slightly favoured.
                float cost = (plane.w + 0.25 * e * e + 1e-8 * q * q) * (x == 0 && y == 0 ? 0.8 : 1.0);
                // Another plane must be better by more than rounding, in which drivers differ. At a crease
                // both planes may fit exactly.
                if (cost < 0.99 * best_cost) { best_cost = cost; best = plane.xyz; }
            }
        }
        float smoothed = dot(best, direction);
        if (step_here > 0.0 && best_cost < FAR) depth = 1.0 / clamp(smoothed, max(q - 0.75 * step_here, 0.25 * q), q + 0.75 * step_here);
    }
    if (FAULT == FAULT_HOLES_NEAR && depth <= 0.0) depth = 0.5;
    vec3 normal = dot(best, best) > 0.0 ? -normalize(best) : -direction;
    imageStore(out_panorama_normal, p, vec4(to_half(normal), 0.0));
    if (in_view.view.edge_depth != 0u) depth = with_edge_class(depth, edge_class_at(p, vertex_depth(p.x, p.y)));
    imageStore(out_depth, p + ivec2(0, 1), vec4(depth));
}
