//! Videos as output: what players find in them, what is lost and what is not, and what becomes of a run that stops.

use crate::{folder::Folder, video_in::ffmpeg};
use std::{
    io::Read,
    process::{Command, Stdio},
};

/// What `ffprobe` says of a file, as JSON.
fn probe(folder: &Folder, name: &str) -> serde_json::Value {
    let mut command = Command::new("ffprobe");
    command.args(["-v", "error", "-print_format", "json", "-show_format", "-show_streams", "-count_frames", name]);
    let output = command.current_dir(folder.root()).output().expect("ffprobe is installed");
    assert!(output.status.success(), "{name}: {}", String::from_utf8_lossy(&output.stderr));
    serde_json::from_slice(&output.stdout).expect("JSON")
}

fn stream<'a>(probed: &'a serde_json::Value, kind: &str) -> &'a serde_json::Value {
    let streams = probed["streams"].as_array().expect("streams");
    streams.iter().find(|stream| stream["codec_type"] == kind).unwrap_or_else(|| panic!("no {kind} in {probed}"))
}

/// All codes of a video's frames.
fn codes(folder: &Folder, words: &str) -> Vec<u8> {
    ffmpeg(folder, &format!("{words} -f rawvideo out.raw"));
    std::fs::read(folder.path("out.raw")).expect("written")
}

/// Twelve frames of 64×32 colour over grey depth, with sound; a ball stands before the wall.
fn packed(folder: &Folder, encoder: &str) {
    let picture =
        "-f lavfi -i testsrc2=size=64x32:rate=24000/1001 -f lavfi -i color=0x808080:size=64x32:rate=24000/1001";
    let sound = "-f lavfi -i sine=frequency=300";
    let join = "-filter_complex [0][1]vstack -frames:v 12 -t 0.5005";
    ffmpeg(folder, &format!("{picture} {sound} {join} {encoder} -c:a aac packed.mp4"));
    folder.write("scene.toml", SCENE);
}

const SCENE: &str = r#"
[panorama]
color = "packed.mp4"
packing = "top-bottom"
scale = 0.02
[camera]
position = [0, 0, 0]
size = [64, 32]
[[object]]
name = "ball"
shape = "sphere"
size = 0.4
translation = [0, 0, -1.5]
"#;

const BT709: &str =
    "-c:v libx264 -crf 12 -pix_fmt yuv420p -colorspace bt709 -color_primaries bt709 -color_trc bt709 -color_range tv";

#[test]
fn a_video_has_the_rate_the_sound_and_the_colours_of_its_source() {
    let folder = Folder::empty();
    packed(&folder, BT709);
    let flags = "--warmup 1 --projection equirect --validation";
    for (name, codec, more) in [
        ("out.mp4", "h264", ""),
        ("out.mov", "prores", "--codec prores"),
        ("out.webm", "vp9", ""),
        ("out.mkv", "ffv1", "--codec ffv1"),
        ("hevc.mp4", "hevc", "--codec hevc --pix-fmt yuv420p10"),
    ] {
        let printed = folder.succeeds(&format!("render scene.toml -o {name} {flags} {more}"));
        assert_eq!(printed.trim(), name);
        let probed = probe(&folder, name);
        let video = stream(&probed, "video");
        assert_eq!((&video["codec_name"], &video["nb_read_frames"]), (&codec.into(), &"12".into()), "{name}");
        assert_eq!((&video["width"], &video["height"]), (&64.into(), &32.into()), "{name}");
        assert_eq!(video["r_frame_rate"], "24000/1001", "{name}");
        for tag in ["color_space", "color_primaries", "color_transfer"] {
            assert_eq!(video[tag], "bt709", "{name}: {tag}");
        }
        assert_eq!(video["color_range"], "tv", "{name}");
        if codec == "hevc" {
            assert_eq!((&video["pix_fmt"], &video["codec_tag_string"]), (&"yuv420p10le".into(), &"hvc1".into()));
        }
        let wanted = if name == "out.webm" { "opus" } else { "aac" };
        assert_eq!(stream(&probed, "audio")["codec_name"], wanted, "{name}");
        // 360° for players, and still after another program has copied the streams
        let spherical = |probed: &serde_json::Value| stream(probed, "video")["side_data_list"].to_string();
        assert!(spherical(&probed).contains("equirectangular"), "{name}: {}", spherical(&probed));
        ffmpeg(&folder, &format!("-i {name} -c copy -strict unofficial again.mkv"));
        assert!(spherical(&probe(&folder, "again.mkv")).contains("equirectangular"), "{name}, copied");
    }
    ffmpeg(&folder, "-i out.mp4 -c copy -strict unofficial again.mp4");
    assert!(stream(&probe(&folder, "again.mp4"), "video")["side_data_list"].to_string().contains("equirectangular"));
    // Version 1 alone is understood, too: another box's name hides version 2.
    let mut bytes = std::fs::read(folder.path("out.mp4")).expect("read");
    let at = bytes.windows(4).position(|word| word == b"sv3d").expect("version 2");
    bytes[at..at + 4].copy_from_slice(b"free");
    std::fs::write(folder.path("v1.mp4"), &bytes).expect("written");
    assert!(stream(&probe(&folder, "v1.mp4"), "video")["side_data_list"].to_string().contains("equirectangular"));

    folder.succeeds("render scene.toml -o flat.mp4 --warmup 0 --frames 2..4 --no-audio -q");
    let probed = probe(&folder, "flat.mp4");
    assert_eq!(stream(&probed, "video")["nb_read_frames"], "3");
    assert!(probed["streams"].as_array().expect("streams").len() == 1 && !probed.to_string().contains("equirect"));
    let left: Vec<_> = folder.root().read_dir().expect("readable").map(|f| f.expect("readable").file_name()).collect();
    assert!(left.iter().all(|name| !name.to_string_lossy().starts_with('.')), "{left:?}");
}

