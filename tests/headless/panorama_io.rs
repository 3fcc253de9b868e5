//! Panorama and image files: what is read, what is refused, and how.

use glam::{DVec3, Vec3};
use image::{ImageBuffer, Luma, Rgb};
use iprt::{
    image_file::{Exr, ExrLayer, FileImage, read, write},
    panorama::{depth::Quantisation, mapping, source::PanoramaFrame},
    scene::Scene,
};
use std::path::Path;
use tempfile::TempDir;

/// A folder with a scene file of this `[panorama]`.
fn scene(panorama: &str) -> (TempDir, std::path::PathBuf) {
    let folder = tempfile::tempdir().expect("a folder");
    let path = folder.path().join("scene.toml");
    std::fs::write(&path, format!("[panorama]\n{panorama}\n")).expect("written");
    (folder, path)
}

fn load(path: &Path) -> Result<std::sync::Arc<PanoramaFrame>, String> {
    let scene = Scene::load(path).map_err(|error| error.to_string())?;
    scene.panorama.load(0).map_err(|error| error.to_string())
}

fn exr(path: &Path, size: [u32; 2], channels: &[(&str, f32)]) {
    let texels = (size[0] * size[1]) as usize;
    let channels = channels.iter().map(|(name, value)| ((*name).to_owned(), vec![*value; texels])).collect();
    write::write_exr(path, &[ExrLayer { name: String::new(), size, channels }]).expect("written");
}

#[test]
fn ldr_images_are_srgb_decoded() {
    let (folder, path) = scene("color = 'c.png'\ndepth = 2.5\nexposure = 2");
    ImageBuffer::from_pixel(4, 2, Rgb([188_u8, 255, 0])).save(folder.path().join("c.png")).expect("saved");
    let frame = load(&path).expect("loads");
    let [r, g, b, a] = frame.radiance.at(0);
    assert!((r - 2.0 * 0.5029).abs() < 1e-3 && g == 2.0 && b == 0.0 && a == 1.0);
    assert_eq!((frame.color_size, frame.depth_size, frame.depth[7]), ([4, 2], [4, 2], 2.5));
    assert_eq!(frame.quantisation, Quantisation::None);

    ImageBuffer::from_pixel(4, 2, Rgb([48_316_u16, 65_535, 0])).save(folder.path().join("c.png")).expect("saved");
    assert!((load(&path).expect("loads").radiance.at(0)[0] - 2.0 * 0.5029).abs() < 1e-3, "16 bits too");
}

#[test]
fn inverse_tone_mapping_raises_only_saturated_ldr_texels() {
    let (folder, path) = scene("color = 'c.png'\ndepth = 2.5\ninverse_tonemap = 5");
    ImageBuffer::from_fn(4, 2, |x, _| Rgb([if x == 0 { 255_u8 } else { 128 }; 3]))
        .save(folder.path().join("c.png"))
        .expect("saved");
    let frame = load(&path).expect("loads");
    assert!((frame.radiance.at(0)[0] - 5.0).abs() < 1e-4);
    assert!((frame.radiance.at(1)[0] - 0.2158).abs() < 1e-3);
}

#[test]
fn hdr_exr_and_jpeg_are_read() {
    let (folder, path) = scene("color = 'c.img'\ndepth = 'd.img'");
    let color = folder.path().join("c.img");
    exr(&folder.path().join("d.img"), [2, 1], &[("Y", 3.5)]);
    let file = std::fs::File::create(&color).expect("created");
    image::codecs::hdr::HdrEncoder::new(file).encode(&[Rgb([8.0, 0.5, 0.25]); 8], 4, 2).expect("encoded");
    let frame = load(&path).expect("loads");
    assert_eq!(frame.radiance.at(0), [8.0, 0.5, 0.25, 1.0]);
    assert_eq!((frame.depth_size, frame.depth[0]), ([2, 1], 3.5), "sizes may differ");

    exr(&color, [4, 2], &[("R", 1.0), ("G", 2.0), ("B", 3.0), ("Z", 9.0)]);
    assert_eq!(load(&path).expect("loads").radiance.at(0), [1.0, 2.0, 3.0, 1.0]);
    exr(&color, [4, 2], &[("Y", 4.0)]);
    assert_eq!(load(&path).expect("loads").radiance.at(0), [4.0, 4.0, 4.0, 1.0]);
    ImageBuffer::from_pixel(16, 8, Rgb([255_u8; 3])).save_with_format(&color, image::ImageFormat::Jpeg).expect("saved");
    assert!(load(&path).expect("loads").radiance.iter().all(|texel| texel[0] > 0.97));
}

