//! Small pictures of textures and materials that must not drift: the goldens of `tests/golden`. A glTF file with a dozen
//! exhibits is made here, textures and all, and stands around the camera in a room.
//!
//! `IPRT_BLESS=1 cargo nextest run golden::` renders each golden anew, as the mean over [`SEEDS`], and writes beside them how far
//! single seeds are from it. Three times the farthest is the tolerance: noise is within it, and a mistake in a material is not,
//! which is shown by a small one in each exhibit.

use crate::common::{Texels, accumulate, colourful, object, options, room, validated, views};
use exr::prelude::{Compression, Encoding, Image, Layer, LayerAttributes, SpecificChannels, WritableImage, f16};
use glam::{Vec2, Vec3, vec2, vec3};
use iprt::{
    gpu::Gpu,
    image_file::{read::read, srgb::linear_to_srgb, write::write_png},
    options::RenderOptions,
    renderer::Renderer,
    scene::{Object, Scene, gltf, shapes::Shape},
    settings::Method,
};
use std::{
    collections::BTreeMap,
    f32::consts::{PI, TAU},
    path::{Path, PathBuf},
    sync::Arc,
};

const SIZE: [u32; 2] = [96, 64];
const FRAMES: u32 = 8;
/// Those whose mean a golden is. The test takes another.
const SEEDS: std::ops::Range<u32> = 1..5;

