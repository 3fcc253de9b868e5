// The virtual objects: how rays meet them (by a two-level BVH, or by ray queries), materials, textures.


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
    float shines; // luminance of what its material emits, without texture
    vec3 f0; // Fresnel reflectance at normal incidence and at grazing
    float f90;
    // Each of these is valid if its part is on.
    float alpha;
    float transmission;
    bool solid;      // it bounds a solid of `eta` and `extinction`
    bool inside;     // the ray came from behind
    float eta;       // index of refraction before the surface, relative to that behind it
    vec3 extinction; // 1/m
    float dispersion; // of the index of refraction between the colours' ends, as a share of it less 1
    float clearcoat;
    float clearcoat_roughness;
    vec3 clearcoat_normal;
    vec3 sheen_color;
    float sheen_roughness;
    vec3 tangent;     // the rougher direction
    float anisotropy;
};

vec3 transform_point(vec4 rows[3], vec3 p) { return vec3(dot(rows[0], vec4(p, 1.0)), dot(rows[1], vec4(p, 1.0)), dot(rows[2], vec4(p, 1.0))); }
vec3 transform_direction(vec4 rows[3], vec3 d) { return vec3(dot(rows[0].xyz, d), dot(rows[1].xyz, d), dot(rows[2].xyz, d)); }
// Transforms by the transpose of the inverse, whose rows are given.
vec3 transform_normal(vec4 inverse_rows[3], vec3 n) { return inverse_rows[0].xyz * n.x + inverse_rows[1].xyz * n.y + inverse_rows[2].xyz * n.z; }

vec3 safe_inverse(vec3 d) {
    return vec3(abs(d.x) > 1e-20 ? 1.0 / d.x : 1e20, abs(d.y) > 1e-20 ? 1.0 / d.y : 1e20, abs(d.z) > 1e-20 ? 1.0 / d.z : 1e20);
}

struct TriangleGeometry { vec3 v0; vec3 e1; vec3 e2; bool one_sided; };

TriangleGeometry triangle_of(uvec4 v0, uvec4 e1, uvec4 e2) {
    return TriangleGeometry(uintBitsToFloat(v0.xyz), uintBitsToFloat(e1.xyz), uintBitsToFloat(e2.xyz), v0.w != 0u);
}

TriangleGeometry triangle_geometry(uint triangle) {
    return triangle_of(imageLoad(in_triangles, table_texel(triangle * 3u)), imageLoad(in_triangles, table_texel(triangle * 3u + 1u)),
        imageLoad(in_triangles, table_texel(triangle * 3u + 2u)));
}

#ifdef RAY_QUERY // virtual_tracer = ray_query

SceneHit scene_find(vec3 origin, vec3 d, float t_min, float t_max) {
    SceneHit hit = SceneHit(FAR, NONE, NONE, vec2(0.0));
    // Devices differ in whether what is at t_min itself is met.
    float after = t_min * 1.000001;
    if (!(after < t_max)) return hit;
    rayQueryEXT query;
    rayQueryInitializeEXT(query, in_acceleration, gl_RayFlagsOpaqueEXT, 0xffu, origin, after, d, t_max);
    while (rayQueryProceedEXT(query)) {}
    if (rayQueryGetIntersectionTypeEXT(query, true) == gl_RayQueryCommittedIntersectionTriangleEXT) {
        hit.t = rayQueryGetIntersectionTEXT(query, true);
        hit.instance = rayQueryGetIntersectionInstanceIdEXT(query, true);
        // An instance's own index is the first triangle of its mesh.
        hit.triangle = rayQueryGetIntersectionInstanceCustomIndexEXT(query, true) + rayQueryGetIntersectionPrimitiveIndexEXT(query, true);
        hit.barycentric = rayQueryGetIntersectionBarycentricsEXT(query, true);
    }
    return hit;
}

const uint MOST_BACKS = 64u; // that the camera passes, along a ray

