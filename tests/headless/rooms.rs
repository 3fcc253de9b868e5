//! The built-in rooms as they are captured and exported.

use crate::common::{options, validated};
use glam::Vec3;
use iprt::{
    gpu::Gpu,
    options::RenderOptions,
    panorama::{
        mapping::texel_direction,
        source::{PanoramaFrame, PanoramaSource},
    },
    reference::{
        capture::{CaptureSettings, room_frames},
        path_trace::{LightSampling, PathSettings, PathTracer},
        truth,
    },
    renderer::Renderer,
    scene::{
        CompleteScene, Object, Scene,
        animation::{Placement, Transform},
        camera::CameraTrack,
        export::{Export, ROOM_FILE, SCENE_FILE},
        file::RenderSettings,
        gltf,
        material::Slot,
        rooms::{NAMES, Room, Video, by_name},
        viewpoint::{Projection, Viewpoint},
    },
    settings::Method,
};

fn room(name: &str) -> Room {
    by_name(name).expect("a built-in room")
}

/// Frames of a few texels, not from any cache.
fn small_frames(gpu: &Gpu, room: &mut Room, size: [u32; 2], samples: u32) -> Vec<PanoramaFrame> {
    room.video = room.video.map(|video| Video { size, ..video });
    let settings = CaptureSettings { size, samples, progress: false, ..Default::default() };
    room_frames(gpu, room, &settings, None).expect("captures")
}

/// The room itself as an object, to be path-traced from anywhere.
fn true_scene(room: &Room) -> Scene {
    let clip = (!room.model.rig.clips.is_empty()).then_some(0);
    let object = Object {
        name: room.name.into(),
        model: room.model.clone(),
        placement: Placement::fixed(Transform::IDENTITY),
        clip,
        speed: 1.0,
    };
    let nothing = PanoramaFrame {
        color_size: [2, 1],
        radiance: vec![[0.0; 4]; 2].into(),
        depth_size: [2, 1],
        depth: vec![0.0; 2],
        ..Default::default()
    };
    let panorama = PanoramaSource::from_frames(vec![nothing], 1.0, Vec3::ZERO, 0.0).expect("a panorama");
    let camera = CameraTrack::at_point(room.capture_position);
    Scene::assemble(room.name, panorama, camera, vec![object], RenderSettings::default()).expect("packs")
}

/// Patches of 16×8 texels of each capture against many more samples of other random numbers.
#[test]
fn a_patch_path_traced_again_has_the_captures_values() {
    validated(|gpu| {
        // Mean absolute error of a patch over the mean, at most. Measured: 0.025, 0.072, 0.007.
        for (name, most) in NAMES.into_iter().zip([0.05, 0.10, 0.02]) {
            let mut room = room(name);
            room.video = None;
            let size = [256, 128];
            let frame = &small_frames(gpu, &mut room, size, 12)[0];
            let scene = true_scene(&room);
            let state = scene.at(0.0, 0.0);
            let mut worst = 0.0_f32;
            // A whole panorama again, coarser, whose texels are the patches: its box filter is their mean.
            let (blocks, seed) = ([16, 16], 77);
            let viewpoint = Viewpoint::equirect(Vec3::ZERO, glam::Quat::IDENTITY);
            let path = PathSettings { size: blocks, seed, bounces: 16, roulette: 3, sampling: LightSampling::Mis };
            let mut tracer =
                PathTracer::new(gpu, &scene.packed, &state.instances, room.capture_position, &viewpoint, &path)
                    .expect("fits");
            for _ in 0..2048 {
                tracer.sample().expect("samples");
            }
            let truth = tracer.read().expect("reads").radiance();
            let (mut sum, mut truth_sum, mut error) = (0.0, 0.0, 0.0);
            for (index, truth) in truth.iter().enumerate() {
                let (column, row) = (index as u32 % blocks[0] * 16, index as u32 / blocks[0] * 8);
                let texels = (0..8).flat_map(|y| (0..16).map(move |x| (row + y) * size[0] + column + x));
                let mean = texels.map(|i| Vec3::from_slice(&frame.radiance.at(i as usize))).sum::<Vec3>() / 128.0;
                let truth = Vec3::from_slice(truth);
                (sum, truth_sum) = (sum + mean.y, truth_sum + truth.y);
                error += (mean.y - truth.y).abs();
                worst = worst.max((mean.y - truth.y).abs() / (truth.y + 0.02));
            }
            println!("{name}: mean {:.4}, error {:.4}, worst {worst:.3}", sum / truth_sum, error / truth_sum);
            assert!((sum / truth_sum - 1.0).abs() < 0.04, "{name}: {}", sum / truth_sum);
            assert!(error / truth_sum < most, "{name}: {}", error / truth_sum);
        }
    });
}

