// The virtual objects: two-level BVH, materials, textures.

const uint NONE = 0xffffffffu;

#include "bind/scene.glsl"

struct SceneHit {
    float t;       // FAR if nothing was hit
    uint instance; // index into in_instances
    uint triangle;
    vec2 barycentric;
};

// A point of a virtual surface, ready for shading.
struct Surface {
    vec3 position;
    vec3 geometric; // both normals face the ray that found the surface
    vec3 normal;
    vec3 base_color;
    float metallic;
    float roughness;
    vec3 emissive;
    vec3 f0; // Fresnel reflectance at normal incidence and at grazing
    float f90;
};

vec3 transform_point(vec4 rows[3], vec3 p) { return vec3(dot(rows[0], vec4(p, 1.0)), dot(rows[1], vec4(p, 1.0)), dot(rows[2], vec4(p, 1.0))); }
vec3 transform_direction(vec4 rows[3], vec3 d) { return vec3(dot(rows[0].xyz, d), dot(rows[1].xyz, d), dot(rows[2].xyz, d)); }
// Transforms by the transpose of the inverse, whose rows are given.
vec3 transform_normal(vec4 inverse_rows[3], vec3 n) { return inverse_rows[0].xyz * n.x + inverse_rows[1].xyz * n.y + inverse_rows[2].xyz * n.z; }

vec3 safe_inverse(vec3 d) {
    return vec3(abs(d.x) > 1e-20 ? 1.0 / d.x : 1e20, abs(d.y) > 1e-20 ? 1.0 / d.y : 1e20, abs(d.z) > 1e-20 ? 1.0 / d.z : 1e20);
}

struct TriangleGeometry { vec3 v0; vec3 e1; vec3 e2; };

TriangleGeometry triangle_geometry(uint triangle) {
    return TriangleGeometry(uintBitsToFloat(imageLoad(in_triangles, table_texel(triangle * 3u)).xyz),
        uintBitsToFloat(imageLoad(in_triangles, table_texel(triangle * 3u + 1u)).xyz),
        uintBitsToFloat(imageLoad(in_triangles, table_texel(triangle * 3u + 2u)).xyz));
}

bool box_met(uvec4 least, uvec4 greatest, vec3 inverse, vec3 shift, float t_max) {
    vec3 a = uintBitsToFloat(least.xyz) * inverse + shift, b = uintBitsToFloat(greatest.xyz) * inverse + shift;
    vec3 near = min(a, b), far = max(a, b);
    float enter = max(max(near.x, near.y), max(near.z, 0.0)), leave = min(min(far.x, far.y), min(far.z, t_max));
    return enter <= leave * 1.0000004;
}

void scene_triangles(uint leaf, uint instance, vec3 origin, vec3 d, inout SceneHit hit) {
    uint first = leaf >> 3u, end = first + (leaf & 7u);
    for (uint k = first; k < end; k++) {
        TriangleGeometry tri = triangle_geometry(k);
        vec3 p = cross(d, tri.e2);
        float det = dot(tri.e1, p);
        float inverse = 1.0 / det;
        vec3 s = origin - tri.v0;
        float u = dot(s, p) * inverse;
        vec3 q = cross(s, tri.e1);
        float v = dot(d, q) * inverse;
        float t = dot(tri.e2, q) * inverse;
        if (det != 0.0 && u >= 0.0 && v >= 0.0 && u + v <= 1.0 && t > 0.0 && t < hit.t) hit = SceneHit(t, instance, k, vec2(u, v));
    }
}

// Walks on from a node of a table, depth first, to the next leaf whose box the ray meets before t_max. Sets
// `node` to where the walk goes on. Returns 0 at the end.
#define WALK(nodes, node, inverse, shift, t_max, leaf)                                                        \
    leaf = 0u;                                                                                                \
    while (node != NONE && leaf == 0u) {                                                                      \
        uvec4 least = imageLoad(nodes, table_texel(node * 2u)), greatest = imageLoad(nodes, table_texel(node * 2u + 1u)); \
        bool met = box_met(least, greatest, inverse, shift, t_max);                                           \
        if (met) leaf = least.w;                                                                              \
        node = met && leaf == 0u ? node + 1u : greatest.w;                                                    \
    }

// Traces one instance. The ray in object space keeps its parameter t.
void scene_instance(uint index, vec3 world_origin, vec3 world_d, inout SceneHit hit) {
    vec4 rows[3];
    [[unroll]] for (uint row = 0u; row < 3u; row++) rows[row] = uintBitsToFloat(imageLoad(in_places, table_texel(index * 4u + row)));
    vec3 origin = transform_point(rows, world_origin), d = transform_direction(rows, world_d);
    vec3 inverse = safe_inverse(d), shift = -origin * inverse;
    uint node = imageLoad(in_places, table_texel(index * 4u + 3u)).x, leaf;
    // One loop visits boxes, the other triangles. A group of rays that walks together is in one of them at a
    // time (Aila and Laine 2009).
    while (true) {
        WALK(in_nodes, node, inverse, shift, hit.t, leaf)
        if (leaf == 0u) break;
        scene_triangles(leaf, index, origin, d, hit);
    }
}

