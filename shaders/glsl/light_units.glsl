// The light that is the result of the filters, out of the units of light_code.glsl.
layout(constant_id = 32) const uint RESULT_BRIEF = 0; // 1: it is in brief, as atrous leaves it

Light result_unpack(uvec4 code) {
    if (RESULT_BRIEF != 0u) return brief_unpack(code);
    return light_unpack(code);
}

// Returns a and b of a layer in W/m², or radiance, up to the scale of the capture.
void light_decode(int layer, inout Light light) {
    light.a /= layer == REAL ? in_view.view.light_units.x : in_view.view.light_units.y;
    light.b /= in_view.view.light_units.y;
}