/// The middle of each scene truth, objects in it, against a picture of that patch alone: another camera, other random numbers, more samples.
#[test]
fn a_patch_path_traced_again_has_the_truths_values() {
    const SIZE: [u32; 2] = [48, 32];
    validated(|gpu| {
        // Mean absolute difference of 4×4 pixels over the mean, at most. Measured: 0.020, 0.058, 0.009; a pixel off 0.16, 0.38, 0.13.
        for (name, most) in NAMES.into_iter().zip([0.04, 0.10, 0.02]) {
            let room = room(name);
            let scene = CompleteScene::assemble(name, room.model, room.camera, room.objects).expect("a good scene");
            let run = |tracer: &mut PathTracer, samples: u32| -> Vec<f32> {
                (0..samples).for_each(|_| tracer.sample().expect("samples"));
                tracer.read().expect("reads").radiance().iter().map(|texel| texel[1].min(4.0)).collect()
            };
            let mut whole = truth::tracer(gpu, &scene, Projection::Perspective, SIZE, 1, 0).expect("fits");
            let whole = run(&mut whole, 128);

            // half the tangents: the middle half of the rows and columns
            let state = scene.at(0.0);
            let mut narrow = truth::viewpoint(&scene, Projection::Perspective, SIZE, 0);
            narrow.tan_half *= 0.5;
            let path = PathSettings::unbiased(SIZE, 77);
            let mut patch =
                PathTracer::new(gpu, &scene.packed, &state.instances, state.camera.position, &narrow, &path)
                    .expect("fits");
            let patch = run(&mut patch, 256);

            let block = |of: &[f32], [x, y]: [u32; 2], side: u32| {
                let pixels = (0..side).flat_map(|j| (0..side).map(move |i| (y + j) * SIZE[0] + x + i));
                pixels.map(|i| of[i as usize]).sum::<f32>() / (side * side) as f32
            };
            let difference = |shift: u32| {
                let (mut error, mut sum) = (0.0, 0.0);
                for (x, y) in (0..4).flat_map(|y| (0..6).map(move |x| (x, y))) {
                    let truth = block(&patch, [8 * x, 8 * y], 8);
                    let at = [SIZE[0] / 4 + 4 * x + shift, SIZE[1] / 4 + 4 * y];
                    error += (block(&whole, at, 4) - truth).abs();
                    sum += truth;
                }
                error / sum
            };
            println!("{name}: {:.4}, a pixel beside it {:.4}", difference(0), difference(1));
            assert!(
                difference(0) < most && difference(1) > difference(0),
                "{name}: {}, {}",
                difference(0),
                difference(1)
            );
        }
    });
}

#[test]
fn in_the_gallery_the_real_screen_moves() {
    validated(|gpu| {
        let mut room = room("gallery");
        let frames = small_frames(gpu, &mut room, [128, 64], 1);
        assert_eq!(frames.len(), 8);
        let moved = |a: usize, b: usize| {
            let pairs = frames[a].depth.iter().zip(&frames[b].depth);
            pairs.filter(|(a, b)| (**a - **b).abs() > 0.05).count()
        };
        for frame in 1..8 {
            assert_eq!(moved(frame, 8 - frame), 0, "out and back");
        }
        for frame in 0..4 {
            let texels = moved(frame, frame + 1);
            assert!((5..800).contains(&texels), "{texels} texels from {frame} to the next");
        }
        // what is far from it stays
        let behind = |i: usize| texel_direction(i as u32 % 128, i as u32 / 128, [128, 64]).z > 0.5;
        for (i, (a, b)) in frames[0].depth.iter().zip(&frames[3].depth).enumerate().filter(|(i, _)| behind(*i)) {
            assert!((a - b).abs() < 1e-4, "texel {i}: {a} {b}");
        }
    });
}

fn picture(gpu: &Gpu, scene: &Scene, time: f64) -> Vec<[f32; 4]> {
    // Which point of an emitter a random number stands for depends on the order of its triangles.
    let options = RenderOptions { size: [96, 54], seed: 0, ..options(Method::Iprt, &[("emitters", "off")]) };
    let mut renderer = Renderer::new(gpu, scene, options).expect("a renderer");
    for _ in 0..3 {
        renderer.render(scene, time).expect("renders");
    }
    renderer.picture().expect("a picture")
}

