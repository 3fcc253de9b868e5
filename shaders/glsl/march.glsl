// Marches a ray through the depth image instead of the surface, which is cheap and approximate. The ray's
// picture in the panorama is an arc of a great circle, from the direction of its origin to its own. The march
// looks at `steps` places of it at equal angles. A place is a hit if it lies behind the nearest texel's depth
// by at most `thickness`. Whatever is thinner than a step can be missed. Texels make steps in depth, so a hit
// must be at least MARCH_BIAS behind.

const float MARCH_BIAS = 0.005;    // relative to the depth
const float MARCH_DISTANT = 1e7;   // metres: the end of the arc
const int MARCH_HALVINGS = 6;

// Returns the depth in the direction of a point; 0 in a hole.
float march_depth(vec3 point, out ivec2 texel) {
    ivec2 size = ivec2(in_view.view.depth_size);
    texel = min(ivec2(panorama_uv(point) * vec2(size)), size - 1);
    return vertex_depth(texel.x, texel.y);
}

float march_distance(vec3 origin, float arc, float share) {
    float angle = arc * share;
    return share < 1.0 ? length(origin) * sin(angle) / max(sin(arc - angle), 1e-6) : MARCH_DISTANT;
}

// Returns how far behind the depth a place of the ray is, in metres. It is negative in front of the depth and
// in front of a hole.
float march_behind(vec3 origin, vec3 d, float t) {
    ivec2 texel;
    float depth = march_depth(origin + d * t, texel);
    return depth > 0.0 ? length(origin + d * t) - depth * (1.0 + MARCH_BIAS) : -1.0;
}

// Does what panorama_trace does, but answers only FREE or SURFACE, within the accuracy of depth and steps.
// The origin counts as in front of the depth.
PanoramaHit panorama_march(vec3 origin, vec3 d, uint steps) {
    float arc = arctangent(length(cross(origin, d)), dot(origin, d));
    float before = 0.0, here = 0.0;
    bool front = true;
    uint k = 0u;
    while (true) {
        bool candidate = false;
        while (k < steps && !candidate) {
            k++;
            before = here;
            here = float(k) / float(steps);
            float behind = march_behind(origin, d, march_distance(origin, arc, here));
            candidate = behind > 0.0 && (front || behind < in_view.view.thickness);
            front = behind <= 0.0;
        }
        if (!candidate) return PanoramaHit(FAR, panorama_uv(d), FREE, vec3(0.0));
        float near = before, far = here;
        for (int n = 0; n < MARCH_HALVINGS; n++) {
            float middle = 0.5 * (near + far);
            if (march_behind(origin, d, march_distance(origin, arc, middle)) > 0.0) far = middle; else near = middle;
        }
        // The ray meets the sphere of that texel's depth twice.
        float t = march_distance(origin, arc, far), along = dot(origin, d);
        ivec2 texel;
        for (int n = 0; n < 2; n++) {
            float depth = march_depth(origin + d * t, texel), square = along * along - dot(origin, origin) + depth * depth;
            if (depth > 0.0 && square > 0.0) t = clamp(sqrt(square) - along, march_distance(origin, arc, near), march_distance(origin, arc, far));
        }
        if (march_behind(origin, d, t) < in_view.view.thickness) {
            int j = min(texel.y, int(in_view.view.depth_size.y) - 2);
            vec3 a = vertex_direction(texel.x, j) * vertex_depth(texel.x, j);
            vec3 b = vertex_direction(texel.x, j + 1) * vertex_depth(texel.x, j + 1), c = vertex_direction(texel.x + 1, j) * vertex_depth(texel.x + 1, j);
            return PanoramaHit(t, panorama_uv(origin + d * t), SURFACE, cross(b - a, c - a));
        }
    }
}
