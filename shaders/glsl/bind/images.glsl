// Images and lists of a view (`DECLARED` in passes/view.rs). Passes read `in_` and write `out_`. A name without a
// prefix is both read and written. Images with layers hold real surfaces in layer REAL and virtual ones in layer
// VIRTUAL. Images with a history hold them in two layers. a, b and frames: LIGHT_NOW(layer) and LIGHT_BEFORE(layer), which are one where camera and
// objects stand still, whatever the video does. What images hold packed light, and when, says `View::light`.

// Of the virtual surface: xy motion to the previous frame in pixels, z distance from the previous camera (m).
layout(set = 0, binding = 34, rgba16f) uniform readonly image2D in_motion;
layout(set = 0, binding = 35, rgba16f) uniform writeonly image2D out_motion;
// Position, normal, roughness and object of what the pixel shows: see guide.glsl.
layout(set = 0, binding = 36, rgba32ui) uniform readonly uimage2DArray in_guide;
layout(set = 0, binding = 37, rgba32ui) uniform uimage2DArray guide;
// What is needed of the last frame's guide, packed before the guide is written anew: see past.glsl.
layout(set = 0, binding = 30, rg32ui) uniform readonly uimage2DArray in_past;
layout(set = 0, binding = 31, rg32ui) uniform writeonly uimage2DArray out_past;
// L_cam; w: how much of the pixel's centre is real, 0 or 1 where nothing is half transparent.
layout(set = 0, binding = 39, rgba32f) uniform readonly image2D in_camera_radiance;
layout(set = 0, binding = 40, rgba32f) uniform image2D camera_radiance;
// Albedo k_V of the Lambert lobe under the GGX lobe, the pixel's mean: see color_code.glsl. FLAG is set where it holds
// several surfaces that stand still.
layout(set = 0, binding = 41, r32ui) uniform readonly uimage2D in_albedo_virtual;
layout(set = 0, binding = 42, r32ui) uniform writeonly uimage2D out_albedo_virtual;
// Radiance that the virtual surface emits: see color_code.glsl.
layout(set = 0, binding = 43, r32ui) uniform readonly uimage2D in_emission;
layout(set = 0, binding = 44, r32ui) uniform writeonly uimage2D out_emission;
// Instance, triangle, barycentric coordinates (float bits) of the virtual surface, or NONE and whether there was one
// a frame ago (HAD_HIT).
layout(set = 0, binding = 45, rgba32ui) uniform readonly uimage2D in_hit;
layout(set = 0, binding = 46, rgba32ui) uniform writeonly uimage2D out_hit;
layout(set = 0, binding = 64, rgba32ui) uniform uimage2D hit;
// What a smooth virtual surface reflects: xy motion to the previous frame in pixels, z its distance from the surface (m;
// 0: the surface is not smooth), w that distance a frame ago.
layout(set = 0, binding = 84, rgba16f) uniform readonly image2D in_reflected;
layout(set = 0, binding = 85, rgba16f) uniform writeonly image2D out_reflected;
// M, from 0 to 1.
layout(set = 0, binding = 47, r16f) uniform readonly image2D in_real_coverage;
layout(set = 0, binding = 48, r16f) uniform image2D real_coverage;
// The picture: linear radiance, w 1.
layout(set = 0, binding = 49, rgba32f) uniform writeonly image2D out_radiance;
// How many paths are traced this frame, over 127; 0: nothing to light, below: not traced.
layout(set = 0, binding = 50, r8_snorm) uniform readonly image2DArray in_mask;
layout(set = 0, binding = 51, r8_snorm) uniform writeonly image2DArray out_mask;
// Light of this frame, as light_code.glsl packs it. Real: a is E_R, b is ΔE. Virtual: a is E of the Lambert
// lobe, b the radiance of all other lobes.
layout(set = 0, binding = 52, rgba32ui) uniform uimage2DArray irradiance;
layout(set = 0, binding = 53, rgba32ui) uniform readonly uimage2DArray in_irradiance;
layout(set = 0, binding = 54, rgba32ui) uniform writeonly uimage2DArray out_irradiance;
// a and b accumulated, where halves would not do; w: second moment of the luminance.
layout(set = 0, binding = 55, rgba32f) uniform image2DArray a;
layout(set = 0, binding = 57, rgba32f) uniform image2DArray b;
// a and b accumulated, packed; the deviations are those of the mean. Where a and b are left out, this is their history,
// and in_accumulated that of the last frame where the layer moves.
layout(set = 0, binding = 65, rgba32ui) uniform uimage2DArray accumulated;
layout(set = 0, binding = 88, rgba32ui) uniform readonly uimage2DArray in_accumulated;
// What follow found: b, and how many frames that holds. An image that later passes fill.
layout(set = 0, binding = 89, rgba32ui) uniform readonly uimage2DArray in_followed_light;
layout(set = 0, binding = 90, rgba32ui) uniform writeonly uimage2DArray out_followed_light;
// How many frames are accumulated in a and in b.
layout(set = 0, binding = 59, rg16f) uniform readonly image2DArray in_frames;
layout(set = 0, binding = 60, rg16f) uniform image2DArray frames;
// a and b accumulated or filtered, packed; the deviations are those of the mean.
layout(set = 0, binding = 62, rgba32ui) uniform readonly uimage2DArray in_light;
layout(set = 0, binding = 63, rgba32ui) uniform writeonly uimage2DArray out_light;
layout(set = 0, binding = 66, rgba32ui) uniform readonly uimage2DArray in_virtual_light;
// Pixels: in `gbuffer` those of silhouettes, then those whose centre is virtual; later those that are traced.
layout(set = 0, binding = 67, scalar) readonly buffer ListRead { uint item[]; } in_list;
layout(set = 0, binding = 68, scalar) writeonly buffer ListWritten { uint item[]; } out_list;
// Tiles of 8×8 pixels in which a layer holds surfaces.
layout(set = 0, binding = 75, scalar) readonly buffer HeldRead { uint item[]; } in_held_tiles;
layout(set = 0, binding = 76, scalar) writeonly buffer HeldWritten { uint item[]; } out_held_tiles;
// Of each tile of each layer: the shares of its light that the video and moving objects have changed since it was
// visited last (xy), and those that they had changed when it was (zw).
layout(set = 0, binding = 38, scalar) readonly buffer ChangesRead { vec4 item[]; } in_changes;
layout(set = 0, binding = 56, scalar) buffer ChangesWritten { vec4 item[]; } changes;
// Of each tile of real surfaces: how far the change that an object makes to its light has moved with the object since
// the last frame (m), and 1 if that is known.
layout(set = 0, binding = 86, scalar) readonly buffer FollowedRead { vec4 item[]; } in_followed;
layout(set = 0, binding = 87, scalar) writeonly buffer FollowedWritten { vec4 item[]; } out_followed;
// Two words for each tile of real surfaces, float bits: the most that its light, once filtered, errs by chance, and the
// most that objects change it, both relative.
layout(set = 0, binding = 58, scalar) buffer TileLight { uint item[]; } tile_light;
// What each tile holds (append.glsl).
layout(set = 0, binding = 106, scalar) readonly buffer TileHoldsRead { uint item[]; } in_tile_holds;
layout(set = 0, binding = 107, scalar) writeonly buffer TileHoldsWritten { uint item[]; } out_tile_holds;
// Of the tiles that hold anything those that passes visit this frame; before that, those in which gbuffer looks for objects.
layout(set = 0, binding = 69, scalar) readonly buffer TilesRead { uint item[]; } in_tiles;
layout(set = 0, binding = 70, scalar) writeonly buffer TilesWritten { uint item[]; } out_tiles;
// Of the list of real surfaces, what aim leaves.
layout(set = 0, binding = 79, scalar) writeonly buffer AimedWritten { uint item[]; } out_aimed;
layout(set = 0, binding = 80, scalar) buffer AimedArgumentsWritten { uint word[]; } out_aimed_arguments;
// Arguments of dispatches over these lists: see list.glsl.
layout(set = 0, binding = 71, scalar) readonly buffer ArgumentsRead { uint word[]; } in_arguments;
layout(set = 0, binding = 72, scalar) buffer ArgumentsWritten { uint word[]; } out_arguments;
layout(set = 0, binding = 77, scalar) readonly buffer HeldArgumentsRead { uint word[]; } in_held_arguments;
layout(set = 0, binding = 78, scalar) buffer HeldArgumentsWritten { uint word[]; } out_held_arguments;
layout(set = 0, binding = 73, scalar) readonly buffer TileArgumentsRead { uint word[]; } in_tile_arguments;
layout(set = 0, binding = 74, scalar) buffer TileArgumentsWritten { uint word[]; } out_tile_arguments;
