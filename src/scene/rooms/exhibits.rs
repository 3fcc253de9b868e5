//! The furniture of the gallery, built as in [`furniture`](super::furniture).

use super::furniture::{centred, lifted, place};
use super::kit::{Builder, Solid, block, lathe, rounded_block, sphere, tube};
use super::textures;
use glam::{Affine3A, Vec2, Vec3, vec2, vec3};

/// Makes a white box to show things on, `size.y` high.
pub fn plinth(b: &mut Builder, at: Affine3A, size: Vec3, paint: u32) {
    b.add(block(vec3(-size.x * 0.5, 0.03, -size.z * 0.5), vec3(size.x * 0.5, size.y, size.z * 0.5)), at, paint);
    let foot = vec3(size.x - 0.05, 0.04, size.z - 0.05);
    b.add(centred(vec3(0.0, 0.014, 0.0), foot), at, paint);
}

/// Makes the ring where a post meets the floor.
pub fn collar(radius: f32) -> Solid {
    lathe(
        &[
            vec2(0.0, -0.004),
            vec2(radius + 0.05, -0.004),
            vec2(radius + 0.05, 0.008),
            vec2(radius + 0.01, 0.018),
            vec2(0.0, 0.018),
        ],
        24,
    )
}

/// Makes stanchions, 0.95 m high, with a rope from each to the next.
pub fn barrier(b: &mut Builder, stands: &[Vec3], metal: u32, rope: u32) {
    for &stand in stands {
        let at = Affine3A::from_translation(stand);
        let foot = [
            (0.0, -0.004),
            (0.15, -0.004),
            (0.15, 0.012),
            (0.10, 0.03),
            (0.024, 0.045),
            (0.018, 0.07),
            (0.018, 0.90),
            (0.028, 0.905),
            (0.028, 0.93),
            (0.0, 0.93),
        ];
        b.add(lathe(&foot.map(Vec2::from), 24), at, metal);
        b.add(sphere(0.034, 16), at * lifted(0.955), metal);
    }
    for pair in stands.windows(2) {
        let path: Vec<Vec3> = (0..=14)
            .map(|i| {
                let t = i as f32 / 14.0;
                pair[0].lerp(pair[1], t) + Vec3::Y * (0.88 - 0.22 * (1.0 - (2.0 * t - 1.0).powi(2)))
            })
            .collect();
        b.add(tube(&path, &[0.015; 15], 10), Affine3A::IDENTITY, rope);
    }
}

/// Makes a bench with a slatted seat at 0.44 m on two steel frames.
pub fn bench(b: &mut Builder, at: Affine3A, width: f32, wood: u32, metal: u32) {
    for i in 0..5 {
        let z = (i as f32 - 2.0) * 0.085;
        b.add(
            rounded_block(vec3(width, 0.035, 0.072), 0.008, 2, 1, 0.0).uv_scaled(vec2(1.2, 1.2)),
            at * place(0.0, 0.4225, z, 0.0),
            wood,
        );
    }
    for x in [-width * 0.5 + 0.16, width * 0.5 - 0.16] {
        b.add(centred(vec3(x, 0.395, 0.0), vec3(0.05, 0.03, 0.40)), at, metal);
        b.add(centred(vec3(x, 0.19, 0.17), vec3(0.045, 0.39, 0.03)), at, metal);
        b.add(centred(vec3(x, 0.19, -0.17), vec3(0.045, 0.39, 0.03)), at, metal);
    }
}

/// Makes a lighting track under the ceiling (`at`), with spots that are switched off.
pub fn track(b: &mut Builder, at: Affine3A, length: f32, metal: u32) {
    b.add(centred(vec3(0.0, -0.10, 0.0), vec3(length, 0.03, 0.035)), at, metal);
    let spots = 7;
    for i in 0..spots {
        let x = (i as f32 / (spots - 1) as f32 - 0.5) * (length - 0.4);
        b.add(tube(&[vec3(x, -0.1, 0.0), vec3(x, -0.19, 0.0)], &[0.008; 2], 8), at, metal);
        let can = lathe(&[(0.0, -0.07), (0.05, -0.07), (0.05, 0.08), (0.03, 0.10), (0.0, 0.10)].map(Vec2::from), 18);
        let tilt = Affine3A::from_rotation_x(if i % 2 == 0 { 0.55 } else { -0.5 });
        b.add(can, at * place(x, -0.235, 0.0, 0.0) * tilt, metal);
    }
    for x in [-length * 0.5 + 0.3, length * 0.5 - 0.3] {
        b.add(tube(&[vec3(x, 0.005, 0.0), vec3(x, -0.1, 0.0)], &[0.008; 2], 8), at, metal);
    }
}

/// Makes the screen that swings about a post at its own +Y axis: a painted board 1.15 m × 1.7 m in a frame,
/// on two arms.
pub fn screen(b: &mut Builder) {
    let frame = b.paint("screen frame", [0.05, 0.045, 0.04]);
    let (near, far, low, high) = (0.10, 1.25, 0.35, 2.05);
    for (kind, turned) in [(0, false), (1, true)] {
        let face = b.painted(if turned { "screen back" } else { "screen front" }, textures::painting(3 + kind));
        let size = vec2(far - near, high - low);
        let (corner, along) = if turned {
            (vec3(far, low, -0.012), Vec3::NEG_X * size.x)
        } else {
            (vec3(near, low, 0.012), Vec3::X * size.x)
        };
        let sheet = super::kit::quad(corner, along, Vec3::Y * size.y).uv_scaled(size.recip());
        b.add(sheet, Affine3A::IDENTITY, face);
    }
    let bars = [
        block(vec3(near - 0.03, low - 0.03, -0.02), vec3(far + 0.03, low, 0.02)),
        block(vec3(near - 0.03, high, -0.02), vec3(far + 0.03, high + 0.03, 0.02)),
        block(vec3(near - 0.03, low, -0.02), vec3(near, high, 0.02)),
        block(vec3(far, low, -0.02), vec3(far + 0.03, high, 0.02)),
    ];
    for bar in bars {
        b.add(bar, Affine3A::IDENTITY, frame);
    }
    for y in [low + 0.2, high - 0.2] {
        b.add(tube(&[vec3(0.0, y, 0.0), vec3(near - 0.01, y, 0.0)], &[0.011; 2], 10), Affine3A::IDENTITY, frame);
        let sleeve = lathe(&[vec2(0.0, -0.03), vec2(0.032, -0.03), vec2(0.032, 0.03), vec2(0.0, 0.03)], 18);
        b.add(sleeve, lifted(y), frame);
    }
}
