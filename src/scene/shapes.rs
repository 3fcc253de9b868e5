//! The built-in shapes, centred at the origin. `size` is the full extent along each axis, metres.

use super::model::Mesh;
use glam::{Vec2, Vec3};
use std::f32::consts::{PI, TAU};

/// The built-in shapes.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Shape {
    /// 64 × 32 quads, smooth.
    Sphere,
    Box,
    /// It lies in XZ and faces +Y.
    Plane,
    /// Its axis is Y, and discs close it.
    Cylinder,
}

impl Shape {
    /// The names in scene files, in the order of [`Shape::ALL`].
    pub const NAMES: [&str; 4] = ["sphere", "box", "plane", "cylinder"];
    /// All shapes.
    pub const ALL: [Self; 4] = [Self::Sphere, Self::Box, Self::Plane, Self::Cylinder];

    /// Makes the mesh, with material 0 on every triangle. `size` must be positive (a plane's y is not used).
    pub fn mesh(self, size: Vec3) -> Mesh {
        let mut mesh = match self {
            Self::Sphere => return sphere(32, size),
            Self::Box => cuboid(size),
            Self::Plane => plane(size),
            Self::Cylinder => lathe(&cylinder_profile(), 64, size),
        };
        mesh.name = Self::NAMES[self as usize].to_owned();
        mesh.materials = vec![0; mesh.triangles.len()];
        mesh
    }
}

/// Makes a sphere of `rings` × 2 `rings` quads, smooth, with material 0 on every triangle.
pub fn sphere(rings: u32, size: Vec3) -> Mesh {
    let mut mesh = lathe(&circle_profile(rings), 2 * rings, size);
    mesh.name = Shape::NAMES[Shape::Sphere as usize].to_owned();
    mesh.materials = vec![0; mesh.triangles.len()];
    mesh
}

/// A point of a profile that is turned about Y: radius, height, normal (radial, up), v.
type ProfilePoint = (f32, f32, [f32; 2], f32);

fn circle_profile(rings: u32) -> Vec<Vec<ProfilePoint>> {
    let point = |ring: u32| {
        let v = ring as f32 / rings as f32;
        let (sin, cos) = if ring == rings { (0.0, -1.0) } else { (PI * v).sin_cos() };
        (0.5 * sin, 0.5 * cos, [sin, cos], v)
    };
    vec![(0..=rings).map(point).collect()]
}

fn cylinder_profile() -> Vec<Vec<ProfilePoint>> {
    vec![
        vec![(0.0, 0.5, [0.0, 1.0], 0.0), (0.5, 0.5, [0.0, 1.0], 1.0)],
        vec![(0.5, 0.5, [1.0, 0.0], 0.0), (0.5, -0.5, [1.0, 0.0], 1.0)],
        vec![(0.5, -0.5, [0.0, -1.0], 0.0), (0.0, -0.5, [0.0, -1.0], 1.0)],
    ]
}

/// Turns profiles about Y. Each runs downwards with the outside to the right.
fn lathe(profiles: &[Vec<ProfilePoint>], sectors: u32, size: Vec3) -> Mesh {
    let mut mesh = Mesh::default();
    for profile in profiles {
        let first = mesh.positions.len() as u32;
        for &(radius, height, [radial, up], v) in profile {
            for sector in 0..=sectors {
                let u = sector as f32 / sectors as f32;
                // The seam's two columns are the same points, bit for bit.
                let (sin, cos) = (TAU * (sector % sectors) as f32 / sectors as f32).sin_cos();
                mesh.positions.push(Vec3::new(radius * sin, height, radius * cos) * size);
                mesh.normals.push((Vec3::new(radial * sin, up, radial * cos) / size).normalize());
                mesh.uvs.push(Vec2::new(u, v));
                mesh.tangents.push((Vec3::new(cos, 0.0, -sin) * size).normalize().extend(1.0).to_array());
            }
        }
        let columns = sectors + 1;
        for ring in 0..profile.len() as u32 - 1 {
            for sector in 0..sectors {
                let a = first + ring * columns + sector;
                let (b, c, d) = (a + 1, a + columns, a + columns + 1);
                if profile[ring as usize].0 > 0.0 {
                    mesh.triangles.push([a, c, b]);
                }
                if profile[ring as usize + 1].0 > 0.0 {
                    mesh.triangles.push([b, c, d]);
                }
            }
        }
    }
    mesh
}

