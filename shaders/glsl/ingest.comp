#version 460
#extension GL_GOOGLE_include_directive : require
#extension GL_EXT_scalar_block_layout : require
// Per video frame, ingest: linear Rec. 709 radiance of a video's codes. Luma and chroma (between its samples as if
// straight: it wraps across, and ends below) become R'G'B' by range and matrix, these become linear by a table of
// the transfer curve, and then come the matrix of the primaries, inverse tone mapping (panorama/tone.rs) and exposure.
// In: words of codes, the curve, what codes mean. Out: radiance, with the factor of clipped lamps in alpha.
#include "halves.glsl"
layout(local_size_x = 16, local_size_y = 16) in;

layout(constant_id = 62) const uint KIND = 1; // 0: grey; 1: luma and chroma; 2: green, blue and red
layout(constant_id = 63) const uint CODE_BYTES = 1;

layout(constant_id = 64) const uint RAISED = 0; // 1: clipped texels shine more than they show

struct Meaning {
    uvec2 from;        // the part's first pixel
    uvec2 size;        // of the part
    uvec3 planes;      // where each plane begins, codes
    uvec2 strides;     // of the first plane and of the others, codes
    uvec2 chroma_from; // the part's first chroma sample
    uvec2 chroma_size;
    uvec2 sub;         // by how many powers of two chroma is narrower and lower
    uvec2 shift;       // of the first chroma sample, half pixels
    vec2 luma;         // offset and factor that make it 0..1
    vec2 chroma;       // the same for -0.5..0.5
    vec3 of_cb;        // what it adds to R'G'B'
    vec3 of_cr;
    vec3 red;          // of linear R, G and B
    vec3 green;
    vec3 blue;
    float knee;
    float bend;        // 0: bright texels are not raised
    float exposure;
    float clipped;     // how bright a texel of a clipped lamp is at least
    uint raised;       // the number of such lamps
};
struct Raised {
    vec3 direction; // in the panorama's frame
    float reach;    // angle
    float factor;
};
layout(set = 0, binding = 60, r32ui) uniform readonly uimage2D in_words;
// The linear value at each of 8192 steps from 0 to 1, and how much more it is at the next.
layout(set = 0, binding = 61, rg32f) uniform readonly image2D in_curve;
// First row: (sin φ, cos φ) of each column. Second: (sin θ, cos θ) of the pole and of each row.
layout(set = 0, binding = 65, rg32f) uniform readonly image2D in_texel_angles;
layout(set = 0, binding = 62, scalar) readonly buffer CodesBuffer { Meaning codes; Raised raised[]; } in_meaning;
layout(set = 0, binding = 63, rgba32f) uniform writeonly image2D out_panorama_radiance;
// The same of a panorama of 16-bit floats.
layout(set = 0, binding = 64, rgba16f) uniform writeonly image2D out_half_radiance;

const float STEPS = 8192.0;

ivec2 place(uint index) { return ivec2(index & 4095u, index >> 12); }

float code(uint index) {
    if (CODE_BYTES == 1u) return float((imageLoad(in_words, place(index >> 2)).r >> ((index & 3u) * 8u)) & 0xffu);
    return float((imageLoad(in_words, place(index >> 1)).r >> ((index & 1u) * 16u)) & 0xffffu);
}

float linear(float code) {
    float at = clamp(code, 0.0, 1.0) * STEPS;
    uint below = uint(at);
    vec2 step = imageLoad(in_curve, place(below)).rg;
    return step.r + step.g * (at - float(below));
}

// A code of a plane between those of two rows and two columns.
float between(uint plane, uvec2 rows, uvec2 columns, vec2 weight) {
    vec2 at_left = vec2(code(plane + rows.x + columns.x), code(plane + rows.y + columns.x));
    vec2 at_right = vec2(code(plane + rows.x + columns.y), code(plane + rows.y + columns.y));
    vec2 at = mix(at_left, at_right, weight.x);
    return mix(at.x, at.y, weight.y);
}

