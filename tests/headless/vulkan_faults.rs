//! A layer makes Vulkan calls fail, one in each run. Whatever fails, a command ends by itself with one line and an exit
//! status, and leaves whole files or none. `IPRT_FAULTS=all` tries every call (`make faults`). Otherwise it is the first
//! and the last of each name for `render`, and of some names for the others.

use crate::{folder::Folder, layers, view::Display};
use std::{
    collections::BTreeMap,
    fs,
    process::{Output, Stdio},
    time::{Duration, Instant},
};

pub const SCENE: &str = r#"
[panorama]
color = "room_%d.png"
depth = { box = [4, 3, 5] }
frames = [0, 1]
[camera]
size = [16, 12]
[[object]]
shape = "box"
size = [0.6, 0.6, 0.6]
translation = [0, -0.2, -1.5]
"#;

/// A command that is tried, what it writes, and the display that it needs.
struct Tried<'a> {
    folder: &'a Folder,
    arguments: &'a str,
    outputs: &'a [&'a str],
    display: Option<&'a Display>,
    /// The calls that are tried, if not all.
    sample: Option<&'a [&'a str]>,
}

/// Those after which work may be going on, and one of each kind of the others.
const SAMPLE: [&str; 6] = [
    "vkWaitForFences",
    "vkQueueSubmit2",
    "vkEndCommandBuffer",
    "vkCreateImage",
    "vkGetQueryPoolResults",
    "vkDeviceWaitIdle",
];
/// The same of a window.
const WINDOW_SAMPLE: [&str; 6] = [
    "vkWaitForFences",
    "vkQueueSubmit2",
    "vkQueuePresentKHR",
    "vkAcquireNextImageKHR",
    "vkCreateSwapchainKHR",
    "vkCreateSemaphore",
];

/// What calls may answer besides what the layer usually lets them answer: out of host or device memory, a timeout, results
/// that are not there yet, and of windows a picture chain that is out of date or a surface that is lost.
const OTHER_ANSWERS: [(&str, &[i32]); 8] = [
    ("vkWaitForFences", &[-1, 2, -4]),
    ("vkQueueSubmit2", &[-1, -2]),
    ("vkDeviceWaitIdle", &[-1]),
    ("vkGetQueryPoolResults", &[-1, 1]),
    ("vkAllocateMemory", &[-1]),
    ("vkCreateComputePipelines", &[-1]),
    ("vkAcquireNextImageKHR", &[-1_000_001_004, -1_000_000_000, -1]),
    ("vkQueuePresentKHR", &[-1_000_001_004, -1_000_000_000, -1]),
];