fn cuboid(size: Vec3) -> Mesh {
    let mut mesh = Mesh::default();
    for axis in 0..3 {
        for sign in [1.0, -1.0] {
            let normal = Vec3::AXES[axis] * sign;
            let up = if axis == 1 { Vec3::NEG_Z * sign } else { Vec3::Y };
            add_quad(&mut mesh, normal, up, size);
        }
    }
    mesh
}

fn plane(size: Vec3) -> Mesh {
    let mut mesh = Mesh::default();
    add_quad(&mut mesh, Vec3::Y, Vec3::NEG_Z, Vec3::new(size.x, 0.0, size.z));
    mesh
}

/// Adds the face of a box towards `normal`. Seen from outside, u is to the right and v downwards.
fn add_quad(mesh: &mut Mesh, normal: Vec3, up: Vec3, size: Vec3) {
    let first = mesh.positions.len() as u32;
    let right = up.cross(normal);
    for uv in [Vec2::ZERO, Vec2::X, Vec2::ONE, Vec2::Y] {
        mesh.positions.push((normal * 0.5 + right * (uv.x - 0.5) + up * (0.5 - uv.y)) * size);
        mesh.normals.push(normal);
        mesh.uvs.push(uv);
        mesh.tangents.push(right.extend(1.0).to_array());
    }
    mesh.triangles.extend([[first, first + 2, first + 1], [first, first + 3, first + 2]]);
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn shapes_have_their_size_and_face_outwards() {
        let size = Vec3::new(2.0, 3.0, 0.5);
        for shape in Shape::ALL {
            let mesh = shape.mesh(size);
            let fold = |f: fn(Vec3, Vec3) -> Vec3| mesh.positions.iter().copied().reduce(f).expect("vertices");
            let (min, max) = (fold(Vec3::min), fold(Vec3::max));
            let expected = if shape == Shape::Plane { size * Vec3::new(1.0, 0.0, 1.0) } else { size };
            assert!((max - min).abs_diff_eq(expected, 1e-5), "{shape:?}");
            assert!((max + min).abs_diff_eq(Vec3::ZERO, 1e-5), "{shape:?}");
            // Tangents run to where u grows, which is where anisotropy is told from.
            assert_eq!(mesh.tangents.len(), mesh.normals.len());
            for ([x, y, z, sign], normal) in mesh.tangents.iter().zip(&mesh.normals) {
                let tangent = Vec3::new(*x, *y, *z);
                assert!(tangent.is_normalized() && tangent.dot(*normal).abs() < 1e-5 && *sign == 1.0, "{shape:?}");
            }
            for triangle in &mesh.triangles {
                let [a, b, c] = triangle.map(|i| mesh.positions[i as usize]);
                let face = (b - a).cross(c - a);
                assert!(face.length() > 0.0, "{shape:?}: no degenerate triangle");
                assert!(shape == Shape::Plane || face.dot(a + b + c) > 0.0, "{shape:?}: outwards");
                let [ua, ub, uc] = triangle.map(|i| mesh.uvs[i as usize]);
                let along = ((b - a) * (uc - ua).y - (c - a) * (ub - ua).y) * (ub - ua).perp_dot(uc - ua).signum();
                for i in triangle {
                    let [x, y, z, _] = mesh.tangents[*i as usize];
                    assert!(Vec3::new(x, y, z).dot(along) > 0.0, "{shape:?}: tangents follow u");
                    assert!(mesh.normals[*i as usize].dot(face) > 0.0, "{shape:?}: normals agree");
                }
            }
        }
    }

    #[test]
    fn volumes() {
        for (shape, expected, tolerance) in
            [(Shape::Box, 6.0, 1e-5), (Shape::Sphere, PI, 0.02), (Shape::Cylinder, PI * 1.5, 0.02)]
        {
            let mesh = shape.mesh(Vec3::new(1.0, 2.0, 3.0));
            let volume: f32 = mesh
                .triangles
                .iter()
                .map(|t| t.map(|i| mesh.positions[i as usize]))
                .map(|[a, b, c]| a.dot(b.cross(c)) / 6.0)
                .sum();
            assert!((volume / expected - 1.0).abs() < tolerance, "{shape:?}: {volume}");
        }
    }
}
