//! Scene files: what is understood, and what is said of the rest.

use glam::{EulerRot, Quat, Vec3};
use image::{ImageBuffer, Rgb};
use iprt::{
    cli::{check, common::DeviceArgs},
    scene::Scene,
};
use std::path::{Path, PathBuf};
use tempfile::TempDir;

const PANORAMA: &str = "[panorama]\ncolor = 'c.png'\ndepth = 2\nposition = [0, 1.3, 0]\n";

/// A folder with a panorama and this scene file.
fn written(text: &str) -> (TempDir, PathBuf) {
    let folder = tempfile::tempdir().expect("a folder");
    ImageBuffer::from_pixel(4, 2, Rgb([99_u8; 3])).save(folder.path().join("c.png")).expect("saved");
    let path = folder.path().join("scene.toml");
    std::fs::write(&path, text).expect("written");
    (folder, path)
}

/// All problems of a scene file, each checked to be one line that names the file.
fn problems(text: &str) -> Vec<String> {
    let (_folder, path) = written(text);
    let (problems, _) = Scene::problems(&path);
    for problem in &problems {
        assert!(!problem.to_string().contains('\n'), "{problem}");
        assert_eq!(problem.exit_code(), 2, "{problem}");
    }
    if let Err(first) = Scene::load(&path) {
        assert_eq!(first.to_string(), problems[0].to_string());
    }
    problems.iter().map(ToString::to_string).collect()
}

/// The only problem holds all these words.
fn one_problem(text: &str, words: &[&str]) {
    let found = problems(text);
    assert_eq!(found.len(), 1, "{text}: {found:?}");
    for word in words {
        assert!(found[0].contains(word), "{text}: \"{word}\" is not in: {}", found[0]);
    }
}

fn load(text: &str) -> Scene {
    let (_folder, path) = written(text);
    Scene::load(&path).unwrap_or_else(|error| panic!("{error}"))
}

#[test]
fn defaults() {
    let scene = load(PANORAMA);
    let camera = scene.at(0.0, 0.0).camera;
    assert_eq!(camera.position, Vec3::new(0.0, 1.3, 0.0));
    assert!((camera.rotation * Vec3::NEG_Z).abs_diff_eq(Vec3::NEG_Z, 1e-6));
    assert_eq!((camera.fov_y_degrees, camera.size), (60.0, [1280, 720]));
    assert_eq!((scene.render.method.as_str(), scene.render.exposure), ("iprt", 1.0));
    assert_eq!((scene.panorama.fps, scene.panorama.yaw_degrees, scene.panorama.frame_count()), (30.0, 0.0, 1));
    assert!(scene.name == "scene" && scene.warnings.is_empty() && scene.instance_count() == 0);
    assert!(scene.at(0.0, 0.0).instances.nodes.is_empty());
}

#[test]
fn unknown_keys_name_the_nearest_known_one() {
    one_problem(
        "[panorama]\ncolour = 'c.png'\ncolor = 'c.png'\ndepth = 2",
        &["panorama.colour", "unknown key", "`color`"],
    );
    one_problem(&format!("{PANORAMA}[camrea]"), &["camrea", "`camera`"]);
    one_problem(&format!("{PANORAMA}[camera]\nfovy = 3"), &["camera.fovy", "`fov_y`"]);
    one_problem(
        &format!("{PANORAMA}[[object]]\nshape = 'box'\nmaterial = {{ rougness = 1 }}"),
        &["object[0].material.rougness", "`roughness`"],
    );
    one_problem(&format!("{PANORAMA}[[object]]\nshape = 'bax'"), &["object[0].shape", "\"bax\"", "`box`"]);
    one_problem(
        &format!("{PANORAMA}[camera]\nkey = [ {{ time = 0, yaw = 1, rol = 2 }} ]"),
        &["camera.key[0].rol", "known here"],
    );
    one_problem(&format!("{PANORAMA}[room]\nglft = 'a'\ngltf = 'b.glb'"), &["room.glft", "`gltf`"]);
}

