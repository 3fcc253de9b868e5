// The real scene: the panorama as radiance by direction and as a surface in space. The surface has a vertex
// at each texel centre, quads of four neighbours split along (i,j)–(i+1,j+1), and a fan to each pole.

#include "bind/panorama.glsl"
#include "halves.glsl"
layout(constant_id = 3) const uint MINIFIED = 0; // 1: the picture is coarser than the panorama and reads its mip levels

const uint FREE = 0u;
const uint SURFACE = 1u;
const uint SKIRT = 2u;
const uint UNSEEN = 3u; // a skirt far behind the edge of a wall (edges.glsl)
const float UNSEEN_LIGHT = 0.4; // of what borders it

struct PanoramaHit {
    float t;      // FAR if the ray leaves
    vec2 uv;      // where the radiance is read
    uint kind;    // FREE, SURFACE, SKIRT, UNSEEN, or a lamp (lamps.glsl)
    vec3 normal;  // of the triangle, of any length
};

bool is_skirt(PanoramaHit hit) { return hit.kind == SKIRT || hit.kind == UNSEEN; }

#include "lamps.glsl"
#include "edges.glsl"

// Returns a texel of the radiance, as `in_panorama_radiance` has it.
vec4 panorama_texel(ivec2 p) {
    return HALVES != 0u ? from_halves(texelFetch(panorama_levels, p, 0)) : imageLoad(in_panorama_radiance, p);
}

// Returns a texel of a mip level.
vec3 panorama_level_texel(ivec2 p, int level) {
    vec4 texel = texelFetch(panorama_levels, p, level);
    return HALVES != 0u ? from_halves(texel).rgb : texel.rgb;
}

vec2 panorama_uv(vec3 d) {
    float u = (arctangent(d.x, -d.z) + in_view.view.yaw) * (0.5 / PI) + 0.5;
    return vec2(u - floor(u), arctangent(length(d.xz), d.y) / PI);
}

// Returns bilinear radiance. Columns wrap, and poles continue on the opposite meridian.
vec3 panorama_bilinear(vec2 uv) {
    ivec2 size = ivec2(in_view.view.color_size);
    vec2 p = uv * vec2(size) - 0.5;
    ivec2 i = ivec2(floor(p));
    vec2 f = p - vec2(i);
    vec3 a = panorama_texel(wrap_texel(i, size)).rgb, b = panorama_texel(wrap_texel(i + ivec2(1, 0), size)).rgb;
    vec3 c = panorama_texel(wrap_texel(i + ivec2(0, 1), size)).rgb, d = panorama_texel(wrap_texel(i + ivec2(1, 1), size)).rgb;
    return mix(mix(a, b, f.x), mix(c, d, f.x), f.y);
}

// Returns the same as a light: a clipped lamp shines by a factor more than it shows.
vec3 panorama_light(vec2 uv) {
    ivec2 size = ivec2(in_view.view.color_size);
    vec2 p = uv * vec2(size) - 0.5;
    ivec2 i = ivec2(floor(p));
    vec2 f = p - vec2(i);
    vec4 a = panorama_texel(wrap_texel(i, size)), b = panorama_texel(wrap_texel(i + ivec2(1, 0), size));
    vec4 c = panorama_texel(wrap_texel(i + ivec2(0, 1), size)), d = panorama_texel(wrap_texel(i + ivec2(1, 1), size));
    return mix(mix(a.rgb * a.w, b.rgb * b.w, f.x), mix(c.rgb * c.w, d.rgb * d.w, f.x), f.y);
}

// Returns the direction of a place of the panorama in the world.
vec3 panorama_direction(vec2 uv) {
    vec2 phi = circle(uv.x - 0.5 - in_view.view.yaw / (2.0 * PI)), theta = circle(0.5 * uv.y);
    return vec3(theta.y * phi.y, theta.x, -theta.y * phi.x);
}

vec3 panorama_bilinear_level(vec2 uv, int level) {
    ivec2 size = textureSize(panorama_levels, level);
    vec2 p = uv * vec2(size) - 0.5;
    ivec2 i = ivec2(floor(p));
    vec2 f = p - vec2(i);
    vec3 a = panorama_level_texel(wrap_texel(i, size), level), b = panorama_level_texel(wrap_texel(i + ivec2(1, 0), size), level);
    vec3 c = panorama_level_texel(wrap_texel(i + ivec2(0, 1), size), level), d = panorama_level_texel(wrap_texel(i + ivec2(1, 1), size), level);
    return mix(mix(a, b, f.x), mix(c, d, f.x), f.y);
}

