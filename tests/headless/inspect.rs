//! What `iprt check` measures, on rooms whose size is known, and what it warns of.

use crate::{
    common::{enters, leaves},
    folder::Folder,
};
use glam::{Quat, Vec3, vec3};
use iprt::{
    image_file::{ExrLayer, write::write_exr},
    panorama::mapping::texel_direction,
};

const SIZE: [u32; 2] = [256, 128];

fn directions() -> impl Iterator<Item = Vec3> {
    (0..SIZE[0] * SIZE[1]).map(|i| texel_direction(i % SIZE[0], i / SIZE[0], SIZE).as_vec3())
}

/// A room of 4 × 2.6 × 5 m, seen 1.5 m over its floor, with two cupboards.
fn distance(d: Vec3) -> f32 {
    let walls = leaves(d, vec3(-2.0, -1.5, -2.5), vec3(2.0, 1.1, 2.5));
    let cupboards = [(vec3(-1.9, -1.5, -2.4), vec3(-0.9, 0.3, -1.8)), (vec3(1.2, -1.5, 0.4), vec3(1.9, -0.4, 2.2))];
    cupboards.into_iter().filter_map(|(low, high)| enters(d, low, high)).fold(walls, f32::min)
}

/// Each surface has a colour of its own.
fn paint(d: Vec3) -> Vec3 {
    let p = d * distance(d);
    let near = |value: f32, wall: f32| (value - wall).abs() < 1e-3;
    match p {
        p if near(p.y, -1.5) => vec3(0.3, 0.2, 0.1),
        p if near(p.y, 1.1) => Vec3::splat(0.9),
        p if near(p.x.abs(), 2.0) => vec3(0.6, 0.6, 0.5),
        p if near(p.z.abs(), 2.5) => vec3(0.4, 0.5, 0.6),
        _ => vec3(0.05, 0.02, 0.02),
    }
}

/// A folder with the room's colour and depth, both of which may be changed.
fn folder(depth: impl Fn(Vec3) -> f32, color: impl Fn(Vec3) -> Vec3, scene: &str) -> Folder {
    let folder = Folder::empty();
    let texels: Vec<[f32; 4]> = directions().map(|d| color(d).extend(1.0).to_array()).collect();
    write_exr(&folder.path("color.exr"), &[ExrLayer::rgb("", SIZE, &texels)]).expect("written");
    let channels = vec![("Y".to_owned(), directions().map(depth).collect())];
    write_exr(&folder.path("depth.exr"), &[ExrLayer { name: String::new(), size: SIZE, channels }]).expect("written");
    folder.write(
        "scene.toml",
        &format!("[panorama]\ncolor = 'color.exr'\ndepth = 'depth.exr'\nposition = [0, 1.5, 0]\n{scene}"),
    );
    folder
}

fn measured(folder: &Folder) -> serde_json::Value {
    serde_json::from_str(&folder.succeeds("check scene.toml --json -q")).expect("JSON")
}

fn warnings(folder: &Folder) -> Vec<String> {
    let report = measured(folder);
    let warnings = report["warnings"].as_array().expect("a list");
    warnings.iter().map(|warning| warning.as_str().expect("text").to_owned()).collect()
}

/// Demands one warning, with these words.
fn warns(folder: &Folder, words: &[&str]) {
    let found = warnings(folder);
    let fits = |warning: &String| words.iter().all(|word| warning.contains(word));
    assert!(found.len() == 1 && fits(&found[0]), "{words:?}: {found:#?}");
}

const CUBE: &str = "[[object]]\nname = 'cube'\nshape = 'box'\nsize = [0.4, 0.4, 0.4]\n";

