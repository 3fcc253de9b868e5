//! Procedural textures, painted in linear colour and stored as sRGB texels.

use super::kit::hash;
use crate::image_file::srgb::linear_to_srgb;
use crate::scene::material::{TexelEncoding, Texture, Wrap};
use glam::{Vec2, Vec3, vec2, vec3};
use std::f32::consts::{PI, TAU};

/// Returns value noise, 0..1, on a lattice that repeats every `period` cells.
fn noise(p: Vec2, period: [i32; 2], seed: u32) -> f32 {
    let cell = p.floor();
    let t = p - cell;
    let t = t * t * (Vec2::splat(3.0) - 2.0 * t);
    let (i, j) = (cell.x as i32, cell.y as i32);
    let at = |i: i32, j: i32| hash(i.rem_euclid(period[0]), j.rem_euclid(period[1]), seed);
    let low = at(i, j) + (at(i + 1, j) - at(i, j)) * t.x;
    let high = at(i, j + 1) + (at(i + 1, j + 1) - at(i, j + 1)) * t.x;
    low + (high - low) * t.y
}

/// Returns three octaves of [`noise`] over `uv` in 0..1, the first with `cells` cells. It tiles.
fn clouds(uv: Vec2, cells: [i32; 2], seed: u32) -> f32 {
    (0..3)
        .map(|k| {
            let period = cells.map(|c| c << k);
            noise(uv * vec2(period[0] as f32, period[1] as f32), period, seed + k) * 0.5f32.powi(k as i32 + 1) / 0.875
        })
        .sum()
}

fn smoothstep(a: f32, b: f32, x: f32) -> f32 {
    let t = ((x - a) / (b - a)).clamp(0.0, 1.0);
    t * t * (3.0 - 2.0 * t)
}

fn painted(size: [u32; 2], color: impl Fn(Vec2) -> Vec3) -> Texture {
    let encode = |x: f32| (linear_to_srgb(x.clamp(0.0, 1.0)) * 255.0 + 0.5) as u8;
    let mut texels = Vec::with_capacity((size[0] * size[1]) as usize);
    for j in 0..size[1] {
        for i in 0..size[0] {
            let c = color(vec2((i as f32 + 0.5) / size[0] as f32, (j as f32 + 0.5) / size[1] as f32));
            texels.push([encode(c.x), encode(c.y), encode(c.z), 255]);
        }
    }
    let wrap = [Wrap::Repeat; 2];
    Texture { name: String::new(), size, texels, encoding: TexelEncoding::Srgb, wrap, nearest: false }
}

/// Oak planks running along u: 16 rows, each of two planks, for a floor tile of 2.4 m × 2.4 m.
pub fn planks() -> Texture {
    painted([1024, 1024], |uv| {
        let row = (uv.y * 16.0).floor();
        let shift = hash(row as i32, 0, 11);
        let along = (uv.x + shift) * 2.0;
        let plank = (along.floor() as i32).rem_euclid(2);
        let tone = hash(row as i32, plank, 12);
        let grain = clouds(vec2(uv.x + tone, uv.y), [8, 192], 13);
        let rings = clouds(vec2(uv.x, uv.y + tone), [3, 40], 17);
        let base = vec3(0.34, 0.19, 0.09).lerp(vec3(0.56, 0.36, 0.20), tone);
        let edge = (uv.y * 16.0).fract().min(1.0 - (uv.y * 16.0).fract()) * 0.15; // metres to the joint
        let end = along.fract().min(1.0 - along.fract()) * 1.2;
        let joint = smoothstep(0.001, 0.006, edge.min(end));
        base * (0.72 + 0.34 * grain + 0.22 * rings) * (0.3 + 0.7 * joint)
    })
}

