//! Inputs that a program must survive (`cases/faults` of the real data, whose README says what is right), and others of
//! their kinds: exit status 0 or 2, one line for each problem, and less than 2 GiB of memory.
#![cfg(unix)]

use crate::folder::Folder;
use std::{
    os::unix::process::ExitStatusExt,
    path::{Path, PathBuf},
    process::{ExitStatus, Stdio},
};

fn cases() -> PathBuf {
    let root = std::env::var_os("IPRT_DATA")
        .map_or_else(|| Path::new(env!("CARGO_MANIFEST_DIR")).join("../shared/data"), PathBuf::from);
    let folder = root.join("cases/faults");
    assert!(folder.is_dir(), "{}: there is no such folder; set IPRT_DATA", folder.display());
    folder
}

/// What became of a run.
struct Ran {
    status: Option<i32>,
    stderr: String,
    /// The most memory that it held, bytes.
    peak: u64,
}

#[allow(clippy::zombie_processes, reason = "wait4 waits for it, and says how much memory it took")]
fn run(folder: &Folder, arguments: &[&str]) -> Ran {
    let (file, mut usage, mut status) = (folder.path("stderr"), std::mem::MaybeUninit::<libc::rusage>::zeroed(), 0);
    let mut command = folder.command();
    let child = command
        .args(arguments)
        .stdout(Stdio::null())
        .stderr(std::fs::File::create(&file).expect("writes"))
        .spawn()
        .expect("starts");
    // SAFETY: the child is waited for here alone.
    let usage = unsafe {
        assert!(libc::wait4(child.id() as i32, &raw mut status, 0, usage.as_mut_ptr()) > 0);
        usage.assume_init()
    };
    let stderr = std::fs::read_to_string(&file).expect("text");
    assert!(!stderr.contains("panicked"), "iprt {arguments:?}: {stderr}");
    Ran { status: ExitStatus::from_raw(status).code(), stderr, peak: usage.ru_maxrss as u64 * 1024 }
}

/// Checks and renders a scene. The answers are the same, and memory is left.
fn survives(folder: &Folder, scene: &str, status: i32, words: &[&str]) {
    let _ = std::fs::remove_file(folder.path("a.exr"));
    for arguments in [&["check", scene][..], &["render", scene, "-o", "a.exr", "--size", "8x8", "--warmup", "0"]] {
        let ran = run(folder, arguments);
        let what = format!("iprt {arguments:?}, {} MiB: {}", ran.peak >> 20, ran.stderr);
        assert_eq!(ran.status, Some(status), "{what}");
        assert!(ran.peak < 2 << 30, "{what}");
        assert!(words.iter().all(|word| ran.stderr.contains(word)), "{words:?}: {what}");
        assert!(!ran.stderr.chars().any(|c| c.is_control() && c != '\n'), "{what}");
        if status == 0 {
            let picture = folder.path("a.exr");
            if arguments[0] == "render" {
                let image =
                    iprt::image_file::read::read(&picture).expect("an EXR").into_color("a.exr").expect("colour");
                assert!(image.texels.iter().flatten().all(|value| value.is_finite()), "{what}");
            }
        } else {
            assert!(!folder.path("a.exr").exists(), "{what}");
            let lines = ran.stderr.lines().filter(|line| !line.starts_with("warning: "));
            assert!(
                lines.clone().count() > 0 && lines.clone().all(|l| l.starts_with("iprt: ") || l.starts_with("error: ")),
                "{what}"
            );
        }
    }
}

#[test]
fn every_fault_case_is_survived() {
    let (folder, cases) = (Folder::empty(), cases());
    for (name, status, words) in [
        ("plain", 0, &[][..]),
        ("exr_claims", 2, &["exr_claims.exr"]),
        ("name_escape", 2, &["object[0].scale", "out of range"]),
        ("set_unknown", 2, &["nonsense"]),
        ("textures_huge", 0, &["reduced"]),
        ("yaw_1e300", 2, &["panorama.yaw", "1e300"]),
        ("thousand_spheres", 0, &[]),
    ] {
        let scene = cases.join(format!("{name}.toml"));
        survives(&folder, scene.to_str().expect("text"), status, words);
    }
    let known = ["plain", "exr_claims", "name_escape", "set_unknown", "textures_huge", "yaw_1e300", "thousand_spheres"];
    for entry in cases.read_dir().expect("readable").filter_map(Result::ok) {
        let path = entry.path();
        let stem = path.file_stem().and_then(|stem| stem.to_str()).expect("a name");
        assert!(path.extension().is_none_or(|e| e != "toml") || known.contains(&stem), "{stem} is not tried");
    }
}

