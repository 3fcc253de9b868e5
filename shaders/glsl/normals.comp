#version 460
#extension GL_GOOGLE_include_directive : require
// Per video frame, normals (second dispatch). Of the planes fitted around it that explain its own depth, each
// texel takes the one that fits its neighbourhood best, so that a window across a crease or an edge does not
// bend the normal there. Depth that came in steps, or is noisy, moves onto that plane, within its step. Small holes in
// noisy depth are filled.
// In: plane, depth. Out: normal (towards the centre), depth (m).
#include "common.glsl"
#include "panorama.glsl"
#include "edge_depth.glsl"
layout(local_size_x = 8, local_size_y = 8) in;

#include "normals.glsl"

// Of the choice so far (xyz plane, w cost) and the plane that was fitted around texel t, returns the better. The
// plane must explain the depth 1/q within the limit. A favour below 1 makes it cheaper.
vec4 chosen(vec4 choice, ivec2 t, float favour, float limit, vec3 direction, float q) {
    vec4 plane = imageLoad(in_plane, wrap_texel(t, ivec2(in_view.view.depth_size)) / push.spacing);
    float e = dot(plane.xyz, direction) - q;
    float cost = (plane.w + 0.25 * e * e + 1e-8 * q * q) * favour;
    // Another plane must be better by more than rounding, in which drivers differ. At a crease both planes may
    // fit exactly.
    return plane.w < 0.0 || abs(e) > limit || cost >= 0.99 * choice.w ? choice : vec4(plane.xyz, cost);
}

void main() {
    ivec2 p = ivec2(gl_GlobalInvocationID.xy), size = ivec2(in_view.view.depth_size);
    if (any(greaterThanEqual(p, size))) return;
    // The poles are copied.
    float pole_scale = FAULT == FAULT_NO_POLES ? 0.0 : 1.0;
    if (p.y == 0) imageStore(out_depth, p, vec4(with_edge_class(pole_scale * vertex_depth(p.x, -1), EDGE_AT_POLE)));
    if (p.y == size.y - 1) imageStore(out_depth, p + ivec2(0, 2), vec4(with_edge_class(pole_scale * vertex_depth(p.x, size.y), EDGE_AT_POLE)));
    float depth = vertex_depth(p.x, p.y);
    vec3 direction = vertex_direction(p.x, p.y);
    vec4 choice = vec4(direction, FAR);
    if (depth > 0.0) {
        float q = 1.0 / depth;
        float step_here = step_at(q);
        float limit = step_here + push.relative * q;
        int offset = max(1, (2 * push.radius) / 3);
        // The nearest plane is slightly favoured. Where each texel has its own, that always counts.
        bool own = push.spacing == 1;
        if (!own) {
            ivec2 near = ((p + push.spacing / 2) / push.spacing) * push.spacing, far = near + push.spacing * ivec2(p.x < near.x ? -1 : 1, p.y < near.y ? -1 : 1);
            choice = chosen(choice, near, 0.8, limit, direction, q);
            choice = chosen(choice, ivec2(far.x, near.y), 1.0, limit, direction, q);
            choice = chosen(choice, ivec2(near.x, far.y), 1.0, limit, direction, q);
            choice = chosen(choice, far, 1.0, limit, direction, q);
        }
        for (int y = -1; y <= 1; y++) {
            for (int x = -1; x <= 1; x++) {
                bool middle = x == 0 && y == 0;
                if (middle && !own) continue;
                choice = chosen(choice, p + ivec2(x * offset % size.x, y * offset), middle ? 0.8 : 1.0, middle ? FAR : limit, direction, q);
            }
        }
        float smoothed = dot(choice.xyz, direction);
        if (step_here > 0.0 && choice.w < FAR) depth = 1.0 / clamp(smoothed, max(q - 0.75 * step_here, 0.25 * q), q + 0.75 * step_here);
    } else if (push.noise > 0.0) {
        ivec2 first = (p / push.spacing) * push.spacing;
        [[unroll]] for (int k = 0; k < 4; k++) {
            vec4 plane = imageLoad(in_plane, wrap_texel(first + push.spacing * ivec2(k & 1, k >> 1), size) / push.spacing);
            if (plane.w >= 0.0 && plane.w < choice.w && dot(plane.xyz, direction) > 0.0) choice = plane;
        }
        if (choice.w < FAR) depth = 1.0 / dot(choice.xyz, direction);
    }
    if (FAULT == FAULT_HOLES_NEAR && vertex_depth(p.x, p.y) <= 0.0) depth = 0.5;
    vec3 normal = dot(choice.xyz, choice.xyz) > 0.0 ? -normalize(choice.xyz) : -direction;
    imageStore(out_panorama_normal, p, vec4(to_half(normal), 0.0));
    if (in_view.view.edge_depth != 0u) depth = with_edge_class(depth, edge_class_at(p, vertex_depth(p.x, p.y)));
    imageStore(out_depth, p + ivec2(0, 1), vec4(depth));
}
