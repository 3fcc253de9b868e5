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

// Returns the distances of the four children's planes, float bits.
ivec4 distances(uint word, float scale, float base) { return floatBitsToInt(bytes(word) * scale + base); }

// Says which children of a node come first: bit 0 flips columns, bit 1 rows. Azimuth grows or falls along a whole ray,
// polar angle mostly does.
uint first_child(vec3 origin, vec3 d) {
    bool left = origin.x * d.z < origin.z * d.x;
    bool up = d.y * dot(origin, origin) > origin.y * dot(origin, d);
    return uint(left) | uint(up) << 1u;
}

// Finds the nearest crossing in (t_min, t_max) of what can be hit, or any crossing of a skirt's far side.
// There is no stack of nodes: where a ray is in the pyramid says what its ancestors are. `left` has four bits for
// each level, finest first: the children of its node that are still to be visited, in the order of first_child. So
// its lowest bit is where to go next, whether down or back up.
Crossing walk(vec3 origin, vec3 d, float t_min, float t_max, bool far_sides) {
    Crossing crossing = Crossing(t_max, NO_TRIANGLE);
    bvec3 forward = greaterThanEqual(d, vec3(0.0));
    vec3 inverse = vec3(abs(d.x) > 1e-20 ? 1.0 / d.x : 1e20, abs(d.y) > 1e-20 ? 1.0 / d.y : 1e20, abs(d.z) > 1e-20 ? 1.0 / d.z : 1e20);
    vec3 shift = -origin * inverse;
    mat3 across = basis(d);
    uint root = far_sides ? in_view.view.pyramid_nodes : 0u, flip = first_child(origin, d);
    bool flip_x = (flip & 1u) != 0u, flip_y = flip > 1u;
    int level = int(in_view.view.pyramid_levels); // a leaf is at -1
    uvec2 left = level < 8 ? uvec2(1u << (4u * uint(level) + flip), 0u) : uvec2(0u, 1u << (4u * uint(level) - 32u + flip));
    uint x = 0u, y = 0u;
    bool done = false;
    // One loop visits boxes, the other triangles. A group of rays that walks together is in one of them at a
    // time (Aila and Laine 2009).
    while (true) {
        while (true) {
            if (left == uvec2(0u)) { done = true; break; }
            bool fine = left.x != 0u;
            uint next = uint(findLSB(fine ? left.x : left.y)) + (fine ? 0u : 32u), child = (next & 3u) ^ flip, climb = (next >> 2u) - uint(level);
            left = fine ? uvec2(left.x & (left.x - 1u), left.y) : uvec2(0u, left.y & (left.y - 1u));
            x = (x >> climb) * 2u + (child & 1u);
            y = (y >> climb) * 2u + (child >> 1u);
            level += int(climb) - 1;
            if (level < 0) break;
            uint texel = (root + pyramid_node(uint(level), x, y)) * 3u;
            uvec4 a = imageLoad(in_pyramid, table_texel(texel)), b = imageLoad(in_pyramid, table_texel(texel + 1u)), c = imageLoad(in_pyramid, table_texel(texel + 2u));
            vec3 scale = uintBitsToFloat((uvec3(a.w, a.w >> 8u, a.w >> 16u) & 0xffu) << 23u) * inverse;
            vec3 base = uintBitsToFloat(a.xyz) * inverse + shift;
            uvec3 least = b.xyz, greatest = uvec3(b.w, c.xy);
            uvec3 near = mix(greatest, least, forward), far = mix(least, greatest, forward);
            // Distances compare as integers do: of what is negative only that matters.
            ivec4 enter = max(max(distances(near.x, scale.x, base.x), distances(near.y, scale.y, base.y)), max(distances(near.z, scale.z, base.z), ivec4(floatBitsToInt(t_min))));
            ivec4 leave = min(min(distances(far.x, scale.x, base.x), distances(far.y, scale.y, base.y)), min(distances(far.z, scale.z, base.z), ivec4(floatBitsToInt(crossing.t))));
            bvec4 met = lessThanEqual(intBitsToFloat(enter), intBitsToFloat(leave) * 1.0000004);
            uvec4 bits = mix(uvec4(0u), uvec4(1u, 2u, 4u, 8u), met);
            uint all = (bits.x | bits.y | bits.z | bits.w) & c.z; // the bounds of an empty child are undefined
            if (flip_x) all = (all & 5u) << 1u | (all & 10u) >> 1u;
            if (flip_y) all = (all & 3u) << 2u | all >> 2u;
            all <<= (uint(level) & 7u) * 4u;
            if (level < 8) left.x |= all; else left.y |= all;
        }
        if (done) break;
        cross_leaf(x, y, across, origin, d, t_min, far_sides, crossing);
        if (far_sides && crossing.triangle != NO_TRIANGLE) break;
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
