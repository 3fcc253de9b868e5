//! A deforming mesh in a packed scene, and what poses it.

use super::{Deform, Outline, Stance};
use crate::scene::{
    bounds::Bounds,
    bvh,
    model::{Mesh, Rig},
    packed::{BvhNode, PackedScene, TriangleGeometry, Vertex},
};
use glam::Vec3;
use std::sync::Arc;

/// A placed mesh that deforms: where its packed arrays are, and what each entry comes from.
#[derive(Clone, Debug)]
pub struct Placed {
    /// The mesh in the model.
    pub mesh: usize,
    pub deform: Arc<Deform>,
    pub first_triangle: u32,
    pub first_vertex: u32,
    pub root: u32,
    /// The corners of each packed triangle in the mesh.
    pub corners: Vec<[u32; 3]>,
    /// The packed vertices and nodes in the rest pose.
    pub vertices: Vec<Vertex>,
    pub nodes: Vec<BvhNode>,
    /// Tangents in the mesh's own space, of each vertex. Empty if no skin turns them.
    pub tangents: Vec<Vec3>,
    /// The upper part of the tree.
    pub outline: Outline,
    /// What poses it at rest.
    pub rest: Stance,
}

impl Placed {
    /// Notes where a mesh has been packed last, in its rest pose. `corners` are those of each packed triangle in the
    /// mesh. `None` if nothing deforms it.
    pub fn new(
        scene: &PackedScene,
        (number, mesh, rig): (usize, &Mesh, &Rig),
        [first_triangle, first_vertex, root]: [u32; 3],
        corners: Vec<[u32; 3]>,
    ) -> Option<Self> {
        let deform = mesh.deform.clone()?;
        let vertices = scene.vertices[first_vertex as usize..].to_vec();
        let nodes = scene.nodes[root as usize..].to_vec();
        let rest = deform.stance(rig, None);
        // The packed tangents were turned, too.
        let own = |(vertex, turn): (&Vertex, &glam::Mat3)| {
            let [x, y, z, _] = vertex.tangent;
            let turned = Vec3::new(x, y, z);
            if turn.determinant().abs() > 1e-20 { turn.inverse() * turned } else { turned }
        };
        let tangents = vertices.iter().zip(&deform.pose(&rest).turns).map(own).collect();
        let outline = Outline::of(&deform, &nodes, root, |triangle| corners[(triangle - first_triangle) as usize]);
        let mesh = number;
        Some(Self {
            mesh,
            deform,
            first_triangle,
            first_vertex,
            root,
            corners,
            vertices,
            nodes,
            tangents,
            outline,
            rest,
        })
    }

    /// The tree's upper part, if its nodes are `nodes`.
    pub fn outline_of(&self, nodes: &[BvhNode]) -> Outline {
        Outline::of(&self.deform, nodes, self.root, |triangle| self.corners[(triangle - self.first_triangle) as usize])
    }

    /// Returns the triangles between posed corners.
    pub fn triangles(&self, positions: &[Vec3]) -> Vec<TriangleGeometry> {
        self.corners.iter().map(|corners| triangle(corners.map(|corner| positions[corner as usize]))).collect()
    }

    /// Returns the tree with its boxes around these triangles. Its leaves stay.
    fn fitted(&self, triangles: &[TriangleGeometry]) -> Vec<BvhNode> {
        let mut nodes = self.nodes.clone();
        // Nodes are in depth-first order, so children come after their parent.
        for index in (0..nodes.len()).rev() {
            let bounds = if nodes[index].leaf != 0 {
                self.around(&nodes[index], triangles).padded()
            } else {
                let [left, right] = bvh::children(&nodes, index, self.root);
                let of = |node: &BvhNode| Bounds { min: node.min, max: node.max };
                of(&nodes[left]).union(of(&nodes[right]))
            };
            (nodes[index].min, nodes[index].max) = (bounds.min, bounds.max);
        }
        nodes
    }