impl Tried<'_> {
    fn run(&self, variables: &[(&str, &str)]) -> Output {
        let mut command = self.folder.command();
        layers::put(&mut command, "VK_LAYER_IPRT_fault")
            .args(self.arguments.split_whitespace())
            .env("IPRT_CACHE", self.folder.path("cache"))
            .envs(variables.iter().copied())
            .stdin(Stdio::null())
            .stdout(Stdio::piped())
            .stderr(Stdio::piped());
        if let Some(display) = self.display {
            command.env("DISPLAY", &display.name).env_remove("WAYLAND_DISPLAY");
        }
        let mut child = command.spawn().expect("starts");
        let start = Instant::now();
        while child.try_wait().expect("runs").is_none() {
            // A wait of the program's own would be 600 s.
            if start.elapsed() > Duration::from_secs(400) {
                child.kill().expect("runs");
                panic!("iprt {} hangs with {variables:?}", self.arguments);
            }
            std::thread::sleep(Duration::from_millis(5));
        }
        child.wait_with_output().expect("ends")
    }

    fn remove(&self) {
        self.outputs.iter().for_each(|name| drop(fs::remove_file(self.folder.path(name))));
    }

    /// The names of the calls of a run in which nothing fails.
    fn calls(&self) -> Vec<String> {
        let file = self.folder.path("calls");
        let _ = fs::remove_file(&file);
        let output = self.run(&[("FAULT_COUNT", file.to_str().expect("text"))]);
        assert_eq!(output.status.code(), Some(0), "{}", String::from_utf8_lossy(&output.stderr));
        fs::read_to_string(file).expect("the layer is used").lines().map(str::to_owned).collect()
    }

    /// Makes calls fail, each in a run of its own.
    fn survives(&self) {
        // The first run also fills the cache of pipelines, which changes what is called.
        self.calls();
        let calls = self.calls();
        let whole: Vec<_> =
            self.outputs.iter().map(|name| fs::read(self.folder.path(name)).expect("written")).collect();
        let mut places: BTreeMap<&str, Vec<usize>> = BTreeMap::new();
        calls.iter().enumerate().for_each(|(at, name)| places.entry(name).or_default().push(at));
        assert!(places.len() > 20, "{places:?}");
        for (name, places) in &places {
            let ends = [places[0], places[places.len() - 1]];
            let chosen = match (every_call(), self.sample) {
                (true, _) => places.as_slice(),
                (false, Some(sample)) if !sample.contains(name) => &[],
                (false, _) => &ends[..places.len().min(2)],
            };
            let others = OTHER_ANSWERS.iter().find(|(call, _)| call == name).map_or(&[][..], |(_, answers)| *answers);
            let usual = chosen.iter().map(|at| (*at, None));
            let others = others.iter().flat_map(|answer| {
                let places = if every_call() { chosen } else { &chosen[..chosen.len().min(1)] };
                places.iter().map(|at| (*at, Some(answer.to_string())))
            });
            for (at, result) in usual.chain(others) {
                self.remove();
                let number = at.to_string();
                let mut variables = vec![("FAULT_AT", &number[..])];
                variables.extend(result.as_deref().map(|result| ("FAULT_RESULT", result)));
                let output = self.run(&variables);
                let stderr = String::from_utf8_lossy(&output.stderr);
                let what = format!(
                    "iprt {}, {name}, call {at} of {} with {variables:?}: {:?}: {stderr}",
                    self.arguments,
                    calls.len(),
                    output.status
                );
                let status = output.status.code().unwrap_or_else(|| panic!("{what}"));
                assert!((0..=3).contains(&status) && !stderr.contains("panicked"), "{what}");
                let lines =
                    stderr.lines().filter(|line| line.starts_with("iprt: ") || line.starts_with("error: ")).count();
                assert!(lines == usize::from(status != 0), "one line: {what}");
                for (name, whole) in self.outputs.iter().zip(&whole) {
                    match fs::read(self.folder.path(name)) {
                        Ok(bytes) => assert!(&bytes == whole || name.ends_with("json"), "{name} differs: {what}"),
                        Err(_) => assert_ne!(status, 0, "{name} is missing: {what}"),
                    }
                }
                let left = self.folder.root().read_dir().expect("readable").filter_map(Result::ok);
                let left: Vec<_> = left.map(|e| e.file_name().to_string_lossy().into_owned()).collect();
                assert!(!left.iter().any(|name| name.starts_with(".iprt-")), "{left:?} {what}");
                // A layer says what leaked, where it can still be asked.
                assert!(!stderr.contains("VUID-"), "{what}");
            }
        }
    }
}

/// Whether every call is tried.
fn every_call() -> bool {
    std::env::var("IPRT_FAULTS").is_ok_and(|all| all == "all")
}

/// Two video frames, and a box that stands.
pub fn folder() -> Folder {
    let folder = Folder::empty();
    for frame in 0..2 {
        folder.paint(&format!("room_{frame}.png"), |x, y| [(4 * x) as u8, (8 * y) as u8, 90 + frame]);
    }
    folder.write("scene.toml", SCENE);
    folder
}

fn survives(arguments: &str, outputs: &[&str], sample: Option<&[&str]>) {
    Tried { folder: &folder(), arguments, outputs, display: None, sample }.survives();
}

#[test]
fn render_survives_each_failure() {
    // Most of a run's time is that of compiling what objects need. All names are called without them.
    let objects = if every_call() { "" } else { "--without-objects" };
    let arguments = format!("render scene.toml -o p_%d.exr --frames 0..1 --warmup 1 -q {objects}");
    survives(&arguments, &["p_0.exr", "p_1.exr"], None);
}

#[test]
fn render_under_validation_leaks_nothing() {
    survives("render scene.toml -o p.png --warmup 0 -vv --validation", &["p.png"], Some(&SAMPLE));
}

#[test]
fn bench_survives_each_failure() {
    survives("bench scene.toml --frames 0..1 --warmup 0 -q --json b.json", &["b.json"], Some(&SAMPLE));
}

#[test]
fn reference_survives_each_failure() {
    survives("reference scene.toml -o r.exr --spp 2 --set relight_warmup=2 -q", &["r.exr"], Some(&SAMPLE));
}

#[test]
fn the_window_survives_each_failure() {
    let (folder, display) = (folder(), Display::start());
    folder.write("play", "wait 5\nsize 300x200\nsettle 2\n");
    let arguments = "view scene.toml --size 160x120 --script play --report report.json -q";
    Tried {
        folder: &folder,
        arguments,
        outputs: &["report.json"],
        display: Some(&display),
        sample: Some(&WINDOW_SAMPLE),
    }
    .survives();
}
