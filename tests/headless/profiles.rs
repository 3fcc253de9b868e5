//! Devices with less than the one at hand, as a layer tells of them: the pictures are the same, or one line says what is
//! missing. Validation stands above the layer, so it holds the program to what the layer tells.

use crate::{folder::Folder, layers, view::Display, vulkan_faults};
use std::{fs, process::Output};

type Profile<'a> = &'a [(&'a str, &'a str)];

fn run(folder: &Folder, profile: Profile, arguments: &str) -> Output {
    let mut command = folder.command();
    layers::put(&mut command, "VK_LAYER_KHRONOS_validation:VK_LAYER_IPRT_profile");
    command.args(arguments.split_whitespace()).envs(profile.iter().copied()).output().expect("runs")
}

fn succeeds(folder: &Folder, profile: Profile, arguments: &str) {
    let output = run(folder, profile, &format!("{arguments} --validation -q"));
    let stderr = String::from_utf8_lossy(&output.stderr);
    assert!(output.status.success() && stderr.is_empty(), "{profile:?}: {:?} {stderr}", output.status);
}

fn same_pictures(profile: Profile) {
    let folder = vulkan_faults::folder();
    let render = "render scene.toml --frames 0..1 --warmup 1 -o";
    folder.succeeds(&format!("{render} plain_%d.exr -q"));
    succeeds(&folder, profile, &format!("{render} told_%d.exr"));
    for frame in 0..2 {
        let [plain, told] = ["plain", "told"].map(|name| fs::read(folder.path(&format!("{name}_{frame}.exr"))));
        assert!(plain.expect("written") == told.expect("written"), "{profile:?}: frame {frame} differs");
    }
}

/// What is said in one line by a command that ends with this status.
fn refused(profile: Profile, arguments: &str, status: i32) -> String {
    let output = run(&vulkan_faults::folder(), profile, arguments);
    let stderr = String::from_utf8_lossy(&output.stderr).into_owned();
    assert!(output.status.code() == Some(status) && stderr.trim_end().lines().count() == 1, "{profile:?}: {stderr}");
    stderr
}

#[test]
fn push_constants_of_128_bytes() {
    same_pictures(&[("PROFILE_PUSH", "128")]);
}

/// Shaders count by ballots, and never ask how large a subgroup is.
#[test]
fn subgroups_of_4_and_of_64() {
    same_pictures(&[("PROFILE_SUBGROUP", "64")]);
    // Here lavapipe's are so for real.
    same_pictures(&[("PROFILE_SUBGROUP", "4"), ("LP_NATIVE_VECTOR_WIDTH", "128")]);
}

#[test]
fn no_optional_feature() {
    same_pictures(&[("PROFILE_FEATURES", "needed")]);
    let none = [("PROFILE_FEATURES", "none")];
    let said = refused(&none, "render scene.toml -o a.png -q", 3);
    assert!(said.contains("shaderStorageImageExtendedFormats") && said.contains("scalarBlockLayout"), "{said}");
    assert_eq!(refused(&none, "devices", 3), said);
}

#[test]
fn heaps_of_4_gib_and_of_24_mib() {
    same_pictures(&[("PROFILE_HEAP", "4294967296")]);
    let said = refused(&[("PROFILE_HEAP", "25165824")], "render scene.toml --size 800x600 -o a.png -q", 2);
    assert!(said.contains("device memory: ") && said.contains("use smaller images"), "{said}");
}

/// The window, too, maps coherent memory alone.
#[test]
fn several_types_of_memory() {
    let split = [("PROFILE_MEMORY", "split")];
    same_pictures(&split);
    let (folder, display) = (vulkan_faults::folder(), Display::start());
    folder.write("play", "settle 2\nsize 300x200\nwait 3\nsettle 2\n");
    let shown = [split[0], ("DISPLAY", &display.name), ("WAYLAND_DISPLAY", "")];
    succeeds(&folder, &shown, "view scene.toml --size 160x120 --script play --report report.json");
}
