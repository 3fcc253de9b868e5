//! glTF files that are odd in one part: that part costs nothing, or itself alone, and a warning names it.

use crate::{
    folder::Folder,
    gltf::{TRIANGLE, inline, triangle},
};
use base64::{Engine as _, engine::general_purpose::STANDARD};
use glam::Vec3;
use image::{ImageFormat, RgbaImage};
use iprt::{
    image_file::srgb::srgb_to_linear,
    scene::{
        gltf,
        material::{Material, Slot},
        model::Model,
    },
};
use std::io::Cursor;

fn plain() -> String {
    triangle(TRIANGLE, r#""count":3"#, "")
}

/// Loads a file whose triangle is to be there, and returns it with its warnings, of which one has these words. Without
/// words there are none.
fn drawn(members: &str, words: &str) -> (Model, Vec<String>) {
    let (model, warnings) = inline(members).unwrap_or_else(|line| panic!("{words}: {line}"));
    assert_eq!(model.meshes.iter().map(|mesh| mesh.triangles.len()).sum::<usize>(), 1, "{members}");
    match words {
        "" => assert!(warnings.is_empty(), "{warnings:?}"),
        _ => assert!(warnings.iter().any(|warning| warning.contains(words)), "{words}: {warnings:?}"),
    }
    (model, warnings)
}

/// An image of these texels, as a data URI.
fn image([width, height]: [u32; 2], texel: impl Fn(u32, u32) -> [u8; 4]) -> String {
    let image = RgbaImage::from_fn(width, height, |x, y| image::Rgba(texel(x, y)));
    let mut bytes = Cursor::new(Vec::new());
    image.write_to(&mut bytes, ImageFormat::Png).expect("encodes");
    format!("data:image/png;base64,{}", STANDARD.encode(bytes.into_inner()))
}

/// The model of a triangle with a material of KHR_materials_pbrSpecularGlossiness.
fn glossy(members: &str, images: &[String], words: &str) -> Model {
    let base = triangle(TRIANGLE, r#""count":3"#, r#","material":0"#);
    let images: Vec<_> = images.iter().map(|uri| format!(r#"{{"uri":"{uri}"}}"#)).collect();
    let material = format!(r#"{{"extensions":{{"KHR_materials_pbrSpecularGlossiness":{{{members}}}}}}}"#);
    let more = format!(
        r#""materials":[{material}],"images":[{}],"textures":[{{"source":0}},{{"source":1}}]"#,
        images.join(",")
    );
    drawn(&format!("{base},{more}"), words).0
}

/// What a material is at a texel: base colour, F0 and roughness.
fn at(model: &Model, texel: [u32; 2]) -> (Vec3, Vec3, f32) {
    let material: &Material = &model.materials[0];
    let code = |slot: Slot, one: [u8; 4]| {
        material.texture(slot).map_or(one, |used| {
            let texture = &model.textures[used.texture];
            texture.texels[(texel[1] * texture.size[0] + texel[0]) as usize]
        })
    };
    let linear = |slot| {
        let [r, g, b, _] = code(slot, [255; 4]).map(|code| srgb_to_linear(f32::from(code) / 255.0));
        Vec3::new(r, g, b)
    };
    let roughness = material.roughness * f32::from(code(Slot::MetallicRoughness, [255; 4])[1]) / 255.0;
    assert_eq!(material.metallic, 0.0);
    (
        material.base_color * linear(Slot::BaseColor),
        0.04 * material.specular_color * linear(Slot::SpecularColor),
        roughness,
    )
}

fn alike(a: (Vec3, Vec3, f32), b: (Vec3, Vec3, f32)) {
    let near = |a: Vec3, b: Vec3| a.abs_diff_eq(b, 6e-3);
    assert!(near(a.0, b.0) && near(a.1, b.1) && (a.2 - b.2).abs() < 4e-3, "{a:?} {b:?}");
}

/// A specular and glossy texture does what the same numbers do as factors.
#[test]
fn specular_textures_are_converted_texel_by_texel() {
    let red = r#""diffuseFactor":[0.7,0.1,0.1,1]"#;
    let white = || image([1, 1], |_, _| [255; 4]);
    for (code, glossiness) in [(56, 128), (200, 30), (0, 255)] {
        let f0 = srgb_to_linear(f32::from(code) / 255.0);
        let glossiness_factor = f32::from(glossiness) / 255.0;
        let factors = format!(r#"{red},"specularFactor":[{f0},{f0},{f0}],"glossinessFactor":{glossiness_factor}"#);
        let wanted = at(&glossy(&factors, &[], ""), [0, 0]);
        assert!(wanted.0.x > 0.05, "{wanted:?}");
        let specular = || image([2, 2], move |_, _| [code, code, code, glossiness]);
        let texture = r#""specularGlossinessTexture":{"index":0}"#;
        alike(at(&glossy(&format!("{red},{texture}"), &[specular()], ""), [1, 1]), wanted);
        let both = format!(r#"{red},{texture},"diffuseTexture":{{"index":1}}"#);
        let model = glossy(&both, &[specular(), white()], "");
        alike(at(&model, [1, 1]), wanted);
        // The textures from which they were made are gone.
        assert_eq!(model.textures.len(), 3, "base colour, specular colour, roughness");
    }
}

/// The smaller texture is read between its texels, and alpha stays.
#[test]
fn specular_and_diffuse_textures_differ_in_size() {
    let both = r#""diffuseTexture":{"index":0},"specularGlossinessTexture":{"index":1}"#;
    // The left half reflects all, and the right nothing.
    let halves = |size: u32| image([size, size], move |x, _| if 2 * x < size { [255; 4] } else { [0, 0, 0, 255] });
    let colors =
        |size: u32| image([size, size], move |_, y| if 2 * y < size { [255, 0, 0, 9] } else { [0, 0, 255, 9] });
    for (diffuse, specular) in [(16, 4), (4, 16), (8, 8)] {
        let model = glossy(both, &[colors(diffuse), halves(specular)], "");
        let texture = &model.textures[model.materials[0].texture(Slot::BaseColor).expect("one").texture];
        assert_eq!(texture.size, [diffuse.max(specular); 2]);
        assert!(texture.texels.iter().all(|texel| texel[3] == 9));
        let color = |x: u32, y: u32| {
            let texel = texture.texels[(y * texture.size[0] + x) as usize];
            Vec3::from([0, 1, 2].map(|part| srgb_to_linear(f32::from(texel[part]) / 255.0)))
        };
        let [quarter, far] = [texture.size[0] / 4, texture.size[0] * 3 / 4];
        for (x, y, wanted) in
            [(quarter, quarter, Vec3::ZERO), (quarter, far, Vec3::ZERO), (far, quarter, Vec3::X), (far, far, Vec3::Z)]
        {
            assert!(color(x, y).abs_diff_eq(wanted, 1e-5), "{}", color(x, y));
        }
    }
    let elsewhere = r#""diffuseTexture":{"index":0},"specularGlossinessTexture":{"index":1,"texCoord":1}"#;
    let model = glossy(elsewhere, &[colors(4), halves(4)], "lie differently");
    assert!(model.materials[0].base_color.abs_diff_eq(Vec3::splat(0.5 / 0.96), 1e-3), "half of it reflects all");
}

/// Sparse targets are data, however many vertices they are for, and targets that move nothing are none.
#[test]
fn sparse_targets_of_many_vertices_are_read() {
    let sparse = r#""sparse":{"count":3,"indices":{"bufferView":1,"componentType":5121},"values":{"bufferView":0}}"#;
    let accessor = |more: &str| format!(r#"{{"componentType":5126,"type":"VEC3","count":180000{more}}}"#);
    let members = |targets: usize| {
        let targets = vec![r#"{"POSITION":0,"NORMAL":0},{"POSITION":1,"NORMAL":1}"#; targets].join(",");
        format!(
            r#""scenes":[{{"nodes":[0]}}],"nodes":[{{"mesh":0}}],
            "meshes":[{{"primitives":[{{"attributes":{{"POSITION":0}},"targets":[{targets}]}}]}}],
            "buffers":[{{"byteLength":36,"uri":"{TRIANGLE}"}},{{"byteLength":3,"uri":"data:;base64,AAEC"}}],
            "bufferViews":[{{"buffer":0,"byteLength":36}},{{"buffer":1,"byteLength":3}}],
            "accessors":[{},{}]"#,
            accessor(&format!(",{sparse}")),
            accessor("")
        )
    };
    let (model, warnings) = inline(&members(8)).expect("loads");
    assert!(warnings.is_empty(), "{warnings:?}");
    let targets = &model.meshes[0].deform.as_ref().expect("targets").targets;
    assert_eq!(targets.len(), 16);
    assert_eq!(targets[14].positions[..4], [Vec3::ZERO, Vec3::X, Vec3::Y, Vec3::ZERO]);
    assert!(targets[15].positions.iter().all(|by| *by == Vec3::ZERO));
    // Too many are left out with one warning, and the rest is drawn.
    let (model, warnings) = inline(&members(100)).expect("loads");
    assert!(warnings.len() == 1 && warnings[0].contains("more morph targets than fit"), "{warnings:?}");
    assert_eq!(model.meshes[0].positions[1], Vec3::X);
    let line = inline(&members(1).replace("180000", "90000000")).expect_err("too many");
    assert!(line.contains("accessor 0: "), "{line}");
}

/// What cannot be read is left out, and named. A file of which nothing else is left is refused.
#[test]
fn a_bad_part_costs_itself_alone() {
    let base = plain();
    let primitive = r#"{"attributes":{"POSITION":0}}"#;
    let nodes = r#""scenes":[{"nodes":[0]}],"nodes":[{"mesh":0}]"#;
    let two_nodes = r#""scenes":[{"nodes":[0,1]}],"nodes":[{"mesh":1},{"mesh":0}]"#;
    let draco = r#"{"attributes":{"POSITION":1},"extensions":{"KHR_draco_mesh_compression":{}}}"#;
    let compressed = r#""accessors":[{"componentType":5126,"type":"VEC3","count":3},"#;
    for (bad, words) in [
        (r#"{"attributes":{"POSITION":44}}"#, "accessor 44 does not exist"),
        (r#"{"attributes":{"POSITION":0},"indices":0}"#, "no unsigned whole numbers"),
        (draco, "as by: gltf-transform copy"),
    ] {
        // The good accessor comes second where there is a compressed one.
        let members = match bad == draco {
            true => base.replace(r#""accessors":["#, compressed).replace(r#""POSITION":0"#, r#""POSITION":1"#),
            false => base.clone(),
        };
        let bad = bad.replace(r#""POSITION":1"#, r#""POSITION":0"#);
        let good = if members == base { primitive.to_owned() } else { primitive.replace('0', "1") };
        let (_, warnings) = drawn(&members.replace(&good, &format!("{bad},{good}")), words);
        assert!(warnings.len() == 1 && warnings[0].contains("left out: mesh 0, primitive 0"), "{warnings:?}");
        let mesh = format!(r#""meshes":[{{"primitives":[{good}]}},{{"primitives":[{bad}]}}]"#);
        let only = format!(r#""meshes":[{{"primitives":[{good}]}}]"#);
        let (_, warnings) = drawn(&members.replace(nodes, two_nodes).replace(&only, &mesh), words);
        assert!(warnings.len() == 1 && warnings[0].contains("left out: mesh 1, primitive 0"), "{warnings:?}");
        let line = inline(&members.replace(&good, &bad)).expect_err("nothing is left");
        assert!(line.contains(words) && !line.contains('\n'), "{line}");
    }
}

/// A triangle at `[0, 7, 0]` with a skin, whose only joint is no part of the scene. Its joints and weights are zero.
fn skinned(skin: &str, weights: usize) -> String {
    plain()
        .replace(
            r#""nodes":[{"mesh":0}]"#,
            r#""nodes":[{"mesh":0,"skin":0,"translation":[0,7,0]},{"translation":[5,0,0]},{"children":[1],"translation":[0,0,2]}]"#,
        )
        .replace(r#""POSITION":0"#, r#""POSITION":0,"JOINTS_0":1,"WEIGHTS_0":2"#)
        .replace(
            r#""count":3}]"#,
            &format!(
                r#""count":3}},{{"componentType":5121,"type":"VEC4","count":3}},{{"componentType":5126,"type":"VEC4","count":{weights}}},
                {{"componentType":5126,"type":"SCALAR","count":1}},{{"componentType":5126,"type":"VEC3","count":1}}]"#
            ),
        )
        + &format!(r#","skins":[{{"joints":[1]{skin}}}]"#)
}

#[test]
fn a_skin_whose_weights_do_not_fit_is_left_out() {
    let (model, _) = drawn(&skinned("", 5), "and its skin with it: mesh 0, primitive 0");
    let [mesh] = &model.meshes[..] else { panic!("one mesh") };
    assert!(mesh.deform.is_none());
    // Without a skin its node's place counts.
    let place = model.rig.nodes.iter().position(|node| node.mesh == Some(0)).expect("drawn");
    assert_eq!(model.rig.node_matrices(None)[place].translation, Vec3::new(0.0, 7.0, 0.0).into());
    // Beside a primitive that fits, it keeps to the first joint.
    let two = skinned("", 3)
        .replace(r#""primitives":["#, r#""primitives":[{"attributes":{"POSITION":0,"JOINTS_0":1,"WEIGHTS_0":3}},"#);
    let (model, warnings) = inline(&two).expect("loads");
    assert!(
        warnings.iter().any(|warning| warning.contains("with the first joint: mesh 0, primitive 0")),
        "{warnings:?}"
    );
    assert!(model.meshes[0].deform.as_ref().is_some_and(|deform| deform.skin.is_some()));
    assert_eq!([0, 3].map(|vertex| model.meshes[0].positions[vertex]), [Vec3::new(5.0, 0.0, 2.0); 2]);
}

/// Joints stand in their own parents wherever these are, and move with them.
#[test]
fn joints_outside_of_the_scene_stand_in_their_parents() {
    let clip = r#","animations":[{"channels":[{"sampler":0,"target":{"node":2,"path":"translation"}}],"samplers":[{"input":3,"output":4}]}]"#;
    let lamp = r#","extensions":{"KHR_lights_punctual":{"lights":[{"type":"point"}]}}"#;
    let shines = r#"{"extensions":{"KHR_lights_punctual":{"light":0}},"translation":[5,0,0]}"#;
    let members = skinned("", 3).replace(r#"{"translation":[5,0,0]}"#, shines) + clip + lamp;
    let (model, _) = drawn(&members, "has a joint that is not in the scene");
    assert_eq!(model.meshes[0].positions[0], Vec3::new(5.0, 0.0, 2.0));
    let deform = model.meshes[0].deform.as_ref().expect("a skin");
    let posed = deform.pose(&deform.stance(&model.rig, Some((0, 0.0))));
    assert_eq!(posed.positions[0], Vec3::new(5.0, 0.0, 0.0), "the parent moves to the origin");
    assert!(model.lights.is_empty(), "what else is outside stays there");
    // Parents in a circle.
    let circle = skinned("", 3).replace(r#"{"translation":[5,0,0]}"#, r#"{"children":[2],"translation":[5,0,0]}"#);
    assert_eq!(drawn(&circle, "not in the scene").0.meshes[0].positions[0], Vec3::new(5.0, 0.0, 2.0));
    let (model, _) =
        drawn(&skinned("", 3).replace(r#""joints":[1]"#, r#""joints":[9]"#), "a joint that does not exist");
    assert_eq!(model.meshes[0].positions[0], Vec3::ZERO);
}

#[test]
fn broken_inverse_bind_matrices_are_identity() {
    for (accessor, words) in [
        (88, "replaced by identity matrices: skin 0: accessor 88 does not exist"),
        (4, "replaced by identity matrices: skin 0: has 3 components"),
    ] {
        let (model, _) = drawn(&skinned(&format!(r#","inverseBindMatrices":{accessor}"#), 3), words);
        assert_eq!(model.meshes[0].positions[0], Vec3::new(5.0, 0.0, 2.0));
        assert!(model.meshes[0].deform.is_some());
    }
}

/// Lengths that are too great cost nothing while all elements are there, and neither do other words for the usual.
#[test]
fn lengths_and_strides_that_harm_nobody() {
    let base = plain();
    let buffer = r#""buffers":[{"byteLength":36"#;
    let view = r#"{"buffer":0,"byteLength":36}"#;
    for (members, words) in [
        (
            base.replace(buffer, r#""buffers":[{"byteLength":100000"#),
            "buffer 0: says it has 100000 bytes, but there are 36",
        ),
        (base.replace(view, r#"{"buffer":0,"byteLength":40}"#), "reaches beyond its buffer: what lies in it is read"),
        (base.replace(view, r#"{"buffer":0,"byteLength":36,"byteStride":0}"#), "a byteStride of 0"),
    ] {
        let (model, warnings) = drawn(&members, words);
        assert_eq!(model.meshes[0].positions, [Vec3::ZERO, Vec3::X, Vec3::Y]);
        assert_eq!(warnings.len(), 1, "{warnings:?}");
    }
    for (view, words) in [
        (r#"{"buffer":0,"byteOffset":40,"byteLength":36}"#, "reaches beyond its buffer"),
        (r#"{"buffer":0,"byteOffset":4,"byteLength":36}"#, "beyond its buffer view"),
        (r#"{"buffer":0,"byteLength":36,"byteStride":4}"#, "stride is smaller"),
    ] {
        let line = inline(&base.replace(r#"{"buffer":0,"byteLength":36}"#, view)).expect_err(words);
        assert!(line.contains(words), "{line}");
    }
    let folder = Folder::empty();
    let path = folder.path("two.gltf");
    for (version, accepted) in [("2", true), ("2.1", true), ("20", false), ("1.0", false)] {
        std::fs::write(&path, format!(r#"{{"asset":{{"version":"{version}"}},{base}}}"#)).expect("written");
        assert_eq!(gltf::load(&path).is_ok_and(|(_, warnings)| warnings.is_empty()), accepted, "{version}");
    }
}

/// Ways to write the same bytes in a URI.
#[test]
fn uris_are_read_as_they_are_met() {
    // Bytes of which base64 has all its letters that mean something in URIs: the last vertex is moved.
    let odd = TRIANGLE.replace("gD8AAAAA", "gD8AA/+/");
    let with = |uri: &str| triangle(uri, r#""count":3"#, "");
    let wanted = drawn(&with(&odd), "").0.meshes[0].positions.clone();
    assert!(wanted[2].z < -1.0, "{wanted:?}");
    for uri in [
        odd.replace('/', "%2F").replace('+', "%2B").replace("octet-stream", "octet-stream "),
        odd.replace("data:application/octet-stream;base64", "DATA:Application/Octet-Stream;BASE64"),
        odd.replace("AA/+/", "AA_-_"),
        odd.replace("AA/+/", "AA%5f%2d%5F") + "AA%3D%3d",
    ] {
        assert_eq!(drawn(&with(&uri), "").0.meshes[0].positions, wanted, "{uri}");
    }
    let folder = Folder::empty();
    let path = folder.path("a.gltf");
    let bytes = STANDARD.decode(TRIANGLE.split_once(',').expect("data").1).expect("base64");
    std::fs::write(folder.path("b c.bin"), &bytes).expect("written");
    // A file whose own name has what looks like a query comes first.
    std::fs::write(folder.path("b c.bin?v=4"), [&[0; 24], &bytes[12..24]].concat()).expect("written");
    for (uri, last) in [("b%20c.bin?v=3", Vec3::Y), ("b c.bin#part", Vec3::Y), ("b%20c.bin?v=4", Vec3::X)] {
        std::fs::write(&path, format!(r#"{{"asset":{{"version":"2.0"}},{}}}"#, with(uri))).expect("written");
        let (model, warnings) = gltf::load(&path).unwrap_or_else(|line| panic!("{line}"));
        assert!(warnings.is_empty() && model.meshes[0].positions[2] == last, "{uri}: {warnings:?}");
    }
    std::fs::write(&path, format!(r#"{{"asset":{{"version":"2.0"}},{}}}"#, with("?v=3"))).expect("written");
    assert!(gltf::load(&path).expect_err("no file").to_string().contains("buffer 0"));
}

#[test]
fn scenes_without_nodes_are_all_nodes() {
    for scenes in [r#""scenes":[{}]"#, r#""scene":1,"scenes":[{"nodes":[]},{}]"#] {
        let members = plain().replace(r#""scenes":[{"nodes":[0]}]"#, scenes);
        let (_, warnings) = drawn(&members, "scenes: have no nodes: all nodes are taken");
        assert_eq!(warnings.len(), 1, "{warnings:?}");
    }
}

#[test]
fn shapes_that_many_nodes_pose_are_counted_together() {
    let folder = Folder::with_scene();
    let scene = "[panorama]\ncolor = \"white.png\"\ndepth = 3\n[[object]]\ngltf = \"posed.gltf\"\n";
    folder.paint("white.png", |_, _| [255; 3]);
    folder.write("posed.toml", scene);
    // A thousand triangles, of which every node has its own, since it poses them by weights of its own.
    let corner =
        |vertex: u32| [u32::from(vertex % 3 == 1), u32::from(vertex % 3 == 2), 0].map(|n| (n as f32).to_le_bytes());
    let bytes: Vec<u8> = (0..3000).flat_map(corner).flatten().collect();
    let buffer = format!("data:application/octet-stream;base64,{}", STANDARD.encode(bytes));
    let posed = |count: usize| {
        let nodes = vec![r#"{"mesh":0,"weights":[0.5]}"#; count].join(",");
        let all = (0..count).map(|node| node.to_string()).collect::<Vec<_>>().join(",");
        let base = triangle(&buffer, r#""count":3000"#, r#","targets":[{"POSITION":0}]"#)
            .replace(r#""scenes":[{"nodes":[0]}]"#, &format!(r#""scenes":[{{"nodes":[{all}]}}]"#))
            .replace(r#""nodes":[{"mesh":0}]"#, &format!(r#""nodes":[{nodes}]"#))
            .replace(r#""byteLength":36"#, r#""byteLength":36000"#);
        folder.write("posed.gltf", &format!(r#"{{"asset":{{"version":"2.0"}},{base}}}"#));
    };
    posed(10);
    folder.succeeds("check posed.toml --memory 100M");
    posed(2000);
    folder.fails("check posed.toml --memory 100M", &["posed.gltf", "would take", "--memory"]);
}
