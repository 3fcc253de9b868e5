//! Furniture of the bedroom, built as in [`furniture`](super::furniture): about the middle of its footprint,
//! facing +Z.

use super::furniture::{centred, feet, lifted, place};
use super::kit::{Builder, Solid, block, lathe, rounded_block, sphere, tube};
use glam::{Affine3A, Vec2, Vec3, vec2, vec3};

/// What a [`bed`] is made of.
pub struct Bedding {
    pub wood: u32,
    pub headboard: u32,
    pub sheet: u32,
    pub duvet: u32,
    pub blanket: u32,
    pub pillows: [u32; 2],
}

/// A double bed, 1.7 m × 2.1 m, with its headboard's back at z = 0 and a lying height of 0.55 m.
pub fn bed(b: &mut Builder, at: Affine3A, look: &Bedding) {
    b.add(block(vec3(-0.84, 0.13, 0.05), vec3(0.84, 0.29, 2.06)).uv_scaled(Vec2::splat(1.2)), at, look.wood);
    b.add(feet(0.76, 0.92, 0.14, 0.03), at * place(0.0, 0.0, 1.05, 0.0), look.wood);
    b.add(
        rounded_block(vec3(1.74, 0.95, 0.10), 0.035, 3, 1, 0.0).uv_scaled(Vec2::splat(3.0)),
        at * place(0.0, 0.62, 0.045, 0.0),
        look.headboard,
    );
    let cloth = |part: Solid| part.uv_scaled(Vec2::splat(3.0));
    b.add(cloth(rounded_block(vec3(1.62, 0.24, 1.96), 0.06, 3, 2, 0.0)), at * place(0.0, 0.40, 1.075, 0.0), look.sheet);
    b.add(
        cloth(rounded_block(vec3(1.79, 0.26, 1.36), 0.075, 4, 5, 0.035)),
        at * place(0.0, 0.445, 1.405, 0.0),
        look.duvet,
    );
    // The duvet's folded edge, and a blanket across the foot.
    b.add(
        cloth(rounded_block(vec3(1.80, 0.09, 0.30), 0.042, 4, 3, 0.01)),
        at * place(0.0, 0.572, 0.80, 0.0),
        look.sheet,
    );
    b.add(
        cloth(rounded_block(vec3(1.83, 0.30, 0.56), 0.08, 4, 4, 0.03)),
        at * place(0.0, 0.452, 1.70, 0.0),
        look.blanket,
    );
    for (x, z, tilt, turn, which) in [
        (-0.41, 0.21, 62.0, 2.0, 0),
        (0.41, 0.21, 60.0, -3.0, 0),
        (-0.33, 0.40, 52.0, -5.0, 1),
        (0.37, 0.41, 50.0, 6.0, 1),
    ] {
        let size = if which == 0 { vec3(0.68, 0.44, 0.10) } else { vec3(0.52, 0.36, 0.09) };
        let lean =
            place(x, 0.655 - 0.015 * which as f32, z, turn) * Affine3A::from_rotation_x(-(90.0f32 - tilt).to_radians());
        b.add(cloth(rounded_block(size, 0.04, 3, 5, 0.06)), at * lean, look.pillows[which]);
    }
}

/// A bedside table, top at 0.5 m, its back at z = 0.
pub fn nightstand(b: &mut Builder, at: Affine3A, wood: u32, front: u32, metal: u32) {
    let uv = Vec2::splat(1.6);
    b.add(block(vec3(-0.22, 0.12, 0.002), vec3(0.22, 0.47, 0.36)).uv_scaled(uv), at, wood);
    b.add(
        rounded_block(vec3(0.50, 0.032, 0.41), 0.012, 2, 1, 0.0).uv_scaled(uv),
        at * place(0.0, 0.484, 0.2, 0.0),
        wood,
    );
    for y in [0.215, 0.375] {
        b.add(
            rounded_block(vec3(0.40, 0.145, 0.02), 0.005, 1, 1, 0.0).uv_scaled(uv),
            at * place(0.0, y, 0.365, 0.0),
            front,
        );
        b.add(sphere(0.012, 12), at * place(0.0, y, 0.386, 0.0), metal);
    }
    b.add(feet(0.18, 0.13, 0.13, 0.02), at * place(0.0, 0.0, 0.18, 0.0), wood);
}

/// A small lamp, 0.38 m tall: a turned foot and a shade that shines.
pub fn table_lamp(b: &mut Builder, at: Affine3A, foot: u32, shade: u32) {
    let profile = [
        (0.0, 0.0005),
        (0.062, 0.0005),
        (0.064, 0.012),
        (0.03, 0.03),
        (0.022, 0.05),
        (0.042, 0.09),
        (0.05, 0.13),
        (0.036, 0.175),
        (0.012, 0.20),
        (0.009, 0.23),
        (0.0, 0.23),
    ];
    b.add(lathe(&profile.map(Vec2::from), 28), at, foot);
    let drum = [(0.0, 0.215), (0.092, 0.215), (0.096, 0.22), (0.066, 0.365), (0.062, 0.368), (0.0, 0.368)];
    b.add(lathe(&drum.map(Vec2::from), 20), at, shade);
    b.add(lathe(&[(0.0, 0.36), (0.006, 0.36), (0.006, 0.38), (0.0, 0.385)].map(Vec2::from), 8), at, foot);
}

