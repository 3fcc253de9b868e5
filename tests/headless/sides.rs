//! Materials of one side: the camera passes their backs, and no other ray does.

use crate::common::*;
use glam::{Quat, Vec3, vec3};
use iprt::{
    gpu::Gpu,
    plan::{Part, Plan},
    reference::path_trace::{LightSampling, PathSettings, PathTracer},
    scene::{
        CompleteScene, Object,
        animation::{Placement, Transform},
        camera::CameraTrack,
        gltf::{self, export::to_glb},
        material::{Alpha, Material},
        model::{Local, Model},
        shapes::Shape,
        viewpoint::Viewpoint,
    },
    settings::Method,
};
use std::sync::Arc;

const SPOT: Vec3 = vec3(0.0, -1.0, -1.5);

/// A sheet between the camera and the floor.
#[derive(Clone, Copy, Debug, PartialEq)]
struct Sheet {
    one_sided: bool,
    /// Its back is above.
    turned: bool,
    mirrored: bool,
    alpha: f32,
}

impl Sheet {
    fn object(self) -> Object {
        let mut mesh = Shape::Plane.mesh(vec3(0.8, 1.0, 0.8));
        if self.turned {
            mesh.triangles.iter_mut().for_each(|triangle| triangle.swap(1, 2));
            mesh.normals.iter_mut().for_each(|normal| *normal = -*normal);
        }
        let alpha_mode = if self.alpha < 1.0 { Alpha::Blend } else { Alpha::Opaque };
        let material = Material { one_sided: self.one_sided, alpha: self.alpha, alpha_mode, ..lambert(0.1) };
        let scale = if self.mirrored { vec3(-1.0, 1.0, 1.0) } else { Vec3::ONE };
        let at = Transform { translation: SPOT, scale, ..Transform::IDENTITY };
        Object { placement: Placement::fixed(at), ..object(mesh, material, SPOT) }
    }

    fn is_seen(self) -> bool {
        !(self.one_sided && self.turned)
    }
}

fn sheets() -> Vec<Sheet> {
    let mut all = Vec::new();
    for one_sided in [false, true] {
        for turned in [false, true] {
            for (mirrored, alpha) in [(false, 1.0), (true, 1.0), (false, 0.6)] {
                all.push(Sheet { one_sided, turned, mirrored, alpha });
            }
        }
    }
    all
}

/// M and radiance of the sheet's middle, and the radiance of the floor beside its image.
fn shown(gpu: &Gpu, sheet: Sheet) -> [f32; 3] {
    let scene = scene(floor(), camera(Vec3::ZERO, SPOT, 50.0), vec![sheet.object()]);
    let renderer = rendered(gpu, &scene, converged(Method::Iprt, &[("relight_levels", "0")]), 24);
    let (coverage, picture) = (aov(&renderer, "real_coverage"), aov(&renderer, "radiance"));
    let mean = |pixels: &[[usize; 2]]| {
        pixels.iter().map(|[x, y]| picture[y * SIZE[0] as usize + x][1]).sum::<f32>() / pixels.len() as f32
    };
    let block = |x: usize, y: usize| (0..16).map(|k| [x + k % 4, y + k / 4]).collect::<Vec<_>>();
    [coverage[24 * 64 + 32][0], mean(&block(30, 22)), mean(&block(30, 44))]
}

#[test]
fn the_camera_passes_backs_of_what_has_one_side_and_light_does_not() {
    validated(|gpu| {
        let mut known = Vec::new();
        for sheet in sheets() {
            let [real, middle, below] = shown(gpu, sheet);
            println!("{sheet:?}: M {real}, {middle}, below {below}");
            let expected = if sheet.is_seen() { 1.0 - sheet.alpha } else { 1.0 };
            assert!((real - expected).abs() < 1e-3, "{sheet:?}: M is {real}");
            // Its shadow lies behind it, seen or not. The floor is 1.
            if !sheet.is_seen() {
                assert!(middle > 0.3 && middle < 0.97, "{sheet:?}: the floor in its shadow is {middle}");
            }
            assert!(below < 0.98, "{sheet:?}: beside it the floor is {below}");
            // Beside it nothing tells how many sides it has.
            let two_sided = Sheet { one_sided: false, ..sheet };
            known.push((sheet, below));
            let other = known.iter().find(|(other, _)| *other == two_sided).expect("it came first");
            assert_eq!(other.1, below, "{sheet:?}");
        }
    });
}