/// A deflated PNG of one bit a pixel, all of them 0.
fn flat_png(path: &Path, width: u32, height: u32) {
    let file = std::fs::File::create(path).expect("writes");
    let mut encoder = png::Encoder::new(std::io::BufWriter::new(file), width, height);
    encoder.set_color(png::ColorType::Grayscale);
    encoder.set_depth(png::BitDepth::One);
    let mut writer = encoder.write_header().expect("a header");
    writer.write_image_data(&vec![0; width.div_ceil(8) as usize * height as usize]).expect("pixels");
}

/// The peak memory of a run that must succeed. Unlike that of [`run`] it leaves out what this process had when it began.
fn peak(folder: &Folder, arguments: &[&str]) -> u64 {
    let mut child = folder.command().args(arguments).stdout(Stdio::null()).spawn().expect("starts");
    let (file, mut peak) = (format!("/proc/{}/status", child.id()), 0);
    loop {
        let status = std::fs::read_to_string(&file).unwrap_or_default();
        let line = status.lines().find_map(|line| line.strip_prefix("VmHWM:"));
        let kib = line.and_then(|line| line.trim_end_matches("kB").trim().parse::<u64>().ok());
        peak = kib.map_or(peak, |kib| 1024 * kib);
        if let Some(status) = child.try_wait().expect("waits") {
            assert!(status.success(), "iprt {arguments:?}: {status}");
            return peak;
        }
        std::thread::sleep(std::time::Duration::from_millis(1));
    }
}

/// Writes the same picture as each kind of file. Its scene is called as the file.
fn large_pictures(folder: &Folder, [width, height]: [u32; 2]) -> [&'static str; 4] {
    let texel = |x: u32, y: u32| [(x / 64 % 200) as u8, (y / 64 % 200) as u8, 90];
    let picture = image::RgbImage::from_fn(width, height, |x, y| image::Rgb(texel(x, y)));
    picture.save(folder.path("a.png")).expect("writes");
    picture.save(folder.path("a.jpg")).expect("writes");
    let mut hdr = format!("#?RADIANCE\nFORMAT=32-bit_rle_rgbe\n\n-Y {height} +X {width}\n").into_bytes();
    hdr.extend(picture.pixels().flat_map(|p| [p.0[0].max(3), p.0[1], p.0[2], 128]));
    std::fs::write(folder.path("a.hdr"), hdr).expect("writes");
    let channel = |c: usize| picture.pixels().map(|p| f32::from(p.0[c]) / 255.0).collect();
    let channels = ["R", "G", "B"].iter().enumerate().map(|(c, name)| ((*name).to_owned(), channel(c))).collect();
    let layer = iprt::image_file::ExrLayer { name: String::new(), size: [width, height], channels };
    iprt::image_file::write::write_exr(&folder.path("a.exr"), &[layer]).expect("writes");
    ["a.png", "a.jpg", "a.hdr", "a.exr"]
}

/// What `docs/limits.md` states of the memory that a panorama takes.
#[test]
fn a_large_panorama_is_in_memory_once() {
    let (folder, size) = (Folder::empty(), [8192, 2048]);
    let texels = u64::from(size[0] * size[1]);
    for name in large_pictures(&folder, size) {
        folder.write("large.toml", &format!("[panorama]\ncolor = \"{name}\"\ndepth = 3\n"));
        let whole = peak(&folder, &["check", "large.toml"]);
        let depth = 4 * 4096 * 1024;
        let bounds = 8 * texels..8 * texels + depth + (80 << 20);
        assert!(bounds.contains(&whole), "{name}: {} MiB, not {bounds:?}", whole >> 20);
        let reduced = peak(&folder, &["check", "large.toml", "--panorama-size", "1024"]);
        let stored = if name == "a.jpg" { 3 * texels } else { 0 };
        assert!(reduced < stored + (80 << 20), "{name} reduced: {} MiB", reduced >> 20);
    }
}