SceneHit scene_find(vec3 origin, vec3 d, float t_min, float t_max, bool from_camera) {
    SceneHit hit = scene_find(origin, d, t_min, t_max);
    if (!from_camera) return hit;
    // Facing is a triangle's own matter, as materials are. A query knows it of whole instances alone.
    for (uint back = 0u; back < MOST_BACKS && hit.instance != NONE; back++) {
        TriangleGeometry tri = triangle_geometry(hit.triangle);
        vec3 normal = transform_normal(in_instances.instance[hit.instance].world_to_object, cross(tri.e1, tri.e2));
        if (!tri.one_sided || dot(normal, d) < 0.0) break;
        hit = scene_find(origin, d, hit.t, t_max);
    }
    return hit;
}

// Says whether a ray meets any virtual surface before t_max, be it there or a hole.
bool scene_meets(vec3 origin, vec3 d, float t_max) {
    if (!(t_max > 0.0)) return false;
    rayQueryEXT query;
    rayQueryInitializeEXT(query, in_acceleration, gl_RayFlagsOpaqueEXT | gl_RayFlagsTerminateOnFirstHitEXT, 0xffu, origin, 0.0, d, t_max);
    while (rayQueryProceedEXT(query)) {}
    return rayQueryGetIntersectionTypeEXT(query, true) != gl_RayQueryCommittedIntersectionNoneEXT;
}

#else

bool box_met(uvec4 least, uvec4 greatest, vec3 inverse, vec3 shift, float t_max) {
    vec3 a = uintBitsToFloat(least.xyz) * inverse + shift, b = uintBitsToFloat(greatest.xyz) * inverse + shift;
    vec3 near = min(a, b), far = max(a, b);
    float enter = max(max(near.x, near.y), max(near.z, 0.0)), leave = min(min(far.x, far.y), min(far.z, t_max));
    return enter <= leave * 1.0000004;
}

void scene_triangles(uint leaf, uint instance, vec3 origin, vec3 d, float t_min, bool from_camera, inout SceneHit hit) {
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
        // The winding that the file has in object space says which side is the front, mirrored or not.
        bool culled = from_camera && tri.one_sided && det < 0.0;
        if (!culled && det != 0.0 && u >= 0.0 && v >= 0.0 && u + v <= 1.0 && t > t_min && t < hit.t) hit = SceneHit(t, instance, k, vec2(u, v));
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
void scene_instance(uint index, vec3 world_origin, vec3 world_d, float t_min, bool from_camera, inout SceneHit hit) {
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
        scene_triangles(leaf, index, origin, d, t_min, from_camera, hit);
    }
}

// Says whether a ray meets any virtual surface before t_max, be it there or a hole.
bool scene_meets(vec3 origin, vec3 d, float t_max) {
    SceneHit hit = SceneHit(t_max, NONE, NONE, vec2(0.0));
    vec3 inverse = safe_inverse(d), shift = -origin * inverse;
    uint node = in_view.view.instance_count > 0u ? 0u : NONE, leaf;
    while (hit.instance == NONE) {
        WALK(in_top_nodes, node, inverse, shift, t_max, leaf)
        if (leaf == 0u) break;
        scene_instance(leaf >> 3u, origin, d, 0.0, false, hit);
    }
    return hit.instance != NONE;
}

SceneHit scene_find(vec3 origin, vec3 d, float t_min, float t_max, bool from_camera) {
    SceneHit hit = SceneHit(t_max, NONE, NONE, vec2(0.0));
    vec3 inverse = safe_inverse(d), shift = -origin * inverse;
    uint node = in_view.view.instance_count > 0u ? 0u : NONE, leaf;
    while (true) {
        WALK(in_top_nodes, node, inverse, shift, hit.t, leaf)
        if (leaf == 0u) break;
        scene_instance(leaf >> 3u, origin, d, t_min, from_camera, hit);
    }
    if (hit.instance == NONE) hit.t = FAR;
    return hit;
}