#[test]
fn scene_truth_sees_the_same_sides() {
    validated(|gpu| {
        let settings = PathSettings { size: [16, 16], seed: 1, bounces: 2, roulette: 2, sampling: LightSampling::Mis };
        let view = Viewpoint::perspective(Vec3::ZERO, Quat::from_rotation_x(-1.0), 30.0, [16, 16]);
        // A room whose walls face outwards is seen from within: it is real.
        let mut mesh = Shape::Box.mesh(vec3(6.0, 4.0, 6.0));
        mesh.name = "room".into();
        let walls = Material { one_sided: true, emissive: Vec3::ONE, ..lambert(0.5) };
        let room = Arc::new(Model::from_mesh(mesh, walls));
        let distance = |sheet: Option<Sheet>| {
            let objects = sheet.map(|sheet| {
                let placed = sheet.object();
                let at = Transform { translation: vec3(0.0, -1.0, -0.6), ..placed.placement.at(0.0) };
                Object { placement: Placement::fixed(at), ..placed }
            });
            let camera = CameraTrack::at_point(Vec3::ZERO);
            let scene = CompleteScene::assemble("test", room.clone(), camera, objects.into_iter().collect());
            let scene = scene.expect("a good scene");
            let state = scene.at(0.0);
            let tracer = PathTracer::new(gpu, &scene.packed, &state.instances, Vec3::ZERO, &view, &settings);
            let sums = sampled(tracer.expect("fits"), 1);
            sums.centre[8 * 16 + 8][3]
        };
        let floor = distance(None);
        assert!((floor - 2.0 / 1f32.sin()).abs() < 0.1, "the room's floor is {floor} m away");
        for sheet in sheets().into_iter().filter(|sheet| sheet.alpha == 1.0) {
            let expected = if sheet.is_seen() { 0.5 * floor } else { floor };
            let found = distance(Some(sheet));
            assert!((found - expected).abs() < 0.01, "{sheet:?}: {found} instead of {expected}");
        }
    });
}

#[test]
fn files_say_which_sides_there_are() {
    let folder = tempfile::tempdir().expect("a folder");
    for (one_sided, mirrored) in [(false, false), (true, false), (true, true)] {
        let path = folder.path().join("sheet.glb");
        let sheet = Sheet { one_sided, turned: false, mirrored, alpha: 1.0 }.object();
        let mut model = Model::clone(&sheet.model);
        if mirrored {
            let scale = vec3(-1.0, 1.0, 1.0);
            model.rig.nodes[0].local = Local::Transform(Transform { scale, ..Transform::IDENTITY });
        }
        std::fs::write(&path, to_glb(&model).expect("a model")).expect("written");
        let (read, warnings) = gltf::load(&path).expect("loads");
        assert!(warnings.is_empty(), "{warnings:?}");
        assert_eq!(read.materials[0].one_sided, one_sided);
        if mirrored {
            validated(|gpu| {
                let placed =
                    Object { model: Arc::new(read.clone()), ..object(Shape::Box.mesh(Vec3::ONE), lambert(0.1), SPOT) };
                let scene = scene(floor(), camera(Vec3::ZERO, SPOT, 50.0), vec![placed]);
                let renderer = rendered(gpu, &scene, options(Method::Iprt, &[]), 1);
                assert_eq!(aov(&renderer, "real_coverage")[24 * 64 + 32][0], 0.0, "a mirrored node keeps its front");
            });
        }
    }
}

/// What is inside out shows its inner side, from which rays meet it again.
#[test]
fn a_box_inside_out_is_not_alone() {
    for (one_sided, turned) in [(false, true), (true, false), (true, true)] {
        let mut mesh = Shape::Box.mesh(Vec3::splat(0.3));
        if turned {
            mesh.triangles.iter_mut().for_each(|triangle| triangle.swap(1, 2));
        }
        let material = Material { one_sided, ..lambert(0.5) };
        let scene = scene(floor(), camera(Vec3::ZERO, SPOT, 50.0), vec![object(mesh, material, vec3(0.0, 0.0, -1.5))]);
        let plan = Plan::of(&scene, &options(Method::Iprt, &[]), None).expect("a plan");
        assert_eq!(plan.on(Part::Bounces), one_sided && turned, "{}", plan.reason(Part::Bounces));
    }
}