// Says whether a ray meets any virtual surface before t_max.
bool scene_meets(vec3 origin, vec3 d, float t_max) {
    SceneHit hit = SceneHit(t_max, NONE, NONE, vec2(0.0));
    vec3 inverse = safe_inverse(d), shift = -origin * inverse;
    uint node = in_view.view.instance_count > 0u ? 0u : NONE, leaf;
    while (hit.instance == NONE) {
        WALK(in_top_nodes, node, inverse, shift, t_max, leaf)
        if (leaf == 0u) break;
        scene_instance(leaf >> 3u, origin, d, hit);
    }
    return hit.instance != NONE;
}

// Finds the closest virtual surface along a ray before t_max.
SceneHit scene_trace(vec3 origin, vec3 d, float t_max) {
    SceneHit hit = SceneHit(t_max, NONE, NONE, vec2(0.0));
    vec3 inverse = safe_inverse(d), shift = -origin * inverse;
    uint node = in_view.view.instance_count > 0u ? 0u : NONE, leaf;
    while (true) {
        WALK(in_top_nodes, node, inverse, shift, hit.t, leaf)
        if (leaf == 0u) break;
        scene_instance(leaf >> 3u, origin, d, hit);
    }
    if (hit.instance == NONE) hit.t = FAR;
    return hit;
}

// --- textures: RGBA8 in a buffer, bilinear between texels and nearest between mip levels ---

int wrap_index(int i, int size, uint mode) {
    if (mode == 2u) return clamp(i, 0, size - 1);
    int m = i % size;
    if (m < 0) m += size;
    if (mode == 0u) return m;
    int period = i % (2 * size);
    if (period < 0) period += 2 * size;
    return period < size ? period : 2 * size - 1 - period;
}

vec3 srgb_decode(vec3 c) { return mix(pow((c + 0.055) / 1.055, vec3(2.4)), c / 12.92, lessThanEqual(c, vec3(0.04045))); }

vec4 texture_texel(Texture tex, uint offset, ivec2 size, ivec2 p) {
    uint packed = in_texels.texel[offset + uint(wrap_index(p.y, size.y, tex.wrap_v) * size.x + wrap_index(p.x, size.x, tex.wrap_u))];
    vec4 c = unpackUnorm4x8(packed);
    if (tex.srgb != 0u) c.rgb = srgb_decode(c.rgb);
    return c;
}

// `footprint` is the width of the ray's footprint in units of uv.
vec4 texture_sample(uint index, vec2 uv, float footprint) {
    Texture tex = in_textures.entry[index];
    float level = floor(0.5 + log2(max(1.0, footprint * float(max(tex.width, tex.height)))));
    uint l = min(uint(level), tex.levels - 1u);
    uint offset = tex.offset;
    for (uint k = 0u; k < l; k++) offset += max(1u, tex.width >> k) * max(1u, tex.height >> k);
    ivec2 size = ivec2(max(1u, tex.width >> l), max(1u, tex.height >> l));
    // uv far from the origin lose their fraction, so they are wrapped first.
    uv = vec2(tex.wrap_u == 0u ? fract(uv.x) : uv.x, tex.wrap_v == 0u ? fract(uv.y) : uv.y);
    uv = clamp(uv, vec2(-1e4), vec2(1e4));
    vec2 p = uv * vec2(size) - 0.5;
    if (tex.nearest != 0u && l == 0u) return texture_texel(tex, offset, size, ivec2(floor(p + 0.5)));
    ivec2 i = ivec2(floor(p));
    vec2 f = p - vec2(i);
    vec4 a = mix(texture_texel(tex, offset, size, i), texture_texel(tex, offset, size, i + ivec2(1, 0)), f.x);
    vec4 b = mix(texture_texel(tex, offset, size, i + ivec2(0, 1)), texture_texel(tex, offset, size, i + ivec2(1, 1)), f.x);
    return mix(a, b, f.y);
}

// Returns where a hit is.
vec3 scene_point(SceneHit hit) {
    TriangleGeometry tri = triangle_geometry(hit.triangle);
    return transform_point(in_instances.instance[hit.instance].object_to_world, tri.v0 + tri.e1 * hit.barycentric.x + tri.e2 * hit.barycentric.y);
}

