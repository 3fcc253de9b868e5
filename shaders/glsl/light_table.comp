#version 460
#extension GL_GOOGLE_include_directive : require
// Per video frame, light_table (second dispatch, one workgroup): weights above the mean and their cumulative
// sums. A thread owns a row of cells.
// In/out: lights.
#include "common.glsl"
#include "panorama.glsl"
#include "light.glsl"
layout(local_size_x = 128) in;

shared float row_sum[128];
shared vec2 row_changed[128]; // by how much, and what there was before
shared float mean;

void main() {
    int row = int(gl_LocalInvocationIndex);
    int weights = LIGHT_WEIGHTS_AT + row * LIGHT_CELLS.x, cumulative = LIGHT_CUMULATIVE_AT + row * LIGHT_CELLS.x;
    float solid_angle = (circle(0.5 * float(row) / float(LIGHT_CELLS.y)).x - circle(0.5 * float(row + 1) / float(LIGHT_CELLS.y)).x) * 2.0 * PI / float(LIGHT_CELLS.x);
    float sum = 0.0, before = 0.0, changed = 0.0;
    for (int x = 0; x < LIGHT_CELLS.x; x++) {
        float now = lights.value[weights + x], change = lights.value[LIGHT_CHANGES_AT + row * LIGHT_CELLS.x + x];
        sum += now * solid_angle;
        before += (now - change) * solid_angle;
        changed += abs(change) * solid_angle;
    }
    row_sum[row] = sum;
    row_changed[row] = vec2(changed, before);
    barrier();
    if (row == 0) {
        float total = 0.0;
        vec2 changed = vec2(0.0);
        for (int r = 0; r < LIGHT_CELLS.y; r++) {
            total += row_sum[r];
            changed += row_changed[r];
        }
        mean = total / (4.0 * PI);
        lights.changed = changed.x / max(max(total, changed.y), 1e-20);
    }
    barrier();
    sum = 0.0;
    for (int x = 0; x < LIGHT_CELLS.x; x++) {
        float l = lights.value[weights + x];
        // If all rays are drawn from the table, it covers the whole panorama, black texels included.
        float w = (DIRECTIONS == LIGHT ? l + 0.1 * mean : max(0.0, l - mean)) * solid_angle;
        lights.value[weights + x] = w;
        sum += w;
        lights.value[cumulative + x] = sum;
    }
    row_sum[row] = sum;
    barrier();
    if (row == 0) {
        float total = 0.0;
        for (int r = 0; r < LIGHT_CELLS.y; r++) {
            total += row_sum[r];
            lights.value[LIGHT_ROWS_AT + r] = total;
        }
        lights.total = total;
        // An even panorama has no lights worth drawing.
        // Free lamps are drawn beside the table, and wherever there are any.
        float lamps = 0.0;
        for (uint k = 0u; k < lamp_count(); k++) lamps += lamp_power(k);
        float above = (total + lamps) / max(4.0 * PI * mean + lamps, 1e-20);
        if (lamps > 0.0) above = max(above, 0.1);
        lights.share = DIRECTIONS == LIGHT ? 1.0 : above < 0.05 ? 0.0 : min(0.5, above);
    }
}
