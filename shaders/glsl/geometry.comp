#version 460
#extension GL_GOOGLE_include_directive : require
// geometry: position, normal, motion or object of one layer's surfaces, unpacked. It is no part of the frame, and made
// when it is asked for.
// In: guide, motion, hit; instances. Out: geometry: xyz position (m), w distance from the camera (m; 0: nothing there) |
// xyz unit normal, w roughness | xy motion to the previous frame in pixels, z distance from the previous camera (m),
// w object id (0: real) | the object's id alone.
#include "common.glsl"
#include "parts.glsl"
#include "bind/images.glsl"
#include "bind/scene.glsl"
#include "guide.glsl"
layout(local_size_x = 8, local_size_y = 8) in;
layout(set = 0, binding = 90, rgba32f) uniform writeonly image2D out_geometry;
layout(constant_id = 1) const int LAYER = 0;
layout(constant_id = 10) const uint WANTED = 0; // as `Values` in passes/display.rs

const uint POSITION = 4u, NORMAL = 5u, MOTION = 6u;

void main() {
    ivec2 p = ivec2(gl_GlobalInvocationID.xy);
    if (any(greaterThanEqual(p, ivec2(in_view.view.size)))) return;
    uvec4 guide = imageLoad(in_guide, ivec3(p, LAYER));
    vec3 position = guide_position(guide);
    bool there = guide.w >> 24 != NO_SURFACE; // hidden or not
    float id = 0.0;
    if (LAYER == VIRTUAL && WANTED >= MOTION && there) id = float(in_instances.instance[imageLoad(in_hit, p).x].id);
    vec4 value = vec4(id, id, id, 1.0);
    if (WANTED > MOTION) there = true;
    else if (WANTED == POSITION) {
        there = guide_has_position(guide); // a lamp, too
        value = vec4(position, distance(position, view_origin(vec2(p) + 0.5)));
    } else if (WANTED == NORMAL) value = vec4(guide_unit_normal(guide), guide_roughness(guide));
    else if (WANTED == MOTION) {
        value = vec4(0.0);
        if (LAYER == REAL) value = motion_of(vec2(p) + 0.5, position, id);
        else value = vec4(imageLoad(in_motion, p).xyz, id);
    }
    imageStore(out_geometry, p, there ? value : vec4(0.0));
}
