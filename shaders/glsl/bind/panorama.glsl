// The panorama, and what is derived from it once per video frame (passes/panorama.rs).

// Radiance: level 0, and all mip levels. w of level 0: by what factor it shines more than it shows. The image is a
// stand-in where the panorama is of 16-bit floats (halves.glsl). `panorama_texel` reads either.
layout(set = 0, binding = 1, rgba32f) uniform readonly image2D in_panorama_radiance;
layout(set = 0, binding = 2) uniform sampler2D panorama_levels;
// Radial depth, metres; 0 is a hole. Texel row j is row j + 1; the first and the last row hold the poles.
layout(set = 0, binding = 3, r32f) uniform readonly image2D in_depth;
layout(set = 0, binding = 4, r32f) uniform writeonly image2D out_depth;
// First row: (sin φ, cos φ) of each column. Second: (sin θ, cos θ) of each row of in_depth.
layout(set = 0, binding = 5, rg32f) uniform readonly image2D in_angles;
// Unit normal towards the centre.
layout(set = 0, binding = 6, rgba16f) uniform readonly image2D in_panorama_normal;
layout(set = 0, binding = 7, rgba16f) uniform writeonly image2D out_panorama_normal;
// A plane n·P = h around each texel: xyz n/h, 1/m; w mean squared residual of 1/D, negative: no plane.
layout(set = 0, binding = 8, rgba32f) uniform readonly image2D in_plane;
layout(set = 0, binding = 9, rgba32f) uniform writeonly image2D out_plane;
// The boxes that rays walk: see pyramid.glsl.
layout(set = 0, binding = 10, rgba32ui) uniform readonly uimage2D in_pyramid;
layout(set = 0, binding = 11, rgba32ui) uniform uimage2D pyramid;
// The light table: see light.glsl.
layout(set = 0, binding = 12, scalar) readonly buffer LightsRead { float share; float total; float changed; float value[]; } in_lights;
layout(set = 0, binding = 13, scalar) buffer LightsWritten { float share; float total; float changed; float value[]; } lights;
// The lamps that hang free: see lamps.glsl (`FreeLamp` in passes/free_lamps.rs).
struct FreeLamp {
    vec3 center;
    float luminance;
    vec3 axis_x;
    vec3 axis_y;
    vec3 axis_z;
    vec3 unit_x;
    vec3 unit_y;
    vec3 unit_z;
    float volume;
    vec3 radiance;
    vec3 around;    // what surrounds it in the capture
    vec3 direction; // of the cone in which the capture shows it
    vec3 across_x;
    vec3 across_y;
};
layout(set = 0, binding = 15, scalar) readonly buffer Lamps { uint count; FreeLamp lamp[]; } in_lamps;
