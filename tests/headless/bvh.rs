//! The packed two-level BVH against brute force.

use glam::{Affine3A, EulerRot, Quat, Vec3};
use iprt::{
    panorama::source::{PanoramaFrame, PanoramaSource},
    scene::{
        Object, Scene, SceneState,
        animation::{Placement, Transform},
        bounds::Bounds,
        bvh,
        camera::CameraTrack,
        file::RenderSettings,
        material::Material,
        model::{Mesh, Model},
        packed::{BvhNode, NONE, PackedScene},
        shapes::Shape,
    },
};
use proptest::prelude::*;
use std::sync::Arc;

fn assemble(objects: Vec<Object>) -> Scene {
    let frame = PanoramaFrame {
        color_size: [2, 1],
        radiance: vec![[1.0; 4]; 2].into(),
        depth_size: [2, 1],
        depth: vec![1.0; 2],
        ..PanoramaFrame::default()
    };
    let panorama = PanoramaSource::from_frames(vec![frame], 30.0, Vec3::ZERO, 0.0).expect("a panorama");
    Scene::assemble("test", panorama, CameraTrack::at_point(Vec3::ZERO), objects, RenderSettings::default())
        .expect("a scene")
}

fn object(mesh: Mesh, transform: Transform) -> Object {
    let model = Arc::new(Model::from_mesh(mesh, Material::default()));
    Object { name: "o".into(), model, placement: Placement::fixed(transform), clip: None, speed: 1.0 }
}

fn soup(corners: &[[Vec3; 3]]) -> Mesh {
    let count = corners.len() as u32;
    Mesh {
        name: "soup".into(),
        positions: corners.iter().flatten().copied().collect(),
        normals: vec![Vec3::Y; corners.len() * 3],
        triangles: (0..count).map(|i| [3 * i, 3 * i + 1, 3 * i + 2]).collect(),
        materials: vec![0; corners.len()],
        ..Mesh::default()
    }
}

/// Distance to a triangle, Möller–Trumbore in double precision.
fn hit_triangle(scene: &PackedScene, triangle: usize, origin: Vec3, direction: Vec3) -> Option<f64> {
    let g = &scene.triangles[triangle];
    let (e1, e2) = (g.e1.as_dvec3(), g.e2.as_dvec3());
    let p = direction.as_dvec3().cross(e2);
    let determinant = e1.dot(p);
    if determinant == 0.0 {
        return None;
    }
    let s = origin.as_dvec3() - g.v0.as_dvec3();
    let u = s.dot(p) / determinant;
    let q = s.cross(e1);
    let v = direction.as_dvec3().dot(q) / determinant;
    let t = e2.dot(q) / determinant;
    (u >= 0.0 && v >= 0.0 && u + v <= 1.0 && t > 0.0).then_some(t)
}

fn enters(bounds: &Bounds, origin: Vec3, direction: Vec3, nearest: f64) -> bool {
    let (mut low, mut high) = (0.0_f64, nearest);
    for axis in 0..3 {
        let inverse = 1.0 / f64::from(direction[axis]);
        let a = (f64::from(bounds.min[axis]) - f64::from(origin[axis])) * inverse;
        let b = (f64::from(bounds.max[axis]) - f64::from(origin[axis])) * inverse;
        (low, high) = (low.max(a.min(b)), high.min(a.max(b)));
    }
    low <= high
}

/// The leaves of a tree whose boxes a ray meets, as a shader finds them, with what `nearest` becomes meanwhile.
fn walk(nodes: &[BvhNode], root: u32, ray: [Vec3; 2], nearest: &mut f64, mut leaf: impl FnMut(&BvhNode, &mut f64)) {
    let mut at = root;
    while at != NONE {
        let node = &nodes[at as usize];
        let met = enters(&Bounds { min: node.min, max: node.max }, ray[0], ray[1], *nearest);
        if met && node.leaf != 0 {
            leaf(node, nearest);
        }
        at = if met && node.leaf == 0 { at + 1 } else { node.next };
    }
}

/// Closest hit as a shader finds it. Returns distance, instance id, triangle.
fn trace(scene: &Scene, state: &SceneState, origin: Vec3, direction: Vec3) -> Option<(f64, u32, u32)> {
    let (mut best, mut nearest) = (None, f64::INFINITY);
    let root = if state.instances.nodes.is_empty() { NONE } else { 0 };
    walk(&state.instances.nodes, root, [origin, direction], &mut nearest, |top, nearest| {
        let instance = &state.instances.instances[(top.leaf >> 3) as usize];
        let [x, y, z] = instance.world_to_object.map(glam::Vec4::from_array);
        let apply = |v: Vec3, w: f32| Vec3::new(x.dot(v.extend(w)), y.dot(v.extend(w)), z.dot(v.extend(w)));
        let local = [apply(origin, 1.0), apply(direction, 0.0)];
        walk(&scene.packed.nodes, instance.root, local, nearest, |node, nearest| {
            for triangle in bvh::leaf(node) {
                if let Some(t) = hit_triangle(&scene.packed, triangle as usize, local[0], local[1])
                    && t < *nearest
                {
                    (*nearest, best) = (t, Some((t, instance.id, triangle)));
                }
            }
        });
    });
    best
}

