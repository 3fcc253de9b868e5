//! The window, on a display of its own (Xvfb), played by scripts, under validation.

use crate::folder::Folder;
use glam::Vec3;
use iprt::{
    passes::display::Meaning,
    scene::{gltf::export::to_glb, material::Material, model::Model, shapes::Shape},
};
use serde_json::Value;
use std::{
    fs,
    io::{BufRead, BufReader},
    path::{Path, PathBuf},
    process::{Child, Command, Output, Stdio},
    time::{Duration, Instant},
};

/// An X server without a screen; what it would show is in a file. It ends with the test.
pub struct Display {
    server: Child,
    pub name: String,
    folder: Folder,
}

impl Display {
    pub fn start() -> Self {
        let folder = Folder::empty();
        let mut server = Command::new("Xvfb")
            .args(["-displayfd", "1", "-screen", "0", "800x600x24", "-nolisten", "tcp", "-fbdir"])
            .arg(folder.root())
            .stdout(Stdio::piped())
            .stderr(Stdio::null())
            .spawn()
            .expect("tests of the window need Xvfb: scripts/setup installs it");
        let mut number = String::new();
        let mut lines = BufReader::new(server.stdout.take().expect("piped"));
        lines.read_line(&mut number).expect("Xvfb says which display it is");
        Self { server, name: format!(":{}", number.trim()), folder }
    }

    /// What is on the screen now, from its upper left corner: an XWD file of 32-bit pixels.
    pub fn screen(&self, [width, height]: [u32; 2]) -> image::RgbImage {
        let file = fs::read(self.folder.path("Xvfb_screen0")).expect("the screen");
        let word = |i: usize| u32::from_be_bytes(file[4 * i..4 * i + 4].try_into().expect("four bytes"));
        let (header, little, row, colors) = (word(0), word(7) == 0, word(12), word(19));
        image::RgbImage::from_fn(width, height, |x, y| {
            let at = (header + 12 * colors + y * row + 4 * x) as usize;
            let pixel = &file[at..at + 4];
            image::Rgb(if little { [pixel[2], pixel[1], pixel[0]] } else { [pixel[1], pixel[2], pixel[3]] })
        })
    }
}

/// Waits for something that the window shows or writes.
pub fn until(what: &str, mut there: impl FnMut() -> bool) {
    let start = Instant::now();
    while !there() {
        assert!(start.elapsed() < Duration::from_secs(100), "waited in vain: {what}");
        std::thread::sleep(Duration::from_millis(50));
    }
}

impl Drop for Display {
    fn drop(&mut self) {
        self.server.kill().expect("it runs");
        self.server.wait().expect("it ends");
    }
}

/// A box room over a floor, two frames long, a lamp, a ball.
const SCENE: &str = r#"# comments stay
[panorama]
color = "room_%d.png"
depth = { box = [4, 3, 5] }
frames = [0, 1]
fps = 10
[camera]
look_at = [0, -0.6, -1]
size = [40, 30]
[[object]]
name = "ball" # the ball
shape = "sphere"
size = [0.6, 0.6, 0.6]
translation = [0, -1.2, -1.6]
[render]
set = { relight_levels = 0, atrous_levels = 2 }
"#;

/// The scene in a folder.
pub fn room() -> Folder {
    let folder = Folder::empty();
    for frame in 0..2 {
        // a bright ceiling, a grey rest; the second frame is redder
        let texel = |_, y| if y < 8 { [250, 250, 250] } else { [90 + 60 * frame, 90, 90] };
        folder.paint(&format!("room_{frame}.png"), texel);
    }
    folder.write("scene.toml", SCENE);
    folder
}

/// Starts a session that plays a script under validation.
pub fn start(folder: &Folder, display: &Display, script: &str, arguments: &str) -> Session {
    start_with(folder, display, script, arguments, &[])
}

/// The same with variables of its environment.
fn start_with(
    folder: &Folder,
    display: &Display,
    script: &str,
    arguments: &str,
    environment: &[(&str, &Path)],
) -> Session {
    folder.write("script.txt", script);
    let flags = "--size 160x120 --script script.txt --report report.json --validation";
    let mut command = Command::new(env!("CARGO_BIN_EXE_iprt"));
    command.args(format!("view {arguments} {flags}").split_whitespace()).current_dir(folder.root());
    command.env("DISPLAY", &display.name).env_remove("WAYLAND_DISPLAY");
    command.envs(environment.iter().copied()).stderr(Stdio::piped()).stdout(Stdio::piped());
    Session { child: command.spawn().expect("starts"), report: folder.path("report.json") }
}

