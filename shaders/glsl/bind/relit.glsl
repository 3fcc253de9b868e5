// What the passes of `relight` make before the picture's own passes run.

// The relit panorama: E_R and ΔE of real surfaces, packed, on a coarse equirect map aligned with the panorama.
layout(set = 0, binding = 14, rgba32ui) uniform readonly uimage2DArray in_relit_light;
