#version 460
#extension GL_GOOGLE_include_directive : require
// Pass 2, sampling_mask (first dispatch): the tiles that the later passes visit, and what moving objects change in
// each. While a picture stands still, tiles of real surfaces take turns, and all pixels of a tile are traced in
// its turn. Tiles with little noise left have their turn more seldom. Where much changes, or another surface is seen, no
// tile waits for its turn.
// In: held_tiles, guide, movers, lights, tile_light. Out: tiles, changes, tile_light (0 where a tile is visited).
#include "common.glsl"
#include "parts.glsl"
#include "bind/images.glsl"
#include "bind/scene.glsl"
#include "append.glsl"
#include "tiles.glsl"
#include "turn.glsl"
#include "guide.glsl"
#include "past.glsl"
#include "panorama.glsl"
#include "trace.glsl"
#include "light.glsl"
layout(local_size_x = 64) in;

layout(push_constant, scalar) uniform Push {
    uint turns; // 1: tiles take turns
    uint history_valid;
    float history_change;
    float rest_noise; // of the light
    uint still; // a bit for each layer: 1 if it shows what it showed in the last frame
} push;
layout(constant_id = 38) const uint FOLLOWS = 0; // 1: temporal follows what moves with an object
layout(constant_id = 36) const uint RESTS = 0; // 1: atrous tells how noisy a tile is

// Points of the panorama's lamps, drawn in proportion to what they send.
const uint LAMPS = 16u;
shared vec4 lamp[LAMPS]; // w: 1 if it is infinitely far, and xyz its direction

void find_lamps() {
    if (OBJECT_MOTION == 0u || DIRECTIONS == BRDF) return;
    uint k = gl_LocalInvocationIndex;
    if (k < LAMPS && in_lights.share > 0.0) {
        vec3 centre = light_sample(vec2((float(k) + 0.5) / float(LAMPS), fract(0.5 + float(k) * 0.6180339887)), vec2(0.5));
        ivec2 texel;
        float distance = surface_distance(centre, texel);
        lamp[k] = distance > 0.0 ? vec4(centre * distance, 0.0) : vec4(centre, 1.0);
        // The first ones are the free lamps, as many as their share of the light.
        float lamps = 0.0;
        for (uint i = 0u; i < lamp_count(); i++) lamps += lamp_power(i);
        float below = (float(k) + 0.5) / float(LAMPS) * (lamps + in_lights.total);
        for (uint i = 0u; i < lamp_count(); i++) {
            if (below >= 0.0 && below < lamp_power(i)) lamp[k] = vec4(in_lamps.lamp[i].center, 0.0);
            below -= lamp_power(i);
        }
    }
    barrier();
}

// Returns how much a sphere takes of the light of a lamp: 1 in its shadow, 0 well outside of the penumbra.
float shade(vec3 x, vec4 lamp, vec3 centre, float radius) {
    vec3 way = lamp.w > 0.0 ? lamp.xyz * 1e3 : lamp.xyz - x, off = centre - x;
    float t = clamp(dot(off, way) / max(dot(way, way), 1e-12), 0.0, 1.0);
    return clamp(3.0 - 2.0 * distance(off, way * t) / radius, 0.0, 1.0);
}

// Returns the share of the cosine-weighted hemisphere that a sphere covers, at most about.
float covers(vec3 x, vec3 normal, vec3 centre, float radius) {
    vec3 off = centre - x;
    float distance2 = dot(off, off), sine2 = min(radius * radius / max(distance2, 1e-12), 1.0);
    float up = dot(off, normal) * inversesqrt(max(distance2, 1e-12)), sine = sqrt(sine2);
    return sine2 * clamp(up + sine, 0.0, 1.0);
}

// How moving objects change a point's light.
struct Change {
    float all;     // since the last frame, relative to the light
    float largest; // by one object
    float whole;   // what this object does to the light in all
    vec3 moved;    // how far what that object does to the light has moved over the surface
};

