// Traces rays through the panorama's surface exactly, from anywhere.
#include "pyramid.glsl"

const uint NO_TRIANGLE = 0xffffffffu;

// The nearest crossing so far: its distance and its triangle (quad column, vertex row above, which of the two
// triangles, whether it is a skirt).
struct Crossing { float t; uint triangle; };
const uint TRIANGLE_UPPER = 1u << 30u, TRIANGLE_SKIRT = 1u << 31u;

// A vertex as a ray sees it: xy across the ray, z along it, w its depth (0 in a hole). Both triangles at an
// edge compute the same edge function from these, so no ray slips between them (Woop et al. 2013).
float edge(vec4 a, vec4 b) { precise float area = a.x * b.y - a.y * b.x; return area; }

void cross_triangle(vec3 weight, vec4 a, vec4 b, vec4 c, vec3 origin, vec3 d, float t_min, bool far_sides, uint triangle, inout Crossing crossing) {
    float sum = weight.x + weight.y + weight.z;
    bool inside = max(weight.x, max(weight.y, weight.z)) <= 0.0 || min(weight.x, min(weight.y, weight.z)) >= 0.0;
    float near = min(a.w, min(b.w, c.w)), far = max(a.w, max(b.w, c.w));
    float t = (weight.x * a.z + weight.y * b.z + weight.z * c.z) / sum;
    bool skirt = far > near * (1.0 + in_view.view.edge_ratio);
    vec3 point = origin + d * t;
    float reach = skirt_reach(near);
    bool beyond = skirt && dot(point, point) > reach * reach;
    if (inside && sum != 0.0 && near > 0.0 && t > t_min && t < crossing.t && beyond == far_sides) {
        crossing.t = t;
        crossing.triangle = triangle | (skirt ? TRIANGLE_SKIRT : 0u);
    }
}

// Tests the two triangles of a quad, split from its upper left to its lower right. `edges` are top, bottom,
// left, right.
void cross_quad(vec4 v00, vec4 v01, vec4 v10, vec4 v11, vec4 edges, vec3 origin, vec3 d, float t_min, bool far_sides, uint quad, inout Crossing crossing) {
    float diagonal = edge(v00, v11);
    cross_triangle(vec3(edges.y, -diagonal, edges.z), v00, v10, v11, origin, d, t_min, far_sides, quad, crossing);
    cross_triangle(vec3(-edges.w, -edges.x, diagonal), v00, v11, v01, origin, d, t_min, far_sides, quad | TRIANGLE_UPPER, crossing);
}

void cross_leaf(uint x, uint y, mat3 across, vec3 origin, vec3 d, float t_min, bool far_sides, inout Crossing crossing) {
    ivec2 size = ivec2(in_view.view.depth_size), first = ivec2(x, y) * 2;
    vec3 at = origin * across;
    vec4 v[9];
    vec2 phi[3];
    ivec3 column = (FAULT == FAULT_NARROW_COLUMNS ? first.x & 4095 : first.x) + ivec3(0, 1, 2);
    // The column after the last is the first. What is beyond that, or beyond a pole, is a hole.
    bvec3 no_column = greaterThan(column, ivec3(size.x));
    column -= mix(ivec3(0), ivec3(size.x), greaterThanEqual(column, ivec3(size.x)));
    column = min(column, ivec3(size.x - 1));
    [[unroll]] for (int i = 0; i < 3; i++) phi[i] = imageLoad(in_angles, ivec2(column[i], 0)).xy;
    [[unroll]] for (int j = 0; j < 3; j++) {
        int row = min(first.y + j, size.y + 1);
        vec2 theta = imageLoad(in_angles, ivec2(row, 1)).xy;
        [[unroll]] for (int i = 0; i < 3; i++) {
            float depth = imageLoad(in_depth, ivec2(column[i], row)).x;
            if (no_column[i] || first.y + j > size.y + 1) depth = 0.0;
            vec3 p = vec3(theta.x * phi[i].x, theta.y, -theta.x * phi[i].y) * depth;
            v[j * 3 + i] = vec4(p * across - at, depth);
        }
    }
    float top0 = edge(v[0], v[1]), top1 = edge(v[1], v[2]), middle0 = edge(v[3], v[4]), middle1 = edge(v[4], v[5]);
    float bottom0 = edge(v[6], v[7]), bottom1 = edge(v[7], v[8]);
    float left0 = edge(v[0], v[3]), left1 = edge(v[3], v[6]), centre0 = edge(v[1], v[4]), centre1 = edge(v[4], v[7]);
    float right0 = edge(v[2], v[5]), right1 = edge(v[5], v[8]);
    uint quad = uint(first.x) | uint(first.y) << 15u;
    cross_quad(v[0], v[1], v[3], v[4], vec4(top0, middle0, left0, centre0), origin, d, t_min, far_sides, quad, crossing);
    cross_quad(v[1], v[2], v[4], v[5], vec4(top1, middle1, centre0, right0), origin, d, t_min, far_sides, quad + 1u, crossing);
    cross_quad(v[3], v[4], v[6], v[7], vec4(middle0, bottom0, left1, centre1), origin, d, t_min, far_sides, quad + (1u << 15u), crossing);
    cross_quad(v[4], v[5], v[7], v[8], vec4(middle1, bottom1, centre1, right1), origin, d, t_min, far_sides, quad + (1u << 15u) + 1u, crossing);
}

