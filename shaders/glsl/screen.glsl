// Virtual objects as the picture shows them: rays walk its depth (McGuire and Mara 2014, "Efficient GPU
// Screen-Space Ray Tracing"). Perspective pictures are walked by a DDA that interpolates 1/z, equirect ones
// by equal angles along the ray's great circle. Rays do not meet what is off the picture or hidden in it.

// How far from its own pixel a ray starts, in pixels. Closer, it would meet the surface that it leaves.
const float SCREEN_GAP = 1.0;

// Returns the virtual surface in a pixel, if the ray passes it between `near` and `far`. Depths are measured
// along `axis`, the view's axis, or from the camera if `axis` is 0.
bool screen_hit(ivec2 p, float near, float far, vec3 axis, inout SceneHit hit) {
    if (!neighbour(p)) return false;
    uvec4 guide = imageLoad(in_guide, ivec3(p, VIRTUAL));
    if (guide_id(guide) == NO_SURFACE) return false;
    vec3 off = guide_position(guide) - in_view.view.position;
    float depth = axis == vec3(0.0) ? length(off) : dot(off, axis);
    if (far < depth || near > depth + push.screen_thickness) return false;
    uvec4 id = imageLoad(in_hit, p);
    hit = SceneHit(0.0, id.x, id.y, uintBitsToFloat(id.zw));
    return true;
}

SceneHit screen_perspective(vec3 origin, vec3 d, float t_max, float jitter) {
    View v = in_view.view;
    SceneHit hit = SceneHit(FAR, NONE, NONE, vec2(0.0));
    const float NEAR = 1e-3;
    vec3 from = origin - v.position;
    vec3 o = vec3(dot(from, v.right), dot(from, v.up), dot(from, v.forward)), e = vec3(dot(d, v.right), dot(d, v.up), dot(d, v.forward));
    // The part of the ray before the camera.
    float t0 = 0.0, t1 = min(t_max, 1e5);
    if (o.z < NEAR) {
        if (e.z <= 0.0) return hit;
        t0 = (NEAR - o.z) / e.z;
    }
    if (e.z < 0.0) t1 = min(t1, (NEAR - o.z) / e.z);
    if (t0 >= t1) return hit;
    // pixel(t) = (a.xy + t b.xy)/(a.z + t b.z). Pixel, 1/z and t/z are linear along the line in the picture.
    vec2 half_size = 0.5 * vec2(v.size);
    vec3 a = vec3(half_size * (o.z + vec2(o.x, -o.y) / v.tan_half), o.z), b = vec3(half_size * (e.z + vec2(e.x, -e.y) / v.tan_half), e.z);
    vec3 h0 = a + t0 * b, h1 = a + t1 * b;
    vec2 p0 = h0.xy / h0.z, line = h1.xy / h1.z - p0;
    float k0 = 1.0 / h0.z, dk = 1.0 / h1.z - k0, q0 = t0 / h0.z, dq = t1 / h1.z - q0;
    // The part within the picture.
    float s = 0.0, end = 1.0;
    for (int i = 0; i < 2; i++) {
        if (line[i] == 0.0) {
            if (p0[i] < 0.0 || p0[i] >= float(v.size[i])) return hit;
            continue;
        }
        float x = -p0[i] / line[i], y = (float(v.size[i]) - p0[i]) / line[i];
        s = max(s, min(x, y));
        end = min(end, max(x, y));
    }
    float pixels = max(abs(line.x), abs(line.y));
    float ds = push.screen_stride / max(pixels, 1e-3);
    s += SCREEN_GAP / max(pixels, 1e-3) + ds * push.screen_jitter * jitter;
    for (; s < end; s += ds) {
        float z0 = 1.0 / (k0 + dk * max(s - 0.5 * ds, 0.0)), z1 = 1.0 / (k0 + dk * min(s + 0.5 * ds, 1.0));
        if (screen_hit(ivec2(floor(p0 + line * s)), min(z0, z1), max(z0, z1), v.forward, hit)) {
            hit.t = (q0 + dq * s) / (k0 + dk * s);
            return hit;
        }
    }
    return hit;
}

float sine_of(float angle) { return circle(angle / (2.0 * PI)).y; }

SceneHit screen_equirect(vec3 origin, vec3 d, float t_max, float jitter) {
    View v = in_view.view;
    SceneHit hit = SceneHit(FAR, NONE, NONE, vec2(0.0));
    vec3 o = origin - v.position;
    float from = length(o);
    if (from < 1e-5) return hit;
    // The ray's points are seen from the direction of its origin round towards d. At angle x the distance is
    // |o| sin Ω / sin(Ω − x).
    vec3 start = o / from, across = d - start * dot(start, d);
    float sine = length(across);
    if (sine < 1e-6) return hit;
    across /= sine;
    float total = arctangent(sine, dot(start, d));
    float step = push.screen_stride * pixel_angle();
    for (float x = SCREEN_GAP * pixel_angle() + step * push.screen_jitter * jitter; x < total; x += step) {
        float ahead = total - x;
        float t = from * sine_of(x) / sine_of(ahead);
        if (t > t_max) break;
        float r0 = from * sine / sine_of(min(ahead + 0.5 * step, PI - 1e-4)), r1 = from * sine / sine_of(max(ahead - 0.5 * step, 1e-4));
        vec2 c = circle(x / (2.0 * PI));
        vec3 w = start * c.x + across * c.y;
        vec3 local = vec3(dot(w, v.right), dot(w, v.up), dot(w, v.forward));
        vec2 uv = vec2(arctangent(local.x, local.z) / (2.0 * PI) + 0.5, arctangent(length(local.xz), local.y) / PI);
        if (screen_hit(ivec2(floor(uv * vec2(v.size))), min(r0, r1), max(r0, r1), vec3(0.0), hit)) {
            hit.t = t;
            return hit;
        }
    }
    return hit;
}

// Finds the first virtual surface along a ray before t_max, as the picture shows it. `jitter` is from 0 to 1.
SceneHit screen_trace(vec3 origin, vec3 d, float t_max, float jitter) {
    if (VIRTUAL_SURFACES == 0u || in_view.view.instance_count == 0u) return SceneHit(FAR, NONE, NONE, vec2(0.0));
    if (in_view.view.projection == EQUIRECT) return screen_equirect(origin, d, t_max, jitter);
    return screen_perspective(origin, d, t_max, jitter);
}

// A surface met on the screen sends what the picture shows of it, whichever side the ray came from, because
// it is seen along the camera's ray.
vec3 screen_direction(SceneHit hit, vec3 d) {
    vec3 ray = scene_point(hit) - in_view.view.position;
    float length2 = dot(ray, ray);
    return length2 > 0.0 ? ray * inversesqrt(length2) : d;
}
