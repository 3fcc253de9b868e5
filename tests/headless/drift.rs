//! Memory stays what it is, however many frames are made of a moving scene with a new video frame each.

use crate::{folder::Folder, layers, vulkan_faults::SCENE};
use std::{
    collections::VecDeque,
    fs,
    path::PathBuf,
    process::Command,
    time::{Duration, Instant},
};

/// Frames before memory is looked at, and those that it must be the same for.
const SETTLED: u32 = 300;
const MORE: u32 = 300;
/// What counts as growth, bytes a frame. lavapipe once lost 316,000.
const LIMIT: f64 = 16384.0;

/// Two pictures by turns, and a box that moves.
fn folder() -> Folder {
    let folder = Folder::empty();
    for odd in 0..2 {
        folder.paint(&format!("{odd}.png"), |x, y| [(4 * x) as u8, (8 * y) as u8, 90 + 20 * odd]);
    }
    for frame in 0..SETTLED + MORE {
        let [of, name] = [format!("{}.png", frame % 2), format!("room_{frame}.png")].map(|name| folder.path(&name));
        fs::hard_link(of, name).expect("linked");
    }
    let moving =
        "key = [{ time = 0, translation = [-0.3, -0.2, -1.5] }, { time = 20, translation = [0.3, -0.2, -1.5] }]";
    let frames = format!("frames = [0, {}]", SETTLED + MORE - 1);
    folder.write("scene.toml", &format!("{}{moving}\n", SCENE.replace("frames = [0, 1]", &frames)));
    folder
}

/// Runs a command. Returns its memory in bytes when each of these files is there: the most of the fifth of a second before.
fn memory_at(command: &mut Command, marks: &[PathBuf]) -> Vec<f64> {
    let mut child = command.spawn().expect("starts");
    let (mut seen, mut found) = (VecDeque::new(), Vec::new());
    while child.try_wait().expect("runs").is_none() {
        let memory = fs::read_to_string(format!("/proc/{}/statm", child.id())).expect("tests of memory need Linux");
        let pages: f64 = memory.split(' ').nth(1).and_then(|word| word.parse().ok()).expect("a number");
        seen.push_back((Instant::now(), pages * 4096.0));
        while seen[0].0.elapsed() > Duration::from_millis(200) && seen.len() > 1 {
            seen.pop_front();
        }
        let there = |mark: &&PathBuf| fs::metadata(mark).is_ok_and(|data| data.len() > 0);
        if marks.get(found.len()).is_some_and(|mark| there(&mark)) {
            found.push(seen.iter().map(|(_, bytes)| *bytes).fold(0.0, f64::max));
        }
        std::thread::sleep(Duration::from_millis(2));
    }
    assert!(child.wait().expect("ends").success() && found.len() == marks.len(), "{found:?} of {marks:?}");
    found
}

/// Bytes that each frame of `render` adds.
fn growth(folder: &Folder, method: &str, leak: &str) -> f64 {
    let last = SETTLED + MORE - 1;
    let mut command = folder.command();
    command
        .args(format!("render scene.toml -o p_%d.png --frames 0..{last} --warmup 0 -q --method {method}").split(' '))
        .args(["--set", "relight_width=16"]);
    layers::put(&mut command, "VK_LAYER_IPRT_fault").env("FAULT_LEAK", leak);
    let at = memory_at(&mut command, &[SETTLED, last].map(|frame| folder.path(&format!("p_{frame}.png"))));
    (at[1] - at[0]) / f64::from(MORE)
}

#[test]
fn render_does_not_grow() {
    let grown = growth(&folder(), "iprt", "0");
    assert!(grown < LIMIT, "it grows by {grown:.0} bytes a frame");
    let grown = growth(&folder(), "ibl", "65536");
    assert!(grown > 2.0 * LIMIT, "a leak would be seen: {grown:.0} bytes a frame");
}
