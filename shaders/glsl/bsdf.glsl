// The BSDF of a virtual surface: glTF 2.0 metallic-roughness and the lobes of its extensions. A lobe is a value.
// Who follows a path asks for the lobes of a surface (bsdf_lobes), chooses one (bsdf_choose), draws a direction of
// it (bsdf_sample), and asks for its value and density for any pair of directions (bsdf_evaluate).
//
// From the outside in: sheen, clear coat, GGX, and below that Lambert or what passes through. Each layer leaves
// to those below what its own directional albedo towards the eye does not take. The GGX lobes are scaled by
// 1 + F0 (1/E - 1) (Turquin 2019) to make up for the missing multiple scattering.

const uint DIFFUSE = 0u;     // Lambert
const uint GLOSSY = 1u;      // GGX (alpha = roughness^2), height-correlated Smith, Schlick
const uint COAT = 2u;        // the same of a clear coat
const uint SHEEN_LOBE = 3u;  // Charlie (Estevez and Kulla 2017), visibility by Neubelt and Pettineo 2013
const uint TRANSMITTED = 4u; // through a thin sheet, or the whole boundary of a solid, its reflection included

const int ENERGY_SIZE = 32;

vec2 energy_at(int first, float cosine, float roughness) {
    vec2 p = clamp(vec2(cosine, roughness), 0.0, 1.0) * float(ENERGY_SIZE - 1);
    ivec2 i = min(ivec2(p), ivec2(ENERGY_SIZE - 2));
    vec2 f = p - vec2(i);
    int k = first + i.y * ENERGY_SIZE + i.x;
    return mix(mix(in_energy.value[k], in_energy.value[k + 1], f.x),
               mix(in_energy.value[k + ENERGY_SIZE], in_energy.value[k + ENERGY_SIZE + 1], f.x), f.y);
}

vec2 ggx_energy(float cosine, float roughness) { return energy_at(0, cosine, roughness); }
float sheen_energy(float cosine, float roughness) { return energy_at(ENERGY_SIZE * ENERGY_SIZE, cosine, roughness).x; }

// What the lobes of a surface are worth towards the eye.
struct Lobes {
    vec3 diffuse; // albedo
    vec3 scale;   // factor on the GGX lobe
    vec3 coat;    // factor on the coat's
    vec3 sheen;   // factor on the sheen lobe
    vec3 through; // albedo of what is transmitted
    // With which probability each is chosen.
    float choose_glossy;
    float choose_coat;
    float choose_sheen;
    float choose_through;
};

// The lobes of a real surface: Lambert of albedo 1.
Lobes lambert_lobes() { return Lobes(vec3(1.0), vec3(1.0), vec3(0.0), vec3(0.0), vec3(0.0), 0.0, 0.0, 0.0, 0.0); }

const float COAT_F0 = 0.04;

float largest(vec3 v) { return max(v.r, max(v.g, v.b)); }