/// Plays a script to its end, and demands that validation had nothing to say.
pub fn play(folder: &Folder, display: &Display, script: &str, arguments: &str) -> Report {
    start(folder, display, script, arguments).finish()
}

fn said(output: &Output) -> String {
    String::from_utf8_lossy(&output.stderr).into_owned()
}

pub struct Session {
    child: Child,
    report: PathBuf,
}

impl Session {
    pub fn finish(self) -> Report {
        let output = self.child.wait_with_output().expect("ends");
        let said = said(&output);
        assert!(output.status.success(), "{said}");
        assert!(!said.contains("panicked"), "{said}");
        let report: Value =
            serde_json::from_slice(&fs::read(&self.report).expect("a report")).expect("the report is JSON");
        assert_eq!(report["messages"], serde_json::json!([]), "validation");
        Report(report)
    }
}

pub struct Report(pub Value);

impl Report {
    pub fn note(&self, word: &str) -> &Value {
        let notes = self.0["notes"].as_array().expect("notes");
        notes.iter().find(|note| note["note"] == word).unwrap_or_else(|| panic!("no note {word} in {notes:#?}"))
    }

    pub fn errors(&self) -> String {
        self.0["errors"].to_string()
    }
}

pub fn vector(value: &Value) -> [f64; 3] {
    let numbers: Vec<f64> = value.as_array().expect("a vector").iter().map(|x| x.as_f64().expect("a number")).collect();
    numbers.try_into().expect("three numbers")
}

pub fn picture(path: &Path) -> image::RgbImage {
    image::open(path).unwrap_or_else(|error| panic!("{}: {error}", path.display())).to_rgb8()
}

/// Mean over a part of a picture.
pub fn mean(picture: &image::RgbImage, x: std::ops::Range<u32>, y: std::ops::Range<u32>) -> f64 {
    let count = f64::from((x.end - x.start) * (y.end - y.start) * 3);
    let sum: u32 = y
        .flat_map(|y| x.clone().map(move |x| (x, y)))
        .flat_map(|(x, y)| picture.get_pixel(x, y).0)
        .map(u32::from)
        .sum();
    f64::from(sum) / count
}

