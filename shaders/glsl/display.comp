#version 460
#extension GL_GOOGLE_include_directive : require
// display: an image of the renderer as a window shows it. It is not part of the frame. `look` says what the
// numbers mean, and the legends in passes/display.rs describe it.
// In: image and other (texels of any meaning, one layer of each), codes (`hit`, or packed light). Out: picture, sRGB codes.
#extension GL_EXT_scalar_block_layout : require
#include "light_code.glsl"
#include "color_code.glsl"
layout(local_size_x = 8, local_size_y = 8) in;

const uint RADIANCE = 0u, DIRECTION = 1u, PLACE = 2u, MOTION = 3u, ID = 4u, SHARE = 5u, MASK = 6u, HISTORY = 7u, CODE = 8u, DIFFERENCE = 9u;

const uint COLOR = 8u; // of `values`

layout(set = 0, binding = 0) uniform sampler2DArray in_image;
layout(set = 0, binding = 1) uniform sampler2DArray in_other;
layout(set = 0, binding = 2) uniform usampler2DArray in_codes;
layout(set = 0, binding = 3, rgba8) uniform writeonly image2D out_picture;
layout(set = 0, binding = 4) uniform sampler2DArray in_marked;

layout(push_constant, scalar) uniform Push {
    uvec2 size;
    uint look;
    uint layer;
    uint values;      // what codes are: 0 nothing or `hit`, 1 a of packed light, 2 b, 3 a + b, COLOR a colour
    uint brief;       // 1: packed light is in brief
    vec2 light_scales; // on a and b of packed light
    float exposure;
    uint tonemap;  // 0: clip, 1: Khronos PBR Neutral
    float raised;  // inverse_tonemap; at most 1 if nothing was raised
    float scale;   // the panorama's exposure
    uint marks;    // 1: show where marked is not 0
} push;

vec3 srgb(vec3 x) {
    x = clamp(x, 0.0, 1.0);
    return mix(12.92 * x, 1.055 * pow(x, vec3(1.0 / 2.4)) - 0.055, greaterThan(x, vec3(0.0031308)));
}

// Does what `tone::compress` does: the largest component is compressed, and the others in proportion.
vec3 lowered(vec3 radiance) {
    if (push.raised <= 1.0) return radiance;
    const float KNEE = 0.6; // as in panorama/tone.rs
    float largest = max(radiance.r, max(radiance.g, radiance.b)) / push.scale;
    if (largest <= KNEE) return radiance;
    float y = (largest - KNEE) / (1.0 - KNEE);
    float bend = 1.0 - (1.0 - KNEE) / (push.raised - KNEE);
    return radiance * ((KNEE + (1.0 - KNEE) * y / (1.0 + bend * y)) / largest);
}

// Does what `Tonemap::map` does.
vec3 toned(vec3 color) {
    if (push.tonemap == 0u) return color;
    color = max(color, 0.0);
    float least = min(color.r, min(color.g, color.b));
    color -= least < 0.08 ? least - 6.25 * least * least : 0.04;
    float most = max(color.r, max(color.g, color.b));
    const float START = 0.76, ROOM = 1.0 - START;
    if (most < START) return color;
    float compressed = 1.0 - ROOM * ROOM / (most + ROOM - START);
    float white = 1.0 - 1.0 / (0.15 * (most - compressed) + 1.0);
    return mix(color * (compressed / most), vec3(compressed), white);
}

vec3 shown(vec3 radiance) { return srgb(toned(push.exposure * lowered(radiance))); }

uint scrambled(uint x) {
    x = (x ^ 61u) ^ (x >> 16u);
    x *= 9u;
    x ^= x >> 4u;
    x *= 0x27d4eb2du;
    return x ^ (x >> 15u);
}

vec3 hue(uint id) {
    float h = float(scrambled(id) & 1023u) / 1024.0;
    return 0.35 + 0.6 * clamp(abs(fract(h + vec3(0.0, 2.0 / 3.0, 1.0 / 3.0)) * 6.0 - 3.0) - 1.0, 0.0, 1.0);
}

// Dark blue, green, yellow, white. `Meaning::color` has the same.
vec3 ramp(float x) {
    x = clamp(x, 0.0, 1.0);
    return clamp(vec3(2.2 * x - 0.7, 1.5 * x, 0.25 + 1.2 * x * (1.0 - x) + max(0.0, 4.0 * x - 3.0)), 0.0, 1.0);
}

void main() {
    ivec2 p = ivec2(gl_GlobalInvocationID.xy);
    if (any(greaterThanEqual(p, ivec2(push.size)))) return;
    // An input that a scene does not use is bound to an image of one texel and one layer.
    ivec3 at = min(ivec3(p, int(push.layer)), textureSize(in_image, 0) - 1);
    vec4 value = push.look == CODE ? vec4(0.0) : texelFetch(in_image, at, 0);
    uvec4 code = texelFetch(in_codes, min(ivec3(p, int(push.layer)), textureSize(in_codes, 0) - 1), 0);
    if (push.values == COLOR) value.rgb = color_unpack(code.x);
    else if (push.values != 0u) {
        Light light = light_unpack(code);
        if (push.brief != 0u) light = brief_unpack(code);
        vec3 a = push.light_scales.x * light.a, b = push.light_scales.y * light.b;
        value.rgb = push.values == 1u ? a : push.values == 2u ? b : a + b;
    }
    vec4 other = texelFetch(in_other, min(at, textureSize(in_other, 0) - 1), 0);
    vec3 color = vec3(0.0);
    switch (push.look) {
    case RADIANCE: color = shown(value.rgb); break;
    case DIRECTION: color = value.xyz == vec3(0.0) ? vec3(0.0) : 0.5 + 0.5 * value.xyz; break;
    case PLACE: color = value.w == 0.0 ? vec3(0.0) : fract(value.xyz); break;
    case MOTION: color = vec3(clamp(0.5 + value.xy / 32.0, 0.0, 1.0), 0.5); break;
    case ID: color = value.x < 0.5 ? vec3(0.2) : hue(uint(value.x)); break;
    case SHARE: color = vec3(clamp(value.x, 0.0, 1.0)); break;
    case MASK: color = vec3(value.x < 0.0 ? 0.4 : min(127.0 * value.x, 1.0)); break;
    case HISTORY: color = ramp(value.x / 64.0); break;
    case CODE: color = code.x == 0xffffffffu ? vec3(0.2) : hue(code.x * 7919u + code.y); break;
    case DIFFERENCE: {
        vec3 apart = abs(shown(value.rgb) - shown(other.rgb));
        color = ramp(4.0 * dot(apart, vec3(1.0 / 3.0)));
        break;
    }
    }
    if (push.marks != 0u && texelFetch(in_marked, ivec3(p, 0), 0).x > 0.0)
        color = mix(color, ((p.x + p.y) / 4) % 2 == 0 ? vec3(1.0, 0.1, 0.6) : vec3(0.3, 0.0, 0.2), 0.6);
    imageStore(out_picture, p, vec4(color, 1.0));
}
