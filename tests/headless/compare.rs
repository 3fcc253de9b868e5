//! `compare --sequence` as users run it.

use crate::folder::Folder;
use iprt::image_file::{ExrLayer, write::write_exr};
use std::path::Path;

fn json(folder: &Folder, arguments: &str) -> serde_json::Value {
    serde_json::from_str(&folder.succeeds(arguments)).expect("JSON")
}

/// Frames `numbers` of 20×12 pixels; `value` of frame and column.
fn write_frames(folder: &Folder, name: &str, numbers: impl IntoIterator<Item = u32>, value: impl Fn(u32, u32) -> f32) {
    for t in numbers {
        let texels: Vec<_> = (0..20 * 12).map(|i| [value(t, i % 20), value(t, i % 20), 0.2, 1.0]).collect();
        write_exr(&folder.path(&format!("{name}_{t:03}.exr")), &[ExrLayer::rgb("", [20, 12], &texels)])
            .expect("writes");
    }
}

/// A shadow falls on the left half in frame 4.
fn step(t: u32, x: u32) -> f32 {
    if t >= 4 && x < 10 { 0.1 } else { 0.5 }
}

#[test]
fn a_sequence_is_measured_frame_by_frame_and_over_time() {
    let folder = Folder::empty();
    write_frames(&folder, "truth", 2..12, step);
    // two frames late, and too bright in frame 9
    write_frames(&folder, "test", 2..12, |t, x| step(t.saturating_sub(2), x) + if t == 9 { 0.3 } else { 0.0 });
    let command = "compare test_%03d.exr truth_%03d.exr --sequence";
    let report = json(&folder, &format!("{command} --json --diff diff_%d.png"));
    assert_eq!((&report["temporal"]["lag"], &report["motion"]), (&3.into(), &false.into()));
    assert_eq!((&report["worst"]["frame"], report["frames"].as_array().map(Vec::len)), (&9.into(), Some(10)));
    let frames = report["frames"].as_array().expect("an array");
    let flip = |frame: &serde_json::Value| frame["flip"].as_f64().expect("a number");
    let mean = frames.iter().map(flip).sum::<f64>() / 10.0;
    assert!((flip(&report["mean"]) - mean).abs() < 1e-12 && flip(&report["worst"]) > 2.0 * mean, "{report}");
    for (frame, right) in [(2, true), (4, false), (5, false), (6, true)] {
        let entry = frames.iter().find(|entry| entry["frame"] == frame).expect("listed");
        assert_eq!(flip(entry) == 0.0, right, "{entry}");
        assert!(folder.path(&format!("diff_{frame}.png")).exists());
    }
    for key in ["rmse", "relmse", "psnr", "ssim", "flip", "max_abs", "mean_ratio", "pixels"] {
        assert!(report["mean"][key].is_number() && frames[0][key].is_number(), "{key}");
    }
    let over_time = |report: &serde_json::Value, key: &str| report["temporal"][key].as_f64().expect("a number");
    assert!(over_time(&report, "ghost_energy") > 0.1 && over_time(&report, "warped_difference") > 0.01, "{report}");
    assert!(over_time(&report, "flicker") > over_time(&report, "flicker_truth"), "{report}");
    let text = folder.succeeds(command);
    assert!(text.contains("lag 3 frames") && text.contains("worst: frame 9") && text.lines().count() == 3, "{text}");

    // Where the shadow never is, nothing is late; a mask a frame holds in sum what a single one does.
    let mask = |name: &str, inside: fn(u32) -> bool| {
        image::GrayImage::from_fn(20, 12, |x, _| image::Luma([255 * u8::from(inside(x))])).save(folder.path(name))
    };
    mask("right.png", |x| x >= 10).expect("writes");
    (2..12).for_each(|t| mask(&format!("left_{t}.png"), |x| x < 10).expect("writes"));
    let right = json(&folder, &format!("{command} --mask right.png --json"));
    assert_eq!((&right["temporal"]["lag"], &right["frames"][2]["rmse"]), (&serde_json::Value::Null, &0.0.into()));
    let left = json(&folder, &format!("{command} --mask left_%d.png --json"));
    assert_eq!((&left["temporal"]["lag"], &left["frames"][0]["pixels"]), (&3.into(), &120.into()));

    // A truth that stands still is one picture.
    write_frames(&folder, "still", [0], |_, _| 0.5);
    write_frames(&folder, "noisy", 0..6, |t, _| 0.5 + 0.01 * (t % 2) as f32);
    let still = json(&folder, "compare noisy_%03d.exr still_000.exr --sequence --json");
    assert!(over_time(&still, "flicker") > 0.002 && over_time(&still, "flicker_truth") == 0.0, "{still}");
    assert_eq!((over_time(&still, "ghost_energy"), &still["temporal"]["lag"]), (0.0, &serde_json::Value::Null));
}

