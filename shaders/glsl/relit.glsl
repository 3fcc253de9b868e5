#include "bind/relit.glsl"
layout(constant_id = 6) const uint RELIGHTING = 0;
const uint RATIO = 1u;

// Relights a real surface: out = L + ΔE·k, k = min(L/E_R, 1/π). k is what a diffuse surface reflects per
// irradiance, at most all of it. This equals L_e + (L − L_e)·E_RV/E_R with L_e = max(0, L − E_R/π), without
// the division's pole at E_R = 0. RATIO is the paper's equation 2, L·E_RV/E_R. Its pole is left in, except
// for E_R < 1e-6, where dividing would overflow.
vec3 relight(vec3 radiance, vec3 irradiance, vec3 change) {
    vec3 k = RELIGHTING == RATIO ? radiance / max(irradiance, vec3(1e-6)) : min(radiance / max(irradiance, vec3(1e-20)), vec3(1.0 / PI));
    // Where a video's colour is beyond Rec. 709 a channel is below 0, and stays so.
    return max(radiance + change * k, min(radiance, vec3(0.0)));
}

// Returns the radiance of a real surface as the mixed scene lights it.
vec3 relit(vec2 uv, vec3 radiance) {
    if (in_view.view.relit == 0u) return radiance;
    ivec2 size = ivec2(in_view.view.relight_size);
    vec2 p = uv * vec2(size) - 0.5;
    ivec2 i = ivec2(floor(p));
    vec2 f = p - vec2(i);
    Light light = Light(vec3(0.0), vec3(0.0), vec2(0.0));
    [[unroll]] for (int k = 0; k < 4; k++) {
        ivec2 o = ivec2(k & 1, k >> 1);
        float w = (o.x == 1 ? f.x : 1.0 - f.x) * (o.y == 1 ? f.y : 1.0 - f.y);
        Light there = result_unpack(imageLoad(in_relit_light, ivec3(wrap_texel(i + o, size), REAL)));
        light.a += w * there.a;
        light.b += w * there.b;
    }
    light_decode(REAL, light);
    return relight(radiance, light.a, light.b);
}