#endif

// Finds the closest virtual surface along a ray in (t_min, t_max), be it there or a hole.
SceneHit scene_closest(vec3 origin, vec3 d, float t_min, float t_max) { return scene_find(origin, d, t_min, t_max, false); }

// Finds the same along a ray from the camera, which sees no backs of what has one side.
SceneHit scene_closest_seen(vec3 origin, vec3 d, float t_min, float t_max) { return scene_find(origin, d, t_min, t_max, true); }

const uint TEXTURES_MOVED = 1u << 31u; // in TEXTURES

// --- textures: RGBA8 in a buffer, trilinear, with several probes along a footprint that is longer than wide ---

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

// Where a hit lies on textures: in the vertices' two sets of coordinates, each with the axes of the ellipse that
// the ray's footprint is there (columns: along the ray, and across it).
struct Texcoords { vec2 uv; mat2 axes; vec2 uv2; mat2 axes2; };

const uint MOST_PROBES = 8u; // along the footprint

// Returns the mean of a texture over a hit's footprint: probes along its longer axis, each trilinear and as wide
// as the shorter one (as anisotropic samplers do). From `cutoff` on, alpha of the finest level is all there. A
// negative one cuts nothing. Coarser levels of masks hold what share is there.
vec4 texture_sample(uint index, Texcoords at, float cutoff) {
    Texture tex = in_textures.entry[index];
    vec2 uv = at.uv;
    mat2 axes = at.axes;
    if ((TEXTURES & TEXTURES_MOVED) != 0u) {
        if (tex.set != 0u) { uv = at.uv2; axes = at.axes2; }
        uv = vec2(dot(tex.transform[0], vec3(uv, 1.0)), dot(tex.transform[1], vec3(uv, 1.0)));
        axes = transpose(mat2(tex.transform[0].xy, tex.transform[1].xy)) * axes;
    }
    if (FAULT == FAULT_TEXTURES_FINEST) axes = mat2(0.0);
    vec2 whole = vec2(tex.width, tex.height);
    float one = length(axes[0] * whole), other = length(axes[1] * whole); // texels
    vec2 line = one > other ? axes[0] : axes[1];
    float wide = max(1.0, min(one, other)), far = max(one, other);
    uint probes = uint(clamp(ceil(far / wide), 1.0, float(MOST_PROBES)));
    float level = min(log2(max(1.0, far / float(probes))), float(tex.levels - 1u));
    uint l = uint(level);
    float between = level - float(l);
    uint offset = tex.offset;
    for (uint k = 0u; k < l; k++) offset += max(1u, tex.width >> k) * max(1u, tex.height >> k);
    // A level that has no weight is not read.
    uint levels = between > 0.0 ? 2u : 1u;
    vec4 sum = vec4(0.0);
    for (uint k = 0u; k < probes * levels; k++) {
        bool coarser = k >= probes;
        uint probe = coarser ? k - probes : k, of = coarser ? l + 1u : l;
        ivec2 size = ivec2(max(1u, tex.width >> of), max(1u, tex.height >> of));
        vec2 q = uv + line * ((float(probe) + 0.5) / float(probes) - 0.5);
        // uv far from the origin lose their fraction, so they are wrapped first.
        q = vec2(tex.wrap_u == 0u ? fract(q.x) : q.x, tex.wrap_v == 0u ? fract(q.y) : q.y);
        q = clamp(q, vec2(-1e4), vec2(1e4)) * vec2(size) - 0.5;
        ivec2 i = ivec2(floor(q));
        vec2 f = q - vec2(i);
        if (tex.nearest != 0u && of == 0u) f = floor(f + 0.5);
        uint first = coarser ? offset + max(1u, tex.width >> l) * max(1u, tex.height >> l) : offset;
        vec4 a = mix(texture_texel(tex, first, size, i), texture_texel(tex, first, size, i + ivec2(1, 0)), f.x);
        vec4 b = mix(texture_texel(tex, first, size, i + ivec2(0, 1)), texture_texel(tex, first, size, i + ivec2(1, 1)), f.x);
        vec4 texel = mix(a, b, f.y);
        if (cutoff >= 0.0 && of == 0u) texel.a = float(texel.a >= cutoff);
        sum += (coarser ? between : 1.0 - between) * texel;
    }
    return sum / float(probes);
}

