//! Scene truth against closed forms, and the captured panorama against the room it was taken in.

use crate::common::{close, mean, object, open, sampled};
use glam::{Quat, Vec3, vec3};
use iprt::{
    gpu::Gpu,
    reference::{
        capture::{COLOR_FILE, CaptureSettings, capture, capture_cached},
        path_trace::{LightSampling, PathSettings, PathTracer, Sums},
    },
    scene::{
        CompleteScene, Object, Scene,
        animation::{Placement, Transform},
        camera::CameraTrack,
        file::RenderSettings,
        material::Material,
        model::Model,
        shapes::Shape,
        viewpoint::Viewpoint,
    },
};
use std::sync::Arc;

fn lambert(albedo: f32, emissive: f32) -> Material {
    let material = Material::plain("lambert", Vec3::splat(albedo), 1.0);
    Material { specular: 0.0, emissive: Vec3::splat(emissive), ..material }
}

fn trace(gpu: &Gpu, objects: Vec<Object>, viewpoint: &Viewpoint, settings: &PathSettings, samples: u32) -> Sums {
    let panorama = iprt::panorama::source::PanoramaSource::from_frames(
        vec![iprt::panorama::source::PanoramaFrame {
            color_size: [1, 1],
            radiance: vec![[0.0; 4]].into(),
            depth_size: [1, 1],
            depth: vec![0.0],
            ..Default::default()
        }],
        30.0,
        Vec3::ZERO,
        0.0,
    )
    .expect("one texel");
    let camera = CameraTrack::at_point(Vec3::ZERO);
    let scene = Scene::assemble("test", panorama, camera, objects, RenderSettings::default()).expect("a good scene");
    let state = scene.at(0.0, 0.0);
    let tracer = PathTracer::new(gpu, &scene.packed, &state.instances, Vec3::ZERO, viewpoint, settings).expect("fits");
    sampled(tracer, samples)
}

const SMALL: PathSettings =
    PathSettings { size: [32, 16], seed: 3, bounces: 64, roulette: 2, sampling: LightSampling::Mis };

#[test]
fn white_furnace() {
    let gpu = open();
    let view = Viewpoint::equirect(vec3(0.1, 0.2, -0.1), Quat::IDENTITY);
    // All walls shine with 1 and reflect half: L = 1 / (1 − ½).
    let walls = || object(Shape::Box.mesh(vec3(3.0, 2.0, 4.0)), lambert(0.5, 1.0), Vec3::ZERO);
    let sums = trace(&gpu, vec![walls()], &view, &SMALL, 64);
    assert!((mean(&sums) - 2.0).abs() < 0.01, "{}", mean(&sums));
    // In a black furnace of radiance 1 whatever absorbs nothing shows 1 too, whichever way its lobes are sampled.
    for (metallic, roughness) in [(1.0, 0.0), (1.0, 0.2), (1.0, 0.6), (0.0, 0.3)] {
        let walls = object(Shape::Box.mesh(Vec3::splat(4.0)), lambert(0.0, 1.0), Vec3::ZERO);
        let white = Material { metallic, ..Material::plain("white", Vec3::ONE, roughness) };
        let ball = object(Shape::Sphere.mesh(Vec3::ONE), white, vec3(0.0, 0.0, -1.2));
        let view = Viewpoint::perspective(Vec3::ZERO, Quat::IDENTITY, 30.0, [16, 16]);
        let sums = trace(&gpu, vec![walls, ball], &view, &PathSettings { size: [16, 16], ..SMALL }, 64);
        assert!((mean(&sums) - 1.0).abs() < 0.02, "metallic {metallic}, roughness {roughness}: {}", mean(&sums));
    }
    close(gpu);
}

