//! The camera of the window. It is the scene's camera until it is moved by hand.

use crate::scene::{
    animation::Track,
    camera::{Aim, Camera, CameraTrack},
};
use glam::{EulerRot, Quat, Vec2, Vec3};

/// The steepest look up or down, degrees.
const STEEPEST: f32 = 89.9;
/// The narrowest and the widest vertical angle, degrees.
const ANGLES: [f32; 2] = [5.0, 150.0];

/// A camera that was moved by hand.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Free {
    /// World, metres.
    pub position: Vec3,
    /// Angle about +Y, degrees.
    pub yaw: f32,
    /// Angle upwards, degrees.
    pub pitch: f32,
    /// Full vertical angle, degrees.
    pub fov_y: f32,
}

impl Free {
    /// Takes the place of another camera.
    pub fn from_camera(camera: &Camera) -> Self {
        let (yaw, pitch, _) = camera.rotation.to_euler(EulerRot::YXZ);
        let [yaw, pitch] = [yaw, pitch].map(f32::to_degrees);
        Self { position: camera.position, yaw, pitch, fov_y: camera.fov_y_degrees }
    }

    /// A track that stays at this camera.
    pub fn track(&self, size: [u32; 2]) -> CameraTrack {
        CameraTrack {
            position: Track::constant(self.position),
            aim: Aim::Angles { yaw: Track::constant(self.yaw), pitch: Track::constant(self.pitch) },
            fov_y_degrees: Track::constant(self.fov_y),
            size,
        }
    }

    /// Turns the camera by a drag over this part of the picture's height, so that what is under the pointer
    /// stays there.
    pub fn turn(&mut self, by: Vec2) {
        self.yaw = (self.yaw + by.x * self.fov_y + 180.0).rem_euclid(360.0) - 180.0;
        self.pitch = (self.pitch + by.y * self.fov_y).clamp(-STEEPEST, STEEPEST);
    }

    /// Narrows or widens the view by a factor.
    pub fn zoom(&mut self, factor: f32) {
        self.fov_y = (self.fov_y * factor).clamp(ANGLES[0], ANGLES[1]);
    }

    /// Moves the camera by metres to the right, up in the world, and forward on the level.
    pub fn walk(&mut self, by: Vec3) {
        let level = Quat::from_rotation_y(self.yaw.to_radians());
        self.position += level * Vec3::new(by.x, 0.0, -by.z) + Vec3::Y * by.y;
    }
}

/// The geometry of a picture, between pixels and rays.
#[derive(Clone, Copy, Debug)]
pub struct Lens {
    /// The camera.
    pub camera: Camera,
    /// Width divided by height.
    pub aspect: f32,
}

impl Lens {
    fn tan_half(&self) -> Vec2 {
        let tan = (0.5 * self.camera.fov_y_degrees.to_radians()).tan();
        Vec2::new(tan * self.aspect, tan)
    }

    /// The unit direction through a place in the picture. Places run from 0 to 1, from the left and the top.
    pub fn direction(&self, place: Vec2) -> Vec3 {
        let at = (2.0 * place - 1.0) * self.tan_half();
        (self.camera.rotation * Vec3::new(at.x, -at.y, -1.0)).normalize()
    }

    /// The place where a point is seen. A point behind the camera has none.
    pub fn project(&self, point: Vec3) -> Option<Vec2> {
        let local = self.camera.rotation.inverse() * (point - self.camera.position);
        let at = Vec2::new(local.x, -local.y) / -local.z / self.tan_half();
        (local.z < -1e-4).then_some(0.5 * (at + 1.0))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use glam::vec2;

    fn free() -> Free {
        Free { position: Vec3::new(1.0, 2.0, 3.0), yaw: 30.0, pitch: -10.0, fov_y: 60.0 }
    }

    #[test]
    fn a_track_of_it_is_where_it_is() {
        let camera = free().track([16, 9]).at(3.0);
        let again = Free::from_camera(&camera);
        assert!((again.yaw - 30.0).abs() < 1e-3 && (again.pitch + 10.0).abs() < 1e-3);
        assert_eq!((again.position, again.fov_y), (free().position, 60.0));
    }

    #[test]
    fn pixels_and_rays_are_inverse() {
        let lens = Lens { camera: free().track([16, 9]).at(0.0), aspect: 16.0 / 9.0 };
        for place in [vec2(0.5, 0.5), vec2(0.1, 0.9), vec2(0.99, 0.2)] {
            let point = lens.camera.position + 2.5 * lens.direction(place);
            assert!(lens.project(point).unwrap().abs_diff_eq(place, 1e-4));
        }
        assert!(lens.project(lens.camera.position - lens.direction(vec2(0.5, 0.5))).is_none());
    }

    #[test]
    fn forward_is_where_it_looks() {
        let mut camera = Free { yaw: 90.0, pitch: 40.0, ..free() };
        camera.walk(Vec3::new(0.0, 0.0, 1.0));
        assert!(camera.position.abs_diff_eq(Vec3::new(0.0, 2.0, 3.0), 1e-6), "level, along −X");
        camera.turn(vec2(0.0, 9.0));
        assert!(camera.pitch < 90.0);
        (0..99).for_each(|_| camera.zoom(2.0));
        assert_eq!(camera.fov_y, 150.0);
    }
}
