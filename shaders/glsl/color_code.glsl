// A colour of any brightness in 4 bytes: three mantissas of 9 bits and an exponent that they share, as Vulkan's
// E5B9G9R9. Values are from 0 to 65,000, off by at most a thousandth of the largest of the three.

const uint FLAG = 1u << 18u; // the last bit of blue, where it stands for something else

uint color_pack(vec3 color) {
    const float MOST = 65000.0, LEAST = 1.0 / 65536.0;
    color = clamp(color, 0.0, MOST);
    float largest = max(max(color.r, color.g), max(color.b, LEAST));
    // The power of two above it; what would round up to that needs the next.
    int exponent = int(floatBitsToUint(largest + largest * (1.0 / 1024.0)) >> 23u) - 126;
    uvec3 mantissa = uvec3(color * uintBitsToFloat(uint(127 + 9 - exponent) << 23u) + 0.5);
    return mantissa.r | mantissa.g << 9 | mantissa.b << 18 | uint(exponent + 15) << 27;
}

vec3 color_unpack(uint code) {
    return vec3(code & 511u, (code >> 9) & 511u, (code >> 18) & 511u) * uintBitsToFloat(((code >> 27) + (127u - 15u - 9u)) << 23u);
}
