//! Meshes that change their shape: skins and morph targets. On the CPU, once a frame, for each placed mesh.
//!
//! A deforming mesh has triangles, vertices and a bottom level of its own for each placement, behind all rigid
//! ones. Every frame its vertices are posed and the boxes of its tree are fitted to them again.

use super::{
    bounds::Bounds,
    bvh,
    model::{Mesh, Rig},
    packed::{BvhNode, PackedScene, TriangleGeometry, Vertex},
};
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
    /// Poses all vertices. `nodes` are node-to-model matrices, and `weights` those of the targets.
    pub fn pose(&self, nodes: &[Affine3A], weights: &[f32]) -> Posed {
        let mut posed = Posed { positions: self.positions.clone(), normals: self.normals.clone(), turns: Vec::new() };
        for (target, weight) in self.targets.iter().zip(weights).filter(|(_, weight)| **weight != 0.0) {
            posed.positions.iter_mut().zip(&target.positions).for_each(|(to, by)| *to += *weight * *by);
            posed.normals.iter_mut().zip(&target.normals).for_each(|(to, by)| *to += *weight * *by);
        }
        let Some(skin) = &self.skin else { return posed };
        let joints = skin.matrices(nodes);
        let matrix = |influences: &Influences| {
            influences.iter().fold(Mat4::ZERO, |sum, (joint, weight)| {
                sum + joints.get(usize::from(*joint)).copied().unwrap_or(Mat4::IDENTITY) * *weight
            })
        };
        let matrices: Vec<Mat4> = self.influences.par_iter().map(matrix).collect();
        posed.positions.iter_mut().zip(&matrices).for_each(|(to, matrix)| *to = matrix.transform_point3(*to));
        posed.turns = matrices.iter().map(|matrix| Mat3::from_mat4(*matrix)).collect();
        for (normal, turn) in posed.normals.iter_mut().zip(&posed.turns) {
            // The cofactors turn normals as the transposed inverse does, and exist for flat matrices, too.
            let [x, y, z] = [turn.x_axis, turn.y_axis, turn.z_axis];
            let turned = Mat3::from_cols(y.cross(z), z.cross(x), x.cross(y)) * *normal;
            *normal = turned * turn.determinant().signum();
        }
        posed
    }
}

/// A placed mesh that deforms: where its packed arrays are, and what each entry comes from.
#[derive(Clone, Debug)]
pub struct Placed {
    /// The mesh in the model.
    pub mesh: usize,
    pub first_triangle: u32,
    pub first_vertex: u32,
    pub root: u32,
    /// The corners of each packed triangle in the mesh.
    corners: Vec<[u32; 3]>,
    /// The packed vertices and nodes in the rest pose.
    vertices: Vec<Vertex>,
    nodes: Vec<BvhNode>,
    /// The inverse of what the rest pose turned tangents by.
    unturn: Vec<Mat3>,
}

/// What a deforming mesh is at one time, to be put over the packed arrays.
#[derive(Clone, Debug, Default)]
pub struct Patch {
    pub first_triangle: u32,
    pub triangles: Vec<TriangleGeometry>,
    /// The same triangles a frame ago.
    pub previous: Vec<TriangleGeometry>,
    pub first_vertex: u32,
    pub vertices: Vec<Vertex>,
    pub first_node: u32,
    pub nodes: Vec<BvhNode>,
    /// The longest way that a vertex has gone since, object space.
    pub step: f32,
}

impl Patch {
    /// Returns the box around it, object space.
    pub fn bounds(&self) -> Bounds {
        self.nodes.first().map_or(Bounds::EMPTY, |root| Bounds { min: root.min, max: root.max })
    }
}

/// Puts patches over packed arrays.
pub fn patched(scene: &PackedScene, patches: &[Patch]) -> PackedScene {
    let mut scene = scene.clone();
    for patch in patches {
        scene.triangles[patch.first_triangle as usize..][..patch.triangles.len()].copy_from_slice(&patch.triangles);
        scene.vertices[patch.first_vertex as usize..][..patch.vertices.len()].copy_from_slice(&patch.vertices);
        scene.nodes[patch.first_node as usize..][..patch.nodes.len()].copy_from_slice(&patch.nodes);
    }
    scene
}

