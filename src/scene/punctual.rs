//! Lights without a surface (glTF's KHR_lights_punctual): those of the true room light scene truth and captures,
//! those of inserted objects the mixed scene, too.

use super::packed;
use glam::{Affine3A, Vec3};

/// A light of a model. It stands in a node and shines along the node's −Z.
#[derive(Clone, Debug, PartialEq)]
pub struct PunctualLight {
    /// The index of its node.
    pub node: usize,
    /// Radiant intensity (radiance · m²). For a directional light it is the irradiance across its direction.
    pub intensity: Vec3,
    /// How it spreads.
    pub kind: PunctualKind,
    /// The distance in metres at which it has faded to nothing; infinite if there is none.
    pub range: f32,
}

/// How a light without a surface spreads.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum PunctualKind {
    Point,
    /// In a cone. Half angles are in radians, with full light within the inner one.
    Spot {
        inner: f32,
        outer: f32,
    },
    /// Parallel, from infinitely far.
    Directional,
}

impl PunctualLight {
    /// Returns it as the shader reads it, with its node at this place in the world.
    pub fn pack(&self, to_world: &Affine3A) -> packed::Punctual {
        let direction = to_world.transform_vector3(Vec3::NEG_Z).try_normalize().unwrap_or(Vec3::NEG_Z);
        // This is glTF's own falloff: the square of a ramp over the cosine.
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
            range: self.range.min(1e30), // Shaders may assume that there are no infinities.
            intensity: self.intensity,
            cone_scale: scale,
            cone_offset: offset,
        }
    }
}