// Returns radiance filtered over a footprint of `angle` radians. It is plain bilinear under magnification.
vec3 panorama_filtered(vec2 uv, float angle) {
    if (MINIFIED == 0u) return panorama_bilinear(uv);
    float level = log2(max(1.0, angle * float(in_view.view.color_size.y) / PI));
    level = min(level, float(in_view.view.color_levels - 1u));
    int l = int(level);
    return mix(panorama_bilinear_level(uv, l), panorama_bilinear_level(uv, min(l + 1, int(in_view.view.color_levels) - 1)), level - float(l));
}

// --- the surface ---

// Returns the depth of vertex (i, j), i from 0 to W. j = -1 and j = H are the poles.
float vertex_depth(int i, int j) {
    int width = int(in_view.view.depth_size.x);
    if (FAULT == FAULT_NO_WRAP && i >= width) return 0.0;
    return imageLoad(in_depth, ivec2(i >= width ? i - width : i, j + 1)).x;
}

vec3 vertex_direction(int i, int j) {
    int width = int(in_view.view.depth_size.x);
    vec2 phi = imageLoad(in_angles, ivec2(i >= width ? i - width : i, 0)).xy, theta = imageLoad(in_angles, ivec2(j + 1, 1)).xy;
    return vec3(theta.x * phi.x, theta.y, -theta.x * phi.y);
}

// Returns the radiance of what a ray met, as captured. No skirt shines: what it shows of the side of a lamp or a
// window is a guess, of which no light may be made. What nobody saw is dimmer than what borders it: it is shown
// as a mean within 4° around the middle between both sides, of which a ray takes one direction by its own bits.
vec3 hit_radiance(PanoramaHit hit) {
    vec2 uv = hit.uv;
    float dim = 1.0;
    if (hit.kind == UNSEEN) {
        uint bits = hash(floatBitsToUint(hit.t) + hash(floatBitsToUint(uv.x) + hash(floatBitsToUint(uv.y))));
        vec2 aside = vec2(bits & 0xffffu, bits >> 16u) / 32768.0 - 1.0;
        uv = clamp(uv + aside * vec2(1.0, 2.0) / 90.0, vec2(-1.0, 0.0), vec2(2.0, 1.0));
        uv.x -= floor(uv.x);
        dim = UNSEEN_LIGHT;
    }
    vec3 radiance = panorama_light(uv);
    if (FREE_LAMPS != 0u) radiance = without_lamps(panorama_direction(uv), radiance);
    if (is_skirt(hit)) radiance *= dim * min(1.0, in_view.view.skirt_luminance / max(luminance(radiance), 1e-20));
    // Colours beyond Rec. 709 are shown, but no light is negative.
    return max(is_lamp(hit) ? lamp_radiance(hit) : radiance, vec3(0.0));
}

// Returns (u, v) of a vertex.
vec2 vertex_uv(int i, int j) {
    int width = int(in_view.view.depth_size.x);
    return vec2((float(i >= width ? i - width : i) + 0.5) / float(width), clamp((float(j) + 0.5) / float(in_view.view.depth_size.y), 0.0, 1.0));
}

// Returns the real surface in a direction from the centre: its distance (0 in a hole) and the texel whose
// vertex is nearest. Between foreground and background (a skirt) it snaps to the vertex that is nearer in the
// image, so that no surface is smeared.
float surface_distance(vec3 d, out ivec2 texel) {
    ivec2 size = ivec2(in_view.view.depth_size);
    vec2 uv = panorama_uv(d);
    vec2 p = uv * vec2(size) - 0.5;
    int i = int(floor(p.x)), j = int(floor(p.y));
    vec2 f = p - vec2(i, j);
    texel = wrap_texel(ivec2(floor(p + 0.5)), size);
    if (i < 0) i += size.x;
    bool lower = j < 0 || (j < size.y - 1 && f.y > f.x); // in the triangle (i,j), (i,j+1), (i+1,j+1)
    ivec2 a = ivec2(i, j), b = lower ? ivec2(i, j + 1) : ivec2(i + 1, j + 1), c = lower ? ivec2(i + 1, j + 1) : ivec2(i + 1, j);
    float da = vertex_depth(a.x, a.y), db = vertex_depth(b.x, b.y), dc = vertex_depth(c.x, c.y);
    float near = min(da, min(db, dc)), far = max(da, max(db, dc));
    if (near <= 0.0) return 0.0;
    if (is_skirt(near, far, 1.0 + in_view.view.edge_ratio, in_view.view.edge_depth != 0u)) return vertex_depth(texel.x, texel.y);
    vec3 va = vertex_direction(a.x, a.y) * da, vb = vertex_direction(b.x, b.y) * db, vc = vertex_direction(c.x, c.y) * dc;
    vec3 n = cross(vb - va, vc - va);
    float t = dot(n, va) / dot(n, d);
    return t >= 0.5 * near && t <= 2.0 * far ? t : near; // rounding can spoil an edge-on hit
}