#[test]
fn a_sound_room_is_measured_and_not_warned_of() {
    let folder = folder(distance, paint, &format!("{CUBE}translation = [0.3, 0.2, -1.2]\n"));
    let report = measured(&folder);
    let near = |value: &serde_json::Value, right: f64, tolerance: f64| {
        let value = value.as_f64().unwrap_or_else(|| panic!("{report:#}"));
        assert!((value - right).abs() < tolerance, "{value}, not {right}: {report:#}");
    };
    near(&report["floor"]["distance"], 1.5, 0.01);
    near(&report["floor"]["tilt"], 0.0, 0.2);
    near(&report["ceiling"]["distance"], 1.1, 0.01);
    near(&report["depth"]["holes"], 0.0, 1e-6);
    near(&report["color"]["radiance"][2], 0.9, 1e-3);
    near(&report["objects"][0]["size"][1], 0.4, 1e-3);
    near(&report["objects"][0]["gap"], 0.0, 0.02);
    assert_eq!(report["warnings"], serde_json::json!([]), "{report:#}");

    let printed = folder.succeeds("check scene.toml -o sheet.png --json=report.json --strict");
    assert!(printed.contains("no problems, 0 warnings"), "{printed}");
    let text = folder.succeeds("check scene.toml");
    assert!(text.contains("floor    1.50 m under the camera, tilted by 0."), "{text}");
    let sheet = image::open(folder.path("sheet.png")).expect("a PNG").into_rgb8();
    assert!(sheet.width() > 1000 && sheet.height() > 500);
    assert!(sheet.pixels().any(|p| p.0 == [215, 30, 30]), "the cube from above");
    assert!(folder.path("report.json").exists());
}

#[test]
fn units_are_recognised() {
    warns(&folder(|d| 1000.0 * distance(d), paint, ""), &["millimetres", "scale = 0.001"]);
    warns(&folder(|d| 100.0 * distance(d), paint, ""), &["centimetres", "scale = 0.01"]);
    warns(&folder(|d| 0.1 * distance(d), paint, ""), &["relative", "scale = 10.6"]);
    let disparity = |d| 200.0 / distance(d);
    warns(&folder(disparity, paint, "encoding = 'disparity'\n"), &["disparity without a scale", "scale = 213"]);
    assert!(warnings(&folder(disparity, paint, "encoding = 'disparity'\nscale = 200\n")).is_empty());
}

#[test]
fn depth_of_another_meaning_is_recognised() {
    warns(&folder(|d| 4.0 / distance(d), paint, ""), &["near and far", "encoding = \"disparity\""]);
    warns(&folder(|d| distance(d) * d.abs().max_element(), paint, ""), &["bent", "encoding = \"planar\""]);
    warns(&folder(distance, paint, "encoding = 'planar'\n"), &["bent", "encoding = \"radial\""]);
}

/// A corridor of 1.8 × 2.6 × 12 m, whose floor is farther than its walls.
fn corridor(d: Vec3) -> f32 {
    leaves(d, vec3(-0.9, -1.6, -6.0), vec3(0.9, 1.0, 6.0))
}

#[test]
fn corridors_are_not_taken_for_swapped() {
    let white = |_: Vec3| Vec3::ONE;
    let sound = folder(corridor, white, "");
    assert!(warnings(&sound).is_empty());
    sound.succeeds("new color.exr depth.exr -o new.toml --height 1.6");
    let text = std::fs::read_to_string(sound.path("new.toml")).expect("written");
    assert!(text.contains("encoding = \"radial\"\nscale = 1\n"), "{text}");
    warns(&folder(|d| 1000.0 * corridor(d), white, ""), &["millimetres", "scale = 0.001"]);
    warns(&folder(|d| corridor(d) * d.abs().max_element(), white, ""), &["bent", "encoding = \"planar\""]);
    warns(&folder(|d| 1.0 / corridor(d), white, ""), &["near and far", "encoding = \"disparity\" and scale = 1 "]);
    let lean = Quat::from_rotation_x(0.14);
    warns(&folder(|d| corridor(lean * d), white, ""), &["tilted by 8.0"]);
}