// R'G'B' of a pixel of the part.
vec3 gamma_color(uvec2 p) {
    uint at = (in_meaning.codes.from.y + p.y) * in_meaning.codes.strides.x + in_meaning.codes.from.x + p.x;
    float luma = (code(in_meaning.codes.planes.x + at) + in_meaning.codes.luma.x) * in_meaning.codes.luma.y;
    if (KIND == 0u) return vec3(luma);
    if (KIND == 2u) return vec3((code(in_meaning.codes.planes.z + at) + in_meaning.codes.luma.x) * in_meaning.codes.luma.y, luma, (code(in_meaning.codes.planes.y + at) + in_meaning.codes.luma.x) * in_meaning.codes.luma.y);
    // In half pixels, and beyond the first sample by one sample, so that nothing is negative.
    uvec2 step = uvec2(2u) << in_meaning.codes.sub;
    uvec2 half_at = 2u * (in_meaning.codes.from + p) + step - in_meaning.codes.shift;
    vec2 weight = vec2(half_at & (step - 1u)) / vec2(step);
    ivec2 first = ivec2(half_at >> (in_meaning.codes.sub + 1u)) - ivec2(in_meaning.codes.chroma_from) - 1, last = ivec2(in_meaning.codes.chroma_size) - 1;
    uvec2 columns = uvec2(first.x < 0 ? last.x : first.x, first.x == last.x ? 0 : first.x + 1);
    ivec2 rows = clamp(ivec2(first.y, first.y + 1), ivec2(0), ivec2(last.y));
    uvec2 row = (in_meaning.codes.chroma_from.y + uvec2(rows)) * in_meaning.codes.strides.y + in_meaning.codes.chroma_from.x;
    vec2 chroma = vec2(between(in_meaning.codes.planes.y, row, columns, weight), between(in_meaning.codes.planes.z, row, columns, weight));
    chroma = (chroma + in_meaning.codes.chroma.x) * in_meaning.codes.chroma.y;
    return vec3(luma) + chroma.x * in_meaning.codes.of_cb + chroma.y * in_meaning.codes.of_cr;
}

// By what a clipped texel shines more than it shows: the factor of the lamp that is nearest by angle.
float factor(uvec2 p, float brightest) {
    if (RAISED == 0u) return 1.0;
    vec2 column = imageLoad(in_texel_angles, ivec2(p.x, 0)).rg, row = imageLoad(in_texel_angles, ivec2(p.y + 1u, 1)).rg;
    vec3 direction = vec3(row.x * column.x, row.y, -row.x * column.y);
    uint count = brightest >= in_meaning.codes.clipped ? in_meaning.codes.raised : 0u;
    float factor = 1.0, nearest = 10.0;
    for (uint k = 0u; k < count; k++) {
        Raised lamp = in_meaning.raised[k];
        float angle = acos(clamp(dot(direction, lamp.direction), -1.0, 1.0)) - lamp.reach;
        factor = angle < nearest ? lamp.factor : factor;
        nearest = min(nearest, angle);
    }
    return factor;
}

void main() {
    uvec2 p = gl_GlobalInvocationID.xy;
    if (any(greaterThanEqual(p, in_meaning.codes.size))) return;
    vec3 codes = gamma_color(p);
    vec3 plain = vec3(linear(codes.r), linear(codes.g), linear(codes.b));
    // Colours beyond Rec. 709 stay what they are.
    vec3 color = vec3(dot(in_meaning.codes.red, plain), dot(in_meaning.codes.green, plain), dot(in_meaning.codes.blue, plain));
    float top = max(color.r, max(color.g, color.b));
    if (in_meaning.codes.bend > 0.0 && top > in_meaning.codes.knee) {
        float x = min((top - in_meaning.codes.knee) / (1.0 - in_meaning.codes.knee), 1.0);
        color *= (in_meaning.codes.knee + (1.0 - in_meaning.codes.knee) * x / (1.0 - in_meaning.codes.bend * x)) / top;
    }
    color *= in_meaning.codes.exposure;
    float shines = factor(p, max(color.r, max(color.g, color.b)));
    if (HALVES != 0u) imageStore(out_half_radiance, ivec2(p), to_halves(color, shines));
    else imageStore(out_panorama_radiance, ivec2(p), vec4(color, shines));
}