Lobes bsdf_lobes(Surface s, vec3 to_eye) {
    Lobes l = lambert_lobes();
    l.diffuse = s.base_color * (1.0 - s.metallic);
    if (SPECULAR == 0u) return l;
    float cosine = dot(s.normal, to_eye), beneath = 1.0; // what layers further out leave
    float sheen = 0.0, coat = 0.0;
    if (SHEEN != 0u) {
        float e = sheen_energy(cosine, s.sheen_roughness);
        l.sheen = s.sheen_color / max(e, 1.0);
        sheen = luminance(l.sheen) * e;
        beneath *= 1.0 - largest(l.sheen) * e;
    }
    if (CLEARCOAT != 0u) {
        vec2 e = ggx_energy(dot(s.clearcoat_normal, to_eye), s.clearcoat_roughness);
        float scale = beneath * s.clearcoat * (1.0 + COAT_F0 * (1.0 / max(e.x + e.y, 1e-3) - 1.0));
        coat = min((COAT_F0 * e.x + e.y) * scale, beneath);
        l.coat = vec3(scale);
        beneath -= coat;
    }
    vec2 e = ggx_energy(cosine, s.roughness);
    float kept = 1.0; // the share that is no boundary of a clear solid
    if (TRANSMISSION != 0u && s.solid) kept -= s.transmission;
    l.scale = 1.0 + s.f0 * (1.0 / max(e.x + e.y, 1e-3) - 1.0);
    vec3 albedo = min((s.f0 * e.x + s.f90 * e.y) * l.scale, vec3(1.0));
    float left = 1.0 - largest(albedo);
    l.diffuse *= left;
    if (TRANSMISSION != 0u) {
        l.through = s.solid ? vec3(beneath * s.transmission) : beneath * left * s.transmission * s.base_color;
        l.diffuse *= 1.0 - s.transmission;
    }
    if (CLEARCOAT != 0u || SHEEN != 0u || TRANSMISSION != 0u) {
        l.scale *= beneath * kept;
        albedo *= beneath * kept;
        l.diffuse *= beneath;
    }
    float ws = luminance(albedo), wd = luminance(l.diffuse), rest = 1.0;
    if (CLEARCOAT != 0u || SHEEN != 0u || TRANSMISSION != 0u) {
        vec3 others = vec3(coat, sheen, luminance(l.through));
        float all = max(ws + wd + others.x + others.y + others.z, 1e-20);
        others = mix(vec3(0.0), clamp(others / all, 0.1, 1.0), greaterThan(others, vec3(0.0)));
        float sum = others.x + others.y + others.z, most = ws + wd > 0.0 ? 0.9 : 1.0;
        if (sum > most || ws + wd <= 0.0) others *= most / max(sum, 1e-20);
        l.choose_coat = others.x;
        l.choose_sheen = others.y;
        l.choose_through = others.z;
        rest = max(1.0 - (others.x + others.y + others.z), 0.0);
    }
    l.choose_glossy = rest * (ws <= 0.0 ? 0.0 : wd <= 0.0 ? 1.0 : clamp(ws / (ws + wd), 0.1, 0.9));
    return l;
}

// Chooses a lobe by a number from 0 to 1.
uint bsdf_choose(Lobes l, float u) {
    if (SPECULAR == 0u) return DIFFUSE;
    if (u < l.choose_glossy) return GLOSSY;
    u -= l.choose_glossy;
    if (CLEARCOAT != 0u) { if (u < l.choose_coat) return COAT; u -= l.choose_coat; }
    if (SHEEN != 0u) { if (u < l.choose_sheen) return SHEEN_LOBE; u -= l.choose_sheen; }
    if (TRANSMISSION != 0u && u < l.choose_through) return TRANSMITTED;
    return DIFFUSE;
}

float bsdf_probability(Lobes l, uint lobe) {
    if (SPECULAR == 0u) return 1.0;
    float p = lobe == GLOSSY ? l.choose_glossy : 1.0 - l.choose_glossy - l.choose_coat - l.choose_sheen - l.choose_through;
    if (CLEARCOAT != 0u && lobe == COAT) p = l.choose_coat;
    if (SHEEN != 0u && lobe == SHEEN_LOBE) p = l.choose_sheen;
    if (TRANSMISSION != 0u && lobe == TRANSMITTED) p = l.choose_through;
    return max(p, 1e-6);
}

float smith_lambda(float cosine, float alpha) {
    float c2 = cosine * cosine;
    return 0.5 * (sqrt(1.0 + alpha * alpha * (1.0 - c2) / max(c2, 1e-12)) - 1.0);
}

// Below this alpha a lobe is a mirror.
const float MIRROR_ALPHA = 1e-3;

// A GGX lobe. `alpha` is along the tangent and across it.
struct Ggx { vec3 normal; vec3 tangent; vec2 alpha; vec3 f0; float f90; vec3 scale; };