#[test]
fn check_does_not_warn_of_a_tilt_that_new_leaves() {
    // A floor that is bent by wrong depth is tilted, and its ceiling is not.
    let slanted = |d: Vec3| {
        leaves(d, vec3(-2.0, -1.5, -2.5), vec3(2.0, 1.1, 2.5)).min({
            let n = vec3(0.08, -1.0, 0.0).normalize();
            if n.dot(d) > 0.0 { 1.4 / n.dot(d) } else { f32::INFINITY }
        })
    };
    let folder = folder(slanted, |_| Vec3::ONE, "");
    assert!(!warnings(&folder).iter().any(|warning| warning.contains("tilted")));
    folder.succeeds("new color.exr depth.exr -o new.toml");
    assert!(!std::fs::read_to_string(folder.path("new.toml")).expect("written").contains("pitch"));
}

#[test]
fn pictures_that_do_not_fit_are_recognised() {
    let mirrored = |d: Vec3| paint(d * vec3(-1.0, 1.0, 1.0));
    warns(&folder(distance, mirrored, ""), &["mirrored"]);
    let turned = |d: Vec3| paint(Quat::from_rotation_y(1.0) * d);
    warns(&folder(distance, turned, ""), &["turned by"]);
    // The depth of another room, whose cupboards stand elsewhere.
    let other = |d: Vec3| {
        let walls = leaves(d, vec3(-3.0, -1.5, -2.0), vec3(2.5, 1.1, 4.0));
        let cupboards = [
            (vec3(0.3, -1.5, -1.9), vec3(0.9, 0.9, -1.2)),
            (vec3(-1.6, -1.5, 0.6), vec3(-0.8, 0.9, 1.4)),
            (vec3(-0.3, -1.5, 1.2), vec3(0.4, 0.2, 1.8)),
        ];
        cupboards.into_iter().filter_map(|(low, high)| enters(d, low, high)).fold(walls, f32::min)
    };
    let told = (0..8).filter(|k| {
        let turn = Quat::from_rotation_y(0.785 * *k as f32 + 0.3);
        let found = warnings(&folder(|d| other(turn * d), paint, ""));
        found.iter().any(|warning| warning.contains("of the depth"))
    });
    let told = told.count();
    assert!(told >= 5, "{told} of 8");
    // Directions of the file are turned to those of the room.
    let lean = Quat::from_rotation_z(0.1);
    let tilted = |keys: &str| folder(|d| distance(lean * d), |d| paint(lean * d), keys);
    warns(&tilted(""), &["tilted by 5.7", "pitch = 0.0 and roll = 5.7"]);
    warns(&tilted("yaw = 40\n"), &["tilted by 5.7", "pitch = 0.0 and roll = 5.7"]);
    let level = measured(&tilted("roll = 5.73\n"));
    assert!(level["floor"]["tilt"].as_f64().expect("a floor") < 0.4, "{level:#}");
    assert!((level["floor"]["distance"].as_f64().expect("a floor") - 1.5).abs() < 0.02, "{level:#}");
}

#[test]
fn objects_that_stand_wrong_are_told_how_to_stand() {
    let placed = |object: &str| folder(distance, paint, &format!("{CUBE}{object}\n"));
    warns(&placed("translation = [0.3, 0.5, -1.2]"), &["cube", "hangs 0.3", "translation = [0.300, 0.2"]);
    warns(&placed("translation = [0.3, 0.05, -1.2]"), &["cube", "sunk by 0.1", "translation = [0.300, 0.2"]);
    warns(&placed("translation = [0.3, 0.2, -4.2]"), &["cube", "outside"]);
    warns(&placed("translation = [0.3, 0.2, -1.2]\nscale = 1000"), &["cube", "capture point", "scale = 0.001"]);
    warns(&placed("translation = [0, 0, -30]\nscale = 100"), &["cube", "larger than the room", "scale = 0.01"]);
    let long = "[[object]]\nname = 'slab'\nshape = 'box'\nsize = [9, 0.4, 0.4]\ntranslation = [0, 0.2, -1.2]";
    warns(&folder(distance, paint, long), &["slab", "larger than the room", "along x"]);
    // Behind a cupboard, and where place puts it.
    assert!(warnings(&placed("translation = [-1.4, 0.2, -2.15]")).is_empty());
    assert!(warnings(&placed("place = { floor = [0.3, -1.2] }")).is_empty());
    let sphere = placed("");
    let text = format!("[panorama]\ncolor = 'color.exr'\ndepth = 4.0\n{CUBE}place = {{ floor = [0.3, -1.2] }}");
    sphere.write("scene.toml", &text);
    assert!(warnings(&sphere).is_empty());
    // On a cupboard, and moving through the air.
    assert!(warnings(&placed("translation = [1.5, 1.3, 1.2]")).is_empty());
    let key = "key = [{ time = 0, translation = [0, 1, -1] }, { time = 1, translation = [0, 2, -1] }]";
    assert!(warnings(&placed(key)).is_empty());
}

