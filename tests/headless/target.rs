//! `--target-flip` and `--target-ms` as users give them: chosen from measured points, measured once, and the same as `--set`.

use crate::folder::Folder;
use std::{fs, path::PathBuf};

/// A box room with bright panels and a ball in it. What is given is not tried: five candidates are left.
const SCENE: &str = r#"
[panorama]
color = "room.png"
depth = { box = [4, 3, 5] }
[camera]
position = [0, 0, 0]
size = [40, 30]
[[object]]
name = "ball"
shape = "sphere"
size = [0.8, 0.8, 0.8]
translation = [0, -0.9, -1.5]
[render]
set = { relight_levels = 0, relight_width = 64, atrous_levels = 2 }
"#;

/// With a cache of its own.
struct Cached(Folder);

struct Said {
    status: Option<i32>,
    out: String,
    err: String,
}

impl Cached {
    fn new() -> Self {
        let folder = Self(Folder::empty());
        let panels = |x: u32, y: u32| if (x / 8 + y / 8).is_multiple_of(3) { [250, 240, 200] } else { [60, 70, 90] };
        folder.0.paint("room.png", panels);
        folder.0.write("scene.toml", SCENE);
        folder
    }

    fn path(&self, name: &str) -> PathBuf {
        self.0.path(name)
    }

    fn run(&self, arguments: &str) -> Said {
        let mut command = self.0.command();
        let output =
            command.args(arguments.split_whitespace()).env("IPRT_CACHE", self.path("cache")).output().expect("runs");
        let text = |bytes| String::from_utf8(bytes).expect("UTF-8");
        let said = Said { status: output.status.code(), out: text(output.stdout), err: text(output.stderr) };
        assert!(!said.err.contains("panicked"), "iprt {arguments}: {}", said.err);
        said
    }

    fn succeeds(&self, arguments: &str) -> Said {
        let said = self.run(arguments);
        assert_eq!(said.status, Some(0), "iprt {arguments}: {}", said.err);
        said
    }

    fn pixels(&self, name: &str) -> Vec<u8> {
        image::open(self.path(name)).expect("a picture").into_rgb8().into_raw()
    }

    /// The files of measured points.
    fn kept(&self) -> Vec<PathBuf> {
        let Ok(files) = fs::read_dir(self.path("cache")) else { return Vec::new() };
        let files = files.map(|file| file.expect("an entry").path());
        files
            .filter(|path| path.file_name().is_some_and(|name| name.to_string_lossy().starts_with("points-")))
            .collect()
    }
}

const MEASURING: &str = "nothing was measured for this view yet";

/// What was chosen, and the flags that make it.
fn chosen(err: &str) -> (String, String) {
    let line = err.lines().find(|line| line.starts_with("target: --method")).expect("it says what was chosen");
    let flags = line["target: ".len()..].split(';').next().expect("flags").to_owned();
    (line.to_owned(), flags)
}

/// The error that is predicted.
fn error(said: &str) -> f64 {
    let after = chosen(said).0.split("FLIP ").nth(1).expect("an error").to_owned();
    after.split_whitespace().next().expect("a word").parse().expect("a number")
}

