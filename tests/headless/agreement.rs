//! `check` refuses what `render` refuses, and nothing else: scenes are made at random, of good and bad values.

use crate::folder::Folder;
use iprt::{
    gpu::{Gpu, GpuOptions},
    inspect::examine,
    options::RenderOptions,
    renderer::Renderer,
    scene::Scene,
};
use std::fmt::Write as _;

/// Values of a key, of which the first are good.
struct Key {
    name: &'static str,
    good: &'static [&'static str],
    bad: &'static [&'static str],
}

const fn key(name: &'static str, good: &'static [&'static str], bad: &'static [&'static str]) -> Key {
    Key { name, good, bad }
}

const PANORAMA: [Key; 8] = [
    key("yaw", &["0", "-90", "1e6"], &["1e300", "nan", "\"left\""]),
    key("position", &["[0, 0, 0]", "[1, 1.5, -1]"], &["[0, 1e39, 0]", "[0, 0]"]),
    key("exposure", &["1", "0.001", "100"], &["0", "-1", "1e-300", "inf"]),
    key("scale", &["1", "0.01", "-1"], &["0", "1e200"]),
    key("offset", &["0", "1"], &["1e80"]),
    key("encoding", &["\"radial\"", "\"planar\"", "\"disparity\""], &["\"sideways\""]),
    key("invalid", &["[]", "[0, 255]", "[3.4e38]"], &["[inf]", "3"]),
    key("inverse_tonemap", &["1", "8"], &["0.5", "1e9"]),
];
const CAMERA: [Key; 5] = [
    key("position", &["[0, 0, 0]", "[0.3, 0.1, 0.2]"], &["[1e50, 0, 0]"]),
    key("yaw", &["0", "720", "1e9"], &["1e40", "inf"]),
    key("pitch", &["0", "90", "-90", "1e5"], &["-1e300"]),
    key("fov_y", &["60", "1", "179"], &["0", "180", "-60"]),
    key("size", &["[8, 8]", "[1, 1]", "[9, 7]"], &["[0, 8]", "[20000, 8]"]),
];
const OBJECT: [Key; 7] = [
    key("size", &["0.3", "[0.1, 0.2, 0.3]", "[1e-6, 1, 1]"], &["0", "-1", "[1, 0, 1]", "1e40"]),
    key("translation", &["[0, 0, -1]", "[0, 0, 0]", "[1e6, 0, 0]"], &["[0, 1e300, 0]", "[nan, 0, 0]"]),
    key("rotation", &["[0, 30, 0]", "[0, 0, 0, 1]", "[1e6, 0, 0]"], &["[0, 0, 0, 0]", "[1, 2]", "[0, 1e39, 0]"]),
    key("scale", &["1", "[1, 2, 0.5]", "-1", "1e-6"], &["0", "1e300", "1e-300"]),
    key(
        "material",
        &["{ metallic = 1, roughness = 0 }", "{ emissive = [5, 5, 5] }", "{ ior = 1 }"],
        &["{ ior = 0 }", "{ emissive = [1e300, 0, 0] }", "{ roughness = 2 }"],
    ),
    key(
        "key",
        &["[{ time = 0, translation = [0, 0, -1] }, { time = 1, translation = [1, 0, -1] }]"],
        &["[{ translation = [0, 0, -1] }]", "[{ time = 0, scale = 0 }]"],
    ),
    key("name", &["\"thing\"", "\"\""], &["3"]),
];
const RENDER: [Key; 3] = [
    key("method", &["\"iprt\"", "\"paper\"", "\"ibl\"", "\"reference\""], &["\"magic\""]),
    key("exposure", &["1", "1e-6", "1e6"], &["0", "1e300", "1e-300"]),
    key(
        "set",
        &[
            "{ atrous_levels = 0 }",
            "{ relight_levels = 0, history = 4 }",
            "{ thickness = \"inf\" }",
            "{ specular = \"on\" }",
        ],
        &["{ nonsense = 1 }", "{ history = -1 }", "{ specular = \"perhaps\" }", "[1]"],
    ),
];

fn table(text: &mut String, random: &mut fastrand::Rng, head: &str, keys: &[Key], badness: f64) {
    let _ = writeln!(text, "{head}");
    for key in keys {
        if random.f64() < 0.4 {
            let values = if random.f64() < badness { key.bad } else { key.good };
            let _ = writeln!(text, "{} = {}", key.name, values[random.usize(..values.len())]);
        }
    }
}

fn scene(random: &mut fastrand::Rng) -> String {
    let badness = [0.0, 0.0, 0.05, 0.2][random.usize(..4)];
    let mut text = "[panorama]\ncolor = \"room.png\"\n".to_owned();
    text += ["depth = 3\n", "depth = \"depth.png\"\n", "depth = { box = [6, 5, 6] }\n"][random.usize(..3)];
    table(&mut text, random, "", &PANORAMA, badness);
    table(&mut text, random, "[camera]", &CAMERA, badness);
    for _ in 0..random.usize(..3) {
        let head = ["[[object]]\nshape = \"sphere\"", "[[object]]\nshape = \"box\""][random.usize(..2)];
        table(&mut text, random, head, &OBJECT, badness);
    }
    table(&mut text, random, "[render]", &RENDER, badness);
    text
}

#[test]
fn check_and_render_agree() {
    let folder = Folder::empty();
    let texel = |x: u32, y: u32| image::Rgb([(x * 8) as u8, (y * 16) as u8, 77]);
    image::RgbImage::from_fn(32, 16, texel).save(folder.path("room.png")).expect("writes");
    image::GrayImage::from_fn(32, 16, |x, y| image::Luma([(x + y + 9) as u8]))
        .save(folder.path("depth.png"))
        .expect("writes");
    let mut counts = [0, 0];
    let gpu = Gpu::new(&GpuOptions { device: std::env::var("IPRT_DEVICE").ok(), ..GpuOptions::default() });
    let gpu = gpu.expect("a device");
    for seed in 0..30 {
        let text = scene(&mut fastrand::Rng::with_seed(seed));
        folder.write("scene.toml", &text);
        let path = folder.path("scene.toml");
        let problems = examine(&path).problems;
        let rendered = Scene::load(&path).and_then(|scene| {
            let options = RenderOptions { size: [8, 8], ..RenderOptions::of(&scene)? };
            let mut renderer = Renderer::new(&gpu, &scene, options)?;
            renderer.render(&scene, 0.0)?;
            renderer.picture()
        });
        match &rendered {
            Ok(picture) => {
                assert!(problems.is_empty(), "seed {seed}: only check refuses: {problems:?}\n{text}");
                let finite = picture.iter().flatten().all(|value| value.is_finite());
                assert!(finite, "seed {seed}: the picture is not finite\n{text}");
            }
            Err(error) => assert!(!problems.is_empty(), "seed {seed}: only render refuses: {error}\n{text}"),
        }
        counts[usize::from(rendered.is_ok())] += 1;
    }
    assert!(counts.iter().all(|count| *count >= 6), "both kinds are tried: {counts:?}");
}

#[test]
fn every_setting_that_is_wrong_is_reported_with_its_nearest() {
    let folder = Folder::empty();
    image::RgbImage::new(8, 4).save(folder.path("room.png")).expect("writes");
    folder.write(
        "scene.toml",
        "[panorama]\ncolor = \"room.png\"\ndepth = 3\nyaw = 1e300\n[render]\nset = { histor = 1, clam = 2 }\n",
    );
    let output = folder.run("check scene.toml");
    let stderr = String::from_utf8_lossy(&output.stderr);
    assert_eq!(output.status.code(), Some(2), "{stderr}");
    for words in [["panorama.yaw", "1e300"], ["histor", "\"history\""], ["clam", "\"clamp\""]] {
        assert!(stderr.lines().any(|line| words.iter().all(|word| line.contains(word))), "{words:?}: {stderr}");
    }
}
