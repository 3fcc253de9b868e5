//! Every built-in room is closed, faces inwards, is diffuse except for the gallery's mirror, and has nothing
//! that flickers.

use super::{NAMES, Room, by_name};
use crate::scene::model::Mesh;
use glam::{Vec3, Vec3A};
use obvhs::{BvhBuildParams, bvh2::builder::build_bvh2_from_tris, ray::Ray, ray::RayHit, triangle::Triangle};
use std::{sync::Arc, time::Duration};

fn rooms() -> Vec<Room> {
    NAMES.iter().map(|name| by_name(name).expect("a built-in room")).collect()
}

fn corners(mesh: &Mesh, i: usize) -> [Vec3; 3] {
    mesh.triangles[i].map(|k| mesh.positions[k as usize])
}

/// Returns all that is real in one mesh, as it stands at `time` seconds.
fn real(room: &Room, time: f64) -> Mesh {
    let rig = &room.model.rig;
    let matrices = rig.node_matrices((!rig.clips.is_empty()).then_some((0, time)));
    let mut all = Mesh { name: room.name.into(), ..Mesh::default() };
    for (node, matrix) in rig.nodes.iter().zip(&matrices) {
        let Some(mesh) = node.mesh.map(|mesh| &room.model.meshes[mesh]) else { continue };
        let first = all.positions.len() as u32;
        all.positions.extend(mesh.positions.iter().map(|p| matrix.transform_point3(*p)));
        all.normals.extend(mesh.normals.iter().map(|n| matrix.transform_vector3(*n)));
        all.uvs.extend(&mesh.uvs);
        all.triangles.extend(mesh.triangles.iter().map(|t| t.map(|k| first + k)));
        all.materials.extend(&mesh.materials);
    }
    all
}

/// Returns the times of a room's panorama frames at which it differs.
fn times(room: &Room) -> Vec<f64> {
    room.video.map_or(vec![0.0], |video| (0..=video.frames / 2).map(|i| f64::from(i) / video.fps).collect())
}

/// Free places in each room, world, metres.
fn places(room: &Room) -> [Vec3; 3] {
    let [a, b] = match room.name {
        "apartment" => [Vec3::new(-0.9, 0.7, -0.9), Vec3::new(1.7, 2.0, -0.9)],
        "bedroom" => [Vec3::new(0.9, 0.5, -0.9), Vec3::new(-1.6, 2.0, -0.4)],
        _ => [Vec3::new(0.3, 0.6, -2.7), Vec3::new(-2.9, 2.2, 1.0)],
    };
    [room.capture_position, a, b]
}

#[test]
fn every_direction_hits_a_front_face() {
    for (room, time) in rooms().iter().flat_map(|room| times(room).into_iter().map(move |time| (room, time))) {
        let mesh = real(room, time);
        let tris: Vec<Triangle> = (0..mesh.triangles.len())
            .map(|i| corners(&mesh, i).map(Vec3A::from))
            .map(|[v0, v1, v2]| Triangle { v0, v1, v2 })
            .collect();
        let bvh = build_bvh2_from_tris(&tris, BvhBuildParams::fast_build(), &mut Duration::default());
        let count = 20_000;
        let mut backs = std::collections::BTreeMap::<String, (u32, Vec3)>::new();
        for origin in places(room) {
            for i in 0..count {
                let y = 1.0 - (2 * i + 1) as f32 / count as f32;
                let angle = i as f32 * 2.399_963_2;
                let direction = Vec3::new((1.0 - y * y).sqrt() * angle.cos(), y, (1.0 - y * y).sqrt() * angle.sin());
                let mut hit = RayHit::none();
                let found = bvh.ray_traverse(Ray::new_inf(origin.into(), direction.into()), &mut hit, |ray, id| {
                    tris[bvh.primitive_indices[id] as usize].intersect(ray)
                });
                assert!(found && hit.t < 10.0, "{}: a gap at {direction} from {origin}", room.name);
                let triangle = bvh.primitive_indices[hit.primitive_id as usize] as usize;
                let [a, b, c] = corners(&mesh, triangle);
                if (b - a).cross(c - a).dot(direction) >= 0.0 {
                    let name = &room.model.materials[mesh.materials[triangle] as usize].name;
                    let entry = backs.entry(name.clone()).or_default();
                    *entry = (entry.0 + 1, origin + direction * hit.t);
                }
            }
        }
        assert!(backs.is_empty(), "{}: back faces seen: {backs:?}", room.name);
    }
}

