//! What poses start from, as `bind/deform.glsl` declares it.

use crate::{gpu_struct, scene::deform::Placed};
use glam::Vec3;
use std::sync::Arc;

gpu_struct! {
    /// A vertex in the mesh's own space. The next one's first influence and delta end its own.
    pub struct RestVertex {
        pub position: Vec3, pub first_influence: u32,
        pub normal: Vec3, pub first_delta: u32,
        pub tangent: Vec3,
        /// 1: its normal is its triangle's.
        pub faceted: u32,
    }
}
gpu_struct! {
    /// A joint that moves a vertex, and its share in that.
    pub struct Influence { pub joint: u32, pub weight: f32 }
}
gpu_struct! {
    /// What a morph target adds to a vertex at weight 1.
    pub struct Delta { pub target: u32, pub position: Vec3, pub normal: Vec3 }
}

/// The arrays of all placed meshes, one after the other.
#[derive(Default)]
pub(super) struct Arrays {
    /// One more than there are, which ends the last.
    pub vertices: Vec<RestVertex>,
    pub influences: Vec<Influence>,
    /// What is not zero, by vertex.
    pub deltas: Vec<Delta>,
}

impl Arrays {
    pub fn of(all: &[Arc<Placed>]) -> Self {
        let mut arrays = Self::default();
        // The first joint of all moves nothing.
        let (mut joint, mut target) = (1, 0);
        for placed in all {
            arrays.add(placed, joint, target);
            joint += placed.rest.joints.len() as u32;
            target += placed.deform.targets.len() as u32;
        }
        let end = RestVertex {
            first_influence: arrays.influences.len() as u32,
            first_delta: arrays.deltas.len() as u32,
            ..Default::default()
        };
        arrays.vertices.push(end);
        arrays
    }

    fn add(&mut self, placed: &Placed, first_joint: u32, first_target: u32) {
        let (deform, joints) = (&placed.deform, placed.rest.joints.len() as u32);
        for (index, position) in deform.positions.iter().enumerate() {
            self.vertices.push(RestVertex {
                position: *position,
                first_influence: self.influences.len() as u32,
                normal: deform.normals.get(index).copied().unwrap_or_default(),
                first_delta: self.deltas.len() as u32,
                tangent: placed.tangents.get(index).copied().unwrap_or_default(),
                faceted: u32::from(deform.normals.is_empty()),
            });
            let own = deform.influences.get(index).filter(|_| deform.skin.is_some());
            self.influences.extend(own.into_iter().flatten().map(|(joint, weight)| {
                let joint = u32::from(*joint);
                Influence { joint: if joint < joints { first_joint + joint } else { 0 }, weight: *weight }
            }));
            self.deltas.extend(deform.targets.iter().zip(first_target..).filter_map(|(target, number)| {
                let of = |values: &[Vec3]| values.get(index).copied().unwrap_or_default();
                let (position, normal) = (of(&target.positions), of(&target.normals));
                let moves = position != Vec3::ZERO || normal != Vec3::ZERO;
                moves.then_some(Delta { target: number, position, normal })
            }));
        }
    }
}
