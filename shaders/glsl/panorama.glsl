// The real scene: the panorama as radiance by direction and as a surface in space.
// The surface: a vertex at each texel centre, quads of four neighbours split along (i,j)–(i+1,j+1), a fan to each pole.
// Rays are traced through a min–max pyramid: the box of vertex positions over blocks of quads, halved to a single box.

// Level 0, and, where the picture is coarser than the panorama (MINIFIED), all mip levels.
layout(set = 0, binding = 1, rgba32f) uniform readonly image2D in_panorama_radiance;
#ifdef PANORAMA_LEVELS
layout(constant_id = 3) const uint MINIFIED = 0;
layout(set = 0, binding = 9) uniform sampler2D panorama_levels;
#endif
// Radial depth, metres, row by row; 0 is a hole. Two more values: the north and the south pole.
layout(set = 0, binding = 2, scalar) readonly buffer Depth { float depth[]; } in_depth;
// (sin φ, cos φ) of each column, then (sin θ, cos θ) of each row.
layout(set = 0, binding = 3, scalar) readonly buffer Angles { vec2 angle[]; } in_angles;

const uint FREE = 0u;
const uint SURFACE = 1u;
const uint SKIRT = 2u;

struct PanoramaHit {
    float t;      // FAR where the ray leaves
    vec2 uv;      // where the radiance is read
    uint kind;    // FREE, SURFACE or SKIRT
    bool unknown; // it passed behind a foreground edge, through space the capture never saw
    vec3 normal;  // of the triangle, of any length
};

vec2 panorama_uv(vec3 d) {
    float u = (arctangent(d.x, -d.z) + in_view.view.yaw) * (0.5 / PI) + 0.5;
    return vec2(u - floor(u), arctangent(length(d.xz), d.y) / PI);
}

// Bilinear radiance; columns wrap and poles continue on the opposite meridian.
vec3 panorama_bilinear(vec2 uv) {
    ivec2 size = ivec2(in_view.view.color_size);
    vec2 p = uv * vec2(size) - 0.5;
    ivec2 i = ivec2(floor(p));
    vec2 f = p - vec2(i);
    vec3 a = imageLoad(in_panorama_radiance, wrap_texel(i, size)).rgb, b = imageLoad(in_panorama_radiance, wrap_texel(i + ivec2(1, 0), size)).rgb;
    vec3 c = imageLoad(in_panorama_radiance, wrap_texel(i + ivec2(0, 1), size)).rgb, d = imageLoad(in_panorama_radiance, wrap_texel(i + ivec2(1, 1), size)).rgb;
    return mix(mix(a, b, f.x), mix(c, d, f.x), f.y);
}

#ifdef PANORAMA_LEVELS
vec3 panorama_bilinear_level(vec2 uv, int level) {
    ivec2 size = textureSize(panorama_levels, level);
    vec2 p = uv * vec2(size) - 0.5;
    ivec2 i = ivec2(floor(p));
    vec2 f = p - vec2(i);
    vec3 a = texelFetch(panorama_levels, wrap_texel(i, size), level).rgb, b = texelFetch(panorama_levels, wrap_texel(i + ivec2(1, 0), size), level).rgb;
    vec3 c = texelFetch(panorama_levels, wrap_texel(i + ivec2(0, 1), size), level).rgb, d = texelFetch(panorama_levels, wrap_texel(i + ivec2(1, 1), size), level).rgb;
    return mix(mix(a, b, f.x), mix(c, d, f.x), f.y);
}

// Radiance filtered over a footprint of `angle` radians; plain bilinear where magnified.
vec3 panorama_filtered(vec2 uv, float angle) {
    if (MINIFIED == 0u) return panorama_bilinear(uv);
    float level = log2(max(1.0, angle * float(in_view.view.color_size.y) / PI));
    level = min(level, float(in_view.view.color_levels - 1u));
    int l = int(level);
    return mix(panorama_bilinear_level(uv, l), panorama_bilinear_level(uv, min(l + 1, int(in_view.view.color_levels) - 1)), level - float(l));
}
#endif

// --- the surface ---

// Depth of vertex (i, j); j = -1 and j = H are the poles.
float vertex_depth(int i, int j) {
    ivec2 size = ivec2(in_view.view.depth_size);
    if (j < 0) return in_depth.depth[size.x * size.y];
    if (j >= size.y) return in_depth.depth[size.x * size.y + 1];
    return in_depth.depth[j * size.x + (i >= size.x ? i - size.x : i)];
}