#[test]
fn strict_makes_warnings_errors() {
    let folder = folder(|d| 1000.0 * distance(d), paint, "");
    for command in ["check scene.toml --strict", "render scene.toml -o a.png --size 8x6 --warmup 0 --strict"] {
        let output = folder.run(command);
        let stderr = String::from_utf8_lossy(&output.stderr);
        assert_eq!(output.status.code(), Some(2), "{command}: {stderr}");
        assert!(stderr.contains("warning: depth.exr: its depth is from") && stderr.contains("--strict"), "{stderr}");
        assert_eq!(stderr.matches("millimetres").count(), 1, "each once: {stderr}");
    }
    assert!(!folder.path("a.png").exists(), "refused before it is rendered");
    let quiet = folder.run("render scene.toml -o a.png --size 8x6 --warmup 0 -q");
    assert!(quiet.status.success() && quiet.stderr.is_empty());
}

#[test]
fn output_that_nobody_reads_is_no_panic() {
    use std::{fs::File, process::Stdio};
    let folder = folder(|d| 1000.0 * distance(d), paint, "");
    let full = || Stdio::from(File::options().write(true).open("/dev/full").expect("there"));
    let closed = || {
        let (reader, writer) = std::io::pipe().expect("a pipe");
        drop(reader);
        Stdio::from(writer)
    };
    let run = |arguments: &str, stdout: Stdio, stderr: Stdio| {
        let mut command = folder.command();
        command.args(arguments.split_whitespace()).stdout(stdout).stderr(stderr);
        command.spawn().expect("starts").wait_with_output().expect("ends")
    };
    let render = "render scene.toml -o p_###.png --frames 0..1 --size 8x6 --warmup 0";
    for command in ["check scene.toml", render] {
        let output = run(command, closed(), Stdio::piped());
        let text = String::from_utf8_lossy(&output.stderr);
        assert!(output.status.code() == Some(0) && !text.contains("panicked"), "{command}: {text}");
        assert_eq!(run(command, Stdio::null(), closed()).status.code(), Some(0), "{command}");
        let output = run(command, full(), Stdio::piped());
        let text = String::from_utf8_lossy(&output.stderr);
        assert!(output.status.code() == Some(2) && text.contains("standard output"), "{command}: {text}");
        assert_eq!(run(command, Stdio::null(), full()).status.code(), Some(2), "{command}");
    }
    assert!(folder.path("p_000.png").exists() && folder.path("p_001.png").exists());
}

fn cube_model(folder: &Folder, side: f32) {
    let mesh = iprt::scene::shapes::Shape::Box.mesh(Vec3::splat(side));
    let model = iprt::scene::model::Model::from_mesh(mesh, crate::common::lambert(0.5));
    std::fs::write(folder.path("cube.glb"), iprt::scene::gltf::export::to_glb(&model).expect("writes"))
        .expect("written");
}

