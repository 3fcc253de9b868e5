//! More virtual objects of the built-in rooms. Each stands on y = 0 about the Y axis, unless it says
//! otherwise.

use super::kit::{Builder, block, lambert, lathe, rounded_block, sphere, tube};
use super::objects::{glossy, metal};
use super::textures;
use crate::scene::material::Material;
use glam::{Affine3A, Vec2, Vec3, vec2, vec3};
use std::f32::consts::{PI, TAU};

const HERE: Affine3A = Affine3A::IDENTITY;

/// Makes a material that shines with this radiance.
fn shining(name: &str, radiance: [f32; 3]) -> Material {
    Material { emissive: radiance.into(), ..lambert(name, Vec3::splat(0.02)) }
}

/// A glazed teapot, 0.17 m tall, spout towards +X.
pub fn teapot(color: [f32; 3]) -> Builder {
    let mut b = Builder::default();
    let glaze = b.material(glossy("teapot glaze", color, 0.08));
    let knob = b.material(metal("teapot knob", [0.93, 0.72, 0.40], 0.2));
    let body = |t: f32| vec2(0.052 + 0.043 * (PI * (0.16 + 0.80 * t)).sin() - 0.012 * t, 0.006 + 0.112 * t);
    let mut profile = vec![vec2(0.0, 0.003), vec2(0.048, 0.003), vec2(0.05, 0.0), vec2(0.056, 0.0), vec2(0.058, 0.004)];
    profile.extend((0..=20).map(|i| body(i as f32 / 20.0)));
    profile.push(vec2(0.0, 0.118));
    b.add(lathe(&profile, 56), HERE, glaze);
    let lid: Vec<Vec2> = (0..=10)
        .map(|i| 0.5 * PI * i as f32 / 10.0)
        .map(|a| vec2(if a > 1.57 { 0.0 } else { 0.047 * a.cos() }, 0.117 + 0.026 * a.sin()))
        .collect();
    b.add(lathe(&[vec![vec2(0.0, 0.115), vec2(0.047, 0.115)], lid].concat(), 48), HERE, glaze);
    b.add(sphere(0.012, 24), Affine3A::from_translation(Vec3::Y * 0.152), knob);
    let spout: Vec<Vec3> = (0..=12)
        .map(|i| i as f32 / 12.0)
        .map(|t| {
            let up = 0.45 * t + 0.55 * t * t * (3.0 - 2.0 * t);
            vec3(0.068 + 0.086 * t - 0.006 * (TAU * t).sin(), 0.044 + 0.074 * up, 0.0)
        })
        .collect();
    let radii: Vec<f32> = (0..=12).map(|i| 0.021 - 0.011 * i as f32 / 12.0).collect();
    b.add(tube(&spout, &radii, 20), HERE, glaze);
    let handle: Vec<Vec3> = (0..=16)
        .map(|i| PI * (0.5 + i as f32 / 16.0) + 0.12)
        .map(|a| vec3(-0.07 + 0.058 * a.cos(), 0.066 + 0.042 * a.sin(), 0.0))
        .collect();
    b.add(tube(&handle, &[0.0075; 17], 14), HERE, glaze);
    b
}

/// A wine bottle, 0.3 m tall.
pub fn bottle() -> Builder {
    let mut b = Builder::default();
    let glass = b.material(glossy("dark green glaze", [0.012, 0.055, 0.025], 0.04));
    let label = b.material(glossy("label", [0.72, 0.66, 0.50], 0.6));
    let foil = b.material(metal("foil", [0.75, 0.16, 0.10], 0.3));
    let profile = [
        (0.0, 0.006),
        (0.030, 0.0),
        (0.0355, 0.003),
        (0.0375, 0.010),
        (0.0375, 0.182),
        (0.0355, 0.196),
        (0.029, 0.210),
        (0.020, 0.224),
        (0.0155, 0.240),
        (0.0145, 0.29),
        (0.0, 0.292),
    ];
    b.add(lathe(&profile.map(Vec2::from), 48), HERE, glass);
    let band = [(0.0, 0.06), (0.0381, 0.06), (0.0381, 0.15), (0.0, 0.15)];
    b.add(lathe(&band.map(Vec2::from), 48), HERE, label);
    let cap =
        [(0.0, 0.25), (0.0163, 0.25), (0.0158, 0.286), (0.0172, 0.288), (0.0172, 0.298), (0.015, 0.301), (0.0, 0.301)];
    b.add(lathe(&cap.map(Vec2::from), 32), HERE, foil);
    b
}

