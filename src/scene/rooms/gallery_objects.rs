//! The virtual objects of the gallery.

use super::objects::{PERIOD, ball, brass_vase, fly, mirror_ball, object, plane, stool};
use super::things;
use crate::scene::Object;
use crate::scene::animation::{Placement, Track};
use glam::{Quat, Vec3, vec3};
use std::f32::consts::TAU;

/// Makes what is exhibited, and what moves between it.
pub fn gallery() -> Vec<Object> {
    vec![
        object("knot", things::knot([0.58, 0.03, 0.025]), vec3(-0.15, 0.8002, -2.15), 15.0),
        object("mirror-ball", mirror_ball(), vec3(2.0, 1.1702, -2.5), 0.0),
        object("teapot", things::teapot([0.03, 0.16, 0.38]), vec3(-2.75, 1.1002, -3.3), -30.0),
        object("ring-of-light", things::ring_of_light(), vec3(0.95, 0.0, -2.35), -12.0),
        object("stool", stool(), vec3(-0.95, 0.0, -1.45), 20.0),
        object("bottle", things::bottle(), vec3(-0.95, 0.4562, -1.45), 0.0),
        object("vase", brass_vase(), vec3(1.62, 0.4402, -1.49), 0.0),
        Object { placement: roll(), ..object("basketball", ball(), Vec3::ZERO, 0.0) },
        Object {
            placement: fly(vec3(0.35, 2.05, -2.3), vec3(0.85, 0.12, 0.6)),
            ..object("plane", plane(), Vec3::ZERO, 0.0)
        },
    ]
}

/// Rolls once round a circle of three times the ball's radius. The ball then has turned three times about its
/// own axis, too.
fn roll() -> Placement {
    const KEYS: usize = 32;
    const RADIUS: f32 = 0.119;
    let at = |i: usize| {
        let angle = TAU * (i % KEYS) as f32 / KEYS as f32;
        let (sin, cos) = angle.sin_cos();
        let position = vec3(0.12, RADIUS + 0.0002, -1.25) + vec3(cos, 0.0, -sin) * (3.0 * RADIUS);
        // Seen from above it runs counter-clockwise: at angle 0 towards −Z, so it turns about −X.
        (position, Quat::from_rotation_y(angle) * Quat::from_rotation_x(-3.0 * angle))
    };
    let time = |i: usize| PERIOD * i as f64 / KEYS as f64;
    Placement {
        translation: Track::from_keys((0..=KEYS).map(|i| (time(i), at(i).0)).collect(), Vec3::ZERO),
        rotation: Track::from_keys((0..=KEYS).map(|i| (time(i), at(i).1.into())).collect(), Quat::IDENTITY.into()),
        scale: Track::constant(Vec3::ONE),
    }
}
