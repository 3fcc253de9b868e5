//! Video files as input: what is read, how its codes are understood, and what is refused.

use crate::{folder::Folder, mitsuba::data_file as data};
use iprt::{
    panorama::source::{PanoramaFrame, PanoramaSource},
    scene::Scene,
};
use std::{path::Path, process::Command, sync::Arc};

/// Runs `ffmpeg` in the folder, with words parted by blanks.
pub fn ffmpeg(folder: &Folder, words: &str) {
    let mut command = Command::new("ffmpeg");
    command.args(["-hide_banner", "-nostdin", "-v", "error", "-y"]).args(words.split_whitespace());
    let output = command.current_dir(folder.root()).output().expect("ffmpeg is installed");
    assert!(output.status.success(), "ffmpeg {words}: {}", String::from_utf8_lossy(&output.stderr));
}

/// Writes a lossless video of these raw frames.
fn lossless(folder: &Folder, name: &str, size: [u32; 2], format: &str, tags: &str, raw: &[u8]) {
    std::fs::write(folder.path("raw"), raw).expect("written");
    let [width, height] = size;
    let source = format!("-f rawvideo -pix_fmt {format} -s {width}x{height} -r 25 -i raw");
    ffmpeg(folder, &format!("{source} -c:v ffv1 {tags} {name}"));
}

fn open(folder: &Folder, panorama: &str) -> PanoramaSource {
    try_open(folder, panorama).expect("opens").panorama
}

fn try_open(folder: &Folder, panorama: &str) -> Result<Scene, String> {
    folder.write("scene.toml", &format!("[panorama]\n{panorama}\n"));
    Scene::load(&folder.path("scene.toml")).map_err(|error| error.to_string())
}

fn load(source: &PanoramaSource, index: usize) -> Arc<PanoramaFrame> {
    source.load(index).unwrap_or_else(|error| panic!("frame {index}: {error}"))
}

fn kandao() -> String {
    let file = data("rgbd/kandao/kandao.mp4");
    format!("color = '{}'\npacking = 'top-bottom'\nencoding = 'disparity'\nscale = 205\noffset = -23", file.display())
}

/// The frames that were taken from this video as images are those that come out of it.
#[test]
fn a_real_video_is_what_its_images_are() {
    let folder = Folder::empty();
    let source = open(&folder, &kandao());
    assert_eq!((source.frame_count(), source.fps, source.rate()), (175, 30.0, [30, 1]));
    let info = source.video().expect("a video");
    assert_eq!((info.size, info.codec.as_str(), info.audio.as_deref()), ([2160, 2160], "h264", Some("aac")));
    assert!(info.assumed.iter().any(|a| a.contains("bt709")), "{:?}", info.assumed);
    let frame = load(&source, 60);
    assert_eq!((frame.color_size, frame.depth_size), ([2160, 1080], [2160, 1080]));

    let image = data("rgbd/kandao/0060_disp.png");
    let codes = image::open(image).expect("an image").into_luma8();
    let (mut near, mut all) = (0, 0);
    for (x, y, code) in codes.enumerate_pixels() {
        let [column, row] = [(2 * x + 1) * 2160 / 2048, (2 * y + 1) * 1080 / 1024];
        let metres = frame.depth[(row * 2160 + column) as usize];
        let code = f32::from(code.0[0]);
        let known = if metres > 0.0 { 205.0 / metres + 23.0 } else { 0.0 };
        all += 1;
        near += usize::from((known - code).abs() <= 3.0 || (code <= 24.0 && known <= 27.0));
    }
    assert!(f64::from(near as u32) > 0.93 * f64::from(all), "{near} of {all} codes");

    let rgb = image::open(data("rgbd/kandao/0060_rgb.jpg")).expect("an image").into_rgb8();
    let mut error = 0.0;
    for (x, y, pixel) in rgb.enumerate_pixels() {
        let [column, row] = [(2 * x + 1) * 2160 / 2048, (2 * y + 1) * 1080 / 1024];
        let texel = frame.radiance.at((row * 2160 + column) as usize);
        let shown = |linear: f32| f32::from(iprt::image_file::write::display_code(linear));
        error += (0..3).map(|c| (shown(texel[c]) - f32::from(pixel.0[c])).abs()).sum::<f32>();
    }
    let mean = error / (3 * rgb.width() * rgb.height()) as f32;
    assert!(mean < 4.0, "mean difference of {mean} codes");
}

