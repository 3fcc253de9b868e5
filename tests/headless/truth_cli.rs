//! `reference --model scene` and `capture` as users run them: from a glTF room to a captured panorama, to a picture of it, to the
//! truth of that picture.

use crate::folder::Folder;
use base64::Engine as _;
use glam::{Vec3, vec3};
use iprt::{
    image_file::read::read,
    panorama::mapping::texel_direction,
    scene::{Scene, shapes::Shape},
};
use std::path::Path;

const EXTENT: Vec3 = vec3(4.0, 2.6, 3.0);
const CAPTURE: Vec3 = vec3(0.5, -0.2, 0.3);

/// A folder with a box room whose ceiling shines; a block in it moves by a metre in one second.
fn room_folder() -> Folder {
    let folder = Folder::empty();
    folder.write("my room.gltf", &room());
    folder
}

fn room() -> String {
    let mesh = Shape::Box.mesh(EXTENT);
    let (ceiling, rest): (Vec<[u32; 3]>, Vec<[u32; 3]>) =
        mesh.triangles.iter().partition(|t| t.iter().all(|v| mesh.positions[*v as usize].y > 0.0));
    let positions: Vec<u8> = mesh.positions.iter().flat_map(|p| p.to_array()).flat_map(f32::to_le_bytes).collect();
    let indices = |t: &[[u32; 3]]| t.iter().flatten().flat_map(|i| i.to_le_bytes()).collect::<Vec<u8>>();
    let keys: Vec<u8> = [0.0f32, 1.0].iter().flat_map(|t| t.to_le_bytes()).collect();
    let places = [vec3(-1.5, -1.1, -1.0), vec3(-0.5, -1.1, -1.0)];
    let places: Vec<u8> = places.iter().flat_map(|p| p.to_array()).flat_map(f32::to_le_bytes).collect();
    let chunks = [positions, indices(&rest), indices(&ceiling), keys, places];
    let mut views = Vec::new();
    let mut offset = 0;
    for chunk in &chunks {
        views.push(format!(r#"{{"buffer":0,"byteOffset":{offset},"byteLength":{}}}"#, chunk.len()));
        offset += chunk.len();
    }
    let data = base64::engine::general_purpose::STANDARD.encode(chunks.concat());
    let lambert = r#""pbrMetallicRoughness":{"baseColorFactor":[0.6,0.5,0.4,1],"metallicFactor":0},"extensions":{"KHR_materials_specular":{"specularFactor":0}}"#;
    format!(
        r#"{{"asset":{{"version":"2.0"}},"scene":0,"scenes":[{{"nodes":[0,1]}}],
"extensionsUsed":["KHR_materials_specular","KHR_materials_emissive_strength"],
"nodes":[{{"mesh":0}},{{"mesh":1,"translation":[-1.5,-1.1,-1.0],"scale":[0.1,0.1,0.1]}}],
"meshes":[{{"primitives":[{{"attributes":{{"POSITION":0}},"indices":1,"material":0}},{{"attributes":{{"POSITION":0}},"indices":2,"material":1}}]}},
{{"primitives":[{{"attributes":{{"POSITION":0}},"indices":1,"material":0}}]}}],
"materials":[{{{lambert}}},{{{lambert_lamp}}}],
"animations":[{{"channels":[{{"sampler":0,"target":{{"node":1,"path":"translation"}}}}],"samplers":[{{"input":3,"output":4}}]}}],
"accessors":[{{"bufferView":0,"componentType":5126,"count":{vertices},"type":"VEC3","min":[-2,-1.3,-1.5],"max":[2,1.3,1.5]}},
{{"bufferView":1,"componentType":5125,"count":{rest},"type":"SCALAR"}},{{"bufferView":2,"componentType":5125,"count":{ceiling},"type":"SCALAR"}},
{{"bufferView":3,"componentType":5126,"count":2,"type":"SCALAR","min":[0],"max":[1]}},{{"bufferView":4,"componentType":5126,"count":2,"type":"VEC3"}}],
"bufferViews":[{views}],"buffers":[{{"byteLength":{offset},"uri":"data:application/octet-stream;base64,{data}"}}]}}"#,
        lambert_lamp = r#""pbrMetallicRoughness":{"baseColorFactor":[0,0,0,1],"metallicFactor":0},"emissiveFactor":[1,1,1],"extensions":{"KHR_materials_specular":{"specularFactor":0},"KHR_materials_emissive_strength":{"emissiveStrength":3}}"#,
        vertices = mesh.positions.len(),
        rest = 3 * rest.len(),
        ceiling = 3 * ceiling.len(),
        views = views.join(","),
    )
}

