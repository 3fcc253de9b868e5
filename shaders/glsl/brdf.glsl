// glTF 2.0 metallic–roughness: a Lambert lobe under a GGX lobe (α = roughness²), height-correlated Smith,
// Schlick. The GGX lobe is scaled by 1 + F0 (1/E − 1) (Turquin 2019) to make up for the missing multiple
// scattering. The Lambert lobe gets what the GGX lobe leaves, 1 − ρ(μ_o).

const int ENERGY_SIZE = 32;

vec2 brdf_energy(float cosine, float roughness) {
    vec2 p = clamp(vec2(cosine, roughness), 0.0, 1.0) * float(ENERGY_SIZE - 1);
    ivec2 i = min(ivec2(p), ivec2(ENERGY_SIZE - 2));
    vec2 f = p - vec2(i);
    int k = i.y * ENERGY_SIZE + i.x;
    return mix(mix(in_energy.value[k], in_energy.value[k + 1], f.x),
               mix(in_energy.value[k + ENERGY_SIZE], in_energy.value[k + ENERGY_SIZE + 1], f.x), f.y);
}

struct Lobes {
    vec3 diffuse;       // k_V·(1 − ρ): the Lambert lobe's albedo
    vec3 scale;         // multiple-scattering factor of the GGX lobe
    float specular_probability;
};

Lobes brdf_lobes(Surface s, vec3 to_eye) {
    Lobes l;
    if (SPECULAR == 0u) return Lobes(s.base_color * (1.0 - s.metallic), vec3(1.0), 0.0);
    vec2 e = brdf_energy(dot(s.normal, to_eye), s.roughness);
    l.scale = 1.0 + s.f0 * (1.0 / max(e.x + e.y, 1e-3) - 1.0);
    vec3 albedo = min((s.f0 * e.x + s.f90 * e.y) * l.scale, vec3(1.0));
    l.diffuse = s.base_color * (1.0 - s.metallic) * (1.0 - max(albedo.r, max(albedo.g, albedo.b)));
    float ws = luminance(albedo), wd = luminance(l.diffuse);
    l.specular_probability = ws <= 0.0 ? 0.0 : wd <= 0.0 ? 1.0 : clamp(ws / (ws + wd), 0.1, 0.9);
    return l;
}

// Draws one of the two lobes.
bool brdf_choose_specular(Lobes l, inout Random random) {
    float u = random_next(random);
    return SPECULAR != 0u && u < l.specular_probability;
}

float smith_lambda(float cosine, float alpha) {
    float c2 = cosine * cosine;
    return 0.5 * (sqrt(1.0 + alpha * alpha * (1.0 - c2) / max(c2, 1e-12)) - 1.0);
}

// Schlick 1994.
vec3 brdf_fresnel(Surface s, float cosine) {
    float x = clamp(1.0 - cosine, 0.0, 1.0), x2 = x * x;
    return s.f0 + (vec3(s.f90) - s.f0) * (x2 * x2 * x);
}

// Below this α the lobe is a mirror.
const float MIRROR_ALPHA = 1e-3;

// Returns the GGX lobe for a pair of directions, f·cos θ_i, and the density with which brdf_sample_specular
// draws `d`. It is zero for a mirror.
vec3 brdf_specular(Surface s, Lobes l, vec3 to_eye, vec3 d, out float density) {
    float alpha = s.roughness * s.roughness;
    density = 0.0;
    float no = max(dot(s.normal, to_eye), 1e-4), ni = dot(s.normal, d);
    if (alpha < MIRROR_ALPHA || ni <= 0.0 || dot(d, s.geometric) <= 0.0) return vec3(0.0);
    vec3 h = normalize(to_eye + d);
    float nh = max(dot(s.normal, h), 0.0), oh = max(dot(to_eye, h), 0.0);
    vec3 aside = cross(s.normal, h); // its square is 1 − nh², without cancellation
    float a2 = alpha * alpha, k = nh * nh * a2 + dot(aside, aside);
    float distribution = a2 / (PI * k * k);
    float lo = smith_lambda(no, alpha), li = smith_lambda(ni, alpha);
    density = distribution / ((1.0 + lo) * 4.0 * no);
    return brdf_fresnel(s, oh) * l.scale * (distribution / (4.0 * no * (1.0 + lo + li)));
}

// Draws a direction of the GGX lobe by visible normals (Dupuy and Benyoub 2023). The weight f·cos/p of a
// mirror is `mirror`.
vec3 brdf_sample_specular(Surface s, Lobes l, vec3 to_eye, vec2 u, out vec3 mirror) {
    float alpha = s.roughness * s.roughness;
    mat3 frame = basis(s.normal);
    vec3 o = to_eye * frame;
    o.z = max(o.z, 1e-4);
    vec3 h = vec3(0.0, 0.0, 1.0);
    mirror = vec3(0.0);
    if (alpha >= MIRROR_ALPHA) {
        vec3 stretched = normalize(vec3(o.xy * alpha, o.z));
        float z = (1.0 - u.y) * (1.0 + stretched.z) - stretched.z;
        float r = sqrt(clamp(1.0 - z * z, 0.0, 1.0));
        h = vec3(r * circle(u.x), z) + stretched;
        h = normalize(vec3(h.xy * alpha, max(h.z, 1e-6)));
    } else mirror = brdf_fresnel(s, o.z) * l.scale;
    vec3 d = normalize(frame * reflect(-o, h));
    if (dot(d, s.geometric) <= 0.0) mirror = vec3(0.0);
    return d;
}
