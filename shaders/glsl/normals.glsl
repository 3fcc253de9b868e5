// What both dispatches of normals are told. radius, stride and spacing are in texels. The tolerance is that of 1/D,
// absolute (1/m) and relative; radial_step is the step of radial codes, m. noise is the step of noisy depth, relative.
layout(push_constant, scalar) uniform Push {
    int radius;
    int stride;
    int spacing;
    float step_disparity;
    float step_radial;
    float noise;
    float relative;
} push;

// Returns by how much 1/D = q may be wrong.
float step_at(float q) { return max(push.step_disparity, max(push.step_radial * q, push.noise) * q); }