#[test]
fn a_session_looks_picks_drags_compares_and_steps() {
    let (folder, display) = (room(), Display::start());
    let script = "
        key P
        settle 2
        note start
        screenshot before.png
        click left 80,75       # the ball
        note picked
        drag left 80,75 120,75
        settle 3
        note dragged
        key R                  # fast machines accumulated while it was dragged
        settle 3
        screenshot after.png
        save moved.toml
        key ctrl+Z
        settle 1
        note undone
        key ctrl+Y
        key Comma              # 15 degrees
        key Equals             # by a tenth
        note turned
        key ctrl+Z
        key ctrl+Z
        key Delete
        settle 1
        note removed
        key ctrl+Z
        note whole
        hold ctrl+F9
        move 80,60
        wheel 2                # ×1.1 twice, as one step
        wait 120               # it is smoothed over time
        note wheeled
        release ctrl+F9
        key ctrl+Z
        note unwheeled
        drag right 40,20 60,30 # the view
        wheel 2
        hold W
        wait 3
        release W
        settle 1
        note looked
        key C
        key 2
        key shift+1
        key B
        settle 2
        note split
        drag left 80,20 40,20  # the line between A and B
        note line
        key V
        settle 2
        wait 2
        note difference
        key V
        key shift+4
        set B relight_levels=0
        key B
        settle 3
        note truth
        key B
        key O
        settle 1
        note aov
        key shift+O
        key Right
        settle 1
        note stepped
        key Space
        wait 6
        key Space
        note played
    ";
    let report = play(&folder, &display, script, "scene.toml");
    assert_eq!(report.0["errors"], serde_json::json!([]));

    let place = |word: &str| vector(&report.note(word)["objects"][0]["translation"]);
    assert_eq!(report.note("start")["selected"], Value::Null);
    assert_eq!(report.note("picked")["selected"], 0);
    let (start, dragged) = (place("start"), place("dragged"));
    assert!(dragged[0] > start[0] + 0.3, "to the right: {start:?} {dragged:?}");
    assert!((dragged[1] + 1.2).abs() < 0.05, "it stands on the floor, at −1.5: {dragged:?}");
    assert_eq!(place("undone"), start);
    let turned = &report.note("turned")["objects"][0];
    assert!((vector(&turned["scale"])[0] - 1.1).abs() < 1e-3, "{turned}");
    assert!((turned["rotation"][1].as_f64().expect("a number") - 7.5_f64.to_radians().sin()).abs() < 1e-3, "{turned}");
    assert_eq!(report.note("removed")["objects"], serde_json::json!([]));
    let size = |word: &str| vector(&report.note(word)["objects"][0]["scale"])[0];
    assert!((size("wheeled") / size("whole") - 1.21).abs() < 0.01, "{} of {}", size("wheeled"), size("whole"));
    assert_eq!(size("unwheeled"), size("whole"), "one gesture is one step");
    let changed = |word: &str| report.note(word)["changed"].as_bool().expect("yes or no");
    assert!(!changed("start") && changed("dragged") && changed("undone") && changed("turned"));

    // the shadow goes where the ball goes: below it is darker than where it was
    let (before, after) = (picture(&folder.path("before.png")), picture(&folder.path("after.png")));
    assert_eq!(before.dimensions(), (160, 120));
    let [was, is] = [60..100, 105..145].map(|x| mean(&after, x.clone(), 90..98) / mean(&before, x, 90..98));
    assert!(is < 0.97 * was, "shadow: {is} under the ball, {was} where it was");

    let camera = |word: &str| report.note(word)["camera"].clone();
    assert_ne!(camera("looked")["rotation"], camera("start")["rotation"]);
    assert_ne!(camera("looked")["position"], camera("start")["position"]);
    assert!(camera("looked")["fov_y"].as_f64() < camera("start")["fov_y"].as_f64());
    let split = report.note("split");
    assert_eq!((&split["compare"], &split["methods"]), (&"split".into(), &serde_json::json!(["paper", "iprt"])));
    assert_eq!(split["shown"].as_array().map(Vec::len), Some(2));
    assert!((report.note("line")["divider"].as_f64().expect("a number") - 0.25).abs() < 0.02);
    assert_eq!(report.note("difference")["difference_shown"], true);
    let truth = report.note("truth");
    assert_eq!(truth["methods"], serde_json::json!(["paper", "reference"]));
    assert!(truth["shown"][1]["frames"].as_u64() >= Some(3), "it accumulates: {truth}");
    assert_ne!(report.note("aov")["aov"], report.note("start")["aov"]);
    assert_eq!((&report.note("start")["frame"], &report.note("stepped")["frame"]), (&0.into(), &1.into()));
    assert_eq!(report.note("played")["playing"], false);

    // what was saved is what was seen
    let saved = fs::read_to_string(folder.path("moved.toml")).expect("saved");
    assert!(saved.contains("# comments stay") && saved.contains("# the ball"), "{saved}");
    let entry = &report.0["screenshots"][1];
    let warmup = entry["frames"].as_u64().expect("a number") - 1;
    folder.succeeds(&format!("render -q moved.toml -o saved.png --size 160x120 --warmup {warmup}"));
    let apart = picture(&folder.path("saved.png"));
    // Both are noisy, and the window's plan allows for more. A ball elsewhere is a twentieth of the picture.
    let apart = apart.iter().zip(after.iter()).filter(|(a, b)| a.abs_diff(**b) > 8).count();
    assert!(apart < after.len() / 500, "the saved scene differs in {apart} of {} codes", after.len());
}

