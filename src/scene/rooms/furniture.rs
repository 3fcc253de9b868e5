//! Furniture. Each function builds one piece about the middle of its footprint, facing +Z, and places it by
//! `at`. Feet reach 5 mm into the floor, and backs into walls, so that no two faces share a plane.

use super::kit::{Builder, Solid, block, curtain, hash, lathe, leaf, quad, rounded_block, sphere, tube};
use glam::{Affine3A, Quat, Vec2, Vec3, vec2, vec3};
use std::f32::consts::TAU;

/// A placement: translation in metres, turn about +Y in degrees.
pub fn place(x: f32, y: f32, z: f32, turn: f32) -> Affine3A {
    Affine3A::from_rotation_translation(Quat::from_rotation_y(turn.to_radians()), vec3(x, y, z))
}

/// Returns the placement raised by `y` metres.
pub fn lifted(y: f32) -> Affine3A {
    Affine3A::from_translation(Vec3::Y * y)
}

/// A block about `centre`.
pub fn centred(centre: Vec3, size: Vec3) -> Solid {
    block(centre - size * 0.5, centre + size * 0.5)
}

/// Four tapered feet at (±x, ±z), up to `height`.
pub fn feet(x: f32, z: f32, height: f32, radius: f32) -> Solid {
    let foot = lathe(&[vec2(0.0, -0.005), vec2(radius * 0.6, -0.005), vec2(radius, height), vec2(0.0, height)], 10);
    [(x, z), (-x, z), (x, -z), (-x, -z)]
        .into_iter()
        .map(|(x, z)| foot.clone().placed(place(x, 0.0, z, 0.0)))
        .fold(Solid::default(), Solid::and)
}

/// Cloth and wood of a [`sofa`].
pub struct Upholstery {
    pub cloth: u32,
    pub wood: u32,
    /// Throw pillows, from left to right.
    pub pillows: Vec<u32>,
}

/// A sofa of `seats` cushions of 0.78 m between two arms; one seat makes an armchair.
pub fn sofa(b: &mut Builder, at: Affine3A, seats: usize, look: &Upholstery) {
    let cloth_uv = Vec2::splat(4.0);
    let inner = 0.78 * seats as f32;
    let mut soft = |part: Solid, place: Affine3A| b.add(part.uv_scaled(cloth_uv), at * place, look.cloth);
    soft(rounded_block(vec3(inner + 0.3, 0.2, 0.8), 0.03, 2, 1, 0.0), lifted(0.22));
    for side in [-1.0, 1.0] {
        let x = side * (inner + 0.2) * 0.5;
        soft(rounded_block(vec3(0.2, 0.52, 0.86), 0.07, 3, 1, 0.0), place(x, 0.37, 0.01, 0.0));
    }
    let lean =
        |x: f32, y: f32, z: f32, tilt: f32| place(x, y, z, 0.0) * Affine3A::from_rotation_x((-tilt).to_radians());
    soft(rounded_block(vec3(inner + 0.02, 0.56, 0.2), 0.08, 3, 1, 0.0), lean(0.0, 0.54, -0.32, 8.0));
    for i in 0..seats {
        let x = (i as f32 - (seats as f32 - 1.0) * 0.5) * 0.78;
        soft(rounded_block(vec3(0.765, 0.15, 0.64), 0.05, 2, 3, 0.03), place(x, 0.375, 0.1, 0.0));
        soft(rounded_block(vec3(0.755, 0.42, 0.15), 0.06, 2, 3, 0.045), lean(x, 0.67, -0.15, 14.0));
    }
    for (i, &material) in look.pillows.iter().enumerate() {
        let x = (i as f32 / (look.pillows.len().max(2) - 1) as f32 - 0.5) * (inner - 0.45);
        let tilt = lean(x, 0.63, 0.07, 24.0) * Affine3A::from_rotation_z((hash(i as i32, 0, 61) - 0.5) * 0.5);
        b.add(rounded_block(vec3(0.40, 0.40, 0.07), 0.034, 2, 4, 0.05).uv_scaled(cloth_uv), at * tilt, material);
    }
    b.add(feet(inner * 0.5, 0.3, 0.13, 0.025), at, look.wood);
}

/// A low table, top at 0.42 m.
pub fn coffee_table(b: &mut Builder, at: Affine3A, size: Vec2, top: u32, legs: u32) {
    b.add(
        rounded_block(vec3(size.x, 0.035, size.y), 0.012, 2, 1, 0.0).uv_scaled(vec2(1.2, 1.8)),
        at * lifted(0.4025),
        top,
    );
    b.add(centred(vec3(0.0, 0.36, 0.0), vec3(size.x - 0.16, 0.055, size.y - 0.16)), at, legs);
    b.add(feet(size.x * 0.5 - 0.07, size.y * 0.5 - 0.07, 0.39, 0.024), at, legs);
}

