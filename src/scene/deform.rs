//! Meshes that change their shape: skins and morph targets.
//!
//! A deforming mesh has triangles, vertices and a bottom level of its own for each placement, behind all rigid
//! ones. Each frame the pass `deform` poses its vertices on the device. [`Deform::pose`] does the same on the CPU,
//! for whoever needs a shape without a renderer.

mod outline;
mod placed;

pub use outline::Outline;
pub use placed::{Patch, Placed, Pose, patched};

use super::model::Rig;
use glam::{Affine3A, Mat3, Mat4, Vec3};
use rayon::prelude::*;

/// What moves the vertices of a mesh. Arrays of vertices are as long as the mesh's.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Deform {
    /// Positions in the mesh's own space, before any target or joint moves them.
    pub positions: Vec<Vec3>,
    /// The same of normals. If empty, each triangle has its own vertices, and they are flat.
    pub normals: Vec<Vec3>,
    pub targets: Vec<Target>,
    /// The node whose weights the targets have.
    pub weights_of: usize,
    pub skin: Option<Skin>,
    /// For each vertex its joints and their weights, which sum to 1.
    pub influences: Vec<Influences>,
}

/// The joints that move a vertex, by their number in the skin, with weights.
pub type Influences = Vec<(u16, f32)>;

/// A morph target: what it adds to each vertex at weight 1.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Target {
    pub positions: Vec<Vec3>,
    /// If empty, normals stay.
    pub normals: Vec<Vec3>,
}

/// The joints of a skin.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Skin {
    /// Nodes of the model; `None` stands at the origin.
    pub joints: Vec<Option<usize>>,
    /// From the mesh's space to each joint's.
    pub inverse_bind: Vec<Mat4>,
}

impl Skin {
    /// Returns for each joint the matrix from the mesh's space to the model's.
    pub fn matrices(&self, nodes: &[Affine3A]) -> Vec<Mat4> {
        let of = |(joint, bind): (&Option<usize>, &Mat4)| {
            Mat4::from(joint.and_then(|node| nodes.get(node)).copied().unwrap_or(Affine3A::IDENTITY)) * *bind
        };
        self.joints.iter().zip(&self.inverse_bind).map(of).collect()
    }
}

/// What poses a deforming mesh at one time.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Stance {
    /// For each joint of the skin the matrix from the mesh's space to the model's.
    pub joints: Vec<Mat4>,
    /// The weights of the morph targets. One that is missing is 0.
    pub weights: Vec<f32>,
}

impl Stance {
    /// Returns the matrix of a joint. One that the skin does not have changes nothing.
    pub fn joint(&self, joint: usize) -> Mat4 {
        self.joints.get(joint).copied().unwrap_or(Mat4::IDENTITY)
    }
}

/// The posed vertices of a mesh.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Posed {
    pub positions: Vec<Vec3>,
    /// Empty where the mesh has none of its own.
    pub normals: Vec<Vec3>,
    /// What turns tangents from the mesh's space, for each vertex. Empty without a skin.
    pub turns: Vec<Mat3>,
}

impl Deform {
    /// Returns what poses it in a model: at a time of a clip, or at rest.
    pub fn stance(&self, rig: &Rig, clip: Option<(usize, f64)>) -> Stance {
        self.stance_among(&rig.node_matrices(clip), rig, clip)
    }

    /// The same, if `nodes` are the rig's node-to-model matrices at that time.
    pub fn stance_among(&self, nodes: &[Affine3A], rig: &Rig, clip: Option<(usize, f64)>) -> Stance {
        let joints = self.skin.as_ref().map_or(Vec::new(), |skin| skin.matrices(nodes));
        Stance { joints, weights: rig.weights(self.weights_of, clip).into_owned() }
    }

    /// Poses all vertices.
    pub fn pose(&self, stance: &Stance) -> Posed {
        let vertices = || (0..self.positions.len()).into_par_iter();
        let positions = vertices().map(|vertex| self.position(vertex, stance)).collect();
        let turns: Vec<_> = match self.skin {
            Some(_) => vertices().map(|vertex| Mat3::from_mat4(self.matrix(vertex, stance))).collect(),
            None => Vec::new(),
        };
        let mut normals = self.normals.clone();
        for (target, weight) in self.targets.iter().zip(&stance.weights).filter(|(_, weight)| **weight != 0.0) {
            normals.iter_mut().zip(&target.normals).for_each(|(to, by)| *to += *weight * *by);
        }
        for (normal, turn) in normals.iter_mut().zip(&turns) {
            // The cofactors turn normals as the transposed inverse does, and exist for flat matrices, too.
            let [x, y, z] = [turn.x_axis, turn.y_axis, turn.z_axis];
            let turned = Mat3::from_cols(y.cross(z), z.cross(x), x.cross(y)) * *normal;
            *normal = turned * turn.determinant().signum();
        }
        Posed { positions, normals, turns }
    }

    /// Poses the position of one vertex.
    pub fn position(&self, vertex: usize, stance: &Stance) -> Vec3 {
        let moved = self.targets.iter().zip(&stance.weights).filter(|(_, weight)| **weight != 0.0);
        let add = |sum: Vec3, (target, weight): (&Target, &f32)| {
            sum + *weight * target.positions.get(vertex).copied().unwrap_or_default()
        };
        let position = moved.fold(self.positions[vertex], add);
        if self.skin.is_some() { self.matrix(vertex, stance).transform_point3(position) } else { position }
    }

    /// The mean of the matrices of a vertex's joints, by their weights.
    fn matrix(&self, vertex: usize, stance: &Stance) -> Mat4 {
        let influences = self.influences.get(vertex).map_or(&[][..], |own| own);
        if influences.is_empty() {
            return Mat4::IDENTITY;
        }
        influences.iter().fold(Mat4::ZERO, |sum, (joint, weight)| sum + stance.joint(usize::from(*joint)) * *weight)
    }
}