/// Fine-grained wood in one piece, grain along u.
pub fn wood(dark: Vec3, light: Vec3, seed: u32) -> Texture {
    painted([256, 256], |uv| {
        let warp = clouds(uv, [2, 3], seed);
        let rings = 0.5 + 0.5 * ((uv.y * 5.0 + warp * 2.0) * TAU).sin();
        let grain = clouds(uv, [6, 96], seed + 5);
        dark.lerp(light, (0.35 * rings + 0.65 * grain).clamp(0.0, 1.0))
    })
}

/// Woven cloth.
pub fn cloth(color: Vec3, seed: u32) -> Texture {
    painted([128, 128], |uv| {
        let weave = 0.5 + 0.25 * ((uv.x * 32.0 * TAU).sin() + (uv.y * 32.0 * TAU).sin());
        color * (0.72 + 0.22 * weave + 0.22 * clouds(uv, [16, 16], seed))
    })
}

/// A rug of 3:2, with border bands and a lozenge field.
pub fn rug() -> Texture {
    painted([768, 512], |uv| {
        let p = vec2(uv.x * 3.0, uv.y * 2.0);
        let edge = p.x.min(3.0 - p.x).min(p.y).min(2.0 - p.y);
        let (cream, red, navy, ochre) =
            (vec3(0.66, 0.58, 0.44), vec3(0.36, 0.075, 0.055), vec3(0.045, 0.07, 0.16), vec3(0.55, 0.32, 0.08));
        let color = if edge < 0.06 {
            navy
        } else if edge < 0.24 {
            let t = (p.x + p.y) * 6.0;
            if (t.fract() - 0.5).abs() < 0.22 { ochre } else { red * 0.8 }
        } else if edge < 0.29 {
            cream
        } else {
            let q = vec2((p.x * 2.5).fract() - 0.5, (p.y * 2.5).fract() - 0.5).abs();
            let d = q.x + q.y;
            let centre = (vec2(p.x - 1.5, p.y - 1.0).abs() * vec2(0.75, 1.1)).dot(Vec2::ONE);
            if (0.5..0.56).contains(&centre) {
                cream
            } else if d < 0.12 {
                ochre
            } else if d < 0.3 {
                if centre < 0.5 { red } else { navy }
            } else if d < 0.36 {
                cream
            } else if centre < 0.5 {
                navy
            } else {
                red
            }
        };
        color * (0.72 + 0.5 * clouds(uv, [192, 128], 31))
    })
}

/// Pictures for the walls on a cream mount: 0 hills at dusk, 1 overlapping discs, 2 colour fields.
pub fn picture(kind: u32) -> Texture {
    painted([256, 320], |uv| {
        let margin = uv.x.min(1.0 - uv.x).min(uv.y.min(1.0 - uv.y) * 1.25);
        if margin < 0.12 {
            return vec3(0.78, 0.75, 0.68);
        }
        let p = vec2((uv.x - 0.12) / 0.76, (uv.y - 0.096) / 0.808);
        match kind {
            0 => {
                let sky = vec3(0.85, 0.42, 0.16).lerp(vec3(0.10, 0.16, 0.38), (1.0 - p.y * 1.4).clamp(0.0, 1.0));
                let sky = if p.distance(vec2(0.65, 0.42)) < 0.09 { vec3(0.95, 0.78, 0.42) } else { sky };
                (0..4).fold(sky, |color, k| {
                    let k = k as f32;
                    let line = 0.48
                        + 0.12 * k
                        + 0.07 * (p.x * (4.0 + 2.0 * k) + 2.1 * k).sin()
                        + 0.03 * (p.x * 17.0 + k).sin();
                    if p.y > line { vec3(0.16, 0.20, 0.30).lerp(vec3(0.02, 0.05, 0.04), k / 3.0) } else { color }
                })
            }
            1 => {
                let discs = [
                    (vec2(0.38, 0.36), 0.28, vec3(0.80, 0.22, 0.10)),
                    (vec2(0.66, 0.55), 0.25, vec3(0.08, 0.30, 0.42)),
                    (vec2(0.36, 0.72), 0.18, vec3(0.82, 0.60, 0.14)),
                ];
                discs.iter().fold(vec3(0.70, 0.66, 0.58), |color, &(centre, radius, ink)| {
                    let d = (p - centre) * vec2(1.0, 1.25);
                    if d.length() < radius { color * ink * 1.3 } else { color }
                })
            }
            _ => {
                let band = (p.y * 3.0 + 0.25 * (p.x * PI).sin()).floor() as i32;
                let inks =
                    [vec3(0.10, 0.35, 0.33), vec3(0.72, 0.58, 0.30), vec3(0.55, 0.14, 0.12), vec3(0.10, 0.10, 0.14)];
                inks[band.clamp(0, 3) as usize] * (0.75 + 0.4 * clouds(p, [10, 30], 41))
            }
        }
    })
}