/// A wardrobe 2.12 m tall with three doors, its back at z = 0.
pub fn wardrobe(b: &mut Builder, at: Affine3A, width: f32, wood: u32, doors: u32, metal: u32) {
    let uv = Vec2::splat(0.9);
    let half = width * 0.5;
    b.add(block(vec3(-half, -0.004, 0.002), vec3(half, 2.1, 0.55)).uv_scaled(uv), at, wood);
    b.add(
        rounded_block(vec3(width + 0.07, 0.06, 0.62), 0.02, 2, 1, 0.0).uv_scaled(uv),
        at * place(0.0, 2.115, 0.292, 0.0),
        wood,
    );
    let panel = (width - 0.05) / 3.0;
    for i in 0..3 {
        let x = (i as f32 - 1.0) * panel;
        b.add(
            rounded_block(vec3(panel - 0.008, 1.92, 0.024), 0.005, 1, 1, 0.0).uv_scaled(uv),
            at * place(x, 1.07, 0.555, 0.0),
            doors,
        );
        for (y, h) in [(0.52, 0.66), (1.46, 0.96)] {
            b.add(
                rounded_block(vec3(panel - 0.16, h, 0.02), 0.009, 2, 1, 0.0).uv_scaled(uv),
                at * place(x, y, 0.567, 0.0),
                doors,
            );
        }
        let side = if i == 0 { 1.0 } else { -1.0 };
        let knob = tube(&[vec3(0.0, -0.07, 0.0), vec3(0.0, 0.07, 0.0)], &[0.008; 2], 10);
        b.add(knob, at * place(x + side * (panel * 0.5 - 0.04), 1.02, 0.578, 0.0), metal);
    }
}

/// A chest of drawers, 0.8 m tall, its back at z = 0.
pub fn dresser(b: &mut Builder, at: Affine3A, width: f32, wood: u32, front: u32, metal: u32) {
    let uv = Vec2::splat(1.2);
    let half = width * 0.5;
    b.add(block(vec3(-half, 0.1, 0.002), vec3(half, 0.77, 0.44)).uv_scaled(uv), at, wood);
    b.add(
        rounded_block(vec3(width + 0.05, 0.035, 0.49), 0.012, 2, 1, 0.0).uv_scaled(uv),
        at * place(0.0, 0.783, 0.236, 0.0),
        wood,
    );
    for (row, y) in [0.21, 0.435, 0.655].into_iter().enumerate() {
        let columns = if row == 2 { 2 } else { 1 };
        let w = (width - 0.05) / columns as f32;
        for c in 0..columns {
            let x = (c as f32 - (columns as f32 - 1.0) * 0.5) * w;
            b.add(
                rounded_block(vec3(w - 0.01, 0.205, 0.024), 0.006, 1, 1, 0.0).uv_scaled(uv),
                at * place(x, y, 0.445, 0.0),
                front,
            );
            for k in [-0.28, 0.28] {
                if columns == 1 {
                    b.add(sphere(0.016, 12), at * place(x + k * w, y, 0.471, 0.0), metal);
                }
            }
            if columns == 2 {
                b.add(sphere(0.016, 12), at * place(x, y, 0.471, 0.0), metal);
            }
        }
    }
    b.add(feet(half - 0.05, 0.17, 0.11, 0.024), at * place(0.0, 0.0, 0.22, 0.0), wood);
}

/// A wooden chair with a slatted back, seat at 0.45 m.
pub fn chair(b: &mut Builder, at: Affine3A, wood: u32, cloth: u32) {
    for x in [-0.19, 0.19] {
        b.add(tube(&[vec3(x, -0.005, 0.19), vec3(x * 0.97, 0.43, 0.18)], &[0.014, 0.019], 12), at, wood);
        let back = [vec3(x, -0.005, -0.21), vec3(x, 0.43, -0.18), vec3(x * 0.95, 0.90, -0.25)];
        b.add(tube(&back, &[0.014, 0.019, 0.015], 12), at, wood);
        b.add(tube(&[vec3(x, 0.22, 0.185), vec3(x, 0.22, -0.195)], &[0.009; 2], 8), at, wood);
    }
    b.add(centred(vec3(0.0, 0.415, 0.0), vec3(0.40, 0.035, 0.39)).uv_scaled(Vec2::splat(2.0)), at, wood);
    b.add(
        rounded_block(vec3(0.42, 0.05, 0.41), 0.022, 3, 3, 0.012).uv_scaled(Vec2::splat(4.0)),
        at * lifted(0.45),
        cloth,
    );
    for (y, z) in [(0.58, -0.205), (0.71, -0.222), (0.84, -0.241)] {
        b.add(
            rounded_block(vec3(0.37, 0.06, 0.016), 0.006, 2, 1, 0.0),
            at * place(0.0, y, z, 0.0) * Affine3A::from_rotation_x(-0.14),
            wood,
        );
    }
}

/// A paper globe that hangs under the ceiling from `at`. It is not lit.
pub fn paper_globe(b: &mut Builder, at: Affine3A, radius: f32, paper: u32, cord: u32) {
    b.add(tube(&[vec3(0.0, 0.005, 0.0), vec3(0.0, -0.34, 0.0)], &[0.004; 2], 8), at, cord);
    b.add(lathe(&[vec2(0.0, -0.02), vec2(0.05, -0.02), vec2(0.05, 0.004), vec2(0.0, 0.004)], 20), at, cord);
    // Ribs run all round, as such lamps have them.
    let profile: Vec<Vec2> = (0..=24)
        .map(|i| {
            let angle = std::f32::consts::PI * i as f32 / 24.0;
            let r = radius * if i % 2 == 0 { 1.0 } else { 0.975 };
            vec2(if i == 0 || i == 24 { 0.0 } else { r * angle.sin() }, -r * angle.cos())
        })
        .collect();
    b.add(lathe(&profile, 32), at * Affine3A::from_translation(Vec3::NEG_Y * (0.3 + radius)), paper);
}
