// What all passes share: the view, random numbers, maths. Positions are in metres relative to the panorama's
// centre, along the world's axes.
#extension GL_EXT_scalar_block_layout : require
#extension GL_EXT_control_flow_attributes : require

const float PI = 3.14159265358979;
const float FAR = 1e30;

const uint PERSPECTIVE = 0u;
const uint EQUIRECT = 1u;
const uint EITHER = 2u;
const uint EQUIRECT_OF_EYE = 3u; // equirect, of one eye of two
layout(constant_id = 14) const uint PROJECTION = EITHER; // of the view, if a pipeline serves one alone

// The two surfaces that a pixel may hold, and the layer of each in array images.
const int REAL = 0;
const int VIRTUAL = 1;
// Their layers in images with a history.
#define LIGHT_NOW(layer) int(in_view.view.light_now[layer])
#define LIGHT_BEFORE(layer) int(in_view.view.light_before[layer])

#include "fault.glsl"

#include "bind/view.glsl"

// --- random numbers: integer hashes of (pixel, frame, dimension, seed) ---

// PCG output permutation of a 32-bit LCG (Jarzynski and Olano 2020, "Hash Functions for GPU Rendering").
uint hash(uint x) {
    uint state = x * 747796405u + 2891336453u;
    uint word = ((state >> ((state >> 28u) + 4u)) ^ state) * 277803737u;
    return (word >> 22u) ^ word;
}

struct Random { uint state; };

Random random_begin(uvec2 pixel, uint stream) {
    return Random(hash(pixel.x + hash(pixel.y + hash(in_view.view.frame + hash(in_view.view.seed + hash(stream))))));
}

// Uniform in [0, 1).
float random_next(inout Random random) {
    random.state = hash(random.state);
    return float(random.state >> 8u) * (1.0 / 16777216.0);
}

vec2 random_next2(inout Random random) {
    float x = random_next(random);
    return vec2(x, random_next(random));
}

// --- maths ---

float luminance(vec3 c) { return dot(c, vec3(0.2126, 0.7152, 0.0722)); }

// Makes an orthonormal basis around a unit vector (Duff et al. 2017, "Building an Orthonormal Basis,
// Revisited"). The branch is not at z = 0, where floors and walls are. Otherwise the last bit of a normal, in
// which drivers differ, would turn all their rays.
mat3 basis(vec3 n) {
    float s = n.z >= -0.347 ? 1.0 : -1.0;
    float a = -1.0 / (s + n.z);
    float b = n.x * n.y * a;
    return mat3(vec3(1.0 + s * n.x * n.x * a, s * b, -s * n.x), vec3(b, s + n.y * n.y * a, -n.y), n);
}

// Computes atan(y, x) to a few ulp on every driver. Vulkan allows its own 4096 ulp, a quarter of a panorama
// texel.
float arctangent(float y, float x) {
    float ax = abs(x), ay = abs(y);
    float big = max(ax, ay), small = min(ax, ay);
    if (big == 0.0) return 0.0;
    float r = small / big;
    bool reduce = r > 0.41421356;
    float s = reduce ? (r - 1.0) / (r + 1.0) : r;
    float z = s * s;
    float a = (((8.05374449538e-2 * z - 1.38776856032e-1) * z + 1.99777106478e-1) * z - 3.33329491539e-1) * z * s + s;
    if (reduce) a += 0.25 * PI;
    if (ay > ax) a = 0.5 * PI - a;
    if (x < 0.0) a = PI - a;
    return y < 0.0 ? -a : a;
}

// Computes (cos, sin) of an angle in turns to 2e-7 on every driver. Vulkan allows its own sine an error of
// 2^-11.
vec2 circle(float turns) {
    float quarter = floor(4.0 * turns + 0.5);
    float x = (turns - 0.25 * quarter) * (2.0 * PI), z = x * x;
    vec2 c = vec2(1.0 + z * (-0.5 + z * (4.16666667e-2 + z * (-1.38888889e-3 + z * 2.48015873e-5))),
        x * (1.0 + z * (-1.66666667e-1 + z * (8.33333333e-3 + z * (-1.98412698e-4 + z * 2.75573192e-6)))));
    int q = int(quarter) & 3;
    if ((q & 1) != 0) c = vec2(-c.y, c.x);
    return q >= 2 ? -c : c;
}

// Draws a cosine-weighted direction about n; its density is cos/π.
vec3 sample_cosine(vec3 n, vec2 u) {
    return normalize(basis(n) * vec3(sqrt(u.x) * circle(u.y), sqrt(max(0.0, 1.0 - u.x))));
}

// Rounds to what a 16-bit float holds exactly, for values up to 1. Drivers round differently on storing.
vec3 to_half(vec3 v) { return floor(v * 2048.0 + 0.5) * (1.0 / 2048.0); }

