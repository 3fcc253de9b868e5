// The view: camera now and one frame ago, the panorama's shape, settings (`ViewData` in passes/view.rs).
struct View {
    vec3 position;
    vec3 right;
    vec3 up;
    vec3 forward;
    vec2 tan_half;
    float eye;               // view_origin: metres to the right
    vec3 previous_position;
    vec3 previous_right;
    vec3 previous_up;
    vec3 previous_forward;
    vec2 previous_tan_half;
    uvec2 size;
    uint projection;
    uint frame;
    uint seed;
    uvec2 color_size;
    uint color_levels;
    uvec2 depth_size;
    float yaw;
    float edge_ratio;
    float thickness;
    float skirt_luminance;   // of a skirt at most
    uint edge_depth;         // 1: skirts are as deep as edges.glsl says
    uint pyramid_levels;
    uvec2 pyramid_size;
    uint pyramid_area;
    uint pyramid_nodes;
    uint instance_count;
    uint light_count;        // lights without a surface
    uint mover_count;        // instances and such lights that have moved since the last frame
    uint touching_count;     // in the list of movers behind these: spheres outside of which objects look as they did
    uint new_video;          // 1: the video frame is another than in the last frame
    uint bounces;
    uint coverage_samples;
    uint rays_per_16;
    uint history_limit;      // of what objects change
    uint history_limit_real; // of what the video alone changes: E_R
    uint relit;
    uvec2 relight_size;
    vec2 light_units;        // factors on E_R, and on what objects change or send, in images
    uvec2 light_now;         // the layers of this frame's real and virtual surfaces in images with a history
    uvec2 light_before;
};

layout(set = 0, binding = 0, scalar) uniform ViewBuffer { View view; } in_view;
