//! Textures are filtered: a pixel shows the mean of what it covers, near and far, and does not shimmer.

use crate::{common::*, mitsuba::data_file};
use glam::{Vec3, vec3};
use iprt::{
    options::RenderOptions,
    renderer::Renderer,
    scene::{
        Object,
        animation::{Placement, Track, Transform},
        camera::{Aim, CameraTrack},
        gltf,
        material::{Material, Slot, TexelEncoding, Texture, TextureUse, Wrap},
        model::Model,
        shapes::Shape,
    },
    settings::Method,
};
use std::sync::Arc;

/// A tile of 8 m that shines in squares of 12.5 cm, 1.2 m below the camera.
fn checkered_tile() -> Object {
    let texel = |i: u32| {
        let (x, y) = (i % 256, i / 256);
        [if (x / 4 + y / 4).is_multiple_of(2) { 255 } else { 0 }, 128, 0, 255]
    };
    let texture = Texture {
        name: "squares".into(),
        size: [256, 256],
        texels: (0..256 * 256).map(texel).collect(),
        encoding: TexelEncoding::Linear,
        wrap: [Wrap::Repeat; 2],
        nearest: false,
    };
    let mut material = Material { emissive: Vec3::ONE, ..lambert(0.0) };
    material.textures[Slot::Emissive as usize] = Some(TextureUse::plain(0));
    let tile = object(Shape::Plane.mesh(vec3(8.0, 0.0, 8.0)), material, vec3(0.0, -1.2, -3.0));
    let model = Model { textures: vec![Arc::new(texture)], ..(*tile.model).clone() };
    Object { model: Arc::new(model), ..tile }
}

/// The camera passes over the tile at a centimetre a frame. Each pixel is held against the mean of the 64 pixels of a picture
/// eight times as fine, and what changes in it from frame to frame against what changes in that mean.
#[test]
fn a_checkered_floor_does_not_shimmer() {
    validated(|gpu| {
        let track = |at: Vec3| Track::from_keys(vec![(0.0, at), (1.0, at + vec3(0.1, 0.0, -0.3))], at);
        let camera = CameraTrack {
            position: track(Vec3::ZERO),
            aim: Aim::LookAt(track(vec3(0.0, -0.6, -2.0))),
            ..camera(Vec3::ZERO, Vec3::NEG_Z, 50.0)
        };
        let room = room([64, 32], vec3(20.0, 8.0, 20.0), Vec3::ZERO, |_| Vec3::splat(0.1));
        let scene = scene(room, camera, vec![checkered_tile()]);
        let size = [64, 48];
        let frames = |fine: u32| -> Vec<(Texels, Texels)> {
            let options = RenderOptions { size: size.map(|s| s * fine), ..options(Method::Iprt, &[]) };
            let mut renderer = Renderer::new(gpu, &scene, options).expect("fits");
            let frame = |n: u32| {
                renderer.render(&scene, f64::from(n) / 30.0).expect("renders");
                (aov(&renderer, "radiance"), aov(&renderer, "real_coverage"))
            };
            (0..4).map(frame).collect()
        };
        let means = |fine: &Texels| -> Vec<f32> {
            let mean = |i: u32| {
                let (x, y) = (i % size[0] * 8, i / size[0] * 8);
                (0..64).map(|k| fine[((y + k / 8) * size[0] * 8 + x + k % 8) as usize][0]).sum::<f32>() / 64.0
            };
            (0..size[0] * size[1]).map(mean).collect()
        };
        let (coarse, fine) = (frames(1), frames(8));
        let (mut error, mut flicker, mut pixels) = (0.0, 0.0, 0.0);
        let mut before: Option<Vec<f32>> = None;
        for ((picture, real), (fine, _)) in coarse.iter().zip(&fine) {
            let off: Vec<f32> = picture.iter().zip(means(fine)).map(|(pixel, mean)| pixel[0] - mean).collect();
            for i in (0..off.len()).filter(|i| real[*i][0] == 0.0) {
                error += off[i].abs();
                flicker += before.as_ref().map_or(0.0, |before| (off[i] - before[i]).abs());
                pixels += 1.0;
            }
            before = Some(off);
        }
        let (error, flicker) = (error / pixels, flicker / pixels * 4.0 / 3.0);
        println!("mean error {error:.4}, flicker {flicker:.4} of contrast 1");
        assert!(pixels > 4000.0, "{pixels}");
        // 0.122 and 0.053 with the nearest level and one probe
        assert!(error < 0.04 && flicker < 0.03, "{error} {flicker}");
    });
}

