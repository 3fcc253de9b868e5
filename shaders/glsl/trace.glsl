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

// What the walk asks of the view for each triangle. Read once: within a loop llvmpipe reads it anew for each ray.
struct SurfaceShape { ivec2 size; float most_ratio; bool edge_depth; float thickness; };

SurfaceShape surface_shape() {
    View v = in_view.view;
    return SurfaceShape(ivec2(v.depth_size), 1.0 + v.edge_ratio, v.edge_depth != 0u, v.thickness);
}

// Depths are not negative, so they compare as integers do, which costs less.
float nearer(float a, float b) { return intBitsToFloat(min(floatBitsToInt(a), floatBitsToInt(b))); }
float farther(float a, float b) { return intBitsToFloat(max(floatBitsToInt(a), floatBitsToInt(b))); }

// Tests a triangle of which the ray's direction has these weights, `along` the distances of its vertices along the
// ray. `near` and `far` are its smallest and largest depth.
void cross_triangle(SurfaceShape shape, vec3 weight, vec3 along, float near, float far, vec3 origin, vec3 d, float t_min, bool far_sides, uint triangle, inout Crossing crossing) {
    float sum = weight.x + weight.y + weight.z;
    bool inside = all(lessThanEqual(weight, vec3(0.0))) || all(greaterThanEqual(weight, vec3(0.0)));
    float t = (weight.x * along.x + weight.y * along.y + weight.z * along.z) / sum;
    bool skirt = is_skirt(near, far, shape.most_ratio, shape.edge_depth);
    vec3 point = origin + d * t;
    float reach = skirt_reach(near, shape.edge_depth, shape.thickness);
    bool beyond = skirt && dot(point, point) > reach * reach;
    if (inside && sum != 0.0 && near > 0.0 && t > t_min && t < crossing.t && beyond == far_sides) {
        crossing.t = t;
        crossing.triangle = triangle | (skirt ? TRIANGLE_SKIRT : 0u);
    }
}

// Tests the two triangles of a quad, split from its upper left to its lower right. `edges` are top, bottom,
// left, right.
void cross_quad(SurfaceShape shape, vec4 v00, vec4 v01, vec4 v10, vec4 v11, vec4 edges, vec3 origin, vec3 d, float t_min, bool far_sides, uint quad, inout Crossing crossing) {
    float diagonal = edge(v00, v11), near = nearer(v00.w, v11.w), far = farther(v00.w, v11.w);
    cross_triangle(shape, vec3(edges.y, -diagonal, edges.z), vec3(v00.z, v10.z, v11.z), nearer(near, v10.w), farther(far, v10.w), origin, d, t_min, far_sides, quad, crossing);
    cross_triangle(shape, vec3(-edges.w, -edges.x, diagonal), vec3(v00.z, v11.z, v01.z), nearer(near, v01.w), farther(far, v01.w), origin, d, t_min, far_sides, quad | TRIANGLE_UPPER, crossing);
}

