#version 460
#extension GL_GOOGLE_include_directive : require
// Per frame, deform (first dispatch): poses vertices, one a thread. With the weights w of morph targets and the matrices
// J of joints (glTF 2.0, "Morph Targets" and "Skins"),
//   p' = M (p + Σ w_t Δp_t),  n' = cof(M) (n + Σ w_t Δn_t) · sign det M,  t' = M t,  M = Σ share_k J_k.
// In: rest vertices, influences, deltas, joints, weights. Out: posed positions (m, object space), and normals and tangents
// (unit length) of vertices.
#include "common.glsl"
#include "bind/scene.glsl"
#include "bind/deform.glsl"
layout(local_size_x = 64) in;

// Returns the unit vector along v, or another vector if it has no direction.
vec3 unit_or(vec3 v, vec3 other) {
    float size = length(v);
    return size > 0.0 ? v / size : other;
}

void main() {
    uint item = own_item();
    if (item >= push.count) return;
    RestVertex rest = in_rest_vertices.vertex[item];
    uint influences_end = in_rest_vertices.vertex[item + 1u].first_influence, deltas_end = in_rest_vertices.vertex[item + 1u].first_delta;
    vec3 position = rest.position, normal = rest.normal;
    for (uint k = rest.first_delta; k < deltas_end; k++) {
        Delta delta = in_deltas.entry[k];
        float weight = in_weights.weight[delta.target];
        position += weight * delta.position;
        normal += weight * delta.normal;
    }
    bool skinned = rest.first_influence < influences_end;
    if (skinned) {
        vec4 rows[3] = vec4[](vec4(0.0), vec4(0.0), vec4(0.0));
        if (FAULT == FAULT_ONE_JOINT) influences_end = rest.first_influence + 1u;
        for (uint k = rest.first_influence; k < influences_end; k++) {
            Influence own = in_influences.entry[k];
            [[unroll]] for (uint row = 0u; row < 3u; row++) rows[row] += own.weight * in_joints.row[own.joint * 3u + row];
        }
        position = vec3(dot(rows[0], vec4(position, 1.0)), dot(rows[1], vec4(position, 1.0)), dot(rows[2], vec4(position, 1.0)));
        mat3 turn = transpose(mat3(rows[0].xyz, rows[1].xyz, rows[2].xyz));
        // The cofactors turn normals as the transposed inverse does, and exist for flat matrices, too.
        vec3 turned = mat3(cross(turn[1], turn[2]), cross(turn[2], turn[0]), cross(turn[0], turn[1])) * normal;
        normal = determinant(turn) < 0.0 ? -turned : turned;
        vertices.vertex[push.first_vertex + item].tangent.xyz = unit_or(turn * rest.tangent, vec3(0.0));
    }
    out_posed.position[item] = position;
    if (rest.faceted == 0u) vertices.vertex[push.first_vertex + item].normal = unit_or(normal, unit_or(rest.normal, vec3(0.0, 1.0, 0.0)));
}