/// A bookcase 1.5 m × 2 m, its back at z = 0, filled with books of the given materials.
pub fn bookcase(b: &mut Builder, at: Affine3A, board: u32, books: &[u32], ornament: u32) {
    let (width, height, depth, t) = (1.5, 2.0, 0.30, 0.024);
    let mut boards = Solid::default();
    for side in [-1.0, 1.0] {
        boards = boards
            .and(centred(vec3(side * (width - t) * 0.5, height * 0.5, depth * 0.5), vec3(t, height + 0.012, depth)));
    }
    boards = boards.and(centred(vec3(0.0, height * 0.5, 0.004), vec3(width - 0.022, height - 0.06, 0.018)));
    let levels: [f32; 6] = [0.08, 0.46, 0.82, 1.18, 1.54, 1.98];
    for y in levels {
        boards = boards.and(centred(vec3(0.0, y, depth * 0.5 - 0.002), vec3(width - 0.02, t, depth - 0.012)));
    }
    boards = boards.and(centred(vec3(0.0, 0.035, depth * 0.5 - 0.02), vec3(width - 0.018, 0.074, depth - 0.06)));
    b.add(boards.uv_scaled(Vec2::splat(1.3)), at, board);
    for (shelf, &y) in levels[..5].iter().enumerate() {
        let random = |i: i32, k: u32| hash(i, shelf as i32, 70 + k);
        let mut x = -width * 0.5 + t + 0.012;
        let floor = y + t * 0.5 + 0.0005;
        let gap_at = -0.3 + 0.75 * random(-1, 0);
        let mut i = 0;
        while x < width * 0.5 - 0.1 {
            if x > gap_at && x < gap_at + 0.05 {
                // Every shelf has a free place. A vessel stands on some of them.
                if shelf % 2 == 1 {
                    let bowl = [
                        (0.0, 0.0),
                        (0.035, 0.0),
                        (0.07, 0.09),
                        (0.062, 0.15),
                        (0.03, 0.19),
                        (0.034, 0.21),
                        (0.0, 0.205),
                    ];
                    b.add(lathe(&bowl.map(Vec2::from), 20), at * place(x + 0.11, floor, 0.17, 0.0), ornament);
                }
                x += 0.26;
                continue;
            }
            let thick = 0.016 + 0.03 * random(i, 1);
            let tall = 0.19 + 0.1 * random(i / 3, 2) - 0.015 * random(i, 3);
            let deep = 0.15 + 0.06 * random(i / 3, 4) - 0.01 * random(i, 5);
            let front = 0.225 + 0.02 * random(i, 6);
            let book = block(vec3(x, floor, front - deep), vec3(x + thick - 0.001, floor + tall, front));
            b.add(book, at, books[(random(i / 2, 7) * books.len() as f32) as usize % books.len()]);
            x += thick;
            i += 1;
        }
    }
}

/// A low cupboard with three doors, its back at z = 0; top at 0.74 m.
pub fn sideboard(b: &mut Builder, at: Affine3A, width: f32, wood: u32, fronts: u32, metal: u32) {
    let uv = Vec2::splat(1.2);
    b.add(block(vec3(-width * 0.5, 0.14, 0.002), vec3(width * 0.5, 0.74, 0.42)).uv_scaled(uv), at, wood);
    let panel = (width - 0.04) / 3.0;
    for i in 0..3 {
        let x = (i as f32 - 1.0) * panel;
        b.add(
            rounded_block(vec3(panel - 0.008, 0.55, 0.02), 0.004, 1, 1, 0.0).uv_scaled(uv),
            at * place(x, 0.44, 0.425, 0.0),
            fronts,
        );
        let knob = tube(&[vec3(0.0, -0.05, 0.0), vec3(0.0, 0.05, 0.0)], &[0.007, 0.007], 8);
        b.add(knob, at * place(x + panel * 0.38, 0.5, 0.447, 0.0), metal);
    }
    b.add(feet(width * 0.5 - 0.08, 0.15, 0.15, 0.022), at * place(0.0, 0.0, 0.21, 0.0), metal);
}

/// A floor lamp: round foot, stem, and a shade that shines.
pub fn floor_lamp(b: &mut Builder, at: Affine3A, metal: u32, shade: u32) {
    let foot = [
        (0.0, -0.004),
        (0.15, -0.004),
        (0.15, 0.014),
        (0.14, 0.022),
        (0.02, 0.03),
        (0.012, 0.05),
        (0.012, 1.42),
        (0.0, 1.42),
    ];
    b.add(lathe(&foot.map(Vec2::from), 24), at, metal);
    let drum = [
        (0.0, 1.355),
        (0.195, 1.355),
        (0.2, 1.34),
        (0.205, 1.34),
        (0.155, 1.63),
        (0.15, 1.63),
        (0.146, 1.615),
        (0.0, 1.615),
    ];
    b.add(lathe(&drum.map(Vec2::from), 24), at, shade);
    b.add(lathe(&[vec2(0.0, 1.60), vec2(0.012, 1.60), vec2(0.012, 1.66), vec2(0.0, 1.67)], 8), at, metal);
}

