//! Caches serve whoever comes, whatever was done to them: two processes at once, killed writers, folders that cannot be
//! written, files of an older version or of nobody.

use crate::{
    common::{options, scene},
    folder::Folder,
};
use glam::{Vec3, vec3};
use iprt::{
    gpu::{Gpu, GpuOptions},
    measure::choice::{Candidate, Sheet, store::Store},
    options::RenderOptions,
    reference::{
        cache::{Keep, truth_of_scene},
        capture::{CaptureSettings, capture_cached},
    },
    scene::{CompleteScene, camera::CameraTrack, material::Material, model::Model, shapes::Shape},
    settings::Method,
};
use std::{
    collections::BTreeMap,
    fs::{self, File},
    os::unix::{fs::PermissionsExt, process::CommandExt},
    path::{Path, PathBuf},
    process::{Child, Command, Stdio},
    sync::{Arc, atomic::AtomicBool},
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

/// Makes one of each thing that is kept: pipelines, a capture, a truth, and a chart's points. Returns their hash.
fn all_kinds(cache: &Path) -> String {
    let device = std::env::var("IPRT_DEVICE").ok();
    let pipeline_cache = Some(cache.join("pipelines"));
    let gpu = Gpu::new(&GpuOptions { device, pipeline_cache, ..GpuOptions::default() }).expect("a device");
    let wall = Material { emissive: Vec3::splat(0.5), ..Material::plain("wall", Vec3::splat(0.5), 1.0) };
    let room = Arc::new(Model::from_mesh(Shape::Box.mesh(vec3(4.0, 3.0, 5.0)), wall));
    let complete =
        CompleteScene::assemble("room", room, CameraTrack::at_point(Vec3::ZERO), Vec::new()).expect("a room");
    let settings = CaptureSettings { size: [32, 16], samples: 2, progress: false, ..CaptureSettings::default() };
    let panorama = capture_cached(&gpu, &complete, Vec3::ZERO, &settings, Some(cache)).expect("captures");

    let options = RenderOptions { size: [16, 12], ..options(Method::Reference, &[]) };
    let keep = Keep { folder: Some(cache), stop: &AtomicBool::new(false) };
    let truth = truth_of_scene(&gpu, &complete, &options, 0.0, 8, keep, &mut || ()).expect("a truth");

    let mut hasher = blake3::Hasher::new();
    let radiance: Vec<[f32; 4]> = panorama.radiance.iter().collect();
    hasher.update(bytemuck::cast_slice(&radiance)).update(bytemuck::cast_slice(&panorama.depth));
    hasher.update(bytemuck::cast_slice(&truth.radiance));
    let scene = scene(panorama, CameraTrack::at_point(Vec3::ZERO), Vec::new());
    let points = Store::of(&gpu, &scene, &options, 1.0, Some(cache)).expect("a key");
    if points.load().is_empty() {
        points.put(Sheet { size: options.size, candidates: vec![Candidate::default()], ..Sheet::default() });
    }
    gpu.destroy().expect("nothing holds it");
    hasher.finalize().to_hex().to_string()
}

/// Not a test, but what a process of the test below does.
#[test]
#[ignore = "the next test runs it in processes of its own"]
fn a_process_that_fills_a_cache() {
    if let Some(cache) = std::env::var_os("IPRT_TEST_CACHE") {
        println!("hash {}", all_kinds(Path::new(&cache)));
    }
}

/// A process that runs that.
fn filling(cache: &Path) -> Command {
    let mut command = Command::new(std::env::current_exe().expect("known"));
    command.args(["--exact", "caches::a_process_that_fills_a_cache", "--ignored", "--nocapture"]);
    command.env("IPRT_TEST_CACHE", cache).stdout(Stdio::piped()).stderr(Stdio::piped());
    command
}

fn hash_of(child: Child) -> String {
    let output = child.wait_with_output().expect("ends");
    let [out, err] = [output.stdout, output.stderr].map(|bytes| String::from_utf8_lossy(&bytes).into_owned());
    let hash = out.lines().find_map(|line| line.split("hash ").nth(1)).unwrap_or_else(|| panic!("{out}{err}"));
    hash.to_owned()
}

fn contents(folder: &Path) -> BTreeMap<PathBuf, Vec<u8>> {
    files(folder).into_iter().map(|path| (path.clone(), fs::read(path).expect("readable"))).collect()
}

/// Forbids writing in a folder, and what is in it, or allows it again.
fn writable(folder: &Path, may: bool) {
    for entry in folder.read_dir().expect("a folder").map(|entry| entry.expect("readable").path()) {
        if entry.is_dir() {
            writable(&entry, may);
        }
    }
    fs::set_permissions(folder, fs::Permissions::from_mode(if may { 0o755 } else { 0o555 })).expect("set");
}

/// Takes from the process that it begins what lets root write everywhere. Other users have not got it.
fn as_anybody(command: &mut Command) -> &mut Command {
    const CAP_DAC_OVERRIDE: libc::c_ulong = 1;
    // SAFETY: it is one system call.
    unsafe {
        command.pre_exec(|| {
            libc::prctl(libc::PR_CAPBSET_DROP, CAP_DAC_OVERRIDE, 0, 0, 0);
            Ok(())
        })
    }
}

/// Lets the process write no file, as on a full disk.
fn on_a_full_disk(command: &mut Command) -> &mut Command {
    // SAFETY: these are two system calls.
    unsafe {
        command.pre_exec(|| {
            libc::signal(libc::SIGXFSZ, libc::SIG_IGN);
            let none = libc::rlimit { rlim_cur: 0, rlim_max: 0 };
            if libc::setrlimit(libc::RLIMIT_FSIZE, &none) == 0 { Ok(()) } else { Err(std::io::Error::last_os_error()) }
        })
    }
}

#[test]
fn captures_truths_points_and_pipelines_survive_what_befalls_a_cache() {
    let (cache, other) = (Folder::empty(), Folder::empty());
    // Two at once on a cold cache.
    let both = [filling(cache.root()), filling(cache.root())].map(|mut one| one.spawn().expect("starts"));
    let [hash, same] = both.map(hash_of);
    assert_eq!(hash, same);
    let kept = contents(cache.root());
    let text: Vec<_> = kept.keys().map(|path| path.display().to_string()).collect();
    for kind in ["pipelines/", "capture-", "truth-", "points-"] {
        assert!(text.iter().any(|path| path.contains(kind)), "{kind} in {text:?}");
    }
    assert!(!text.iter().any(|path| path.contains(".iprt-")), "{text:?}");
    let times = || -> Vec<_> {
        kept.keys().map(|path| fs::metadata(path).and_then(|m| m.modified()).expect("there")).collect()
    };
    let again = |what: &str, change: &dyn Fn(&mut Command)| {
        let mut command = filling(cache.root());
        change(&mut command);
        assert_eq!(hash_of(command.spawn().expect("starts")), hash, "{what}");
    };
    let written = times();
    again("all is there", &|_| ());
    assert_eq!(times(), written, "it was read, not made again");

    // A folder that can be read alone, filled and empty; a full one.
    writable(cache.root(), false);
    writable(other.root(), false);
    again("read-only", &|command| {
        as_anybody(command);
    });
    again("empty and read-only", &|command| {
        as_anybody(command.env("IPRT_TEST_CACHE", other.root()));
    });
    writable(cache.root(), true);
    writable(other.root(), true);
    again("full", &|command| {
        on_a_full_disk(command.env("IPRT_TEST_CACHE", other.root()));
    });
    assert!(files(other.root()).is_empty(), "{:?}", files(other.root()));
    assert_eq!(times(), written);

    // A writer that was killed, at its first file and between those of a capture; an older version.
    let mut killed = filling(other.root()).spawn().expect("starts");
    while files(other.root()).is_empty() {
        assert!(killed.try_wait().expect("runs").is_none(), "it ended before it was killed");
        std::thread::sleep(Duration::from_millis(1));
    }
    killed.kill().expect("runs");
    killed.wait().expect("ends");
    again("after a killed writer", &|command| {
        command.env("IPRT_TEST_CACHE", other.root());
    });
    for path in kept.keys().filter(|path| path.ends_with("blake3") || path.ends_with("0003")) {
        fs::remove_file(path).expect("there");
    }
    again("half of it", &|_| ());
    assert!(contents(cache.root()) == kept, "it is made whole");
    kept.keys().for_each(|path| fs::write(path, "version 0").expect("writes"));
    again("an older version", &|_| ());
    assert!(contents(cache.root()) == kept, "it is written anew");
}

#[test]
fn a_chart_of_another_version_is_not_continued() {
    let folder = folder();
    fs::create_dir(folder.path("chart")).expect("made");
    folder.write("chart/chart.json", "{ \"version\": 0 }");
    folder.fails("chart scene.toml -o chart --size 8x8 -q", &["chart.json", "no chart of this version", "delete it"]);
}