fn color(path: &Path) -> Vec<[f32; 4]> {
    read(path).expect("an image").into_color("test").expect("RGB").texels
}

#[test]
fn from_a_room_to_its_panorama_to_a_picture_to_its_truth() {
    let folder = room_folder();
    let at = format!("{},{},{}", CAPTURE.x, CAPTURE.y, CAPTURE.z);
    let arguments = ["capture", "my room.gltf", "-o", "cap", "--size", "128x64", "--spp", "64", "--position", &at];
    assert_eq!(folder.succeeds_with(&arguments).trim(), Path::new("cap").join("scene.toml").display().to_string());
    let scene = Scene::load(&folder.path("cap/scene.toml")).expect("render takes it as it is");
    assert_eq!((scene.panorama.position, scene.panorama.frame_count()), (CAPTURE, 1));
    let frame = scene.panorama.load(0).expect("reads");
    assert_eq!((frame.color_size, frame.depth_size), ([128, 64], [128, 64]));
    let mut walls = 0;
    for (i, depth) in frame.depth.iter().enumerate() {
        let d = texel_direction(i as u32 % 128, i as u32 / 128, [128, 64]).as_vec3();
        let to_wall = ((0.5 * EXTENT - CAPTURE * d.signum()) / d.abs()).min_element();
        walls += usize::from((depth / to_wall - 1.0).abs() < 1e-4);
        assert!(*depth < to_wall * 1.0001, "texel {i}: {depth} behind the wall");
    }
    assert!(walls > 7900, "all but the block is wall: {walls} of 8192");
    assert!((frame.radiance.at(64)[1] - 3.0).abs() < 1e-4, "the lamp is seen as it is");

    // the same view by the renderer, from the panorama, and by the path tracer, from the room
    let same = ["--projection", "equirect", "--size", "128x64", "-q"];
    folder.succeeds_with(&[&["render", "cap/scene.toml", "-o", "view.exr", "--warmup", "0"][..], &same].concat());
    let truth = ["reference", "cap/scene.toml", "-o", "truth.exr", "--model", "scene", "--spp", "64", "--seed", "9"];
    folder.succeeds_with(&[&truth[..], &same].concat());
    let (view, truth) = (color(&folder.path("view.exr")), color(&folder.path("truth.exr")));
    let mean = |image: &[[f32; 4]], rows: std::ops::Range<usize>| {
        image[rows.start * 128..rows.end * 128].iter().map(|c| f64::from(c[0])).sum::<f64>() / (128 * rows.len()) as f64
    };
    for rows in [0..16, 24..40, 48..64] {
        let ratio = mean(&view, rows.clone()) / mean(&truth, rows.clone());
        // the noise of both
        assert!((ratio - 1.0).abs() < 0.01, "rows {rows:?}: {ratio}");
    }
    let mut left: Vec<_> = (folder.root().read_dir().expect("readable"))
        .map(|f| f.expect("readable").file_name().to_string_lossy().into_owned())
        .collect();
    left.sort();
    assert_eq!(left, ["cap", "my room.gltf", "truth.exr", "view.exr"], "no state and no temporary file is left");

    // an animated room is a video
    let arguments = ["capture", "my room.gltf", "-o", "video", "--size", "96x48", "--spp", "1", "--position", &at];
    folder.succeeds_with(&[&arguments[..], &["--frames", "0..2", "--fps", "4", "-q"]].concat());
    let scene = Scene::load(&folder.path("video/scene.toml")).expect("render takes it as it is");
    assert_eq!((scene.panorama.frame_count(), scene.panorama.fps), (3, 4.0));
    let depth = |index: usize| scene.panorama.load(index).expect("reads").depth.clone();
    assert!(depth(0) != depth(1) && depth(1) != depth(2), "the block moves");
}

#[test]
fn resumed_by_the_command_line_the_bits_are_the_same() {
    let folder = room_folder();
    std::fs::write(folder.path("scene.toml"), SCENE).expect("writes");
    let run = |output: &str, more: &str| {
        let arguments = format!("reference scene.toml --model scene --size 24x16 -o {output} {more}");
        folder.succeeds_with(&arguments.split_whitespace().collect::<Vec<_>>())
    };
    assert!(run("whole.exr", "--spp 40").contains("40 samples"));
    run("parts.exr", "--spp 3 --resume");
    assert!(folder.path("parts.exr.state").exists());
    run("parts.exr", "--spp 40 --resume -q");
    assert_eq!(color(&folder.path("whole.exr")), color(&folder.path("parts.exr")));
    assert!(!folder.path("whole.exr.state").exists());
    let common = "reference scene.toml --model scene --size 24x16 -o parts.exr";
    folder.fails(common, &["parts.exr.state", "--resume", "delete"]);
    folder.fails(&format!("{common} --resume --seed 3"), &["parts.exr.state", "other settings"]);
    std::fs::write(folder.path("parts.exr.state"), "x").expect("writes");
    folder.fails(&format!("{common} --resume"), &["parts.exr.state", "damaged"]);
}