// Finds a texel of a periodic map: columns wrap, and rows beyond a pole continue on the opposite meridian.
// Columns may be off by the width, no more.
ivec2 wrap_texel(ivec2 p, ivec2 size) {
    int half_turn = size.x / 2;
    if (p.y < 0 || p.y >= size.y) {
        p.y = p.y < 0 ? -1 - p.y : 2 * size.y - 1 - p.y;
        p.x += p.x < half_turn ? half_turn : half_turn - size.x;
    }
    if (FAULT == FAULT_NO_WRAP) p.x = clamp(p.x, 0, size.x - 1);
    p.x += p.x < 0 ? size.x : 0;
    p.x -= p.x >= size.x ? size.x : 0;
    return clamp(p, ivec2(0), size - 1);
}

// Finds an item of a table, which is an array as an image.
ivec2 table_texel(uint item) { return ivec2(item & 4095u, item >> 12u); }

uint projection() { return PROJECTION == EITHER ? in_view.view.projection : PROJECTION & 1u; }

// Says whether the view is of one eye of two. A pipeline of one projection does not ask the view: lavapipe 22 compiles a
// shader with such a condition anew in each frame, and frees none.
bool of_eye() { return PROJECTION == EITHER ? in_view.view.eye != 0.0 : PROJECTION == EQUIRECT_OF_EYE; }

// Finds a neighbouring pixel of this view, if there is one. An equirect view wraps, a perspective one ends.
bool neighbour(inout ivec2 p) {
    ivec2 size = ivec2(in_view.view.size);
    if (projection() == EQUIRECT) { p = wrap_texel(p, size); return true; }
    return all(greaterThanEqual(p, ivec2(0))) && all(lessThan(p, size));
}

// --- camera ---

// Returns the unit direction through a point of the image, in pixels (centres are at +½).
vec3 view_direction(vec2 pixel) {
    View v = in_view.view;
    vec2 s = pixel / vec2(v.size);
    if (projection() == EQUIRECT) {
        vec2 phi = circle(s.x - 0.5), theta = circle(0.5 * s.y);
        return normalize(v.right * (theta.y * phi.y) + v.up * theta.x + v.forward * (theta.y * phi.x));
    }
    vec2 ndc = vec2(2.0 * s.x - 1.0, 1.0 - 2.0 * s.y) * v.tan_half;
    return normalize(v.forward + v.right * ndc.x + v.up * ndc.y);
}

// Returns how far beside the middle an eye of a stereo panorama sees what lies `latitude` (radians) from the horizon. Towards
// the poles, which have no side, the eyes become one.
float eye_offset(float latitude) { return in_view.view.eye * (1.0 - smoothstep(60.0, 75.0, degrees(abs(latitude)))); }

// Returns where the ray through a point of the image, in pixels, begins. The eyes of a stereo panorama look in each direction
// with the other beside them (omnidirectional stereo, Peleg, Ben-Ezra and Pritch 2001).
vec3 view_origin(vec2 pixel) {
    View v = in_view.view;
    if (projection() != EQUIRECT || !of_eye()) return v.position;
    vec2 s = pixel / vec2(v.size), phi = circle(s.x - 0.5);
    return v.position + (v.right * phi.x - v.forward * phi.y) * eye_offset(PI * (0.5 - s.y));
}

// Returns where a point was in the image of the previous frame, in pixels. z is its distance, negative behind
// the camera.
vec3 project_previous(vec3 point) {
    View v = in_view.view;
    vec3 d = point - v.previous_position;
    vec3 local = vec3(dot(d, v.previous_right), dot(d, v.previous_up), dot(d, v.previous_forward));
    float distance = length(d);
    if (projection() == EQUIRECT) {
        float phi = arctangent(local.x, local.z), along = length(local.xz), theta = arctangent(along, local.y);
        if (of_eye()) {
            // The ray touches the circle of the eyes. How wide that is depends on how high the point is seen.
            float off = 0.0, ahead = along;
            for (int k = 0; k < 3; k++) {
                off = clamp(eye_offset(0.5 * PI - theta), -0.99 * along, 0.99 * along);
                ahead = sqrt(along * along - off * off);
                theta = arctangent(ahead, local.y);
            }
            phi -= arctangent(off, ahead);
            distance = length(vec2(ahead, local.y));
        }
        return vec3(vec2(phi / (2.0 * PI) + 0.5, theta / PI) * vec2(v.size), distance);
    }
    if (local.z <= 1e-6) return vec3(-1e6, -1e6, -distance);
    vec2 ndc = local.xy / (local.z * v.previous_tan_half);
    return vec3(vec2(0.5 + 0.5 * ndc.x, 0.5 - 0.5 * ndc.y) * vec2(v.size), distance);
}

// Returns how far from a pixel a point was seen a frame ago: xy in pixels, z its distance then; w as given.
vec4 motion_of(vec2 pixel, vec3 previous_point, float id) {
    vec3 previous = project_previous(previous_point);
    vec2 motion = previous.xy - pixel;
    if (projection() == EQUIRECT) motion.x -= round(motion.x / float(in_view.view.size.x)) * float(in_view.view.size.x);
    if (FAULT == FAULT_MOTION_OFF) motion.x += 1.0;
    return vec4(motion, previous.z, id);
}

// Returns the angle in radians that one pixel spans.
float pixel_angle() {
    return projection() == EQUIRECT ? PI / float(in_view.view.size.y)
                                               : 2.0 * in_view.view.tan_half.y / float(in_view.view.size.y);
}