/// A potted plant about 1.5 m tall.
pub fn plant(b: &mut Builder, at: Affine3A, pot: u32, soil: u32, stem: u32, leaves: [u32; 2]) {
    let profile = [
        (0.0, -0.004),
        (0.13, -0.004),
        (0.18, 0.34),
        (0.19, 0.34),
        (0.19, 0.37),
        (0.165, 0.37),
        (0.165, 0.33),
        (0.0, 0.33),
    ];
    b.add(lathe(&profile.map(Vec2::from), 28), at, pot);
    b.add(lathe(&[vec2(0.0, 0.30), vec2(0.17, 0.30), vec2(0.16, 0.34), vec2(0.0, 0.355)], 20), at, soil);
    for s in 0..5 {
        let random = |k: u32| hash(s, 3, 90 + k);
        let turn = s as f32 * TAU / 5.0 + random(0);
        let (lean, height) = (0.10 + 0.17 * random(1), 0.55 + 0.55 * random(2));
        let point =
            |t: f32| vec3(turn.cos() * (0.04 + lean * t * t), 0.33 + height * t, turn.sin() * (0.04 + lean * t * t));
        let path: Vec<Vec3> = (0..=6).map(|i| point(i as f32 / 6.0)).collect();
        let radii: Vec<f32> = (0..=6).map(|i| 0.011 - 0.0012 * i as f32).collect();
        b.add(tube(&path, &radii, 8), at, stem);
        for l in 0..7 {
            let t = 0.34 + 0.66 * l as f32 / 6.0;
            let random = |k: u32| hash(s * 16 + l, 4, 90 + k);
            let size = (0.22 + 0.12 * random(0)) * (1.15 - 0.35 * t);
            let blade = leaf(size, size * 0.42, 0.10 + 0.08 * random(1), 0.14 + 0.16 * random(2));
            let spin = Quat::from_rotation_y(l as f32 * 2.4 + turn + random(3) * 0.7);
            let grown = Affine3A::from_rotation_translation(spin, point(t));
            b.add(blade, at * grown, leaves[(random(4) > 0.5) as usize]);
        }
    }
}

/// A framed picture that hangs on a wall at z = 0, with `at` at its centre.
pub fn picture(b: &mut Builder, at: Affine3A, size: Vec2, canvas: u32, frame: u32) {
    let bar = 0.028;
    let (w, h) = (size.x * 0.5, size.y * 0.5);
    // The uprights end where the cross bars begin.
    let bars = [
        (vec3(0.0, h + bar * 0.5, 0.012), vec3(size.x + 2.0 * bar, bar, 0.034)),
        (vec3(0.0, -h - bar * 0.5, 0.012), vec3(size.x + 2.0 * bar, bar, 0.034)),
        (vec3(w + bar * 0.5, 0.0, 0.012), vec3(bar, size.y, 0.034)),
        (vec3(-w - bar * 0.5, 0.0, 0.012), vec3(bar, size.y, 0.034)),
    ];
    for (centre, size) in bars {
        b.add(centred(centre, size), at, frame);
    }
    let sheet = quad(vec3(-w - 0.002, -h - 0.002, 0.014), Vec3::X * (size.x + 0.004), Vec3::Y * (size.y + 0.004));
    b.add(sheet.uv_scaled(vec2(1.0 / (size.x + 0.004), 1.0 / (size.y + 0.004))), at, canvas);
}

/// A closed door with its frame on a wall at z = 0.
pub fn door(b: &mut Builder, at: Affine3A, leaf_paint: u32, frame: u32, metal: u32) {
    let (w, h) = (0.42, 2.04);
    for x in [-w - 0.04, w + 0.04] {
        b.add(block(vec3(x - 0.04, -0.004, -0.006), vec3(x + 0.04, h, 0.035)), at, frame);
    }
    b.add(block(vec3(-w - 0.08, h, -0.005), vec3(w + 0.08, h + 0.08, 0.035)), at, frame);
    b.add(block(vec3(-w - 0.002, 0.006, -0.004), vec3(w + 0.002, h + 0.002, 0.018)), at, leaf_paint);
    for (y0, y1) in [(0.22, 0.86), (1.06, 1.88)] {
        let size = vec3(0.56, y1 - y0, 0.024);
        b.add(rounded_block(size, 0.011, 2, 1, 0.0), at * place(0.0, (y0 + y1) * 0.5, 0.017, 0.0), leaf_paint);
    }
    let handle = [vec3(0.34, 1.0, 0.01), vec3(0.34, 1.0, 0.06), vec3(0.325, 1.0, 0.07), vec3(0.23, 1.0, 0.07)];
    b.add(tube(&handle, &[0.009; 4], 10), at, metal);
}