/// A basketball's skin on a globe map.
pub fn basketball() -> Texture {
    painted([512, 256], |uv| {
        let (phi, theta) = (uv.x * TAU, uv.y * PI);
        let d = vec3(theta.sin() * phi.sin(), theta.cos(), theta.sin() * phi.cos());
        let line = d.x.abs().min(d.y.abs()).min((d.z.abs() - 0.52 - 0.42 * d.y * d.y).abs() * 0.8);
        let pebbles = clouds(uv, [128, 64], 51);
        let skin = vec3(0.62, 0.205, 0.055) * (0.75 + 0.4 * pebbles);
        vec3(0.03, 0.025, 0.02).lerp(skin, smoothstep(0.018, 0.03, line))
    })
}

/// Old dark boards running along u, for a floor tile of 1.8 m × 1.8 m.
pub fn dark_planks() -> Texture {
    painted([768, 768], |uv| {
        let row = (uv.y * 12.0).floor();
        let along = (uv.x + hash(row as i32, 0, 71)) * 2.0;
        let tone = hash(row as i32, (along.floor() as i32).rem_euclid(2), 72);
        let grain = clouds(vec2(uv.x + tone, uv.y), [6, 144], 73);
        let base = vec3(0.15, 0.078, 0.038).lerp(vec3(0.29, 0.165, 0.085), tone);
        let edge = (uv.y * 12.0).fract().min(1.0 - (uv.y * 12.0).fract()) * 0.15; // metres to the joint
        let end = along.fract().min(1.0 - along.fract()) * 0.9;
        base * (0.65 + 0.6 * grain) * (0.25 + 0.75 * smoothstep(0.001, 0.006, edge.min(end)))
    })
}

/// Wallpaper with rows of leaves on a muted ground, for a tile of 1.2 m × 1.2 m.
pub fn wallpaper() -> Texture {
    painted([512, 512], |uv| {
        let (ground, leaf, vein) = (vec3(0.36, 0.34, 0.27), vec3(0.17, 0.22, 0.15), vec3(0.50, 0.44, 0.28));
        let cell = uv * 6.0;
        let row = cell.y.floor();
        let q = vec2((cell.x + 0.5 * (row as i32 % 2) as f32).fract() - 0.5, cell.y.fract() - 0.5);
        let stem = (q.x - 0.05 * (q.y * TAU).sin()).abs();
        let blades = [(-1.0, 0.12), (1.0, -0.1), (-1.0, -0.28), (1.0, 0.3)].iter().any(|&(side, y): &(f32, f32)| {
            let p = vec2(q.x * side - 0.13, q.y - y - 0.35 * (q.x * side - 0.05));
            (p.x / 0.13).powi(2) + (p.y / 0.055).powi(2) < 1.0
        });
        let color = if stem < 0.014 {
            vein
        } else if blades {
            leaf
        } else {
            ground
        };
        color * (0.85 + 0.3 * clouds(uv, [64, 64], 74))
    })
}

