//! Lights without a surface that objects bring, against closed forms: in evenly lit surroundings every surface reflects
//! its albedo times 1 + I·cos θ/(π·d²).

use crate::{common::*, folder::Folder};
use glam::{Vec3, vec2, vec3};
use iprt::{
    gpu::Gpu,
    scene::{
        Object, Scene,
        animation::Transform,
        camera::CameraTrack,
        model::Local,
        punctual::{PunctualKind, PunctualLight},
    },
    settings::Method,
};
use std::{f32::consts::PI, sync::Arc};

const FLOOR: f32 = -1.5;
const LAMP: Vec3 = vec3(0.3, -0.6, -2.0);
const INTENSITY: f32 = 2.0;

fn view() -> CameraTrack {
    camera(Vec3::ZERO, vec3(0.0, FLOOR, -2.0), 50.0)
}

fn floor_with(objects: Vec<Object>) -> Scene {
    let fine = room([512, 256], vec3(16.0, 9.5, 16.0), vec3(0.0, 3.25, 0.0), |_| Vec3::ONE);
    scene(fine, view(), objects)
}

/// The picture's green channel, with light of the first bounce alone.
fn green(gpu: &Gpu, scene: &Scene, method: Method, frames: u32) -> Vec<f32> {
    let renderer = rendered(gpu, scene, options(method, &[("relight_levels", "0"), ("atrous_levels", "0")]), frames);
    aov(&renderer, "radiance").iter().map(|texel| texel[1]).collect()
}

/// Where a pixel of the floor is.
fn place(pixel: usize) -> Vec3 {
    let at = vec2((pixel % SIZE[0] as usize) as f32 + 0.5, (pixel / SIZE[0] as usize) as f32 + 0.5);
    let d = pixel_direction(&view(), 0.0, SIZE, at);
    d * (FLOOR / d.y)
}

/// The pixels of the floor near the lamp, and where they are.
fn near() -> impl Iterator<Item = (usize, Vec3)> {
    let all = (0..(SIZE[0] * SIZE[1]) as usize).map(|pixel| (pixel, place(pixel)));
    all.filter(|(_, x)| x.y < 0.0 && x.distance(LAMP) < 1.5)
}

/// What a point light adds to a white floor.
fn added(x: Vec3) -> f32 {
    let to = LAMP - x;
    INTENSITY * to.y / to.length().powi(3) / PI
}

/// A light of another kind in the same place, that shines down.
fn down(kind: PunctualKind, range: f32) -> Object {
    let mut lamp = light(Vec3::splat(INTENSITY), LAMP);
    let model = Arc::make_mut(&mut lamp.model);
    model.lights = vec![PunctualLight { node: 0, intensity: Vec3::splat(INTENSITY), kind, range }];
    let rotation = glam::Quat::from_rotation_x(-0.5 * PI);
    model.rig.nodes[0].local = Local::Transform(Transform { rotation, ..Transform::IDENTITY });
    lamp
}

#[test]
fn a_light_alone_lights_the_floor_by_its_distance() {
    validated(|gpu| {
        let lit = floor_with(vec![light(Vec3::splat(INTENSITY), LAMP)]);
        for method in Method::ALL {
            let frames = if method == Method::Reference { 8 } else { 1 };
            let picture = green(gpu, &lit, method, frames);
            assert!(near().count() > 1000);
            let mut sum = 0.0;
            for (pixel, x) in near() {
                let (found, expected) = (picture[pixel], 1.0 + added(x));
                let error = (found / expected - 1.0).abs();
                assert!(error < 0.04, "{method:?} {pixel}: {found}, not {expected}");
                sum += error;
            }
            let mean = sum / near().count() as f32;
            assert!(mean < 0.01, "{method:?}: {mean}");
        }
    });
}

#[test]
fn cones_and_ranges_end_where_they_say_and_walls_stop_parallel_light() {
    validated(|gpu| {
        let spot = PunctualKind::Spot { inner: 0.2, outer: 0.5 };
        let cone = green(gpu, &floor_with(vec![down(spot, f32::INFINITY)]), Method::Iprt, 1);
        let faded = green(gpu, &floor_with(vec![down(PunctualKind::Point, 1.2)]), Method::Iprt, 1);
        // The room has a ceiling.
        let parallel = green(gpu, &floor_with(vec![down(PunctualKind::Directional, f32::INFINITY)]), Method::Iprt, 1);
        for (pixel, x) in near() {
            let (d, cosine) = (x.distance(LAMP), (LAMP.y - x.y) / x.distance(LAMP));
            let ramp = ((cosine - 0.5f32.cos()) / (0.2f32.cos() - 0.5f32.cos())).clamp(0.0, 1.0);
            let window = (1.0 - (d / 1.2).powi(4)).clamp(0.0, 1.0);
            for (found, share) in [(cone[pixel], ramp * ramp), (faded[pixel], window), (parallel[pixel], 0.0)] {
                let expected = 1.0 + share * added(x);
                assert!((found / expected - 1.0).abs() < 0.02, "{pixel}: {found}, not {expected}");
            }
        }
    });
}

