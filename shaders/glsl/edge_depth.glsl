// Measures how wide the thing is that ends at a texel (edges.glsl), on the depth as captured.

// Walks from a texel over the thing that it is of, and returns where that ends. It passes behind what stands
// before it. `most` is the distance at which it is a wall's.
vec3 edge_walk(ivec2 p, ivec2 way, vec3 start, float depth, float most) {
    ivec2 size = ivec2(in_view.view.depth_size);
    vec3 last = start;
    int at = 0, before = 0;
    for (int n = 0; n < 40 && 4 * at < size.x; n++) {
        at += max(1, at / 8);
        ivec2 q = p + way * at;
        if (q.y < 0 || q.y >= size.y) break;
        q.x += q.x < 0 ? size.x : q.x >= size.x ? -size.x : 0;
        float d = vertex_depth(q.x, q.y), ratio = 1.0 + in_view.view.edge_ratio * float(min(at - before, 5));
        if (d <= 0.0 || d > depth * ratio) break;
        if (d * ratio < depth) continue;
        depth = d;
        before = at;
        last = vertex_direction(q.x, q.y) * d;
        if (distance(last, start) > most) break;
    }
    return last;
}

// Returns the class of a texel with this depth, 0 where there is no edge.
uint edge_class_at(ivec2 p, float depth) {
    ivec2 size = ivec2(in_view.view.depth_size);
    float farthest = 0.0;
    [[unroll]] for (int k = 0; k < 9; k++) {
        ivec2 q = clamp(p + ivec2(k % 3, k / 3) - 1, ivec2(-1), size);
        q.x += q.x < 0 ? size.x : q.x >= size.x ? -size.x : 0;
        farthest = max(farthest, vertex_depth(q.x, q.y));
    }
    if (depth <= 0.0 || farthest <= depth * (1.0 + in_view.view.edge_ratio)) return 0u;
    vec3 start = vertex_direction(p.x, p.y) * depth;
    float width = FAR;
    for (int k = 0; k < 4; k++) {
        ivec2 way = k == 0 ? ivec2(1, 0) : k == 1 ? ivec2(0, 1) : k == 2 ? ivec2(1, 1) : ivec2(1, -1);
        vec3 a = edge_walk(p, way, start, depth, WALL), b = edge_walk(p, -way, start, depth, WALL);
        // The texels at both ends are the thing's to half their width.
        width = min(width, distance(a, b) + depth * PI / float(size.y));
    }
    return edge_class(width);
}
