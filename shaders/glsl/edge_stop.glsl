// Weighs how well two pixels lie on one surface, for interpolate, temporal and atrous.

// `scale` is the distance between the pixels on the surface, in metres. The plane distance is compared with
// it and with the depth noise of a capture, half a percent of the distance.
float geometry_weight(vec4 position, vec4 normal, float id, vec4 other_position, vec4 other_normal, float other_id, float scale) {
    if (FAULT == FAULT_FILTER_BLIND) return 1.0;
    if (other_position.w <= 0.0 || other_id != id) return 0.0;
    float plane = abs(dot(normal.xyz, other_position.xyz - position.xyz));
    float facing = max(0.0, dot(normal.xyz, other_normal.xyz));
    float n = facing * facing;
    n *= n; n *= n; n *= n; n *= n; // facing^32
    return n * exp(-plane / (0.5 * scale + 0.005 * position.w));
}
