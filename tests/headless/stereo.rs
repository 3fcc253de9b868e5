//! Pictures for two eyes.

use crate::{common::*, folder::Folder};
use glam::{Vec3, vec3};
use iprt::{
    gpu::Gpu,
    options::RenderOptions,
    renderer::Renderer,
    scene::{Object, Scene, camera::CameraTrack, viewpoint::Projection},
    settings::Method,
};
use std::f32::consts::{PI, TAU};

const WIDE: [u32; 2] = [512, 256];
const EYE: f32 = 0.0325;

/// Azimuth (to the right), horizontal distance and height of small balls.
const BALLS: [(f32, f32, f32); 5] =
    [(0.0, 1.0, 0.0), (1.6, 1.0, 0.2), (3.0, 0.8, -0.3), (-2.0, 1.2, 0.5), (0.9, 0.2, 1.0)];

fn balls() -> Scene {
    let objects: Vec<Object> = BALLS
        .into_iter()
        .map(|(azimuth, distance, height)| {
            fine_ball(0.06, lambert(0.2), vec3(distance * azimuth.sin(), height, -distance * azimuth.cos()))
        })
        .collect();
    let around = surroundings([256, 128], |_| 4.0, |_| Vec3::ONE);
    scene(around, CameraTrack::at_point(Vec3::ZERO), objects)
}

fn seen_by(gpu: &Gpu, scene: &Scene, eye: f32) -> Renderer {
    let options = RenderOptions { size: WIDE, projection: Projection::Equirect, eye, ..options(Method::Iprt, &[]) };
    rendered(gpu, scene, options, 1)
}

/// Where each ball is seen, in columns.
fn columns(renderer: &Renderer) -> Vec<f32> {
    let [coverage, ids] = ["real_coverage", "object_id"].map(|name| aov(renderer, name));
    (1..=BALLS.len())
        .map(|id| {
            // About the middle that is expected, so that no ball is cut by the seam.
            let middle = (BALLS[id - 1].0 / TAU + 0.5) * WIDE[0] as f32;
            let (mut sum, mut total) = (0.0, 0.0);
            for (k, (coverage, seen)) in coverage.iter().zip(&ids).enumerate() {
                if seen[0] as usize != id {
                    continue;
                }
                let x = (k % WIDE[0] as usize) as f32 + 0.5 - middle;
                let x = x - (x / WIDE[0] as f32).round() * WIDE[0] as f32;
                sum += (1.0 - coverage[0]) * x;
                total += 1.0 - coverage[0];
            }
            assert!(total > 20.0, "ball {id} is seen in {total} pixels");
            sum / total
        })
        .collect()
}

#[test]
fn each_eye_sees_all_around_with_the_other_beside_it() {
    validated(|gpu| {
        let scene = balls();
        let [left, middle, right] = [-EYE, 0.0, EYE].map(|eye| columns(&seen_by(gpu, &scene, eye)));
        for (k, (_, distance, height)) in BALLS.into_iter().enumerate() {
            let latitude = (height / distance).atan().to_degrees();
            let expected = if latitude < 60.0 { (EYE / distance).asin() / TAU * WIDE[0] as f32 } else { 0.0 };
            for (found, expected) in [(left[k], expected), (middle[k], 0.0), (right[k], -expected)] {
                assert!((found - expected).abs() < 0.15, "ball {k}: {found} columns aside, not {expected}");
            }
        }
    });
}

#[test]
fn what_stands_still_is_followed_to_where_it_is() {
    validated(|gpu| {
        let renderer = seen_by(gpu, &balls(), EYE);
        let [motion, position] = ["motion_real", "position_real"].map(|name| aov(&renderer, name));
        for (pixel, (motion, position)) in motion.iter().zip(&position).enumerate() {
            // At the poles a column is next to nothing.
            let latitude = PI * (0.5 - ((pixel / WIDE[0] as usize) as f32 + 0.5) / WIDE[1] as f32);
            let aside = (motion[0] * latitude.cos()).hypot(motion[1]);
            assert!(aside < 0.02, "pixel {pixel} moves by {motion:?}");
            assert!((motion[2] / position[3] - 1.0).abs() < 1e-4, "pixel {pixel}: {motion:?}, {position:?}");
        }
    });
}

#[test]
fn two_eyes_are_written_one_above_the_other() {
    let folder = Folder::with_scene();
    let render = "render scene.toml --warmup 1 -q --size 64x32";
    folder.succeeds(&format!("{render} --stereo 65mm --projection equirect --aov real_coverage -o both.exr"));
    let both = iprt::image_file::read::read(&folder.path("both.exr")).expect("reads");
    let both = both.into_color("both").expect("a picture");
    assert_eq!(both.size, [64, 64]);
    let (left, right) = both.texels.split_at(64 * 32);
    assert!(left.iter().flatten().all(|value| value.is_finite()) && left != right);
    folder.succeeds(&format!("{render} --stereo 0.065 -o flat.png"));
    assert_eq!(image::image_dimensions(folder.path("flat.png")).expect("a PNG"), (64, 64));

    let video = format!("{render} --projection equirect --frames 0..2");
    for name in ["both.mp4", "both.mkv"] {
        folder.succeeds(&format!("{video} --stereo 6.5cm -o {name}"));
        assert!(side_data(&folder, name).contains("top and bottom"), "{name}: {}", side_data(&folder, name));
    }
    folder.succeeds(&format!("{video} --stereo 65mm -o eyes_%d.png"));
    folder.succeeds("join eyes_%d.png -o joined.mp4 --spherical --stereo -q");
    assert!(side_data(&folder, "joined.mp4").contains("top and bottom"));

    folder.fails(&format!("{render} --stereo 65mm --method paper -o a.png"), &["--stereo", "virtual_tracer"]);
    for (command, word) in [
        (format!("{render} --stereo 3m -o a.png"), "1mm to 1m"),
        ("join eyes_%d.png -o joined.mp4 --stereo".to_owned(), "--spherical"),
    ] {
        let output = folder.run(&command);
        let said = String::from_utf8_lossy(&output.stderr);
        assert!(output.status.code() == Some(2) && said.contains(word), "{command}: {said}");
    }
}

/// What ffprobe says of a video's stream beside its pixels.
fn side_data(folder: &Folder, name: &str) -> String {
    let words = ["-v", "error", "-print_format", "json", "-show_streams"];
    let output =
        std::process::Command::new("ffprobe").args(words).arg(folder.path(name)).output().expect("ffprobe runs");
    let probed: serde_json::Value = serde_json::from_slice(&output.stdout).expect("JSON");
    probed["streams"][0]["side_data_list"].to_string()
}
