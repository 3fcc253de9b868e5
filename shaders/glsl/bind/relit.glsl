// What the passes of `relight` make before the picture's own passes run.

// The relit panorama: E_R and ΔE of real surfaces, on a coarse equirect map aligned with the panorama.
layout(set = 0, binding = 14, rgba32f) uniform readonly image2DArray in_relight_real;
layout(set = 0, binding = 15, rgba32f) uniform readonly image2DArray in_relight_change;