// Returns how far a shadow that a lamp in a direction casts on a plane moves with its caster, `near` times as fast as
// that: it is the farther, the nearer the caster is to the lamp.
vec3 shadow_motion(vec3 caster, vec3 normal, vec3 d, float near) {
    float up = dot(d, normal);
    return near * (caster - d * (dot(caster, normal) / max(abs(up), 0.1) * sign(up)));
}

// Returns about how moving objects changed a point's light since the last frame. Of its own light a moving surface
// loses little from one frame to the next, as it changes over half a metre.
Change change_at(vec3 x, vec3 normal, uint id) {
    Change change = Change(0.0, 0.0, 0.0, vec3(FAR));
    for (uint i = 0u; i < in_view.view.mover_count; i++) {
        Mover m = in_movers.mover[i];
        if (m.id != NONE && id == guide_object(m.id)) { change.all += m.step / 0.5; continue; }
        vec3 step = m.now - m.before;
        float part = max(covers(x, normal, m.now, m.radius), covers(x, normal, m.before, m.radius));
        float whole = part * (1.0 + m.glow), sum = whole * min(1.0, 2.0 * m.step / m.radius);
        vec3 moved = sum * (step - normal * dot(step, normal));
        if (DIRECTIONS != BRDF && in_lights.share > 0.0) {
            float unit = min(2.0 * in_lights.share, 1.0) / float(LAMPS), stepped = min(1.0, 4.0 * m.step / m.radius);
            for (uint k = 0u; k < LAMPS; k++) {
                float shaded = unit * max(shade(x, lamp[k], m.now, m.radius), shade(x, lamp[k], m.before, m.radius));
                if (shaded <= 0.0) continue;
                whole += shaded;
                shaded *= stepped;
                sum += shaded;
                vec3 way = lamp[k].w > 0.0 ? lamp[k].xyz : lamp[k].xyz - x;
                float near = lamp[k].w > 0.0 ? 1.0 : min(length(way) / max(distance(lamp[k].xyz, m.now), 1e-3), 4.0);
                moved += shaded * shadow_motion(step, normal, normalize(way), near);
            }
        }
        // What jumps leaves nothing of the light that was.
        bool jumps = m.step > m.radius;
        change.all += jumps ? sum * max(1.0, sum / 0.05) : sum;
        if (sum > change.largest) {
            change.largest = sum;
            change.whole = whole;
            // A turning object does not take its shadow along.
            bool goes = !jumps && dot(step, step) > 0.25 * m.step * m.step;
            change.moved = goes ? moved / sum : vec3(FAR);
        }
    }
    return change;
}

// Returns how much the last video frame changed a point's light: as much as the panorama changed in all, and of a
// real surface at least as much as what it reflects.
float video_change_at(vec3 x, uint layer) {
    if (DIRECTIONS == BRDF || in_view.view.new_video == 0u) return 0.0;
    if (layer == uint(VIRTUAL)) return in_lights.changed;
    ivec2 cell = light_cell(panorama_uv(x));
    int at = cell.y * LIGHT_CELLS.x + cell.x;
    float now = in_lights.value[LIGHT_LUMINANCES_AT + at], change = in_lights.value[LIGHT_CHANGES_AT + at];
    return max(in_lights.changed, abs(change) / max(max(now, now - change), 1e-20));
}

// Says whether it is a tile's turn: each pixel's share of the frames, or a quarter of that in a tile that rests.
bool tile_turn(ivec2 at, uint number) {
    if (!in_turn(at, in_view.view.rays_per_16)) return false;
    if (RESTS == 0u || uintBitsToFloat(tile_light.item[2u * number]) >= push.rest_noise) return true;
    uint round = in_view.view.frame * in_view.view.rays_per_16 / 16u;
    return ((round + hash(number)) & 3u) == 0u;
}

