//! Values over time, given by key frames.

use glam::{Affine3A, Mat3, Quat, Vec3};

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

impl Lerp for Quat {
    fn mix(a: Self, b: Self, t: f32) -> Self {
        a.slerp(b, t)
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
    pub rotation: Track<Quat>,
    pub scale: Track<Vec3>,
}

impl Placement {
    /// Makes a placement that stands still.
    pub fn fixed(transform: Transform) -> Self {
        Self {
            translation: Track::constant(transform.translation),
            rotation: Track::constant(transform.rotation),
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
            rotation: self.rotation.at(time),
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
        let track = Track::from_keys(vec![(0.0, Quat::IDENTITY), (1.0, Quat::from_rotation_y(1.0))], Quat::IDENTITY);
        assert!(track.at(0.25).angle_between(Quat::from_rotation_y(0.25)) < 1e-3);
    }

    #[test]
    fn flat_matrices_are_not_invertible() {
        assert!(is_invertible(&Affine3A::from_scale(Vec3::splat(1e-3))));
        assert!(is_invertible(&Affine3A::from_scale(Vec3::new(-1.0, 1.0, 1.0))));
        assert!(!is_invertible(&Affine3A::from_scale(Vec3::new(1.0, 0.0, 1.0))));
        assert!(!is_invertible(&Affine3A::from_scale(Vec3::splat(f32::NAN))));
    }
}