#[test]
fn objects_are_lit_and_cast_shadows() {
    validated(|gpu| {
        let at = vec3(0.3, -1.1, -2.0); // right below it
        let caster = || ball(0.15, lambert(0.5), at);
        let [with, without] = [vec![caster(), light(Vec3::splat(INTENSITY), LAMP)], vec![caster()]].map(floor_with);
        let renderer = rendered(gpu, &with, options(Method::Reference, &[]), 1);
        let [position, normal] = ["position_virtual", "normal_virtual"].map(|name| aov(&renderer, name));
        drop(renderer);
        let [with, without] = [with, without].map(|scene| green(gpu, &scene, Method::Reference, 64));
        let track = view();
        let pixel = |x: Vec3| {
            let p = project(&track, 0.0, SIZE, x);
            p.y as usize * SIZE[0] as usize + p.x as usize
        };
        // Its shadow is 0.15/0.5·0.9 = 0.27 m wide each way.
        let behind = pixel(vec3(0.3, FLOOR, -2.2));
        assert!((with[behind] - without[behind]).abs() < 0.01, "{} {}", with[behind], without[behind]);
        let aside = pixel(vec3(-0.4, FLOOR, -2.0));
        let brings = with[aside] - without[aside];
        // Some of it comes by way of the ball.
        assert!((brings / added(place(aside)) - 1.0).abs() < 0.06, "{brings}");
        let top = pixel(at + 0.15 * vec3(0.0, 0.6, 0.8));
        let [x, normal] = [&position, &normal].map(|image| Vec3::from_slice(&image[top]));
        let to = LAMP - x;
        let expected = 0.5 * INTENSITY * to.dot(normal) / to.length().powi(3) / PI;
        let found = with[top] - without[top];
        // Some comes by way of the floor.
        assert!((found / expected - 1.0).abs() < 0.06, "{found}, not {expected}");
    });
}

#[test]
fn its_light_moves_with_it() {
    validated(|gpu| {
        let lamp = light(Vec3::splat(INTENSITY), LAMP);
        let moved = floor_with(vec![moving(lamp, LAMP - vec3(0.8, 0.0, 0.0), LAMP)]);
        let mut renderer = rendered(gpu, &moved, options(Method::Iprt, &[("relight_levels", "0")]), 1);
        // It comes to rest in frame 20.
        for frame in 0..=30 {
            renderer.render(&moved, f64::from(frame) / 20.0).expect("renders");
            let picture = aov(&renderer, "radiance");
            let behind = vec3(0.8 * (1.0 - frame as f32 / 20.0).max(0.0), 0.0, 0.0);
            let error = |(pixel, x): (usize, Vec3)| (picture[pixel][1] / (1.0 + added(x + behind)) - 1.0).abs();
            let (mean, largest) = near().map(error).fold((0.0, 0.0f32), |(sum, most), e| (sum + e, most.max(e)));
            let mean = mean / near().count() as f32;
            // measured: 0.005, 0.03; with nothing known of moving lights 0.095, 0.25
            assert!(mean < 0.01 && largest < 0.06, "{frame}: {mean}, {largest}");
        }
    });
}

#[test]
fn a_scene_file_scales_the_lights_of_a_gltf_file() {
    let folder = Folder::empty();
    folder.paint("c.png", |_, _| [90; 3]);
    folder.write(
        "lamp.gltf",
        r#"{ "asset": { "version": "2.0" }, "extensionsUsed": ["KHR_lights_punctual"],
        "extensions": { "KHR_lights_punctual": { "lights": [{ "type": "point", "intensity": 80 }] } },
        "nodes": [{ "extensions": { "KHR_lights_punctual": { "light": 0 } } }], "scenes": [{ "nodes": [0] }] }"#,
    );
    let load = |object: &str| {
        folder.write("scene.toml", &format!("[panorama]\ncolor = 'c.png'\ndepth = 2\n[[object]]\n{object}"));
        Scene::load(&folder.path("scene.toml"))
    };
    let of = |object: &str| {
        let scene = load(object).expect("loads");
        assert_eq!(scene.warnings.is_empty(), scene.light_count() > 0, "{:?}", scene.warnings);
        scene.at(0.0, 0.0).instances.lights.iter().map(|light| light.intensity.x).collect::<Vec<_>>()
    };
    assert_eq!(of("gltf = 'lamp.gltf'"), [80.0]);
    assert_eq!(of("gltf = 'lamp.gltf'\nlight = 0.05"), [4.0]);
    assert!(of("gltf = 'lamp.gltf'\nlight = 0").is_empty());
    for (object, words) in [
        ("gltf = 'lamp.gltf'\nlight = -1", ["object[0].light", "from 0 to 1e6"]),
        ("shape = 'box'\nlight = 2", ["object[0].light", "a shape has no lights"]),
    ] {
        let error = load(object).expect_err("refused").to_string();
        assert!(words.iter().all(|word| error.contains(word)), "{error}");
    }
}
