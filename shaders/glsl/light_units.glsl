// Out of the units of light_code.glsl.

// Returns a and b of a layer in W/m², or radiance, up to the scale of the capture.
void light_decode(int layer, inout Light light) {
    light.a /= layer == REAL ? in_view.view.light_units.x : in_view.view.light_units.y;
    light.b /= in_view.view.light_units.y;
}
