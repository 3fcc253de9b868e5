//! What the program prints: whoever reads it may leave, a full disk is told, nothing in a name moves the cursor,
//! and no signal leaves half a file.

use crate::{
    folder::{Folder, SCENE},
    gltf::triangle,
};
use std::{
    fs::File,
    path::{Path, PathBuf},
    process::{Output, Stdio},
    time::{Duration, Instant},
};

/// A folder with a small scene, and its room as a model.
fn folder() -> Folder {
    let folder = Folder::with_scene();
    let room = iprt::scene::model::Model::from_mesh(
        iprt::scene::shapes::Shape::Box.mesh(glam::vec3(4.0, 3.0, 5.0)),
        iprt::scene::material::Material::plain("wall", glam::Vec3::splat(0.5), 1.0),
    );
    std::fs::write(folder.path("room.glb"), iprt::scene::gltf::export::to_glb(&room).expect("a model"))
        .expect("writes");
    folder
}

/// Every command that prints to standard output, with what it takes, and the files that it writes.
const COMMANDS: [(&str, &[&str]); 15] = [
    ("devices", &[]),
    ("devices --json", &[]),
    ("check scene.toml", &[]),
    ("check scene.toml --json", &[]),
    ("new room.png -o new.toml --force", &["new.toml"]),
    ("render scene.toml -o p_%d.png --frames 0..2 --warmup 0", &["p_0.png", "p_1.png", "p_2.png"]),
    ("bench scene.toml --frames 0..1 --warmup 0 --json b.json", &["b.json"]),
    ("plan scene.toml --json plan.json", &["plan.json"]),
    ("reference scene.toml -o r.exr --spp 2", &["r.exr"]),
    ("masks scene.toml -o masks --spp 2", &["masks/virtual.png", "masks/influenced.png"]),
    ("compare room.png room.png", &[]),
    ("capture room.glb -o capture --spp 1 --size 16x8", &["capture/scene.toml", "capture/depth.exr"]),
    ("stability empty_scene -o stability --quick --method ibl", &["stability/stability.json"]),
    ("completions bash", &[]),
    ("--help", &[]),
];

fn run(folder: &Folder, arguments: &str, change: impl FnOnce(&mut std::process::Command)) -> Output {
    let mut command = folder.command();
    command.args(arguments.split_whitespace()).stdout(Stdio::piped()).stderr(Stdio::piped());
    change(&mut command);
    let output = command.spawn().expect("starts").wait_with_output().expect("ends");
    let stderr = String::from_utf8_lossy(&output.stderr);
    assert!(!stderr.contains("panicked"), "iprt {arguments}: {stderr}");
    output
}

fn full() -> File {
    File::options().write(true).open("/dev/full").expect("there is such a device")
}

/// A pipe whose reader has left.
fn left() -> std::io::PipeWriter {
    let (reader, writer) = std::io::pipe().expect("a pipe");
    drop(reader);
    writer
}

#[test]
fn a_reader_who_leaves_is_no_error() {
    let folder = folder();
    for (arguments, files) in COMMANDS {
        let output = run(&folder, arguments, |command| {
            command.stdout(left());
        });
        let stderr = String::from_utf8_lossy(&output.stderr);
        assert_eq!(output.status.code(), Some(0), "iprt {arguments}: {stderr}");
        for name in files {
            std::fs::remove_file(folder.path(name)).unwrap_or_else(|error| panic!("iprt {arguments}: {name}: {error}"));
        }
        let output = run(&folder, arguments, |command| {
            command.stderr(left());
        });
        assert_eq!(output.status.code(), Some(0), "iprt {arguments}, standard error");
    }
}

#[test]
fn a_full_disk_is_told_after_all_files_are_written() {
    let folder = folder();
    for (arguments, files) in COMMANDS {
        let output = run(&folder, arguments, |command| {
            command.stdout(full());
        });
        let stderr = String::from_utf8_lossy(&output.stderr);
        assert_eq!(output.status.code(), Some(2), "iprt {arguments}: {stderr}");
        let lines: Vec<_> = stderr.lines().filter(|line| line.contains("standard output")).collect();
        assert!(lines.len() == 1 && lines[0].starts_with("iprt: "), "iprt {arguments}: {stderr}");
        for name in files {
            assert!(folder.path(name).is_file(), "iprt {arguments}: {name}");
        }
    }
    // What is said on standard error is lost: the exit status tells.
    for arguments in
        ["render scene.toml -o e.png --warmup 0", "check nowhere.toml", "rander", "check scene.toml --nonsense"]
    {
        let output = run(&folder, arguments, |command| {
            command.stderr(full());
        });
        assert_eq!(output.status.code(), Some(2), "iprt {arguments}");
    }
    assert!(folder.path("e.png").is_file());
}

