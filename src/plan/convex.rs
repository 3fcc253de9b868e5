//! Finds out whether a mesh is convex and closed. A ray that leaves such a mesh never meets it again.

use crate::scene::packed::TriangleGeometry;
use glam::DVec3;
use std::f64::consts::PI;

/// Meshes with more corners times triangles than this are not examined.
const MOST: usize = 1 << 27;

/// Whether all corners lie behind the plane of each triangle, and the triangles cover every direction from
/// the inside once. Corners may stick out by `tolerance`, which is less than the offset of rays from
/// surfaces. If they are `one_sided`, their fronts must be outside.
pub fn is_convex(triangles: &[TriangleGeometry], tolerance: f64, one_sided: bool) -> bool {
    let corners: Vec<DVec3> =
        triangles.iter().flat_map(|t| [t.v0, t.v0 + t.e1, t.v0 + t.e2]).map(|v| v.as_dvec3()).collect();
    if triangles.is_empty() || corners.len() * triangles.len() > MOST {
        return false;
    }
    let centre = corners.iter().sum::<DVec3>() / corners.len() as f64;
    let mut covered = 0.0;
    for triangle in corners.chunks_exact(3) {
        let [a, b, c] = [triangle[0] - centre, triangle[1] - centre, triangle[2] - centre];
        let normal = (b - a).cross(c - a);
        let Some(mut normal) = normal.try_normalize() else { return false };
        if normal.dot(a) < 0.0 {
            if one_sided {
                return false; // the camera looks in
            }
            normal = -normal; // surfaces have two sides for rays, so winding does not matter
        }
        let plane = normal.dot(a);
        if corners.iter().any(|v| normal.dot(*v - centre) > plane + tolerance) {
            return false;
        }
        // solid angle (Van Oosterom and Strackee 1983)
        let (la, lb, lc) = (a.length(), b.length(), c.length());
        let cosines = la * lb * lc + a.dot(b) * lc + a.dot(c) * lb + b.dot(c) * la;
        covered += 2.0 * a.dot(b.cross(c)).abs().atan2(cosines);
    }
    (covered - 4.0 * PI).abs() < 1e-4
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::scene::{model::Mesh, shapes::Shape};
    use glam::{Vec3, vec3};

    fn triangles(mesh: &Mesh) -> Vec<TriangleGeometry> {
        let corners = |t: &[u32; 3]| t.map(|k| mesh.positions[k as usize]);
        mesh.triangles.iter().map(corners).map(|[a, b, c]| TriangleGeometry { v0: a, e1: b - a, e2: c - a }).collect()
    }

    #[test]
    fn shapes_are_convex_and_holes_are_found() {
        for shape in [Shape::Sphere, Shape::Box, Shape::Cylinder] {
            let mut all = triangles(&shape.mesh(vec3(0.3, 0.4, 0.5)));
            assert!(is_convex(&all, 1e-5, false), "{shape:?}");
            assert!(is_convex(&all, 1e-5, true), "{shape:?} faces outwards");
            all.iter_mut().for_each(|t| (t.e1, t.e2) = (t.e2, t.e1));
            assert!(is_convex(&all, 1e-5, false) && !is_convex(&all, 1e-5, true), "{shape:?} inside out");
            all.pop();
            assert!(!is_convex(&all, 1e-5, false), "{shape:?} with a hole");
        }
        assert!(!is_convex(&triangles(&Shape::Plane.mesh(Vec3::ONE)), 1e-5, false), "a plane is not closed");
    }

    #[test]
    fn a_dent_is_found() {
        let mut mesh = Shape::Sphere.mesh(Vec3::ONE);
        let dented = mesh.positions[mesh.positions.len() / 2];
        for position in mesh.positions.iter_mut().filter(|p| p.distance(dented) < 1e-6) {
            *position *= 0.9;
        }
        assert!(!is_convex(&triangles(&mesh), 1e-5, false));
        let two = [triangles(&Shape::Box.mesh(Vec3::ONE)), triangles(&Shape::Box.mesh(Vec3::splat(0.5)))].concat();
        assert!(!is_convex(&two, 1e-5, false), "one inside the other");
    }
}