// Says whether material m has a texture in a slot, and reads it.
#define TEXTURED(slot) ((TEXTURES & (1u << slot)) != 0u && m.textures[slot] != NONE)
#define TEXEL(slot) texture_sample(m.textures[slot], at, -1.0)

// Returns the material of a hit.
Material hit_material(SceneHit hit) {
    return in_materials.material[in_instances.instance[hit.instance].first_material + in_shading.triangle[hit.triangle].material];
}

// Returns where a hit is.
vec3 scene_point(SceneHit hit) {
    TriangleGeometry tri = triangle_geometry(hit.triangle);
    return transform_point(in_instances.instance[hit.instance].object_to_world, tri.v0 + tri.e1 * hit.barycentric.x + tri.e2 * hit.barycentric.y);
}

// Returns the ellipse that a ray along d, `width` metres wide, covers on a triangle: its axes along the ray and across
// it, as shares of the triangle's edges.
mat2 footprint(TriangleGeometry tri, vec4 object_to_world[3], vec3 geometric, vec3 d, float width) {
    vec3 w1 = transform_direction(object_to_world, tri.e1), w2 = transform_direction(object_to_world, tri.e2);
    vec3 n = cross(w1, w2);
    float facing = abs(dot(geometric, d));
    vec3 across = cross(geometric, d);
    across = facing < 0.9999 ? normalize(across) : basis(geometric)[0];
    vec3 along = cross(across, geometric) * (width / max(facing, 1e-2));
    across *= width;
    float scale = 1.0 / max(dot(n, n), 1e-30);
    return scale * mat2(dot(cross(along, w2), n), dot(cross(w1, along), n), dot(cross(across, w2), n), dot(cross(w1, across), n));
}

// Returns how much of a surface is there at a hit, from 0 to 1, of what a ray along d, `width` metres wide, covers.
float hit_alpha(SceneHit hit, vec3 d, float width) {
    Material m = hit_material(hit);
    if ((m.flags & (MASKED | BLENDED)) == 0u) return 1.0;
    TriangleShading shading = in_shading.triangle[hit.triangle];
    Vertex v0 = in_vertices.vertex[shading.v0], v1 = in_vertices.vertex[shading.v1], v2 = in_vertices.vertex[shading.v2];
    vec3 b = vec3(1.0 - hit.barycentric.x - hit.barycentric.y, hit.barycentric);
    bool masked = (m.flags & MASKED) != 0u;
    float alpha = m.alpha * dot(vec3(v0.color >> 24u, v1.color >> 24u, v2.color >> 24u), b) / 255.0;
    if (!TEXTURED(SLOT_BASE_COLOR)) return masked ? float(alpha >= m.alpha_cutoff) : clamp(alpha, 0.0, 1.0);
    Texcoords at = Texcoords(v0.uv * b.x + v1.uv * b.y + v2.uv * b.z, mat2(0.0), v0.uv2 * b.x + v1.uv2 * b.y + v2.uv2 * b.z, mat2(0.0));
    if (width > 0.0) {
        TriangleGeometry tri = triangle_geometry(hit.triangle);
        Instance instance = in_instances.instance[hit.instance];
        vec3 geometric = normalize(transform_normal(instance.world_to_object, cross(tri.e1, tri.e2)));
        mat2 edges = footprint(tri, instance.object_to_world, geometric, d, width);
        at.axes = mat2(v1.uv - v0.uv, v2.uv - v0.uv) * edges;
        at.axes2 = mat2(v1.uv2 - v0.uv2, v2.uv2 - v0.uv2) * edges;
    }
    float sampled = texture_sample(m.textures[SLOT_BASE_COLOR], at, masked ? m.alpha_cutoff / max(alpha, 1e-6) : -1.0).a;
    return clamp(masked ? sampled : alpha * sampled, 0.0, 1.0);
}

