#version 460
#extension GL_GOOGLE_include_directive : require
// Per video frame, depth_pyramid: one level of the boxes that rays walk (pyramid.glsl), around the triangles
// of the surface. Triangles with a hole are left out. Skirts are bounded as far as they can be hit. If it is
// asked for, nodes of their own bound what lies beyond, the far sides.
// In: depth, angles. In/out: pyramid.
#include "common.glsl"
#include "panorama.glsl"
#include "pyramid.glsl"
layout(local_size_x = 8, local_size_y = 8) in;

layout(push_constant, scalar) uniform Push { uint level; uint width; uint height; uint far_sides; } push;

struct Box { vec3 lo; vec3 hi; };

void include(inout Box box, vec3 p) {
    box.lo = min(box.lo, p);
    box.hi = max(box.hi, p);
}

// Returns the part of an edge within `reach` of the centre, or the parts beyond it. If both ends are beyond,
// its middle may be within.
void include_edge(inout Box box, vec3 a, vec3 b, float reach) {
    vec3 e = b - a;
    float ee = max(dot(e, e), 1e-30), ae = dot(a, e), inside = ae * ae - ee * (dot(a, a) - reach * reach);
    float middle = -ae / ee, half_length = sqrt(max(inside, 0.0)) / ee;
    float from = clamp(middle - half_length, 0.0, 1.0), to = clamp(middle + half_length, 0.0, 1.0);
    bool within = inside > 0.0 && middle + half_length >= 0.0 && middle - half_length <= 1.0;
    if (push.far_sides == 0u) {
        if (within) { include(box, a + e * from); include(box, a + e * to); }
    } else {
        if (!within || from > 0.0) { include(box, a); include(box, within ? a + e * from : b); }
        if (within && to < 1.0) { include(box, a + e * to); include(box, b); }
    }
}

// Returns the part of a skirt that can be hit, or the part beyond.
void include_skirt(inout Box box, vec3 a, vec3 b, vec3 c, float reach) {
    Box part = Box(vec3(FAR), vec3(-FAR));
    include_edge(part, a, b, reach);
    include_edge(part, b, c, reach);
    include_edge(part, c, a, reach);
    if (part.lo.x > part.hi.x) return;
    // Between two edges the sphere of radius `reach` bulges past the chord by at most this. It only cuts into
    // the far part.
    vec2 texel = PI * vec2(2.0, 1.0) / vec2(in_view.view.depth_size);
    float pad = reach * (1e-5 + (push.far_sides == 0u ? 0.125 * dot(texel, texel) : 0.0));
    box.lo = min(box.lo, part.lo - pad);
    box.hi = max(box.hi, part.hi + pad);
}

// A vertex in rows of in_depth; w its depth, 0 in a hole and beyond the image.
vec4 vertex(ivec2 p) {
    ivec2 size = ivec2(in_view.view.depth_size);
    if (p.x > size.x || p.y > size.y + 1) return vec4(0.0);
    float depth = vertex_depth(p.x, p.y - 1);
    return vec4(vertex_direction(p.x, p.y - 1) * depth, depth);
}

// Returns the smallest and largest depth of a triangle, and how far from the centre it can be hit. A skirt
// can be hit only within `thickness` behind its nearest depth; otherwise it would be a spike across the room.
vec3 triangle_range(float a, float b, float c) {
    float near = min(a, min(b, c)), far = max(a, max(b, c));
    bool edge_depth = in_view.view.edge_depth != 0u;
    return vec3(near, far, is_skirt(near, far, 1.0 + in_view.view.edge_ratio, edge_depth) ? skirt_reach(near, edge_depth, in_view.view.thickness) : FAR);
}

Box leaf_box(ivec2 leaf) {
    Box box = Box(vec3(FAR), vec3(-FAR));
    vec4 v[9];
    [[unroll]] for (int k = 0; k < 9; k++) v[k] = vertex(leaf * 2 + ivec2(k % 3, k / 3));
    uint skirts = 0u;
    [[unroll]] for (int k = 0; k < 8; k++) {
        int corner = (k >> 2) * 3 + ((k >> 1) & 1);
        vec4 a = v[corner], b = v[(k & 1) == 0 ? corner + 3 : corner + 4], c = v[(k & 1) == 0 ? corner + 4 : corner + 1];
        vec3 range = triangle_range(a.w, b.w, c.w);
        if (range.x <= 0.0) continue;
        if (range.y > range.z) skirts |= 1u << k;
        else if (push.far_sides == 0u) {
            include(box, a.xyz);
            include(box, b.xyz);
            include(box, c.xyz);
        }
    }
    // Few leaves have any, so most leave this loop at once.
    while (skirts != 0u) {
        int k = findLSB(skirts);
        skirts &= skirts - 1u;
        ivec2 corner = leaf * 2 + ivec2((k >> 1) & 1, k >> 2);
        vec4 a = vertex(corner), b = vertex(corner + ivec2(k & 1, 1)), c = vertex(corner + ivec2(1, 1 - (k & 1)));
        include_skirt(box, a.xyz, b.xyz, c.xyz, triangle_range(a.w, b.w, c.w).z);
    }
    // Rays round their numbers, too.
    vec3 largest = max(abs(box.lo), abs(box.hi));
    float pad = 4e-6 * max(largest.x, max(largest.y, largest.z));
    return box.lo.x > box.hi.x ? box : Box(box.lo - pad, box.hi + pad);
}