#[test]
fn integer_depth_has_codes_and_a_spacing() {
    let (folder, path) =
        scene("color = 'c.png'\ndepth = 'd.png'\nencoding = 'disparity'\nscale = 205\noffset = -23\ninvalid = [255]");
    ImageBuffer::from_pixel(4, 2, Rgb([9_u8; 3])).save(folder.path().join("c.png")).expect("saved");
    let codes = [0_u8, 23, 24, 125, 255, 64, 64, 64];
    ImageBuffer::<Luma<u8>, _>::from_raw(4, 2, codes.to_vec())
        .expect("fits")
        .save(folder.path().join("d.png"))
        .expect("saved");
    let frame = load(&path).expect("loads");
    assert_eq!(frame.depth[..5], [0.0, 0.0, 205.0, 205.0 / 102.0, 0.0]);
    assert_eq!(frame.quantisation, Quantisation::Disparity { step: 1.0 / 205.0 });

    let (folder, path) = scene("color = 'c.png'\ndepth = 'd.png'\nscale = 0.001");
    ImageBuffer::from_pixel(4, 2, Rgb([9_u8; 3])).save(folder.path().join("c.png")).expect("saved");
    ImageBuffer::from_pixel(4, 2, Luma([2500_u16])).save(folder.path().join("d.png")).expect("saved");
    let frame = load(&path).expect("loads");
    assert!((frame.depth[0] - 2.5).abs() < 1e-6);
    assert_eq!(frame.quantisation, Quantisation::Radial { step: 0.001 });
}

#[test]
fn packed_images_hold_colour_first() {
    for (packing, split) in [("top-bottom", (false, true)), ("left-right", (true, false))] {
        let (folder, path) = scene(&format!("color = 'c.png'\npacking = '{packing}'\nscale = 0.01"));
        let (width, height) = if split.0 { (8, 2) } else { (4, 4) };
        let image = ImageBuffer::from_fn(width, height, |x, y| {
            let second = if split.1 { y >= 2 } else { x >= 4 };
            if second { Rgb([100_u8; 3]) } else { Rgb([255, 0, 0]) }
        });
        image.save(folder.path().join("c.png")).expect("saved");
        let frame = load(&path).expect("loads");
        assert_eq!((frame.color_size, frame.depth_size), ([4, 2], [4, 2]), "{packing}");
        assert!(frame.radiance.iter().all(|texel| texel == [1.0, 0.0, 0.0, 1.0]), "{packing}");
        assert!(frame.depth.iter().all(|depth| (*depth - 1.0).abs() < 1e-6), "{packing}");
    }
}

#[test]
fn a_box_is_seen_from_inside() {
    let (folder, path) = scene(
        "color = 'c.png'\ndepth = { box = [4, 2.6, 3], center = [0, 1.3, 0] }\nposition = [0.5, 1.0, -0.2]\nyaw = 30",
    );
    ImageBuffer::from_pixel(64, 32, Rgb([9_u8; 3])).save(folder.path().join("c.png")).expect("saved");
    let frame = load(&path).expect("loads");
    for row in 0..32 {
        for column in 0..64 {
            let direction = mapping::panorama_to_world(mapping::texel_direction(column, row, [64, 32]), 30.0);
            let metres = f64::from(frame.depth[(row * 64 + column) as usize]);
            let hit = DVec3::new(0.5, 1.0, -0.2) + direction * metres - DVec3::new(0.0, 1.3, 0.0);
            let outside = (hit.abs() / DVec3::new(2.0, 1.3, 1.5)).max_element();
            assert!((outside - 1.0).abs() < 1e-5, "{hit}");
        }
    }
}