#[test]
fn wrong_values_name_field_and_remedy() {
    for (text, words) in [
        ("[panorama]\ncolor = 3\ndepth = 2", ["panorama.color", "expected a string, found an integer", "write"]),
        ("[panorama]\ncolor = 'c.png'\ndepth = true", ["panorama.depth", "neither file, number nor box", "give"]),
        ("[panorama]\ncolor = 'c.png'\ndepth = -1", ["panorama.depth", "out of range", "above 0"]),
        (
            "[panorama]\ncolor = 'c.png'\ndepth = { box = [1, 1, 1], center = [9, 0, 0] }",
            ["panorama.depth.box", "outside the box", "check"],
        ),
        (
            "[panorama]\ncolor = 'c.png'\ndepth = 2\npacking = 'top-bottom'",
            ["panorama.depth", "already holds the depth", "leave"],
        ),
        ("[panorama]\ncolor = 'c.png'\ndepth = 2\nframes = [5, 2]", ["panorama.frames", "no range", "[first, last]"]),
        (
            "[panorama]\ncolor = 'c.png'\ndepth = 2\nposition = [1, 2]",
            ["panorama.position", "array of 3 finite numbers, found an array of 2", "write"],
        ),
        ("[panorama]\ncolor = 'c.png'\ndepth = 2\nexposure = nan", ["panorama.exposure", "found NaN", "write"]),
        ("[panorama]\ncolor = 'c.png'\ndepth = 2\nexposure = 0", ["panorama.exposure", "out of range", "above 0"]),
        ("[panorama]\ncolor = 'v.mp4'\ndepth = 2", ["v.mp4", "no such file", "check"]),
        ("[panorama]\ncolor = '$NO_SUCH_NAME/c.png'\ndepth = 2", ["panorama.color", "NO_SUCH_NAME", "export"]),
        ("[panorama]\ncolor = '${NO_SUCH_NAME}/c.png'\ndepth = 2", ["panorama.color", "NO_SUCH_NAME", "export"]),
        ("[panorama]\ncolor = '%d_%d.png'\ndepth = 2", ["%d_%d.png", "two frame numbers", "%04d"]),
        ("[panorama]\ncolor = 'c.png'\n", ["panorama.depth", "is missing", "radius"]),
        ("[panorama\n", ["scene.toml: line 1", "", "TOML"]),
        ("[camera]\n", ["panorama", "is missing", "add [panorama]"]),
    ] {
        one_problem(text, &words);
    }
    for (text, words) in [
        ("[camera]\nfov_y = 180", ["camera.fov_y", "out of range", "between 0 and 180"]),
        ("[camera]\nsize = [0, 4]", ["camera.size", "no image size", "16384"]),
        ("[camera]\nlook_at = [0, 0, 0]\nyaw = 3", ["camera.look_at", "beside yaw", "give"]),
        ("[camera]\nlook_at = [0, 1.3, 0]", ["camera.look_at", "where the camera stands", "in front"]),
        ("[camera]\nkey = [ { yaw = 3 } ]", ["camera.key[0].time", "is missing", "seconds"]),
        (
            "[camera]\nkey = [ { time = 3, size = [2, 2], yaw = 1 } ]",
            ["camera.key[0].size", "cannot change", "[camera]"],
        ),
        ("[[object]]\nname = 'x'", ["object[0].gltf", "both missing", "give one"]),
        ("[[object]]\nshape = 'box'\nsize = [1, 0, 1]", ["object[0].size", "not positive", "metres"]),
        ("[[object]]\nshape = 'box'\nscale = 0", ["object[0].scale", "flattens", "not 0"]),
        ("[[object]]\nshape = 'box'\nrotation = [1, 2]", ["object[0].rotation", "no rotation", "quaternion"]),
        (
            "[[object]]\nshape = 'box'\nmaterial = { metallic = 2 }",
            ["object[0].material.metallic", "out of range", "0 to 1"],
        ),
        ("[[object]]\ngltf = 'absent.glb'", ["absent.glb", "no such file", "check"]),
        ("[room]\ngltf = 'absent.glb'", ["absent.glb", "no such file", "check"]),
        ("[render]\nset = 3", ["render.set", "no table", "key = value"]),
        ("object = 3", ["object", "expected an array of tables", "[[object]]"]),
    ] {
        let whole = if text.starts_with('[') { format!("{PANORAMA}{text}") } else { format!("{text}\n{PANORAMA}") };
        if text.contains("[room]") {
            assert!(problems(&whole)[0].contains("no such file"));
        } else {
            one_problem(&whole, &words);
        }
    }
}