Ggx ggx_of(Surface s, Lobes l, uint lobe) {
    float alpha = s.roughness * s.roughness;
    Ggx g = Ggx(s.normal, vec3(0.0), vec2(alpha), s.f0, s.f90, l.scale);
    if (ANISOTROPY != 0u) {
        g.tangent = s.tangent;
        g.alpha.x = mix(alpha, 1.0, s.anisotropy * s.anisotropy);
        if (g.alpha.x >= MIRROR_ALPHA) g.alpha.y = max(alpha, MIRROR_ALPHA);
    }
    if (CLEARCOAT != 0u && lobe == COAT) {
        g = Ggx(s.clearcoat_normal, basis(s.clearcoat_normal)[0], vec2(s.clearcoat_roughness * s.clearcoat_roughness), vec3(COAT_F0), 1.0, l.coat);
    }
    return g;
}

// Schlick 1994.
vec3 ggx_fresnel(Ggx g, float cosine) {
    float x = clamp(1.0 - cosine, 0.0, 1.0), x2 = x * x;
    return g.f0 + (vec3(g.f90) - g.f0) * (x2 * x2 * x);
}

// Smith's Lambda of a direction of a cosine.
float ggx_lambda(Ggx g, vec3 v, float cosine) {
    if (ANISOTROPY == 0u) return smith_lambda(cosine, g.alpha.x);
    vec2 across = vec2(dot(g.tangent, v), dot(cross(g.normal, g.tangent), v)) * g.alpha;
    return 0.5 * (sqrt(1.0 + dot(across, across) / max(cosine * cosine, 1e-12)) - 1.0);
}

// Returns f*cos of a GGX lobe for a pair of directions, and the density with which ggx_sample draws `d`.
vec3 ggx_evaluate(Ggx g, vec3 geometric, vec3 to_eye, vec3 d, out float density) {
    density = 0.0;
    float no = max(dot(g.normal, to_eye), 1e-4), ni = dot(g.normal, d);
    if (g.alpha.x < MIRROR_ALPHA || ni <= 0.0 || dot(d, geometric) <= 0.0) return vec3(0.0);
    vec3 h = normalize(to_eye + d);
    float nh = max(dot(g.normal, h), 0.0), oh = max(dot(to_eye, h), 0.0), distribution;
    vec3 aside = cross(g.normal, h); // its square is 1 - nh^2, without cancellation
    if (ANISOTROPY == 0u) {
        float a2 = g.alpha.x * g.alpha.x, k = nh * nh * a2 + dot(aside, aside);
        distribution = a2 / (PI * k * k);
    } else {
        // With B = cross(n, T): dot(aside, B) = dot(h, T) and dot(aside, T) = -dot(h, B).
        vec2 along = vec2(dot(aside, cross(g.normal, g.tangent)), dot(aside, g.tangent)) / g.alpha;
        float k = nh * nh + dot(along, along);
        distribution = 1.0 / (PI * g.alpha.x * g.alpha.y * k * k);
    }
    float lo = ggx_lambda(g, to_eye, no), li = ggx_lambda(g, d, ni);
    density = distribution / ((1.0 + lo) * 4.0 * no);
    return ggx_fresnel(g, oh) * g.scale * (distribution / (4.0 * no * (1.0 + lo + li)));
}

mat3 ggx_frame(Ggx g) {
    return ANISOTROPY == 0u ? basis(g.normal) : mat3(g.tangent, cross(g.normal, g.tangent), g.normal);
}

// Draws a half vector by visible normals (Dupuy and Benyoub 2023), in the lobe's frame. o.z > 0.
vec3 ggx_half(vec2 alpha, vec3 o, vec2 u) {
    vec3 stretched = normalize(vec3(o.xy * alpha, o.z));
    float z = (1.0 - u.y) * (1.0 + stretched.z) - stretched.z;
    float r = sqrt(clamp(1.0 - z * z, 0.0, 1.0));
    vec3 h = vec3(r * circle(u.x), z) + stretched;
    return normalize(vec3(h.xy * alpha, max(h.z, 1e-6)));
}

// Draws a direction of a GGX lobe. The weight f*cos/p of a mirror is `mirror`.
vec3 ggx_sample(Ggx g, vec3 geometric, vec3 to_eye, vec2 u, out vec3 mirror) {
    mat3 frame = ggx_frame(g);
    vec3 o = to_eye * frame;
    o.z = max(o.z, 1e-4);
    vec3 h = vec3(0.0, 0.0, 1.0);
    mirror = vec3(0.0);
    if (g.alpha.x >= MIRROR_ALPHA) h = ggx_half(g.alpha, o, u);
    else mirror = ggx_fresnel(g, o.z) * g.scale;
    vec3 d = normalize(frame * reflect(-o, h));
    if (dot(d, geometric) <= 0.0) mirror = vec3(0.0);
    return d;
}