#[test]
fn sequences_step_and_are_timed() {
    let (folder, path) = scene("color = 'c%02d.png'\ndepth = 1\nframes = [4, 10, 3]\nfps = 10");
    for (number, code) in [(4_u32, 10_u8), (7, 20), (10, 30)] {
        let name = folder.path().join(format!("c{number:02}.png"));
        ImageBuffer::from_pixel(2, 1, Rgb([code; 3])).save(name).expect("saved");
    }
    let panorama = Scene::load(&path).expect("loads").panorama;
    assert_eq!(panorama.frame_count(), 3);
    for (time, index) in [(-1.0, 0), (0.0, 0), (0.09, 0), (0.1, 1), (0.2, 2), (99.0, 2)] {
        assert_eq!(panorama.frame_at(time), index, "{time}");
    }
    assert!((0..3).all(|i| panorama.frame_at(panorama.frame_time(i)) == i));
    let values: Vec<f32> = (0..3).map(|i| panorama.load(i).expect("loads").radiance.at(0)[0]).collect();
    assert!(values[0] < values[1] && values[1] < values[2]);
}

#[test]
fn bad_radiance_is_mended_or_refused() {
    let (folder, path) = scene("color = 'c.exr'\ndepth = 1");
    let color = folder.path().join("c.exr");
    let size = [4, 2];
    let mut texels = vec![[1.0, 1.0, 1.0, 1.0]; 8];
    texels[1][0] = f32::NAN;
    texels[2][1] = f32::INFINITY;
    texels[3][2] = -1.0;
    write::write_exr(&color, &[ExrLayer::rgb("", size, &texels)]).expect("written");
    let frame = load(&path).expect("loads");
    assert_eq!(frame.radiance.at(1), [0.0, 0.0, 0.0, 1.0], "a texel that is no number is not known");
    assert!(frame.depth[1] == 0.0 && frame.depth[0] > 0.0);
    assert_eq!(frame.radiance.at(2), [1.0, 65504.0, 1.0, 1.0], "the sun in half precision");
    assert_eq!(frame.radiance.at(3), [1.0, 1.0, 0.0, 1.0]);
    for words in ["12.5 % of its texels", "1 texels with negative", "1 texels with infinite"] {
        assert!(
            frame.warnings.iter().any(|w| w.contains(words) && w.contains("c.exr")),
            "{words}: {:?}",
            frame.warnings
        );
    }
    exr(&color, size, &[("R", f32::NAN), ("G", f32::NAN), ("B", f32::NAN)]);
    assert!(load(&path).expect_err("refused").contains("no finite pixel"));
}

#[test]
fn depth_that_is_all_holes_is_allowed_with_a_warning() {
    let (folder, path) = scene("color = 'c.png'\ndepth = 'd.exr'");
    ImageBuffer::from_pixel(4, 2, Rgb([9_u8; 3])).save(folder.path().join("c.png")).expect("saved");
    exr(&folder.path().join("d.exr"), [4, 2], &[("depth", f32::NAN)]);
    let frame = load(&path).expect("loads");
    assert!(frame.depth.iter().all(|depth| *depth == 0.0));
    assert!(frame.warnings.iter().any(|w| w.contains("infinitely far") && w.contains("d.exr")), "{:?}", frame.warnings);
}

/// Made by avifenc of a red and a blue half. What is right was measured of the picture that it was made of.
#[test]
fn avif_is_a_panorama_whatever_its_range_and_depth() {
    let (folder, path) = scene("color = 'c.avif'\ndepth = 1");
    let color = folder.path().join("c.avif");
    let corpus = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/corpus");
    for name in ["full8.avif", "limited10.avif"] {
        std::fs::copy(corpus.join(name), &color).expect("copied");
        let frame = load(&path).expect("loads");
        assert_eq!((frame.color_size, frame.white), ([64, 32], Some(1.0)), "{name}");
        for (column, right) in [(8, [0.527, 0.0144, 0.0513]), (56, [0.0513, 0.2159, 0.527])] {
            let found = frame.radiance.at(16 * 64 + column);
            assert!(right.iter().zip(found).all(|(right, found)| (right - found).abs() < 0.02), "{name}: {found:?}");
        }
    }
    std::fs::copy(corpus.join("turned.avif"), &color).expect("copied");
    let line = load(&path).expect_err("turned");
    assert!(line.contains("c.avif: asks to be turned") && line.contains("avifdec") && !line.contains('\n'), "{line}");
}

