//! Where a picture is taken from.

use crate::panorama::mapping::texel_direction;
use glam::{Quat, Vec2, Vec3};

/// How directions map to pixels.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Projection {
    Perspective,
    /// All directions. The image's centre is the camera's forward direction.
    Equirect,
}

/// Where a picture is taken from, relative to the panorama's centre.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Viewpoint {
    /// The distance from the panorama's centre in metres, along world axes.
    pub position: Vec3,
    /// The rotation from camera to world.
    pub rotation: Quat,
    /// Tangents of half the horizontal and vertical angle. Equirect pictures do not use them.
    pub tan_half: Vec2,
    /// The projection.
    pub projection: Projection,
    /// How far to the right of the position each direction is seen from, metres: an eye of a stereo panorama.
    pub eye: f32,
}

impl Viewpoint {
    /// Makes a pinhole with a full vertical angle in degrees.
    pub fn perspective(position: Vec3, rotation: Quat, fov_y_degrees: f32, size: [u32; 2]) -> Self {
        let tan_y = (0.5 * fov_y_degrees.to_radians()).tan();
        let tan_half = Vec2::new(tan_y * size[0] as f32 / size[1] as f32, tan_y);
        Self { position, rotation, tan_half, projection: Projection::Perspective, eye: 0.0 }
    }

    /// Makes a full panorama.
    pub fn equirect(position: Vec3, rotation: Quat) -> Self {
        Self { position, rotation, tan_half: Vec2::ONE, projection: Projection::Equirect, eye: 0.0 }
    }

    /// Makes it that of an eye so many metres to the right. The eyes of a panorama look everywhere with the other beside
    /// them (omnidirectional stereo, Peleg, Ben-Ezra and Pritch 2001), but see the poles, where no direction is right, from
    /// the middle (`view_origin` in `common.glsl`).
    pub fn of_eye(self, eye: f32) -> Self {
        match self.projection {
            Projection::Perspective => Self { position: self.position + self.rotation * (eye * Vec3::X), ..self },
            Projection::Equirect => Self { eye, ..self },
        }
    }

    /// Returns the unit direction of the ray through a pixel's centre, world axes.
    pub fn direction(&self, pixel: [u32; 2], size: [u32; 2]) -> Vec3 {
        let local = match self.projection {
            Projection::Equirect => texel_direction(pixel[0], pixel[1], size).as_vec3(),
            Projection::Perspective => {
                let ndc = [0, 1].map(|k| (pixel[k] as f32 + 0.5) / size[k] as f32 * 2.0 - 1.0);
                Vec3::new(ndc[0] * self.tan_half.x, -ndc[1] * self.tan_half.y, -1.0).normalize()
            }
        };
        self.rotation * local
    }

    /// Says whether primary rays start at the panorama's centre. The real surface is then a look-up.
    pub fn centred(&self) -> bool {
        self.position.length() < 1e-5 && self.eye == 0.0
    }

    /// Returns the angle in radians that one pixel of a picture of this height spans.
    pub fn pixel_angle(&self, height: u32) -> f32 {
        match self.projection {
            Projection::Perspective => 2.0 * self.tan_half.y / height as f32,
            Projection::Equirect => std::f32::consts::PI / height as f32,
        }
    }
}