    /// Returns the box around the triangles of a leaf.
    pub fn around(&self, leaf: &BvhNode, triangles: &[TriangleGeometry]) -> Bounds {
        let own = bvh::leaf(leaf).map(|triangle| &triangles[(triangle - self.first_triangle) as usize]);
        Bounds::of(own.flat_map(|t| [t.v0, t.v0 + t.e1, t.v0 + t.e2]))
    }
}

fn triangle([v0, v1, v2]: [Vec3; 3]) -> TriangleGeometry {
    TriangleGeometry { v0, e1: v1 - v0, e2: v2 - v0 }
}

/// A deforming mesh now and a frame ago, not posed yet.
#[derive(Clone, Debug)]
pub struct Pose {
    pub placed: Arc<Placed>,
    pub now: Stance,
    pub before: Stance,
    /// A box around it now, object space. It may be larger than it must.
    pub bounds: Bounds,
    /// How far a vertex has gone since at most, object space.
    pub step: f32,
}

/// What a deforming mesh is at one time, to be put over the packed arrays.
#[derive(Clone, Debug, Default)]
pub struct Patch {
    pub triangles: Vec<TriangleGeometry>,
    pub vertices: Vec<Vertex>,
    pub nodes: Vec<BvhNode>,
}

impl Pose {
    pub fn new(placed: &Arc<Placed>, now: Stance, before: Stance) -> Self {
        let (bounds, step) = (placed.outline.bounds(&now), placed.outline.step(&now, &before));
        Self { placed: placed.clone(), now, before, bounds, step }
    }

    /// Poses it on the CPU, and returns the box around it, object space.
    pub fn posed_bounds(&self) -> Bounds {
        let triangles = self.placed.triangles(&self.placed.deform.pose(&self.now).positions);
        Bounds::of(triangles.into_iter().flat_map(|t| [t.v0, t.v0 + t.e1, t.v0 + t.e2])).padded()
    }

    /// Poses one triangle, by its number among all. `None` if it belongs to something else.
    pub fn triangle(&self, number: u32) -> Option<TriangleGeometry> {
        let corners = self.placed.corners.get(number.checked_sub(self.placed.first_triangle)? as usize)?;
        Some(triangle(corners.map(|corner| self.placed.deform.position(corner as usize, &self.now))))
    }

    /// Poses it on the CPU.
    pub fn patch(&self) -> Patch {
        let placed = &*self.placed;
        let posed = placed.deform.pose(&self.now);
        let triangles = placed.triangles(&posed.positions);
        let mut vertices = placed.vertices.clone();
        if placed.deform.normals.is_empty() {
            for (corners, triangle) in placed.corners.iter().zip(&triangles) {
                let normal = triangle.e1.cross(triangle.e2).normalize_or(Vec3::Y);
                corners.iter().for_each(|corner| vertices[*corner as usize].normal = normal);
            }
        } else {
            for ((vertex, normal), own) in vertices.iter_mut().zip(&posed.normals).zip(&placed.deform.normals) {
                vertex.normal = normal.normalize_or(own.normalize_or(Vec3::Y));
            }
        }
        for ((vertex, turn), own) in vertices.iter_mut().zip(&posed.turns).zip(&placed.tangents) {
            let [.., sign] = vertex.tangent;
            vertex.tangent = (*turn * *own).normalize_or_zero().extend(sign).to_array();
        }
        let nodes = placed.fitted(&triangles);
        Patch { triangles, vertices, nodes }
    }
}

/// Puts meshes over packed arrays as they are now, posed on the CPU.
pub fn patched(scene: &PackedScene, poses: &[Pose]) -> PackedScene {
    let mut scene = scene.clone();
    for pose in poses {
        let (patch, placed) = (pose.patch(), &pose.placed);
        scene.triangles[placed.first_triangle as usize..][..patch.triangles.len()].copy_from_slice(&patch.triangles);
        scene.vertices[placed.first_vertex as usize..][..patch.vertices.len()].copy_from_slice(&patch.vertices);
        scene.nodes[placed.root as usize..][..patch.nodes.len()].copy_from_slice(&patch.nodes);
    }
    scene
}