/// Frames that are sought are those that come in order, in a file with frames of both directions.
#[test]
fn seeking_and_reading_in_order_give_the_same_frames() {
    let folder = Folder::empty();
    // An estimate of lamps would be the first frame's.
    let captured = format!("{}\nlamps = 'as captured'", kandao());
    let in_order = open(&folder, &captured);
    let frames: Vec<_> = (0..9).map(|index| load(&in_order, index)).collect();
    let same = |a: &PanoramaFrame, b: &PanoramaFrame| a.radiance == b.radiance && a.depth == b.depth;
    assert!(!same(&frames[3], &frames[4]));
    for index in [8, 3, 4, 0] {
        let sought = open(&folder, &format!("{captured}\nframes = [{index}, 174]"));
        assert!(same(&load(&sought, 0), &frames[index as usize]), "frame {index}");
    }
    // backwards, and far ahead
    assert!(same(&load(&in_order, 2), &frames[2]));
    assert_eq!(load(&in_order, 174).color_size, [2160, 1080]);
    assert!(same(&load(&in_order, 5), &frames[5]));
    assert!(Arc::ptr_eq(&load(&in_order, 5), &load(&in_order.clone(), 5)), "who asks again shares it");
}

#[test]
fn codes_mean_what_the_tags_say() {
    let folder = Folder::empty();
    let size = [4, 2];
    let plane = |codes: [u16; 3], deep: bool| -> Vec<u8> {
        let bytes = |code: u16| if deep { code.to_le_bytes().to_vec() } else { vec![code as u8] };
        codes.iter().flat_map(|code| bytes(*code).repeat(8)).collect()
    };
    let srgb = |code: f32| if code <= 0.04045 { code / 12.92 } else { ((code + 0.055) / 1.055).powf(2.4) };
    for (name, format, tags, codes, expected) in [
        // 75 % red in both ranges and three matrices: Y'CbCr by their definitions
        ("limited 709", "yuv444p", "-colorspace bt709 -color_range tv", [51, 109, 212], [srgb(0.75), 0.0, 0.0]),
        ("full 709", "yuv444p", "-colorspace bt709 -color_range pc", [41, 106, 223], [srgb(0.75), 0.0, 0.0]),
        ("limited 601", "yuv444p", "-colorspace smpte170m -color_range tv", [65, 100, 212], [srgb(0.75), 0.0, 0.0]),
        ("untagged, small", "yuv444p", "", [65, 100, 212], [srgb(0.75), 0.0, 0.0]),
        ("10 bits", "yuv444p10le", "-colorspace bt709 -color_range tv", [502, 512, 512], [srgb(0.5); 3]),
        ("rgb", "gbrp", "", [128, 0, 255], [1.0, srgb(128.0 / 255.0), 0.0]),
        ("grey", "gray", "", [128, 0, 0], [srgb(128.0 / 255.0); 3]),
        (
            "PQ, 203 cd/m²",
            "yuv444p10le",
            "-colorspace bt2020nc -color_trc smpte2084 -color_primaries bt2020 -color_range tv",
            [573, 512, 512],
            [1.0; 3],
        ),
        (
            "PQ, 1000 cd/m²",
            "yuv444p10le",
            "-colorspace bt2020nc -color_trc smpte2084 -color_primaries bt2020 -color_range tv",
            [723, 512, 512],
            [1000.0 / 203.0; 3],
        ),
        (
            "HLG, 75 %",
            "yuv444p10le",
            "-colorspace bt2020nc -color_trc arib-std-b67 -color_primaries bt2020 -color_range tv",
            [721, 512, 512],
            [1.0; 3],
        ),
        ("linear", "gbrp", "-color_trc linear", [51, 0, 255], [1.0, 0.2, 0.0]),
    ] {
        let deep = format.contains("10");
        let raw = if format == "gray" { plane(codes, deep)[..8].to_vec() } else { plane(codes, deep) };
        lossless(&folder, "v.mkv", size, format, tags, &raw);
        let frame = load(&open(&folder, "color = 'v.mkv'\ndepth = 2"), 0);
        let texel = frame.radiance.at(5);
        let near = |c: usize| (texel[c] - expected[c]).abs() < 0.012 * expected[c].max(1.0);
        assert!((0..3).all(near), "{name}: {texel:?}, not {expected:?}");
    }
}

