// Measures how wide the thing is that ends at a texel (edges.glsl), on the depth as captured.

const float WIDE = 1.4; // metres: what is wider is as deep as that

// Walks from a texel over the thing that it is of, and returns where that ends, `steps` ways away. It passes behind
// what stands before it. It may end once it is `most` away.
vec3 edge_walk(ivec2 p, vec2 way, vec3 start, float depth, float most, out int steps) {
    ivec2 size = ivec2(in_view.view.depth_size);
    vec3 last = start;
    int at = 0, before = 0;
    for (int n = 0; n < 40 && 4 * at < size.x; n++) {
        at += max(1, at / 8);
        ivec2 q = p + ivec2(round(way * float(at)));
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
    steps = before;
    return last;
}

// Returns the class of a texel with this depth, 0 where there is no edge.
uint edge_class_at(ivec2 p, float depth) {
    ivec2 size = ivec2(in_view.view.depth_size);
    float beyond = depth * (1.0 + in_view.view.edge_ratio), spread = 0.0, around[25];
    vec2 outward = vec2(0.0);
    bool skirts = false, ends = false;
    [[unroll]] for (int k = 0; k < 25; k++) {
        ivec2 q = clamp(p + ivec2(k % 5, k / 5) - 2, ivec2(-2, -1), size + ivec2(1, 0));
        q.x += q.x < 0 ? size.x : q.x >= size.x ? -size.x : 0;
        around[k] = vertex_depth(q.x, q.y);
    }
    [[unroll]] for (int k = 0; k < 25; k++) {
        vec2 offset = vec2(k % 5, k / 5) - 2.0;
        bool beside = max(abs(offset.x), abs(offset.y)) < 2.0, far = around[k] > beyond;
        skirts = skirts || far && beside;
        // A plane that is seen at a grazing angle goes on in equal steps of 1/depth, and has no edge there.
        float opposite = around[24 - k], onward = 2.0 / depth - 1.0 / (opposite > 0.0 ? opposite : depth);
        far = far && 1.0 / around[k] < 0.8 * onward;
        outward += far ? offset : vec2(0.0);
        spread += far ? length(offset) : 0.0;
        ends = ends || far && beside;
    }
    if (depth <= 0.0 || !skirts) return 0u;
    if (!ends) return EDGE_ON_PLANE;
    vec3 start = vertex_direction(p.x, p.y) * depth;
    float width = WIDE;
    int steps;
    if (length(outward) > 0.25 * spread) {
        // Straight in from its edge, to the middle. What is a few texels wide ends on both sides, and has no other.
        vec2 way = normalize(-outward);
        edge_walk(p, way, start, depth, width, steps);
        ivec2 middle = p + ivec2(round(way * float(steps / 2)));
        middle.x += middle.x < 0 ? size.x : middle.x >= size.x ? -size.x : 0;
        float there = vertex_depth(middle.x, middle.y);
        if (there > 0.0) {
            p = middle;
            depth = there;
            start = vertex_direction(p.x, p.y) * depth;
        }
    }
    for (int k = 0; k < 4; k++) {
        vec2 way = k == 0 ? vec2(1.0, 0.0) : k == 1 ? vec2(0.0, 1.0) : k == 2 ? vec2(1.0, 1.0) : vec2(1.0, -1.0);
        vec3 a = edge_walk(p, way, start, depth, width, steps), b = edge_walk(p, -way, start, depth, width, steps);
        // The texels at both ends are the thing's to half their width.
        width = min(width, distance(a, b) + depth * PI / float(size.y));
    }
    return edge_class(min(width, 0.1 + 0.25 * width));
}