/// A square cushion about the origin, facing ±Z.
pub fn pillow(dark: Vec3, light: Vec3) -> Builder {
    let mut b = Builder::default();
    let cloth = b.painted("pillow", textures::stripes(dark, light, 25));
    b.add(rounded_block(vec3(0.42, 0.42, 0.07), 0.034, 3, 8, 0.055).uv_scaled(Vec2::splat(2.4)), HERE, cloth);
    b
}

/// A night light like a mushroom, 0.2 m tall: its cap shines.
pub fn night_light() -> Builder {
    let mut b = Builder::default();
    let stem = b.material(glossy("white plastic", [0.75, 0.73, 0.68], 0.3));
    let cap = b.material(shining("glowing cap", [7.0, 3.4, 1.3]));
    let profile = [(0.0, 0.0), (0.06, 0.0), (0.062, 0.006), (0.04, 0.02), (0.027, 0.05), (0.025, 0.11), (0.0, 0.115)];
    b.add(lathe(&profile.map(Vec2::from), 36), HERE, stem);
    let dome: Vec<Vec2> = (0..=12)
        .map(|i| 0.5 * PI * i as f32 / 12.0)
        .map(|a| vec2(if a > 1.57 { 0.0 } else { 0.095 * a.cos() }, 0.115 + 0.085 * a.sin()))
        .collect();
    b.add(lathe(&[vec![vec2(0.0, 0.105), vec2(0.08, 0.105)], dome].concat(), 36), HERE, cap);
    b
}

/// A table lantern, 0.22 m tall: a glowing core between black rods.
pub fn lantern() -> Builder {
    let mut b = Builder::default();
    let black = b.material(metal("blackened steel", [0.20, 0.19, 0.18], 0.35));
    let core = b.material(shining("paper core", [5.2, 3.4, 1.7]));
    for y in [0.0, 0.2] {
        let plate = [(0.0, y), (0.062, y), (0.065, y + 0.005), (0.062, y + 0.012), (0.0, y + 0.012)];
        b.add(lathe(&plate.map(Vec2::from), 32), HERE, black);
    }
    for k in 0..6 {
        let (sin, cos) = (TAU * k as f32 / 6.0).sin_cos();
        let rod = [vec3(0.056 * cos, 0.01, 0.056 * sin), vec3(0.056 * cos, 0.203, 0.056 * sin)];
        b.add(tube(&rod, &[0.0035; 2], 10), HERE, black);
    }
    b.add(lathe(&[(0.0, 0.011), (0.036, 0.011), (0.036, 0.201), (0.0, 0.201)].map(Vec2::from), 28), HERE, core);
    let ring: Vec<Vec3> =
        (0..=20).map(|i| PI * i as f32 / 20.0).map(|a| vec3(0.04 * a.cos(), 0.211 + 0.045 * a.sin(), 0.0)).collect();
    b.add(tube(&ring, &[0.003; 21], 10), HERE, black);
    b
}

/// A wooden tray, 0.46 m × 0.32 m.
pub fn tray() -> Builder {
    let mut b = Builder::default();
    let wood = textures::wood(vec3(0.16, 0.06, 0.025), vec3(0.34, 0.15, 0.06), 26);
    let wood = b.textured(glossy("lacquered wood", [1.0; 3], 0.18), wood);
    let uv = Vec2::splat(2.5);
    b.add(block(vec3(-0.225, 0.0, -0.155), vec3(0.225, 0.012, 0.155)).uv_scaled(uv), HERE, wood);
    for (centre, size) in [
        (vec3(0.0, 0.02, 0.155), vec3(0.46, 0.042, 0.012)),
        (vec3(0.0, 0.02, -0.155), vec3(0.46, 0.042, 0.012)),
        (vec3(0.225, 0.02, 0.0), vec3(0.0119, 0.0419, 0.30)),
        (vec3(-0.225, 0.02, 0.0), vec3(0.0119, 0.0419, 0.30)),
    ] {
        b.add(rounded_block(size, 0.004, 2, 1, 0.0).uv_scaled(uv), Affine3A::from_translation(centre), wood);
    }
    b
}