#[test]
fn depth_comes_beside_below_or_from_another_file() {
    let folder = Folder::empty();
    // 4×2 of colour and of codes 100, in two arrangements and as two files
    let grey = |luma: u8, count: usize| vec![luma; count];
    let stacked = [grey(200, 8), grey(100, 8)].concat();
    lossless(&folder, "tb.mkv", [4, 4], "gray", "", &stacked);
    let beside: Vec<u8> = (0..2).flat_map(|_| [grey(200, 4), grey(100, 4)].concat()).collect();
    lossless(&folder, "lr.mkv", [8, 2], "gray", "", &beside);
    lossless(&folder, "c.mkv", [4, 2], "gray", "", &grey(200, 8).repeat(3));
    lossless(&folder, "d.mkv", [4, 2], "gray", "", &[grey(100, 8), grey(50, 8), grey(25, 8)].concat());
    let deep: Vec<u8> = [400_u16; 8].iter().flat_map(|code| code.to_le_bytes()).collect();
    lossless(&folder, "d10.mkv", [4, 2], "gray10le", "", &deep);
    for (panorama, metres) in [
        ("color = 'tb.mkv'\npacking = 'top-bottom'\nscale = 0.01", 1.0),
        ("color = 'lr.mkv'\npacking = 'left-right'\nscale = 0.01", 1.0),
        ("color = 'c.mkv'\ndepth = 'd.mkv'\nscale = 0.01", 1.0),
        ("color = 'c.mkv'\ndepth = 'd10.mkv'\nframes = [0, 0]\nscale = 0.01", 4.0),
        ("color = 'c.mkv'\ndepth = 3.5", 3.5),
    ] {
        let frame = load(&open(&folder, panorama), 0);
        assert_eq!((frame.color_size, frame.depth_size), ([4, 2], [4, 2]), "{panorama}");
        assert!(frame.depth.iter().all(|depth| (depth - metres).abs() < 1e-4), "{panorama}: {}", frame.depth[0]);
        assert!((frame.radiance.at(3)[0] - 0.5776).abs() < 1e-3, "{panorama}");
    }
    // a still picture of depth, and a sequence of it that counts from 1
    image::GrayImage::from_pixel(4, 2, image::Luma([77])).save(folder.path("d.png")).expect("saved");
    let source = open(&folder, "color = 'c.mkv'\ndepth = 'd.png'\nscale = 0.01");
    assert!(source.frame_count() == 3 && (load(&source, 2).depth[0] - 0.77).abs() < 1e-4);
    for number in 1..=3_u8 {
        let name = folder.path(&format!("d{number:03}.png"));
        image::GrayImage::from_pixel(4, 2, image::Luma([10 * number])).save(name).expect("saved");
    }
    let source = open(&folder, "color = 'c.mkv'\ndepth = 'd%03d.png'\nscale = 0.01");
    assert!((load(&source, 1).depth[0] - 0.2).abs() < 1e-4);
    // frames that are chosen
    let source = open(&folder, "color = 'c.mkv'\ndepth = 'd.mkv'\nscale = 0.01\nframes = [0, 2, 2]");
    assert_eq!((source.frame_count(), source.fps), (2, 12.5));
    assert!((load(&source, 1).depth[0] - 0.25).abs() < 1e-4);
    // equal pictures are one frame, which is processed once
    let still = open(&folder, "color = 'c.mkv'\ndepth = 2");
    assert!(Arc::ptr_eq(&load(&still, 0), &load(&still, 1)) && Arc::ptr_eq(&load(&still, 1), &load(&still, 2)));
}