fn brute_force(
    scene: &Scene,
    triangles: &[std::ops::Range<u32>],
    state: &SceneState,
    origin: Vec3,
    direction: Vec3,
) -> Option<f64> {
    let mut nearest: Option<f64> = None;
    for instance in &state.instances.instances {
        let [x, y, z] = instance.world_to_object.map(glam::Vec4::from_array);
        let apply = |v: Vec3, w: f32| Vec3::new(x.dot(v.extend(w)), y.dot(v.extend(w)), z.dot(v.extend(w)));
        for triangle in triangles[instance.id as usize - 1].clone() {
            let hit = hit_triangle(&scene.packed, triangle as usize, apply(origin, 1.0), apply(direction, 0.0));
            nearest = [nearest, hit].into_iter().flatten().reduce(f64::min);
        }
    }
    nearest
}

fn vector(range: f32) -> impl Strategy<Value = Vec3> {
    let component = -range..range;
    (component.clone(), component.clone(), component).prop_map(|(x, y, z)| Vec3::new(x, y, z))
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(60))]

    #[test]
    fn closest_hits_equal_brute_force(
        soups in prop::collection::vec(prop::collection::vec((vector(2.0), vector(0.5), vector(0.5)), 1..60), 1..12),
        placements in prop::collection::vec((vector(3.0), vector(180.0), vector(2.0)), 12),
        rays in prop::collection::vec((vector(6.0), vector(1.0)), 40),
    ) {
        let mut objects = Vec::new();
        for (soup_corners, (translation, angles, scale)) in soups.iter().zip(&placements) {
            let corners: Vec<_> = soup_corners.iter().map(|(a, b, c)| [*a, *a + *b, *a + *c]).collect();
            let [x, y, z] = angles.to_array().map(f32::to_radians);
            let rotation = Quat::from_euler(EulerRot::XYZ, x, y, z);
            let scale = scale.signum() * (scale.abs() + 0.2);
            objects.push(object(soup(&corners), Transform { translation: *translation, rotation, scale }));
        }
        let scene = assemble(objects);
        let state = scene.at(0.0, 0.0);
        bvh::check(&scene.packed).expect("valid");
        bvh::check_top(&scene.packed, &state.instances).expect("valid");
        let mut first = 0;
        let ranges: Vec<_> = soups.iter().map(|soup| { let range = first..first + soup.len() as u32; first = range.end; range }).collect();
        prop_assert_eq!(scene.packed.triangles.len(), first as usize);
        for (origin, direction) in rays.into_iter().filter(|(_, direction)| direction.length() > 0.01) {
            let found = trace(&scene, &state, origin, direction).map(|(t, ..)| t);
            prop_assert_eq!(found, brute_force(&scene, &ranges, &state, origin, direction));
        }
    }
}

#[test]
fn axis_parallel_rays_hit_flat_shapes() {
    let scene = assemble(vec![object(Shape::Plane.mesh(Vec3::ONE), Transform::IDENTITY)]);
    let state = scene.at(0.0, 0.0);
    let hit = trace(&scene, &state, Vec3::new(0.2, 3.0, 0.1), Vec3::NEG_Y).expect("a hit");
    assert!((hit.0 - 3.0).abs() < 1e-6 && hit.1 == 1);
    assert!(trace(&scene, &state, Vec3::new(0.6, 3.0, 0.1), Vec3::NEG_Y).is_none());
}

#[test]
fn trees_of_the_nastiest_meshes_are_whole() {
    // Triangles shrinking towards a point: a greedy heuristic peels them off one by one.
    let nested: Vec<_> = (0..3000)
        .map(|i| {
            let size = 0.99_f32.powi(i);
            [Vec3::ZERO, Vec3::X * size, Vec3::Y * size].map(|v| v + Vec3::splat(size))
        })
        .collect();
    let same = vec![[Vec3::ZERO, Vec3::X, Vec3::Y]; 3000];
    let line: Vec<_> =
        (0..3000).map(|i| [Vec3::ZERO, Vec3::X, Vec3::Y].map(|v| v + Vec3::X * (i as f32).powi(2))).collect();
    for corners in [nested, same, line] {
        let scene = assemble(vec![object(soup(&corners), Transform::IDENTITY)]);
        bvh::check(&scene.packed).expect("valid");
        assert_eq!(scene.packed.triangles.len(), 3000);
    }
}

