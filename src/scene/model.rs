//! A model: meshes, materials, textures and the nodes that place them. glTF loading, the built-in shapes and
//! the built-in rooms all make it.

use super::{
    animation::Transform,
    clip::Clip,
    deform::Deform,
    material::{Material, Texture},
    punctual::PunctualLight,
};
use glam::{Affine3A, Vec2, Vec3, Vec4};
use std::{borrow::Cow, sync::Arc};

/// Triangles in object space, metres. All per-vertex arrays have the length of `positions`.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Mesh {
    pub name: String,
    pub positions: Vec<Vec3>,
    /// Unit length.
    pub normals: Vec<Vec3>,
    /// If empty, all are zero.
    pub uvs: Vec<Vec2>,
    /// As in glTF, `w` is the bitangent's sign. Zero means that there is no normal mapping. If empty, all are
    /// zero.
    pub tangents: Vec<[f32; 4]>,
    /// The second coordinates. If empty, all are zero.
    pub uvs2: Vec<Vec2>,
    /// Factors on the base colour and on alpha, linear, 0..1. If empty, all are one.
    pub colors: Vec<Vec4>,
    /// Vertex indices, counter-clockwise seen from the front.
    pub triangles: Vec<[u32; 3]>,
    /// The material of each triangle: an index into the model's.
    pub materials: Vec<u32>,
    /// What moves its vertices. The arrays above are its rest pose.
    pub deform: Option<Arc<Deform>>,
}

/// How a node is placed in its parent.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Local {
    /// A transform, which can be animated.
    Transform(Transform),
    /// A matrix, which need not be a product of the three.
    Matrix(Affine3A),
}

impl Local {
    /// Returns the matrix from node to parent.
    pub fn matrix(&self) -> Affine3A {
        match self {
            Self::Transform(transform) => transform.matrix(),
            Self::Matrix(matrix) => *matrix,
        }
    }
}

/// A node of the model's hierarchy.
#[derive(Clone, Debug, PartialEq)]
pub struct Node {
    pub name: String,
    /// The index of the parent, which comes earlier in the list.
    pub parent: Option<usize>,
    pub local: Local,
    /// The index of its mesh.
    pub mesh: Option<usize>,
    /// The weights of its mesh's morph targets.
    pub weights: Vec<f32>,
}

/// Everything that one glTF file, shape or built-in room holds.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Model {
    pub name: String,
    /// Models that share a mesh, or a texture, share what is packed of it.
    pub meshes: Vec<Arc<Mesh>>,
    pub materials: Vec<Material>,
    pub textures: Vec<Arc<Texture>>,
    pub rig: Rig,
    /// Lights without a surface.
    pub lights: Vec<PunctualLight>,
}

/// The nodes of a model and what moves them.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Rig {
    /// The nodes. Parents come before their children.
    pub nodes: Vec<Node>,
    pub clips: Vec<Clip>,
}

impl Model {
    /// Makes a model of one mesh with one material, at the origin.
    pub fn from_mesh(mesh: impl Into<Arc<Mesh>>, material: Material) -> Self {
        let mesh = mesh.into();
        let name = mesh.name.clone();
        let local = Local::Transform(Transform::IDENTITY);
        let node = Node { name: name.clone(), parent: None, local, mesh: Some(0), weights: Vec::new() };
        let rig = Rig { nodes: vec![node], clips: Vec::new() };
        Self { name, meshes: vec![mesh], materials: vec![material], textures: Vec::new(), rig, lights: Vec::new() }
    }
}

impl Model {
    /// Adds another model's only mesh as a node at `at`, with its materials and textures. Returns the node's
    /// index.
    pub fn add(&mut self, other: Self, at: Transform) -> usize {
        let (first_material, first_texture) = (self.materials.len() as u32, self.textures.len());
        let node = self.rig.nodes.len();
        for mut mesh in other.meshes.into_iter().take(1) {
            Arc::make_mut(&mut mesh).materials.iter_mut().for_each(|material| *material += first_material);
            self.rig.nodes.push(Node {
                name: other.name.clone(),
                parent: None,
                local: Local::Transform(at),
                mesh: Some(self.meshes.len()),
                weights: Vec::new(),
            });
            self.meshes.push(mesh);
        }
        self.materials.extend(other.materials.into_iter().map(|material| material.with_textures_from(first_texture)));
        self.textures.extend(other.textures);
        node
    }
}

impl Rig {
    /// Returns node-to-model matrices, with `clip` played at `time` seconds if one is given.
    pub fn node_matrices(&self, clip: Option<(usize, f64)>) -> Vec<Affine3A> {
        let mut locals: Vec<Local> = self.nodes.iter().map(|node| node.local).collect();
        if let Some((clip, time)) = clip {
            self.clips[clip].apply(time, &mut locals);
        }
        let mut matrices: Vec<Affine3A> = Vec::with_capacity(locals.len());
        for (node, local) in self.nodes.iter().zip(&locals) {
            let parent = node.parent.map_or(Affine3A::IDENTITY, |parent| matrices[parent]);
            matrices.push(parent * local.matrix());
        }
        matrices
    }

    /// Returns the weights of the morph targets of a node's mesh, with `clip` played as above.
    pub fn weights(&self, node: usize, clip: Option<(usize, f64)>) -> Cow<'_, [f32]> {
        let own = self.nodes.get(node).map_or(&[][..], |node| &node.weights);
        let played = clip.and_then(|(clip, time)| self.clips[clip].weights_at(node, time));
        played.map_or(Cow::Borrowed(own), Cow::Owned)
    }
}
