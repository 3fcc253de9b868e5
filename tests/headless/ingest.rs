//! `ingest` makes of a video's codes what the processor makes of them, for each way in which `ffmpeg` stores codes.

use crate::{common::*, folder::Folder, video_in::ffmpeg};
use iprt::{
    Error,
    gpu::{FrameOptions, Gpu},
    options::RenderOptions,
    panorama::{source::PanoramaFrame, texels::Texels},
    passes::{
        ingest::Ingest,
        panorama::{Needs, Panorama},
    },
    plan::{Part, Plan},
    renderer::{Renderer, Wishes},
    scene::Scene,
    settings::Method,
};
use std::sync::Arc;

/// A lossless video of random codes of this size. It has two frames, grey in their lower or right half if depth is there.
fn video(folder: &Folder, size: [u32; 2], format: &str, tags: &str, packing: &str) {
    let mut random = fastrand::Rng::with_seed(7);
    let [width, height] = size;
    // Smooth over some pixels, as pictures are, and beyond the limited range.
    let small = [width.div_ceil(3), height.div_ceil(3)];
    let mut pixel = |at: u32| {
        let [x, y] = [at % small[0], at / small[0] % small[1]];
        let grey = packing.contains("top") && 2 * y >= small[1] || packing.contains("left") && 2 * x >= small[0];
        let code = random.u16(..);
        [0; 3].map(|_| if grey { code } else { random.u16(..) })
    };
    let raw: Vec<u8> = (0..2 * small[0] * small[1]).flat_map(&mut pixel).flat_map(u16::to_le_bytes).collect();
    std::fs::write(folder.path("raw"), raw).expect("written");
    let source = format!("-f rawvideo -pix_fmt rgb48le -s {}x{} -r 25 -i raw", small[0], small[1]);
    // What is grey stays so.
    let flags = if packing.contains("packing") { "neighbor" } else { "bicubic" };
    let filter = format!("-vf scale={width}:{height}:flags={flags}");
    ffmpeg(folder, &format!("{source} {filter} -pix_fmt {format} -c:v ffv1 {tags} v.mkv"));
}

fn open(folder: &Folder, more: &str) -> Scene {
    let depth = if more.contains("packing") { "" } else { "depth = 2" };
    folder.write("scene.toml", &format!("[panorama]\ncolor = 'v.mkv'\n{depth}\n{more}\n"));
    Scene::load(&folder.path("scene.toml")).expect("a scene")
}

/// The radiance that the device makes of a frame's codes.
fn ingested(gpu: &Gpu, scene: &Scene, content: &PanoramaFrame) -> Texels {
    let plan = Plan::of(scene, &options(Method::Iprt, &[]), None).expect("a plan");
    let coding = plan.codes().expect("codes");
    let needs = Needs::of(&plan);
    let mut panorama = Panorama::new(gpu, content.color_size, content.depth_size, 0.0, needs).expect("fits");
    let ingest = Ingest::new(gpu, coding, plan.halves()).expect("a pass");
    let mut frame = gpu.frame().expect("a frame");
    panorama.upload(&mut frame, content).expect("fits");
    frame.barrier("ingest reads codes");
    ingest.record(&mut frame, &panorama).expect("recorded");
    frame.run().expect("runs");
    gpu.read_image(panorama.radiance(), 0).expect("reads").into()
}

/// Says by how much texels differ at most, as a share of their brightest channel, and in alpha.
fn difference(a: &Texels, b: &Texels) -> f32 {
    assert_eq!(a.len(), b.len());
    let off = |(a, b): ([f32; 4], [f32; 4])| {
        let most = b[0].max(b[1]).max(b[2]).max(1e-3);
        (0..4).map(|c| (a[c] - b[c]).abs() / if c == 3 { b[3] } else { most }).fold(0.0, f32::max)
    };
    a.iter().zip(b.iter()).map(off).fold(0.0, f32::max)
}

