// Directions towards the panorama's lights from a point in a box room, drawn or on a grid, each with the density that is claimed for it.
#version 460
#extension GL_GOOGLE_include_directive : require
#include "common.glsl"
#include "panorama.glsl"
#include "light.glsl"
layout(local_size_x = 64) in;
layout(set = 0, binding = 40, scalar) writeonly buffer Samples { vec4 value[]; } out_samples; // direction, density

layout(push_constant, scalar) uniform Push { vec3 x; vec3 low; vec3 high; uint grid; uint per_thread; } push;

// Where a ray from inside meets the walls.
vec3 wall_point(vec3 from, vec3 d) {
    vec3 t = (mix(push.low, push.high, greaterThan(d, vec3(0.0))) - from) / d;
    return from + d * min(t.x, min(t.y, t.z));
}

void main() {
    uint i = gl_GlobalInvocationID.x;
    Random random = random_begin(uvec2(i % 64u, i / 64u), 0u);
    for (uint k = 0u; k < push.per_thread; k++) {
        uint n = i * push.per_thread + k;
        vec3 d, point;
        if (push.grid == 0u) {
            vec2 u = random_next2(random);
            point = wall_point(vec3(0.0), light_sample(u, random_next2(random)));
            d = normalize(point - push.x);
        } else {
            float phi = 2.0 * PI * (float(n % push.grid) + 0.5) / float(push.grid), z = 2.0 * (float(n / push.grid) + 0.5) / float(push.grid) - 1.0;
            d = vec3(sqrt(1.0 - z * z) * sin(phi), z, sqrt(1.0 - z * z) * cos(phi));
            point = wall_point(push.x, d);
        }
        // the wall that the point is nearest to
        vec3 wall = abs(2.0 * (point - push.low) / (push.high - push.low) - 1.0);
        PanoramaHit hit;
        hit.t = distance(point, push.x);
        hit.uv = panorama_uv(point);
        hit.kind = SURFACE;
        hit.normal = wall.x > max(wall.y, wall.z) ? vec3(1.0, 0.0, 0.0) : wall.y > wall.z ? vec3(0.0, 1.0, 0.0) : vec3(0.0, 0.0, 1.0);
        out_samples.value[n] = vec4(d, light_density(push.x, d, hit));
    }
}
