// Small lamps that hang free (panorama/lamps.rs): ellipsoids of even radiance before the panorama's surface,
// from which they are left out. A ray meets them, and directions towards them are drawn evenly over the cone
// that they fill. In the space in which an ellipsoid is a ball of radius 1, that cone is round.
layout(constant_id = 30) const uint FREE_LAMPS = 0; // 1: there may be some

const uint MOST_LAMPS = 32u;
const uint LAMP = 4u; // a hit of lamp k is of kind LAMP + k

uint lamp_count() { return FREE_LAMPS != 0u ? min(in_lamps.count, MOST_LAMPS) : 0u; }

vec3 lamp_unit(uint k, vec3 v) {
    return vec3(dot(in_lamps.lamp[k].unit_x, v), dot(in_lamps.lamp[k].unit_y, v), dot(in_lamps.lamp[k].unit_z, v));
}

// Returns where a ray meets a lamp, FAR if it does not. From within there is no lamp.
float lamp_distance(uint k, vec3 origin, vec3 d) {
    vec3 to = lamp_unit(k, in_lamps.lamp[k].center - origin), e = lamp_unit(k, d);
    float ee = dot(e, e), along = dot(to, e) / ee;
    vec3 off = to - along * e;
    float h = 1.0 - dot(off, off), t = along - sqrt(max(h, 0.0) / ee);
    return h > 0.0 && t > 0.0 && dot(to, to) > 1.0 ? t : FAR;
}

// Lets a lamp before it stand for what a ray hit.
void lamps_meet(vec3 origin, vec3 d, inout PanoramaHit hit) {
    if (FREE_LAMPS == 0u) return;
    for (uint k = 0u; k < lamp_count(); k++) {
        float t = lamp_distance(k, origin, d);
        if (t < hit.t) {
            hit.t = t;
            hit.kind = LAMP + k;
        }
    }
}

bool is_lamp(PanoramaHit hit) { return FREE_LAMPS != 0u && hit.kind >= LAMP; }

vec3 lamp_radiance(PanoramaHit hit) { return in_lamps.lamp[min(hit.kind - LAMP, MOST_LAMPS - 1u)].radiance; }

// Returns what the panorama would show in a direction without the lamps: behind a lamp the mean of what
// surrounds it.
vec3 without_lamps(vec3 d, vec3 radiance) {
    if (FREE_LAMPS == 0u) return radiance;
    for (uint k = 0u; k < lamp_count(); k++) {
        float along = dot(d, in_lamps.lamp[k].direction);
        vec2 off = vec2(dot(d, in_lamps.lamp[k].across_x), dot(d, in_lamps.lamp[k].across_y));
        if (along > 0.0 && dot(off, off) < along * along) radiance = in_lamps.lamp[k].around;
    }
    return radiance;
}

// Returns 1 - the cosine of the half angle of the cone that a lamp fills, in the lamp's space; 0 within it.
float lamp_cone(uint k, vec3 x) {
    vec3 to = lamp_unit(k, in_lamps.lamp[k].center - x);
    float sine2 = 1.0 / dot(to, to);
    return sine2 < 0.9999 ? sine2 / (1.0 + sqrt(1.0 - sine2)) : 0.0;
}

// Returns by how much that space's solid angles are smaller.
float lamp_scale(uint k, vec3 d) {
    float e = length(lamp_unit(k, d));
    return e * e * e * in_lamps.lamp[k].volume;
}

// Returns what a lamp sends to the panorama's centre: luminance times solid angle.
float lamp_power(uint k) { return in_lamps.lamp[k].luminance * 2.0 * PI * lamp_cone(k, vec3(0.0)) * lamp_scale(k, in_lamps.lamp[k].direction); }

// Returns about what a lamp sends to a surface: luminance times solid angle; 0 if it is below the horizon.
float lamp_weight(uint k, vec3 x, vec3 normal) {
    vec3 way = in_lamps.lamp[k].center - x;
    vec3 high = vec3(dot(in_lamps.lamp[k].axis_x, normal), dot(in_lamps.lamp[k].axis_y, normal), dot(in_lamps.lamp[k].axis_z, normal));
    float height = dot(way, normal) + length(high), cone = lamp_cone(k, x);
    return height > 0.0 && cone > 0.0 ? in_lamps.lamp[k].luminance * 2.0 * PI * cone * lamp_scale(k, normalize(way)) : 0.0;
}

float lamps_weight(vec3 x, vec3 normal) {
    float sum = 0.0;
    for (uint k = 0u; k < lamp_count(); k++) sum += lamp_weight(k, x, normal);
    return sum;
}

// Draws a direction towards a lamp.
vec3 lamp_sample(uint k, vec3 x, vec2 u) {
    float below = u.x * lamp_cone(k, x), sine = sqrt(max(below * (2.0 - below), 0.0));
    vec3 e = basis(normalize(lamp_unit(k, in_lamps.lamp[k].center - x))) * vec3(sine * circle(u.y), 1.0 - below);
    return normalize(in_lamps.lamp[k].axis_x * e.x + in_lamps.lamp[k].axis_y * e.y + in_lamps.lamp[k].axis_z * e.z);
}

// Returns its density per solid angle in a direction in which the lamp is.
float lamp_density(uint k, vec3 x, vec3 d) {
    float cone = lamp_cone(k, x);
    return cone > 0.0 ? 1.0 / (2.0 * PI * cone * lamp_scale(k, d)) : 0.0;
}
