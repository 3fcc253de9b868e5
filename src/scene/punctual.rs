//! Lights without a surface, as glTF's KHR_lights_punctual has them. They light scene truth and captures; a picture of the
//! renderer shows them as far as the capture does.

use super::packed;
use glam::{Affine3A, Vec3};

/// A light of a model; it stands in a node and shines along the node's −Z.
#[derive(Clone, Debug, PartialEq)]
pub struct PunctualLight {
    /// Index of its node.
    pub node: usize,
    /// Radiant intensity (radiance · m²); of a directional light irradiance across its direction.
    pub intensity: Vec3,
    /// How it spreads.
    pub kind: PunctualKind,
    /// Metres at which it has faded to nothing; infinite without one.
    pub range: f32,
}

/// How a light without a surface spreads.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum PunctualKind {
    /// The same to all sides.
    Point,
    /// In a cone; half angles in radians, full light within the inner one.
    Spot { inner: f32, outer: f32 },
    /// Parallel, from infinitely far.
    Directional,
}

impl PunctualLight {
    /// As the shader reads it, where its node stands so in the world.
    pub fn pack(&self, to_world: &Affine3A) -> packed::Punctual {
        let direction = to_world.transform_vector3(Vec3::NEG_Z).try_normalize().unwrap_or(Vec3::NEG_Z);
        // glTF's own falloff: the square of a ramp over the cosine.
        let (scale, offset) = match self.kind {
            PunctualKind::Spot { inner, outer } => {
                let scale = 1.0 / (inner.cos() - outer.cos()).max(1e-3);
                (scale, -outer.cos() * scale)
            }
            _ => (0.0, 1.0),
        };
        packed::Punctual {
            position: to_world.translation.into(),
            directional: u32::from(self.kind == PunctualKind::Directional),
            direction,
            range: self.range.min(1e30), // shaders take infinities for granted to be absent
            intensity: self.intensity,
            cone_scale: scale,
            cone_offset: offset,
        }
    }
}
