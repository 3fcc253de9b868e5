//! Objects in the window: copied, moved by their arrows and along axes, painted, and the steps taken back.

use crate::view::{Display, mean, picture, play, room, vector};
use std::fs;

#[test]
fn objects_are_copied_and_moved_along_an_axis() {
    let (folder, display) = (room(), Display::start());
    let script = "
        key P
        settle 1
        click left 80,75
        wait 2
        note ball
        move 80,20
        wait 2
        note room
        hold Y
        drag left 80,75 80,45
        release Y
        note lifted
        drag left 80,45 100,50
        note level
        hold alt+F9
        drag left 100,50 100,80
        release alt+F9
        note landed
        key ctrl+Z
        key ctrl+Z
        key ctrl+D
        settle 1
        note copied
        save copied.toml
        key ctrl+Z
        note undone
    ";
    let report = play(&folder, &display, script, "scene.toml");
    assert_eq!(report.0["errors"], serde_json::json!([]));
    let under = |word: &str| report.note(word)["under"].as_str().expect("words").to_owned();
    let command = |word: &str| report.note(word)["command"].as_str().expect("words").to_owned();
    assert_eq!(command("copied"), "", "what is not in a file cannot be rendered");
    assert!(under("ball").starts_with("ball: 1."), "{}", under("ball"));
    assert!(under("room").starts_with("the room: ") && under("room").contains("radiance"), "{}", under("room"));
    let place = |word: &str, index: usize| vector(&report.note(word)["objects"][index]["translation"]);
    let (start, lifted) = (place("room", 0), place("lifted", 0));
    assert!(lifted[1] > start[1] + 0.3, "upwards: {start:?} {lifted:?}");
    assert!((lifted[0] - start[0]).abs() < 1e-4 && (lifted[2] - start[2]).abs() < 1e-4, "{start:?} {lifted:?}");
    let (level, landed) = (place("level", 0), place("landed", 0));
    assert!((level[1] - lifted[1]).abs() < 1e-4 && level[0] > lifted[0] + 0.1, "on its level: {level:?}");
    assert!((landed[1] + 1.2).abs() < 0.05, "on the floor, at −1.5: {landed:?}");
    let copied = report.note("copied");
    assert_eq!((&copied["selected"], &copied["objects"][1]["name"]), (&1.into(), &"ball-2".into()));
    assert!(place("copied", 1)[0] > lifted[0] + 0.6 && place("copied", 0) == lifted, "beside it: {copied}");
    assert_eq!(report.note("undone")["objects"].as_array().map(Vec::len), Some(1), "a copy is one step");
    let saved = fs::read_to_string(folder.path("copied.toml")).expect("saved");
    assert!(saved.contains("name = \"ball\" # the ball") && saved.contains("name = \"ball-2\""), "{saved}");
    // Nobody has turned or scaled anything, or chosen how the picture is made.
    for word in ["rotation", "scale", "method", "exposure", "fill_unseen"] {
        assert!(!saved.contains(word), "{word}: {saved}");
    }
    folder.succeeds("check copied.toml");
}

#[test]
fn an_arrow_moves_an_object_along_its_axis() {
    let (folder, display) = (room(), Display::start());
    // The arrow upwards begins where the box of the ball ends, some 20 points above its middle.
    let script = "
        key P
        settle 1
        click left 80,75
        wait 2
        note before
        drag left 80,47 80,37
        note up
        key ctrl+Z
        note back
    ";
    let report = play(&folder, &display, script, "scene.toml");
    let place = |word: &str| vector(&report.note(word)["objects"][0]["translation"]);
    let [before, up] = [place("before"), place("up")];
    assert!(up[1] > before[1] + 0.05, "{before:?} {up:?}");
    assert!((up[0] - before[0]).abs() < 1e-4 && (up[2] - before[2]).abs() < 1e-4, "{before:?} {up:?}");
    assert_eq!(place("back"), before);
}

#[test]
fn materials_are_set_by_hand_and_saved() {
    let (folder, display) = (room(), Display::start());
    let script = "
        key P
        settle 1
        click left 80,75
        settle 4
        screenshot grey.png
        material base_color=0,0.8,0
        material roughness=0.9
        settle 4
        screenshot green.png
        note painted
        save painted.toml
        key ctrl+D
        save copied.toml
        key ctrl+Z
        material base_color=
        save half.toml
        key ctrl+Z
        key ctrl+Z
        key ctrl+Z
        settle 4
        screenshot again.png
        note undone
    ";
    let report = play(&folder, &display, script, "scene.toml");
    assert_eq!(report.errors(), "[]");
    let green = |name: &str| {
        let picture = picture(&folder.path(name));
        let [r, g, b] = picture.get_pixel(80, 75).0;
        assert!(mean(&picture, 70..90, 65..85) > 5.0, "{name}");
        f64::from(g) / f64::from(r.max(b).max(1))
    };
    assert!(green("grey.png") < 1.3 && green("again.png") < 1.3, "{} {}", green("grey.png"), green("again.png"));
    assert!(green("green.png") > 2.0, "{}", green("green.png"));
    assert_eq!(
        report.note("painted")["steps"],
        serde_json::json!(["as opened", "material of ball", "material of ball"])
    );
    assert_eq!(report.note("undone")["steps"][0], "as opened");
    let saved = |name: &str| fs::read_to_string(folder.path(name)).expect("saved");
    let painted = saved("painted.toml");
    assert!(painted.contains("base_color = [0.0, 0.8, 0.0]") && painted.contains("roughness = 0.9"), "{painted}");
    assert!(painted.contains("# the ball"), "comments stay: {painted}");
    assert_eq!(saved("copied.toml").matches("roughness = 0.9").count(), 2, "{}", saved("copied.toml"));
    let half = saved("half.toml");
    assert!(!half.contains("base_color") && half.contains("roughness = 0.9"), "{half}");
    folder.succeeds("check copied.toml");
    // What the file says is what the window showed.
    folder.succeeds("render painted.toml --size 160x120 --warmup 3 -q -o rendered.png");
    assert!(green("rendered.png") > 2.0);
}