/// A window's curtains and their rod on a wall at z = 0. The window spans `width` about x = 0, and the rod
/// hangs at `top`.
pub fn curtains(b: &mut Builder, at: Affine3A, width: f32, top: f32, cloth: u32, metal: u32) {
    let reach = width * 0.5 + 0.32;
    for side in [-1.0, 1.0] {
        let hung = curtain(0.40, top - 0.06, 4, 0.028).uv_scaled(Vec2::splat(4.0));
        b.add(hung, at * place(side * (width * 0.5 + 0.10), 0.03, 0.11, 0.0), cloth);
        b.add(sphere(0.03, 14), at * place(side * (reach + 0.02), top, 0.11, 0.0), metal);
        b.add(
            tube(&[vec3(side * (reach - 0.05), top, -0.005), vec3(side * (reach - 0.05), top, 0.11)], &[0.008; 2], 8),
            at,
            metal,
        );
    }
    b.add(tube(&[vec3(-reach, top, 0.11), vec3(reach, top, 0.11)], &[0.014; 2], 12), at, metal);
}

/// A ribbed radiator on a wall at z = 0, clear of the floor.
pub fn radiator(b: &mut Builder, at: Affine3A, width: f32, paint: u32) {
    let ribs = (width / 0.075) as i32;
    for i in 0..ribs {
        let x = (i as f32 - (ribs - 1) as f32 * 0.5) * 0.075;
        b.add(rounded_block(vec3(0.06, 0.52, 0.07), 0.024, 1, 1, 0.0), at * place(x, 0.40, 0.075, 0.0), paint);
    }
    for y in [0.2, 0.6] {
        let half = width * 0.5 - 0.05;
        b.add(tube(&[vec3(-half, y, 0.075), vec3(half, y, 0.075)], &[0.014; 2], 10), at, paint);
    }
}

/// A tall vase with dry twigs, standing at `at`.
pub fn vase(b: &mut Builder, at: Affine3A, glaze: u32, twig: u32) {
    let profile = [
        (0.0, 0.001),
        (0.045, 0.001),
        (0.075, 0.07),
        (0.082, 0.13),
        (0.07, 0.20),
        (0.04, 0.26),
        (0.03, 0.30),
        (0.04, 0.33),
        (0.035, 0.33),
        (0.024, 0.30),
        (0.0, 0.27),
    ];
    b.add(lathe(&profile.map(Vec2::from), 28), at, glaze);
    for i in 0..7 {
        let random = |k: u32| hash(i, 5, 110 + k);
        let turn = i as f32 * 2.4;
        let lean = 0.06 + 0.14 * random(0);
        let path: Vec<Vec3> = (0..=5)
            .map(|k| {
                let t = k as f32 / 5.0;
                let bend = 0.015 * (9.0 * t + random(1) * 6.0).sin();
                let out = 0.008 + lean * t * t;
                vec3(turn.cos() * out + bend * t, 0.275 + (0.35 + 0.2 * random(2)) * t, turn.sin() * out + bend * t)
            })
            .collect();
        b.add(tube(&path, &[0.003, 0.003, 0.003, 0.0025, 0.002, 0.0015], 6), at, twig);
        b.add(sphere(0.014, 10), at * Affine3A::from_translation(path[5]), glaze);
    }
}

/// A stack of magazines that lie flat.
pub fn magazines(b: &mut Builder, at: Affine3A, covers: &[u32]) {
    let mut y = 0.0005;
    for (i, &cover) in covers.iter().enumerate() {
        let thick = 0.008 + 0.014 * hash(i as i32, 6, 120);
        let turn = (hash(i as i32, 7, 120) - 0.5) * 30.0;
        let size = vec2(0.15, 0.105) * (1.0 - 0.12 * i as f32);
        b.add(block(vec3(-size.x, 0.0, -size.y), vec3(size.x, thick, size.y)), at * place(0.0, y, 0.0, turn), cover);
        y += thick + 0.0005;
    }
}

/// A waste-paper basket. Its inside is modelled, too.
pub fn basket(b: &mut Builder, at: Affine3A, paint: u32) {
    let profile = [(0.0, -0.004), (0.12, -0.004), (0.15, 0.3), (0.142, 0.3), (0.113, 0.012), (0.0, 0.012)];
    b.add(lathe(&profile.map(Vec2::from), 28), at, paint);
}
