//! glTF loading: real models, and 263 broken ones.

use crate::folder::Folder;
use glam::{Vec2, Vec3};
use iprt::{
    panorama::{depth::Quantisation, source::PanoramaFrame, source::PanoramaSource},
    scene::{
        Object, Scene,
        animation::{Placement, Transform},
        bvh,
        camera::CameraTrack,
        clip::Property,
        file::RenderSettings,
        gltf,
        material::{Alpha, Slot, TextureUse},
        model::{Mesh, Model},
    },
};
use std::{
    panic::{AssertUnwindSafe, catch_unwind},
    path::{Path, PathBuf},
    sync::Arc,
};

/// The folder of real data; a missing one fails the test.
fn data(below: &str) -> PathBuf {
    let root = std::env::var_os("IPRT_DATA")
        .map_or_else(|| Path::new(env!("CARGO_MANIFEST_DIR")).join("../shared/data"), PathBuf::from);
    let path = root.join(below);
    assert!(path.exists(), "{} is missing; set IPRT_DATA", path.display());
    path
}

fn files(folder: &Path, found: &mut Vec<PathBuf>) {
    for entry in std::fs::read_dir(folder).expect("a readable folder") {
        let path = entry.expect("an entry").path();
        if path.is_dir() {
            files(&path, found);
        } else if path.extension().is_some_and(|extension| extension == "gltf" || extension == "glb") {
            found.push(path);
        }
    }
}

/// The model in a scene of its own, which checks both BVH levels.
fn scene_of(model: Model) -> Scene {
    let frame = PanoramaFrame {
        color_size: [2, 1],
        radiance: vec![[1.0; 4]; 2].into(),
        depth_size: [2, 1],
        depth: vec![1.0; 2],
        quantisation: Quantisation::None,
        warnings: vec![],
        white: None,
        taken: Default::default(),
    };
    let panorama = PanoramaSource::from_frames(vec![frame], 30.0, Vec3::ZERO, 0.0).expect("a panorama");
    let clip = (!model.rig.clips.is_empty()).then_some(0);
    let placement = Placement::fixed(Transform::IDENTITY);
    let object = Object { name: "m".into(), model: Arc::new(model), placement, clip, speed: 1.0 };
    let camera = CameraTrack::at_point(Vec3::ZERO);
    let scene = Scene::assemble("test", panorama, camera, vec![object], RenderSettings::default()).expect("packs");
    for time in [0.0, 0.7] {
        let state = scene.at(time, 0.0);
        bvh::check_top(&scene.packed, &state.instances).expect("a valid top level");
    }
    scene
}

fn load(below: &str) -> (Model, Vec<String>) {
    gltf::load(&data("gltf").join(below)).unwrap_or_else(|error| panic!("{below}: {error}"))
}

#[test]
fn every_broken_file_loads_or_gives_one_line() {
    let mut found = Vec::new();
    files(&data("gltf_malformed"), &mut found);
    assert_eq!(found.len(), 263);
    let mut refused = 0;
    for path in &found {
        let outcome = catch_unwind(AssertUnwindSafe(|| match gltf::load(path) {
            Ok((model, warnings)) => {
                assert!(warnings.iter().all(|warning| !warning.contains('\n')));
                scene_of(model);
                false
            }
            Err(error) => {
                let line = error.to_string();
                assert!(!line.contains('\n') && line.len() < 600, "{line}");
                assert!(line.starts_with(&path.display().to_string()), "{line}");
                assert_eq!(error.exit_code(), 2);
                true
            }
        }));
        refused += usize::from(outcome.unwrap_or_else(|_| panic!("{} panicked", path.display())));
    }
    // Most are borderline: what is broken is not drawn, or has a meaning all the same. Shapes that cannot be known
    // are refused.
    println!("{refused} of {} refused", found.len());
    assert!((15..60).contains(&refused), "{refused} were refused");
}

#[test]
fn every_real_model_loads() {
    let mut found = Vec::new();
    files(&data("gltf"), &mut found);
    assert!(found.len() >= 16);
    for path in found {
        let (model, warnings) = gltf::load(&path).unwrap_or_else(|error| panic!("{error}"));
        let scene = scene_of(model);
        assert!(!scene.packed.triangles.is_empty(), "{}", path.display());
        println!("{}: {} triangles, {warnings:?}", path.display(), scene.packed.triangles.len());
    }
}

