//! Levels a panorama whose camera was tilted: picture and depth are sampled anew.

use super::{
    mapping::{coordinates, texel_direction, wrap},
    source::PanoramaSpec,
    texels::Texels,
};
use glam::{DQuat, Quat, Vec3, Vec4};
use rayon::prelude::*;

/// The turn that levels a panorama.
pub struct Levelling {
    /// From a level direction to one of the file.
    to_file: DQuat,
}

/// Returns the rotation by pitch about +X after roll about +Z, in degrees.
pub fn rotation(pitch_degrees: f32, roll_degrees: f32) -> Quat {
    Quat::from_rotation_x(pitch_degrees.to_radians()) * Quat::from_rotation_z(roll_degrees.to_radians())
}

/// Returns pitch and roll in degrees that turn this direction upright.
pub fn upright(normal: Vec3) -> [f32; 2] {
    let roll = normal.x.atan2(normal.y);
    let pitch = -normal.z.atan2(normal.x.hypot(normal.y));
    [pitch.to_degrees(), roll.to_degrees()]
}

impl Levelling {
    /// Returns what a scene file asks for; `None` if that is nothing.
    pub fn of(spec: &PanoramaSpec) -> Option<Self> {
        let asked = spec.pitch_degrees != 0.0 || spec.roll_degrees != 0.0;
        let to_level = rotation(spec.pitch_degrees, spec.roll_degrees);
        asked.then(|| Self { to_file: to_level.inverse().as_dquat() })
    }

    /// Where a texel of the level image is in the file's, in texels from the middle of the first one.
    fn place(&self, index: usize, size: [u32; 2]) -> [f64; 2] {
        let (column, row) = (index as u32 % size[0], index as u32 / size[0]);
        let uv = coordinates(self.to_file * texel_direction(column, row, size));
        [uv.x * f64::from(size[0]) - 0.5, uv.y * f64::from(size[1]) - 0.5]
    }

    /// Returns a level picture, bilinear. A texel with an unknown neighbour (alpha 0) is unknown.
    pub fn radiance(&self, size: [u32; 2], texels: &Texels) -> Texels {
        let texel = |column: f64, row: f64| {
            let (x, y) = wrap(column as i64, row as i64, size);
            Vec4::from(texels.at(y as usize * size[0] as usize + x as usize))
        };
        let level = |index: usize| {
            let [x, y] = self.place(index, size);
            let (left, top) = (x.floor(), y.floor());
            let (fx, fy) = ((x - left) as f32, (y - top) as f32);
            let upper = texel(left, top).lerp(texel(left + 1.0, top), fx);
            let mixed = upper.lerp(texel(left, top + 1.0).lerp(texel(left + 1.0, top + 1.0), fx), fy);
            if mixed.w > 0.999 { mixed.truncate().extend(1.0).to_array() } else { [0.0; 4] }
        };
        Texels::make(texels.len(), level)
    }

    /// Returns level depth. It is taken from the nearest texel, as a mean over an edge is nowhere.
    pub fn depth(&self, size: [u32; 2], depth: &[f32]) -> Vec<f32> {
        let nearest = |index: usize| {
            let [x, y] = self.place(index, size);
            let (x, y) = wrap(x.round() as i64, y.round() as i64, size);
            depth[y as usize * size[0] as usize + x as usize]
        };
        (0..depth.len()).into_par_iter().map(nearest).collect()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_is_upright_is_turned_upright() {
        for normal in [Vec3::new(0.1, 0.9, -0.2), Vec3::new(-0.3, 0.8, 0.4), Vec3::Y] {
            let [pitch, roll] = upright(normal);
            assert!((rotation(pitch, roll) * normal.normalize()).abs_diff_eq(Vec3::Y, 1e-5), "{normal}");
        }
    }
}