/// Name, glTF material, and a mistake: what stands in the place of what.
const EXHIBITS: [(&str, &str, [&str; 2]); 12] = [
    // sRGB is not decoded
    (
        "base_color",
        r#""pbrMetallicRoughness":{"baseColorTexture":{"index":0},"metallicFactor":0,"roughnessFactor":0.8}"#,
        [r#""index":0"#, r#""index":6"#],
    ),
    // turned to the other side
    (
        "texture_transform",
        r#""pbrMetallicRoughness":{"baseColorTexture":{"index":0,"extensions":{"KHR_texture_transform":
            {"offset":[0.2,0.1],"rotation":0.5,"scale":[2,1.5]}}},"metallicFactor":0,"roughnessFactor":0.8}"#,
        ["0.5", "-0.5"],
    ),
    // roughness and metallic are swapped
    (
        "metallic_roughness",
        r#""pbrMetallicRoughness":{"baseColorFactor":[0.9,0.6,0.3,1],"metallicRoughnessTexture":{"index":1}}"#,
        [r#""index":1"#, r#""index":7"#],
    ),
    // green downwards
    (
        "normal",
        r#""pbrMetallicRoughness":{"baseColorFactor":[0.7,0.7,0.7,1],"metallicFactor":0.5,"roughnessFactor":0.3},
            "normalTexture":{"index":2,"scale":0.8}"#,
        [r#""index":2"#, r#""index":8"#],
    ),
    // by the other coordinates
    (
        "emissive",
        r#""pbrMetallicRoughness":{"baseColorFactor":[0.1,0.1,0.1,1],"metallicFactor":0},"emissiveFactor":[0.9,1,0.8],
            "emissiveTexture":{"index":3,"texCoord":1},
            "extensions":{"KHR_materials_emissive_strength":{"emissiveStrength":2}}"#,
        [r#","texCoord":1"#, ""],
    ),
    // another cutoff
    (
        "alpha_mask",
        r#""alphaMode":"MASK","alphaCutoff":0.4,"pbrMetallicRoughness":{"baseColorTexture":{"index":4},"metallicFactor":0}"#,
        ["0.4", "0.6"],
    ),
    // the factor is left out
    (
        "alpha_blend",
        r#""alphaMode":"BLEND","pbrMetallicRoughness":{"baseColorFactor":[1,1,1,0.8],"baseColorTexture":{"index":4},"metallicFactor":0}"#,
        ["0.8", "1"],
    ),
    // the texture is left out
    (
        "transmission",
        r#""pbrMetallicRoughness":{"baseColorFactor":[0.9,0.7,0.5,1],"metallicFactor":0,"roughnessFactor":0.2},
            "extensions":{"KHR_materials_transmission":{"transmissionFactor":1,"transmissionTexture":{"index":1}}}"#,
        [r#","transmissionTexture":{"index":1}"#, ""],
    ),
    // the coat is left out
    (
        "clearcoat",
        r#""pbrMetallicRoughness":{"baseColorFactor":[0.05,0.02,0.02,1],"metallicFactor":0,"roughnessFactor":0.9},
            "extensions":{"KHR_materials_clearcoat":{"clearcoatFactor":1,"clearcoatTexture":{"index":4},
            "clearcoatRoughnessFactor":0.6,"clearcoatRoughnessTexture":{"index":1}}}"#,
        [r#""clearcoatFactor":1"#, r#""clearcoatFactor":0"#],
    ),
    // the texture is left out
    (
        "sheen",
        r#""pbrMetallicRoughness":{"baseColorFactor":[0.05,0.05,0.1,1],"metallicFactor":0,"roughnessFactor":0.9},
            "extensions":{"KHR_materials_sheen":{"sheenColorFactor":[1,0.9,0.8],"sheenColorTexture":{"index":0},
            "sheenRoughnessFactor":0.9,"sheenRoughnessTexture":{"index":4}}}"#,
        [r#","sheenColorTexture":{"index":0}"#, ""],
    ),
    // the turn is left out
    (
        "anisotropy",
        r#""pbrMetallicRoughness":{"baseColorFactor":[0.9,0.85,0.8,1],"roughnessFactor":0.25},
            "extensions":{"KHR_materials_anisotropy":{"anisotropyStrength":0.9,"anisotropyRotation":0.8,"anisotropyTexture":{"index":5}}}"#,
        ["0.8,\"aniso", "0,\"aniso"],
    ),
    // another thickness
    (
        "iridescence",
        r#""pbrMetallicRoughness":{"baseColorFactor":[0.4,0.4,0.4,1],"roughnessFactor":0.3},
            "extensions":{"KHR_materials_iridescence":{"iridescenceFactor":1,"iridescenceThicknessMinimum":100,
            "iridescenceThicknessMaximum":700,"iridescenceThicknessTexture":{"index":1}}}"#,
        ["700", "600"],
    ),
];

/// Numbers of [0, 1] as bytes.
fn bytes(texel: [f32; 4]) -> [u8; 4] {
    texel.map(|x| (255.0 * x.clamp(0.0, 1.0)).round() as u8)
}

fn colours(p: Vec2) -> [f32; 4] {
    let checked = (p * 6.0).floor();
    let dark = if (checked.x + checked.y) % 2.0 == 0.0 { 0.35 } else { 1.0 };
    [dark * p.x, dark * (1.0 - p.y), dark * if p.x > p.y { 0.9 } else { 0.2 }, 1.0]
}

/// A share in R, ramps in G and B that run in other directions.
fn numbers(p: Vec2) -> [f32; 4] {
    [0.5 + 0.5 * (9.0 * p.x + 5.0 * p.y).sin(), p.x, (2.5 * p.y - 0.6).clamp(0.0, 1.0), 1.0]
}

fn bumps(p: Vec2) -> [f32; 4] {
    let n = vec3(0.6 * (TAU * 2.0 * p.x).sin(), 0.6 * (TAU * (1.5 * p.y + p.x)).cos(), 1.0).normalize();
    [0.5 * n.x + 0.5, 0.5 * n.y + 0.5, 0.5 * n.z + 0.5, 1.0]
}

fn lamps(p: Vec2) -> [f32; 4] {
    let cell = (p * 8.0).floor();
    let at = (cell.x + 3.0 * cell.y) * 1.7;
    [0.5 + 0.5 * at.sin(), 0.5 + 0.5 * (1.3 * at).cos(), 0.5 + 0.5 * (2.1 * at).sin(), 1.0]
}

fn leaves(p: Vec2) -> [f32; 4] {
    let alpha = 0.5 + 0.5 * (TAU * 2.0 * p.x).cos() * (TAU * 1.5 * p.y).sin();
    [0.9, 0.3 + 0.6 * p.y, 0.2, alpha]
}

fn directions(p: Vec2) -> [f32; 4] {
    let (sin, cos) = (PI * p.x).sin_cos();
    [0.5 + 0.5 * cos, 0.5 + 0.5 * sin, 1.0 - 0.6 * p.y, 1.0]
}

/// Says what a texture holds at a place.
type Paint = fn(Vec2) -> [f32; 4];

/// The textures, and from the seventh on what mistakes make of them.
const TEXTURES: [Paint; 9] = [
    colours,
    numbers,
    bumps,
    lamps,
    leaves,
    directions,
    |p| colours(p).map(linear_to_srgb),
    |p| {
        let [r, g, b, a] = numbers(p);
        [r, b, g, a]
    },
    |p| {
        let [x, y, z, a] = bumps(p);
        [x, 1.0 - y, z, a]
    },
];

const GRID: usize = 24;
/// Half the side of an exhibit, and its distance, metres.
const HALF: f32 = 0.35;
const DISTANCE: f32 = 2.0;

/// Writes the glTF file, with a mistake in every material or in none.
fn write_model(folder: &Path, mistaken: bool) -> PathBuf {
    const TEXELS: u32 = 64;
    for (number, paint) in TEXTURES.iter().enumerate() {
        let at = |i: u32| (vec2((i % TEXELS) as f32, (i / TEXELS) as f32) + 0.5) / TEXELS as f32;
        let codes: Vec<u8> = (0..TEXELS * TEXELS).flat_map(|i| bytes(paint(at(i)))).collect();
        write_png(&folder.join(format!("{number}.png")), [TEXELS; 2], &codes, 4).expect("written");
    }
    // A cushion, so that each shows a range of directions: z is a paraboloid's over the square.
    let corners = (0..=GRID).flat_map(|y| (0..=GRID).map(move |x| vec2(x as f32, y as f32) / GRID as f32));
    let mut columns = [const { Vec::<f32>::new() }; 5];
    for uv in corners {
        let p = vec2(2.0 * uv.x - 1.0, 1.0 - 2.0 * uv.y);
        let position = vec3(p.x * HALF, p.y * HALF, 0.4 * HALF * (2.0 - p.length_squared()));
        columns[0].extend(position.to_array());
        columns[1].extend(vec3(0.8 * p.x, 0.8 * p.y, 1.0).normalize().to_array());
        columns[2].extend(uv.to_array());
        columns[3].extend((vec2(uv.y, uv.x) * 1.5 - 0.3).to_array());
        columns[4].extend([1.0, uv.x, 1.0 - 0.5 * uv.y]);
    }
    let row = GRID + 1;
    let quads = (0..GRID * GRID).map(|i| i / GRID * row + i % GRID);
    let indices: Vec<u8> = quads
        .flat_map(|a| [a, a + row, a + 1, a + 1, a + row, a + row + 1])
        .flat_map(|i| (i as u32).to_le_bytes())
        .collect();
    let (mut data, mut buffer_views, mut accessors) = (Vec::<u8>::new(), Vec::new(), Vec::new());
    for (column, kind) in columns.iter().zip(["VEC3", "VEC3", "VEC2", "VEC2", "VEC3"]) {
        let bytes: Vec<u8> = column.iter().flat_map(|x| x.to_le_bytes()).collect();
        buffer_views.push(format!(r#"{{"buffer":0,"byteOffset":{},"byteLength":{}}}"#, data.len(), bytes.len()));
        let view = accessors.len();
        accessors
            .push(format!(r#"{{"bufferView":{view},"componentType":5126,"type":"{kind}","count":{}}}"#, row * row));
        data.extend(bytes);
    }
    buffer_views.push(format!(r#"{{"buffer":0,"byteOffset":{},"byteLength":{}}}"#, data.len(), indices.len()));
    accessors.push(format!(r#"{{"bufferView":5,"componentType":5125,"type":"SCALAR","count":{}}}"#, indices.len() / 4));
    data.extend(indices);

    let (mut materials, mut meshes, mut nodes) = (Vec::new(), Vec::new(), Vec::new());
    for (i, (name, material, [right, wrong])) in EXHIBITS.iter().enumerate() {
        assert!(material.contains(right), "{name}");
        let material = if mistaken { material.replace(right, wrong) } else { (*material).to_owned() };
        materials.push(format!(r#"{{"name":"{name}",{material}}}"#));
        let colour = if *name == "alpha_blend" { r#","COLOR_0":4"# } else { "" };
        meshes.push(format!(
            r#"{{"primitives":[{{"attributes":{{"POSITION":0,"NORMAL":1,"TEXCOORD_0":2,"TEXCOORD_1":3{colour}}},"indices":5,"material":{i}}}]}}"#
        ));
        let (at, turn) = (place(i), glam::Quat::from_rotation_y(-angle(i)));
        nodes.push(format!(
            r#"{{"mesh":{i},"translation":[{},{},{}],"rotation":[{},{},{},{}]}}"#,
            at.x, at.y, at.z, turn.x, turn.y, turn.z, turn.w
        ));
    }
    let numbered = |count: usize, text: &dyn Fn(usize) -> String| (0..count).map(text).collect::<Vec<_>>().join(",");
    let json = format!(
        r#"{{"asset":{{"version":"2.0"}},"extensionsUsed":["KHR_texture_transform","KHR_materials_emissive_strength",
        "KHR_materials_transmission","KHR_materials_clearcoat","KHR_materials_sheen","KHR_materials_anisotropy",
        "KHR_materials_iridescence"],"scene":0,"scenes":[{{"nodes":[{}]}}],"nodes":[{}],"meshes":[{}],"materials":[{}],
        "textures":[{}],"images":[{}],"samplers":[{{}},{{"magFilter":9728,"wrapS":33648,"wrapT":33071}}],
        "buffers":[{{"byteLength":{},"uri":"data.bin"}}],"bufferViews":[{}],"accessors":[{}]}}"#,
        numbered(EXHIBITS.len(), &|i| i.to_string()),
        nodes.join(","),
        meshes.join(","),
        materials.join(","),
        // the lamps' texture is mirrored, clamped and not interpolated
        numbered(TEXTURES.len(), &|i| format!(r#"{{"source":{i},"sampler":{}}}"#, u32::from(i == 3))),
        numbered(TEXTURES.len(), &|i| format!(r#"{{"uri":"{i}.png"}}"#)),
        data.len(),
        buffer_views.join(","),
        accessors.join(","),
    );
    std::fs::write(folder.join("data.bin"), &data).expect("written");
    let path = folder.join("exhibits.gltf");
    std::fs::write(&path, json).expect("written");
    path
}

/// Exhibits stand in a circle.
fn angle(exhibit: usize) -> f32 {
    TAU * exhibit as f32 / EXHIBITS.len() as f32
}

fn place(exhibit: usize) -> Vec3 {
    let (sin, cos) = angle(exhibit).sin_cos();
    DISTANCE * vec3(sin, 0.0, -cos)
}

fn exhibition(mistaken: bool) -> Scene {
    let folder = tempfile::tempdir().expect("a folder");
    let (model, warnings) = gltf::load(&write_model(folder.path(), mistaken)).expect("a good file");
    assert!(warnings.is_empty(), "{warnings:?}");
    let objects =
        vec![Object { model: Arc::new(model), ..object(Shape::Box.mesh(Vec3::ONE), Default::default(), Vec3::ZERO) }];
    let lamp = vec3(0.4, 0.8, 0.3).normalize();
    let panorama = room([256, 128], vec3(9.0, 4.0, 9.0), vec3(0.0, 0.5, 0.0), |d| {
        let stripes = if (7.0 * d.z.atan2(d.x)).sin() > 0.3 { 1.3 } else { 0.5 };
        if d.dot(lamp) > 0.96 { Vec3::splat(9.0) } else { stripes * colourful(d) }
    });
    let camera = views(&std::array::from_fn::<_, { EXHIBITS.len() }, _>(|i| (Vec3::ZERO, place(i), 24.0)));
    crate::common::scene(panorama, camera, objects)
}

/// A picture of each exhibit.
fn pictures(gpu: &Gpu, scene: &Scene, seed: u32) -> Vec<Texels> {
    // The relit panorama would take most of the time, and shows nothing of materials.
    let options = RenderOptions { size: SIZE, seed, ..options(Method::Iprt, &[("relight_levels", "0")]) };
    let mut renderer = Renderer::new(gpu, scene, options).expect("fits");
    let picture = |second| {
        accumulate(&mut renderer, scene, second, FRAMES);
        renderer.picture().expect("reads")
    };
    (0..EXHIBITS.len()).map(picture).collect()
}

/// Root mean square difference of means over 4×4 pixels, radiance up to 4. It is no number if one of the pictures has such.
fn distance(a: &Texels, b: &Texels) -> f64 {
    let mut sum = 0.0;
    let blocks = SIZE[0] * SIZE[1] / 16;
    for block in 0..blocks {
        let pixels = crate::common::block_pixels(block, SIZE[0]);
        for c in 0..3 {
            let shown = |x: f32| f64::from(if x > 4.0 { 4.0 } else { x });
            let difference = pixels.iter().map(|p| shown(a[*p][c]) - shown(b[*p][c])).sum::<f64>() / 16.0;
            sum += difference * difference;
        }
    }
    (sum / f64::from(3 * blocks)).sqrt()
}

fn folder() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/golden")
}

fn write_half(path: &Path, texels: &Texels) {
    let width = SIZE[0] as usize;
    let pixel = |at: exr::math::Vec2<usize>| {
        let [r, g, b, _] = texels[at.y() * width + at.x()].map(f16::from_f32);
        (r, g, b)
    };
    let encoding = Encoding { compression: Compression::ZIP16, ..Encoding::SMALL_LOSSLESS };
    let size = (width, SIZE[1] as usize);
    let layer = Layer::new(size, LayerAttributes::default(), encoding, SpecificChannels::rgb(pixel));
    Image::from_layer(layer).write().to_file(path).expect("written");
}

/// Renders the goldens, and how far the seeds are from them.
fn bless(gpu: &Gpu) {
    std::fs::create_dir_all(folder()).expect("a folder");
    let scene = exhibition(false);
    let seeds: Vec<_> = SEEDS.map(|seed| pictures(gpu, &scene, seed)).collect();
    let mut spread = BTreeMap::new();
    for (i, (name, ..)) in EXHIBITS.iter().enumerate() {
        let mean: Texels = (0..seeds[0][i].len())
            .map(|p| std::array::from_fn(|c| seeds.iter().map(|seed| seed[i][p][c]).sum::<f32>() / seeds.len() as f32))
            .collect();
        let farthest = seeds.iter().map(|seed| distance(&seed[i], &mean)).fold(0.0, f64::max);
        spread.insert(*name, (farthest * 1e5).ceil() / 1e5);
        write_half(&folder().join(format!("{name}.exr")), &mean);
    }
    let text = serde_json::to_string_pretty(&spread).expect("writes") + "\n";
    std::fs::write(folder().join("spread.json"), text).expect("written");
}

#[test]
fn textures_and_materials_have_not_drifted() {
    validated(|gpu| {
        if std::env::var_os("IPRT_BLESS").is_some() {
            bless(gpu);
        }
        let text = std::fs::read_to_string(folder().join("spread.json")).expect("IPRT_BLESS=1 writes it");
        let spread: BTreeMap<String, f64> = serde_json::from_str(&text).expect("as blessing writes it");
        let now = pictures(gpu, &exhibition(false), SEEDS.end);
        let mistaken = pictures(gpu, &exhibition(true), SEEDS.end);
        let mut wrong = Vec::new();
        for (i, (name, ..)) in EXHIBITS.iter().enumerate() {
            let path = folder().join(format!("{name}.exr"));
            let golden = read(&path).and_then(|image| image.into_color(name)).expect("a golden");
            assert_eq!(golden.size, SIZE);
            let tolerance = 3.0 * spread[*name];
            let [found, planted] = [&now[i], &mistaken[i]].map(|picture| distance(picture, &golden.texels));
            println!("{name}: {found:.5} of {tolerance:.5}, with a mistake {planted:.5}");
            if found.is_nan() || found > tolerance {
                wrong.push(format!("{name} has drifted: {found:.5}, its tolerance {tolerance:.5}"));
            }
            if planted <= 1.5 * tolerance {
                wrong.push(format!("{name}: a mistake goes unnoticed: {planted:.5}, tolerance {tolerance:.5}"));
            }
            // The comparison sees what is shifted, black or no number.
            let mut shifted = golden.texels.clone();
            shifted.rotate_right(4);
            let black = vec![[0.0; 4]; shifted.len()];
            let mut spoiled = golden.texels.clone();
            spoiled[77][1] = f32::NAN;
            assert!([shifted, black].iter().all(|other| distance(other, &golden.texels) > tolerance), "{name}");
            assert!(distance(&spoiled, &golden.texels).is_nan());
        }
        assert!(wrong.is_empty(), "{wrong:#?}");
    });
}
