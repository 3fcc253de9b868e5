//! The virtual objects of the apartment, some of which stand in other rooms, too, and how objects move.

use super::kit::{Builder, lathe, rounded_block, sphere, tube};
use super::textures;
use super::things;
use crate::scene::Object;
use crate::scene::animation::{Placement, Track, Transform};
use crate::scene::material::Material;
use glam::{Affine3A, EulerRot, Quat, Vec2, Vec3, vec2, vec3};
use std::f32::consts::{FRAC_PI_2, TAU};
use std::sync::Arc;

/// Seconds after which the motion of the built-in scenes repeats.
pub const PERIOD: f64 = 4.0;

/// Places something at `translation`, turned about +Y by degrees.
pub fn object(name: &str, b: Builder, translation: Vec3, turn: f32) -> Object {
    let rotation = Quat::from_rotation_y(turn.to_radians());
    Object {
        name: name.into(),
        model: Arc::new(b.model(name)),
        placement: Placement::fixed(Transform { translation, rotation, scale: Vec3::ONE }),
        clip: None,
        speed: 1.0,
    }
}

/// Turns objects that stand still.
pub trait Turned {
    fn turned(self, rotation: Quat) -> Self;
}

impl Turned for Object {
    fn turned(mut self, rotation: Quat) -> Self {
        self.placement.rotation = Track::constant(rotation.into());
        self
    }
}

/// Makes a metal of one colour.
pub fn metal(name: &str, color: [f32; 3], roughness: f32) -> Material {
    Material { metallic: 1.0, ..Material::plain(name, color.into(), roughness) }
}

/// Makes a coated dielectric of one colour.
pub fn glossy(name: &str, color: [f32; 3], roughness: f32) -> Material {
    Material::plain(name, color.into(), roughness)
}

/// Makes what stands, lies and flies in the apartment.
pub fn apartment() -> Vec<Object> {
    vec![
        object("stool", stool(), vec3(-1.05, 0.0, -1.75), 20.0),
        object("basketball", ball(), vec3(-0.86, 0.1292, -1.13), 35.0),
        object("mirror-ball", mirror_ball(), vec3(1.0, 0.1802, -1.62), 0.0),
        object("vase", brass_vase(), vec3(-0.16, 0.4202, -1.46), 0.0),
        object("mug", mug(), vec3(0.13, 0.4202, -1.30), -50.0),
        object("lantern", things::lantern(), vec3(-1.05, 0.4552, -1.75), 15.0),
        object("bottle", things::bottle(), vec3(-0.01, 0.4202, -1.60), 0.0),
        object("teapot", things::teapot([0.62, 0.58, 0.50]), vec3(0.42, 0.4202, -1.27), 200.0),
        object("pillow", things::pillow(vec3(0.05, 0.16, 0.20), vec3(0.70, 0.64, 0.52)), vec3(0.58, 0.70, -2.40), 0.0)
            .turned(Quat::from_rotation_y(-0.12) * Quat::from_rotation_x(-0.42)),
        Object {
            placement: fly(vec3(0.15, 1.12, -1.72), vec3(0.72, 0.12, 0.52)),
            ..object("plane", plane(), Vec3::ZERO, 0.0)
        },
    ]
}

/// A basketball about the origin.
pub fn ball() -> Builder {
    let mut b = Builder::default();
    let skin = b.painted("basketball", textures::basketball());
    let tilt = Affine3A::from_quat(Quat::from_euler(EulerRot::XYZ, 0.5, 0.3, 0.35));
    b.add(sphere(0.119, 48), tilt, skin);
    b
}

/// A perfect mirror, 0.34 m across, about the origin.
pub fn mirror_ball() -> Builder {
    let mut b = Builder::default();
    let mirror = b.material(metal("mirror", [0.95, 0.95, 0.95], 0.0));
    b.add(sphere(0.17, 72), Affine3A::IDENTITY, mirror);
    b
}

/// A rough brass vase, 0.27 m tall, open at the top.
pub fn brass_vase() -> Builder {
    let mut b = Builder::default();
    let brass = b.material(metal("brass", [0.91, 0.68, 0.33], 0.32));
    let outside =
        |t: f32| 0.046 + 0.047 * (t * 2.9 + 0.15).sin().powi(2) - 0.018 * t + 0.016 * (t * 6.0 - 4.9).max(0.0).powi(2);
    let steps = 28;
    let mut profile = vec![vec2(0.0, 0.0), vec2(outside(0.0) - 0.003, 0.0)];
    profile.extend((0..=steps).map(|i| i as f32 / steps as f32).map(|t| vec2(outside(t), 0.003 + 0.267 * t)));
    profile.extend(
        (2..=steps).rev().map(|i| i as f32 / steps as f32).map(|t| vec2(outside(t) - 0.004, 0.0025 + 0.267 * t)),
    );
    profile.push(vec2(0.0, 0.02));
    b.add(lathe(&profile, 64), Affine3A::IDENTITY, brass);
    b
}