#[test]
fn motion_of_a_render_makes_what_moves_steady() {
    let folder = Folder::empty();
    folder.paint("room.png", |x, y| [(90.0 + 60.0 * (x as f32 * 0.4).sin()) as u8, (6 * y) as u8, 90]);
    std::fs::write(folder.path("scene.toml"), MOVING).expect("writes");
    for (name, aov) in [("with", "--aov motion,position"), ("without", "")] {
        let frames = "--frames 0..3 --warmup 0 --size 80x60 -q --set relight_levels=0";
        folder.succeeds(&format!("render scene.toml -o {name}_%02d.exr {frames} {aov}"));
    }
    // Against a picture that stands still, all that the warp does not explain counts.
    let measure = |name: &str| {
        let report = json(&folder, &format!("compare {name}_%02d.exr {name}_00.exr --sequence --json"));
        (report["motion"].clone(), report["temporal"]["warped_difference"].as_f64().expect("a number"))
    };
    let ((told, warped), (untold, plain)) = (measure("with"), measure("without"));
    println!("warped difference {warped:.5} with motion vectors, {plain:.5} without");
    assert_eq!((told, untold), (true.into(), false.into()));
    assert!(plain > 0.01 && warped < 0.2 * plain, "{warped} of {plain}");
}

/// The camera turns by six pixels a frame and the ball moves, before a room that stands still.
const MOVING: &str = r#"
[panorama]
color = "room.png"
depth = { box = [4, 3, 5] }
fps = 10
[camera]
fov_y = 60
key = [ { time = 0, yaw = 0 }, { time = 1, yaw = 45 } ]
[[object]]
shape = "sphere"
size = [0.6, 0.6, 0.6]
material = { emissive = [0.1, 0.2, 0.3] }
key = [ { time = 0, translation = [-0.4, -0.2, -1.5] }, { time = 1, translation = [0.8, -0.2, -1.5] } ]
"#;

#[test]
fn what_the_user_got_wrong_is_told_in_one_line() {
    let folder = Folder::empty();
    write_frames(&folder, "a", 0..5, step);
    write_frames(&folder, "short", 0..3, step);
    write_frames(&folder, "gap", [0, 1, 3], step);
    write_frames(&folder, "one", [7], step);
    write_frames(&folder, "nan", 0..5, |t, _| if t == 3 { f32::NAN } else { 0.5 });
    image::GrayImage::new(20, 12).save(folder.path("dark.png")).expect("writes");
    for (arguments, words) in [
        ("a_000.exr a_001.exr", &["a_000.exr", "is one picture", "pattern"][..]),
        ("b_%03d.exr a_%03d.exr", &["b_%03d.exr", "0 frames"]),
        ("one_%03d.exr a_%03d.exr", &["one_%03d.exr", "1 frames", "two"]),
        ("gap_%03d.exr a_%03d.exr", &["gap_002.exr", "is missing"]),
        (
            "a_%03d.exr short_%03d.exr",
            &["a_%03d.exr", "5 frames from 0 to 4", "short_%03d.exr has 3 frames from 0 to 2"],
        ),
        ("a_%03d.exr b_%03d.exr", &["b_%03d.exr has no frames"]),
        ("a_%03d.exr b.exr", &["b.exr", "no such file"]),
        ("a_%03d.exr nan_%03d.exr", &["nan_003.exr", "not finite"]),
        ("a_%03d.exr a_%03d.exr --mask dark.png", &["--mask", "no pixel"]),
        ("a_%03d.exr a_%03d.exr --mask dark_%d.png", &["dark_0.png", "no such file"]),
        ("a_%03d.exr a_%03d.exr --diff diff.png", &["--diff", "pattern"]),
        ("a_%03d.exr a_%03d.exr --exposure 0", &["--exposure", "positive"]),
        ("a_%d_%d.exr a_%03d.exr", &["a_%d_%d.exr", "two frame numbers"]),
    ] {
        folder.fails(&format!("compare --sequence {arguments}"), words);
    }
    assert!(!Path::new(&folder.path("diff.png")).exists());
}
