//! Cubemaps as panoramas, made by `ffmpeg`'s own projections, and depth by the names of what wrote it.

use crate::{folder::Folder, video_in::ffmpeg};
use glam::{Vec3, vec3};
use image::{GenericImage, GenericImageView, ImageBuffer, Luma, Rgb, RgbImage};
use iprt::{
    panorama::{mapping::texel_direction, preset::PRESETS, source::PanoramaFrame},
    scene::Scene,
};
use std::sync::Arc;

const SIZE: [u32; 2] = [512, 256];
const SIDE: u32 = 128;

/// A smooth picture that tells all directions apart, as sRGB codes.
fn paint(d: Vec3) -> [f32; 3] {
    [128.0 + 120.0 * d.x, 128.0 + 120.0 * d.y, 128.0 + 120.0 * d.z]
}

/// Millimetres to the walls of a room of 4 × 3 × 5 m.
fn millimetres(d: Vec3) -> f32 {
    1000.0 * (vec3(2.0, 1.5, 2.5) / d.abs()).min_element()
}

/// A folder with the room as a panorama and as cubemaps of colour and of depth.
fn folder() -> Folder {
    let folder = Folder::empty();
    let direction = |x, y| texel_direction(x, y, SIZE).as_vec3();
    let color = RgbImage::from_fn(SIZE[0], SIZE[1], |x, y| Rgb(paint(direction(x, y)).map(|code| code.round() as u8)));
    color.save(folder.path("panorama.png")).expect("written");
    let depth = ImageBuffer::from_fn(SIZE[0], SIZE[1], |x, y| Luma([millimetres(direction(x, y)) as u16]));
    depth.save(folder.path("panorama_depth.png")).expect("written");
    for kind in ["c6x1", "c3x2", "c1x6"] {
        ffmpeg(&folder, &format!("-i panorama.png -vf v360=e:{kind} {kind}.png"));
        ffmpeg(&folder, &format!("-i panorama_depth.png -vf v360=e:{kind}:interp=near {kind}_depth.png"));
    }
    let strip = image::open(folder.path("c6x1.png")).expect("readable").to_rgb8();
    assert_eq!(strip.dimensions(), (6 * SIDE, SIDE));
    let face = |index: u32| strip.view(index * SIDE, 0, SIDE, SIDE).to_image();
    let [right, left, up, down, front, back] = [0, 1, 2, 3, 4, 5].map(face);
    for (word, face) in ["posx", "negx", "posy", "negy", "posz", "negz"].iter().zip([0, 1, 2, 3, 4, 5].map(face)) {
        face.save(folder.path(&format!("cube_{word}.png"))).expect("written");
    }
    let turned = image::imageops::rotate180(&back);
    let crosses = [("horizontal", [4, 3], [3, 1], &back), ("vertical", [3, 4], [1, 3], &turned)];
    for (name, [columns, rows], at_back, back) in crosses {
        let mut cross = RgbImage::new(columns * SIDE, rows * SIDE);
        let faces =
            [(&right, [2, 1]), (&left, [0, 1]), (&up, [1, 0]), (&down, [1, 2]), (&front, [1, 1]), (back, at_back)];
        for (face, [column, row]) in faces {
            cross.copy_from(face, column * SIDE, row * SIDE).expect("fits");
        }
        cross.save(folder.path(&format!("{name}.png"))).expect("written");
    }
    folder
}

fn load(folder: &Folder, panorama: &str) -> Arc<PanoramaFrame> {
    folder.write("scene.toml", &format!("[panorama]\n{panorama}\n"));
    let scene = Scene::load(&folder.path("scene.toml")).expect("loads");
    scene.panorama.load(0).expect("loads")
}

