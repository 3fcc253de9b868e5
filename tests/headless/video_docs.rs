//! Every command in docs/video.md is run, in its order, on a small video.

use crate::{folder::Folder, video_in::ffmpeg};
use std::path::Path;

/// Commands of code blocks that are marked as `sh`.
fn commands(document: &str) -> Vec<&str> {
    let blocks = document.split("```sh\n").skip(1).filter_map(|rest| rest.split("```").next());
    blocks.flat_map(str::lines).filter(|line| !line.trim().is_empty()).collect()
}

#[test]
fn every_command_of_the_document_works() {
    let folder = Folder::empty();
    // A room of 4 m, as disparity 400/metres: colour over grey depth.
    let size = [128, 64];
    let depth =
        iprt::panorama::depth::box_depth(size, glam::Vec3::new(5.0, 3.0, 4.0), glam::Vec3::new(0.0, -0.1, 0.0), 0.0);
    let codes: Vec<u8> = depth.iter().map(|metres| (200.0 / metres).clamp(1.0, 255.0) as u8).collect();
    image::GrayImage::from_raw(size[0], size[1], codes).expect("fits").save(folder.path("d.png")).expect("saved");
    let sources =
        "-f lavfi -i testsrc2=size=128x64:rate=30:duration=0.4 -loop 1 -framerate 30 -i d.png -f lavfi -i sine";
    let join = "-filter_complex [0][1]vstack=shortest=1 -c:v libx264 -crf 1 -pix_fmt yuv420p -c:a aac -t 0.4";
    ffmpeg(&folder, &format!("{sources} {join} video.mp4"));
    for number in 0..12 {
        std::fs::copy(folder.path("d.png"), folder.path(&format!("depth_{number:04}.png"))).expect("copied");
    }
    std::fs::create_dir(folder.path("frames")).expect("made");

    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("docs/video.md");
    let document = std::fs::read_to_string(path).expect("readable");
    let commands = commands(&document);
    assert!(commands.len() > 15, "{commands:?}");
    let program = env!("CARGO_BIN_EXE_iprt");
    for line in commands {
        // Small pictures show as much.
        let smaller = line.replace("iprt render scene.toml", "iprt render scene.toml --size 64x32 --warmup 1");
        let smaller = if smaller.contains("--warmup auto") { smaller.replace("--warmup 1 ", "") } else { smaller };
        let words = smaller.replace("iprt ", &format!("{program} ")).replace("ffmpeg ", "ffmpeg -v error ");
        let mut shell = std::process::Command::new("bash");
        shell.args(["-o", "pipefail", "-c", &words]).current_dir(folder.root()).env_remove("IPRT_VALIDATION");
        let output = shell.output().expect("runs");
        let said = String::from_utf8_lossy(&output.stderr);
        assert!(output.status.success() && !said.contains("panicked"), "{line}: {said}");
    }
    for name in [
        "look.png",
        "out.mp4",
        "remuxed.mov",
        "flat.mp4",
        "master.mov",
        "small.webm",
        "exact.mkv",
        "object.png",
        "joined.mp4",
        "piped.mp4",
    ] {
        let length = folder.path(name).metadata().map_or(0, |data| data.len());
        assert!(length > 150, "{name} has {length} bytes");
    }
    assert_eq!(folder.path("frames.rgb").metadata().expect("written").len(), 2 * 64 * 32 * 3);
    // The arithmetic that the document gives to compositors.
    let layer = |name: &str, file: &str| {
        let read = iprt::image_file::read::read(&folder.path(file)).expect("read");
        let iprt::image_file::FileImage::Exr(image) = read else { panic!("{file} is no EXR") };
        let layer = image.layers.into_iter().find(|layer| layer.name == name).expect("the layer");
        ["R", "G", "B"].map(|channel| layer.channel(channel).expect("a channel").to_vec())
    };
    let picture = layer("", "comp_0000.exr");
    let (alpha, ratio, plate) =
        (layer("alpha", "comp_0000.exr"), layer("ratio", "comp_0000.exr"), layer("", "plate_0000.exr"));
    let (mut changed, mut covered) = (0, 0);
    for c in 0..3 {
        for i in 0..picture[c].len() {
            let made = plate[c][i] * ratio[c][i] + alpha[c][i];
            assert!((made - picture[c][i]).abs() <= 2e-3 * picture[c][i].abs() + 1e-4, "{made}, not {}", picture[c][i]);
            changed += usize::from((ratio[c][i] - 1.0).abs() > 0.01);
            covered += usize::from(alpha[c][i] > 0.0);
        }
    }
    assert!(changed > 20 && covered > 20, "{changed} changed, {covered} covered");
    let png = image::open(folder.path("object.png")).expect("a PNG").into_rgba8();
    let opaque = png.pixels().filter(|pixel| pixel.0[3] == 255).count();
    assert!(opaque > 5 && opaque < 1000, "{opaque}");
}

