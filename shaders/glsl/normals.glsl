// What both dispatches of normals are told. radius, stride and spacing are in texels. The tolerance is that of 1/D,
// absolute (1/m) and relative; radial_step is the step of radial codes, m. first_turn and turn are (sin, cos) of the
// longitude from a texel to the first tap of a row, and from tap to tap.
layout(push_constant, scalar) uniform Push {
    int radius;
    int stride;
    int spacing;
    float step_disparity;
    float step_radial;
    float relative;
    vec2 first_turn;
    vec2 turn;
} push;
