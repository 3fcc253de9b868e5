// Light of one surface in 16 bytes, as halves: a and b (see bind/images.glsl), and the standard deviations of
// their luminances. It is in units near the panorama's mean radiance, so that halves hold what is dark and what
// is bright.

struct Light {
    vec3 a;
    vec3 b;
    vec2 deviation; // x < 0: nothing is known
};

uvec4 light_pack(Light light) {
    const float MOST = 65000.0;
    vec3 a = clamp(light.a, -MOST, MOST), b = clamp(light.b, -MOST, MOST);
    vec2 deviation = min(light.deviation, MOST);
    return uvec4(packHalf2x16(a.xy), packHalf2x16(vec2(a.z, b.x)), packHalf2x16(b.yz), packHalf2x16(deviation));
}

Light light_unpack(uvec4 code) {
    vec2 middle = unpackHalf2x16(code.y);
    return Light(vec3(unpackHalf2x16(code.x), middle.x), vec3(middle.y, unpackHalf2x16(code.z)), unpackHalf2x16(code.w));
}

// The same in floats without their lower half, which cost less to read and are a quarter of a percent apart: for light
// that is not yet filtered, and for light between the levels of the filter.
uint brief_pair(float x, float y, uint add) { return ((floatBitsToUint(x) + (add & 0xffffu)) >> 16u) | ((floatBitsToUint(y) + (add >> 16u)) & 0xffff0000u); }

uvec4 brief_pack(Light light) {
    const uint NEAREST = 0x80008000u;
    return uvec4(brief_pair(light.a.x, light.a.y, NEAREST), brief_pair(light.a.z, light.b.x, NEAREST), brief_pair(light.b.y, light.b.z, NEAREST),
        brief_pair(light.deviation.x, light.deviation.y, NEAREST));
}

// Rounds up or down by chance, so that a mean of many roundings is right.
uvec4 brief_pack_by_chance(Light light, uint random) {
    uint other = random * 747796405u;
    uvec4 code = brief_pack(light);
    code.xyz = uvec3(brief_pair(light.a.x, light.a.y, random), brief_pair(light.a.z, light.b.x, other), brief_pair(light.b.y, light.b.z, other * 747796405u));
    return code;
}

vec2 brief_two(uint word) { return uintBitsToFloat(uvec2(word << 16u, word & 0xffff0000u)); }

Light brief_unpack(uvec4 code) {
    vec2 middle = brief_two(code.y);
    return Light(vec3(brief_two(code.x), middle.x), vec3(middle.y, brief_two(code.z)), brief_two(code.w));
}

const uvec4 LIGHT_UNKNOWN = uvec4(0u, 0u, 0u, 0xbc00u); // the deviation is below 0 in either code