const SCENE: &str = "[panorama]\ncolor = \"not_yet.exr\"\ndepth = 2\n[room]\ngltf = \"my room.gltf\"\n
[[object]]\nshape = \"sphere\"\nsize = [0.5, 0.5, 0.5]\ntranslation = [0, 0, -1]\nmaterial = { metallic = 1, roughness = 0.3 }\n";

#[test]
fn what_the_user_got_wrong_is_told_in_one_line() {
    let folder = room_folder();
    std::fs::write(folder.path("scene.toml"), SCENE).expect("writes");
    std::fs::write(folder.path("roomless.toml"), "[panorama]\ncolor = \"a.png\"\ndepth = 2\n").expect("writes");
    std::fs::write(folder.path("lost.toml"), SCENE.replace("my room", "lost")).expect("writes");
    std::fs::write(folder.path("bad.glb"), "glTF").expect("writes");
    for (arguments, words) in [
        ("reference roomless.toml --model scene -o a.exr", &["roomless.toml: room.gltf", "missing", "[room]"][..]),
        ("reference lost.toml --model scene -o a.exr", &["lost.toml: room.gltf", "lost.gltf"]),
        ("reference scene.toml --model magic -o a.exr", &["--model", "magic", "panorama or scene"]),
        ("reference scene.toml --model scene -o a.jpg", &["a.jpg", ".exr"]),
        ("reference scene.toml --model scene -o no/a.exr", &["no/a.exr", "folder"]),
        ("reference scene.toml --model scene -o a.exr --until-noise 2", &["--until-noise", "0.01"]),
        ("reference scene.toml --model scene -o a.exr --size 0x4", &["size", "0"]),
        ("reference scene.toml --model scene -o a.exr --set bounces=3", &["--set", "--model scene"]),
        ("reference scene.toml --model scene -o a.exr --aov all", &["--aov", "--model scene"]),
        ("reference scene.toml --model scene -o a.exr --projection fisheye", &["--projection", "fisheye"]),
        ("reference scene.toml -o a.exr --resume", &["--resume", "--model scene"]),
        ("capture nowhere.glb -o cap", &["nowhere.glb", "no such file"]),
        ("capture bad.glb -o cap", &["bad.glb"]),
        ("capture apartment -o cap --size 100x100", &["--size", "100x100", "twice"]),
        ("capture apartment -o cap --position 1,2", &["--position", "1,2"]),
        ("capture apartment -o cap --frames 3..9", &["--frames", "0"]),
        ("capture apartment -o scene.toml/cap", &["scene.toml/cap", "folder"]),
    ] {
        folder.fails(arguments, words);
    }
    assert!(!folder.path("cap").exists() && !folder.path("a.exr").exists());
}

/// Its room is written beside its panorama, so that the scene file knows the truth.
#[test]
fn a_built_in_room_is_captured_with_its_truth() {
    let folder = Folder::empty();
    folder.succeeds("capture bedroom -o bedroom --size 32x16 --spp 32 -q");
    assert!(folder.path("bedroom/room.glb").is_file());
    folder.succeeds("check bedroom/scene.toml");
    // its truth from the capture point is what was captured
    let truth = "reference bedroom/scene.toml --model scene --without-objects --projection equirect --size 32x16";
    folder.succeeds(&format!("{truth} --spp 32 -o truth.exr -q"));
    let scene = std::fs::read_to_string(folder.path("bedroom/scene.toml")).expect("readable");
    let color = scene.lines().find_map(|line| line.strip_prefix("color = \"")).expect("a panorama");
    let files = [folder.path("truth.exr"), folder.path("bedroom").join(color.trim_end_matches('"'))];
    // of the few samples the bright ones tell little
    let [truth, captured] = files.map(|file| {
        let texels = read(&file).and_then(|image| image.into_color("test")).expect("a picture").texels;
        let mut green: Vec<f32> = texels.iter().map(|texel| texel[1]).collect();
        green.sort_by(f32::total_cmp);
        green[green.len() / 2]
    });
    assert!((truth / captured - 1.0).abs() < 0.25, "{truth} {captured}");
}