/// Where no object has influence, a lossless video has the source's own codes.
#[test]
fn only_the_encoder_loses_what_no_object_influences() {
    let folder = Folder::empty();
    for encoder in [
        BT709,
        "-c:v libx264 -crf 12 -pix_fmt yuvj420p",
        "-c:v libx265 -crf 12 -pix_fmt yuv420p10le -x265-params log-level=error",
    ] {
        packed(&folder, encoder);
        let flags = "--projection equirect --warmup 0 --frames 0..3 -q";
        folder.succeeds(&format!("render scene.toml -o plate.mkv --codec ffv1 {flags} --without-objects"));
        folder.succeeds(&format!("render scene.toml -o with.mkv --codec ffv1 {flags}"));
        let source = codes(&folder, "-i packed.mp4 -vf crop=64:32:0:0 -frames:v 4");
        assert_eq!(codes(&folder, "-i plate.mkv"), source, "{encoder}");
        let with = codes(&folder, "-i with.mkv");
        let differ = with.iter().zip(&source).filter(|(a, b)| a != b).count();
        assert!(with.len() == source.len() && differ > 20, "{encoder}: the ball is seen");
        assert!(differ < source.len() / 2, "{encoder}: {differ} of {} codes", source.len());
    }
    // the lossless kind of a lossy codec
    folder.succeeds("render scene.toml -o l.mp4 --codec hevc --crf 0 --without-objects --projection equirect --warmup 0 --frames 0..3 -q");
    assert_eq!(codes(&folder, "-i l.mp4"), codes(&folder, "-i packed.mp4 -vf crop=64:32:0:0 -frames:v 4"));
}

