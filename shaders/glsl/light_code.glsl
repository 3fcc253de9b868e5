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

// Rounds to what halves hold, up or down by chance (13 random bits), so that a mean of many roundings is right.
float half_by_chance(float v, uint bits) { return uintBitsToFloat((floatBitsToUint(v) + (bits & 0x1fffu)) & ~0x1fffu); }

// As light_pack, with a and b rounded by chance.
uvec4 light_pack_by_chance(Light light, uint random) {
    uint other = random * 747796405u;
    light.a = vec3(half_by_chance(light.a.x, random), half_by_chance(light.a.y, random >> 9u), half_by_chance(light.a.z, random >> 18u));
    light.b = vec3(half_by_chance(light.b.x, other), half_by_chance(light.b.y, other >> 9u), half_by_chance(light.b.z, other >> 18u));
    return light_pack(light);
}

// Returns a and b of a layer in W/m², or radiance, up to the scale of the capture.
void light_decode(int layer, inout Light light) {
    light.a /= layer == REAL ? in_view.view.light_units.x : in_view.view.light_units.y;
    light.b /= in_view.view.light_units.y;
}

const uvec4 LIGHT_UNKNOWN = uvec4(0u, 0u, 0u, 0xbc00u); // deviation −1