/// A chunk is what a whole run is: the same where nothing was before it, and the nearer, the longer it warms up.
#[test]
fn chunks_begin_as_a_whole_run_goes_on() {
    let folder = Folder::empty();
    let render = |name: &str, more: &str| {
        folder.succeeds(&format!("render apartment -o {name}_%03d.exr --size 64x36 --set history=8 -q {more}"));
    };
    let flip = |test: &str, truth: &str| {
        let json = folder.succeeds(&format!("compare {test}.exr {truth}.exr --json"));
        serde_json::from_str::<serde_json::Value>(&json).expect("JSON")["flip"].as_f64().expect("a number")
    };
    render("whole", "--frames 0..100");
    render("near", "--frames 20..21 --warmup auto");
    assert_eq!([flip("near_020", "whole_020"), flip("near_021", "whole_021")], [0.0; 2]);
    render("auto", "--frames 100..100 --warmup auto");
    render("usual", "--frames 100..100");
    let [auto, usual] = [flip("auto_100", "whole_100"), flip("usual_100", "whole_100")];
    assert!(auto < 0.6 * usual && auto < 0.015, "{auto} and {usual}");
}

#[test]
fn join_tells_panoramas_from_other_views() {
    let folder = Folder::with_scene();
    std::fs::create_dir(folder.path("f")).expect("made");
    let flags = "--size 64x32 --warmup 0 -q";
    for kind in ["png", "exr"] {
        let render =
            |frame: u32, more: &str| folder.succeeds(&format!("render scene.toml -o f/{frame}.{kind} {flags} {more}"));
        render(0, "--projection equirect");
        render(1, "--projection equirect --without-objects");
        folder.succeeds(&format!("join f/%01d.{kind} -o a.mp4 --spherical"));
        render(1, "");
        folder.fails(&format!("join f/%01d.{kind} -o a.mp4 --spherical"), &["1.", "first frame is", "all around"]);
    }
}

#[test]
fn join_names_what_is_missing_or_odd() {
    let folder = Folder::empty();
    std::fs::create_dir(folder.path("f")).expect("made");
    let save = |number: u32, width: u32| {
        image::RgbImage::new(width, 8).save(folder.path(&format!("f/a_{number:03}.png"))).expect("saved");
    };
    folder.fails("join f -o a.mp4", &["f:", "no numbered"]);
    [0, 1, 2, 5, 6, 9].into_iter().for_each(|number| save(number, 16));
    folder.fails("join f -o a.mp4", &["4 of 10 frames are missing: 3..4, 7..8", "--frames 3..4"]);
    folder.fails("join f -o a.mp4 --frames 0..3", &["1 of 4 frames are missing: 3"]);
    folder.fails("join f -o a.png", &["a.png", ".mp4"]);
    folder.succeeds("join f -o a.mp4 --frames 0..2 --fps 10");
    [3, 4, 7, 8].into_iter().for_each(|number| save(number, 16));
    save(6, 18);
    folder.fails("join f -o b.mp4", &["a_006.png", "18x8", "16x8"]);
    save(6, 16);
    std::fs::write(folder.path("f/a_004.png"), "no picture").expect("written");
    folder.fails("join f -o b.mp4", &["a_004.png", "cannot be read"]);
    save(4, 16);
    let gray = image::ImageBuffer::<image::Luma<u16>, _>::new(16, 8);
    gray.save(folder.path("f/a_005.png")).expect("saved");
    folder.fails("join f -o b.mp4", &["a_005.png", "is a PNG of L16, but the first frame is a PNG of Rgb8"]);
    image::RgbImage::new(16, 8).save_with_format(folder.path("f/a_005.png"), image::ImageFormat::Jpeg).expect("saved");
    folder.fails("join f -o b.mp4", &["a_005.png", "is a JPEG of Rgb8"]);
    save(5, 16);
    image::RgbImage::new(16, 8).save(folder.path("f/b_0.png")).expect("saved");
    folder.fails("join f -o b.mp4", &["several kinds", "a_%03d.png", "b_%01d.png"]);
    folder.succeeds("join f/a_%03d.png -o b.mp4");
    assert!(folder.path("b.mp4").exists());
}
