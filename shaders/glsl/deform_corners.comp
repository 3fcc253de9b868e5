#version 460
#extension GL_GOOGLE_include_directive : require
// Per frame, deform (last dispatch, where rays meet objects by ray queries): the corners of which the pass acceleration
// builds, one triangle a thread. In: posed. Out: corners (m, object space).
#include "common.glsl"
#include "bind/scene.glsl"
#include "bind/deform.glsl"
layout(local_size_x = 64) in;

void main() {
    uint item = own_item();
    if (item >= push.count) return;
    TriangleShading corners = in_shading.triangle[push.first_triangle + item];
    out_corners.corner[item * 3u] = in_posed.position[corners.v0 - push.first_vertex];
    out_corners.corner[item * 3u + 1u] = in_posed.position[corners.v1 - push.first_vertex];
    out_corners.corner[item * 3u + 2u] = in_posed.position[corners.v2 - push.first_vertex];
}