/// A colour profile is compressed, and takes nothing of the pixels' budget.
#[test]
fn a_profile_that_unpacks_to_much_is_left_out() {
    let folder = Folder::empty();
    let mut info = png::Info::with_size(64, 32);
    (info.color_type, info.bit_depth) = (png::ColorType::Grayscale, png::BitDepth::Eight);
    info.icc_profile = Some(vec![0; 200 << 20].into());
    let file = std::fs::File::create(folder.path("bomb.png")).expect("writes");
    let mut writer = png::Encoder::with_info(file, info).and_then(png::Encoder::write_header).expect("a header");
    writer.write_image_data(&[90; 64 * 32]).expect("pixels");
    writer.finish().expect("ends");
    assert!(folder.path("bomb.png").metadata().expect("is there").len() < 1 << 20);
    folder.write("bomb.toml", "[panorama]\ncolor = \"bomb.png\"\ndepth = 3\n");
    let most = peak(&folder, &["check", "bomb.toml"]);
    assert!(most < 150 << 20, "{} MiB", most >> 20);
}

#[test]
fn what_the_device_cannot_hold_is_refused_before_it_is_decoded() {
    let folder = Folder::empty();
    flat_png(&folder.path("wide.png"), 20000, 10000);
    // No pixel is left.
    let bytes = std::fs::read(folder.path("wide.png")).expect("reads");
    std::fs::write(folder.path("wide.png"), &bytes[..60]).expect("writes");
    folder.write("wide.toml", "[panorama]\ncolor = \"wide.png\"\ndepth = 3\n");
    let ran = run(&folder, &["render", "wide.toml", "-o", "a.png", "--size", "8x8"]);
    assert_eq!((ran.status, ran.stderr.lines().count()), (Some(2), 1), "{}", ran.stderr);
    let words = ["wide.png: has 20000x10000 texels", "at most", "--panorama-size 10000"];
    assert!(words.iter().all(|word| ran.stderr.contains(word)), "{}", ran.stderr);
}

#[test]
fn more_pixels_than_are_decoded_whole_are_read_by_strips() {
    let folder = Folder::empty();
    flat_png(&folder.path("wide.png"), 32000, 16000);
    let bytes = std::fs::read(folder.path("wide.png")).expect("reads");
    std::fs::write(folder.path("wide.png"), &bytes[..60]).expect("writes");
    folder.write("wide.toml", "[panorama]\ncolor = \"wide.png\"\ndepth = 3\n");
    let color = run(&folder, &["check", "wide.toml", "--panorama-size", "64"]);
    assert!(color.stderr.contains("wide.png: cannot be decoded"), "its rows are asked for: {}", color.stderr);
    flat_png(&folder.path("small.png"), 64, 32);
    folder.write("deep.toml", "[panorama]\ncolor = \"small.png\"\ndepth = \"wide.png\"\n");
    let depth = run(&folder, &["check", "deep.toml", "--panorama-size", "64"]);
    assert!(depth.stderr.contains("32000x16000 pixels, more than 16384x16384"), "{}", depth.stderr);
}