/// A glazed mug with a handle, 0.1 m tall.
pub fn mug() -> Builder {
    let mut b = Builder::default();
    let glaze = b.material(glossy("teal glaze", [0.02, 0.22, 0.25], 0.12));
    let profile = [
        (0.0, 0.002),
        (0.030, 0.002),
        (0.032, 0.0),
        (0.036, 0.0),
        (0.040, 0.004),
        (0.042, 0.012),
        (0.042, 0.094),
        (0.0412, 0.0968),
        (0.0392, 0.098),
        (0.0374, 0.0968),
        (0.0368, 0.094),
        (0.0368, 0.014),
        (0.034, 0.009),
        (0.0, 0.008),
    ];
    b.add(lathe(&profile.map(Vec2::from), 56), Affine3A::IDENTITY, glaze);
    let handle: Vec<Vec3> = (0..=16)
        .map(|i| {
            let angle = FRAC_PI_2 * (1.25 - 2.5 * i as f32 / 16.0);
            vec3(0.049 + 0.026 * angle.cos(), 0.05 + 0.031 * angle.sin(), 0.0)
        })
        .collect();
    b.add(tube(&handle, &[0.0056; 17], 14), Affine3A::IDENTITY, glaze);
    b
}

/// A wooden stool, seat at 0.46 m, on four splayed legs with rungs.
pub fn stool() -> Builder {
    let mut b = Builder::default();
    let wood = textures::wood(vec3(0.30, 0.13, 0.05), vec3(0.50, 0.26, 0.11), 23);
    let wood = b.textured(glossy("varnished wood", [1.0; 3], 0.45), wood);
    let seat = [
        (0.0, 0.425),
        (0.145, 0.425),
        (0.162, 0.430),
        (0.168, 0.440),
        (0.167, 0.452),
        (0.160, 0.459),
        (0.145, 0.461),
        (0.08, 0.456),
        (0.0, 0.454),
    ];
    b.add(lathe(&seat.map(Vec2::from), 48).uv_scaled(vec2(3.0, 1.0)), Affine3A::IDENTITY, wood);
    let foot = |k: usize, y: f32| {
        let (sin, cos) = (TAU * (k as f32 + 0.5) / 4.0).sin_cos();
        vec3(cos, 0.0, sin) * (0.18 - 0.075 * y / 0.44) + Vec3::Y * y
    };
    for k in 0..4 {
        b.add(tube(&[foot(k, 0.0), foot(k, 0.2), foot(k, 0.44)], &[0.012, 0.017, 0.014], 14), Affine3A::IDENTITY, wood);
        let y = if k % 2 == 0 { 0.14 } else { 0.19 };
        b.add(tube(&[foot(k, y), foot((k + 1) % 4, y)], &[0.0085; 2], 10), Affine3A::IDENTITY, wood);
    }
    b
}

/// A toy plane, 0.34 m long, nose towards −Z.
pub fn plane() -> Builder {
    let mut b = Builder::default();
    let red = b.material(glossy("red lacquer", [0.55, 0.035, 0.025], 0.35));
    let cream = b.material(glossy("cream lacquer", [0.75, 0.68, 0.50], 0.35));
    let dark = b.material(glossy("dark", [0.03, 0.03, 0.035], 0.5));
    let hull = [
        (0.0, -0.17),
        (0.010, -0.168),
        (0.016, -0.15),
        (0.028, -0.06),
        (0.036, 0.03),
        (0.037, 0.09),
        (0.032, 0.125),
        (0.018, 0.142),
        (0.0, 0.146),
    ];
    // The lathe's axis is turned to −Z.
    let forward = Affine3A::from_rotation_x(-FRAC_PI_2);
    b.add(lathe(&hull.map(Vec2::from), 28), forward, red);
    let at = Affine3A::from_translation;
    b.add(rounded_block(vec3(0.42, 0.012, 0.075), 0.0055, 3, 2, 0.0), at(vec3(0.0, -0.012, -0.045)), cream);
    b.add(rounded_block(vec3(0.15, 0.009, 0.045), 0.004, 3, 2, 0.0), at(vec3(0.0, 0.006, 0.142)), cream);
    b.add(rounded_block(vec3(0.009, 0.07, 0.05), 0.004, 3, 2, 0.0), at(vec3(0.0, 0.037, 0.145)), cream);
    b.add(sphere(0.024, 20), at(vec3(0.0, 0.028, -0.02)), dark);
    b.add(rounded_block(vec3(0.13, 0.012, 0.005), 0.002, 2, 1, 0.0), at(vec3(0.0, 0.0, -0.149)), dark);
    b.add(sphere(0.011, 14), at(vec3(0.0, 0.0, -0.15)), cream);
    b
}

/// Makes one round of a lying ellipse about `centre`, banked into the turn. `reach` is how far it goes along
/// x, y (up and down twice) and z.
pub fn fly(centre: Vec3, reach: Vec3) -> Placement {
    const KEYS: usize = 24;
    let at = |i: usize| {
        let (sin, cos) = (TAU * i as f32 / KEYS as f32 + 0.9).sin_cos();
        let sway = 2.0 * sin * cos; // The sine is that of twice the angle.
        let position = centre + reach * vec3(cos, sway, -sin);
        let velocity = reach * vec3(-sin, 2.0 * (cos * cos - sin * sin), -cos);
        let yaw = f32::atan2(-velocity.x, -velocity.z);
        let pitch = (velocity.y / velocity.length()).asin();
        (position, Quat::from_euler(EulerRot::YXZ, yaw, pitch, 0.45))
    };
    let time = |i: usize| PERIOD * i as f64 / KEYS as f64;
    Placement {
        translation: Track::from_keys((0..=KEYS).map(|i| (time(i), at(i % KEYS).0)).collect(), Vec3::ZERO),
        rotation: Track::from_keys(
            (0..=KEYS).map(|i| (time(i), at(i % KEYS).1.into())).collect(),
            Quat::IDENTITY.into(),
        ),
        scale: Track::constant(Vec3::ONE),
    }
}