#[test]
fn the_screen_and_a_screenshot_are_what_render_gives() {
    let (folder, display) = (room(), Display::start());
    // What is found of lamps is found in the first frame.
    let scene = SCENE.replace("[camera]", "lamps = \"as captured\"\n[camera]");
    folder.write("scene.toml", &scene.replace("[render]", "[render]\ntonemap = \"neutral\""));
    let script = "
        key P
        key Right
        settle 1
        key R
        settle 5
        screenshot shot.exr
        screenshot shot.png
        note shot
        await seen
        key V
        await differed
    ";
    let session = start(&folder, &display, script, "scene.toml --method paper --set history=7");
    // the screen shows the same, but for the line in its lower left corner, and for the frames since
    until("the picture on the screen", || {
        let shot = folder.path("shot.png");
        shot.exists() && {
            let apart = |(a, b): (u8, u8)| f64::from(a.abs_diff(b));
            let pairs = |(a, b): (image::RgbImage, image::RgbImage)| a.into_raw().into_iter().zip(b.into_raw());
            let pixels = 160 * 75 * 3;
            let sum: f64 = pairs((display.screen([160, 120]), picture(&shot))).take(pixels).map(apart).sum();
            sum < 1.5 * pixels as f64
        }
    });
    folder.write("seen", "");
    // most of the picture is nearly the same by B: dark blue, by the legend
    until("the difference on the screen", || {
        let none = Meaning::Difference.color(0.0).map(|c| (255.0 * c).round() as u8);
        let blue = |pixel: &&image::Rgb<u8>| pixel.0.iter().zip(none).all(|(a, b)| a.abs_diff(b) <= 8);
        display.screen([160, 60]).pixels().filter(blue).count() > 160 * 60 / 2
    });
    folder.write("differed", "");
    let report = session.finish();
    assert_eq!(report.0["errors"], serde_json::json!([]));
    let command = report.note("shot")["command"].as_str().expect("a command").to_owned();
    for words in ["iprt render scene.toml -o picture.png --size 160x120 --method paper --set ", " --tonemap neutral "] {
        assert!(command.contains(words), "{command}");
    }
    assert!(command.contains("history=7") && command.contains("--frames 1..1 --warmup "), "{command}");
    folder.succeeds(command.trim_start_matches("iprt "));
    assert!(folder.path("picture.png").exists());
    // The frame that the window stood at, as long as it stood. Its plan allows for more, so that bits differ.
    folder.write(
        "still.toml",
        &fs::read_to_string(folder.path("scene.toml")).expect("written").replace("frames = [0, 1]", "frames = [1, 1]"),
    );
    for (entry, name) in report.0["screenshots"].as_array().expect("two").iter().zip(["exr", "png"]) {
        let warmup = entry["frames"].as_u64().expect("a number") - 1;
        let flags = format!("--method paper --set history=7 --size 160x120 --warmup {warmup}");
        folder.succeeds(&format!("render -q still.toml -o render.{name} {flags}"));
        let compared = folder.succeeds(&format!("compare shot.{name} render.{name} --json"));
        let compared: serde_json::Value = serde_json::from_str(&compared).expect("JSON");
        assert!(compared["rmse"].as_f64().expect("a number") < 2e-4, "{name}: {compared}");
    }
}

#[cfg(debug_assertions)]
#[test]
fn a_changed_shader_is_seen_and_a_broken_one_is_said() {
    use crate::reload::{change, copy};
    let (folder, display, root) = (room(), Display::start(), copy());
    let script = "
        key P
        settle 1
        screenshot before.png
        await changed
        key F5
        screenshot after.png
        await broken
        key F5
        errors 1
        screenshot same.png
    ";
    let session = start_with(&folder, &display, script, "scene.toml", &[("IPRT_SHADERS", root.path())]);
    let composite = "shaders/glsl/composite.comp";
    until("a screenshot", || folder.path("before.png").exists());
    change(root.path(), composite, "vec4(radiance, 1.0)", "vec4(0.0, radiance.gb, 1.0)");
    folder.write("changed", "");
    until("another screenshot", || folder.path("after.png").exists());
    change(root.path(), composite, "vec4(0.0", "vec4(nonsense");
    folder.write("broken", "");
    let report = session.finish();
    let red = |name: &str| picture(&folder.path(name)).pixels().any(|pixel| pixel.0[0] > 0);
    assert!(red("before.png") && !red("after.png") && !red("same.png"));
    let errors = report.errors();
    assert!(errors.contains("composite.comp:") && errors.contains("nonsense"), "{errors}");
}