/// Saturated colours of BT.2020 and P3, most of which Rec. 709 has not.
#[test]
fn wide_gamuts_come_through() {
    let folder = Folder::empty();
    folder.write(
        "scene.toml",
        &SCENE.replace("packed.mp4", "wide.mkv").replace("packing = \"top-bottom\"\nscale = 0.02", "depth = 3"),
    );
    for (pixels, tags) in [
        ("yuv422p10le", "-colorspace bt2020nc -color_primaries bt2020 -color_trc bt2020-10 -color_range tv"),
        ("yuv444p10le", "-colorspace bt2020nc -color_primaries bt2020 -color_trc smpte2084 -color_range tv"),
        ("yuv420p", "-colorspace bt709 -color_primaries smpte432 -color_trc bt709 -color_range tv"),
    ] {
        let matrix = if tags.contains("bt2020nc") { "bt2020" } else { "bt709" };
        let video =
            format!("-vf format=gbrp,scale=out_color_matrix={matrix},format={pixels} -c:v ffv1 {tags} wide.mkv");
        ffmpeg(&folder, &format!("-f lavfi -i rgbtestsrc=size=64x32:rate=25 -frames:v 2 {video}"));
        let flags = "--projection equirect --warmup 0 --frames 0..1 -q --codec ffv1";
        folder.succeeds(&format!("render scene.toml -o plate.mkv {flags} --without-objects"));
        assert_eq!(codes(&folder, "-i plate.mkv"), codes(&folder, "-i wide.mkv"), "{tags}");

        // In another view, too, where no pixel is the source's own.
        ffmpeg(&folder, &format!("-f lavfi -i color=0x10e020:size=64x32:rate=25 -frames:v 2 {video}"));
        folder.succeeds("render scene.toml -o flat.mkv --codec ffv1 --without-objects --warmup 0 --frames 0..0 -q");
        let middle = |file: &str| codes(&folder, &format!("-i {file} -vf crop=2:2:30:14 -frames:v 1"));
        assert_eq!(middle("flat.mkv"), middle("wide.mkv"), "{tags}");
    }
}

/// What is asked to be lossless is, and what an encoder does not hold is told.
#[test]
fn pixels_are_kept_where_the_codec_can() {
    let folder = Folder::empty();
    folder.write(
        "scene.toml",
        &SCENE.replace("packed.mp4", "v.mkv").replace("packing = \"top-bottom\"\nscale = 0.02", "depth = 3"),
    );
    let flags = "--projection equirect --without-objects --warmup 0 --frames 0..1 -q";
    let tags = "-colorspace bt709 -color_primaries bt709 -color_trc bt709 -color_range tv";
    for pixels in ["yuv422p10le", "yuv444p"] {
        ffmpeg(
            &folder,
            &format!("-f lavfi -i testsrc2=size=64x32:rate=25 -frames:v 2 -c:v ffv1 -pix_fmt {pixels} {tags} v.mkv"),
        );
        for codec in ["h264", "hevc", "vp9"] {
            folder.succeeds(&format!("render scene.toml -o out.mp4 --codec {codec} --crf 0 {flags} --strict"));
            assert_eq!(stream(&probe(&folder, "out.mp4"), "video")["pix_fmt"], pixels, "{codec}");
            assert_eq!(codes(&folder, "-i out.mp4"), codes(&folder, "-i v.mkv"), "{codec}, {pixels}");
        }
    }
    let wide = "-colorspace bt2020nc -color_primaries bt2020 -color_trc smpte2084 -color_range tv";
    ffmpeg(
        &folder,
        &format!("-f lavfi -i testsrc2=size=64x32:rate=25 -frames:v 2 -c:v ffv1 -pix_fmt yuv420p12le {wide} v.mkv"),
    );
    folder.succeeds(&format!("render scene.toml -o out.mp4 --codec h264 {flags}"));
    assert_eq!(stream(&probe(&folder, "out.mp4"), "video")["pix_fmt"], "yuv420p10le");
    let output = folder.run(&format!("render scene.toml -o out.mp4 --codec h264 --crf 0 {}", flags.replace(" -q", "")));
    let said = String::from_utf8_lossy(&output.stderr);
    assert!(output.status.success() && said.contains("libx264 does not hold yuv420p12le: yuv420p10le"), "{said}");
    folder.fails(
        &format!("render scene.toml -o out.mp4 --codec h264 --pix-fmt yuv444p12 {flags}"),
        &["--pix-fmt", "libx264 does not hold yuv444p12le", "yuv444p10le"],
    );
}