// Fresnel's equations for unpolarised light. `eta` is the index of refraction before the boundary, relative to
// that behind it.
float dielectric_fresnel(float cosine, float eta) {
    float sine2 = eta * eta * max(1.0 - cosine * cosine, 0.0);
    if (sine2 >= 1.0) return 1.0;
    float behind = sqrt(1.0 - sine2);
    float s = (eta * cosine - behind) / (eta * cosine + behind), p = (cosine - eta * behind) / (cosine + eta * behind);
    return 0.5 * (s * s + p * p);
}

// The colour of a path that a solid has parted from the others: 0 to 2, or WHITE.
const uint WHITE = 3u;
uint path_color = WHITE;

// Returns a solid's relative index of refraction for the path's colour (KHR_materials_dispersion).
float dispersed_eta(Surface s) {
    float ior = s.inside ? s.eta : 1.0 / s.eta;
    ior += (ior - 1.0) * s.dispersion * (float(path_color) - 1.0);
    return s.inside ? ior : 1.0 / ior;
}

// Draws a direction of what is transmitted, and its weight. A thin sheet lets the reflected lobe out on its other
// side. A solid's boundary reflects or refracts at each of its facets; a direction that its own facets would block
// is mirrored to the side where it belongs, so that nothing is lost between them.
vec3 through_sample(Surface s, Lobes l, vec3 to_eye, vec3 u, out vec3 weight) {
    mat3 frame = basis(s.normal);
    vec3 o = to_eye * frame;
    o.z = max(o.z, 1e-4);
    o = normalize(o);
    float alpha = s.roughness * s.roughness;
    vec3 h = alpha >= MIRROR_ALPHA ? ggx_half(vec2(alpha), o, u.xy) : vec3(0.0, 0.0, 1.0);
    weight = l.through;
    vec3 d = reflect(-o, h);
    bool reflected = s.solid;
    if (s.solid) {
        float cosine = clamp(dot(o, h), 0.0, 1.0);
        reflected = u.z < dielectric_fresnel(cosine, s.eta);
        if (!reflected) {
            if (s.dispersion > 0.0 && path_color == WHITE) {
                float f = dielectric_fresnel(cosine, s.eta); // what u.z has told already
                path_color = min(uint(3.0 * (u.z - f) / max(1.0 - f, 1e-6)), 2u);
                weight *= 3.0 * vec3(equal(uvec3(path_color), uvec3(0u, 1u, 2u)));
            }
            if (path_color != WHITE) s.eta = dispersed_eta(s);
            d = refract(-o, h, s.eta);
            if (d == vec3(0.0)) { d = reflect(-o, h); reflected = true; }
            // Light passes two boundaries of a solid of this colour.
            else weight *= sqrt(s.base_color);
        }
    } else if (alpha < MIRROR_ALPHA) d = -o;
    d.z = reflected ? abs(d.z) : -abs(d.z);
    d.z = reflected ? max(d.z, 1e-4) : min(d.z, -1e-4);
    vec3 world = normalize(frame * d);
    // The same with the triangle's own plane, from which shading normals differ.
    float side = dot(world, s.geometric);
    if (reflected ? side <= 0.0 : side >= 0.0) world = normalize(world - s.geometric * (side + (reflected ? -1e-3 : 1e-3)));
    return world;
}

// Says whether a lobe has no density: what it draws cannot be found by aiming elsewhere.
bool bsdf_is_sharp(Surface s, uint lobe) {
    bool sharp = lobe == GLOSSY && ggx_of(s, lambert_lobes(), lobe).alpha.x < MIRROR_ALPHA;
    if (CLEARCOAT != 0u && lobe == COAT) sharp = s.clearcoat_roughness * s.clearcoat_roughness < MIRROR_ALPHA;
    return sharp || (TRANSMISSION != 0u && lobe == TRANSMITTED);
}