#[test]
fn objects_are_placed_by_the_room() {
    let gltf = "[[object]]\nname = 'cube'\ngltf = 'cube.glb'\n";
    let placed = |place: &str| {
        let folder = folder(distance, paint, &format!("{gltf}{place}\n"));
        cube_model(&folder, 2.0);
        folder
    };
    let bounds = |folder: &Folder, index: usize| {
        iprt::scene::Scene::load(&folder.path("scene.toml")).expect("loads").object_bounds(index, 0.0)
    };
    let on_floor = bounds(&placed("size = 0.3\nplace = { floor = [0.4, -1] }"), 0);
    assert!(on_floor.center().abs_diff_eq(vec3(0.4, 0.15, -1.0), 0.01), "{on_floor:?}");
    assert!((on_floor.max - on_floor.min).abs_diff_eq(Vec3::splat(0.3), 1e-3));
    // The column and row of the cupboard's top.
    let to_top = vec3(1.5, 1.1 - 1.5, 1.0);
    let pixel = iprt::panorama::mapping::coordinates(to_top.as_dvec3()) * glam::dvec2(256.0, 128.0);
    let on_top = bounds(&placed(&format!("scale = 0.1\nplace = {{ pixel = [{}, {}] }}", pixel.x, pixel.y)), 0);
    assert!((on_top.min.y - 1.1).abs() < 0.01 && (on_top.center().x - 1.5).abs() < 0.15, "{on_top:?}");
    let ball = "[[object]]\nshape = 'sphere'\nsize = 0.2\nplace = { on = 'cube' }";
    let stacked = bounds(&placed(&format!("size = 0.3\nplace = {{ floor = [0, -1], facing = 45 }}\n{ball}")), 1);
    assert!(stacked.center().abs_diff_eq(vec3(0.0, 0.4, -1.0), 0.01), "{stacked:?}");
    let below = bounds(&placed(&format!("size = 0.3\nplace = {{ floor = [0, -1], facing = 45 }}\n{ball}")), 0);
    let report = measured(&placed(&format!("size = 0.3\nplace = {{ floor = [0, -1], facing = 45 }}\n{ball}")));
    assert!((report["objects"][1]["gap"].as_f64().expect("a height") - 0.3).abs() < 0.01, "{report:#}");
    assert_eq!(report["warnings"], serde_json::json!([]), "what stands on an object does not hang");
    let gap = stacked.min.y - below.max.y;
    assert!(gap > 2e-4 && gap < 1e-3, "they share no plane: {gap}");

    for (place, words) in [
        ("place = { floor = [0, 0] }\ntranslation = [0, 0, 0]", "stands beside place"),
        ("place = { floor = [0, 0], on = 'x' }", "needs one of floor, pixel and on"),
        ("place = { on = 'table' }", "no object above it"),
        ("place = { floor = [0, 0], facing = 'door' }", "or \"camera\""),
        ("place = { pixel = [999, 0] }", "outside the picture"),
        ("size = [1, 1, 1]\nplace = { floor = [0, 0] }", "the largest side"),
    ] {
        placed(place).fails("check scene.toml", &[words]);
    }
}

#[test]
fn a_new_scene_is_right_at_the_first_try() {
    let place = |name: &str, factor: f32, power: i32| {
        let folder = folder(|d| factor * distance(d).powi(power), paint, "");
        cube_model(&folder, 300.0);
        let printed = folder.succeeds(&format!("new color.exr depth.exr cube.glb -o {name}.toml"));
        assert!(printed.contains("written"), "{printed}");
        let text = std::fs::read_to_string(folder.path(&format!("{name}.toml"))).expect("written");
        let report: serde_json::Value =
            serde_json::from_str(&folder.succeeds(&format!("check {name}.toml --json --strict"))).expect("JSON");
        let object = &report["objects"][0];
        assert!(object["gap"].as_f64().expect("over the floor").abs() < 0.03, "{text}{report:#}");
        assert!((object["size"][0].as_f64().expect("a size") - 0.4).abs() < 0.2, "{text}");
        text
    };
    assert!(place("metres", 1.0, 1).contains("position = [0, 1.500, 0]"));
    assert!(place("millimetres", 1000.0, 1).contains("scale = 0.001"));
    let text = place("relative", 0.05, 1);
    assert!(text.contains("scale = 21.3") && text.contains("position = [0, 1.59"), "{text}");
    let text = place("disparity", 3.0, -1);
    assert!(text.contains("encoding = \"disparity\"") && text.contains("scale = 3.2"), "{text}");

    // A tall model is in the picture from head to foot.
    let tall = folder(distance, paint, "");
    cube_model(&tall, 1.5);
    tall.succeeds("new color.exr depth.exr cube.glb -o tall.toml");
    let text = std::fs::read_to_string(tall.path("tall.toml")).expect("written");
    let value = |key: &str| text.split(key).nth(1).and_then(|rest| rest.split(['\n', ']']).next()).expect("a key");
    let look: Vec<f32> = value("look_at = [").split(',').map(|x| x.trim().parse().expect("a number")).collect();
    let half = 0.5 * value("fov_y = ").parse::<f32>().expect("a number");
    let away = look[0].hypot(look[2]);
    let elevation = |over: f32, away: f32| (over - 1.5).atan2(away).to_degrees();
    let middle = elevation(look[1], away);
    assert!(elevation(0.0, away - 0.75) > middle - half && elevation(1.5, away) < middle + half, "{text}");

    let folder = folder(distance, paint, "");
    folder.succeeds("new color.exr -o box.toml");
    folder.fails("new color.exr -o box.toml", &["box.toml", "--force"]);
    folder.fails("new color.exr depth.exr color.exr -o two.toml", &["second image of depth"]);
    folder.fails("check apartmnt", &["did you mean `apartment`?"]);
}