// Returns the surface at a hit. `d` is the ray's direction, and `width` the width of its footprint there in
// metres.
Surface scene_surface(SceneHit hit, vec3 d, float width) {
    Instance instance = in_instances.instance[hit.instance];
    TriangleGeometry tri = triangle_geometry(hit.triangle);
    TriangleShading shading = in_shading.triangle[hit.triangle];
    Vertex v0 = in_vertices.vertex[shading.v0], v1 = in_vertices.vertex[shading.v1], v2 = in_vertices.vertex[shading.v2];
    Material m = in_materials.material[shading.material];
    vec3 b = vec3(1.0 - hit.barycentric.x - hit.barycentric.y, hit.barycentric);

    Surface s;
    s.position = transform_point(instance.object_to_world, tri.v0 + tri.e1 * hit.barycentric.x + tri.e2 * hit.barycentric.y);
    s.geometric = normalize(transform_normal(instance.world_to_object, cross(tri.e1, tri.e2)));
    vec3 normal = transform_normal(instance.world_to_object, v0.normal * b.x + v1.normal * b.y + v2.normal * b.z);
    normal = dot(normal, normal) > 0.0 ? normalize(normal) : s.geometric;
    vec2 uv = v0.uv * b.x + v1.uv * b.y + v2.uv * b.z;

    vec3 w1 = transform_direction(instance.object_to_world, tri.e1), w2 = transform_direction(instance.object_to_world, tri.e2);
    vec2 u1 = v1.uv - v0.uv, u2 = v2.uv - v0.uv;
    float footprint = width * sqrt(abs(u1.x * u2.y - u1.y * u2.x) / max(1e-20, length(cross(w1, w2))));

    if (TEXTURES != 0u && m.normal_texture != NONE) {
        vec4 tangent = v0.tangent * b.x + v1.tangent * b.y + v2.tangent * b.z;
        vec3 t = transform_direction(instance.object_to_world, tangent.xyz);
        t -= normal * dot(t, normal);
        if (dot(t, t) > 1e-20) {
            t = normalize(t);
            vec3 n = texture_sample(m.normal_texture, uv, footprint).xyz * 2.0 - 1.0;
            n = vec3(n.xy * m.normal_scale, max(n.z, 1e-3));
            normal = normalize(t * n.x + cross(normal, t) * (tangent.w < 0.0 ? -n.y : n.y) + normal * n.z);
        }
    }
    if (dot(s.geometric, d) > 0.0 && FAULT != FAULT_NORMALS_UNTURNED) { s.geometric = -s.geometric; normal = -normal; }
    // A shading normal that faces away from the ray would see nothing, so it is tilted back to the horizon.
    float facing = dot(normal, d);
    if (facing > -1e-3) normal = normalize(normal - d * (facing + 1e-3));
    s.normal = normal;

    s.base_color = m.base_color;
    s.metallic = m.metallic;
    s.roughness = m.roughness;
    s.emissive = EMISSION != 0u ? m.emissive : vec3(0.0);
    if ((v0.color & v1.color & v2.color) != 0xffffffffu) {
        vec3 c0 = unpackUnorm4x8(v0.color).rgb, c1 = unpackUnorm4x8(v1.color).rgb, c2 = unpackUnorm4x8(v2.color).rgb;
        vec3 tint = c0 * c0 * b.x + c1 * c1 * b.y + c2 * c2 * b.z;
        s.base_color *= tint;
        if ((m.flags & 2u) != 0u) s.emissive *= tint;
    }
    float specular = m.specular;
    vec3 specular_color = m.specular_color;
    if (TEXTURES != 0u) {
        if (m.base_color_texture != NONE) s.base_color *= texture_sample(m.base_color_texture, uv, footprint).rgb;
        if (m.metallic_roughness_texture != NONE) {
            vec4 c = texture_sample(m.metallic_roughness_texture, uv, footprint);
            s.roughness *= c.g;
            s.metallic *= c.b;
        }
        if (EMISSION != 0u && m.emissive_texture != NONE) s.emissive *= texture_sample(m.emissive_texture, uv, footprint).rgb;
        if (m.specular_texture != NONE) specular *= texture_sample(m.specular_texture, uv, footprint).a;
        if (m.specular_color_texture != NONE) specular_color *= texture_sample(m.specular_color_texture, uv, footprint).rgb;
    }
    float f = (m.ior - 1.0) / (m.ior + 1.0);
    s.f0 = mix(min(f * f * specular_color, vec3(1.0)) * specular, s.base_color, s.metallic);
    s.f90 = mix(specular, 1.0, s.metallic);
    return s;
}

// Returns where rays leave a virtual surface: a few ulp of its coordinates and 0.1 mm off it.
vec3 surface_origin(Surface s) {
    return s.position + s.geometric * max(1e-4, 4e-6 * max(abs(s.position.x), max(abs(s.position.y), abs(s.position.z))));
}