#[test]
fn hdr_goes_out_as_it_came_in() {
    let folder = Folder::empty();
    for (transfer, more) in [
        (
            "smpte2084",
            ":hdr10=1:master-display=G(13250,34500)B(7500,3000)R(34000,16000)WP(15635,16450)L(10000000,1):max-cll=900,300",
        ),
        ("arib-std-b67", ""),
    ] {
        let tags = format!("-colorspace bt2020nc -color_primaries bt2020 -color_trc {transfer} -color_range tv");
        let params =
            format!("-x265-params log-level=error:colorprim=bt2020:transfer={transfer}:colormatrix=bt2020nc{more}");
        packed(&folder, &format!("-c:v libx265 -crf 8 -pix_fmt yuv420p10le {tags} {params}"));
        folder.succeeds(
            "render scene.toml -o out.mp4 --projection equirect --warmup 0 --frames 0..1 --without-objects -q",
        );
        let probed = probe(&folder, "out.mp4");
        let video = stream(&probed, "video");
        assert_eq!((&video["codec_name"], &video["pix_fmt"]), (&"hevc".into(), &"yuv420p10le".into()));
        assert_eq!((&video["color_transfer"], &video["color_primaries"]), (&transfer.into(), &"bt2020".into()));
        let frames = ["-v", "error", "-show_frames", "-print_format", "json", "out.mp4"];
        let output = Command::new("ffprobe").args(frames).current_dir(folder.root()).output().expect("runs");
        let text = String::from_utf8_lossy(&output.stdout).into_owned();
        assert_eq!(text.contains("Mastering display metadata"), transfer == "smpte2084", "{text}");
    }
}

#[test]
fn a_stream_goes_to_whoever_reads_it() {
    let folder = Folder::empty();
    packed(&folder, BT709);
    let run = |arguments: &str| {
        let output = folder.run(arguments);
        assert!(output.status.success() && output.stderr.is_empty(), "{}", String::from_utf8_lossy(&output.stderr));
        output.stdout
    };
    let flags = "--projection equirect --without-objects --warmup 0 --frames 0..2 -q";
    let y4m = run(&format!("render scene.toml -o - {flags}"));
    std::fs::write(folder.path("a.y4m"), &y4m).expect("written");
    let probed = probe(&folder, "a.y4m");
    let video = stream(&probed, "video");
    assert_eq!((&video["nb_read_frames"], &video["r_frame_rate"]), (&"3".into(), &"24000/1001".into()));
    assert_eq!(codes(&folder, "-i a.y4m"), codes(&folder, "-i packed.mp4 -vf crop=64:32:0:0 -frames:v 3"));
    assert_eq!(run(&format!("render scene.toml -o - --pix-fmt rgb24 {flags}")).len(), 3 * 64 * 32 * 3);
    assert_eq!(run(&format!("render scene.toml -o - --pix-fmt yuv420p10 {flags}")).len(), 3 * 64 * 32 * 3);
    folder.fails("render scene.toml -q -o - --pix-fmt purple", &["--pix-fmt", "purple"]);

    // Who reads one frame and leaves is not told off.
    let mut child = folder
        .command()
        .args("render scene.toml -o - --pix-fmt rgb48 --warmup 0 -q".split_whitespace())
        .stdout(Stdio::piped())
        .stderr(Stdio::piped())
        .spawn()
        .expect("starts");
    let mut frame = vec![0; 64 * 32 * 6];
    child.stdout.take().expect("a pipe").read_exact(&mut frame).expect("a frame");
    let output = child.wait_with_output().expect("ends");
    assert_eq!(
        (output.status.code(), output.stderr.len()),
        (Some(0), 0),
        "{}",
        String::from_utf8_lossy(&output.stderr)
    );
}