// Splits a word into its four bytes.
vec4 bytes(uint word) { return vec4(ivec4(uvec4(word, word >> 8u, word >> 16u, word >> 24u) & 0xffu)); }

// Finds the nearest crossing in (t_min, t_max) of what can be hit, or any crossing of a skirt's far side.
// There is no stack of nodes: where a ray is in the pyramid says what its ancestors are. A byte for each
// level says how many of a node's children are still to be visited and, nearest first, which. Their distances
// are not kept. The crossings found meanwhile rule them out when their own children's boxes are met, which
// was measured to cost less.
Crossing walk(vec3 origin, vec3 d, float t_min, float t_max, bool far_sides) {
    Crossing crossing = Crossing(t_max, NO_TRIANGLE);
    bvec3 forward = greaterThanEqual(d, vec3(0.0));
    vec3 inverse = vec3(abs(d.x) > 1e-20 ? 1.0 / d.x : 1e20, abs(d.y) > 1e-20 ? 1.0 / d.y : 1e20, abs(d.z) > 1e-20 ? 1.0 / d.z : 1e20);
    vec3 shift = -origin * inverse;
    mat3 across = basis(d);
    uint root = far_sides ? in_view.view.pyramid_nodes : 0u;
    uvec4 trail = uvec4(0u);
    uint pending = 0u; // a bit for each level that has children left
    int level = int(in_view.view.pyramid_levels) - 1; // a leaf is at -1
    uint x = 0u, y = 0u;
    bool back = false, done = false;
    const uint MISS = 0xffffffffu;
    // One loop visits boxes, the other triangles. A group of rays that walks together is in one of them at a
    // time (Aila and Laine 2009).
    while (true) {
        while (true) {
            if (back) {
                if (pending == 0u) { done = true; break; }
                int up = findLSB(pending);
                uint bits = (uint(up) & 3u) * 8u;
                uvec4 mask = mix(uvec4(0u), uvec4(0xffu << bits), equal(uvec4(uint(up) >> 2u), uvec4(0u, 1u, 2u, 3u)));
                uvec4 own = trail & mask;
                uint left = (own.x | own.y | own.z | own.w) >> bits, child = left & 3u, count = left >> 6u;
                x = (x >> uint(up - level)) * 2u + (child & 1u);
                y = (y >> uint(up - level)) * 2u + (child >> 1u);
                level = up - 1;
                if (count == 1u) pending &= pending - 1u;
                trail = (trail & ~mask) | (mask & ((((count - 1u) << 6u) | ((left >> 2u) & 0xfu)) << bits));
                back = false;
            }
            if (level < 0) break;
            uint texel = (root + pyramid_node(uint(level), x, y)) * 3u;
            uvec4 a = imageLoad(in_pyramid, table_texel(texel)), b = imageLoad(in_pyramid, table_texel(texel + 1u)), c = imageLoad(in_pyramid, table_texel(texel + 2u));
            vec3 scale = uintBitsToFloat((uvec3(a.w, a.w >> 8u, a.w >> 16u) & 0xffu) << 23u) * inverse;
            vec3 base = uintBitsToFloat(a.xyz) * inverse + shift;
            uvec3 least = b.xyz, greatest = uvec3(b.w, c.xy);
            uvec3 near = mix(greatest, least, forward), far = mix(least, greatest, forward);
            vec4 enter = max(max(bytes(near.x) * scale.x + base.x, bytes(near.y) * scale.y + base.y), max(bytes(near.z) * scale.z + base.z, vec4(t_min)));
            vec4 leave = min(min(bytes(far.x) * scale.x + base.x, bytes(far.y) * scale.y + base.y), min(bytes(far.z) * scale.z + base.z, vec4(crossing.t)));
            // Distances sort as integers. Their last bits hold the child's number.
            uvec4 key;
            [[unroll]] for (uint k = 0u; k < 4u; k++) {
                // The bounds of an empty child are undefined.
                bool met = (c.z & (1u << k)) != 0u && enter[k] <= leave[k] * 1.0000004;
                key[k] = met ? (floatBitsToUint(abs(enter[k])) & ~3u) | k : MISS;
            }
            uint low0 = min(key.x, key.y), high0 = max(key.x, key.y), low1 = min(key.z, key.w), high1 = max(key.z, key.w);
            uint first = min(low0, low1), last = max(high0, high1), between0 = max(low0, low1), between1 = min(high0, high1);
            uint second = min(between0, between1), third = max(between0, between1);
            if (second != MISS) {
                uint count = 1u + uint(third != MISS) + uint(last != MISS), bits = (uint(level) & 3u) * 8u;
                uvec4 mask = mix(uvec4(0u), uvec4(0xffu << bits), equal(uvec4(uint(level) >> 2u), uvec4(0u, 1u, 2u, 3u)));
                uint left = (count << 6u) | ((last & 3u) << 4u) | ((third & 3u) << 2u) | (second & 3u);
                trail = (trail & ~mask) | (mask & (left << bits));
                pending |= 1u << uint(level);
            }
            back = first == MISS;
            if (!back) {
                x = x * 2u + (first & 1u);
                y = y * 2u + ((first >> 1u) & 1u);
                level--;
            }
        }
        if (done) break;
        cross_leaf(x, y, across, origin, d, t_min, far_sides, crossing);
        if (far_sides && crossing.triangle != NO_TRIANGLE) break;
        back = true;
    }
    return crossing;
}