#[test]
fn names_are_shown_as_text_and_values_of_the_environment_not_at_all() {
    let folder = folder();
    let name = r#"name = "a\u001b[31mRED\nsecond \u009b line""#;
    folder.write(
        "strange.toml",
        &SCENE.replace("name = \"ball\"", name).replace("translation = [0, -0.2", "translation = [0, -9"),
    );
    let output = folder.run("check strange.toml");
    let stderr = String::from_utf8_lossy(&output.stderr).into_owned();
    let stdout = String::from_utf8_lossy(&output.stdout).into_owned();
    let control = |text: &str| text.chars().any(|c| c.is_control() && c != '\n');
    assert!(!control(&stderr) && !control(&stdout), "{stderr:?} {stdout:?}");
    let named: Vec<_> = stderr.lines().chain(stdout.lines()).filter(|line| line.contains("RED")).collect();
    assert!(named.len() >= 2 && named.iter().all(|line| line.contains(r"\nsecond")), "{stderr:?} {stdout:?}");
    assert!(stderr.lines().all(|line| line.starts_with("warning: ")), "{stderr:?}");
    // The same of a file's name, of an argument, and of words that are no argument.
    for arguments in
        [&["check", "no\u{1b}[31m\nwhere.toml"][..], &["render", "-o", "a\u{1b}[2J.gif"], &["ra\u{1b}[2Jnder"]]
    {
        let output = folder.run_with(arguments);
        let stderr = String::from_utf8_lossy(&output.stderr).into_owned();
        assert!(output.status.code() == Some(2) && !control(&stderr), "{stderr:?}");
    }

    folder.write("hidden.toml", &SCENE.replace("room.png", "$ROOM_FOLDER/gone.png"));
    let output = run(&folder, "check hidden.toml", |command| {
        command.env("ROOM_FOLDER", "hidden/secret");
    });
    let stderr = String::from_utf8_lossy(&output.stderr);
    assert!(stderr.contains("$ROOM_FOLDER/gone.png") && !stderr.contains("secret"), "{stderr}");
    // And of a file that a glTF there names.
    std::fs::create_dir_all(folder.path("secret")).expect("a folder");
    folder.write(
        "secret/a.gltf",
        &format!(r#"{{"asset":{{"version":"2.0"}},{}}}"#, triangle("gone.bin", r#""count":3"#, "")),
    );
    folder.write("beside.toml", &format!("{SCENE}\n[[object]]\ngltf = \"$ROOM_FOLDER/a.gltf\"\n"));
    let output = run(&folder, "check beside.toml", |command| {
        command.env("ROOM_FOLDER", "secret");
    });
    let said = String::from_utf8_lossy(&[output.stdout, output.stderr].concat()).into_owned();
    assert!(said.contains("$ROOM_FOLDER/gone.bin") && !said.contains("secret"), "{said}");
}

#[test]
fn a_warning_is_told_once_with_its_count_and_without_colour() {
    let folder = folder();
    // A cache that cannot be written: a file is where its folder should be.
    folder.write("cache", "");
    let output = run(&folder, "masks scene.toml -o masks --spp 4", |command| {
        command.env("IPRT_CACHE", folder.path("cache/deep"));
    });
    assert_eq!(output.status.code(), Some(0));
    let output = run(
        &folder,
        "chart scene.toml -o chart --sweep methods --size 8x8 --looks 1 --moving 0 --rounds 1 --truth-spp 16",
        |command| {
            command.env("IPRT_CACHE", folder.path("cache/deep"));
        },
    );
    let stderr = String::from_utf8_lossy(&output.stderr);
    assert_eq!(output.status.code(), Some(0), "{stderr}");
    assert!(!stderr.contains('\u{1b}'), "{stderr:?}");
    let kept: Vec<_> = stderr.lines().filter(|line| line.contains("not kept")).collect();
    let kinds: std::collections::BTreeSet<_> =
        kept.iter().map(|line| line.split(" is not kept").next().unwrap_or(line)).collect();
    assert!(!kept.is_empty() && kept.len() <= 2 * kinds.len(), "{stderr}");
    assert!(stderr.contains("more like this one"), "{stderr}");
}

/// Everything in a folder and below it.
fn files(folder: &Path) -> Vec<PathBuf> {
    let entries = folder.read_dir().expect("a folder").map(|entry| entry.expect("readable").path());
    entries.flat_map(|path| if path.is_dir() { files(&path) } else { vec![path] }).collect()
}

/// Stops a command while it writes, by each signal that asks politely.
#[cfg(unix)]
#[test]
fn signals_leave_whole_files_alone() {
    let folder = folder();
    for signal in [libc::SIGINT, libc::SIGTERM, libc::SIGHUP] {
        let arguments = "render scene.toml -o out_%03d.exr --size 200x150 --aov all --warmup 0 --frames 0..400 -q";
        let mut command = folder.command();
        let mut child = command
            .args(arguments.split_whitespace())
            .stdout(Stdio::null())
            .stderr(Stdio::piped())
            .spawn()
            .expect("starts");
        let start = Instant::now();
        while !folder.path("out_001.exr").exists() {
            assert!(start.elapsed() < Duration::from_secs(200), "nothing is written");
            std::thread::sleep(Duration::from_millis(5));
        }
        // SAFETY: the child is not waited for yet, so that its number is its own.
        assert_eq!(unsafe { libc::kill(child.id() as i32, signal) }, 0);
        let output = child.wait().expect("ends");
        assert_eq!(output.code(), Some(130), "signal {signal}");
        let names = files(folder.root());
        assert!(!names.iter().any(|path| path.to_string_lossy().contains(".iprt-")), "{names:?}");
        for path in names.iter().filter(|path| path.extension().is_some_and(|e| e == "exr")) {
            iprt::image_file::read::read(path).unwrap_or_else(|error| panic!("signal {signal}: {error}"));
            std::fs::remove_file(path).expect("there");
        }
    }
}

#[test]
fn a_failed_write_names_the_file() {
    // A file where a folder should be, and a folder where a file should be.
    let folder = folder();
    std::fs::create_dir(folder.path("taken.exr")).expect("made");
    folder.fails("render scene.toml -o taken.exr --warmup 0 -q", &["taken.exr"]);
    folder.fails("render scene.toml -o room.png/a.exr -q", &["room.png/a.exr"]);
    folder.fails("render scene.toml -o st_%99999d.png --frames 0..1", &["st_%99999d.png", "too wide"]);
}