#[test]
fn time_stamps_and_rotation_are_followed() {
    let folder = Folder::empty();
    let source = "-f lavfi -i testsrc2=size=32x16:rate=10:duration=1";
    ffmpeg(
        &folder,
        &format!("{source} -vf select='eq(n,0)+eq(n,1)+eq(n,5)+eq(n,9)' -fps_mode passthrough -c:v ffv1 v.mkv"),
    );
    let panorama = open(&folder, "color = 'v.mkv'\ndepth = 2");
    assert!(panorama.frame_count() == 4 && panorama.video().is_some_and(|video| video.varies));
    for (time, index) in [(-1.0, 0), (0.05, 0), (0.1, 1), (0.49, 1), (0.5, 2), (0.89, 2), (0.95, 3), (9.0, 3)] {
        assert_eq!(panorama.frame_at(time), index, "{time} s");
    }
    assert!((0..4).all(|i| panorama.frame_at(panorama.frame_time(i)) == i));

    // Upside down: the matrix of the track's header turns by 180°.
    ffmpeg(&folder, &format!("{source} -frames:v 2 -c:v libx264 -qp 0 -pix_fmt yuv444p v.mp4"));
    let upright = load(&open(&folder, "color = 'v.mp4'\ndepth = 2"), 0);
    let mut bytes = std::fs::read(folder.path("v.mp4")).expect("read");
    let header = bytes.windows(4).position(|word| word == b"tkhd").expect("a header") + 44;
    let fixed = |value: i32| (value * 65536).to_be_bytes();
    for (at, value) in [(0, -1), (16, -1), (24, 32), (28, 16)] {
        bytes[header + at..header + at + 4].copy_from_slice(&fixed(value));
    }
    std::fs::write(folder.path("turned.mp4"), bytes).expect("written");
    let source = open(&folder, "color = 'turned.mp4'\ndepth = 2");
    assert_eq!(source.video().map(|video| video.rotation.rem_euclid(360)), Some(180));
    let turned = load(&source, 0);
    let near = |a: &[f32; 4], b: &[f32; 4]| (0..3).all(|c| (a[c] - b[c]).abs() < 0.02);
    let agree = upright.radiance.iter().zip(turned.radiance.iter().rev()).filter(|(a, b)| near(a, b)).count();
    assert!(agree > 32 * 16 * 95 / 100, "{agree}");
}