/// Every lobe and layer, at every roughness and from straight above to 75 degrees, shows the furnace as it is.
#[test]
fn no_lobe_takes_or_makes_light() {
    let gpu = open();
    const ROUGHNESS: [f32; 5] = [0.0, 0.1, 0.3, 0.5, 1.0];
    let white = |roughness: f32| Material::plain("white", Vec3::ONE, roughness);
    type Make = fn(Material) -> Material;
    let all: [(&str, Make); 9] = [
        ("metal", |white| Material { metallic: 1.0, ..white }),
        ("dielectric", |white| white),
        ("thin sheet", |white| Material { transmission: 1.0, ..white }),
        ("half a thin sheet", |white| Material { transmission: 0.5, ..white }),
        ("solid", |white| Material { transmission: 1.0, thickness: 1.0, ..white }),
        ("coat", |white| Material { clearcoat: 1.0, clearcoat_roughness: white.roughness, ..white }),
        ("sheen", |white| Material { sheen_color: Vec3::ONE, sheen_roughness: white.roughness, ..white }),
        ("film", |white| Material { iridescence: 1.0, ..white }),
        ("coat over sheen over a metal", |white| Material {
            metallic: 1.0,
            clearcoat: 1.0,
            clearcoat_roughness: 0.2,
            sheen_color: Vec3::splat(0.7),
            sheen_roughness: white.roughness,
            ..white
        }),
    ];
    let shown = |material: &dyn Fn(f32) -> Material, degrees: f32, samples: u32| -> Vec<f32> {
        let mut objects = vec![object(Shape::Box.mesh(Vec3::splat(20.0)), lambert(0.0, 1.0), Vec3::ZERO)];
        let turn = Quat::from_rotation_x((90.0 - degrees).to_radians());
        for (column, roughness) in ROUGHNESS.into_iter().enumerate() {
            let at = vec3(column as f32 - 2.0, 0.0, -4.0);
            let mut strip = object(Shape::Plane.mesh(vec3(1.0, 1.0, 6.0)), material(roughness), at);
            strip.placement = Placement::fixed(Transform { translation: at, rotation: turn, scale: Vec3::ONE });
            objects.push(strip);
        }
        // 20 pixels wide, 5 metres at a distance of 4
        let fov = 2.0 * (0.5f32 * 5.0 * 0.2 / 4.0).atan().to_degrees();
        let view = Viewpoint::perspective(Vec3::ZERO, Quat::IDENTITY, fov, [20, 4]);
        let sums = trace(&gpu, objects, &view, &PathSettings { size: [20, 4], ..SMALL }, samples);
        let radiance = sums.radiance();
        let strip = |k: usize| {
            let pixels = || (0..4).flat_map(|y| (1..3).map(move |x| 20 * y + 4 * k + x));
            // What lies under a film gets of every colour what the colour that it reflects most leaves.
            (0..3).map(|c| pixels().map(|p| radiance[p][c]).sum::<f32>() / 8.0).fold(0.0, f32::max)
        };
        (0..ROUGHNESS.len()).map(strip).collect()
    };
    for (name, make) in all {
        for degrees in [10.0, 45.0, 75.0] {
            // Sheen is drawn by the cosine, which is far from its shape.
            let samples = if name.contains("sheen") { 4096 } else { 512 };
            let found = shown(&|roughness| make(white(roughness)), degrees, samples);
            println!("{name}, {degrees}: {found:.4?}");
            assert!(found.iter().all(|mean| (mean - 1.0).abs() < 0.01), "{name} at {degrees} degrees: {found:?}");
        }
    }
    // The strips are seen: what absorbs shows less.
    let grey =
        shown(&|roughness| Material { base_color: Vec3::splat(0.5), metallic: 1.0, ..white(roughness) }, 10.0, 64);
    assert!(grey.iter().all(|mean| *mean < 0.7), "{grey:?}");
    close(gpu);
}

#[test]
fn direct_light_of_a_square() {
    let gpu = open();
    // Straight below the middle of a square lamp of side 2a at height h: E = 4 · L · (A/√(1+A²)) · atan(A/√(1+A²)), A = a/h.
    for side in [2.0f32, 0.02] {
        let radiance = 4.0 / (side * side);
        let floor = object(Shape::Plane.mesh(vec3(20.0, 1.0, 20.0)), lambert(0.8, 0.0), vec3(0.0, -1.0, 0.0));
        let lamp = object(Shape::Plane.mesh(vec3(side, 1.0, side)), lambert(0.0, radiance), vec3(0.0, 1.0, 0.0));
        let a = 0.5 * side / 2.0;
        let s = a / (1.0 + a * a).sqrt();
        let expected = 0.8 / std::f32::consts::PI * radiance * 4.0 * s * s.atan();
        let down = Quat::from_rotation_x(-std::f32::consts::FRAC_PI_2);
        let view = Viewpoint::perspective(vec3(0.0, -0.5, 0.0), down, 1.0, [8, 8]);
        let settings = PathSettings { size: [8, 8], bounces: 1, ..SMALL };
        let found = mean(&trace(&gpu, vec![floor, lamp], &view, &settings, 64));
        assert!((found / expected - 1.0).abs() < 0.01, "side {side}: {found} instead of {expected}");
    }
    close(gpu);
}