#[test]
fn a_normal_map_shows_the_ball_that_stands_beside_it() {
    validated(|gpu| {
        // Balls of five rows and three materials, each beside its own normal map, which is turned by something else in each
        // row. The file has no tangents.
        let (model, _) = gltf::load(&data_file("gltf/NormalTangentTest/NormalTangentTest.glb")).expect("loads");
        let object = Object {
            name: "balls".into(),
            model: model.into(),
            placement: Placement::fixed(Transform { translation: vec3(0.0, 0.0, -8.0), ..Transform::IDENTITY }),
            clip: None,
            speed: 1.0,
        };
        let lamp = vec3(0.5, 0.7, 0.5).normalize();
        let radiance = |d: Vec3| Vec3::splat(0.2 + 4.0 * d.dot(lamp).max(0.0).powi(4));
        let panorama = room([128, 64], Vec3::splat(40.0), Vec3::ZERO, radiance);
        let scene = scene(panorama, camera(Vec3::ZERO, vec3(0.0, 0.0, -8.0), 17.0), vec![object]);
        let size = [240, 240];
        let renderer = rendered(gpu, &scene, RenderOptions { size, ..options(Method::Iprt, &[]) }, 12);
        let picture = aov(&renderer, "radiance");
        let metre = 120.0 / (8.0 * 8.5_f32.to_radians().tan());
        let disc = |x: f32, y: f32| -> Vec<f32> {
            let (x, y) = ((120.0 + metre * x) as i32, (120.0 - metre * y) as i32);
            let reach = -4..=4;
            let inside =
                reach.clone().flat_map(|j| reach.clone().map(move |i| (i, j))).filter(|(i, j)| i * i + j * j <= 16);
            inside.map(|(i, j)| picture[((y + j) * 240 + x + i) as usize][1]).collect()
        };
        for (column, row) in (0..15).map(|k| (k % 3, k / 3)) {
            let (x, y) = (-0.96 + 0.8 * column as f32, 0.8 - 0.4 * row as f32);
            let (ball, map) = (disc(x, y), disc(x + 0.32, y));
            let mean = |of: &[f32]| of.iter().sum::<f32>() / of.len() as f32;
            let (a, b) = (mean(&ball), mean(&map));
            let product =
                |f: &[f32], g: &[f32], a: f32, b: f32| f.iter().zip(g).map(|(f, g)| (f - a) * (g - b)).sum::<f32>();
            let alike = product(&ball, &map, a, b) / (product(&ball, &ball, a, a) * product(&map, &map, b, b)).sqrt();
            println!("{column} {row}: {alike} {a} {b}");
            assert!(alike > 0.8, "column {column}, row {row}: {alike}");
        }
    });
}

/// Shining squares of 12.5 cm at 3 m, beside and behind a pane of clear glass without a surface of its own (ior 1), and seen in a
/// mirror: the pictures' contrast from square to square.
#[test]
fn squares_behind_glass_and_in_a_mirror_are_as_sharp_as_they_are() {
    validated(|gpu| {
        let upright = |mut tile: Object, at: Vec3| {
            let turned = glam::Quat::from_rotation_x(std::f32::consts::FRAC_PI_2);
            tile.placement = Placement::fixed(Transform { translation: at, rotation: turned, ..Transform::IDENTITY });
            tile
        };
        let pane = |material: Material| object(Shape::Box.mesh(vec3(4.0, 4.0, 0.01)), material, vec3(0.0, 0.0, -1.5));
        let glass = Material { transmission: 1.0, ior: 1.0, specular: 0.0, ..Material::plain("glass", Vec3::ONE, 0.0) };
        let room = || room([64, 32], vec3(20.0, 8.0, 20.0), Vec3::ZERO, |_| Vec3::splat(0.1));
        let shown = |objects: Vec<Object>| {
            let look = camera(Vec3::ZERO, Vec3::NEG_Z, 40.0);
            let scene = scene(room(), look, objects);
            let options = RenderOptions { size: [48, 48], ..options(Method::Iprt, &[]) };
            aov(&rendered(gpu, &scene, options, 8), "radiance")
        };
        let far = vec3(0.0, 0.0, -3.0);
        let bare = shown(vec![upright(checkered_tile(), far)]);
        let behind = shown(vec![upright(checkered_tile(), far), pane(glass)]);
        // The mirror shows the tile behind the camera at 1.5 m + 1.5 m.
        let mirrored = shown(vec![upright(checkered_tile(), vec3(0.0, 0.0, 1e-3)), pane(metal(0.0))]);
        let deviation = |picture: &Texels| {
            let mean = picture.iter().map(|t| t[0]).sum::<f32>() / picture.len() as f32;
            (picture.iter().map(|t| (t[0] - mean).powi(2)).sum::<f32>() / picture.len() as f32).sqrt()
        };
        let [bare, behind, mirrored] = [bare, behind, mirrored].map(|picture| deviation(&picture));
        println!("{bare} {behind} {mirrored}");
        assert!(bare > 0.35 && behind > 0.9 * bare && mirrored > 0.9 * bare, "{bare}, {behind}, {mirrored}");
    });
}