#[test]
fn cubemaps_show_the_same_room() {
    let folder = folder();
    let linear: Vec<f32> = (0..=255).map(|code| iprt::image_file::srgb::srgb_to_linear(code as f32 / 255.0)).collect();
    let code = |value: f32| linear.partition_point(|known| *known < value) as f32;
    for color in [
        "color = 'c6x1.png'\nlayout = 'cube'\ndepth = 'c6x1_depth.png'",
        "color = 'c1x6.png'\nlayout = 'cube'\ndepth = 'c1x6_depth.png'",
        "color = 'c3x2.png'\nlayout = 'cube'\ndepth = 'c3x2_depth.png'",
        "color = 'horizontal.png'\nlayout = 'cube'\ndepth = 'panorama_depth.png'",
        "color = 'vertical.png'\nlayout = 'cube'\ndepth = 'c6x1_depth.png'",
        "color = 'cube_{face}.png'\ndepth = 'panorama_depth.png'",
    ] {
        let frame = load(&folder, &format!("{color}\nscale = 0.001"));
        assert_eq!((frame.color_size, frame.depth_size), (SIZE, SIZE), "{color}");
        assert!(frame.warnings.is_empty(), "{color}: {:?}", frame.warnings);
        let (mut worst, mut far) = (0.0_f32, 0.0);
        for index in 0..SIZE[0] * SIZE[1] {
            let direction = texel_direction(index % SIZE[0], index / SIZE[0], SIZE).as_vec3();
            let (texel, right) = (frame.radiance.at(index as usize), paint(direction));
            worst = (0..3).fold(worst, |worst, c| worst.max((code(texel[c]) - right[c]).abs()));
            far += (frame.depth[index as usize] / (0.001 * millimetres(direction)) - 1.0).abs();
        }
        // Two codes are the rounding of three pictures, and a texel is 0.7°.
        assert!(worst < 3.5, "{color}: {worst} codes");
        let far = far / (SIZE[0] * SIZE[1]) as f32;
        assert!(far < 0.006, "{color}: depth is {far} off");
    }
}

#[test]
fn a_cube_is_recognised_and_a_bad_one_is_told() {
    let folder = folder();
    for (files, words) in [
        ("cube_negy.png panorama_depth.png", "color = \"cube_{face}.png\""),
        ("horizontal.png c6x1_depth.png", "layout = \"cube\""),
        ("c3x2.png c3x2_depth.png", "layout = \"cube\""),
    ] {
        folder.succeeds(&format!("new {files} -o new.toml --force"));
        let text = std::fs::read_to_string(folder.path("new.toml")).expect("written");
        assert!(text.contains(words) && text.contains("scale = 0.001\n"), "{files}: {text}");
        let floor = text.split("position = [0, ").nth(1).and_then(|rest| rest.split(',').next()).expect("a position");
        assert!((floor.parse::<f32>().expect("metres") - 1.5).abs() < 0.03, "{files}: {text}");
    }
    let panorama = |text: &str, words: &[&str]| {
        folder.write("bad.toml", &format!("[panorama]\ndepth = 2\n{text}\n"));
        folder.fails("check bad.toml", words);
    };
    panorama("color = 'panorama.png'\nlayout = 'cube'", &["panorama.png", "no shape of a cubemap", "4:3"]);
    panorama("color = 'room_{face}.png'", &["room_{face}.png", "no six files", "px nx py ny pz nz"]);
    std::fs::remove_file(folder.path("cube_negz.png")).expect("removed");
    panorama("color = 'cube_{face}.png'", &["cube_negz.png", "all six faces"]);
}

#[test]
fn depth_has_the_meaning_of_what_wrote_it() {
    let folder = Folder::with_scene();
    ImageBuffer::from_pixel(64, 32, Luma([2000_u16])).save(folder.path("depth.png")).expect("written");
    let metres =
        |more: &str| load(&folder, &format!("color = 'room.png'\ndepth = 'depth.png'\n{more}")).depth[64 * 16 + 32];
    for preset in PRESETS {
        let scale = if preset.scale.is_none() { "scale = 3000" } else { "" };
        let right = match preset.name {
            "kandao" => 255.0 / 2000.0,
            "dap" => 2000.0 * 100.0,
            "moge" => 2000.0 * 3000.0,
            "depth-anything" => 1.5,
            "stanford2d3d" => 2000.0 / 512.0,
            "structured3d" => 2.0,
            "matterport" => 0.5,
            // Forwards the axis of the face is the direction, but for half a texel.
            "replica" => 2000.0 / 6553.5,
            other => panic!("{other} has no value here"),
        };
        let found = metres(&format!("depth_preset = '{}'\n{scale}", preset.name));
        assert!((found / right - 1.0).abs() < 0.01, "{}: {found} m", preset.name);
    }
    assert!((metres("depth_preset = 'structured3d'\nscale = 0.002") - 4.0).abs() < 1e-4, "what is given goes first");
    folder.write("bad.toml", "[panorama]\ncolor = 'room.png'\ndepth = 'depth.png'\ndepth_preset = 'moge'\n");
    folder.fails("check bad.toml", &["panorama.depth_preset", "is relative", "give scale"]);
    let text = |preset: &str| {
        folder.succeeds(&format!("new room.png depth.png --depth-preset {preset} -o new.toml --force"));
        std::fs::read_to_string(folder.path("new.toml")).expect("written")
    };
    assert!(text("structured3d").contains("depth_preset = \"structured3d\"\nscale = 0.001\n"));
    assert!(text("depth-anything").contains("depth_preset = \"depth-anything\"\nscale = "));
}