/// Time stamps of a camera whose clock is uneven, and a video of which frames were left out.
#[test]
fn uneven_time_stamps_are_no_damage_and_give_a_usual_rate() {
    let folder = Folder::empty();
    ffmpeg(&folder, "-f lavfi -i testsrc2=size=64x32:rate=30:duration=1 -c:v ffv1 even.mkv");
    ffmpeg(&folder, "-i even.mkv -c copy -bsf:v setts=ts=round(N*33.3+6*mod(N*7\\,5)) uneven.mkv");
    let output = folder.run("check uneven.mkv");
    let said = [output.stdout, output.stderr].map(|bytes| String::from_utf8_lossy(&bytes).into_owned()).concat();
    assert!(said.contains("not equally far apart") && !said.contains("damaged"), "{said}");
    let kept = "-vf select='not(eq(mod(n,7),3))' -fps_mode passthrough";
    for (rate, name) in [("30", "30/1"), ("30000/1001", "30000/1001"), ("24000/1001", "24000/1001")] {
        let source = format!("-f lavfi -i testsrc2=size=64x32:rate={rate}:duration=3");
        ffmpeg(&folder, &format!("{source} {kept} -c:v ffv1 left.mkv"));
        folder.write("scene.toml", "[panorama]\ncolor = 'left.mkv'\ndepth = 2\n");
        folder.succeeds("render scene.toml -o out.mp4 --size 32x16 --warmup 0 --frames 0..59 -q");
        let ask = "-v error -show_entries stream=r_frame_rate -of csv=p=0 out.mp4";
        let output = Command::new("ffprobe").args(ask.split(' ')).current_dir(folder.root()).output().expect("runs");
        assert_eq!(String::from_utf8_lossy(&output.stdout).trim(), name);
    }
}

#[test]
fn depth_of_another_rate_is_matched_and_told() {
    let folder = Folder::empty();
    let grey = |name: &str, rate: u32, count: usize| {
        let raw: Vec<u8> = (0..count).flat_map(|number| vec![10 + 10 * number as u8; 8]).collect();
        std::fs::write(folder.path("raw"), raw).expect("written");
        let source = format!("-f rawvideo -pix_fmt gray -s 4x2 -r {rate} -i raw");
        ffmpeg(&folder, &format!("{source} -c:v ffv1 {name}"));
    };
    grey("c.mkv", 30, 8);
    grey("half.mkv", 15, 6);
    grey("short.mkv", 15, 3);
    grey("named.mkv", 10, 8);
    let metres = |depth: &str, index: usize| {
        let source = open(&folder, &format!("color = 'c.mkv'\ndepth = '{depth}'\nscale = 0.01"));
        assert!(source.warnings.iter().any(|w| w.contains(depth) && w.contains("colour has 30")), "{depth}");
        load(&source, index).depth[0]
    };
    assert!((metres("half.mkv", 3) - 0.2).abs() < 1e-4 && (metres("half.mkv", 7) - 0.4).abs() < 1e-4);
    assert!((metres("named.mkv", 7) - 0.8).abs() < 1e-4, "as many frames go by number");
    let Err(line) = try_open(&folder, "color = 'c.mkv'\ndepth = 'short.mkv'") else { panic!("depth ends too early") };
    assert!(line.contains("short.mkv") && line.contains("frames = [0, 5]"), "{line}");
}

/// A child that something else ends, as the kernel does where memory is short, is not taken for a damaged file.
#[test]
#[cfg(unix)]
fn a_killed_child_is_named() {
    use std::os::unix::fs::PermissionsExt;
    let folder = Folder::empty();
    ffmpeg(&folder, "-f lavfi -i testsrc2=size=64x32:rate=25:duration=1 -c:v ffv1 v.mkv");
    folder.write("scene.toml", "[panorama]\ncolor = 'v.mkv'\ndepth = 2\n");
    folder.write("still.toml", "[panorama]\ncolor = 'v.png'\ndepth = 2\n");
    ffmpeg(&folder, "-i v.mkv -frames:v 1 v.png");
    // An ffmpeg that ends itself where it would decode or encode.
    let real = Command::new("sh").args(["-c", "command -v ffmpeg"]).output().expect("runs").stdout;
    let real = String::from_utf8_lossy(&real).trim().to_owned();
    std::fs::create_dir(folder.path("bin")).expect("made");
    let script = format!("#!/bin/sh\ncase \"$*\" in *rawvideo*) kill -9 $$;; esac\nexec {real} \"$@\"\n");
    folder.write("bin/ffmpeg", &script);
    std::fs::set_permissions(folder.path("bin/ffmpeg"), std::fs::Permissions::from_mode(0o755)).expect("set");
    let path = format!("{}:{}", folder.path("bin").display(), std::env::var("PATH").expect("set"));
    for (arguments, file) in [
        ("render scene.toml -o a.png --size 32x16 --warmup 0 -q", "v.mkv"),
        ("render still.toml -o a.mp4 --size 32x16 --warmup 0 -q", "a.mp4"),
    ] {
        let output = folder.command().args(arguments.split(' ')).env("PATH", &path).output().expect("runs");
        let said = String::from_utf8_lossy(&output.stderr);
        assert!(!output.status.success() && said.trim().lines().count() == 1, "{said}");
        assert!(said.contains(file) && said.contains("ended from outside, by signal 9"), "{said}");
        assert!(!said.contains("damaged") && !said.contains("--codec"), "{said}");
    }
}