#[test]
fn the_device_makes_what_the_processor_makes_of_codes() {
    const HALF: f32 = 1.0 / 2048.0;
    let hdr = "-colorspace bt2020nc -color_primaries bt2020 -color_range tv -color_trc";
    validated(|gpu| {
        for (format, tags, more) in [
            ("yuv420p", "-colorspace bt709 -color_range tv", ""),
            ("yuv420p", "-colorspace bt709 -color_range tv -chroma_sample_location center", "exposure = 3"),
            ("yuv420p", "-colorspace smpte170m -color_range pc -chroma_sample_location topleft", ""),
            ("yuv420p", "-colorspace bt2020nc -color_primaries smpte432 -chroma_sample_location top", ""),
            ("yuv420p", "-colorspace smpte240m", "packing = 'top-bottom'\ninverse_tonemap = 8"),
            ("yuv422p", "-colorspace fcc -color_trc gamma28", "packing = 'left-right'"),
            ("yuv440p", "-color_trc gamma22", "inverse_tonemap = 4\nlamps = 3\nexposure = 0.5"),
            ("yuv410p", "-color_trc linear", ""),
            ("yuv411p", "", "lamps = 'as captured'"),
            ("yuv444p", "-color_range pc", ""),
            ("yuv420p10le", &format!("{hdr} smpte2084"), "exposure = 0.1"),
            ("yuv420p10le", &format!("{hdr} arib-std-b67"), "packing = 'top-bottom'"),
            ("yuv422p12le", "", "lamps = 5"),
            ("yuv444p16le", "", ""),
            ("gbrp", "", "inverse_tonemap = 2"),
            ("gbrp12le", "", ""),
            ("gray", "-color_range pc", "lamps = 2"),
            ("gray16le", "", ""),
        ] {
            let folder = Folder::empty();
            let name = format!("{format} {tags} {more}");
            // Sides that no chroma fits, and rows that no word ends with.
            let size = if more.contains("packing") { [72, 36] } else { [35, 19] };
            video(&folder, size, format, tags, more);
            let scene = open(&folder, more);
            let content = scene.panorama.load(1).unwrap_or_else(|error| panic!("{name}: {error}"));
            let codes = content.radiance.codes().unwrap_or_else(|| panic!("{name}: no codes"));
            assert!(!codes.are_made(), "{name}");
            let each: Texels = (0..content.radiance.len()).map(|at| content.radiance.at(at)).collect();
            assert!(difference(&each, codes.all()) < 1e-5, "{name}: texels and rows differ");
            let made = ingested(gpu, &scene, &content);
            let off = difference(&made, codes.all());
            assert!(off < HALF, "{name}: {off}");
            let brightest = each.iter().map(|t| t[0].max(t[1]).max(t[2])).fold(0.0, f32::max);
            assert!(brightest > 0.1, "{name}: {brightest}");
        }
    });
}

/// What is known of texels before they are made leaves out none that is bright.
#[test]
fn bright_texels_are_found_among_codes() {
    let folder = Folder::empty();
    for (format, tags, more) in [
        ("yuv420p", "", "lamps = 9"),
        ("yuv420p10le", "-colorspace bt2020nc -color_primaries bt2020 -color_trc smpte2084", "exposure = 0.2"),
        ("yuv444p", "-color_primaries smpte432", "inverse_tonemap = 6"),
        ("gbrp", "", ""),
        ("gray", "", "lamps = 'as captured'"),
    ] {
        video(&folder, [64, 32], format, tags, "");
        let content = open(&folder, more).panorama.load(1).expect("a frame");
        let measure = |t: &[f32; 4]| t[3] * (0.2126 * t[0] + 0.7152 * t[1] + 0.0722 * t[2]);
        for least in [0.0, 0.05, 0.3, 0.9, 5.0] {
            let mut found = content.radiance.brighter(least, measure);
            found.sort_by_key(|(_, at)| *at);
            assert!(!content.radiance.codes().expect("codes").are_made());
            let all = (0..content.radiance.len()).map(|at| measure(&content.radiance.at(at)));
            let right: Vec<_> = all.zip(0..).filter(|(value, _)| *value > least).collect();
            assert_eq!(found, right, "{format} above {least}");
        }
    }
}

