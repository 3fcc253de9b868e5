// The panorama as a light. Directions about its centre are drawn in proportion to how much brighter than the
// mean they are, and the density of a drawn direction is known as seen from anywhere. A cell's weight is its
// solid angle times its luminance above the mean, so that only lamps and windows are drawn, and BRDF sampling
// keeps the rest. `light_table.comp` fills the table: header (share of drawing lights, total weight,
// share of the light that the last video frame changed), cumulative row weights, cumulative cell weights in each
// row, cell weights, cell luminances, and how these changed in the last video frame.
layout(constant_id = 7) const uint DIRECTIONS = 2; // which strategies draw directions (`Directions` in settings.rs)
const uint BRDF = 0u, LIGHT = 1u;

const ivec2 LIGHT_CELLS = ivec2(256, 128);
const int LIGHT_ROWS_AT = 0;
const int LIGHT_CUMULATIVE_AT = 128;
const int LIGHT_WEIGHTS_AT = 128 + 256 * 128;
const int LIGHT_LUMINANCES_AT = 128 + 2 * 256 * 128;
const int LIGHT_CHANGES_AT = 128 + 3 * 256 * 128;

ivec2 light_cell(vec2 uv) { return clamp(ivec2(uv * vec2(LIGHT_CELLS)), ivec2(0), LIGHT_CELLS - 1); }

// Draws a direction from the panorama's centre.
vec3 light_sample(vec2 u, vec2 within) {
    float x = u.x * in_lights.total;
    int lo = 0, hi = LIGHT_CELLS.y - 1;
    while (lo < hi) {
        int mid = (lo + hi) / 2;
        if (in_lights.value[LIGHT_ROWS_AT + mid] > x) hi = mid; else lo = mid + 1;
    }
    int row = lo, first = LIGHT_CUMULATIVE_AT + row * LIGHT_CELLS.x;
    x = u.y * in_lights.value[first + LIGHT_CELLS.x - 1];
    lo = 0; hi = LIGHT_CELLS.x - 1;
    while (lo < hi) {
        int mid = (lo + hi) / 2;
        if (in_lights.value[first + mid] > x) hi = mid; else lo = mid + 1;
    }
    vec2 uv = (vec2(lo, row) + within) / vec2(LIGHT_CELLS);
    vec2 phi = circle(uv.x - 0.5 - (FAULT == FAULT_YAW_FORGOTTEN ? 0.0 : in_view.view.yaw / (2.0 * PI))), theta = circle(0.5 * uv.y);
    return vec3(theta.y * phi.y, theta.x, -theta.y * phi.x);
}

// Returns the density of light_sample per solid angle about the centre.
float light_density_centre(vec2 uv) {
    ivec2 cell = light_cell(uv);
    float p = in_lights.value[LIGHT_WEIGHTS_AT + cell.y * LIGHT_CELLS.x + cell.x] / max(in_lights.total, 1e-20);
    return p * float(LIGHT_CELLS.x * LIGHT_CELLS.y) / (2.0 * PI * PI * max(circle(0.5 * uv.y).y, 1e-4));
}

// Returns the same per solid angle about x, for what a ray from x along d met: p_c·(r² cos θ_c)/(D² cos θ_x)
// on a surface, p_c where the ray left, and 0 on skirts.
float light_density(vec3 x, vec3 d, PanoramaHit hit) {
    if (is_skirt(hit) || in_lights.share <= 0.0) return 0.0;
    float p = light_density_centre(hit.uv);
    if (hit.kind == FREE) return p;
    vec3 point = x + d * hit.t;
    float distance2 = dot(point, point);
    float cos_c = abs(dot(hit.normal, point)) * inversesqrt(max(distance2, 1e-20)), cos_x = abs(dot(hit.normal, d));
    return p * hit.t * hit.t * cos_c / max(distance2 * cos_x, 1e-12);
}