vec3 vertex_direction(int i, int j) {
    ivec2 size = ivec2(in_view.view.depth_size);
    if (j < 0) return vec3(0.0, 1.0, 0.0);
    if (j >= size.y) return vec3(0.0, -1.0, 0.0);
    vec2 phi = in_angles.angle[i >= size.x ? i - size.x : i], theta = in_angles.angle[size.x + j];
    return vec3(theta.x * phi.x, theta.y, -theta.x * phi.y);
}

// (u, v) of a vertex.
vec2 vertex_uv(int i, int j) {
    return vec2((float(i) + 0.5) / float(in_view.view.depth_size.x), clamp((float(j) + 0.5) / float(in_view.view.depth_size.y), 0.0, 1.0));
}

// The real surface in a direction from the centre: its distance (0 in a hole) and the texel whose vertex is nearest.
// Between foreground and background (a skirt) it snaps to the nearer vertex in the image, so that no surface is smeared.
float surface_distance(vec3 d, out ivec2 texel) {
    ivec2 size = ivec2(in_view.view.depth_size);
    vec2 uv = panorama_uv(d);
    vec2 p = uv * vec2(size) - 0.5;
    int i = int(floor(p.x)), j = int(floor(p.y));
    vec2 f = p - vec2(i, j);
    texel = wrap_texel(ivec2(floor(p + 0.5)), size);
    if (i < 0) i += size.x;
    bool lower = j < 0 || (j < size.y - 1 && f.y > f.x); // of the two triangles, (i,j) (i,j+1) (i+1,j+1)
    ivec2 a = ivec2(i, j), b = lower ? ivec2(i, j + 1) : ivec2(i + 1, j + 1), c = lower ? ivec2(i + 1, j + 1) : ivec2(i + 1, j);
    float da = vertex_depth(a.x, a.y), db = vertex_depth(b.x, b.y), dc = vertex_depth(c.x, c.y);
    float near = min(da, min(db, dc)), far = max(da, max(db, dc));
    if (near <= 0.0) return 0.0;
    if (far > near * (1.0 + in_view.view.edge_ratio)) return in_depth.depth[texel.y * size.x + texel.x];
    vec3 va = vertex_direction(a.x, a.y) * da, vb = vertex_direction(b.x, b.y) * db, vc = vertex_direction(c.x, c.y) * dc;
    vec3 n = cross(vb - va, vc - va);
    float t = dot(n, va) / dot(n, d);
    return t >= 0.5 * near && t <= 2.0 * far ? t : near; // edge-on by rounding
}

#ifdef TRACE_PANORAMA
// Boxes of the pyramid: six floats a node (min, max), four siblings together.
layout(set = 0, binding = 4, scalar) readonly buffer Pyramid { float bound[]; } in_pyramid;

uint pyramid_node(uint level, uint x, uint y) {
    return in_view.view.level_offset[level] + ((y >> 1u) * ((in_view.view.level_width[level] + 1u) >> 1u) + (x >> 1u)) * 4u + ((y & 1u) * 2u + (x & 1u));
}

// One triangle against the ray, closest so far in `hit`; `unknown` collects the nearest crossing of a skirt's far side.
void panorama_triangle(vec3 origin, vec3 d, vec3 v0, vec3 v1, vec3 v2, vec3 depths, float t_min, ivec2 corners[3], inout PanoramaHit hit, inout float unknown) {
    float near = min(depths.x, min(depths.y, depths.z));
    if (near <= 0.0) return;
    vec3 e1 = v1 - v0, e2 = v2 - v0;
    vec3 p = cross(d, e2);
    float det = dot(e1, p);
    if (det == 0.0) return;
    float inverse = 1.0 / det;
    vec3 s = origin - v0;
    float u = dot(s, p) * inverse;
    vec3 q = cross(s, e1);
    float v = dot(d, q) * inverse;
    float t = dot(e2, q) * inverse;
    if (u < 0.0 || v < 0.0 || u + v > 1.0 || t <= t_min || t >= hit.t) return;
    float far = max(depths.x, max(depths.y, depths.z));
    if (far <= near * (1.0 + in_view.view.edge_ratio)) {
        hit.t = t;
        hit.kind = SURFACE;
        hit.normal = cross(e1, e2);
        return;
    }
    if (length(origin + d * t) - near > in_view.view.thickness) {
        unknown = min(unknown, t);
        return;
    }
    ivec2 corner = depths.x <= min(depths.y, depths.z) ? corners[0] : depths.y <= depths.z ? corners[1] : corners[2];
    hit.t = t;
    hit.kind = SKIRT;
    hit.uv = vertex_uv(corner.x, corner.y);
}