/// A standing mirror, 1.5 m × 0.52 m in a wooden frame on two feet, facing +Z and leaning back a little.
pub fn standing_mirror() -> Builder {
    let mut b = Builder::default();
    let wood = textures::wood(vec3(0.12, 0.055, 0.025), vec3(0.28, 0.14, 0.065), 27);
    let wood = b.textured(glossy("frame wood", [1.0; 3], 0.35), wood);
    let mirror = b.material(metal("silvered glass", [0.93, 0.94, 0.93], 0.0));
    let back = Affine3A::from_translation(Vec3::Y * 0.06) * Affine3A::from_rotation_x(-0.07);
    for (centre, size) in [
        (vec3(0.0, 0.02, 0.0), vec3(0.56, 0.045, 0.04)),
        (vec3(0.0, 1.48, 0.0), vec3(0.56, 0.045, 0.04)),
        (vec3(-0.262, 0.75, 0.0), vec3(0.0445, 1.46, 0.0395)),
        (vec3(0.262, 0.75, 0.0), vec3(0.0445, 1.46, 0.0395)),
    ] {
        let bar = rounded_block(size, 0.008, 2, 1, 0.0).uv_scaled(vec2(2.0, 2.0));
        b.add(bar, back * Affine3A::from_translation(centre), wood);
    }
    b.add(block(vec3(-0.25, 0.03, -0.012), vec3(0.25, 1.47, 0.005)), back, mirror);
    for x in [-0.26, 0.26] {
        b.add(
            tube(&[vec3(x, 0.012, 0.17), vec3(x, 0.085, 0.0), vec3(x, 0.012, -0.2)], &[0.012, 0.017, 0.012], 14),
            HERE,
            wood,
        );
    }
    b
}

/// A knotted tube on a small foot, 0.46 m tall: glossy lacquer.
pub fn knot(color: [f32; 3]) -> Builder {
    let mut b = Builder::default();
    let lacquer = b.material(glossy("lacquer", color, 0.06));
    let steel = b.material(metal("brushed steel", [0.62, 0.62, 0.64], 0.28));
    let count = 160;
    let path: Vec<Vec3> = (0..=count)
        .map(|i| TAU * (i % count) as f32 / count as f32)
        .map(|t| {
            let r = 0.115 + 0.05 * (3.0 * t).cos();
            vec3(r * (2.0 * t).cos(), 0.268 + r * (2.0 * t).sin(), 0.062 * (3.0 * t).sin())
        })
        .collect();
    b.add(tube(&path, &vec![0.027; count + 1], 24), HERE, lacquer);
    let foot = [
        (0.0, 0.0),
        (0.085, 0.0),
        (0.088, 0.004),
        (0.085, 0.016),
        (0.016, 0.022),
        (0.012, 0.03),
        (0.012, 0.12),
        (0.0, 0.12),
    ];
    b.add(lathe(&foot.map(Vec2::from), 36), HERE, steel);
    b
}

/// A ring of light, 0.7 m across, standing in a dark block.
pub fn ring_of_light() -> Builder {
    let mut b = Builder::default();
    let stone = b.material(glossy("black stone", [0.02, 0.02, 0.022], 0.12));
    let glow = b.material(shining("neon", [1.1, 4.6, 5.4]));
    b.add(rounded_block(vec3(0.30, 0.10, 0.16), 0.01, 3, 1, 0.0), Affine3A::from_translation(Vec3::Y * 0.05), stone);
    let count = 72;
    let path: Vec<Vec3> = (0..=count)
        .map(|i| TAU * (i % count) as f32 / count as f32)
        .map(|a| vec3(0.33 * a.sin(), 0.41 - 0.33 * a.cos(), 0.0))
        .collect();
    b.add(tube(&path, &vec![0.013; count + 1], 16), HERE, glow);
    b
}
