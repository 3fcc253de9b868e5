#version 460
#extension GL_GOOGLE_include_directive : require
// Per frame, deform (second dispatch): the triangles between posed vertices, one a thread. What they were is kept as the
// frame before. In: posed. Out: triangles, previous triangles (m, object space), flat normals of vertices.
#include "common.glsl"
#include "bind/scene.glsl"
#include "bind/deform.glsl"
layout(local_size_x = 64) in;

uvec4 texel(vec3 v, uint w) { return uvec4(floatBitsToUint(v), w); }

void main() {
    uint item = own_item();
    if (item >= push.count) return;
    TriangleShading corners = in_shading.triangle[push.first_triangle + item];
    vec3 v0 = in_posed.position[corners.v0 - push.first_vertex];
    vec3 e1 = in_posed.position[corners.v1 - push.first_vertex] - v0, e2 = in_posed.position[corners.v2 - push.first_vertex] - v0;
    uint at = (push.first_triangle + item) * 3u;
    uvec4 before = imageLoad(triangles, table_texel(at));
    imageStore(out_previous_triangles, table_texel(item * 3u), before);
    imageStore(out_previous_triangles, table_texel(item * 3u + 1u), imageLoad(triangles, table_texel(at + 1u)));
    imageStore(out_previous_triangles, table_texel(item * 3u + 2u), imageLoad(triangles, table_texel(at + 2u)));
    imageStore(triangles, table_texel(at), texel(v0, before.w));
    imageStore(triangles, table_texel(at + 1u), texel(e1, 0u));
    imageStore(triangles, table_texel(at + 2u), texel(e2, 0u));
    if (in_rest_vertices.vertex[corners.v0 - push.first_vertex].faceted != 0u) {
        vec3 across = cross(e1, e2);
        float size = length(across);
        vec3 normal = size > 0.0 ? across / size : vec3(0.0, 1.0, 0.0);
        vertices.vertex[corners.v0].normal = normal;
        vertices.vertex[corners.v1].normal = normal;
        vertices.vertex[corners.v2].normal = normal;
    }
}