// The 2×2 quads of a leaf: quad row j lies between vertex rows j-1 and j.
void panorama_leaf(vec3 origin, vec3 d, uint block_x, uint block_y, float t_min, inout PanoramaHit hit, inout float unknown) {
    ivec2 size = ivec2(in_view.view.depth_size);
    for (int q = 0; q < 4; q++) {
        int i = int(block_x) * 2 + (q & 1), j = int(block_y) * 2 + (q >> 1) - 1;
        if (i >= size.x || j >= size.y) continue;
        float da = vertex_depth(i, j), db = vertex_depth(i, j + 1), dc = vertex_depth(i + 1, j + 1), dd = vertex_depth(i + 1, j);
        vec3 va = vertex_direction(i, j) * da, vc = vertex_direction(i + 1, j + 1) * dc;
        if (j < size.y - 1)
            panorama_triangle(origin, d, va, vertex_direction(i, j + 1) * db, vc, vec3(da, db, dc), t_min, ivec2[3](ivec2(i, j), ivec2(i, j + 1), ivec2(i + 1, j + 1)), hit, unknown);
        if (j >= 0)
            panorama_triangle(origin, d, va, vc, vertex_direction(i + 1, j) * dd, vec3(da, dc, dd), t_min, ivec2[3](ivec2(i, j), ivec2(i + 1, j + 1), ivec2(i + 1, j)), hit, unknown);
    }
}

// Closest hit of the real surface along a ray in (t_min, t_max). Exact for the surface defined above.
PanoramaHit panorama_trace(vec3 origin, vec3 d, float t_min, float t_max) {
    PanoramaHit hit = PanoramaHit(t_max, vec2(0.0), FREE, false, vec3(0.0));
    float unknown = FAR;
    vec3 inverse = vec3(abs(d.x) > 1e-20 ? 1.0 / d.x : 1e20, abs(d.y) > 1e-20 ? 1.0 / d.y : 1e20, abs(d.z) > 1e-20 ? 1.0 / d.z : 1e20);
    vec3 shift = -origin * inverse;
    uint stack[48];
    float entry[48];
    int top = 1;
    stack[0] = (in_view.view.pyramid_levels - 1u) << 28u;
    entry[0] = 0.0;
    // boxes in one loop, triangles in the other: a group of rays that walks together does either, not both (Aila and Laine 2009)
    const uint NO_LEAF = 0xffffffffu;
    while (true) {
        uint leaf = NO_LEAF;
        while (top > 0) {
            top--;
            uint code = stack[top];
            if (entry[top] >= hit.t) continue;
            uint level = code >> 28u, y = (code >> 14u) & 0x3fffu, x = code & 0x3fffu;
            if (level == 0u) { leaf = code; break; }
            uint base = pyramid_node(level - 1u, x * 2u, y * 2u) * 6u;
            vec4 t;
            uvec4 child;
            [[unroll]] for (uint k = 0u; k < 4u; k++) {
                uint b = base + k * 6u;
                vec3 lo = vec3(in_pyramid.bound[b], in_pyramid.bound[b + 1u], in_pyramid.bound[b + 2u]);
                vec3 hi = vec3(in_pyramid.bound[b + 3u], in_pyramid.bound[b + 4u], in_pyramid.bound[b + 5u]);
                bool empty = lo.x > hi.x; // to the slab test an inverted box is everywhere
                lo = lo * inverse + shift;
                hi = hi * inverse + shift;
                vec3 a = min(lo, hi), c = max(lo, hi);
                float enter = max(max(a.x, a.y), max(a.z, t_min)), leave = min(min(c.x, c.y), min(c.z, hit.t));
                t[k] = !empty && enter <= leave * 1.0000004 ? enter : FAR;
                child[k] = ((level - 1u) << 28u) | ((y * 2u + (k >> 1u)) << 14u) | (x * 2u + (k & 1u));
            }
            // farthest first, so that the nearest is popped first
            if (t.x < t.y) { t.xy = t.yx; child.xy = child.yx; }
            if (t.z < t.w) { t.zw = t.wz; child.zw = child.wz; }
            if (t.x < t.z) { t.xz = t.zx; child.xz = child.zx; }
            if (t.y < t.w) { t.yw = t.wy; child.yw = child.wy; }
            if (t.y < t.z) { t.yz = t.zy; child.yz = child.zy; }
            [[unroll]] for (uint k = 0u; k < 4u; k++) {
                if (t[k] < FAR) { stack[top] = child[k]; entry[top] = t[k]; top++; }
            }
        }
        if (leaf == NO_LEAF) break;
        panorama_leaf(origin, d, leaf & 0x3fffu, (leaf >> 14u) & 0x3fffu, t_min, hit, unknown);
    }
    hit.unknown = unknown < hit.t;
    if (hit.kind == FREE) { hit.t = FAR; hit.uv = panorama_uv(d); }
    if (hit.kind == SURFACE) hit.uv = panorama_uv(origin + d * hit.t);
    return hit;
}
#endif
