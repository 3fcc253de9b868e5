// Large panoramas are kept as 16-bit floats, as panorama/texels.rs packs them. A texel whose brightest channel is beyond these
// is divided by 2^16, and one that is very dark is multiplied by it. Alpha is the root of the factor by which a texel
// shines more than it shows, which is 1 or more: negative in a texel that was divided, and 2^-12 of it in one that was
// multiplied.
layout(constant_id = 52) const uint HALVES = 0; // 1: the panorama is kept so

const float HALF_MOST = 65504.0;
const float HALF_DARK = 0.0009765625; // 2^-10
const float HALF_SCALE = 65536.0;
const float HALF_ROOT = 4096.0;

vec4 from_halves(vec4 t) {
    float root = abs(t.w);
    bool dark = root < 0.5;
    float scale = t.w < 0.0 ? HALF_SCALE : dark ? 1.0 / HALF_SCALE : 1.0;
    root *= dark ? HALF_ROOT : 1.0;
    return vec4(t.rgb * scale, root * root);
}

// Packs a texel that shines by this factor more than it shows.
vec4 to_halves(vec3 radiance, float factor) {
    float top = max(radiance.r, max(radiance.g, radiance.b));
    float scale = top > HALF_MOST ? 1.0 / HALF_SCALE : top < HALF_DARK ? HALF_SCALE : 1.0;
    float root = sqrt(factor) * (top > HALF_MOST ? -1.0 : top < HALF_DARK ? 1.0 / HALF_ROOT : 1.0);
    return vec4(clamp(radiance * scale, -HALF_MOST, HALF_MOST), root);
}
