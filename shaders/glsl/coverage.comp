#version 460
#extension GL_GOOGLE_include_directive : require
// Pass 1, gbuffer (second dispatch): the fraction M of each pixel that shows the real scene, 0 or 1 except at
// silhouettes, where the 3×3 neighbourhood holds both kinds of surface. It lists silhouettes, the pixels beside
// which another object or material is seen, and the tiles that the later passes visit.
// In: camera_radiance.w (M at the centre), guide, hit, reflected of the last frame; materials of the scene. Out:
// coverage; guide of real surfaces, marked where they are hidden and so not lit; list, tiles.
#include "common.glsl"
#include "parts.glsl"
#include "bind/images.glsl"
#include "append.glsl"
#include "tiles.glsl"
#include "guide.glsl"
#include "scene.glsl"
layout(local_size_x = 8, local_size_y = 8) in;
layout(constant_id = 28) const uint KEPT = 0; // as in gbuffer

// What is seen at a pixel's centre: the object, and its material.
uvec2 shown(uvec4 hit) { return uvec2(hit.x, hit.x != NONE ? in_shading.triangle[hit.y].material : 0u); }

// Says whether a pixel shows one virtual surface, and one beside it another.
bool inner_edge(ivec2 p) {
    uvec2 here = shown(imageLoad(in_hit, p));
    if (here.x == NONE) return false;
    const ivec2 BESIDE[4] = { ivec2(1, 0), ivec2(-1, 0), ivec2(0, 1), ivec2(0, -1) };
    bool differs = false;
    [[unroll]] for (int k = 0; k < 4; k++) {
        ivec2 q = p + BESIDE[k];
        if (!neighbour(q)) continue;
        uvec2 there = shown(imageLoad(in_hit, q));
        differs = differs || (there.x != NONE && there != here);
    }
    return differs;
}

void main() {
    if (KEPT != 0u && list_group() >= in_tile_arguments.word[3]) return;
    ivec2 p = ivec2(gl_GlobalInvocationID.xy);
    bool inside = KEPT != 0u ? tile_pixel(REAL, p) : all(lessThan(p, ivec2(in_view.view.size)));
    float centre = imageLoad(in_camera_radiance, p).w;
    float sum = 0.0, count = 0.0;
    [[unroll]] for (int y = -1; y <= 1; y++) {
        [[unroll]] for (int x = -1; x <= 1; x++) {
            ivec2 q = p + ivec2(x, y);
            if (!neighbour(q)) continue;
            sum += imageLoad(in_camera_radiance, q).w;
            count += 1.0;
        }
    }
    bool silhouette = inside && sum != 0.0 && sum != count, hidden = !silhouette && centre == 0.0;
    uvec4 behind = imageLoad(guide, ivec3(p, REAL));
    bool was_hidden = (behind.y & HIDDEN) != 0u, real = inside && !hidden && (behind.w >> 24) != NO_SURFACE;
    // A tile that an object has left is visited once more.
    bool left = inside && imageLoad(real_coverage, p).x < 1.0;
    if (inside) imageStore(real_coverage, p, vec4(centre));
    if (inside && hidden != was_hidden) {
        behind.y ^= HIDDEN;
        imageStore(guide, ivec3(p, REAL), behind);
    }
    if (inside && hidden) imageStore(out_mask, ivec3(p, REAL), vec4(0.0));
    append_pixels(bvec2(silhouette || (inside && inner_edge(p)), false), p);
    bool reflects = REFLECTIONS != 0u && inside && imageLoad(in_reflected, p).z != 0.0;
    append_tile(p / 8, real, silhouette || left || (inside && centre == 0.0), reflects);
}