#[test]
fn the_water_bottle_has_all_its_textures() {
    let (model, warnings) = load("WaterBottle/WaterBottle.gltf");
    assert!(warnings.is_empty(), "{warnings:?}");
    let material = &model.materials[0];
    for slot in [Slot::BaseColor, Slot::MetallicRoughness, Slot::Normal, Slot::Emissive] {
        assert!(material.texture(slot).is_some(), "{slot:?}");
    }
    let height = scene_of(model).object_bounds(0, 0.0);
    assert!(((height.max - height.min).y - 0.26).abs() < 0.02);
}

/// Sides are read. Without a word the front alone is seen, also without a material.
#[test]
fn materials_have_one_side_unless_a_file_says_two() {
    let sides = |below: &str| load(below).0.materials.iter().map(|m| m.one_sided).collect::<Vec<_>>();
    assert_eq!(sides("TwoSidedPlane/TwoSidedPlane.gltf"), [false]);
    assert_eq!(sides("TriangleWithoutIndices/TriangleWithoutIndices.gltf"), [true]);
    assert_eq!(sides("WaterBottle/WaterBottle.gltf"), [true]);
    let (model, _) = load("TextureSettingsTest/TextureSettingsTest.glb");
    for material in &model.materials {
        assert_eq!(material.one_sided, material.name != "DoubleSidedMaterial", "{}", material.name);
    }
}

/// Skins and morph targets move with their clips, and stand where the specification puts them.
#[test]
fn skins_and_morph_targets_deform() {
    for (file, clip, time) in [
        ("Fox/Fox.glb", Some("Run"), 0.3),
        ("RiggedFigure/RiggedFigure.glb", None, 0.6),
        ("AnimatedMorphCube/AnimatedMorphCube.glb", None, 1.0),
        ("SimpleMorph/SimpleMorph.gltf", None, 1.0),
    ] {
        let (mut model, warnings) = load(file);
        assert!(warnings.is_empty(), "{file}: {warnings:?}");
        if let Some(name) = clip {
            let at = model.rig.clips.iter().position(|clip| clip.name == name).expect("its clip");
            model.rig.clips.swap(0, at);
        }
        let rest = model.meshes.iter().map(|mesh| mesh.positions.len()).sum::<usize>();
        let scene = scene_of(model);
        let (start, later) = (scene.at(0.0, 0.0).instances, scene.at(time, time - 0.05).instances);
        assert!(!later.poses.is_empty() && rest > 0, "{file}");
        // The shape before is that of the time before.
        let earlier = scene.at(time - 0.05, time - 0.05).instances;
        for ((start, pose), earlier) in start.poses.iter().zip(&later.poses).zip(&earlier.poses) {
            let [at_first, before, now] = [start, earlier, pose].map(|pose| pose.patch());
            assert!(at_first.triangles != now.triangles && start.step == 0.0, "{file} does not move");
            assert!(pose.step > 0.0 && now.triangles != before.triangles, "{file} has no motion");
            assert_eq!(pose.before, earlier.now, "{file}");
            assert!(now.vertices.iter().all(|vertex| (vertex.normal.length() - 1.0).abs() < 1e-3), "{file}");
        }
        bvh::check(&iprt::scene::deform::patched(&scene.packed, &later.poses)).expect("a valid bottom level");
        bvh::check_top(&scene.packed, &later).expect("a valid top level");
        // What is at rest stands where it did when it was loaded.
        let mut still = scene.objects().next().expect("one").clone();
        still.clip = None;
        let still = scene.with_objects(&[still]).expect("packs");
        assert!(still.at(1.0, 0.5).instances.poses.is_empty() && !still.packed.triangles.is_empty());
    }
}

