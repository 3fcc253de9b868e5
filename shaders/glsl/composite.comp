#version 460
#extension GL_GOOGLE_include_directive : require
// Pass 6, composite: differential rendering with fractional M (IPRT eq. 2, with ΔE = E_RV − E_R): L =
// M·(L_cam + ΔE·k) + (1 − M)·(L_e + k_V·E/π + L_GGX), where k = min(L_cam/E_R, 1/π), or L_cam/E_R as in the
// paper.
// In: camera_radiance (L_cam), real_coverage (M), albedo_virtual (k_V), emission (L_e), guide, light (E_R and
// ΔE | E and L_GGX); tiles. Out: radiance, alpha 1.
#include "common.glsl"
#include "parts.glsl"
#include "bind/images.glsl"
#include "guide.glsl"
#include "light_code.glsl"
#include "light_units.glsl"
#include "relit.glsl"
#include "color_code.glsl"
#include "tiles.glsl"
layout(local_size_x = 8, local_size_y = 8) in;
layout(constant_id = 1) const int LAYER = 0;
layout(constant_id = 35) const uint DESPECKLE = 0;
layout(constant_id = 29) const uint LISTED = 0; // 1: only the tiles of a layer that were visited are made again

// Brings a pixel's relative change of light between the second least and the second greatest of its neighbours'. One or
// two pixels of noisy depth lie anywhere, even in objects, and have nobody to be filtered with. Too great a change is
// made less. One that is too little, or turned around, is moved as E_R is coloured: a factor would know no bounds.
void settle_among_neighbours(ivec2 p, inout Light light) {
    float own = luminance(light.b) / max(luminance(light.a), 1e-20), count = 0.0;
    vec2 least = vec2(FAR), greatest = vec2(-FAR); // and the second
    [[unroll]] for (int k = 0; k < 9; k++) {
        ivec2 q = p + ivec2(k % 3 - 1, k / 3 - 1);
        if (k == 4 || !neighbour(q)) continue;
        Light there = result_unpack(imageLoad(in_light, ivec3(q, REAL)));
        float change = luminance(there.b) / max(luminance(there.a), 1e-20);
        if (there.deviation.x < 0.0) continue;
        least = vec2(min(least.x, change), min(least.y, max(least.x, change)));
        greatest = vec2(max(greatest.x, change), max(greatest.y, min(greatest.x, change)));
        count += 1.0;
    }
    if (count < 4.0 || own == 0.0) return; // what no object changes stays
    float settled = clamp(own, least.y, greatest.y);
    if (settled * own > 0.0 && abs(settled) <= abs(own)) light.b *= settled / own;
    else light.b += (settled - own) * light.a;
}

void main() {
    ivec2 p = ivec2(gl_GlobalInvocationID.xy);
    if (LISTED != 0u ? !tile_pixel(LAYER, p) : any(greaterThanEqual(p, ivec2(in_view.view.size)))) return;
    if (FAULT == FAULT_LAST_TILE_LOST && any(greaterThanEqual(p, ivec2(in_view.view.size) & ~7))) {
        imageStore(out_radiance, p, vec4(0.0));
        return;
    }
    vec3 radiance = imageLoad(in_camera_radiance, p).rgb;
    if (LIT != 0u && in_view.view.instance_count + in_view.view.light_count > 0u && guide_id(imageLoad(in_guide, ivec3(p, REAL))) != NO_SURFACE) {
        Light light = result_unpack(imageLoad(in_light, ivec3(p, REAL)));
        if (DESPECKLE != 0u) settle_among_neighbours(p, light);
        light_decode(REAL, light);
        radiance = relight(radiance, light.a, light.b);
    }
    float coverage = VIRTUAL_SURFACES != 0u ? imageLoad(in_real_coverage, p).x : 1.0;
    if (coverage < 1.0) {
        Light light = result_unpack(imageLoad(in_virtual_light, ivec3(p, VIRTUAL)));
        light_decode(VIRTUAL, light);
        vec3 virtual_radiance = EMISSION != 0u ? color_unpack(imageLoad(in_emission, p).x) : vec3(0.0);
        virtual_radiance += color_unpack(imageLoad(in_albedo_virtual, p).x) * light.a * (1.0 / PI);
        if (SPECULAR != 0u) virtual_radiance += light.b;
        radiance = coverage * radiance + (1.0 - coverage) * virtual_radiance;
    }
    imageStore(out_radiance, p, vec4(radiance, 1.0));
}
