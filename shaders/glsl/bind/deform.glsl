// What the pass deform reads and writes besides the scene's tables (passes/deform.rs). Vertices, triangles and nodes are
// counted from the first that changes its shape.

// A vertex in the mesh's own space, before anything moves it. The next vertex's first influence and delta end its own.
struct RestVertex {
    vec3 position;
    uint first_influence;
    vec3 normal;
    uint first_delta;
    vec3 tangent; // 0: none that a skin turns
    uint faceted; // 1: its normal is its triangle's
};
// A joint that moves a vertex, and its share in that.
struct Influence { uint joint; float weight; };
// What a morph target adds to a vertex at weight 1.
struct Delta { uint target; vec3 position; vec3 normal; };
// What does not change in a node: its leaf, and the node behind all that is within (`BvhNode` in scene/packed.rs).
struct Link { uint leaf; uint next; };

layout(set = 0, binding = 92, scalar) readonly buffer RestVertices { RestVertex vertex[]; } in_rest_vertices;
layout(set = 0, binding = 93, scalar) readonly buffer Influences { Influence entry[]; } in_influences;
layout(set = 0, binding = 94, scalar) readonly buffer Deltas { Delta entry[]; } in_deltas;
// Three rows for each joint's matrix from the mesh's space to the model's. The first joint moves nothing.
layout(set = 0, binding = 95, scalar) readonly buffer Joints { vec4 row[]; } in_joints;
layout(set = 0, binding = 96, scalar) readonly buffer Weights { float weight[]; } in_weights; // of morph targets
layout(set = 0, binding = 97, scalar) readonly buffer PosedRead { vec3 position[]; } in_posed;
layout(set = 0, binding = 98, scalar) writeonly buffer PosedWritten { vec3 position[]; } out_posed;
layout(set = 0, binding = 99, scalar) buffer VerticesWritten { Vertex vertex[]; } vertices;
layout(set = 0, binding = 100, rgba32ui) uniform uimage2D triangles;
layout(set = 0, binding = 101, rgba32ui) uniform writeonly uimage2D out_previous_triangles;
layout(set = 0, binding = 102, rgba32ui) uniform uimage2D nodes;
layout(set = 0, binding = 103, scalar) readonly buffer Links { Link node[]; } in_links;
// The nodes, all leaves first, and each inner node behind those within.
layout(set = 0, binding = 104, scalar) readonly buffer Order { uint node[]; } in_order;
// Three corners of each triangle, for ray queries.
layout(set = 0, binding = 105, scalar) writeonly buffer Corners { vec3 corner[]; } out_corners;

// The items of one dispatch, and where the meshes that change their shape begin in the scene's tables.
layout(push_constant, scalar) uniform Push { uint first; uint count; uint first_triangle; uint first_vertex; uint first_node; } push;

const uint ROW = 65536u; // items in a row of workgroups: more rows than one are for more than a device takes of them

// Returns the number of this thread's item, or `count` or more if it has none.
uint own_item() { return gl_GlobalInvocationID.y * ROW + gl_GlobalInvocationID.x; }
