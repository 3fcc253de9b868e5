//! Computes tangents by MikkTSpace, the algorithm that glTF prescribes where a file has none.

use bevy_mikktspace::{Geometry, TangentSpace, generate_tangents};
use std::collections::HashMap;

/// Triangles whose vertices can be split.
pub(super) trait Corners: Sized {
    fn counts(&self) -> (usize, usize);
    fn vertex(&self, triangle: usize, corner: usize) -> u32;
    fn position_normal_uv(&self, vertex: u32) -> ([f32; 3], [f32; 3], [f32; 2]);
    /// Replaces the vertices by (old vertex, tangent), and the triangles.
    fn rebuild(self, vertices: &[(u32, [f32; 4])], triangles: Vec<[u32; 3]>) -> Self;
}

struct Work<'a, C> {
    corners: &'a C,
    tangents: Vec<[f32; 4]>,
}

impl<C: Corners> Geometry for Work<'_, C> {
    fn num_faces(&self) -> usize {
        self.corners.counts().1
    }

    fn num_vertices_of_face(&self, _: usize) -> usize {
        3
    }

    fn position(&self, face: usize, corner: usize) -> [f32; 3] {
        self.corners.position_normal_uv(self.corners.vertex(face, corner)).0
    }

    fn normal(&self, face: usize, corner: usize) -> [f32; 3] {
        self.corners.position_normal_uv(self.corners.vertex(face, corner)).1
    }

    fn tex_coord(&self, face: usize, corner: usize) -> [f32; 2] {
        self.corners.position_normal_uv(self.corners.vertex(face, corner)).2
    }

    fn set_tangent(&mut self, tangent: Option<TangentSpace>, face: usize, corner: usize) {
        let [x, y, z, sign] = tangent.map_or([0.0; 4], |tangent| tangent.tangent_encoded());
        // MikkTSpace takes v upwards. In glTF it points down, and the green of normal maps up.
        let tangent = [x, y, z, -sign];
        let usable = tangent.iter().all(|value| value.is_finite());
        self.tangents[face * 3 + corner] = if usable { tangent } else { [0.0; 4] };
    }
}

/// Gives every corner its tangent. Vertices whose corners disagree are split. Corners without one get zero,
/// which switches normal mapping off there.
pub(super) fn generate<C: Corners>(corners: C) -> C {
    let (_, triangles) = corners.counts();
    let mut work = Work { corners: &corners, tangents: vec![[0.0; 4]; triangles * 3] };
    // An error means that no tangent could be made.
    let _ = generate_tangents(&mut work);
    let tangents = work.tangents;
    let mut vertices: Vec<(u32, [f32; 4])> = Vec::new();
    let mut known: HashMap<(u32, [u32; 4]), u32> = HashMap::new();
    let mut corner_vertex = |triangle: usize, corner: usize| {
        let (vertex, tangent) = (corners.vertex(triangle, corner), tangents[triangle * 3 + corner]);
        *known.entry((vertex, tangent.map(f32::to_bits))).or_insert_with(|| {
            vertices.push((vertex, tangent));
            vertices.len() as u32 - 1
        })
    };
    let rebuilt = (0..triangles).map(|triangle| [0, 1, 2].map(|corner| corner_vertex(triangle, corner))).collect();
    corners.rebuild(&vertices, rebuilt)
}
