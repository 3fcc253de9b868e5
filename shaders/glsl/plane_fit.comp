#version 460
#extension GL_GOOGLE_include_directive : require
// Per video frame, normals (first dispatch): a plane through the neighbourhood of every `spacing`-th texel. On the
// plane n.P = h the inverse depth is linear in direction, 1/D = a.w with a = n/h, so a is found by linear least
// squares in three rounds. The first takes neighbours whose depth connects to this one's, the others those that the
// plane so far explains. Holes are left out. A surface at a grazing angle goes on in equal steps of 1/D, however far apart
// they are.
// In: depth (m), angles. Out: plane (xyz a, 1/m; w mean squared residual of 1/D, negative: no plane), one texel for
// each place.
#include "common.glsl"
#include "panorama.glsl"
layout(local_size_x = 8, local_size_y = 8) in;

#include "normals.glsl"

// Returns by how much q changes over half the window, if it does so by the same amount on both sides.
float slope(ivec2 p, ivec2 way, float q, float step_here, ivec2 size) {
    way *= push.radius;
    way.x %= size.x;
    ivec2 ahead = wrap_texel(p + way, size), behind = wrap_texel(p - way, size);
    float before = vertex_depth(behind.x, behind.y), after = vertex_depth(ahead.x, ahead.y);
    if (before <= 0.0 || after <= 0.0) return 0.0;
    float b = q - 1.0 / before, f = 1.0 / after - q;
    return abs(f - b) <= 2.0 * step_here + 0.02 * q ? 0.5 * (b + f) : 0.0;
}

void main() {
    ivec2 size = ivec2(in_view.view.depth_size), place = ivec2(gl_GlobalInvocationID.xy), p = place * push.spacing;
    if (any(greaterThanEqual(p, size))) return;
    float depth = vertex_depth(p.x, p.y);
    if (depth <= 0.0) {
        imageStore(out_plane, place, vec4(0.0, 0.0, 0.0, -1.0));
        return;
    }
    float q = 1.0 / depth;
    float step_here = step_at(q);
    // The local frame: along the row, down the column, outwards. In it a neighbour's direction follows from the
    // difference of longitudes and from its row.
    vec2 phi = imageLoad(in_angles, ivec2(p.x, 0)).xy, theta = imageLoad(in_angles, ivec2(p.y + 1, 1)).xy;
    mat3 frame = mat3(phi.y, 0.0, phi.x, theta.y * phi.x, -theta.x, -theta.y * phi.y, theta.x * phi.x, theta.y, -theta.x * phi.y);
    // The normal equations, with tangential coordinates scaled to the window.
    float scale = float(size.y) / (PI * float(push.radius));
    // Rows get shorter towards the poles. The window stays as wide as it is high.
    int wide = min(int(1.0 / theta.x), max(size.x / 8, 1));
    float texel = float(wide) / float(size.x);
    vec2 to_first = circle(-texel * float(push.radius)), to_next = circle(texel * float(push.stride));
    vec3 a = vec3(slope(p, ivec2(wide, 0), q, step_here, size) / (float(wide) * theta.x), slope(p, ivec2(0, 1), q, step_here, size), q);
    float residual = 0.0;
    for (int round = 0; round < 3; round++) {
        float sxx = 0.0, sxy = 0.0, sxz = 0.0, syy = 0.0, syz = 0.0, szz = 0.0, count = 0.0, error = 0.0;
        vec3 right = vec3(0.0);
        for (int y = -push.radius; y <= push.radius; y += push.stride) {
            ivec2 row = wrap_texel(p + ivec2(0, y), size); // over a pole it is half a turn away
            vec2 below = imageLoad(in_angles, ivec2(row.y + 1, 1)).xy;
            float ring = below.x * (row.x == p.x ? 1.0 : -1.0);
            float across = ring * theta.y, out_along = ring * theta.x;
            float across_pole = -below.y * theta.x, out_pole = below.y * theta.y;
            vec2 turn = to_first; // (cos, sin) of the difference of longitudes
            for (int x = -push.radius; x <= push.radius; x += push.stride) {
                float d = vertex_depth(wrap_texel(row + ivec2(x * wide % size.x, 0), size).x, row.y);
                vec3 w = vec3(scale * ring * turn.y, scale * (across * turn.x + across_pole), out_along * turn.x + out_pole);
                turn = vec2(turn.x * to_next.x - turn.y * to_next.y, turn.x * to_next.y + turn.y * to_next.x);
                if (d <= 0.0) continue;
                float qi = 1.0 / d;
                float e = qi - dot(a, w);
                float reach = max(abs(float(x)), abs(float(y)));
                float limit = round == 0 ? 2.0 * step_here + (0.02 + 0.03 * reach) * q : (round == 1 ? 2.0 : 1.2) * step_here + push.relative * q;
                if (abs(e) > limit) continue;
                sxx += w.x * w.x; sxy += w.x * w.y; sxz += w.x * w.z;
                syy += w.y * w.y; syz += w.y * w.z; szz += w.z * w.z;
                right += w * qi;
                error += e * e;
                count += 1.0;
            }
        }
        mat3 m = mat3(sxx, sxy, sxz, sxy, syy, syz, sxz, syz, szz);
        m[0][0] += 1e-5; m[1][1] += 1e-5;
        float det = determinant(m);
        if (count < 3.0 || det < 1e-7 * count * count * count) {
            if (round == 0) { a = vec3(0.0, 0.0, q); residual = 1.0; } // too little to fit: face the centre
            break;
        }
        a = inverse(m) * right;
        if (round > 0) residual = error / count;
    }
    vec3 plane = frame * vec3(a.xy * scale, a.z);
    imageStore(out_plane, place, vec4(plane, residual));
}