#[test]
fn what_cannot_be_used_is_one_clear_line() {
    let folder = Folder::empty();
    let refused = |panorama: &str, words: &[&str]| {
        let line = match try_open(&folder, panorama) {
            Err(line) => line,
            Ok(scene) => (0..scene.panorama.frame_count())
                .find_map(|index| scene.panorama.load(index).err())
                .unwrap_or_else(|| panic!("{panorama}: no error"))
                .to_string(),
        };
        assert!(!line.contains('\n') && words.iter().all(|word| line.contains(word)), "{panorama}: {line}");
    };
    ffmpeg(&folder, "-f lavfi -i testsrc2=size=64x32:rate=25:duration=2 -c:v libx264 -movflags +faststart v.mp4");
    ffmpeg(&folder, "-f lavfi -i color=gray:size=64x32:rate=25:duration=1 -c:v ffv1 -pix_fmt gray short.mkv");
    ffmpeg(&folder, "-f lavfi -i sine=duration=1 -c:a aac sound.mp4");
    let whole = std::fs::read(folder.path("v.mp4")).expect("read");
    std::fs::write(folder.path("cut.mp4"), &whole[..whole.len() - 500]).expect("written");
    ffmpeg(&folder, "-i v.mp4 -c copy v.mkv");
    let matroska = std::fs::read(folder.path("v.mkv")).expect("read");
    std::fs::write(folder.path("cut.mkv"), &matroska[..matroska.len() * 3 / 4]).expect("written");
    std::fs::write(folder.path("head.mp4"), &whole[..60]).expect("written");
    std::fs::write(folder.path("text.mp4"), "no video").expect("written");
    std::fs::write(folder.path("empty.mp4"), "").expect("written");
    refused("color = 'nowhere.mp4'\ndepth = 2", &["nowhere.mp4", "no such file"]);
    refused("color = 'empty.mp4'\ndepth = 2", &["empty.mp4", "empty"]);
    refused("color = 'text.mp4'\ndepth = 2", &["text.mp4", "cannot be read as a video"]);
    refused("color = 'head.mp4'\ndepth = 2", &["head.mp4", "copy it again"]);
    refused("color = 'sound.mp4'\ndepth = 2", &["sound.mp4", "no video stream, but audio"]);
    refused("color = 'cut.mp4'\ndepth = 2", &["cut.mp4", "cut off", "of its 50 frames", "frames = [0, "]);
    refused(
        "color = 'v.mp4'\ndepth = 'short.mkv'",
        &["short.mkv", "has 25 frames, but the colour has 50", "frames = [0, 24]"],
    );
    refused("color = 'v.mp4'\ndepth = 2\nframes = [0, 50]", &["v.mp4", "no frame 50", "0 to 49"]);
    refused("color = { file = 'v.mp4', layer = 'a' }\ndepth = 2", &["v.mp4", "no layers"]);
    refused("color = 'v.mp4'\npacking = 'top-bottom'", &["v.mp4", "in colour"]);
    refused("color = 'v.mp4'\ndepth = 2\nmask = 'v.mp4'", &["v.mp4", "one picture is needed"]);
    folder.fails("check cut.mp4", &["cut.mp4", "of its 50 frames"]);

    // Without ffmpeg the status is 2, and the line says how to get it.
    folder.write("scene.toml", "[panorama]\ncolor = 'v.mp4'\ndepth = 2\n");
    for arguments in [&["render", "scene.toml", "-o", "a.png"][..], &["check", "v.mp4"]] {
        let output = folder.command().args(arguments).env("PATH", folder.root()).output().expect("runs");
        let stderr = String::from_utf8_lossy(&output.stderr);
        assert_eq!(output.status.code(), Some(2), "{stderr}");
        assert!(stderr.trim_end().lines().count() == 1 && stderr.contains("apt-get install ffmpeg"), "{stderr}");
    }
}

