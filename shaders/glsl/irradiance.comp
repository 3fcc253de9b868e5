#version 460
#extension GL_GOOGLE_include_directive : require
// Pass 3, irradiance: one path per traced surface (IPRT eq. 1, N = 1). Real surfaces get E_R, and ΔE = E_RV −
// E_R from the same random numbers (W/m² up to the capture's scale). Virtual surfaces get E of the
// Lambert lobe and the radiance of the GGX lobe. Rays see real surfaces relit, and virtual ones by paths of up
// to `bounces` vertices.
// In: list, or what aim left of it; position, normal, hit; panorama, scene, relit panorama. Out: irradiance (E_R and ΔE | E
// and GGX radiance).
#include "irradiance.glsl"
layout(local_size_x = 64) in;

void real_surface_light(ivec2 p) {
    Random random = random_begin(uvec2(p), uint(REAL));
    RealStart from = real_start(p);
    Ray ray = real_ray(real_aim(p, from, random), from);
    vec3 radiance = vec3(0.0), mixed = vec3(0.0);
    if (ray.weight.x > 0.0) {
        SceneHit hit = virtual_trace(from.off_virtual, ray.d, ray.real.t, random);
        radiance = hit_radiance(ray.real);
        mixed = incoming(from.off_virtual, ray, hit, random);
        if (ROULETTE != 0u && hit.instance == NONE) {
            float share = traced_share(p);
            ray.weight = chosen(p, share) ? ray.weight / share : vec3(0.0);
        }
    }
    vec3 weight = PI * ray.weight;
    if (FAULT == FAULT_ENERGY_CLAMP) weight *= min(1.0, 0.3 / max(luminance(weight * max(radiance, mixed)), 1e-20));
    vec2 units = in_view.view.light_units;
    imageStore(out_irradiance, ivec3(p, REAL), light_pack(Light(units.x * weight * radiance, units.y * weight * (mixed - radiance), vec2(0.0))));
}

void virtual_surface_light(ivec2 p) {
    Random random = random_begin(uvec2(p), uint(VIRTUAL));
    vec4 point = imageLoad(in_position, ivec3(p, VIRTUAL));
    uvec4 id = imageLoad(in_hit, p);
    vec3 from_eye = (point.xyz - in_view.view.position) / point.w;
    Surface s = scene_surface(SceneHit(point.w, id.x, id.y, uintBitsToFloat(id.zw)), from_eye, point.w * pixel_angle());
    Lobes l = brdf_lobes(s, -from_eye);
    bool specular = brdf_choose_specular(l, random);
    vec3 origin = surface_origin(s);
    vec3 numbers = first_numbers(p, uint(VIRTUAL));
    Ray ray = trace(aim(origin, origin, s.normal, specular, s, l, -from_eye, numbers, random), origin, origin, s.normal, specular, s, l, -from_eye);
    vec3 weight = ray.weight / (specular ? l.specular_probability : (1.0 - l.specular_probability) / PI);
    if (dot(ray.d, s.geometric) <= 0.0) weight = vec3(0.0);
    vec3 radiance = vec3(0.0);
    if (max(weight.r, max(weight.g, weight.b)) > 0.0) {
        SceneHit hit = virtual_trace(origin, ray.d, ray.real.t, random);
        radiance = weight * incoming(origin, ray, hit, random);
    }
    if (FAULT == FAULT_ENERGY_CLAMP) radiance *= min(1.0, 0.3 / max(luminance(radiance), 1e-20));
    radiance *= in_view.view.light_units.y;
    vec3 lambert = specular ? vec3(0.0) : radiance;
    imageStore(out_irradiance, ivec3(p, VIRTUAL), light_pack(Light(lambert, radiance - lambert, vec2(0.0))));
}

void main() {
    uint k = list_group() * 64u + gl_LocalInvocationIndex;
    if (k >= in_arguments.word[LAYER * 4 + 3]) return;
    uint item = in_list.item[uint(LAYER) * in_view.view.size.x * in_view.view.size.y + k];
    ivec2 p = ivec2(item & 0xffffu, item >> 16u);
    if (LAYER == REAL) real_surface_light(p);
    else virtual_surface_light(p);
}