/// A vertex with more than eight influences, and one whose weights do not sum to 1.
#[test]
fn skins_have_any_number_of_influences() {
    let joints: Vec<String> = (0..12).map(|i| format!(r#"{{"translation":[{i},0,0]}}"#)).collect();
    let mut bytes: Vec<u8> = [0.0f32; 9].iter().flat_map(|v| v.to_le_bytes()).collect();
    bytes[12..16].copy_from_slice(&1.0f32.to_le_bytes());
    bytes[28..32].copy_from_slice(&1.0f32.to_le_bytes());
    for set in 0..3u8 {
        bytes.extend((0..3).flat_map(|_| (0..4).map(move |i| 4 * set + i)));
    }
    bytes.extend((0..12).flat_map(|_| 0.25f32.to_le_bytes()));
    let text: String = bytes.iter().map(|byte| format!("%{byte:02x}")).collect();
    let numbers = (0..12).map(|i| (i + 1).to_string()).collect::<Vec<_>>().join(",");
    let (model, warnings) = inline(&format!(
        r#""scenes":[{{"nodes":[0,{numbers}]}}],"nodes":[{{"mesh":0,"skin":0,"translation":[0,7,0]}},{}],"skins":[{{"joints":[{numbers}]}}],
        "meshes":[{{"primitives":[{{"attributes":{{"POSITION":0,"JOINTS_0":1,"JOINTS_1":2,"JOINTS_2":3,"WEIGHTS_0":4,"WEIGHTS_1":4,"WEIGHTS_2":4}}}}]}}],
        "buffers":[{{"byteLength":120,"uri":"data:application/octet-stream,{text}"}}],
        "bufferViews":[{{"buffer":0,"byteLength":36}},{{"buffer":0,"byteOffset":36,"byteLength":36}},{{"buffer":0,"byteOffset":72,"byteLength":48}}],
        "accessors":[{{"bufferView":0,"componentType":5126,"type":"VEC3","count":3}},
            {{"bufferView":1,"componentType":5121,"type":"VEC4","count":3}},
            {{"bufferView":1,"byteOffset":12,"componentType":5121,"type":"VEC4","count":3}},
            {{"bufferView":1,"byteOffset":24,"componentType":5121,"type":"VEC4","count":3}},
            {{"bufferView":2,"componentType":5126,"type":"VEC4","count":3}}]"#,
        joints.join(",")
    ))
    .expect("loads");
    assert!(warnings.is_empty(), "{warnings:?}");
    // Twelve joints of equal weight stand at 0 to 11, so that the mean moves by 5.5. The node's own place counts for nothing.
    assert!(
        model.meshes[0].positions[0].abs_diff_eq(Vec3::new(5.5, 0.0, 0.0), 1e-5),
        "{:?}",
        model.meshes[0].positions
    );
    assert_eq!(model.meshes[0].deform.as_ref().expect("a skin").influences[0].len(), 12);
}

#[test]
fn missing_normals_are_flat_and_missing_tangents_are_made() {
    let (model, _) = load("TriangleWithoutIndices/TriangleWithoutIndices.gltf");
    assert_eq!(model.meshes[0].normals, [Vec3::Z; 3]);
    let (model, _) = load("NormalTangentTest/NormalTangentTest.glb");
    for (mesh, normal_mapped) in
        model.meshes.iter().map(|m| (m, model.materials[m.materials[0] as usize].texture(Slot::Normal)))
    {
        for (tangent, normal) in mesh.tangents.iter().zip(&mesh.normals) {
            let [x, y, z, sign] = *tangent;
            let along = Vec3::new(x, y, z);
            if normal_mapped.is_some() && along != Vec3::ZERO {
                assert!((along.length() - 1.0).abs() < 1e-3 && along.dot(*normal).abs() < 0.05 && sign.abs() == 1.0);
            }
        }
        assert!(normal_mapped.is_none() || mesh.tangents.iter().any(|tangent| tangent[3] != 0.0));
    }
}

#[test]
fn tangents_that_are_made_are_those_that_a_file_brings() {
    // The same bottle without its tangents.
    let given = data("gltf/WaterBottle/WaterBottle.gltf");
    let folder = Folder::empty();
    for entry in std::fs::read_dir(given.parent().expect("a folder")).expect("readable") {
        let path = entry.expect("an entry").path();
        std::fs::copy(&path, folder.path(&path.file_name().expect("a name").to_string_lossy())).expect("copies");
    }
    let text = std::fs::read_to_string(&given).expect("text").replace("\"TANGENT\"", "\"_UNUSED\"");
    std::fs::write(folder.path("WaterBottle.gltf"), text).expect("writes");
    let corners = |path: &Path| -> Vec<[f32; 4]> {
        let (model, _) = gltf::load(path).expect("loads");
        let of =
            |mesh: &Arc<Mesh>| mesh.triangles.iter().flatten().map(|i| mesh.tangents[*i as usize]).collect::<Vec<_>>();
        model.meshes.iter().flat_map(of).collect()
    };
    let (given, made) = (corners(&given), corners(&folder.path("WaterBottle.gltf")));
    assert!(given.len() == made.len() && given.len() > 10_000);
    let alike = |(a, b): &(&[f32; 4], &[f32; 4])| (0..3).map(|i| a[i] * b[i]).sum::<f32>() > 0.95 && a[3] == b[3];
    let share = given.iter().zip(&made).filter(alike).count() as f32 / given.len() as f32;
    assert!(share > 0.98, "{share} of the corners agree");
}

#[test]
fn sparse_accessors_replace_positions() {
    let (model, _) = load("SimpleSparseAccessor/SimpleSparseAccessor.gltf");
    let positions = &model.meshes[0].positions;
    assert!(positions.iter().any(|p| p.abs_diff_eq(Vec3::new(1.0, 2.0, 0.0), 1e-6)), "{positions:?}");
}

#[test]
fn texture_transforms_are_kept_for_each_texture() {
    let (model, _) = load("TextureTransformTest/TextureTransformTest.gltf");
    let placed = |name: &str, uv: Vec2| {
        let node = model.rig.nodes.iter().find(|node| node.name == name).unwrap_or_else(|| panic!("no node {name}"));
        let mesh = &model.meshes[node.mesh.expect("a mesh")];
        let texture = model.materials[mesh.materials[0] as usize].texture(Slot::BaseColor).expect("a texture");
        assert_eq!(texture.set, 0);
        texture.transform.transform_point2(uv)
    };
    assert!(placed("Offset U", Vec2::ZERO).abs_diff_eq(Vec2::new(0.5, 0.0), 1e-4));
    // 0.39 rad about the upper left corner, counter-clockwise with v down
    let rotated = placed("Rotation", Vec2::X);
    assert!(rotated.x > 0.0 && rotated.y < -0.1, "{rotated}");
}

/// Two textures of one material by different sets, and colours of vertices in each of their types.
#[test]
fn a_texture_has_its_own_coordinates_and_colours_have_alpha() {
    let bytes: Vec<u8> = [[0.0f32, 0.0, 0.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]]
        .as_flattened()
        .iter()
        .chain(&[0.1, 0.2, 0.3, 0.4, 0.5, 0.6])
        .flat_map(|v| v.to_le_bytes())
        .chain([255, 0, 0, 128, 0, 255, 0, 255, 0, 0, 255, 0])
        .chain([1u16 << 15, 0, 0, u16::MAX, 0, 0, 0, 0, 0, 0, 0, 0].into_iter().flat_map(u16::to_le_bytes))
        .collect();
    let text: String = bytes.iter().map(|byte| format!("%{byte:02x}")).collect();
    let pixel = "data:image/png;base64,iVBORw0KGgoAAAANSUhEUgAAAAEAAAABCAYAAAAfFcSJAAAADUlEQVR42mNk+M9QDwADhgGAWjR9awAAAABJRU5ErkJggg==";
    for (color, kind, first) in [(2, 5121, [1.0, 0.0, 0.0, 0.5]), (3, 5123, [0.5, 0.0, 0.0, 1.0])] {
        let (model, warnings) = inline(&format!(
            r#""scenes":[{{"nodes":[0]}}],"nodes":[{{"mesh":0}}],
            "meshes":[{{"primitives":[{{"attributes":{{"POSITION":0,"TEXCOORD_0":1,"TEXCOORD_3":1,"COLOR_0":2}},"material":0}}]}}],
            "buffers":[{{"byteLength":96,"uri":"data:application/octet-stream,{text}"}}],
            "bufferViews":[{{"buffer":0,"byteLength":36}},{{"buffer":0,"byteOffset":36,"byteLength":24}},
                {{"buffer":0,"byteOffset":60,"byteLength":12}},{{"buffer":0,"byteOffset":72,"byteLength":24}}],
            "accessors":[{{"bufferView":0,"componentType":5126,"type":"VEC3","count":3}},
                {{"bufferView":1,"componentType":5126,"type":"VEC2","count":3}},
                {{"bufferView":{color},"componentType":{kind},"normalized":true,"type":"VEC4","count":3}}],
            "images":[{{"uri":"{pixel}"}}],"textures":[{{"source":0}}],
            "materials":[{{"alphaMode":"MASK","pbrMetallicRoughness":{{"baseColorTexture":{{"index":0,"texCoord":3}},
                "metallicRoughnessTexture":{{"index":0,"extensions":{{"KHR_texture_transform":{{"scale":[2,3]}}}}}}}}}}]"#
        ))
        .expect("loads");
        assert!(warnings.is_empty(), "{warnings:?}");
        let (mesh, material) = (&model.meshes[0], &model.materials[0]);
        assert_eq!((&mesh.uvs, material.alpha_mode), (&mesh.uvs2, Alpha::Mask(0.5)));
        let [base, rough] = [Slot::BaseColor, Slot::MetallicRoughness].map(|slot| material.texture(slot).expect("one"));
        assert_eq!((base.set, rough.set), (0, 1), "sets 3 and 0 of the file");
        assert_eq!(base, TextureUse::plain(base.texture));
        assert_eq!(rough.transform.transform_point2(Vec2::ONE), Vec2::new(2.0, 3.0));
        assert!(mesh.colors[0].abs_diff_eq(first.into(), 0.01), "{:?}", mesh.colors);
        let scene = scene_of(model);
        let [a, b] = [base, rough].map(|texture| texture.set);
        assert_eq!(scene.packed.textures.iter().map(|t| t.set as usize).collect::<Vec<_>>(), [a, b]);
    }
}

#[test]
fn animated_nodes_move() {
    let (model, _) = load("BoxAnimated/BoxAnimated.gltf");
    assert!(model.rig.clips[0].channels.iter().any(|channel| channel.property == Property::Rotation));
    let scene = scene_of(model);
    let (start, later) = (scene.at(0.0, 0.0), scene.at(2.0, 1.9));
    let moved = start.instances.instances.iter().zip(&later.instances.instances);
    assert!(moved.clone().any(|(a, b)| a.object_to_world != b.object_to_world));
    assert!(moved.clone().all(|(a, b)| a.id == b.id));
    assert!(later.instances.instances.iter().any(|i| i.object_to_world != i.previous_object_to_world));
}

/// A glTF file with these top-level members beside `asset`.
pub(crate) fn inline(members: &str) -> Result<(Model, Vec<String>), String> {
    let folder = tempfile::tempdir().expect("a folder");
    let path = folder.path().join("inline.gltf");
    std::fs::write(&path, format!(r#"{{"asset":{{"version":"2.0"}},{members}}}"#)).expect("written");
    gltf::load(&path).map_err(|error| error.to_string())
}

/// A triangle, with room for changes.
pub(crate) fn triangle(buffer: &str, accessor: &str, material: &str) -> String {
    format!(
        r#""scenes":[{{"nodes":[0]}}],"nodes":[{{"mesh":0}}],
        "meshes":[{{"primitives":[{{"attributes":{{"POSITION":0}}{material}}}]}}],
        "buffers":[{{"byteLength":36,"uri":"{buffer}"}}],"bufferViews":[{{"buffer":0,"byteLength":36}}],
        "accessors":[{{"bufferView":0,"componentType":5126,"type":"VEC3","min":[0,0,0],"max":[1,1,0],{accessor}}}]"#
    )
}

pub(crate) const TRIANGLE: &str =
    "data:application/octet-stream;base64,AAAAAAAAAAAAAAAAAACAPwAAAAAAAAAAAAAAAAAAgD8AAAAA";

#[test]
fn hostile_files_are_refused() {
    let (model, _) = inline(&triangle(TRIANGLE, r#""count":3"#, "")).expect("a good file");
    assert_eq!(model.meshes[0].positions, [Vec3::ZERO, Vec3::X, Vec3::Y]);
    for (members, words) in [
        (triangle("http://example.com/a.bin", r#""count":3"#, ""), "not a file beside"),
        (triangle("file:///etc/passwd", r#""count":3"#, ""), "not a file beside"),
        (triangle("/dev/zero", r#""count":3"#, ""), "no relative path"),
        (triangle("absent%20name.bin", r#""count":3"#, ""), "absent name.bin"),
        (triangle("data:application/octet-stream;base64,A*A", r#""count":3"#, ""), "buffer 0"),
        (triangle("data:text/plain,hello", r#""count":3"#, ""), "beyond its buffer view"),
        (triangle("data:application/octet-stream;base64,AAAA", r#""count":3"#, ""), "beyond its buffer view"),
        (triangle(TRIANGLE, r#""count":4"#, ""), "beyond its buffer view"),
        (triangle(TRIANGLE, r#""count":18446744073709551615"#, ""), "would take"),
        (triangle(TRIANGLE, r#""count":3,"byteOffset":18446744073709551615"#, ""), "beyond its buffer view"),
        (triangle(TRIANGLE, r#""count":3"#, r#","indices":0"#), "whole numbers"),
        (
            r#""accessors":[{"componentType":5126,"type":"VEC3","count":4000000000}],"meshes":[{"primitives":[{"attributes":{"POSITION":0}}]}],"nodes":[{"mesh":0}],"scenes":[{"nodes":[0]}]"#.into(),
            "accessor 0: ", // no data, and more of it than memory
        ),
        (
            triangle(TRIANGLE, r#""count":3"#, r#","extensions":{"KHR_draco_mesh_compression":{}}"#)
                .replace(r#""bufferView":0,"componentType""#, r#""componentType""#),
            "KHR_draco_mesh_compression, which is not read; write it without, as by: gltf-transform copy",
        ),
        (
            triangle(TRIANGLE, r#""count":3"#, "")
                .replace(r#""bufferViews":[{"buffer":0,"#, r#""bufferViews":[{"buffer":7,"extensions":{"EXT_meshopt_compression":{"buffer":0,"byteLength":36,"mode":"TRIANGLES","count":4,"byteStride":12}},"#),
            "buffer view 0: its meshopt mode, filter, count and stride do not fit each other",
        ),
        (
            triangle(TRIANGLE, r#""count":3"#, "")
                .replace(r#""bufferViews":[{"buffer":0,"#, r#""bufferViews":[{"buffer":7,"extensions":{"KHR_meshopt_compression":{"buffer":0,"byteLength":36,"mode":"ATTRIBUTES","count":3,"byteStride":12}},"#),
            "buffer view 0: its meshopt data is damaged",
        ),
    ] {
        let line = inline(&members).expect_err(words);
        assert!(line.contains(words) && !line.contains('\n'), "{words}: {line}");
    }
}

#[test]
fn what_is_odd_or_unused_never_refuses_a_file() {
    let plain = triangle(TRIANGLE, r#""count":3"#, "");
    let lines = TRIANGLE.replace("AACAPwAA", "AACA\\nPwAA\\r\\n").trim_end_matches('=').to_owned();
    for (members, words) in [
        (triangle(&lines, r#""count":3"#, ""), None),
        (triangle(TRIANGLE, r#""count":3"#, r#","material":7"#), Some("default material")),
        (format!(r#"{plain},"extensionsUsed":["EXT_nonsense"]"#), Some("EXT_nonsense")),
        (format!(r#"{plain},"extensionsRequired":["KHR_materials_specular"]"#), None),
        (format!(r#"{plain},"images":[{{"uri":"absent.png"}}],"cameras":[{{"type":"fisheye"}}],"skins":[{{}}]"#), None),
        (
            format!(
                r#"{plain},"animations":[{{"channels":[{{"sampler":0,"target":{{"path":"pointer"}}}}],"samplers":[]}}]"#
            ),
            None,
        ),
        (
            format!(r#"{plain},"animations":[{{"channels":[{{"sampler":3,"target":{{"node":0,"path":"scale"}}}}]}}]"#),
            Some("animation 0, channel 0"),
        ),
        (plain.replace(r#""scenes":[{"nodes":[0]}]"#, r#""scenes":[{"nodes":[0]},{}]"#), None),
        (plain.replace(r#""scenes":[{"nodes":[0]}]"#, r#""scene":9,"scenes":[{"nodes":[0]}]"#), Some("scene 9")),
        (plain.replace(r#""scenes":[{"nodes":[0]}]"#, r#""scenes":[{"nodes":[0,5]}]"#), Some("node 5")),
        (plain.replace(r#"{"mesh":0}"#, r#"{"mesh":0,"children":[0]}"#), Some("own ancestor")),
        (plain.replace(r#"{"mesh":0}"#, r#"{"mesh":0,"rotation":[0,0,0,0]}"#), Some("rotation")),
        (plain.replace(r#"{"mesh":0}"#, r#"{"mesh":0,"translation":[NaN,0,0]}"#), Some("translation")),
        (plain.replace(r#""attributes":{"#, r#""attributes":{"NORMAL":8,"COLOR_0":9,"#), Some("accessor 8")),
    ] {
        let (model, warnings) = inline(&members).unwrap_or_else(|line| panic!("{members}: {line}"));
        assert_eq!(model.meshes[0].positions, [Vec3::ZERO, Vec3::X, Vec3::Y], "{members}");
        match words {
            None => assert!(warnings.is_empty(), "{members}: {warnings:?}"),
            Some(words) => assert!(warnings.iter().any(|warning| warning.contains(words)), "{words}: {warnings:?}"),
        }
    }
    for (material, words) in [
        (r#"{"pbrMetallicRoughness":{"baseColorTexture":{"index":9}}}"#, "texture 9"),
        (r#"{"extensions":{"KHR_materials_specular":{"specularTexture":{"index":9}}}}"#, "texture 9"),
        (r#"{"normalTexture":{"index":9}}"#, "texture 9"),
        (r#"{"pbrMetallicRoughness":{"metallicFactor":1.0000001,"baseColorFactor":[1.5,0,0,1]}}"#, "metallicFactor"),
        (r#"{"alphaMode":"HASHED"}"#, "alpha mode"),
        (r#"{"pbrMetallicRoughness":7,"extensions":[],"emissiveFactor":"red"}"#, ""),
    ] {
        let members = triangle(TRIANGLE, r#""count":3"#, r#","material":0"#);
        let (_, warnings) = inline(&format!(r#"{members},"materials":[{material}]"#)).expect(material);
        assert!(words.is_empty() || warnings.iter().any(|w| w.contains(words)), "{material}: {warnings:?}");
    }
}

#[test]
fn a_vertex_that_is_no_number_costs_its_triangles_alone() {
    // The second vertex is (NaN, 0, 0).
    let members = triangle(&TRIANGLE.replace("AACAPwAA", "AADAfwAA"), r#""count":3"#, "");
    let (model, warnings) = inline(&members).expect("loads");
    assert!(model.meshes[0].triangles.is_empty() && warnings[0].contains("1 triangles have a vertex"), "{warnings:?}");
    scene_of(model);
}

#[test]
fn wide_and_deep_hierarchies_neither_hang_nor_overflow() {
    let nodes: Vec<String> = (0..100_000).map(|i| format!(r#"{{"children":[{}]}}"#, i + 1)).collect();
    let (model, _) =
        inline(&format!(r#""nodes":[{},{{}}],"scenes":[{{"nodes":[0]}}]"#, nodes.join(","))).expect("loads");
    assert_eq!(model.rig.nodes.len(), 100_001);
    assert_eq!(model.rig.node_matrices(None).len(), 100_001);
}

#[test]
fn meshes_used_twice_are_packed_once() {
    let members = triangle(TRIANGLE, r#""count":3"#, "").replace(
        r#""nodes":[0]}],"nodes":[{"mesh":0}]"#,
        r#""nodes":[0]}],"nodes":[{"mesh":0,"children":[1]},{"mesh":0,"translation":[0,0,5]}]"#,
    );
    let scene = scene_of(inline(&members).expect("loads").0);
    assert_eq!((scene.packed.triangles.len(), scene.instance_count()), (1, 2));
    let instances = scene.at(0.0, 0.0).instances.instances;
    assert_eq!(instances[0].root, instances[1].root);
    assert_eq!((instances[1].id, instances[1].object_to_world[2][3]), (2, 5.0));
}

/// The extensions that Khronos lists, ratified and of vendors. Each is read, passed over in silence because it shows
/// nothing, or named once, also if it is required; but one that shapes may need is an error then, which names it.
#[test]
fn every_listed_extension_is_read_or_named() {
    let plain = triangle(TRIANGLE, r#""count":3"#, "");
    let read = "KHR_lights_punctual KHR_materials_anisotropy KHR_materials_clearcoat KHR_materials_dispersion \
        KHR_materials_emissive_strength KHR_materials_ior KHR_materials_iridescence KHR_materials_sheen \
        KHR_materials_specular KHR_materials_transmission KHR_materials_unlit KHR_materials_variants \
        KHR_materials_volume KHR_materials_pbrSpecularGlossiness KHR_mesh_quantization KHR_texture_transform \
        EXT_meshopt_compression KHR_meshopt_compression EXT_mesh_gpu_instancing EXT_texture_webp KHR_xmp_json_ld KHR_xmp";
    // What these compress is an error or a warning where it is met, with a command that converts the file.
    let converted = "KHR_draco_mesh_compression KHR_texture_basisu EXT_texture_avif MSFT_texture_dds";
    let other = "KHR_animation_pointer KHR_node_visibility KHR_node_hoverability KHR_node_selectability \
        KHR_interactivity KHR_audio_graph KHR_audio_emitter KHR_physics_rigid_bodies KHR_materials_diffuse_transmission \
        KHR_materials_volume_scatter KHR_techniques_webgl EXT_lights_image_based \
        EXT_lights_ies EXT_mesh_features EXT_structural_metadata EXT_instance_features \
        ADOBE_materials_clearcoat_specular ADOBE_materials_thin_transparency \
        AGI_articulations AGI_stk_metadata CESIUM_primitive_outline FB_geometry_metadata GODOT_single_root \
        GRIFFEL_bim_data MPEG_media MPEG_animation_timing MPEG_audio_spatial \
        MPEG_scene_dynamic MPEG_texture_video MPEG_viewport_recommended \
        MSFT_lod MSFT_packing_normalRoughnessMetallic MSFT_packing_occlusionRoughnessMetallic NV_materials_mdl \
        OMI_collider OMI_physics_body VRMC_vrm";
    let shapes = "KHR_gaussian_splatting EXT_primitive_voxels EXT_mesh_primitive_restart MPEG_accessor_timed \
        MPEG_buffer_circular MPEG_mesh_linking ACME_secret_meshes materials";
    for (list, named, refused) in
        [(read, false, false), (converted, false, false), (other, true, false), (shapes, true, true)]
    {
        for name in list.split_whitespace() {
            let names = |warnings: &[String]| warnings.iter().filter(|warning| warning.contains(name)).count();
            let (_, warnings) = inline(&format!(r#"{plain},"extensionsUsed":["{name}","{name}"]"#)).expect(name);
            assert_eq!(names(&warnings), usize::from(named), "{name}");
            let required = inline(&format!(r#"{plain},"extensionsUsed":["{name}"],"extensionsRequired":["{name}"]"#));
            match required {
                Ok((_, warnings)) => {
                    assert!(!refused && names(&warnings) == usize::from(named), "{name}: {warnings:?}");
                    assert!(!named || warnings[0].contains("is required and unknown"), "{warnings:?}");
                }
                Err(line) => {
                    assert!(refused && line.contains(name) && !line.contains('\n'), "{line}");
                    assert!(!line.contains("export") && line.contains("gltf-pipeline"), "{line}");
                }
            }
        }
    }
}

/// Files that gltfpack has compressed (`gltfpack -c`, with both extensions and all filters) are what they were.
#[test]
fn compressed_by_meshoptimizer() {
    let corpus = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/corpus");
    for (packed, plain) in [
        ("meshopt.glb", "RiggedFigure/RiggedFigure.glb"),
        ("meshopt_khr.glb", "RiggedFigure/RiggedFigure.glb"),
        ("meshopt_colors.glb", "BoxVertexColors/BoxVertexColors.glb"),
    ] {
        let (model, warnings) = gltf::load(&corpus.join(packed)).unwrap_or_else(|error| panic!("{error}"));
        assert!(warnings.is_empty(), "{warnings:?}");
        // Vertices are merged and in another order, but the triangles' corners are the same.
        let corners = |model: &Model| {
            let (mut tint, mut facing, mut count) = (Vec3::ZERO, Vec3::ZERO, 0.0);
            for mesh in &model.meshes {
                for vertex in mesh.triangles.iter().flatten().map(|vertex| *vertex as usize) {
                    tint += mesh.colors.get(vertex).map_or(Vec3::ONE, |color| color.truncate());
                    facing += mesh.normals[vertex].abs();
                    count += 1.0;
                }
            }
            (tint / count, facing / count)
        };
        let plain = load(plain).0;
        let [(tint, facing), (plain_tint, plain_facing)] = [&model, &plain].map(corners);
        assert!(tint.abs_diff_eq(plain_tint, 0.01), "{packed}: {tint} {plain_tint}");
        assert!(facing.abs_diff_eq(plain_facing, 0.01), "{packed}: {facing} {plain_facing}");
        let [packed_scene, plain] = [model, plain].map(scene_of);
        assert_eq!(packed_scene.packed.triangles.len(), plain.packed.triangles.len(), "{packed}");
        for time in [0.0, 0.4, 0.9] {
            let [a, b] = [&packed_scene, &plain].map(|scene| scene.object_bounds(0, time));
            assert!(a.min.abs_diff_eq(b.min, 4e-3) && a.max.abs_diff_eq(b.max, 4e-3), "{packed}: {a:?} {b:?}");
        }
    }
}

/// Flipped bytes in real files: an error or a model, never a panic.
#[test]
fn mutated_files_never_panic() {
    let mut seed = 1_u64;
    let mut random = |below: usize| {
        seed = seed.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        (seed >> 33) as usize % below
    };
    let folder = tempfile::tempdir().expect("a folder");
    let mut refused = 0;
    for source in [
        "BoxInterleaved/BoxInterleaved.glb",
        "BoxVertexColors/BoxVertexColors.glb",
        "BoxAnimated/BoxAnimated.gltf",
        "SimpleSparseAccessor/SimpleSparseAccessor.gltf",
        "SimpleMorph/SimpleMorph.gltf",
    ] {
        let source = data("gltf").join(source);
        for entry in std::fs::read_dir(source.parent().expect("a folder")).expect("read") {
            let entry = entry.expect("an entry").path();
            std::fs::copy(&entry, folder.path().join(entry.file_name().expect("a name"))).expect("copied");
        }
        let whole = std::fs::read(&source).expect("read");
        let path = folder.path().join("mutated").with_extension(source.extension().expect("one"));
        for _ in 0..400 {
            let mut bytes = whole.clone();
            for _ in 0..1 + random(4) {
                let at = random(bytes.len());
                bytes[at] = match random(3) {
                    0 => b'0' + random(10) as u8,
                    1 => bytes[at] ^ (1 << random(8)),
                    _ => random(256) as u8,
                };
            }
            if random(8) == 0 {
                bytes.truncate(random(bytes.len()));
            }
            std::fs::write(&path, &bytes).expect("written");
            let outcome =
                catch_unwind(AssertUnwindSafe(|| gltf::load(&path).map(|(model, _)| scene_of(model)).is_err()));
            refused += usize::from(outcome.unwrap_or_else(|_| panic!("panicked on {}", path.display())));
        }
    }
    assert!(refused > 300, "{refused}");
}