/// Writes codes of the room's depth as a grey picture, and returns what `iprt new` makes of it with `check`'s report.
fn new_scene(depth: impl Fn(Vec3) -> f32, most: f32, turn: Quat) -> (String, serde_json::Value) {
    let folder = folder(distance, |d| paint(turn * d), "");
    let codes: Vec<f32> = directions().map(|d| (depth(turn * d) * most).round().clamp(0.0, most)).collect();
    let [width, height] = SIZE;
    let at = |x: u32, y: u32| codes[(y * width + x) as usize];
    match most {
        255.0 => image::GrayImage::from_fn(width, height, |x, y| image::Luma([at(x, y) as u8]))
            .save(folder.path("depth.png"))
            .expect("written"),
        _ => image::ImageBuffer::from_fn(width, height, |x, y| image::Luma([at(x, y) as u16]))
            .save(folder.path("depth.png"))
            .expect("written"),
    }
    folder.succeeds("new color.exr depth.png -o new.toml --height 1.5");
    let text = std::fs::read_to_string(folder.path("new.toml")).expect("written");
    (text, serde_json::from_str(&folder.succeeds("check new.toml --json -q")).expect("JSON"))
}

/// Says that the room has its height and that the ball stands on its floor. Of 255 grey values the offset is known to
/// some hundredths, and the ball is found 28 mm too low.
fn is_the_room((text, report): &(String, serde_json::Value), within: f64) {
    let number = |value: &serde_json::Value| value.as_f64().unwrap_or(f64::NAN);
    assert!((number(&report["floor"]["distance"]) - 1.5).abs() < within, "{text}{report:#}");
    assert!((number(&report["ceiling"]["distance"]) - 1.1).abs() < within, "{text}{report:#}");
    assert!(number(&report["floor"]["tilt"]) < 0.6, "{text}{report:#}");
    assert!(number(&report["objects"][0]["gap"]).abs() < 0.04, "{text}{report:#}");
}

#[test]
fn relative_depth_that_fills_its_range_is_fitted_to_the_room() {
    let (near, far) = directions().map(distance).fold((f32::MAX, 0.0_f32), |(a, b), d| (a.min(d), b.max(d)));
    let share = |d: Vec3| (distance(d) - near) / (far - near);
    for most in [255.0, 65535.0] {
        let stretched = new_scene(share, most, Quat::IDENTITY);
        assert!(stretched.0.contains("encoding = \"radial\"") && stretched.0.contains("offset = "), "{}", stretched.0);
        is_the_room(&stretched, 0.05);
        // Distances as shares of the largest need no offset.
        let shares = new_scene(|d| distance(d) / far, most, Quat::IDENTITY);
        assert!(!shares.0.contains("offset"), "{}", shares.0);
        is_the_room(&shares, 0.05);
    }
    let turned = new_scene(|d| 1.0 - share(d), 65535.0, Quat::IDENTITY);
    assert!(turned.0.contains("turned round") && turned.0.contains("scale = -"), "{}", turned.0);
    is_the_room(&turned, 0.05);
    let disparity = new_scene(|d| (near / distance(d) - near / far) / (1.0 - near / far), 65535.0, Quat::IDENTITY);
    assert!(disparity.0.contains("encoding = \"disparity\""), "{}", disparity.0);
    is_the_room(&disparity, 0.1);
}