#[test]
fn a_lamp_in_a_rough_mirror_is_the_same_by_both_ways_of_sampling() {
    // The reflected lamp's energy does not depend on the number of lamps it is cut into nor on a decoy that takes most of
    // the light samples; both only shift weight between light and lobe sampling.
    let gpu = open();
    let picture = |decoy: bool| {
        let mirror = Material { metallic: 1.0, ..Material::plain("metal", Vec3::ONE, 0.35) };
        let floor = object(Shape::Plane.mesh(vec3(6.0, 1.0, 6.0)), mirror, vec3(0.0, -1.0, 0.0));
        let lamp = object(Shape::Sphere.mesh(Vec3::splat(0.6)), lambert(0.0, 5.0), vec3(0.0, 0.3, -2.0));
        let mut objects = vec![floor, lamp];
        if decoy {
            // bright, but behind the floor
            objects.push(object(Shape::Sphere.mesh(Vec3::splat(0.6)), lambert(0.0, 500.0), vec3(0.0, -3.0, 0.0)));
        }
        let view = Viewpoint::perspective(Vec3::ZERO, Quat::from_rotation_x(-0.7), 40.0, [16, 16]);
        mean(&trace(&gpu, objects, &view, &PathSettings { size: [16, 16], bounces: 1, ..SMALL }, 512))
    };
    let (plain, decoy) = (picture(false), picture(true));
    assert!(plain > 0.05 && (plain / decoy - 1.0).abs() < 0.02, "{plain} and {decoy}");
    close(gpu);
}

/// A box room with a shining ceiling.
fn room() -> CompleteScene {
    let mut model = Model::from_mesh(Shape::Box.mesh(vec3(4.0, 2.6, 3.0)), lambert(0.6, 0.0));
    let mut lamp = lambert(0.0, 6.0);
    lamp.name = "lamp".into();
    model.materials.push(lamp);
    let mesh = Arc::make_mut(&mut model.meshes[0]);
    for (triangle, material) in mesh.triangles.iter().zip(&mut mesh.materials) {
        *material = u32::from(triangle.iter().all(|v| mesh.positions[*v as usize].y > 0.0));
    }
    CompleteScene::assemble("room", Arc::new(model), CameraTrack::at_point(Vec3::ZERO), Vec::new())
        .expect("a good room")
}

#[test]
fn captured_depth_is_the_distance_and_the_cache_mends_itself() {
    let gpu = open();
    let settings = CaptureSettings { size: [64, 32], samples: 4, progress: false, ..Default::default() };
    let position = vec3(0.5, -0.2, 0.3);
    let frame = capture(&gpu, &room(), 0.0, position, &settings).expect("captures");
    for (i, depth) in frame.depth.iter().enumerate() {
        let d = iprt::panorama::mapping::texel_direction(i as u32 % 64, i as u32 / 64, [64, 32]).as_vec3();
        let to_walls = (vec3(2.0, 1.3, 1.5) - position * d.signum()) / d.abs();
        assert!((depth / to_walls.min_element() - 1.0).abs() < 1e-4, "texel {i}: {depth}");
    }
    assert!((frame.radiance.at(32)[1] - 6.0).abs() < 1e-4, "the lamp above is seen as it is");

    let cache = tempfile::tempdir().expect("a folder");
    let cached = || capture_cached(&gpu, &room(), position, &settings, Some(cache.path())).expect("captures");
    let first = cached();
    assert_eq!(first.radiance, frame.radiance, "same seed, same bits");
    let folder = cache.path().read_dir().expect("written").next().expect("one capture").expect("readable").path();
    let color = folder.join(COLOR_FILE);
    let (good, written) = (std::fs::read(&color).expect("there"), color.metadata().expect("there").modified().ok());
    assert_eq!((cached().radiance, cached().depth), (first.radiance.clone(), first.depth.clone()));
    assert_eq!(color.metadata().expect("there").modified().ok(), written, "read, not captured again");
    for damage in [&good[..good.len() / 2], &[]] {
        std::fs::write(&color, damage).expect("writable");
        assert_eq!(cached().radiance, first.radiance);
        assert_eq!(std::fs::read(&color).expect("there"), good);
    }
    close(gpu);
}
