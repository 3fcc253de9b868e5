//! glTF loading: real models, and 263 broken ones.

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
        model::Model,
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
        radiance: vec![[1.0; 4]; 2],
        depth_size: [2, 1],
        depth: vec![1.0; 2],
        quantisation: Quantisation::None,
        warnings: vec![],
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
    // Many are only borderline (hints, unused data); but most of what is broken must be refused.
    println!("{refused} of {} refused", found.len());
    assert!(refused > 100, "only {refused} were refused");
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
    assert!(material.base_color_texture.is_some() && material.metallic_roughness_texture.is_some());
    assert!(material.normal_texture.is_some() && material.emissive_texture.is_some());
    let height = scene_of(model).object_bounds(0, 0.0);
    assert!(((height.max - height.min).y - 0.26).abs() < 0.02);
}

#[test]
fn unsupported_features_are_named() {
    for (file, feature) in [
        ("RiggedFigure/RiggedFigure.glb", "a skin"),
        ("AnimatedMorphCube/AnimatedMorphCube.glb", "a morph target"),
        ("BoxVertexColors/BoxVertexColors.glb", "a vertex colour"),
        ("AlphaBlendModeTest/AlphaBlendModeTest.glb", "alpha mode BLEND"),
        ("glass-table/glass-table.glb", "KHR_materials_transmission"),
    ] {
        let (_, warnings) = load(file);
        assert!(warnings.iter().any(|w| w.contains(feature) && w.contains(file)), "{file}: {warnings:?}");
    }
}

#[test]
fn missing_normals_are_flat_and_missing_tangents_are_made() {
    let (model, _) = load("TriangleWithoutIndices/TriangleWithoutIndices.gltf");
    assert_eq!(model.meshes[0].normals, [Vec3::Z; 3]);
    let (model, _) = load("NormalTangentTest/NormalTangentTest.glb");
    for (mesh, normal_mapped) in
        model.meshes.iter().map(|m| (m, model.materials[m.materials[0] as usize].normal_texture))
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
fn sparse_accessors_replace_positions() {
    let (model, _) = load("SimpleSparseAccessor/SimpleSparseAccessor.gltf");
    let positions = &model.meshes[0].positions;
    assert!(positions.iter().any(|p| p.abs_diff_eq(Vec3::new(1.0, 2.0, 0.0), 1e-6)), "{positions:?}");
}

#[test]
fn texture_transforms_are_baked() {
    let (model, _) = load("TextureTransformTest/TextureTransformTest.gltf");
    let uvs = |name: &str| {
        let node = model.rig.nodes.iter().find(|node| node.name == name).unwrap_or_else(|| panic!("no node {name}"));
        model.meshes[node.mesh.expect("a mesh")].uvs.clone()
    };
    let names: Vec<_> = model.rig.nodes.iter().map(|node| node.name.as_str()).collect();
    println!("{names:?}");
    let max = |uvs: &[Vec2]| uvs.iter().copied().fold(Vec2::NEG_INFINITY, Vec2::max);
    let min = |uvs: &[Vec2]| uvs.iter().copied().fold(Vec2::INFINITY, Vec2::min);
    // Offset U is 0.5 over half the image, Rotation 0.39 rad about the upper left corner.
    let offset = uvs("Offset U");
    assert!(
        min(&offset).abs_diff_eq(Vec2::new(0.5, 0.0), 1e-4) && max(&offset).abs_diff_eq(Vec2::new(1.0, 0.5), 1e-4),
        "{offset:?}"
    );
    let rotation = uvs("Rotation");
    assert!(min(&rotation).y < -0.1, "counter-clockwise with v down: {rotation:?}");
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