bool lobe_is_ggx(uint lobe) { return lobe == GLOSSY || (CLEARCOAT != 0u && lobe == COAT); }

// Draws a direction of a lobe. The weight f*cos/p of a sharp lobe is `sharp`.
vec3 bsdf_sample(Surface s, Lobes l, uint lobe, vec3 to_eye, vec3 u, out vec3 sharp) {
    sharp = vec3(0.0);
    vec3 d;
    if (SPECULAR != 0u && lobe_is_ggx(lobe)) d = ggx_sample(ggx_of(s, l, lobe), s.geometric, to_eye, u.xy, sharp);
    else d = sample_cosine(s.normal, u.xy);
    if (TRANSMISSION != 0u && lobe == TRANSMITTED) d = through_sample(s, l, to_eye, u, sharp);
    return d;
}

// Says whether a direction leaves the surface as a lobe can send it.
bool bsdf_leaves(Surface s, uint lobe, vec3 d) {
    return dot(d, s.geometric) > 0.0 || (TRANSMISSION != 0u && lobe == TRANSMITTED);
}

const float LEAST_SHEEN = 0.2; // roughness

// Returns f*cos of the sheen lobe of colour 1.
float sheen_evaluate(Surface s, vec3 to_eye, vec3 d) {
    float roughness = max(s.sheen_roughness, LEAST_SHEEN), inverse = 1.0 / (roughness * roughness);
    float no = max(dot(s.normal, to_eye), 1e-4), ni = max(dot(s.normal, d), 0.0);
    vec3 h = normalize(to_eye + d);
    vec3 aside = cross(s.normal, h);
    float sine = sqrt(clamp(dot(aside, aside), 1e-12, 1.0));
    float distribution = (2.0 + inverse) * pow(sine, inverse) / (2.0 * PI);
    return distribution * ni / (4.0 * max(no + ni - no * ni, 1e-4));
}

// Returns f*cos of a lobe for a pair of directions, and the density with which bsdf_sample draws `d`. Both are
// zero for a sharp lobe.
vec3 bsdf_evaluate(Surface s, Lobes l, uint lobe, vec3 to_eye, vec3 d, out float density) {
    if (SPECULAR != 0u && lobe_is_ggx(lobe)) return ggx_evaluate(ggx_of(s, l, lobe), s.geometric, to_eye, d, density);
    density = max(dot(s.normal, d), 0.0) / PI;
    if (TRANSMISSION != 0u && lobe == TRANSMITTED) { density = 0.0; return vec3(0.0); }
    if (SHEEN != 0u && lobe == SHEEN_LOBE) return l.sheen * sheen_evaluate(s, to_eye, d);
    return l.diffuse * density;
}

// Returns the extinction of what a path is in after it left a surface along d. A path that was in another solid before is
// in the open when it leaves the inner one.
vec3 medium_after(vec3 medium, Surface s, uint lobe, vec3 d) {
    if (TRANSMISSION == 0u || lobe != TRANSMITTED || !s.solid || dot(d, s.geometric) >= 0.0) return medium;
    return s.inside ? vec3(0.0) : s.extinction;
}

// Returns what the medium lets pass of light from a surface so far away. Whatever was known of the path, a surface that
// is met from inside a solid is seen through that.
vec3 medium_passes(vec3 medium, Surface s, float distance) {
    if (TRANSMISSION == 0u) return vec3(1.0);
    return exp(-(s.solid && s.inside && s.transmission > 0.0 ? s.extinction : medium) * distance);
}

const float WIDEST_SPREAD = 0.05; // radians

// Returns how far apart the directions are, radians, that one path of a lobe stands for where it reads textures.
float lobe_spread(Surface s, uint lobe) {
    if (lobe == DIFFUSE || lobe == SHEEN_LOBE) return WIDEST_SPREAD;
    float roughness = CLEARCOAT != 0u && lobe == COAT ? s.clearcoat_roughness : s.roughness;
    return min(WIDEST_SPREAD, 0.5 * roughness * roughness);
}