#[test]
fn a_camera_that_was_tilted_is_levelled() {
    let tilted = Quat::from_rotation_z(-0.1) * Quat::from_rotation_x(0.08);
    let metres = |d: Vec3| distance(d) / 65.535;
    let scene = new_scene(metres, 65535.0, tilted);
    assert!(scene.0.contains("\npitch = 4.6\n") && scene.0.contains("\nroll = -5.7\n"), "{}", scene.0);
    is_the_room(&scene, 0.02);
    // A floor that the depth bends, under a ceiling that is level, is no tilt of the camera.
    let bent = |d: Vec3| metres(d) * if d.y < 0.0 { 1.0 + 0.12 * d.y * d.z } else { 1.0 };
    let (text, report) = new_scene(bent, 65535.0, Quat::IDENTITY);
    assert!(report["floor"]["tilt"].as_f64().expect("a floor") > 2.0, "{report:#}");
    assert!(!text.contains("pitch"), "{text}");
}

/// The commands of the README's "Your own panorama", but the window's.
#[test]
fn the_readmes_first_steps_work() {
    let readme = std::fs::read_to_string(concat!(env!("CARGO_MANIFEST_DIR"), "/README.md")).expect("there");
    let section = readme.split("## Your own panorama").nth(1).expect("a section");
    let block = section.split("```sh\n").nth(1).and_then(|rest| rest.split("```").next()).expect("commands");
    let folder = folder(distance, paint, "");
    cube_model(&folder, 0.4);
    std::fs::rename(folder.path("cube.glb"), folder.path("teapot.glb")).expect("renamed");
    let picture = image::RgbImage::from_fn(SIZE[0], SIZE[1], |x, y| {
        let color = paint(texel_direction(x, y, SIZE).as_vec3());
        image::Rgb(color.to_array().map(iprt::image_file::write::display_code))
    });
    picture.save(folder.path("room.png")).expect("written");
    let millimetres = image::ImageBuffer::from_fn(SIZE[0], SIZE[1], |x, y| {
        image::Luma([(1000.0 * distance(texel_direction(x, y, SIZE).as_vec3())) as u16])
    });
    millimetres.save(folder.path("depth.png")).expect("written");
    let mut ran = 0;
    for line in block.lines() {
        let command = line.split('#').next().unwrap_or_default().trim().trim_start_matches("iprt ");
        if command.starts_with("view") {
            continue;
        }
        let small = if command.starts_with("render") { " --size 96x54 --warmup 3" } else { "" };
        folder.succeeds(&format!("{command}{small}"));
        ran += 1;
    }
    assert_eq!(ran, 3, "{block}");
    assert!(folder.path("picture.png").exists() && folder.path("sheet.png").exists());
}

#[test]
fn what_is_masked_is_not_known() {
    let folder = folder(distance, paint, "mask = 'mask.png'\n");
    let mask = image::GrayImage::from_fn(8, 4, |_, y| image::Luma([if y == 3 { 0 } else { 255 }]));
    mask.save(folder.path("mask.png")).expect("written");
    let report = measured(&folder);
    let holes = report["depth"]["holes"].as_f64().expect("a share");
    assert!((holes - 0.146).abs() < 0.01, "a quarter of the rows at the bottom: {holes}");
    assert!(report["warnings"][0].as_str().expect("text").contains("25.0 % of its texels"), "{report:#}");
}