/// Striped cotton, stripes along v.
pub fn stripes(dark: Vec3, light: Vec3, seed: u32) -> Texture {
    painted([256, 256], |uv| {
        let t = (uv.x * 4.0).fract();
        let stripe = if t < 0.34 || (0.46..0.52).contains(&t) || (0.82..0.88).contains(&t) { dark } else { light };
        let weave = 0.5 + 0.25 * ((uv.x * 64.0 * TAU).sin() + (uv.y * 64.0 * TAU).sin());
        stripe * (0.76 + 0.18 * weave + 0.2 * clouds(uv, [24, 24], seed))
    })
}

/// Concrete cast in slabs of 1.6 m, for a tile of 3.2 m × 3.2 m.
pub fn concrete() -> Texture {
    painted([1024, 1024], |uv| {
        let slab = uv * 2.0;
        let tone = hash(slab.x.floor() as i32, slab.y.floor() as i32, 81);
        let stain = clouds(uv, [5, 5], 82);
        let grit = clouds(uv, [160, 160], 83);
        let edge = slab.fract().min(Vec2::ONE - slab.fract()).min_element() * 1.6; // metres to the joint
        let base = vec3(0.33, 0.325, 0.315) * (0.72 + 0.14 * tone + 0.36 * stain + 0.16 * grit);
        base * (0.35 + 0.65 * smoothstep(0.002, 0.007, edge))
    })
}

/// Plaster with faint strokes.
pub fn plaster(color: Vec3, seed: u32) -> Texture {
    painted([256, 256], |uv| color * (0.93 + 0.08 * clouds(uv, [4, 10], seed) + 0.05 * clouds(uv, [48, 32], seed + 9)))
}

/// Large abstract paintings: 0 waves, 1 a grid of colours, 2 arcs, 3 slanted bands, 4 rings.
pub fn painting(kind: u32) -> Texture {
    const INKS: [Vec3; 6] = [
        vec3(0.72, 0.10, 0.05),
        vec3(0.04, 0.13, 0.36),
        vec3(0.80, 0.56, 0.08),
        vec3(0.74, 0.70, 0.60),
        vec3(0.03, 0.03, 0.04),
        vec3(0.06, 0.34, 0.26),
    ];
    let brush = move |uv: Vec2| 0.78 + 0.36 * clouds(uv, [14, 60], 91 + kind);
    painted([384, 384], move |uv| {
        let ink = match kind {
            0 => {
                let y = uv.y * 7.0 + 0.5 * (uv.x * 7.0).sin() + 0.25 * (uv.x * 17.0 + 2.0).sin();
                [3, 1, 5, 1, 3, 2, 0, 4][(y.floor() as i32).rem_euclid(8) as usize]
            }
            1 => {
                let (x, y) = (uv.x * 5.0, uv.y * 4.0);
                let line = x.fract().min(y.fract());
                let pick = hash(x.floor() as i32, y.floor() as i32, 92);
                if line < 0.05 { 4 } else { [3, 3, 0, 1, 2, 5][(pick * 6.0) as usize % 6] }
            }
            2 => {
                let near = [(0.2, 1.0, 0), (0.75, 1.0, 1), (0.5, 0.1, 2)];
                let arcs = near.iter().find_map(|&(x, y, ink)| {
                    let r = uv.distance(vec2(x, y)) * 9.0;
                    (r < 4.4 && r.fract() < 0.6).then_some(ink)
                });
                arcs.unwrap_or(3)
            }
            3 => [0, 3, 4, 2, 3, 1][(((uv.x + 0.7 * uv.y) * 6.0).floor() as i32).rem_euclid(6) as usize],
            _ => {
                let r = (uv.distance(vec2(0.42, 0.45)) * 9.0).min(uv.distance(vec2(0.7, 0.8)) * 11.0 + 1.0);
                [2, 4, 5, 3, 1, 0][(r.floor() as i32).rem_euclid(6) as usize]
            }
        };
        INKS[ink] * brush(uv)
    })
}
