//! What every built-in room promises: closed, facing inwards, purely diffuse, nothing that flickers.

use super::{Room, apartment};
use crate::scene::model::Mesh;
use glam::{Vec3, Vec3A};
use obvhs::{BvhBuildParams, bvh2::builder::build_bvh2_from_tris, ray::Ray, ray::RayHit, triangle::Triangle};
use std::time::Duration;

fn corners(mesh: &Mesh, i: usize) -> [Vec3; 3] {
    mesh.triangles[i].map(|k| mesh.positions[k as usize])
}

fn meshes(room: &Room) -> Vec<(&str, &Mesh)> {
    let objects = room.objects.iter().map(|o| (o.name.as_str(), &o.model.meshes[0]));
    std::iter::once((room.name, &room.model.meshes[0])).chain(objects).collect()
}

#[test]
fn every_direction_hits_a_front_face() {
    let room = apartment();
    let tris: Vec<Triangle> = (0..room.model.meshes[0].triangles.len())
        .map(|i| corners(&room.model.meshes[0], i).map(Vec3A::from))
        .map(|[v0, v1, v2]| Triangle { v0, v1, v2 })
        .collect();
    let bvh = build_bvh2_from_tris(&tris, BvhBuildParams::fast_build(), &mut Duration::default());
    let count = 20_000;
    let mut backs = std::collections::BTreeMap::<String, (u32, Vec3)>::new();
    for origin in [room.capture_position, Vec3::new(-0.9, 0.7, -0.9), Vec3::new(1.7, 2.0, -0.9)] {
        for i in 0..count {
            let y = 1.0 - (2 * i + 1) as f32 / count as f32;
            let angle = i as f32 * 2.399_963_2;
            let direction = Vec3::new((1.0 - y * y).sqrt() * angle.cos(), y, (1.0 - y * y).sqrt() * angle.sin());
            let mut hit = RayHit::none();
            let found = bvh.ray_traverse(Ray::new_inf(origin.into(), direction.into()), &mut hit, |ray, id| {
                tris[bvh.primitive_indices[id] as usize].intersect(ray)
            });
            assert!(found && hit.t < 6.0, "a gap at {direction} from {origin}");
            let triangle = bvh.primitive_indices[hit.primitive_id as usize] as usize;
            let [a, b, c] = corners(&room.model.meshes[0], triangle);
            if (b - a).cross(c - a).dot(direction) >= 0.0 {
                let name = &room.model.materials[room.model.meshes[0].materials[triangle] as usize].name;
                let entry = backs.entry(name.clone()).or_default();
                *entry = (entry.0 + 1, origin + direction * hit.t);
            }
        }
    }
    assert!(backs.is_empty(), "back faces seen: {backs:?}");
}

#[test]
fn meshes_are_well_formed() {
    let room = apartment();
    for (name, mesh) in meshes(&room) {
        assert_eq!(mesh.positions.len(), mesh.normals.len(), "{name}");
        assert_eq!(mesh.positions.len(), mesh.uvs.len(), "{name}");
        assert_eq!(mesh.triangles.len(), mesh.materials.len(), "{name}");
        for i in 0..mesh.triangles.len() {
            let [a, b, c] = corners(mesh, i);
            let face = (b - a).cross(c - a);
            assert!(face.length() > 1e-10, "{name}: triangle {i} at {a} has no area");
            for k in mesh.triangles[i] {
                let normal = mesh.normals[k as usize];
                assert!((normal.length() - 1.0).abs() < 1e-3, "{name}: normal {normal} at {a}");
                assert!(
                    face.normalize().dot(normal) > 0.2,
                    "{name}: triangle {i} at {a} turns away from its normal {normal}"
                );
            }
        }
    }
    assert!(
        (2_000..25_000).contains(&room.model.meshes[0].triangles.len()),
        "{} triangles",
        room.model.meshes[0].triangles.len()
    );
}

#[test]
fn what_is_real_is_diffuse() {
    for material in &apartment().model.materials {
        assert_eq!((material.specular, material.metallic), (0.0, 0.0), "{}", material.name);
        assert!(material.base_color.max_element() <= 1.0);
    }
}

/// The overlap of two triangles in one plane, in square metres, by clipping one with the other's edges.
fn overlap(p: [Vec3; 3], q: [Vec3; 3], normal: Vec3) -> f32 {
    let mut polygon = p.to_vec();
    for k in 0..3 {
        let (a, inside) = (q[k], normal.cross(q[(k + 1) % 3] - q[k]));
        let side = |v: Vec3| inside.dot(v - a);
        let mut clipped = Vec::new();
        for i in 0..polygon.len() {
            let (v, w) = (polygon[i], polygon[(i + 1) % polygon.len()]);
            if side(v) >= 0.0 {
                clipped.push(v);
            }
            if (side(v) >= 0.0) != (side(w) >= 0.0) {
                clipped.push(v + (w - v) * (side(v) / (side(v) - side(w))));
            }
        }
        polygon = clipped;
    }
    polygon.windows(2).map(|w| (w[0] - polygon[0]).cross(w[1] - polygon[0]).length() * 0.5).sum()
}

#[test]
fn no_two_faces_share_a_plane_and_a_place() {
    let room = apartment();
    let faces: Vec<_> = (0..room.model.meshes[0].triangles.len())
        .map(|i| {
            let c = corners(&room.model.meshes[0], i);
            let low = c[0].min(c[1]).min(c[2]);
            let high = c[0].max(c[1]).max(c[2]);
            (i, c, (c[1] - c[0]).cross(c[2] - c[0]).normalize(), low, high)
        })
        .collect();
    let mut order: Vec<_> = (0..faces.len()).collect();
    order.sort_by(|&a, &b| faces[a].3.x.total_cmp(&faces[b].3.x));
    let mut found = Vec::new();
    for (k, &a) in order.iter().enumerate() {
        let (i, p, n, low, high) = faces[a];
        for &b in &order[k + 1..] {
            let (j, q, m, other_low, other_high) = faces[b];
            if other_low.x > high.x + 2e-4 {
                break;
            }
            let apart = other_low.cmpgt(high + 2e-4).any() || low.cmpgt(other_high + 2e-4).any();
            if apart || n.dot(m) < 0.9999 || q.iter().any(|&v| n.dot(v - p[0]).abs() > 2e-4) {
                continue;
            }
            if overlap(p, q, n) > 2e-6 {
                let name = |t: usize| room.model.materials[room.model.meshes[0].materials[t] as usize].name.clone();
                found.push((name(i), name(j), (low + high) * 0.5, n));
            }
        }
    }
    found.dedup_by(|a, b| a.0 == b.0 && a.1 == b.1);
    assert!(found.is_empty(), "{} coplanar overlaps, such as {:?}", found.len(), &found[..found.len().min(12)]);
}

#[test]
fn moving_objects_come_back() {
    let room = apartment();
    let moving: Vec<_> = room.objects.iter().filter(|o| !o.placement.translation.is_constant()).collect();
    assert!(!moving.is_empty());
    for object in moving {
        assert_eq!(object.placement.at(0.0), object.placement.at(4.0), "{}", object.name);
        assert_ne!(object.placement.at(0.0), object.placement.at(1.0), "{}", object.name);
    }
}

#[test]
fn same_call_same_bits() {
    assert!(apartment().model == apartment().model);
}
