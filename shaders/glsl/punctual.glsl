// Lights without a surface (glTF's KHR_lights_punctual). No ray meets them, so they are drawn for each surface.

// As `Punctual` in scene/packed.rs.
struct Punctual { vec3 position; uint directional; vec3 direction; float range; vec3 intensity; float cone_scale; float cone_offset; };
layout(set = 0, binding = 75, scalar) readonly buffer PunctualLights { uint count; Punctual light[]; } in_punctual;

// Returns the irradiance across the direction `d` to the light, which is `distance` away.
vec3 punctual_irradiance(Punctual light, vec3 x, out vec3 d, out float distance) {
    d = -light.direction;
    distance = FAR;
    if (light.directional != 0u) return light.intensity;
    vec3 to = light.position - x;
    distance = length(to);
    d = to / max(distance, 1e-12);
    float cone = clamp(dot(light.direction, -d) * light.cone_scale + light.cone_offset, 0.0, 1.0);
    float faded = distance / light.range;
    float window = clamp(1.0 - faded * faded * faded * faded, 0.0, 1.0); // glTF's recommendation
    return light.intensity * (cone * cone * window / max(distance * distance, 1e-12));
}

// A light that was drawn, and what it brings by a lobe if nothing stands between, over the probability of drawing it.
// `weight` is 0 if none shines here.
struct PunctualChoice { vec3 d; float distance; vec3 brings; float weight; };

const uint PUNCTUAL_CANDIDATES = 8u;

// Draws one of a few lights by what it would bring (resampled importance sampling, Talbot et al. 2005).
PunctualChoice punctual_choose(vec3 x, Surface s, Lobes l, vec3 to_eye, uint lobe, inout Random random) {
    PunctualChoice chosen = PunctualChoice(vec3(0.0), 0.0, vec3(0.0), 0.0);
    uint count = min(in_punctual.count, PUNCTUAL_CANDIDATES);
    float total = 0.0;
    for (uint k = 0u; k < count; k++) {
        uint index = k;
        if (in_punctual.count > PUNCTUAL_CANDIDATES)
            index = min(uint(random_next(random) * float(in_punctual.count)), in_punctual.count - 1u);
        vec3 d;
        float distance, density;
        vec3 incident = punctual_irradiance(in_punctual.light[index], x, d, distance);
        if (dot(d, s.geometric) <= 0.0) continue;
        vec3 brings = bsdf_evaluate(s, l, lobe, to_eye, d, density) * incident;
        float weight = luminance(brings);
        total += weight;
        if (weight > 0.0 && random_next(random) * total < weight) chosen = PunctualChoice(d, distance, brings, weight);
    }
    if (chosen.weight > 0.0) chosen.brings *= total * float(in_punctual.count) / (chosen.weight * float(count));
    return chosen;
}
