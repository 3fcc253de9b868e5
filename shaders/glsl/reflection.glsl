// Where what a smooth surface reflects was seen a frame ago.

const float SMOOTH = 0.3; // rougher lobes show no picture that could move

// Returns the mean curvature around a hit as its vertices' normals have it, 1/m: 0 flat, positive where it bulges
// towards the viewer.
float curvature(SceneHit on, bool inside) {
    Instance instance = in_instances.instance[on.instance];
    TriangleGeometry tri = triangle_geometry(on.triangle);
    TriangleShading shading = in_shading.triangle[on.triangle];
    vec3 n0 = normalize(transform_normal(instance.world_to_object, in_vertices.vertex[shading.v0].normal));
    vec3 n1 = normalize(transform_normal(instance.world_to_object, in_vertices.vertex[shading.v1].normal));
    vec3 n2 = normalize(transform_normal(instance.world_to_object, in_vertices.vertex[shading.v2].normal));
    vec3 e1 = transform_direction(instance.object_to_world, tri.e1), e2 = transform_direction(instance.object_to_world, tri.e2);
    float bends = 0.5 * (dot(n1 - n0, e1) / max(dot(e1, e1), 1e-12) + dot(n2 - n0, e2) / max(dot(e2, e2), 1e-12));
    return inside ? -bends : bends;
}

// Returns how a point of an object moved since the last frame.
vec3 point_motion(Instance instance, vec3 point) {
    if (OBJECT_MOTION == 0u) return vec3(0.0);
    return transform_point(instance.previous_object_to_world, transform_point(instance.world_to_object, point)) - point;
}

// Returns about how far away the real surface is that is seen from x along d.
float real_distance(vec3 x, vec3 d) {
    float t = 0.0;
    ivec2 texel;
    for (int k = 0; k < 4; k++) {
        vec3 point = x + d * t;
        float far = surface_distance(k == 0 ? d : normalize(point), texel);
        if (far <= 0.0) { t = FAR; break; }
        t = max(t + far - length(point), 0.01);
    }
    return t;
}

// Returns a texel of `reflected` for a surface that the eye sees along `from_eye` in a pixel. `t` is how far from the
// surface that is which it reflects, and `moved` where that was a frame ago, relative to now. The image of it stands as
// far behind a flat mirror. One of curvature c has it at 1/(1/t + 2c), near its axis, and between itself and where a flat
// one would have it in the ratio of the two; so does its motion.
vec4 reflection_motion(vec2 pixel, Surface s, SceneHit on, vec3 from_eye, float t, vec3 moved) {
    const float FARTHEST = 1e4;
    t = min(t, FARTHEST);
    Instance instance = in_instances.instance[on.instance];
    float bends = curvature(on, s.inside);
    float depth = 1.0 / max(1.0 + 2.0 * bends * t, 0.25); // of the image, relative to t
    // A ball turns about its centre without a change of what it shows.
    bool round = abs(bends) > 1e-2;
    vec3 then = point_motion(instance, round ? s.position - s.normal / bends : s.position);
    vec3 normal_then = s.normal;
    if (OBJECT_MOTION != 0u && !round)
        normal_then = normalize(transform_direction(instance.previous_object_to_world, transform_direction(instance.world_to_object, s.normal)));
    vec3 shown = s.position + reflect(from_eye, s.normal) * t, shown_then = shown + moved, at_then = s.position + then;
    vec3 behind = s.position + from_eye * t; // in a flat mirror
    vec3 behind_then = shown_then - 2.0 * dot(shown_then - at_then, normal_then) * normal_then;
    vec3 image_then = s.position + from_eye * (t * depth) + mix(then, behind_then - behind, depth);
    return vec4(motion_of(pixel, image_then, 0.0).xy, t, distance(shown_then, at_then));
}