const uint MOST_LAYERS = 64u; // that are not there, along a ray

// Finds the closest virtual surface that is there along a ray before t_max. What is there in part is there at
// random, that often. A ray from the camera passes the backs of what has one side.
SceneHit scene_trace_from(vec3 origin, vec3 d, float t_max, bool from_camera) {
    if (ALPHA == 0u) return scene_find(origin, d, 0.0, t_max, from_camera);
    SceneHit hit;
    float t_min = 0.0;
    for (uint layer = 0u; layer < MOST_LAYERS; layer++) {
        hit = scene_find(origin, d, t_min, t_max, from_camera);
        if (hit.instance == NONE) break;
        uint at = hash(floatBitsToUint(hit.barycentric.x) + hash(floatBitsToUint(hit.barycentric.y) + hit.triangle));
        Random random = random_begin(uvec2(at, floatBitsToUint(hit.t)), 3u);
        if (random_next(random) < hit_alpha(hit, d, 0.0)) break;
        t_min = hit.t;
        hit.instance = NONE;
    }
    if (hit.instance == NONE) hit.t = FAR;
    return hit;
}

// The same of a ray from a surface.
SceneHit scene_trace(vec3 origin, vec3 d, float t_max) { return scene_trace_from(origin, d, t_max, false); }

// Returns how the eye sees light that interferes with itself after a path of so many nanometres, linear RGB.
vec3 film_sensitivity(float path, vec3 shift) {
    float phase = 2.0 * PI * path * 1e-9;
    const vec3 SIZE = vec3(5.4856e-13, 4.4201e-13, 5.2481e-13), PLACE = vec3(1.6810e+06, 1.7953e+06, 2.2084e+06), SPREAD = vec3(4.3278e+09, 9.3046e+09, 6.6121e+09);
    vec3 xyz = SIZE * sqrt(2.0 * PI * SPREAD) * cos(PLACE * phase + shift) * exp(-phase * phase * SPREAD);
    xyz.x += 9.7470e-14 * sqrt(2.0 * PI * 4.5282e+09) * cos(2.2399e+06 * phase + shift.x) * exp(-4.5282e+09 * phase * phase);
    xyz /= 1.0685e-7;
    return mat3(vec3(3.2404542, -0.9692660, 0.0556434), vec3(-1.5371385, 1.8760108, -0.2040259), vec3(-0.4985314, 0.0415560, 1.0572252)) * xyz;
}

// Returns the reflectance, at a cosine, of a thin film of an index of refraction and a thickness in nanometres
// (Belcour and Barla 2017, "A Practical Extension to Microfacet Theory for the Modeling of Varying Iridescence").
// `f0` is that of what is below it.
vec3 film_reflectance(float cosine, float film_ior, float thickness, vec3 f0) {
    // The film goes over to nothing where it is much thinner than light's waves.
    float ior = mix(1.0, film_ior, smoothstep(0.0, 0.03, thickness));
    float sine2 = (1.0 - cosine * cosine) / (ior * ior);
    if (sine2 >= 1.0) return vec3(1.0);
    float within = sqrt(1.0 - sine2);
    float r = (ior - 1.0) / (ior + 1.0), x = 1.0 - cosine, y = 1.0 - within;
    float r0 = r * r;
    float first = r0 + (1.0 - r0) * x * x * x * x * x, passed = 1.0 - first;
    vec3 root = sqrt(clamp(f0, vec3(0.0), vec3(0.9999))), base_ior = (1.0 + root) / (1.0 - root);
    vec3 q = (base_ior - ior) / (base_ior + ior), q0 = q * q;
    vec3 second = q0 + (1.0 - q0) * (y * y * y * y * y);
    float path = 2.0 * ior * thickness * within;
    vec3 shift = mix(vec3(PI), vec3(2.0 * PI), lessThan(base_ior, vec3(ior)));
    vec3 both = clamp(first * second, 1e-5, 0.9999), r123 = sqrt(both), rs = passed * passed * second / (1.0 - both);
    vec3 sum = vec3(first) + rs, c = rs - passed;
    for (int m = 1; m <= 2; m++) {
        c *= r123;
        sum += 2.0 * c * film_sensitivity(float(m) * path, float(m) * shift);
    }
    return max(sum, vec3(0.0));
}

