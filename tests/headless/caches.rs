//! Caches serve whoever comes, whatever was done to them: two processes at once, killed writers, folders that cannot be
//! written, files of an older version or of nobody.

use crate::folder::Folder;
use glam::Vec3;
use iprt::{
    gpu::{Gpu, GpuOptions},
    reference::capture::{CaptureSettings, capture_cached},
    scene::{CompleteScene, camera::CameraTrack, material::Material, model::Model, shapes::Shape},
};
use std::{
    fs::{self, File},
    path::{Path, PathBuf},
    process::{Command, Stdio},
    sync::Arc,
    time::{Duration, SystemTime},
};

const SCENE: &str = "[panorama]\ncolor = \"room.png\"\ndepth = 3\n[camera]\nsize = [16, 12]\n[[object]]\nshape = \"box\"\n\
                     size = 0.4\ntranslation = [0, 0, -1.5]\n";

fn folder() -> Folder {
    let folder = Folder::empty();
    image::RgbImage::from_pixel(32, 16, image::Rgb([90, 120, 60])).save(folder.path("room.png")).expect("writes");
    folder.write("scene.toml", SCENE);
    folder
}

fn render(folder: &Folder, output: &str) -> Command {
    let mut command = folder.command();
    command.args(["render", "scene.toml", "--warmup", "0", "-q", "-o", output]);
    command.env("IPRT_CACHE", folder.path("cache")).stdout(Stdio::null()).stderr(Stdio::piped());
    command
}

/// Renders, and demands that it goes well and says nothing. Returns the picture.
fn rendered(folder: &Folder, output: &str) -> Vec<u8> {
    let ran = render(folder, output).output().expect("runs");
    let stderr = String::from_utf8_lossy(&ran.stderr);
    assert!(ran.status.success() && stderr.is_empty(), "{:?}: {stderr}", ran.status);
    fs::read(folder.path(output)).expect("written")
}

/// Everything in a folder and below it.
fn files(folder: &Path) -> Vec<PathBuf> {
    let entries = folder.read_dir().expect("a folder").map(|entry| entry.expect("readable").path());
    entries.flat_map(|path| if path.is_dir() { files(&path) } else { vec![path] }).collect()
}

#[test]
fn pipelines_are_shared_by_processes_and_mended() {
    let folder = folder();
    // Two at once on a cold cache.
    let both = ["a.png", "b.png"].map(|output| render(&folder, output).spawn().expect("starts"));
    for child in both {
        let ran = child.wait_with_output().expect("ends");
        assert!(ran.status.success(), "{}", String::from_utf8_lossy(&ran.stderr));
    }
    let picture = fs::read(folder.path("a.png")).expect("written");
    assert_eq!(fs::read(folder.path("b.png")).expect("written"), picture);
    let kept = files(&folder.path("cache"));
    assert!(!kept.is_empty(), "pipelines are kept");
    assert!(!kept.iter().any(|path| path.to_string_lossy().contains(".iprt-")), "{kept:?}");

    // What a killed writer left, and files of an older version.
    let left = kept[0].parent().expect("a folder").join(".iprt-killed");
    File::create(&left).and_then(|f| f.set_modified(SystemTime::now() - Duration::from_secs(300))).expect("made");
    for content in [&b""[..], b"version 0", &[0xff; 4096]] {
        kept.iter().for_each(|path| fs::write(path, content).expect("writes"));
        assert!(rendered(&folder, "c.png") == picture, "with {} bytes in each file", content.len());
        assert!(kept.iter().all(|path| fs::read(path).expect("there") != content), "it is mended");
    }
    assert!(!left.exists(), "it is swept");
}

#[test]
fn a_cache_that_cannot_be_written_is_done_without() {
    let folder = folder();
    let picture = rendered(&folder, "a.png");
    // A file is where the folder should be, and folders are where files should be.
    let kept = files(&folder.path("cache"));
    for path in &kept {
        fs::remove_file(path).expect("there");
        fs::create_dir(path).expect("made");
    }
    assert!(rendered(&folder, "b.png") == picture);
    fs::remove_dir_all(folder.path("cache")).expect("there");
    folder.write("cache", "");
    assert!(rendered(&folder, "c.png") == picture);
}

#[test]
fn captures_are_shared_by_processes() {
    let cache = Folder::empty();
    let wall = Material { emissive: Vec3::splat(0.5), ..Material::plain("wall", Vec3::splat(0.5), 1.0) };
    let room = Arc::new(Model::from_mesh(Shape::Box.mesh(Vec3::new(4.0, 3.0, 5.0)), wall));
    let settings = CaptureSettings { size: [32, 16], samples: 2, progress: false, ..CaptureSettings::default() };
    let capture = || {
        let gpu = Gpu::new(&GpuOptions { device: std::env::var("IPRT_DEVICE").ok(), ..GpuOptions::default() });
        let camera = CameraTrack::at_point(Vec3::ZERO);
        let scene = CompleteScene::assemble("room", room.clone(), camera, Vec::new()).expect("a room");
        capture_cached(&gpu.expect("a device"), &scene, Vec3::ZERO, &settings, Some(cache.root())).expect("captures")
    };
    let all: Vec<_> = std::thread::scope(|scope| {
        let both = [scope.spawn(capture), scope.spawn(capture)];
        both.into_iter().map(|one| one.join().expect("captures")).collect()
    });
    let kept = files(cache.root());
    assert!(!kept.is_empty() && !kept.iter().any(|path| path.to_string_lossy().contains(".iprt-")), "{kept:?}");
    let again = capture();
    assert!(all.iter().all(|one| one.radiance == again.radiance && one.depth == again.depth));
    let stamp = |path: &PathBuf| fs::metadata(path).and_then(|data| data.modified()).expect("there");
    let before: Vec<_> = kept.iter().map(stamp).collect();
    assert_eq!(capture().radiance, again.radiance);
    assert_eq!(kept.iter().map(stamp).collect::<Vec<_>>(), before, "it was read, not made again");
}