impl Placed {
    /// Notes where a mesh has been packed last. `corners` are those of each packed triangle in the mesh.
    pub fn new(scene: &PackedScene, mesh: usize, [triangle, vertex, root]: [u32; 3], corners: Vec<[u32; 3]>) -> Self {
        Self {
            mesh,
            first_triangle: triangle,
            first_vertex: vertex,
            root,
            corners,
            vertices: scene.vertices[vertex as usize..].to_vec(),
            nodes: scene.nodes[root as usize..].to_vec(),
            unturn: Vec::new(),
        }
    }

    /// Takes down how the rest pose, in which the mesh was packed, turns its tangents.
    pub fn resting(mut self, mesh: &Mesh, rig: &Rig) -> Self {
        if let Some(deform) = &mesh.deform {
            let posed = deform.pose(&rig.node_matrices(None), &rig.weights(deform.weights_of, None));
            let inverse = |turn: &Mat3| if turn.determinant().abs() > 1e-20 { turn.inverse() } else { Mat3::IDENTITY };
            self.unturn = posed.turns.iter().map(inverse).collect();
        }
        self
    }

    /// Returns the mesh as it is with these matrices and weights now and before.
    pub fn patch(&self, mesh: &Mesh, now: (&[Affine3A], &[f32]), before: (&[Affine3A], &[f32])) -> Option<Patch> {
        let deform = mesh.deform.as_ref()?;
        let posed = deform.pose(now.0, now.1);
        let earlier = if now == before { None } else { Some(deform.pose(before.0, before.1)) };
        let triangle = |positions: &[Vec3], corners: &[u32; 3]| {
            let [v0, v1, v2] = corners.map(|corner| positions[corner as usize]);
            TriangleGeometry { v0, e1: v1 - v0, e2: v2 - v0 }
        };
        let triangles: Vec<_> = self.corners.iter().map(|corners| triangle(&posed.positions, corners)).collect();
        let previous = match &earlier {
            Some(earlier) => self.corners.iter().map(|corners| triangle(&earlier.positions, corners)).collect(),
            None => triangles.clone(),
        };
        let moved = |earlier: &Posed| {
            posed.positions.iter().zip(&earlier.positions).map(|(a, b)| a.distance(*b)).fold(0.0, f32::max)
        };
        let step = earlier.as_ref().map_or(0.0, moved);
        let mut vertices = self.vertices.clone();
        if deform.normals.is_empty() {
            for (corners, triangle) in self.corners.iter().zip(&triangles) {
                let normal = triangle.e1.cross(triangle.e2).normalize_or(Vec3::Y);
                corners.iter().for_each(|corner| vertices[*corner as usize].normal = normal);
            }
        } else {
            for (vertex, normal) in vertices.iter_mut().zip(&posed.normals) {
                vertex.normal = normal.normalize_or(vertex.normal);
            }
        }
        for ((vertex, turn), unturn) in vertices.iter_mut().zip(&posed.turns).zip(&self.unturn) {
            let [x, y, z, sign] = vertex.tangent;
            let along = (*turn * (*unturn * Vec3::new(x, y, z))).normalize_or_zero();
            vertex.tangent = along.extend(sign).to_array();
        }
        let nodes = self.fitted(&triangles);
        let [first_triangle, first_vertex, first_node] = [self.first_triangle, self.first_vertex, self.root];
        Some(Patch { first_triangle, triangles, previous, first_vertex, vertices, first_node, nodes, step })
    }

    /// Returns the tree with its boxes around these triangles. Its leaves stay.
    fn fitted(&self, triangles: &[TriangleGeometry]) -> Vec<BvhNode> {
        let mut nodes = self.nodes.clone();
        // Nodes are in depth-first order, so children come after their parent.
        for index in (0..nodes.len()).rev() {
            let bounds = if nodes[index].leaf != 0 {
                let run = bvh::leaf(&nodes[index]);
                let own = run.map(|triangle| &triangles[(triangle - self.first_triangle) as usize]);
                Bounds::of(own.flat_map(|t| [t.v0, t.v0 + t.e1, t.v0 + t.e2])).padded()
            } else {
                let [left, right] = children(&nodes, index, self.root);
                let of = |node: &BvhNode| Bounds { min: node.min, max: node.max };
                of(&nodes[left]).union(of(&nodes[right]))
            };
            (nodes[index].min, nodes[index].max) = (bounds.min, bounds.max);
        }
        nodes
    }
}

fn children(nodes: &[BvhNode], index: usize, root: u32) -> [usize; 2] {
    let left = index + 1;
    [left, (nodes[left].next - root) as usize]
}
