// The virtual objects (passes/scene.rs). Structs are as in scene/packed.rs, in scalar layout.

const uint NONE = 0xffffffffu; // no instance, no texture

struct TriangleShading { uint v0; uint v1; uint v2; uint material; };
struct Vertex { vec3 normal; vec2 uv; vec4 tangent; uint color; vec2 uv2; };
struct Instance { vec4 object_to_world[3]; vec4 world_to_object[3]; vec4 previous_object_to_world[3]; uint root; uint id; uint previous; float step; uint first_material; };
struct Mover { vec3 now; float radius; vec3 before; float step; uint id; float glow; };
// The textures of a material (`Slot` in scene/material.rs).
const uint SLOTS = 15u;
const uint SLOT_BASE_COLOR = 0u;
const uint SLOT_METALLIC_ROUGHNESS = 1u;
const uint SLOT_NORMAL = 2u;
const uint SLOT_EMISSIVE = 3u;
const uint SLOT_SPECULAR = 4u;
const uint SLOT_SPECULAR_COLOR = 5u;
const uint SLOT_TRANSMISSION = 6u;
const uint SLOT_CLEARCOAT = 7u;
const uint SLOT_CLEARCOAT_ROUGHNESS = 8u;
const uint SLOT_CLEARCOAT_NORMAL = 9u;
const uint SLOT_SHEEN_COLOR = 10u;
const uint SLOT_SHEEN_ROUGHNESS = 11u;
const uint SLOT_ANISOTROPY = 12u;
const uint SLOT_IRIDESCENCE = 13u;
const uint SLOT_IRIDESCENCE_THICKNESS = 14u;
// Bits of a material's flags.
const uint ONE_SIDED = 1u, UNLIT = 2u, MASKED = 4u, BLENDED = 8u, SOLID = 16u;
struct Material {
    vec3 base_color; float metallic;
    vec3 emissive; float roughness;
    vec3 specular_color; float specular;
    float ior; float normal_scale;
    uint flags;
    float alpha; float alpha_cutoff;
    float transmission;
    vec3 extinction; float dispersion;
    float clearcoat; float clearcoat_roughness; float clearcoat_normal_scale;
    vec3 sheen_color; float sheen_roughness;
    float anisotropy;
    vec2 anisotropy_direction;
    float iridescence; float iridescence_ior; vec2 iridescence_thickness;
    uint textures[SLOTS];
};
struct Texture { uint offset; uint width; uint height; uint levels; uint wrap_u; uint wrap_v; uint srgb; uint nearest; uint set; vec3 transform[2]; };

// Tables of four words an item (table_texel). A triangle is three: v0 and, if its material is ONE_SIDED, 1; e1; e2.
layout(set = 0, binding = 20, rgba32ui) uniform readonly uimage2D in_triangles;
layout(set = 0, binding = 21, scalar) readonly buffer Shading { TriangleShading triangle[]; } in_shading;
layout(set = 0, binding = 22, scalar) readonly buffer Vertices { Vertex vertex[]; } in_vertices;
// A node is two: least corner and leaf, greatest corner and next (`BvhNode` in scene/packed.rs).
layout(set = 0, binding = 23, rgba32ui) uniform readonly uimage2D in_nodes;
layout(set = 0, binding = 24, scalar) readonly buffer Instances { Instance instance[]; } in_instances;
// What has moved since the last frame.
layout(set = 0, binding = 81, scalar) readonly buffer Movers { Mover mover[]; } in_movers;
layout(set = 0, binding = 25, rgba32ui) uniform readonly uimage2D in_top_nodes;
// Triangles that change their shape, as they were a frame ago; in_triangles has the first of them at the instance's
// `previous`.
layout(set = 0, binding = 82, rgba32ui) uniform readonly uimage2D in_previous_triangles;
// An instance is four: the rows of world_to_object, and the root of its bottom level.
layout(set = 0, binding = 19, rgba32ui) uniform readonly uimage2D in_places;
#ifdef RAY_QUERY
// All instances, in the order of in_instances, for ray queries (passes/acceleration.rs).
layout(set = 0, binding = 91) uniform accelerationStructureEXT in_acceleration;
#endif
layout(set = 0, binding = 26, scalar) readonly buffer Materials { Material material[]; } in_materials;
layout(set = 0, binding = 27, scalar) readonly buffer Textures { Texture entry[]; } in_textures;
layout(set = 0, binding = 28, scalar) readonly buffer Texels { uint texel[]; } in_texels;
// The triangles that shine: one is drawn in proportion to area * luminance; `below` is the probability of all before it.
struct Emitter { uint instance; uint triangle; float below; uint padding; };
layout(set = 0, binding = 83, scalar) readonly buffer Emitters {
    uint count;
    float inverse_power; // 1 / Σ area · luminance
    vec3 center;         // of that power, and how far on average it is from there
    float radius;
    float surroundings;  // irradiance of the panorama on average
    Emitter entry[];
} in_emitters;
// Directional albedo of GGX, ρ = F0·x + F90·y, 32×32 over (cos θ_o, roughness) from 0 to 1 (`ggx_table` in
// passes/bsdf.rs). Then as many of the sheen lobe's, in x, over (cos, sheen roughness).
layout(set = 0, binding = 29, scalar) readonly buffer Energy { vec2 value[]; } in_energy;