/// Videos whose colours are changed before they are used come as radiance, and the pictures are the same.
#[test]
fn codes_make_the_picture_that_radiance_makes() {
    let folder = Folder::empty();
    video(&folder, [128, 64], "yuv420p", "-colorspace bt709", "");
    image::RgbImage::from_pixel(4, 2, image::Rgb([255; 3])).save(folder.path("white.png")).expect("saved");
    validated(|gpu| {
        let picture = |more: &str, sets: &[(&str, &str)]| {
            let scene = open(&folder, more);
            let mut renderer = Renderer::new(gpu, &scene, options(Method::Iprt, sets)).expect("a renderer");
            let codes = renderer.plan().codes().is_some();
            for time in [0.0, 0.04] {
                renderer.render(&scene, time).expect("renders");
            }
            let made = scene.panorama.load(1).expect("a frame").radiance.codes().map(|codes| codes.are_made());
            (Texels::from(renderer.picture().expect("a picture")), codes, made)
        };
        let (by_codes, on, made) = picture("", &[]);
        assert_eq!((on, made), (true, Some(false)), "the device alone makes radiance");
        let (by_hand, on, made) = picture("", &[("ingest", "off")]);
        assert_eq!((on, made), (false, Some(true)));
        let (by_files, on, made) = picture("mask = 'white.png'", &[]);
        assert_eq!((on, made), (false, None));
        assert!(difference(&by_codes, &by_hand) < 1e-3 && difference(&by_hand, &by_files) < 1e-3);
    });
}

/// Who asks for a frame twice gets the same codes, and what a frame takes in memory is what its codes take.
#[test]
fn a_frame_of_codes_takes_as_little_as_its_codes() {
    let folder = Folder::empty();
    video(&folder, [64, 32], "yuv420p", "", "");
    let scene = open(&folder, "lamps = 'as captured'");
    let content = scene.panorama.load(0).expect("a frame");
    let depth = size_of_val(&content.depth[..]);
    assert_eq!(content.bytes(), 64 * 32 * 3 / 2 + depth);
    assert!(Arc::ptr_eq(&content, &scene.panorama.load(0).expect("a frame")));
    assert_eq!(content.radiance.iter().count(), 64 * 32);
    assert_eq!(content.bytes(), 64 * 32 * (3 + 32) / 2 + depth, "and all texels, once somebody asked for them");
    assert!(Plan::of(&scene, &options(Method::Iprt, &[]), None).expect("a plan").on(Part::Ingest));
}

/// As `renderer::every_barrier_is_needed`, for a frame that begins with codes.
#[test]
fn every_barrier_of_a_frame_of_codes_is_needed() {
    let folder = Folder::empty();
    video(&folder, [64, 32], "yuv420p", "", "");
    let thing = "[[object]]\nshape = \"sphere\"\nsize = 0.6\ntranslation = [0.1, -0.2, -1.4]";
    let scene = open(&folder, thing);
    validated(|gpu| {
        let set = [("relight_levels", "2"), ("relight_width", "32"), ("interpolate", "true")];
        let coarse = RenderOptions { size: [12, 8], ..options(Method::Iprt, &set) };
        let mut renderer = rendered(gpu, &scene, coarse, 1);
        let mut at = 0;
        let reason = loop {
            let submission = FrameOptions { skip_barrier: Some(at), ..Default::default() };
            match renderer.begin(&scene, 1.0 / 25.0, &Wishes { submission, ..Default::default() }) {
                Err(Error::Internal(text)) if text.contains("ingest") => break text,
                Err(Error::Internal(text)) => assert!(text.contains("no barrier between"), "{text}"),
                Err(other) => panic!("barrier {at}: {other}"),
                Ok(_) => {
                    panic!("barrier {at} can be left out, and none was between ingest and what reads its radiance")
                }
            }
            at += 1;
        };
        assert!(reason.contains("no barrier between"), "{reason}");
        let timings = renderer.render(&scene, 1.0 / 25.0).expect("renders");
        assert!(timings.pass("ingest").is_some());
    });
}
