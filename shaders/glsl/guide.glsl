// A surface in 16 bytes: position (m), the normal in steps of 1/127, and the object. The position's lowest bits, a
// millionth of it, hold more: those of x the roughness, those of y HIDDEN, and those of y and z the normal in quarters
// of its steps. A lamp has a position and is NO_SURFACE.

const uint NO_SURFACE = 0u;
const uint REAL_SURFACE = 1u;
const uint HIDDEN = 1u; // a real surface of which objects leave nothing to be seen: it is not lit

// Returns a number of 2 to 255.
uint guide_object(uint instance_id) { return 2u + instance_id % 254u; }

uvec4 guide_pack(vec3 position, vec3 normal, float roughness, uint object) {
    uvec3 p = floatBitsToUint(position) & ~15u;
    ivec3 steps = ivec3(round(normal * 127.0));
    uvec3 n = uvec3(steps) & 0xffu, q = uvec3(clamp(ivec3(round(normal * (4.0 * 127.0))) - 4 * steps, -2, 1) + 2);
    p |= uvec3(uint(clamp(roughness, 0.0, 1.0) * 15.0 + 0.5), q.x << 1 | (q.y & 1u) << 3, q.y >> 1 | q.z << 1);
    return uvec4(p, n.x | n.y << 8 | n.z << 16 | object << 24);
}

uint guide_id(uvec4 guide) { return (guide.y & HIDDEN) != 0u ? NO_SURFACE : guide.w >> 24; }
vec3 guide_position(uvec4 guide) { return uintBitsToFloat(guide.xyz); }
bool guide_has_position(uvec4 guide) { return any(greaterThan(guide.xyz, uvec3(15u))); }
float guide_roughness(uvec4 guide) { return float(guide.x & 15u) * (1.0 / 15.0); }

// Returns the normal, times 127.
vec3 guide_normal(uvec4 guide) { return vec3((ivec3(guide.www) << ivec3(24, 16, 8)) >> 24); }

// Returns the unit normal, to 0.1 degree.
vec3 guide_unit_normal(uvec4 guide) {
    vec3 quarters = vec3((guide.y >> 1) & 3u, (guide.y >> 3 & 1u) | (guide.z & 1u) << 1, (guide.z >> 1) & 3u);
    return normalize(4.0 * guide_normal(guide) + quarters - 2.0);
}

// Returns how far a neighbour's normal is turned, as facing^32, or 0 if it is another object.
float guide_facing(uvec4 guide, vec3 normal, uvec4 other) {
    if (FAULT == FAULT_FILTER_BLIND) return 1.0;
    float facing = max(0.0, dot(normal, guide_normal(other)) * (1.0 / (127.0 * 127.0)));
    float n = facing * facing;
    n *= n; n *= n; n *= n; n *= n;
    return guide_id(other) == guide_id(guide) ? n : 0.0;
}

// Returns how far a neighbour is from the tangent plane, metres. `normal` is as guide_normal gives it.
float guide_off_plane(vec3 position, vec3 normal, uvec4 other) {
    if (FAULT == FAULT_FILTER_BLIND) return 0.0;
    return abs(dot(normal, guide_position(other) - position)) * (1.0 / 127.0);
}

// Returns how far from the plane a neighbour may be at a reach of so many pixels: half the distance between
// the two, and the depth noise of a capture, half a percent of the distance from the camera.
float guide_tolerance(float distance, float reach) { return distance * (0.5 * pixel_angle() * reach + 0.005); }