#[test]
fn an_exported_room_is_the_same_scene() {
    validated(|gpu| {
        for name in NAMES {
            let mut room = room(name);
            let frames = small_frames(gpu, &mut room, [128, 64], 1);
            let fps = room.video.map_or(30.0, |video| video.fps);
            let folder = tempfile::tempdir().expect("a folder");
            let export = Export::of(&room);
            let target = folder.path().join("out");
            export.prepare(&target).expect("an empty folder");
            let path = export.write(&target, &frames).expect("writes");
            assert_eq!(path, target.join(SCENE_FILE));
            export.prepare(&target).expect("the same scene may be written again");

            let (problems, warnings) = Scene::problems(&path);
            assert!(problems.is_empty() && warnings.is_empty(), "{name}: {problems:?} {warnings:?}");
            let read = Scene::load(&path).expect("loads");
            assert_eq!(read.room, Some(target.join(ROOM_FILE)));
            let panorama = PanoramaSource::from_frames(frames, fps, room.capture_position, 0.0).expect("frames");
            let (camera, objects) = (room.camera.clone(), room.objects.clone());
            let made = Scene::assemble(name, panorama, camera, objects, RenderSettings::default()).expect("packs");
            assert_eq!(read.camera, made.camera, "{name}");
            assert_eq!(read.panorama.frame_count(), made.panorama.frame_count());
            for time in [0.0, 1.5] {
                let (a, b) = (picture(gpu, &read, time), picture(gpu, &made, time));
                let differs =
                    |(a, b): &(&[f32; 4], &[f32; 4])| (0..3).any(|c| (a[c] - b[c]).abs() > 1e-3 * (1.0 + b[c]));
                let count = a.iter().zip(&b).filter(differs).count();
                println!("{name} at {time} s: {count} pixels differ");
                assert!(count <= 26, "{name} at {time} s: {count} of {} pixels differ", a.len());
            }
        }
    });
}

#[test]
fn models_come_back_from_glb_as_they_were() {
    let folder = tempfile::tempdir().expect("a folder");
    for name in NAMES {
        let room = room(name);
        for (file, model) in &Export::of(&room).models {
            let path = folder.path().join(file);
            std::fs::write(&path, gltf::export::to_glb(model).expect("writes")).expect("writable");
            let (read, warnings) = gltf::load(&path).expect("loads");
            assert!(warnings.is_empty(), "{name}: {file}: {warnings:?}");
            assert_eq!(read.rig, model.rig, "{name}: {file}");
            let area = |model: &iprt::scene::model::Model, wanted: &iprt::scene::material::Material| -> f64 {
                let mut sum = 0.0;
                for mesh in &model.meshes {
                    for (triangle, material) in mesh.triangles.iter().zip(&mesh.materials) {
                        let own = &model.materials[*material as usize];
                        if (&own.name, own.base_color, own.emissive)
                            == (&wanted.name, wanted.base_color, wanted.emissive)
                        {
                            let [a, b, c] = triangle.map(|k| mesh.positions[k as usize].as_dvec3());
                            sum += (b - a).cross(c - a).length() * 0.5;
                        }
                    }
                }
                sum
            };
            for material in &read.materials {
                let same = model.materials.iter().find(|other| {
                    (&other.name, other.base_color, other.emissive, other.roughness)
                        == (&material.name, material.base_color, material.emissive, material.roughness)
                });
                let same = same.unwrap_or_else(|| panic!("{name}: {file}: {} is new", material.name));
                assert_eq!(
                    (same.metallic, same.specular, same.ior),
                    (material.metallic, material.specular, material.ior)
                );
                let texels = |model: &iprt::scene::model::Model, material: &iprt::scene::material::Material| {
                    let texture = &model.textures[material.texture(Slot::BaseColor)?.texture];
                    Some((texture.size, texture.texels.clone(), texture.encoding))
                };
                assert_eq!(texels(model, same), texels(&read, material));
                let (a, b) = (area(model, same), area(&read, material));
                assert!((a - b).abs() <= 1e-9 * a, "{name}: {file}: {} covers {a} and {b} m²", material.name);
            }
        }
    }
}

#[test]
fn a_folder_in_use_is_refused() {
    let folder = tempfile::tempdir().expect("a folder");
    let export = Export::of(&room("bedroom"));
    std::fs::write(folder.path().join("notes.txt"), "mine").expect("writable");
    let error = export.prepare(folder.path()).expect_err("holds something else").to_string();
    assert!(error.contains("notes.txt"), "{error}");
    std::fs::remove_file(folder.path().join("notes.txt")).expect("removable");
    export.prepare(folder.path()).expect("empty again");
    std::fs::write(folder.path().join(SCENE_FILE), Export::of(&room("apartment")).scene).expect("writable");
    let error = export.prepare(folder.path()).expect_err("another scene").to_string();
    assert!(error.contains(SCENE_FILE) && error.contains("another scene"), "{error}");
}
