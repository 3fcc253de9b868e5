//! The virtual objects of the bedroom.

use super::objects::{Turned, ball, fly, mug, object, plane};
use super::things;
use crate::scene::Object;
use glam::{Quat, Vec3, vec3};

/// Makes what lies on the bed, stands beside it and flies over it.
pub fn bedroom() -> Vec<Object> {
    let lean = Quat::from_rotation_y(0.35) * Quat::from_rotation_x(-0.85);
    vec![
        object(
            "pillow",
            things::pillow(vec3(0.42, 0.06, 0.05), vec3(0.72, 0.66, 0.54)),
            vec3(-0.86, 0.735, -1.42),
            0.0,
        )
        .turned(lean),
        object("tray", things::tray(), vec3(-0.20, 0.622, -1.25), 12.0),
        object("teapot", things::teapot([0.55, 0.60, 0.62]), vec3(-0.27, 0.6345, -1.27), -150.0),
        object("mug", mug(), vec3(-0.09, 0.6345, -1.20), -30.0),
        object("bottle", things::bottle(), vec3(-1.45, 0.5002, -2.06), 0.0),
        object("standing-mirror", things::standing_mirror(), vec3(1.43, 0.0, -1.92), -38.0),
        object("night-light", things::night_light(), vec3(0.84, 0.0002, -1.28), 0.0),
        object("basketball", ball(), vec3(1.12, 0.1292, -0.98), 35.0),
        Object {
            placement: fly(vec3(-0.1, 1.28, -1.55), vec3(0.62, 0.10, 0.42)),
            ..object("plane", plane(), Vec3::ZERO, 0.0)
        },
    ]
}