#[test]
fn the_top_level_holds_every_instance_once() {
    for count in [1, 2, 3, 100, 1000] {
        let model = Arc::new(Model::from_mesh(Shape::Box.mesh(Vec3::ONE), Material::default()));
        let at = |i: i32| Transform { translation: Vec3::X * (i as f32).powi(3), ..Transform::IDENTITY };
        let objects = (0..count).map(|i| Object {
            name: format!("{i}"),
            model: model.clone(),
            placement: Placement::fixed(at(i)),
            clip: None,
            speed: 1.0,
        });
        let scene = assemble(objects.collect());
        assert_eq!(scene.packed.triangles.len(), 12, "one mesh is packed once");
        let state = scene.at(0.0, 0.0);
        assert_eq!(state.instances.instances.len(), count as usize);
        bvh::check_top(&scene.packed, &state.instances).expect("valid");
    }
}

#[test]
fn the_check_finds_broken_trees() {
    let scene = assemble(vec![object(Shape::Sphere.mesh(Vec3::ONE), Transform::IDENTITY)]);
    let broken = |change: &dyn Fn(&mut PackedScene)| {
        let mut packed = PackedScene::clone(&scene.packed);
        change(&mut packed);
        bvh::check(&packed).expect_err("broken").to_string()
    };
    bvh::check(&scene.packed).expect("valid");
    let inner = 1 + scene.packed.nodes[1..].iter().position(|node| node.leaf == 0).expect("an inner node");
    let leaf = scene.packed.nodes.iter().position(|node| node.leaf > 0).expect("a leaf");
    assert!(broken(&|p| p.nodes[inner].next = 0).contains("goes back"), "a cycle");
    assert!(broken(&|p| p.nodes[inner].next = 1 << 20).contains("not there"));
    assert!(broken(&|p| p.nodes.truncate(inner + 1)).contains("not there"));
    assert!(broken(&|p| p.nodes[leaf].leaf += 8).contains("triangle"));
    assert!(broken(&|p| p.nodes[leaf].max = p.nodes[leaf].min).contains("outside"));
    assert!(broken(&|p| p.triangles[7].v0 += 10.0).contains("outside"));
    assert!(broken(&|p| p.nodes[leaf].leaf |= 7).contains("a leaf of 7"));
}

#[test]
fn degenerate_triangles_are_left_out_with_a_warning_and_flat_instances_are_drawn() {
    let corners = [[Vec3::ZERO, Vec3::X, Vec3::Y], [Vec3::ZERO, Vec3::X, Vec3::X * 2.0], [Vec3::ONE; 3]];
    let flat = Transform { scale: Vec3::new(1.0, 0.0, 1.0), ..Transform::IDENTITY };
    let line = Transform { scale: Vec3::new(1.0, 0.0, 0.0), ..Transform::IDENTITY };
    let boxed = |transform| object(Shape::Box.mesh(Vec3::ONE), transform);
    let scene = assemble(vec![object(soup(&corners), Transform::IDENTITY), boxed(flat), boxed(line)]);
    assert_eq!(scene.packed.triangles.len(), 1 + 12 + 12);
    assert!(scene.warnings.iter().any(|w| w.contains("2 triangles without area")), "{:?}", scene.warnings);
    assert!(scene.warnings.iter().any(|w| w.contains("flattened to a line")), "{:?}", scene.warnings);
    let state = scene.at(0.0, 0.0);
    assert_eq!(state.instances.instances.iter().map(|i| i.id).collect::<Vec<_>>(), [1, 2]);
    assert_eq!(scene.object_name(2), Some("o"));
}

#[test]
fn matrices_are_rows_and_inverses() {
    let transform = Transform {
        translation: Vec3::new(1.0, 2.0, 3.0),
        rotation: Quat::from_rotation_z(std::f32::consts::FRAC_PI_2),
        scale: Vec3::new(2.0, 3.0, 4.0),
    };
    let scene = assemble(vec![object(Shape::Box.mesh(Vec3::ONE), transform)]);
    let instance = scene.at(0.0, 0.0).instances.instances[0];
    let expected = [[0.0, -3.0, 0.0, 1.0], [2.0, 0.0, 0.0, 2.0], [0.0, 0.0, 4.0, 3.0]];
    for (row, expected) in instance.object_to_world.iter().zip(expected) {
        assert!(row.iter().zip(expected).all(|(a, b)| (a - b).abs() < 1e-5), "{row:?}");
    }
    let affine = |rows: [[f32; 4]; 3]| {
        let column = |i: usize| Vec3::new(rows[0][i], rows[1][i], rows[2][i]);
        Affine3A::from_cols(column(0).into(), column(1).into(), column(2).into(), column(3).into())
    };
    let product = affine(instance.object_to_world) * affine(instance.world_to_object);
    assert!(product.abs_diff_eq(Affine3A::IDENTITY, 1e-5));
}