// Returns the closest hit of the real surface along a ray in (t_min, t_max). t_min ≥ 0, and d has length 1.
PanoramaHit panorama_trace(vec3 origin, vec3 d, float t_min, float t_max) {
    Crossing crossing = walk(origin, d, t_min, t_max, false);
    if (crossing.triangle == NO_TRIANGLE) return PanoramaHit(FAR, panorama_uv(d), FREE, vec3(0.0));
    ivec2 a = ivec2(crossing.triangle & 0x7fffu, int((crossing.triangle >> 15u) & 0x7fffu) - 1), b = a + ivec2(0, 1), c = a + 1;
    if ((crossing.triangle & TRIANGLE_UPPER) != 0u) { b = c; c = a + ivec2(1, 0); }
    vec3 depth = vec3(vertex_depth(a.x, a.y), vertex_depth(b.x, b.y), vertex_depth(c.x, c.y));
    vec3 va = vertex_direction(a.x, a.y) * depth.x, vb = vertex_direction(b.x, b.y) * depth.y, vc = vertex_direction(c.x, c.y) * depth.z;
    PanoramaHit hit = PanoramaHit(crossing.t, vec2(0.0), SURFACE, cross(vb - va, vc - va));
    if ((crossing.triangle & TRIANGLE_SKIRT) != 0u) {
        ivec2 nearest = depth.x <= min(depth.y, depth.z) ? a : depth.y <= depth.z ? b : c;
        hit.kind = SKIRT;
        hit.uv = vertex_uv(nearest.x, nearest.y);
        // Far behind a wall's edge it is neither the wall nor what is seen beyond, but between them.
        float near = min(depth.x, min(depth.y, depth.z));
        vec3 point = origin + d * hit.t;
        if (in_view.view.edge_depth != 0u && dot(point, point) > (near + in_view.view.thickness) * (near + in_view.view.thickness)) {
            ivec2 farthest = depth.x >= max(depth.y, depth.z) ? a : depth.y >= depth.z ? b : c;
            vec2 size = vec2(in_view.view.depth_size);
            hit.uv = clamp((0.5 * vec2(nearest + farthest) + 0.5) / size, vec2(0.0), vec2(2.0, 1.0));
            hit.uv.x -= floor(hit.uv.x);
        }
    } else hit.uv = panorama_uv(origin + d * hit.t);
    return hit;
}

// Says whether a ray passes through a skirt's far side in (t_min, t_max), that is, through space that the
// capture never saw. The pyramid must have far sides.
bool panorama_unknown(vec3 origin, vec3 d, float t_min, float t_max) {
    return walk(origin, d, t_min, t_max, true).triangle != NO_TRIANGLE;
}