#[test]
fn check_shows_what_it_understood_of_a_video() {
    let folder = Folder::empty();
    let video = data("rgbd/kandao/kandao.mp4");
    let printed = folder.succeeds_with(&["check", &video.display().to_string()]);
    for words in ["h264 2160x2160", "175, 30 a second", "matrix bt709", "limited range", "assumed", "aac", "top-bottom"]
    {
        assert!(printed.contains(words), "no \"{words}\" in {printed}");
    }
    let json = folder.succeeds_with(&["check", &video.display().to_string(), "--json"]);
    let json: serde_json::Value = serde_json::from_str(&json).expect("JSON");
    assert_eq!((&json["frames"], &json["packing"]), (&175.into(), &"top-bottom".into()));
    assert!(Path::new(json["file"].as_str().expect("a name")).exists());
}

/// What the disparity's offset is, nobody says.
#[test]
fn a_new_scene_of_real_disparity_has_a_level_floor_with_the_object_on_it() {
    let folder = Folder::empty();
    let [color, depth] = ["0060_rgb.jpg", "0060_disp.png"].map(|name| data(&format!("rgbd/kandao/{name}")));
    let [color, depth] = [color.display().to_string(), depth.display().to_string()];
    folder.succeeds_with(&["new", &color, &depth, "-o", "scene.toml"]);
    let report: serde_json::Value = serde_json::from_str(&folder.succeeds("check scene.toml --json -q")).expect("JSON");
    let (tilt, height) = (&report["floor"]["tilt"], &report["floor"]["distance"]);
    assert!(tilt.as_f64().is_some_and(|tilt| tilt < 6.0), "tilted by {tilt}");
    assert!(height.as_f64().is_some_and(|height| (1.4..1.8).contains(&height)), "{height} m high");
    let warnings = report["warnings"].to_string();
    assert!(!warnings.contains("object"), "{warnings}");
}

/// From a video to a picture with an object in it, with no tool in between.
#[test]
fn a_scene_file_is_written_for_a_video() {
    let folder = Folder::empty();
    let video = data("rgbd/kandao/kandao.mp4");
    folder.succeeds_with(&["new", &video.display().to_string(), "-o", "scene.toml"]);
    let text = std::fs::read_to_string(folder.path("scene.toml")).expect("written");
    assert!(text.contains("packing = \"top-bottom\"") && text.contains("encoding = \"disparity\""), "{text}");
    folder.succeeds("render scene.toml -o a.png --size 64x36 --warmup 1 -q --validation");
    assert_eq!(image::open(folder.path("a.png")).expect("a picture").width(), 64);
}

/// Motion JPEG in AVI, which counts an empty chunk as a frame.
#[test]
fn a_whole_avi_is_not_called_cut_off() {
    let folder = Folder::empty();
    ffmpeg(&folder, "-f lavfi -i testsrc2=size=64x32:rate=25:duration=1 -c:v mjpeg v.avi");
    let source = open(&folder, "color = 'v.avi'\ndepth = 3");
    assert_eq!(source.frame_count(), 25);
    folder.succeeds("check scene.toml");
}
