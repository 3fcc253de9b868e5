//! Values over time, given by key frames.

use glam::{Affine3A, EulerRot, Mat3, Quat, Vec3};

/// A type whose key frames can be interpolated.
pub trait Lerp: Copy {
    /// Returns `a` at `t = 0` and `b` at `t = 1`.
    fn mix(a: Self, b: Self, t: f32) -> Self;
}

impl Lerp for f32 {
    fn mix(a: Self, b: Self, t: f32) -> Self {
        a + (b - a) * t
    }
}

impl Lerp for Vec3 {
    fn mix(a: Self, b: Self, t: f32) -> Self {
        a.lerp(b, t)
    }
}

/// A rotation as key frames give it. Angles are interpolated as angles, so that from 0° to 360° is a turn.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Turn {
    /// What follows the angles.
    pub by: Quat,
    /// Degrees about x, y and z: Rx·Ry·Rz.
    pub degrees: Vec3,
}

impl Turn {
    /// Makes a rotation by angles in degrees.
    pub fn of_degrees(degrees: Vec3) -> Self {
        Self { by: Quat::IDENTITY, degrees }
    }

    /// Returns the rotation.
    pub fn quat(self) -> Quat {
        if self.degrees == Vec3::ZERO {
            return self.by;
        }
        let [x, y, z] = self.degrees.to_array().map(f32::to_radians);
        self.by * Quat::from_euler(EulerRot::XYZ, x, y, z)
    }
}

impl From<Quat> for Turn {
    fn from(by: Quat) -> Self {
        Self { by, degrees: Vec3::ZERO }
    }
}

impl Lerp for Turn {
    fn mix(a: Self, b: Self, t: f32) -> Self {
        Self { by: a.by.slerp(b.by, t), degrees: a.degrees.lerp(b.degrees, t) }
    }
}

/// Key frames of one value, by time in seconds. The value is held before the first and after the last.
#[derive(Clone, Debug, PartialEq)]
pub struct Track<T> {
    first: T,
    rest: Vec<(f64, T)>,
    start: f64,
}

impl<T: Lerp> Track<T> {
    /// Makes a track with the same value at all times.
    pub fn constant(value: T) -> Self {
        Self { first: value, rest: Vec::new(), start: 0.0 }
    }

    /// Sorts key frames by time. Without any, the value is always `default`.
    pub fn from_keys(mut keys: Vec<(f64, T)>, default: T) -> Self {
        keys.sort_by(|a, b| a.0.total_cmp(&b.0));
        match keys.split_first() {
            None => Self::constant(default),
            Some((&(start, first), rest)) => Self { first, rest: rest.to_vec(), start },
        }
    }

    /// Says whether the value never changes.
    pub fn is_constant(&self) -> bool {
        self.rest.is_empty()
    }

    /// Returns all key frames by time, at least one. A constant has one at 0.
    pub fn keys(&self) -> impl Iterator<Item = (f64, T)> {
        std::iter::once((self.start, self.first)).chain(self.rest.iter().copied())
    }

    /// Returns the value at `time` seconds.
    pub fn at(&self, time: f64) -> T {
        let (mut before_time, mut before) = (self.start, self.first);
        for &(key_time, key) in &self.rest {
            if time < key_time {
                if time <= before_time {
                    return before;
                }
                return T::mix(before, key, ((time - before_time) / (key_time - before_time)) as f32);
            }
            (before_time, before) = (key_time, key);
        }
        before
    }
}

/// Where something stands, in metres: scaled, then rotated, then moved.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Transform {
    pub translation: Vec3,
    pub rotation: Quat,
    pub scale: Vec3,
}

impl Transform {
    /// The transform that changes nothing.
    pub const IDENTITY: Self = Self { translation: Vec3::ZERO, rotation: Quat::IDENTITY, scale: Vec3::ONE };

    /// Returns the matrix.
    pub fn matrix(&self) -> Affine3A {
        Affine3A::from_scale_rotation_translation(self.scale, self.rotation, self.translation)
    }
}

/// A [`Transform`] over time.
#[derive(Clone, Debug, PartialEq)]
pub struct Placement {
    pub translation: Track<Vec3>,
    pub rotation: Track<Turn>,
    pub scale: Track<Vec3>,
}

impl Placement {
    /// Makes a placement that stands still.
    pub fn fixed(transform: Transform) -> Self {
        Self {
            translation: Track::constant(transform.translation),
            rotation: Track::constant(transform.rotation.into()),
            scale: Track::constant(transform.scale),
        }
    }

    /// Says whether the placement never changes.
    pub fn is_constant(&self) -> bool {
        self.translation.is_constant() && self.rotation.is_constant() && self.scale.is_constant()
    }

    /// Returns the placement at `time` seconds.
    pub fn at(&self, time: f64) -> Transform {
        Transform {
            translation: self.translation.at(time),
            rotation: self.rotation.at(time).quat(),
            scale: self.scale.at(time),
        }
    }
}