#[test]
fn unusable_files_give_one_line_that_names_them() {
    let (folder, path) = scene("color = 'c.png'\ndepth = 1");
    let color = folder.path().join("c.png");
    let refused = |problem: &str| {
        let line = load(&path).expect_err(problem);
        assert!(line.contains("c.png") && line.contains(problem) && !line.contains('\n'), "{line}");
    };
    refused("no such file");
    std::fs::write(&color, "").expect("written");
    refused("empty");
    std::fs::write(&color, "a text").expect("written");
    refused("is not a PNG, JPEG, WebP, TIFF, EXR or HDR");
    std::fs::write(&color, b"\0\0\0\x20ftypisom\0\0\0\0").expect("written");
    refused("ffmpeg");
    std::fs::write(&color, b"\0\0\0\x1cftypheic\0\0\0\0").expect("written");
    refused("of the kind HEIC, which is not read; convert it");
    exr(&color, [4, 2], &[("X", 1.0), ("diffuse.U", 1.0)]);
    refused("has no R, G, B nor Y channel, but X, diffuse.U");
    std::fs::remove_file(&color).expect("removed");
    std::fs::create_dir(&color).expect("made");
    refused("not a regular file");
}

#[test]
fn coloured_depth_is_refused() {
    let (folder, path) = scene("color = 'c.png'\ndepth = 'd.png'");
    ImageBuffer::from_pixel(4, 2, Rgb([9_u8; 3])).save(folder.path().join("c.png")).expect("saved");
    ImageBuffer::from_pixel(4, 2, Rgb([9_u8, 20, 3])).save(folder.path().join("d.png")).expect("saved");
    assert!(load(&path).expect_err("refused").contains("in colour"));
}

#[test]
fn unusual_shapes_are_warned_of() {
    let (folder, path) = scene("color = 'c.png'\ndepth = 1");
    ImageBuffer::from_pixel(1, 1, Rgb([9_u8; 3])).save(folder.path().join("c.png")).expect("saved");
    assert!(load(&path).expect("loads").warnings[0].contains("1x1"));
}

/// Every truncation and many corruptions of every kind of file: an error or an image, never a panic, never a huge one.
#[test]
fn damaged_images_never_panic() {
    let folder = tempfile::tempdir().expect("a folder");
    let path = |name: &str| folder.path().join(name);
    let noise = |x: u32, y: u32| (x * 37 + y * 101 + x * y) as u8;
    let rgb = ImageBuffer::from_fn(23, 11, |x, y| Rgb([noise(x, y), noise(y, x), noise(x + 1, y)]));
    rgb.save(path("a.png")).expect("saved");
    rgb.save(path("a.jpg")).expect("saved");
    let texels: Vec<_> = rgb.pixels().map(|p| [f32::from(p.0[0]), f32::from(p.0[1]), f32::from(p.0[2]), 1.0]).collect();
    let floats: Vec<_> = texels.iter().map(|t| Rgb([t[0], t[1], t[2]])).collect();
    let file = std::fs::File::create(path("a.hdr")).expect("created");
    image::codecs::hdr::HdrEncoder::new(file).encode(&floats, 23, 11).expect("encoded");
    write::write_exr(&path("a.exr"), &[ExrLayer::rgb("", [23, 11], &texels)]).expect("written");
    let mut refused = 0;
    for name in ["a.png", "a.jpg", "a.hdr", "a.exr"] {
        let whole = std::fs::read(path(name)).expect("read");
        assert!(read::decode(&whole, name).is_ok(), "{name}");
        let mut attempt = |bytes: &[u8]| {
            let outcome = std::panic::catch_unwind(|| {
                read::decode(bytes, name).and_then(|image| image.into_color(name)).map_err(|error| error.to_string())
            });
            let decoded = outcome.unwrap_or_else(|_| panic!("{name} panicked on {} bytes", bytes.len()));
            refused += usize::from(decoded.is_err_and(|line| !line.contains('\n') && line.starts_with(name)));
        };
        for length in (0..whole.len()).step_by(1 + whole.len() / 400) {
            attempt(&whole[..length]);
        }
        for at in 0..whole.len().min(600) {
            for value in [0, 0x7f, 0xff, whole[at] ^ 1, whole[at] ^ 0x80] {
                let mut bytes = whole.clone();
                bytes[at] = value;
                attempt(&bytes);
            }
        }
    }
    assert!(refused > 1000, "{refused}");
}