#[test]
fn memory_is_asked_for_before_it_is_taken() {
    let folder = Folder::empty();
    flat_png(&folder.path("wide.png"), 12288, 6144);
    folder.write("wide.toml", "[panorama]\ncolor = \"wide.png\"\ndepth = 3\n");
    for arguments in [
        &["--memory", "512M", "check", "wide.toml"][..],
        &["render", "wide.toml", "-o", "a.png", "--memory=512M"],
        &["compare", "wide.png", "wide.png", "--memory", "512M"],
        &["new", "wide.png", "-o", "new.toml", "--memory", "512M"],
    ] {
        let ran = run(&folder, arguments);
        let what = format!("iprt {arguments:?}, {} MiB: {}", ran.peak >> 20, ran.stderr);
        assert_eq!(ran.status, Some(2), "{what}");
        assert!(ran.stderr.contains("wide.png: would take") && ran.stderr.contains("--memory"), "{what}");
        assert!(ran.peak < 256 << 20 && ran.stderr.lines().count() == 1, "{what}");
    }

    // Many large textures, of which no single one is too large.
    flat_png(&folder.path("large.png"), 4096, 4096);
    let list = |entry: fn(usize) -> String| (0..16).map(entry).collect::<Vec<_>>().join(",");
    let gltf = format!(
        r#"{{"asset": {{"version": "2.0"}}, "images": [{}], "textures": [{}], "materials": [{}], "meshes": [{}],
        "nodes": [{}], "accessors": [{{"componentType": 5126, "type": "VEC3", "count": 3, "bufferView": 0}}],
        "bufferViews": [{{"buffer": 0, "byteLength": 36}}],
        "buffers": [{{"byteLength": 36, "uri": "data:,AAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAA"}}]}}"#,
        list(|_| r#"{"uri": "large.png"}"#.into()),
        list(|k| format!(r#"{{"source": {k}}}"#)),
        list(|k| format!(r#"{{"pbrMetallicRoughness": {{"baseColorTexture": {{"index": {k}}}}}}}"#)),
        list(|k| format!(r#"{{"primitives": [{{"attributes": {{"POSITION": 0}}, "material": {k}}}]}}"#)),
        list(|k| format!(r#"{{"mesh": {k}}}"#)),
    );
    folder.write("textures.gltf", &gltf);
    folder
        .write("textures.toml", "[panorama]\ncolor = \"small.png\"\ndepth = 3\n[[object]]\ngltf = \"textures.gltf\"\n");
    flat_png(&folder.path("small.png"), 64, 32);
    let ran = run(&folder, &["check", "textures.toml"]);
    assert!(ran.stderr.contains("all together exceed 256 MiB"), "{}", ran.stderr);
    assert!(ran.peak < 900 << 20, "{} MiB", ran.peak >> 20);

    crate::video_in::ffmpeg(&folder, "-f lavfi -i color=gray:s=8192x4096:r=1:d=1 -c:v ffv1 -pix_fmt gray film.mkv");
    folder.write("film.toml", "[panorama]\ncolor = \"film.mkv\"\ndepth = 3\n");
    let ran = run(&folder, &["check", "film.toml", "--memory", "512M"]);
    assert!(ran.status == Some(2) && ran.stderr.contains("film.mkv: would take"), "{}", ran.stderr);
    assert!(ran.peak < 256 << 20, "{} MiB", ran.peak >> 20);

    // Accessors of zeros, which no byte of the file stands for.
    let many = "{\"componentType\": 5126, \"type\": \"VEC3\", \"count\": 4000000}";
    let accessors = [many; 24].join(",");
    let targets: Vec<_> = (1..24).map(|index| format!("{{\"POSITION\": {index}}}")).collect();
    let gltf = format!(
        "{{\"asset\": {{\"version\": \"2.0\"}}, \"accessors\": [{accessors}], \"nodes\": [{{\"mesh\": 0}}], \"meshes\": \
         [{{\"primitives\": [{{\"attributes\": {{\"POSITION\": 0}}, \"targets\": [{}]}}]}}]}}",
        targets.join(",")
    );
    folder.write("zeros.gltf", &gltf);
    image::RgbImage::new(16, 8).save(folder.path("room.png")).expect("writes");
    folder.write("zeros.toml", "[panorama]\ncolor = \"room.png\"\ndepth = 3\n[[object]]\ngltf = \"zeros.gltf\"\n");
    let ran = run(&folder, &["check", "zeros.toml"]);
    assert!(
        matches!(ran.status, Some(0 | 2)) && ran.peak < 700 << 20,
        "{:?}, {} MiB: {}",
        ran.status,
        ran.peak >> 20,
        ran.stderr
    );
}

/// Many equal objects are one model.
#[test]
fn equal_objects_are_instances() {
    let folder = Folder::empty();
    image::RgbImage::from_pixel(32, 16, image::Rgb([90, 90, 90])).save(folder.path("room.png")).expect("writes");
    let model = iprt::scene::model::Model::from_mesh(
        iprt::scene::shapes::Shape::Sphere.mesh(glam::Vec3::splat(0.1)),
        iprt::scene::material::Material::plain("grey", glam::Vec3::splat(0.5), 1.0),
    );
    std::fs::write(folder.path("ball.glb"), iprt::scene::gltf::export::to_glb(&model).expect("a model"))
        .expect("writes");
    let mut text = "[panorama]\ncolor = \"room.png\"\ndepth = 9\n".to_owned();
    for index in 0..10_000 {
        let (x, y) = (f64::from(index % 100) * 0.1 - 5.0, f64::from(index / 100) * 0.1 - 5.0);
        text += &format!("[[object]]\ngltf = \"ball.glb\"\ntranslation = [{x:.2}, {y:.2}, -6]\n");
    }
    folder.write("many.toml", &text);
    let scene = iprt::scene::Scene::load(&folder.path("many.toml")).expect("loads");
    assert_eq!(scene.object_count(), 10_000);
    let one = model.meshes[0].triangles.len();
    assert!(scene.packed.triangles.len() <= one, "{} triangles", scene.packed.triangles.len());
    survives(&folder, "many.toml", 0, &[]);
}