#[test]
fn every_problem_is_reported_at_once() {
    let found = problems(
        "[panorama]\ncolor = 'absent_%d.png'\ndepth = 'absent.exr'\nframes = [0, 1]\n[[object]]\ngltf = 'one.glb'\n[[object]]\ngltf = 'two.glb'\n[room]\ngltf = 'three.glb'",
    );
    for name in ["absent_0.png", "one.glb", "two.glb", "three.glb"] {
        assert!(found.iter().any(|problem| problem.contains(name)), "{name}: {found:?}");
    }
    let found = problems("[panorama]\ncolr = 1\nfps = 'x'\n[camera]\nfov_y = 999\n[rendr]");
    assert!(found.len() >= 5, "{found:?}");
}

#[test]
fn each_frame_of_a_sequence_is_checked() {
    let (folder, path) = written("[panorama]\ncolor = 'f%d.png'\ndepth = 2");
    for number in 0..3 {
        std::fs::copy(folder.path().join("c.png"), folder.path().join(format!("f{number}.png"))).expect("copied");
    }
    let whole = std::fs::read(folder.path().join("f1.png")).expect("read");
    std::fs::write(folder.path().join("f1.png"), &whole[..whole.len() / 2]).expect("written");
    let (problems, _) = Scene::problems(&path);
    assert_eq!(problems.len(), 1, "{problems:?}");
    assert!(problems[0].to_string().contains("f1.png"));
    assert!(Scene::load(&path).is_ok_and(|scene| scene.panorama.frame_count() == 3 && scene.panorama.load(1).is_err()));
    let args = check::Args {
        scene: path.display().to_string(),
        output: None,
        json: iprt::cli::json::JsonArgs { json: None },
        strict: false,
        quiet: false,
        device: DeviceArgs { device: None, validation: false },
    };
    let error = check::run(&args).expect_err("refused");
    assert_eq!(error.exit_code(), 2);
}

#[test]
fn unreadable_scene_files() {
    let missing = Scene::load(Path::new("/no/such/scene.toml")).expect_err("refused");
    assert!(missing.to_string().contains("/no/such/scene.toml") && missing.exit_code() == 2);
    let (folder, path) = written("");
    std::fs::write(&path, [0xff, 0xfe, 0x00]).expect("written");
    assert!(Scene::load(&path).expect_err("refused").to_string().contains("not a text file"));
    assert!(Scene::load(folder.path()).expect_err("refused").to_string().contains("not a regular file"));
}

#[test]
fn objects_stand_where_they_are_told() {
    let scene = load(&format!(
        "{PANORAMA}[[object]]\nname = 'a'\nshape = 'box'\nsize = [1, 2, 3]\ntranslation = [5, 0, 0]\nrotation = [0, 90, 0]\nscale = 2\n\
         [[object]]\nshape = 'sphere'\nscale = [1, 2, 3]\n"
    ));
    let bounds = scene.object_bounds(0, 0.0);
    assert!(bounds.min.abs_diff_eq(Vec3::new(2.0, -2.0, -1.0), 1e-4), "{bounds:?}");
    assert!(bounds.max.abs_diff_eq(Vec3::new(8.0, 2.0, 1.0), 1e-4), "{bounds:?}");
    let bounds = scene.object_bounds(1, 0.0);
    assert!((bounds.max - bounds.min).abs_diff_eq(Vec3::new(1.0, 2.0, 3.0), 1e-3), "{bounds:?}");
    assert_eq!((scene.object_name(1), scene.object_name(2), scene.object_name(3)), (Some("a"), Some("sphere"), None));
}

#[test]
fn euler_angles_are_rx_ry_rz_and_quaternions_are_taken() {
    let rotation = Quat::from_euler(EulerRot::XYZ, 0.3, -0.7, 1.1);
    let [x, y, z] = [0.3_f32, -0.7, 1.1].map(f32::to_degrees);
    let [qx, qy, qz, qw] = rotation.to_array().map(|v| 2.0 * v);
    let scene = load(&format!(
        "{PANORAMA}[[object]]\nshape = 'box'\nrotation = [{x}, {y}, {z}]\n[[object]]\nshape = 'box'\nrotation = [{qx}, {qy}, {qz}, {qw}]\n"
    ));
    let instances = scene.at(0.0, 0.0).instances.instances;
    for (a, b) in instances[0].object_to_world.iter().zip(&instances[1].object_to_world) {
        assert!(a.iter().zip(b).all(|(a, b)| (a - b).abs() < 1e-5));
    }
    let column = |i: usize| Vec3::from(instances[0].object_to_world.map(|row| row[i]));
    assert!(column(0).abs_diff_eq(rotation * Vec3::X, 1e-5) && column(2).abs_diff_eq(rotation * Vec3::Z, 1e-5));
}