#[test]
fn what_is_written_is_read_back() {
    let folder = tempfile::tempdir().expect("a folder");
    let path = folder.path().join("out.exr");
    let size = [5, 3];
    let values: Vec<f32> = (0..15).map(|i| 1.0 / (i as f32 + 0.3)).collect();
    let color: Vec<_> = values.iter().map(|v| [*v, 2.0 * v, 0.5 * v, 1.0]).collect();
    let layers = [
        ExrLayer::rgb("", size, &color),
        ExrLayer::rgb("albedo", size, &color),
        ExrLayer { name: "depth".into(), size, channels: vec![("Z".into(), values.clone())] },
    ];
    write::write_exr(&path, &layers).expect("written");
    let FileImage::Exr(Exr { layers: read_layers, .. }) = read::read(&path).expect("read") else { panic!("an EXR") };
    assert_eq!(read_layers.len(), 3);
    for layer in &layers {
        let found = read_layers.iter().find(|l| l.name == layer.name).expect("the layer");
        assert_eq!(found.size, size);
        for (name, values) in &layer.channels {
            assert_eq!(found.channel(name), Some(values.as_slice()), "{}.{name}", layer.name);
        }
    }
    assert_eq!(read::read(&path).and_then(|image| image.into_color("x")).expect("colour").texels, color);

    let path = folder.path().join("out.png");
    write::write_display(&path, [2, 1], &[[0.25, 1.0, f32::NAN, 1.0], [-1.0, 9.0, 0.0, 1.0]], 2.0).expect("written");
    let codes = image::open(&path).expect("read").into_rgb8().into_raw();
    assert_eq!(codes, [188, 255, 0, 0, 255, 0]);
    let left: Vec<_> = std::fs::read_dir(folder.path()).expect("read").map(|e| e.expect("e").file_name()).collect();
    assert_eq!(left.len(), 2, "nothing temporary is left: {left:?}");
}

#[test]
fn unwritable_outputs_are_refused_and_leave_nothing() {
    let folder = tempfile::tempdir().expect("a folder");
    for path in [folder.path().join("absent/out.png"), folder.path().to_path_buf(), "/proc/out.png".into()] {
        let error = write::write_png(&path, [1, 1], &[1, 2, 3], 3).expect_err("refused");
        assert_eq!(error.exit_code(), 2);
        assert!(error.to_string().contains(&path.display().to_string()), "{error}");
    }
    assert_eq!(std::fs::read_dir(folder.path()).expect("read").count(), 0);
    let kept = folder.path().join("kept.txt");
    std::fs::write(&kept, "old").expect("written");
    let failed = write::write_atomically(&kept, |_| Err(iprt::Error::input("x", "failed half way", "y")));
    assert!(failed.is_err());
    assert_eq!(std::fs::read_to_string(&kept).expect("read"), "old");
    assert_eq!(std::fs::read_dir(folder.path()).expect("read").count(), 1);
}

#[test]
fn the_yaw_turns_the_panorama_right_handed() {
    let turned = mapping::panorama_to_world(DVec3::NEG_Z, 90.0).as_vec3();
    assert!(turned.abs_diff_eq(Vec3::NEG_X, 1e-6));
    assert!(mapping::world_to_panorama(DVec3::NEG_X, 90.0).abs_diff_eq(DVec3::NEG_Z, 1e-12));
}
