#version 460
#extension GL_GOOGLE_include_directive : require
// Per video frame, depth_pyramid: one level of the min–max pyramid that rays walk: boxes (m) around the vertices of 2×2 quads
// at level 0, around four boxes above. Triangles with a hole are left out; an empty box has min > max.
// In: depth, angles. In/out: pyramid.
#include "common.glsl"
#include "panorama.glsl"
layout(local_size_x = 8, local_size_y = 8) in;
layout(set = 0, binding = 4, scalar) buffer Pyramid { float bound[]; } pyramid;

layout(push_constant, scalar) uniform Push { uint level; uint width; uint height; } push;

uint node(uint level, uint x, uint y) {
    return in_view.view.level_offset[level] + ((y >> 1u) * ((in_view.view.level_width[level] + 1u) >> 1u) + (x >> 1u)) * 4u + ((y & 1u) * 2u + (x & 1u));
}

// The part of an edge within `reach` of the centre, padded for the arc between two such edges.
void include_edge(inout vec3 lo, inout vec3 hi, vec3 a, vec3 b, float reach) {
    if (dot(a, a) > dot(b, b)) { vec3 swapped = a; a = b; b = swapped; }
    if (dot(a, a) > reach * reach) return;
    vec3 e = b - a;
    float ee = dot(e, e), ae = dot(a, e), c = dot(a, a) - reach * reach;
    float s = ee > 0.0 ? clamp((sqrt(max(ae * ae - ee * c, 0.0)) - ae) / ee, 0.0, 1.0) : 0.0;
    vec3 end = a + e * s, pad = vec3(1e-4 * reach);
    lo = min(lo, min(a, end) - pad);
    hi = max(hi, max(a, end) + pad);
}

void include_triangle(inout vec3 lo, inout vec3 hi, int i0, int j0, int i1, int j1, int i2, int j2) {
    float d0 = vertex_depth(i0, j0), d1 = vertex_depth(i1, j1), d2 = vertex_depth(i2, j2);
    if (min(d0, min(d1, d2)) <= 0.0) return;
    vec3 a = vertex_direction(i0, j0) * d0, b = vertex_direction(i1, j1) * d1, c = vertex_direction(i2, j2) * d2;
    float near = min(d0, min(d1, d2)), far = max(d0, max(d1, d2));
    // A skirt can be hit only within `thickness` behind its nearest depth: beyond, it would be a spike across the room.
    float reach = far > near * (1.0 + in_view.view.edge_ratio) ? near + in_view.view.thickness : FAR;
    if (far <= reach) {
        lo = min(lo, min(a, min(b, c)));
        hi = max(hi, max(a, max(b, c)));
        return;
    }
    include_edge(lo, hi, a, b, reach);
    include_edge(lo, hi, b, c, reach);
    include_edge(lo, hi, c, a, reach);
}

void main() {
    // the grid is padded to even so that four siblings always exist
    uvec2 p = gl_GlobalInvocationID.xy;
    if (p.x >= ((push.width + 1u) & ~1u) || p.y >= ((push.height + 1u) & ~1u)) return;
    vec3 lo = vec3(FAR), hi = vec3(-FAR);
    if (p.x < push.width && p.y < push.height) {
        ivec2 size = ivec2(in_view.view.depth_size);
        if (push.level == 0u) {
            for (int q = 0; q < 4; q++) {
                int i = int(p.x) * 2 + (q & 1), j = int(p.y) * 2 + (q >> 1) - 1;
                if (i >= size.x || j >= size.y) continue;
                if (j < size.y - 1) include_triangle(lo, hi, i, j, i, j + 1, i + 1, j + 1);
                if (j >= 0) include_triangle(lo, hi, i, j, i + 1, j + 1, i + 1, j);
            }
        } else {
            uint base = node(push.level - 1u, p.x * 2u, p.y * 2u) * 6u;
            for (uint k = 0u; k < 4u; k++) {
                uint b = base + k * 6u;
                lo = min(lo, vec3(pyramid.bound[b], pyramid.bound[b + 1u], pyramid.bound[b + 2u]));
                hi = max(hi, vec3(pyramid.bound[b + 3u], pyramid.bound[b + 4u], pyramid.bound[b + 5u]));
            }
        }
    }
    uint b = node(push.level, p.x, p.y) * 6u;
    pyramid.bound[b] = lo.x; pyramid.bound[b + 1u] = lo.y; pyramid.bound[b + 2u] = lo.z;
    pyramid.bound[b + 3u] = hi.x; pyramid.bound[b + 4u] = hi.y; pyramid.bound[b + 5u] = hi.z;
}