// Returns a normal of a normal map, as a unit tangent, its bitangent's sign and the vertices' normal have it.
vec3 mapped_normal(vec3 texel, float scale, vec3 tangent, float bitangent, vec3 normal) {
    vec3 n = texel * 2.0 - 1.0;
    n = vec3(n.xy * scale, max(n.z, 1e-3));
    return normalize(tangent * n.x + cross(normal, tangent) * (bitangent < 0.0 ? -n.y : n.y) + normal * n.z);
}

// Tilts a normal that faces away from the ray, and so would see nothing, back to the horizon. One that would mirror the
// ray below the surface is tilted until the mirrored ray leaves it (as in Keller et al. 2017, The Iray light transport
// simulation and rendering system, A.3).
vec3 facing_normal(vec3 normal, vec3 geometric, vec3 d) {
    float facing = dot(normal, d);
    if (facing > -1e-3) normal = normalize(normal - d * (facing + 1e-3));
    vec3 mirrored = reflect(d, normal);
    float least = min(-0.9 * dot(geometric, d), 0.01), above = dot(mirrored, geometric);
    return above < least ? normalize(normalize(mirrored + geometric * (least - above)) - d) : normal;
}

// Returns the surface at a hit. `d` is the ray's direction, and `width` the width of its footprint there in
// metres.
Surface scene_surface(SceneHit hit, vec3 d, float width) {
    Instance instance = in_instances.instance[hit.instance];
    TriangleGeometry tri = triangle_geometry(hit.triangle);
    TriangleShading shading = in_shading.triangle[hit.triangle];
    Vertex v0 = in_vertices.vertex[shading.v0], v1 = in_vertices.vertex[shading.v1], v2 = in_vertices.vertex[shading.v2];
    Material m = in_materials.material[instance.first_material + shading.material];
    vec3 b = vec3(1.0 - hit.barycentric.x - hit.barycentric.y, hit.barycentric);

    Surface s;
    s.position = transform_point(instance.object_to_world, tri.v0 + tri.e1 * hit.barycentric.x + tri.e2 * hit.barycentric.y);
    s.geometric = normalize(transform_normal(instance.world_to_object, cross(tri.e1, tri.e2)));
    vec3 normal = transform_normal(instance.world_to_object, v0.normal * b.x + v1.normal * b.y + v2.normal * b.z);
    normal = dot(normal, normal) > 0.0 ? normalize(normal) : s.geometric;
    vec3 smooth_normal = normal;

    Texcoords at;
    at.uv = v0.uv * b.x + v1.uv * b.y + v2.uv * b.z;
    at.uv2 = v0.uv2 * b.x + v1.uv2 * b.y + v2.uv2 * b.z;
    if (TEXTURES != 0u) {
        mat2 edges = footprint(tri, instance.object_to_world, s.geometric, d, width);
        at.axes = mat2(v1.uv - v0.uv, v2.uv - v0.uv) * edges;
        at.axes2 = mat2(v1.uv2 - v0.uv2, v2.uv2 - v0.uv2) * edges;
    }

    vec3 t = vec3(0.0);
    float bitangent = 1.0;
    if ((TEXTURES & (1u << SLOT_NORMAL | 1u << SLOT_CLEARCOAT_NORMAL)) != 0u || ANISOTROPY != 0u) {
        vec4 tangent = v0.tangent * b.x + v1.tangent * b.y + v2.tangent * b.z;
        t = transform_direction(instance.object_to_world, tangent.xyz);
        t -= normal * dot(t, normal);
        t = dot(t, t) > 1e-20 ? normalize(t) : vec3(0.0);
        bitangent = tangent.w;
    }
    bool has_tangent = t != vec3(0.0);
    if (TEXTURED(SLOT_NORMAL) && has_tangent) normal = mapped_normal(TEXEL(SLOT_NORMAL).xyz, m.normal_scale, t, bitangent, normal);
    s.inside = dot(s.geometric, d) > 0.0 && FAULT != FAULT_NORMALS_UNTURNED;
    if (s.inside) { s.geometric = -s.geometric; normal = -normal; }
    s.normal = facing_normal(normal, s.geometric, d);

    s.base_color = m.base_color;
    s.metallic = m.metallic;
    s.roughness = m.roughness;
    s.emissive = EMISSION != 0u ? m.emissive : vec3(0.0);
    s.shines = luminance(s.emissive);
    s.alpha = m.alpha;
    if ((v0.color & v1.color & v2.color) != 0xffffffffu) {
        vec3 c0 = unpackUnorm4x8(v0.color).rgb, c1 = unpackUnorm4x8(v1.color).rgb, c2 = unpackUnorm4x8(v2.color).rgb;
        vec3 tint = c0 * c0 * b.x + c1 * c1 * b.y + c2 * c2 * b.z;
        s.base_color *= tint;
        if ((m.flags & UNLIT) != 0u) s.emissive *= tint;
        s.alpha *= dot(vec3(v0.color >> 24u, v1.color >> 24u, v2.color >> 24u), b) / 255.0;
    }
    float specular = m.specular;
    vec3 specular_color = m.specular_color;
    if (TEXTURED(SLOT_BASE_COLOR)) {
        vec4 c = TEXEL(SLOT_BASE_COLOR);
        s.base_color *= c.rgb;
        s.alpha *= c.a;
    }
    if ((m.flags & BLENDED) == 0u) s.alpha = 1.0;
    if (TEXTURED(SLOT_METALLIC_ROUGHNESS)) {
        vec4 c = TEXEL(SLOT_METALLIC_ROUGHNESS);
        s.roughness *= c.g;
        s.metallic *= c.b;
    }
    if (EMISSION != 0u && TEXTURED(SLOT_EMISSIVE)) s.emissive *= TEXEL(SLOT_EMISSIVE).rgb;
    if (TEXTURED(SLOT_SPECULAR)) specular *= TEXEL(SLOT_SPECULAR).a;
    if (TEXTURED(SLOT_SPECULAR_COLOR)) specular_color *= TEXEL(SLOT_SPECULAR_COLOR).rgb;
    float f = (m.ior - 1.0) / (m.ior + 1.0);
    s.f0 = mix(min(f * f * specular_color, vec3(1.0)) * specular, s.base_color, s.metallic);
    s.f90 = mix(specular, 1.0, s.metallic);

    s.transmission = 0.0;
    if (TRANSMISSION != 0u) {
        s.transmission = m.transmission * (1.0 - s.metallic);
        if (TEXTURED(SLOT_TRANSMISSION)) s.transmission *= TEXEL(SLOT_TRANSMISSION).r;
        s.solid = (m.flags & SOLID) != 0u;
        float ior = max(m.ior, 1.0);
        s.eta = s.inside ? ior : 1.0 / ior;
        s.extinction = m.extinction;
        s.dispersion = 0.025 * m.dispersion;
    }
    if (CLEARCOAT != 0u) {
        s.clearcoat = m.clearcoat;
        s.clearcoat_roughness = m.clearcoat_roughness;
        if (TEXTURED(SLOT_CLEARCOAT)) s.clearcoat *= TEXEL(SLOT_CLEARCOAT).r;
        if (TEXTURED(SLOT_CLEARCOAT_ROUGHNESS)) s.clearcoat_roughness *= TEXEL(SLOT_CLEARCOAT_ROUGHNESS).g;
        s.clearcoat_normal = smooth_normal;
        if (TEXTURED(SLOT_CLEARCOAT_NORMAL) && has_tangent)
            s.clearcoat_normal = mapped_normal(TEXEL(SLOT_CLEARCOAT_NORMAL).xyz, m.clearcoat_normal_scale, t, bitangent, smooth_normal);
        if (s.inside) s.clearcoat_normal = -s.clearcoat_normal;
        s.clearcoat_normal = facing_normal(s.clearcoat_normal, s.geometric, d);
    }
    if (SHEEN != 0u) {
        s.sheen_color = m.sheen_color;
        s.sheen_roughness = m.sheen_roughness;
        if (TEXTURED(SLOT_SHEEN_COLOR)) s.sheen_color *= TEXEL(SLOT_SHEEN_COLOR).rgb;
        if (TEXTURED(SLOT_SHEEN_ROUGHNESS)) s.sheen_roughness *= TEXEL(SLOT_SHEEN_ROUGHNESS).a;
    }
    if (ANISOTROPY != 0u) {
        vec2 along = m.anisotropy_direction;
        s.anisotropy = has_tangent ? m.anisotropy : 0.0;
        if (TEXTURED(SLOT_ANISOTROPY)) {
            vec3 c = TEXEL(SLOT_ANISOTROPY).rgb;
            vec2 turn = c.rg * 2.0 - 1.0;
            along = vec2(along.x * turn.x - along.y * turn.y, along.x * turn.y + along.y * turn.x);
            s.anisotropy *= c.b;
        }
        vec3 rough = t * along.x + cross(smooth_normal, t) * (bitangent < 0.0 ? -along.y : along.y);
        rough -= s.normal * dot(rough, s.normal);
        bool known = dot(rough, rough) > 1e-12;
        s.tangent = known ? normalize(rough) : basis(s.normal)[0];
        if (!known) s.anisotropy = 0.0;
    }
    if (IRIDESCENCE != 0u && m.iridescence > 0.0) {
        float amount = m.iridescence, thickness = m.iridescence_thickness.y;
        if (TEXTURED(SLOT_IRIDESCENCE)) amount *= TEXEL(SLOT_IRIDESCENCE).r;
        if (TEXTURED(SLOT_IRIDESCENCE_THICKNESS)) thickness = mix(m.iridescence_thickness.x, thickness, TEXEL(SLOT_IRIDESCENCE_THICKNESS).g);
        float cosine = clamp(-dot(s.normal, d), 1e-3, 1.0), x = 1.0 - cosine, x5 = x * x * x * x * x;
        // As a reflectance at normal incidence, of which Schlick makes the film's at this cosine.
        vec3 film = clamp((film_reflectance(cosine, m.iridescence_ior, thickness, s.f0) - x5) / max(1.0 - x5, 1e-3), vec3(0.0), vec3(1.0));
        s.f0 = mix(s.f0, film, amount);
    }
    return s;
}

// Returns where rays leave a virtual surface: a few ulp of its coordinates and 0.1 mm off it.
vec3 surface_origin(Surface s) {
    return s.position + s.geometric * max(1e-4, 4e-6 * max(abs(s.position.x), max(abs(s.position.y), abs(s.position.z))));
}

// Returns the same for a ray along d, which may go through the surface.
vec3 surface_origin_along(Surface s, vec3 d) {
    if (dot(d, s.geometric) < 0.0) s.geometric = -s.geometric;
    return surface_origin(s);
}
