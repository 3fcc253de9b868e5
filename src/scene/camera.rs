//! The camera, and how it moves.

use super::animation::Track;
use glam::{EulerRot, Quat, Vec3};

/// A pinhole camera. It looks along −Z of its own frame; +Y is up and x is to the right.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Camera {
    /// The place in the world, metres.
    pub position: Vec3,
    /// The rotation from camera to world.
    pub rotation: Quat,
    /// Full vertical angle, degrees.
    pub fov_y_degrees: f32,
    /// Width and height in pixels.
    pub size: [u32; 2],
}

/// Where the camera looks.
#[derive(Clone, Debug, PartialEq)]
pub enum Aim {
    /// At a point of the world.
    LookAt(Track<Vec3>),
    /// By angles in degrees, right-handed. `yaw` turns about +Y (90 looks along −X), then `pitch` upwards.
    Angles { yaw: Track<f32>, pitch: Track<f32> },
}

/// The camera over time.
#[derive(Clone, Debug, PartialEq)]
pub struct CameraTrack {
    pub position: Track<Vec3>,
    pub aim: Aim,
    /// Full vertical angle, degrees.
    pub fov_y_degrees: Track<f32>,
    /// Width and height in pixels, the same at all times.
    pub size: [u32; 2],
}

impl CameraTrack {
    /// Makes a still camera at `position` that looks along −Z, 60° high, 1280×720.
    pub fn at_point(position: Vec3) -> Self {
        Self {
            position: Track::constant(position),
            aim: Aim::Angles { yaw: Track::constant(0.0), pitch: Track::constant(0.0) },
            fov_y_degrees: Track::constant(60.0),
            size: [1280, 720],
        }
    }

    /// Says whether nothing of it ever changes.
    pub fn is_constant(&self) -> bool {
        let aim = match &self.aim {
            Aim::LookAt(target) => target.is_constant(),
            Aim::Angles { yaw, pitch } => yaw.is_constant() && pitch.is_constant(),
        };
        aim && self.position.is_constant() && self.fov_y_degrees.is_constant()
    }

    /// Returns the camera at `time` seconds.
    pub fn at(&self, time: f64) -> Camera {
        let position = self.position.at(time);
        let (yaw, pitch) = match &self.aim {
            Aim::LookAt(target) => angles_towards(target.at(time) - position),
            Aim::Angles { yaw, pitch } => (yaw.at(time).to_radians(), pitch.at(time).to_radians()),
        };
        Camera {
            position,
            rotation: Quat::from_euler(EulerRot::YXZ, yaw, pitch, 0.0),
            fov_y_degrees: self.fov_y_degrees.at(time),
            size: self.size,
        }
    }
}

/// Returns the yaw and pitch in radians that look along `direction`. Straight up and down keep yaw 0. The
/// zero vector gives forward.
fn angles_towards(direction: Vec3) -> (f32, f32) {
    let horizontal = direction.x.hypot(direction.z);
    if !direction.is_finite() || direction == Vec3::ZERO {
        return (0.0, 0.0);
    }
    let yaw = if horizontal <= 1e-6 * direction.y.abs() { 0.0 } else { (-direction.x).atan2(-direction.z) };
    (yaw, direction.y.atan2(horizontal))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn looking_at(target: Vec3) -> Camera {
        let mut track = CameraTrack::at_point(Vec3::ZERO);
        track.aim = Aim::LookAt(Track::constant(target));
        track.at(0.0)
    }

    #[test]
    fn it_looks_where_it_is_told() {
        for target in [Vec3::NEG_Z, Vec3::Z, Vec3::X, Vec3::Y, Vec3::NEG_Y, Vec3::new(1.2, -0.7, -0.05)] {
            let rotation = looking_at(target).rotation;
            assert!((rotation * Vec3::NEG_Z).abs_diff_eq(target.normalize(), 1e-5), "{target}");
            assert!((rotation * Vec3::X).y.abs() < 1e-6, "{target}: the horizon is level");
            assert!((rotation * Vec3::Y).y >= -1e-6, "{target}: not upside down");
        }
        assert!(looking_at(Vec3::ZERO).rotation.is_finite());
    }

    #[test]
    fn yaw_is_right_handed_and_pitch_is_up() {
        let mut track = CameraTrack::at_point(Vec3::ZERO);
        track.aim = Aim::Angles { yaw: Track::constant(90.0), pitch: Track::constant(0.0) };
        assert!((track.at(0.0).rotation * Vec3::NEG_Z).abs_diff_eq(Vec3::NEG_X, 1e-6));
        track.aim = Aim::Angles { yaw: Track::constant(0.0), pitch: Track::constant(90.0) };
        assert!((track.at(0.0).rotation * Vec3::NEG_Z).abs_diff_eq(Vec3::Y, 1e-6));
    }
}