void cross_leaf(SurfaceShape shape, uint x, uint y, mat3 across, vec3 origin, vec3 d, float t_min, bool far_sides, inout Crossing crossing) {
    ivec2 size = shape.size, first = ivec2(x, y) * 2;
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
    cross_quad(shape, v[0], v[1], v[3], v[4], vec4(top0, middle0, left0, centre0), origin, d, t_min, far_sides, quad, crossing);
    cross_quad(shape, v[1], v[2], v[4], v[5], vec4(top1, middle1, centre0, right0), origin, d, t_min, far_sides, quad + 1u, crossing);
    cross_quad(shape, v[3], v[4], v[6], v[7], vec4(middle0, bottom0, left1, centre1), origin, d, t_min, far_sides, quad + (1u << 15u), crossing);
    cross_quad(shape, v[4], v[5], v[7], v[8], vec4(middle1, bottom1, centre1, right1), origin, d, t_min, far_sides, quad + (1u << 15u) + 1u, crossing);
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

// Goes from a node to one that is left to be visited: `next` is its place in `left`.
void follow(uint next, uint flip, inout uint level, inout uint x, inout uint y) {
    uint child = (next & 3u) ^ flip, climb = (next >> 2u) + 1u - level;
    x = (x >> climb) * 2u + (child & 1u);
    y = (y >> climb) * 2u + (child >> 1u);
    level = next >> 2u;
}

const uint WALKED = 16u; // more than any level, and added to the last one when nothing is left of `left`

// Finds the nearest crossing in (t_min, t_max) of what can be hit, or any crossing of a skirt's far side.
// There is no stack of nodes: where a ray is in the pyramid says what its ancestors are. `left` has four bits for
// each level, finest first: the children of its node that are still to be visited, in the order of first_child. So
// its lowest bit is where to go next, whether down or back up. `high` has those of levels from 8 on.
Crossing walk(vec3 origin, vec3 d, float t_min, float t_max, bool far_sides) {
    Crossing crossing = Crossing(t_max, NO_TRIANGLE);
    bvec3 forward = greaterThanEqual(d, vec3(0.0));
    vec3 inverse = vec3(abs(d.x) > 1e-20 ? 1.0 / d.x : 1e20, abs(d.y) > 1e-20 ? 1.0 / d.y : 1e20, abs(d.z) > 1e-20 ? 1.0 / d.z : 1e20);
    vec3 shift = -origin * inverse;
    mat3 across = basis(d);
    SurfaceShape shape = surface_shape();
    PyramidShape pyramid = pyramid_shape();
    uint root = far_sides ? in_view.view.pyramid_nodes : 0u, flip = first_child(origin, d);
    uvec4 bit = uvec4(1u) << (uvec4(0u, 1u, 2u, 3u) ^ flip);
    uint left = 0u, high = 0u;
    uint level = in_view.view.pyramid_levels - 1u, x = 0u, y = 0u; // the node to visit
    // One loop visits boxes, the other triangles. A group of rays that walks together is in one of them at a
    // time, and a ray that has found triangles walks on until it has three such nodes, so that it seldom waits
    // for the others (Aila and Laine 2009). Both loops ask at their ends whether to go on: asked first, a group
    // that does not branch would visit another node with no ray in it. Whether to go on is part of `level`, which
    // goes from turn to turn: what is only made in a turn is lost on llvmpipe for a ray that leaves before others.
    do {
        uvec3 found = uvec3(0u); // nodes of level 0 with leaves to test: four bits of which, 14 bits of x and y
        do {
            ivec2 texel = pyramid_texel(root + pyramid_node(pyramid, level, x, y));
            uvec4 a = imageLoad(in_pyramid, texel), b = imageLoad(in_pyramid, texel + ivec2(1, 0)), c = imageLoad(in_pyramid, texel + ivec2(2, 0));
            vec3 scale = uintBitsToFloat((uvec3(a.w, a.w >> 8u, a.w >> 16u) & 0xffu) << 23u) * inverse;
            vec3 base = uintBitsToFloat(a.xyz) * inverse + shift;
            uvec3 least = b.xyz, greatest = uvec3(b.w, c.xy);
            uvec3 near = mix(greatest, least, forward), far = mix(least, greatest, forward);
            // Distances compare as integers do: of what is negative only that matters.
            ivec4 enter = max(max(distances(near.x, scale.x, base.x), distances(near.y, scale.y, base.y)), max(distances(near.z, scale.z, base.z), ivec4(floatBitsToInt(t_min))));
            ivec4 leave = min(min(distances(far.x, scale.x, base.x), distances(far.y, scale.y, base.y)), min(distances(far.z, scale.z, base.z), ivec4(floatBitsToInt(crossing.t))));
            bvec4 met = lessThanEqual(intBitsToFloat(enter), intBitsToFloat(leave) * 1.0000004);
            uvec4 bits = mix(uvec4(0u), bit, met);
            uint all = (bits.x | bits.y | bits.z | bits.w) & (c.z >> (4u * flip)); // the bounds of an empty child are undefined
            if (level == 0u) found = all != 0u ? uvec3(all | x << 4u | y << 18u, found.xy) : found;
            else if (level <= 8u) left |= all << (4u * level - 4u);
            else high |= all << (4u * level - 36u);
            if (left != 0u) follow(uint(findLSB(left)), flip, level, x, y);
            else level |= WALKED;
            left &= left - 1u;
        } while (level < WALKED && found.z == 0u);
        do {
            if (found.x != 0u) {
                uint child = uint(findLSB(found.x)) ^ flip, leaf_x = ((found.x >> 4u) & 0x3fffu) * 2u, leaf_y = (found.x >> 18u) * 2u;
                cross_leaf(shape, leaf_x + (child & 1u), leaf_y + (child >> 1u), across, origin, d, t_min, far_sides, crossing);
                found.x &= found.x - 1u;
                if ((found.x & 15u) == 0u) found = uvec3(found.yz, 0u);
            }
        } while (found.x != 0u);
        if (level >= WALKED && high != 0u) {
            level -= WALKED;
            follow(uint(findLSB(high)) + 32u, flip, level, x, y);
            high &= high - 1u;
        }
        if (far_sides && crossing.triangle != NO_TRIANGLE) level |= WALKED;
    } while (level < WALKED);
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
        // Far behind an edge it is neither the thing nor what is seen beyond, but between them.
        float near = min(depth.x, min(depth.y, depth.z));
        vec3 point = origin + d * hit.t;
        if (in_view.view.edge_depth != 0u && dot(point, point) > (near + in_view.view.thickness) * (near + in_view.view.thickness)) {
            ivec2 farthest = depth.x >= max(depth.y, depth.z) ? a : depth.y >= depth.z ? b : c;
            vec2 size = vec2(in_view.view.depth_size);
            hit.uv = clamp((0.5 * vec2(nearest + farthest) + 0.5) / size, vec2(0.0), vec2(2.0, 1.0));
            hit.uv.x -= floor(hit.uv.x);
            hit.kind = UNSEEN;
        }
    } else hit.uv = panorama_uv(origin + d * hit.t);
    return hit;
}

// Says whether a ray passes through a skirt's far side in (t_min, t_max), that is, through space that the
// capture never saw. The pyramid must have far sides.
bool panorama_unknown(vec3 origin, vec3 d, float t_min, float t_max) {
    return walk(origin, d, t_min, t_max, true).triangle != NO_TRIANGLE;
}