#[test]
fn what_is_dropped_is_there_and_what_goes_wrong_is_said() {
    let (folder, display) = (room(), Display::start());
    folder.write("broken.glb", "no model");
    let model = Model::from_mesh(Shape::Box.mesh(Vec3::splat(0.3)), Material::plain("red", Vec3::X, 0.5));
    fs::write(folder.path("cube.glb"), to_glb(&model).expect("a model")).expect("writes");
    let script = "
        key P
        settle 1
        drop broken.glb
        errors 1
        drop cube.glb
        objects 2
        settle 1
        note dropped
        save with_cube.toml
        save nowhere/scene.toml
        screenshot nowhere/a.png
        screenshot here.png
        await gone
        key Right
        errors 4
        note gone
        key Left
        settle 1
        note back
    ";
    let session = start(&folder, &display, script, "scene.toml");
    until("a screenshot", || folder.path("here.png").exists());
    fs::remove_file(folder.path("room_1.png")).expect("was there");
    fs::write(folder.path("gone"), "").expect("writes");
    let report = session.finish();
    let errors = report.errors();
    for words in ["broken.glb", "nowhere/a.png", "nowhere/scene.toml", "room_1.png"] {
        assert!(errors.contains(words), "no {words} in {errors}");
    }
    let cube = &report.note("dropped")["objects"][1];
    assert_eq!(cube["name"], "cube");
    assert!((vector(&cube["translation"])[1] + 1.35).abs() < 0.05, "it stands on the floor, at −1.5: {cube}");
    assert!(fs::read_to_string(folder.path("with_cube.toml")).expect("saved").contains("gltf = \"cube.glb\""));
    assert!(report.note("gone")["text"].to_string().contains("room_1.png"));
    assert_eq!(report.note("back")["frame"], 0);
}

#[test]
fn it_survives_being_resized() {
    let (folder, display) = (room(), Display::start());
    let mut script = String::from("settle 1\n");
    for k in 0..20 {
        script += &format!("size {}x{}\n", [1, 400, 90, 333][k % 4] + 3 * k, [240, 1, 70, 251][k % 4] + 5 * k);
        script += ["", "wait 1\n", "wait 2\n"][k % 3];
    }
    for mode in ["mailbox", "immediate", "fifo"] {
        script += &format!("present {mode}\nwait 2\n");
    }
    script += "lose\nwait 2\nlose\nlose\nwait 1\n";
    script +=
        "key F11\nwait 2\nkey F11\nkey F1\nsize 300x200\nwait 3\nkey F1\nsettle 1\nnote end\nscreenshot end.png\n";
    let report = play(&folder, &display, &script, "scene.toml");
    assert_eq!(report.0["errors"], serde_json::json!([]));
    assert_eq!(report.note("end")["window"], serde_json::json!([300, 200]));
    assert!(report.0["swapchains"].as_u64() >= Some(10), "its images were made anew");
    let size: Vec<u32> = serde_json::from_value(report.note("end")["picture"].clone()).expect("a size");
    let written = picture(&folder.path("end.png")).dimensions();
    assert_eq!([written.0, written.1], size[..]);
}

#[test]
fn without_a_display_it_says_so() {
    let folder = room();
    let problems = [
        ("--script nowhere.txt", &["nowhere.txt"][..]),
        ("--size 0x9", &["--size"]),
        ("--target-ms 0", &["--target-ms"]),
        ("scene.toml", &["DISPLAY", "needs a display"]),
    ];
    for (arguments, words) in problems {
        let mut command = Command::new(env!("CARGO_BIN_EXE_iprt"));
        command.arg("view").args(arguments.split_whitespace()).current_dir(folder.root());
        let output = command.env_remove("DISPLAY").env_remove("WAYLAND_DISPLAY").output().expect("runs");
        let said = said(&output);
        assert_eq!(output.status.code(), Some(2), "{arguments}: {said}");
        assert_eq!(said.trim_end().lines().count(), 1, "{said}");
        for word in words {
            assert!(said.contains(word), "{arguments}: no \"{word}\" in {said}");
        }
    }
}

#[test]
fn a_window_asks_before_changes_are_lost() {
    let (folder, display) = (room(), Display::start());
    // Nothing was changed, or all of it was taken back: it closes. Otherwise it asks, and only then closes.
    for (script, asked) in [
        ("settle 1\nclose\nnote never", None),
        ("key P\nsettle 1\nclick left 80,75\nkey Equals\nkey ctrl+Z\nclose\nnote never", None),
        (
            "key P\nsettle 1\nclick left 80,75\nkey Equals\nclose\nwait 3\nnote asked\nkey Escape\nwait 3\nnote went_on\nclose\nclose\nnote never",
            Some("asked"),
        ),
    ] {
        let report = play(&folder, &display, script, "scene.toml");
        let words: Vec<_> = report.0["notes"].as_array().expect("notes").iter().map(|n| n["note"].clone()).collect();
        assert!(!words.contains(&"never".into()), "it closes: {words:?}");
        if let Some(word) = asked {
            assert_eq!(report.note(word)["closing"], true);
            assert_eq!(report.note("went_on")["closing"], false);
            assert_eq!(report.note("went_on")["changed"], true);
        }
    }
}
