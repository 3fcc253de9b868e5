//! The lamps that hang free, as shaders know them.

use crate::{
    gpu_struct,
    panorama::lamps::{Lamp, MOST},
};
use glam::{Quat, Vec3};

gpu_struct! {
    /// `FreeLamp` in `bind/panorama.glsl`: an ellipsoid. Places are metres relative to the panorama's centre,
    /// along the world's axes. A vector v is (unit_x·v, unit_y·v, unit_z·v) in the space in which the
    /// ellipsoid is a ball of radius 1.
    pub struct FreeLamp {
        pub center: Vec3,
        pub luminance: f32,
        pub axis_x: Vec3,
        pub axis_y: Vec3,
        pub axis_z: Vec3,
        pub unit_x: Vec3,
        pub unit_y: Vec3,
        pub unit_z: Vec3,
        pub volume: f32,
        pub radiance: Vec3,
        pub around: Vec3,
        pub direction: Vec3,
        pub across_x: Vec3,
        pub across_y: Vec3,
    }
}

/// Bytes of the buffer: the number of lamps, and the lamps.
pub const BYTES: u64 = 4 + MOST as u64 * size_of::<FreeLamp>() as u64;

/// The content of the buffer for the lamps of a panorama that is turned by `yaw_degrees`.
pub fn packed(lamps: &[Lamp], yaw_degrees: f32) -> Vec<u32> {
    let mut words = vec![lamps.len() as u32];
    lamps.iter().for_each(|lamp| words.extend_from_slice(bytemuck::cast_slice(&[placed(lamp, yaw_degrees)])));
    words
}

fn placed(lamp: &Lamp, yaw_degrees: f32) -> FreeLamp {
    let turn = Quat::from_rotation_y(yaw_degrees.to_radians());
    let [axis_x, axis_y, axis_z] = lamp.axes.map(|axis| turn * axis);
    let unit = |axis: Vec3| axis / axis.length_squared();
    FreeLamp {
        center: turn * lamp.center,
        luminance: lamp.radiance.dot(Vec3::new(0.2126, 0.7152, 0.0722)),
        axis_x,
        axis_y,
        axis_z,
        unit_x: unit(axis_x),
        unit_y: unit(axis_y),
        unit_z: unit(axis_z),
        volume: axis_x.length() * axis_y.length() * axis_z.length(),
        radiance: lamp.radiance,
        around: lamp.around,
        direction: turn * lamp.direction,
        across_x: turn * lamp.across[0],
        across_y: turn * lamp.across[1],
    }
}