/// Says whether a matrix can be inverted with numbers that single precision still holds.
pub fn is_invertible(matrix: &Affine3A) -> bool {
    let linear = Mat3::from(matrix.matrix3);
    let size = linear.x_axis.length() * linear.y_axis.length() * linear.z_axis.length();
    let determinant = linear.determinant().abs();
    matrix.is_finite() && determinant > 1e-30 && determinant > 1e-6 * size && matrix.inverse().is_finite()
}

/// Returns a matrix that can be inverted: this one, or, if it flattens to a plane, one that keeps a
/// ten-thousandth of the thickness. A matrix that flattens to a line or a point, or is not finite, has none.
pub fn made_invertible(matrix: &Affine3A) -> Option<Affine3A> {
    if is_invertible(matrix) {
        return Some(*matrix);
    }
    let linear = Mat3::from(matrix.matrix3);
    // The longest cross product of a rank 2 matrix's columns is normal to what it spans; that of its rows is
    // what it flattens.
    let lost = |m: Mat3| {
        let crosses = [m.x_axis.cross(m.y_axis), m.y_axis.cross(m.z_axis), m.z_axis.cross(m.x_axis)];
        crosses
            .into_iter()
            .max_by(|a, b| a.length_squared().total_cmp(&b.length_squared()))
            .and_then(Vec3::try_normalize)
    };
    let (across, flattened) = (lost(linear)?, lost(linear.transpose())?);
    let size = [linear.x_axis, linear.y_axis, linear.z_axis].map(Vec3::length).into_iter().fold(0.0, f32::max);
    let thickness = 1e-4 * size * across;
    let outer = Mat3::from_cols(thickness * flattened.x, thickness * flattened.y, thickness * flattened.z);
    let thick = Affine3A::from_mat3_translation(linear + outer, matrix.translation.into());
    is_invertible(&thick).then_some(thick)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn tracks_hold_and_interpolate() {
        let track = Track::from_keys(vec![(2.0, 30.0_f32), (1.0, 10.0)], 7.0);
        assert_eq!(track.at(0.0), 10.0);
        assert_eq!(track.at(1.5), 20.0);
        assert_eq!(track.at(2.0), 30.0);
        assert_eq!(track.at(9.0), 30.0);
        assert_eq!(Track::from_keys(vec![], 7.0_f32).at(3.0), 7.0);
    }

    #[test]
    fn two_keys_at_one_time_are_a_jump() {
        let track = Track::from_keys(vec![(0.0, 0.0_f32), (1.0, 1.0), (1.0, 5.0), (2.0, 5.0)], 0.0);
        assert_eq!(track.at(0.5), 0.5);
        assert_eq!(track.at(1.0), 5.0);
    }

    #[test]
    fn rotations_turn_at_constant_speed() {
        let keys = [(0.0, Quat::IDENTITY), (1.0, Quat::from_rotation_y(1.0))].map(|(time, turn)| (time, turn.into()));
        let track: Track<Turn> = Track::from_keys(keys.to_vec(), Quat::IDENTITY.into());
        assert!(track.at(0.25).quat().angle_between(Quat::from_rotation_y(0.25)) < 1e-3);
        let round = [(0.0, Vec3::ZERO), (1.0, Vec3::new(0.0, 720.0, 0.0))].map(|(t, d)| (t, Turn::of_degrees(d)));
        let track = Track::from_keys(round.to_vec(), Quat::IDENTITY.into());
        let third = Quat::from_rotation_y(240_f32.to_radians());
        assert!(track.at(1.0 / 3.0).quat().angle_between(third) < 1e-3, "angles go round twice");
    }

    #[test]
    fn flat_matrices_are_not_invertible() {
        assert!(is_invertible(&Affine3A::from_scale(Vec3::splat(1e-3))));
        assert!(is_invertible(&Affine3A::from_scale(Vec3::new(-1.0, 1.0, 1.0))));
        assert!(!is_invertible(&Affine3A::from_scale(Vec3::new(1.0, 0.0, 1.0))));
        assert!(!is_invertible(&Affine3A::from_scale(Vec3::splat(f32::NAN))));
    }

    #[test]
    fn planes_get_a_thickness_and_lines_do_not() {
        let turn = |a| Affine3A::from_axis_angle(Vec3::new(0.6, 0.0, 0.8), a);
        let flat = turn(1.0) * Affine3A::from_scale(Vec3::new(2.0, 0.0, 3.0)) * turn(-0.4);
        let thick = made_invertible(&flat).expect("a plane");
        for point in [Vec3::X, Vec3::Y, Vec3::new(-1.0, 2.0, 0.5)] {
            assert!(thick.transform_point3(point).abs_diff_eq(flat.transform_point3(point), 2e-3));
        }
        assert_eq!(made_invertible(&turn(0.3)), Some(turn(0.3)));
        for lost in [Vec3::new(1.0, 0.0, 0.0), Vec3::ZERO, Vec3::splat(f32::NAN)] {
            assert_eq!(made_invertible(&Affine3A::from_scale(lost)), None);
        }
    }
}