#[test]
fn meshes_are_well_formed() {
    for room in rooms() {
        let objects = room.objects.iter().map(|o| (o.name.as_str(), &o.model.meshes[0]));
        for (name, mesh) in room.model.meshes.iter().map(|mesh| (room.name, mesh)).chain(objects) {
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
        let count = |mesh: &Arc<Mesh>| mesh.triangles.len();
        let real: usize = room.model.meshes.iter().map(count).sum();
        let inserted: usize = room.objects.iter().map(|o| count(&o.model.meshes[0])).sum();
        println!("{}: {real} triangles, its {} objects {inserted}", room.name, room.objects.len());
        assert!((2_000..30_000).contains(&real), "{}: {real} triangles", room.name);
    }
}

#[test]
fn what_is_real_is_diffuse_but_for_one_mirror() {
    for room in rooms() {
        for material in &room.model.materials {
            assert!(material.base_color.max_element() <= 1.0, "{}", material.name);
            if (room.name, material.name.as_str()) == ("gallery", "mirror") {
                assert_eq!((material.metallic, material.roughness), (1.0, 0.0));
            } else {
                assert_eq!((material.specular, material.metallic), (0.0, 0.0), "{}: {}", room.name, material.name);
            }
        }
    }
}

#[test]
fn objects_are_diffuse_glossy_and_specular_and_one_shines() {
    for room in rooms() {
        let materials: Vec<_> = room.objects.iter().flat_map(|object| &object.model.materials).collect();
        let some = |what: &str, is: &dyn Fn(&crate::scene::material::Material) -> bool| {
            assert!(materials.iter().any(|material| is(material)), "{}: no {what} object", room.name);
        };
        some("diffuse", &|m| m.specular == 0.0 && m.metallic == 0.0);
        some("glossy", &|m| m.metallic == 0.0 && m.specular > 0.0 && m.roughness < 0.3);
        some("mirror-like", &|m| m.metallic == 1.0 && m.roughness == 0.0);
        some("emissive", &|m| m.emissive.max_element() > 1.0);
        assert!(room.objects.len() >= 6, "{}", room.name);
    }
}

/// Returns the overlap of two triangles in one plane, in square metres, by clipping one with the other's
/// edges.
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

/// Returns pairs of faces that lie on one another, each named once: materials, place, normal.
fn shared_places(room: &Room, mesh: &Mesh) -> Vec<(String, String, Vec3, Vec3)> {
    let faces: Vec<_> = (0..mesh.triangles.len())
        .map(|i| {
            let c = corners(mesh, i);
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
                let name = |t: usize| room.model.materials[mesh.materials[t] as usize].name.clone();
                found.push((name(i), name(j), (low + high) * 0.5, n));
            }
        }
    }
    found.sort_by(|a, b| (&a.0, &a.1).cmp(&(&b.0, &b.1)));
    found.dedup_by(|a, b| a.0 == b.0 && a.1 == b.1);
    found
}

#[test]
fn no_two_faces_share_a_plane_and_a_place() {
    for room in rooms() {
        for time in times(&room) {
            let found = shared_places(&room, &real(&room, time));
            assert!(found.is_empty(), "{} at {time} s: coplanar overlaps {found:?}", room.name);
        }
    }
}

#[test]
fn moving_objects_come_back() {
    for room in rooms() {
        let moving: Vec<_> = room.objects.iter().filter(|o| !o.placement.translation.is_constant()).collect();
        assert!(!moving.is_empty(), "{}", room.name);
        for object in moving {
            let (start, end) = (object.placement.at(0.0), object.placement.at(4.0));
            assert!(start.translation.abs_diff_eq(end.translation, 1e-5), "{}: {}", room.name, object.name);
            assert!(start.rotation.dot(end.rotation).abs() > 1.0 - 1e-5, "{}: {}", room.name, object.name);
            assert_ne!(start, object.placement.at(1.0), "{}: {}", room.name, object.name);
        }
    }
}

#[test]
fn the_screen_swings_out_and_back_the_same_way() {
    let room = by_name("gallery").expect("built in");
    let video = room.video.expect("it moves");
    let at = |frame: u32| room.model.rig.node_matrices(Some((0, f64::from(frame) / video.fps)));
    for frame in 1..video.frames {
        assert_eq!(at(frame), at(video.frames - frame), "one capture serves both");
        assert_ne!(at(frame), at(frame - 1));
    }
    assert_eq!(at(0), at(video.frames));
    assert_eq!(f64::from(video.frames) / video.fps, 4.0);
}

#[test]
fn same_call_same_bits() {
    for name in NAMES {
        let model = || by_name(name).expect("built in").model;
        assert!(model() == model(), "{name}");
    }
}