void main() {
    find_lamps();
    uvec2 tiles = tile_count();
    uint all = tiles.x * tiles.y, index = gl_GlobalInvocationID.x, layer = index / all, k = index - layer * all;
    uint tile = in_held_tiles.item[min(index, 2u * all - 1u)];
    bool wanted = layer < 2u && k < in_held_arguments.word[min(layer, 1u) * 4u + 3u];
    if (!wanted) return;
    ivec2 at = ivec2(tile & 0xffffu, tile >> 16u);
    uint number = uint(at.y) * tiles.x + uint(at.x);
    bool turns = layer == uint(REAL) && push.turns != 0u, turn = turns && tile_turn(at, number);
    if (OBJECT_MOTION != 0u) {
        uint place = layer * all + number;
        vec2 change = push.history_valid != 0u ? changes.item[place].xy : vec2(0.0);
        bool another = false, visited_last = false, follows = false;
        vec3 moved = vec3(0.0);
        bool stands = ((push.still >> layer) & 1u) != 0u;
        if (in_view.view.mover_count + in_view.view.new_video > 0u) {
            vec2 most = vec2(0.0);
            Change largest = Change(0.0, 0.0, 0.0, vec3(FAR));
            [[unroll]] for (int i = 0; i < 4; i++) {
                ivec2 q = min(at * 8 + ivec2(i & 1, i >> 1) * 5 + 1, ivec2(in_view.view.size) - 1);
                uvec4 guide = imageLoad(in_guide, ivec3(q, layer)), past = imageLoad(in_past, ivec3(q, layer));
                float distance_now = length(guide_position(guide) - in_view.view.position);
                bool differs = guide_id(guide) != guide_id(past_guide(past)) || abs(past_distance(past) - distance_now) > 0.15 * distance_now;
                another = another || (differs && !stands);
                if (guide_id(guide) == NO_SURFACE) continue;
                Change by_objects = change_at(guide_position(guide), guide_normal(guide) / 127.0, guide_id(guide));
                most = max(most, vec2(video_change_at(guide_position(guide), layer), by_objects.all));
                if (by_objects.all > largest.all) largest = by_objects;
            }
            const float SEEN = 0.05;
            float effect = RESTS != 0u && layer == uint(REAL) ? uintBitsToFloat(tile_light.item[2u * number + 1u]) : 1.0;
            // Where objects hardly change the light, it is the video's own, whatever the video does to it; unless that is
            // so much that they may cast another shadow.
            most.x *= clamp(max(effect, 2.0 * most.x), 0.0, 1.0);
            visited_last = change == vec2(0.0);
            change += most;
            // Where one object makes most of ΔE and of its change, that moves along.
            follows = FOLLOWS != 0u && layer == uint(REAL) && largest.moved.x < FAR && largest.largest > max(0.75 * largest.all, SEEN) && largest.whole > 2.0 * effect;
            moved = largest.moved;
        }
        // Where a history keeps more than a few frames it can wait for its turn.
        const float SOON = 8.0;
        bool now = another || (change.x + change.y) * SOON > (push.history_change < FAR ? push.history_change : 0.0);
        wanted = !turns || turn || now;
        turn = turn && !now;
        follows = follows && wanted && visited_last;
        const float LEFT = 0.25; // of a change that is followed
        changes.item[place] = wanted ? vec4(vec2(0.0), change.x, follows ? LEFT * change.y : change.y) : vec4(change, vec2(0.0));
        if (FOLLOWS != 0u && layer == uint(REAL)) out_followed.item[number] = vec4(moved, follows ? 1.0 : 0.0);
    } else wanted = !turns || turn;
    if (!wanted) return;
    if (RESTS != 0u && layer == uint(REAL)) tile_light.item[2u * number] = tile_light.item[2u * number + 1u] = 0u;
    uint total = atomicAdd(out_tile_arguments.word[layer * 4u + 3u], 1u) + 1u;
    atomicMax(out_tile_arguments.word[layer * 4u], min(total, GROUPS_PER_ROW));
    atomicMax(out_tile_arguments.word[layer * 4u + 1u], (total + GROUPS_PER_ROW - 1u) / GROUPS_PER_ROW);
    out_tile_arguments.word[layer * 4u + 2u] = 1u;
    out_tiles.item[layer * all + total - 1u] = tile | (turn ? TILE_DENSE : 0u);
}
