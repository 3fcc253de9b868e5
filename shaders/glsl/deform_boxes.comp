#version 460
#extension GL_GOOGLE_include_directive : require
// Per frame, deform (last dispatches, one for each height above the leaves): fits the boxes of the bottom levels around
// posed triangles, one node a thread. Which node is in which stays.
// In: triangles (m, object space), links, the boxes of the nodes within. Out: nodes.
#include "common.glsl"
#include "bind/scene.glsl"
#include "bind/deform.glsl"
layout(local_size_x = 64) in;

void around(uint node, inout vec3 least, inout vec3 greatest) {
    least = min(least, uintBitsToFloat(imageLoad(nodes, table_texel(node * 2u)).xyz));
    greatest = max(greatest, uintBitsToFloat(imageLoad(nodes, table_texel(node * 2u + 1u)).xyz));
}

void main() {
    uint item = own_item();
    if (item >= push.count) return;
    uint index = in_order.node[push.first + item], node = push.first_node + index;
    Link link = in_links.node[index];
    vec3 least = vec3(FAR), greatest = vec3(-FAR);
    if (link.leaf == 0u) {
        around(node + 1u, least, greatest);
        around(in_links.node[index + 1u].next, least, greatest);
    } else {
        uint first = link.leaf >> 3u, end = first + (link.leaf & 7u);
        for (uint k = first; k < end; k++) {
            vec3 v0 = uintBitsToFloat(imageLoad(in_triangles, table_texel(k * 3u)).xyz);
            vec3 v1 = v0 + uintBitsToFloat(imageLoad(in_triangles, table_texel(k * 3u + 1u)).xyz);
            vec3 v2 = v0 + uintBitsToFloat(imageLoad(in_triangles, table_texel(k * 3u + 2u)).xyz);
            least = min(least, min(v0, min(v1, v2)));
            greatest = max(greatest, max(v0, max(v1, v2)));
        }
        // more than single precision loses on coordinates of this size (`Bounds::padded`)
        vec3 size = max(abs(least), abs(greatest));
        float margin = max(size.x, max(size.y, size.z)) * 4.8e-7;
        least -= margin;
        greatest += margin;
    }
    imageStore(nodes, table_texel(node * 2u), uvec4(floatBitsToUint(least), link.leaf));
    imageStore(nodes, table_texel(node * 2u + 1u), uvec4(floatBitsToUint(greatest), link.next));
}