#[test]
fn key_frames_move_objects_and_camera() {
    let scene = load(&format!(
        "{PANORAMA}[camera]\nyaw = 5\nkey = [ {{ time = 0, yaw = 0 }}, {{ time = 4, yaw = 90, fov_y = 30 }} ]\n\
         [[object]]\nshape = 'box'\nkey = [ {{ time = 0, translation = [1, 0, 0] }}, {{ time = 2, translation = [1, 0, 1], rotation = [0, 90, 0] }} ]\n"
    ));
    let state = scene.at(1.0, 0.5);
    let instance = state.instances.instances[0];
    assert!(
        (instance.object_to_world[2][3] - 0.5).abs() < 1e-6
            && (instance.previous_object_to_world[2][3] - 0.25).abs() < 1e-6
    );
    assert_eq!(state.camera.fov_y_degrees, 30.0);
    let expected = Quat::from_rotation_y(22.5_f32.to_radians()) * Vec3::NEG_Z;
    assert!((state.camera.rotation * Vec3::NEG_Z).abs_diff_eq(expected, 1e-5));
    let still = scene.at(1.0, 1.0).instances.instances[0];
    assert_eq!(still.object_to_world, still.previous_object_to_world);
}

#[test]
fn look_at_straight_down_is_a_rotation() {
    for target in ["[0, 0, 0]", "[0, 9, 0]"] {
        let scene = load(&format!("{PANORAMA}[camera]\nlook_at = {target}\n"));
        let rotation = scene.at(0.0, 0.0).camera.rotation;
        assert!(rotation.is_normalized() && (rotation * Vec3::NEG_Z).y.abs() > 0.999_99);
    }
}

#[test]
fn material_overrides_replace() {
    let scene = load(&format!(
        "{PANORAMA}[[object]]\nname = 'glass'\nshape = 'sphere'\nmaterial = {{ base_color = [0.1, 0.2, 0.3], metallic = 1, roughness = 0.2, specular = 0, ior = 1.3, emissive = [5, 0, 0], transmission = 1 }}\n\
         [[object]]\nshape = 'sphere'\n"
    ));
    let material = scene.packed.materials[0];
    assert_eq!((material.base_color, material.metallic, material.roughness), (Vec3::new(0.1, 0.2, 0.3), 1.0, 0.2));
    assert_eq!((material.specular, material.ior, material.emissive), (0.0, 1.3, Vec3::X * 5.0));
    assert_eq!(scene.packed.materials[1].metallic, 0.0);
    assert_eq!((material.transmission, scene.packed.materials[1].transmission), (1.0, 0.0));
    assert!(scene.warnings.is_empty(), "{:?}", scene.warnings);
}

#[test]
fn render_settings_are_kept() {
    let scene = load(&format!(
        "{PANORAMA}[render]\nmethod = 'ibl'\nexposure = 2\nset = {{ bounces = 4, relighting = 'ratio' }}\n"
    ));
    assert_eq!((scene.render.method.as_str(), scene.render.exposure), ("ibl", 2.0));
    assert_eq!(scene.render.set["bounces"].as_integer(), Some(4));
    assert_eq!(scene.render.set["relighting"].as_str(), Some("ratio"));
}

#[test]
fn frames_without_a_pattern_are_warned_of() {
    let scene = load(&format!("{PANORAMA}frames = [0, 3]\n"));
    assert!(scene.panorama.frame_count() == 1 && scene.warnings[0].contains("panorama.frames"), "{:?}", scene.warnings);
}

#[test]
fn paths_come_from_the_environment_and_the_scene_files_folder() {
    // CARGO_MANIFEST_DIR is set for every test.
    let folder = tempfile::tempdir_in(env!("CARGO_TARGET_TMPDIR")).expect("a folder");
    ImageBuffer::from_pixel(2, 1, Rgb([99_u8; 3])).save(folder.path().join("c.png")).expect("saved");
    let relative = folder.path().strip_prefix(env!("CARGO_MANIFEST_DIR"));
    if let Ok(relative) = relative {
        let (_scene_folder, path) =
            written(&format!("[panorama]\ncolor = '$CARGO_MANIFEST_DIR/{}/c.png'\ndepth = 1", relative.display()));
        let scene = Scene::load(&path).expect("loads");
        assert_eq!(scene.panorama.load(0).expect("loads").color_size, [2, 1]);
    }
}