/// A run that is stopped leaves no file of that name, and the same command goes on.
#[test]
fn an_interrupted_video_goes_on() {
    let folder = Folder::empty();
    ffmpeg(&folder, &format!("-f lavfi -i testsrc2=size=64x32:rate=25:duration=6 {BT709} v.mp4"));
    folder.write(
        "scene.toml",
        &SCENE.replace("packed.mp4", "v.mp4").replace("packing = \"top-bottom\"\nscale = 0.02", "depth = 3"),
    );
    let arguments = "render scene.toml -o out.mp4 --warmup 2 --size 32x18 --frames 0..119";
    let mut child = folder.command().args(arguments.split_whitespace()).spawn().expect("starts");
    let parts = folder.path(".out.mp4.iprt-parts");
    let has_part = || {
        let files = std::fs::read_dir(&parts).into_iter().flatten().filter_map(Result::ok);
        files
            .map(|file| file.file_name().to_string_lossy().into_owned())
            .any(|name| name.ends_with(".nut") && name.starts_with("part"))
    };
    for _ in 0..3000 {
        if has_part() || child.try_wait().expect("is asked").is_some() {
            break;
        }
        std::thread::sleep(std::time::Duration::from_millis(20));
    }
    assert!(has_part(), "a part is written while it runs");
    child.kill().expect("killed");
    child.wait().expect("ends");
    assert!(!folder.path("out.mp4").exists(), "nothing half-written has the name");
    for name in ["short:1.mp4", "other.mp4"] {
        let copy = folder.path(&format!(".{name}.iprt-parts"));
        std::fs::create_dir(&copy).expect("made");
        for file in std::fs::read_dir(&parts).expect("is there").filter_map(Result::ok) {
            std::fs::copy(file.path(), copy.join(file.file_name())).expect("copied");
        }
    }
    let output = folder.run(arguments);
    let said = String::from_utf8_lossy(&output.stderr);
    assert!(output.status.success() && said.contains("goes on at frame 48"), "{said}");
    assert_eq!(stream(&probe(&folder, "out.mp4"), "video")["nb_read_frames"], "120");
    assert!(!parts.exists());

    // Parts of a longer run are none of a shorter one, and those of another source are none at all.
    folder.succeeds("render scene.toml -o short:1.mp4 --warmup 2 --size 32x18 --frames 0..29 -q");
    std::fs::rename(folder.path("short:1.mp4"), folder.path("short.mp4")).expect("renamed");
    assert_eq!(stream(&probe(&folder, "short.mp4"), "video")["nb_read_frames"], "30");
    ffmpeg(&folder, &format!("-f lavfi -i testsrc=size=64x32:rate=25:duration=6 {BT709} v.mp4"));
    let output = folder.run(&arguments.replace("out.mp4", "other.mp4").replace("0..119", "0..49"));
    let said = String::from_utf8_lossy(&output.stderr);
    assert!(output.status.success() && !said.contains("goes on"), "{said}");
    assert_eq!(stream(&probe(&folder, "other.mp4"), "video")["nb_read_frames"], "50");
}

/// Where nothing can be written, as on a full disk, nothing is left behind.
#[test]
#[cfg(unix)]
fn a_full_disk_leaves_no_folder_of_parts() {
    let folder = Folder::with_scene();
    // Files have no room for a byte.
    let line = format!(
        "trap '' XFSZ; ulimit -f 0; exec {} render scene.toml -o a.mp4 --size 32x16 --warmup 0 -q",
        env!("CARGO_BIN_EXE_iprt")
    );
    let output = Command::new("bash").args(["-c", &line]).current_dir(folder.root()).output().expect("runs");
    let said = String::from_utf8_lossy(&output.stderr);
    assert!(!output.status.success() && said.contains("cannot be written"), "{said}");
    let left: Vec<_> = folder.root().read_dir().expect("readable").map(|f| f.expect("readable").file_name()).collect();
    assert!(left.iter().all(|name| !name.to_string_lossy().starts_with('.')), "{left:?}");
}

#[test]
fn what_does_not_fit_is_told_before_anything_is_rendered() {
    let folder = Folder::empty();
    packed(&folder, BT709);
    for (arguments, words) in [
        ("-o a.webm --codec h264", &["--codec", "h264", "webm vp9"][..]),
        ("-o a.mp4 --codec prores", &["--codec", "prores", "mov"]),
        ("-o a.mp4 --crf 99", &["--crf", "99", "51"]),
        ("-o a.mov --codec prores --crf 3", &["--crf", "prores"]),
        ("-o a.mp4 --pix-fmt nonsense", &["--pix-fmt", "nonsense"]),
        ("-o a.mp4 --size 33x18", &["--size", "33x18", "even"]),
        ("-o a.png --codec h264", &["--codec", "a.png"]),
        ("-o missing/a.mp4", &["missing/a.mp4", "folder"]),
        ("-o a.mp4 --aov all", &["--aov", "exr"]),
        ("-o a.mp4 --codec av1 --pix-fmt gbrp", &["libsvtav1"]),
    ] {
        folder.fails(&format!("render scene.toml -q --warmup 0 --frames 0..0 {arguments}"), words);
    }
    assert!(!folder.path("a.mp4").exists());
}