#[test]
fn a_target_chooses_settings_that_are_measured_once() {
    let folder = Cached::new();
    let first = folder.succeeds("render scene.toml -o a.png --target-ms 1e6 --set bounces=2");
    assert!(first.err.contains(MEASURING) && first.err.contains("5 candidates measured at 40×30"), "{}", first.err);
    assert!(!first.err.contains("warning"), "{}", first.err);
    assert_eq!(folder.kept().len(), 1);
    let written = fs::read(&folder.kept()[0]).expect("reads");

    // With endless time it is the most accurate, whichever that is. The same flags without a target make the same picture.
    let (line, flags) = chosen(&first.err);
    assert!(flags.starts_with("--method "), "{flags}");
    let set = folder.succeeds(&format!("render scene.toml -o b.png --set bounces=2 {flags}"));
    assert!(!set.err.contains("target:"), "{}", set.err);
    assert!(folder.pixels("a.png") == folder.pixels("b.png"), "{flags} is what was rendered");
    let quiet = folder.succeeds("render scene.toml -o c.png -q --target-ms 1e6 --set bounces=2");
    assert_eq!((quiet.err.as_str(), quiet.out.as_str()), ("", ""));
    assert!(folder.pixels("a.png") == folder.pixels("c.png"));

    let plan = |arguments: &str| {
        let said = folder.succeeds(&format!("plan scene.toml --set bounces=2 --json plan.json {arguments}"));
        assert!(!said.err.contains(MEASURING) && !said.err.contains("target:"), "{}", said.err);
        said
    };
    assert!(plan("--target-ms 1e6").out.contains(&line), "the same choice from what was kept");
    let json = fs::read(folder.path("plan.json")).expect("reads");
    let json: serde_json::Value = serde_json::from_slice(&json).expect("JSON");
    assert_eq!(json["choice"]["flags"], flags.as_str());
    assert_eq!(json["choice"]["measured_at"], serde_json::json!([40, 30]));

    // Out of reach, the most accurate or the fastest is taken, with a warning.
    let told = |said: &Said, what: &str| said.err.matches(&format!("warning: {what}: out of reach")).count();
    let impossible = plan("--target-flip 1e-6");
    assert_eq!(chosen(&impossible.out), chosen(&first.err));
    assert_eq!(told(&impossible, "--target-flip 0.000001"), 1, "{}", impossible.err);
    let fastest = folder.succeeds("bench scene.toml --frames 0..1 --warmup 0 --target-ms 1e-6 --set bounces=2");
    assert_eq!(told(&fastest, "--target-ms 0.000001"), 1, "{}", fastest.err);
    // where anything is good enough, too
    let cheap = plan("--target-flip 0.9");
    assert!(cheap.err.is_empty() && error(&cheap.out) >= error(&first.err), "{} {}", cheap.out, cheap.err);
    assert_eq!(chosen(&fastest.err), chosen(&cheap.out));
    assert_eq!(chosen(&plan("--target-ms 1e6 --target-flip 0.9").out), chosen(&cheap.out));

    let paper = plan("--method paper --target-flip 0.9");
    assert!(chosen(&paper.out).1.starts_with("--method paper"), "{}", paper.out);
    assert_eq!(fs::read(&folder.kept()[0]).expect("reads"), written, "nothing was measured again");
}

#[test]
fn where_nothing_is_inserted_all_is_exact_and_damage_is_mended() {
    let folder = Cached::new();
    let plan = "plan scene.toml --without-objects --target-flip 0.01";
    let first = folder.succeeds(plan);
    assert!(first.err.contains(MEASURING) && !first.err.contains("warning"), "{}", first.err);
    assert!(first.out.contains("FLIP 0.000 against the view without objects"), "{}", first.out);
    let written = fs::read(&folder.kept()[0]).expect("reads");
    fs::write(&folder.kept()[0], &written[..written.len() - 9]).expect("writes");
    let mended = folder.succeeds(plan);
    assert!(mended.err.contains("damaged") && mended.err.contains(MEASURING), "{}", mended.err);
    assert!(!folder.succeeds(plan).err.contains("damaged"));
}

#[test]
fn targets_that_are_none_are_one_line() {
    let folder = Cached::new();
    for (arguments, words) in [
        ("render scene.toml -o a.png --target-ms 0", ["--target-ms", "\"0\"", "positive"]),
        ("render scene.toml -o a.png --target-ms -5", ["--target-ms", "-5", "positive"]),
        ("bench scene.toml --target-flip NaN", ["--target-flip", "NaN", "positive"]),
        ("plan scene.toml --target-flip much", ["--target-flip", "much", "positive"]),
        ("plan scene.toml --target-ms inf", ["--target-ms", "inf", "positive"]),
        ("plan scene.toml --method reference --target-ms 5", ["--method", "reference", "--spp"]),
    ] {
        let said = folder.run(arguments);
        assert_eq!((said.status, said.err.trim_end().lines().count()), (Some(2), 1), "{arguments}: {}", said.err);
        assert!(words.iter().all(|word| said.err.contains(word)), "{arguments}: {}", said.err);
    }
    for arguments in ["render scene.toml -o a.png --spp 4 --target-ms 5", "bench scene.toml --rays --target-flip 0.1"] {
        let said = folder.run(arguments);
        assert!(said.status == Some(2) && said.err.contains("cannot be used with"), "{arguments}: {}", said.err);
    }
    assert!(folder.kept().is_empty() && !folder.path("a.png").exists());
}