// Returns the box around a node's children.
Box node_box(uint node) {
    ivec2 texel = pyramid_texel(node);
    uvec4 a = imageLoad(pyramid, texel), b = imageLoad(pyramid, texel + ivec2(1, 0)), c = imageLoad(pyramid, texel + ivec2(2, 0));
    vec3 origin = uintBitsToFloat(a.xyz), scale = uintBitsToFloat((uvec3(a.w, a.w >> 8u, a.w >> 16u) & 0xffu) << 23u);
    Box box = Box(vec3(FAR), vec3(-FAR));
    for (uint k = 0u; k < 4u; k++) {
        if ((c.z & (1u << k)) == 0u) continue;
        include(box, origin + scale * vec3((b.xyz >> (8u * k)) & 0xffu));
        include(box, origin + scale * vec3((uvec3(b.w, c.xy) >> (8u * k)) & 0xffu));
    }
    return box;
}

void main() {
    uvec2 p = gl_GlobalInvocationID.xy;
    if (p.x >= push.width || p.y >= push.height) return;
    uint root = push.far_sides != 0u ? in_view.view.pyramid_nodes : 0u;
    PyramidShape shape = pyramid_shape();
    Box child[4], whole = Box(vec3(FAR), vec3(-FAR));
    for (uint k = 0u; k < 4u; k++) {
        uvec2 q = p * 2u + uvec2(k & 1u, k >> 1u);
        Box box = Box(vec3(FAR), vec3(-FAR));
        if (push.level == 0u) box = leaf_box(ivec2(q));
        else if (all(lessThan(q, ((in_view.view.pyramid_size - 1u) >> (push.level - 1u)) + 1u))) box = node_box(root + pyramid_node(shape, push.level - 1u, q.x, q.y));
        child[k] = box;
        whole.lo = min(whole.lo, box.lo);
        whole.hi = max(whole.hi, box.hi);
    }
    uvec3 least = uvec3(0u), greatest = uvec3(0u), exponent = uvec3(1u);
    uint held = 0u;
    if (whole.lo.x <= whole.hi.x) {
        // Steps are powers of two, and 255 of them span the box.
        uvec3 bits = floatBitsToUint(max((whole.hi - whole.lo) / 254.9, vec3(1e-30)));
        exponent = (bits >> 23u) + uvec3(notEqual(bits & 0x7fffffu, uvec3(0u)));
        vec3 scale = uintBitsToFloat(exponent << 23u);
        for (uint k = 0u; k < 4u; k++) {
            if (child[k].lo.x > child[k].hi.x) continue;
            held |= 1u << k;
            least |= uvec3(clamp(floor((child[k].lo - whole.lo) / scale - 1e-3), 0.0, 255.0)) << (8u * k);
            greatest |= uvec3(clamp(ceil((child[k].hi - whole.lo) / scale + 1e-3), 0.0, 255.0)) << (8u * k);
        }
    } else whole.lo = vec3(0.0);
    uint node = root + pyramid_node(shape, push.level, p.x, p.y);
    uint columns = (held & 5u) << 1u | (held & 10u) >> 1u, rows = (held & 3u) << 2u | held >> 2u, both = (columns & 3u) << 2u | columns >> 2u;
    ivec2 texel = pyramid_texel(node);
    imageStore(pyramid, texel, uvec4(floatBitsToUint(whole.lo), exponent.x | exponent.y << 8u | exponent.z << 16u));
    imageStore(pyramid, texel + ivec2(1, 0), uvec4(least, greatest.x));
    imageStore(pyramid, texel + ivec2(2, 0), uvec4(greatest.yz, held | columns << 4u | rows << 8u | both << 12u, 0u));
}
