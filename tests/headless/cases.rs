//! Cases that users reported of tools for this job (`cases` of the real data): each has what is right in
//! `expected.json`, and every one of them is checked.

use crate::{
    common::{accumulate, options, project, validated},
    folder::Folder,
};
use glam::{Vec3, vec3};
use iprt::{
    renderer::Renderer,
    scene::{Scene, material::Slot, viewpoint::Projection},
    settings::Method,
};
use serde::Deserialize;
use std::path::PathBuf;

/// A texel's column and row, what is there, and how far it may be off, as a share of it.
type Texel<T> = (u32, u32, T, f32);

#[derive(Deserialize)]
struct Case {
    scene: String,
    what: String,
    #[serde(default)]
    pixels: Vec<Texel<[f32; 3]>>,
    #[serde(default)]
    depth: Vec<Texel<f32>>,
    #[serde(default)]
    atleast: Vec<(u32, u32, f32)>,
    /// The scene that it looks like.
    same: Option<String>,
    /// What `check` and `render` warn of.
    warn: Option<String>,
    rc: Option<i32>,
    frames: Option<String>,
    capture: Option<[f32; 3]>,
}

fn folder() -> PathBuf {
    let root = std::env::var_os("IPRT_DATA")
        .map_or_else(|| std::path::Path::new(env!("CARGO_MANIFEST_DIR")).join("../shared/data"), PathBuf::from);
    root.join("cases")
}

fn cases(kind: impl Fn(&Case) -> bool) -> Vec<Case> {
    let path = folder().join("expected.json");
    let text = std::fs::read(&path).unwrap_or_else(|error| panic!("{}: {error}; set IPRT_DATA", path.display()));
    let cases: Vec<Case> = serde_json::from_slice(&text).expect("cases");
    cases.into_iter().filter(kind).collect()
}

fn shows_a_panorama(case: &Case) -> bool {
    !(case.pixels.is_empty() && case.depth.is_empty() && case.atleast.is_empty())
}

fn load(name: &str) -> Scene {
    let path = folder().join(format!("{name}.toml"));
    Scene::load(&path).unwrap_or_else(|error| panic!("{name}: {error}"))
}

#[test]
fn every_case_is_of_a_kind_that_is_checked() {
    let unchecked = cases(|case| {
        !shows_a_panorama(case)
            && case.same.is_none()
            && case.warn.is_none()
            && case.rc.is_none()
            && case.capture.is_none()
    });
    let names: Vec<_> = unchecked.iter().map(|case| case.scene.as_str()).collect();
    assert_eq!(names, ["gltf_flat"], "these have a test of their own");
}

/// A panorama of that size shows its texels as they are.
#[test]
fn panoramas_are_what_their_files_say() {
    let near = |value: f32, right: f32, tolerance: f32| (value - right).abs() <= tolerance * right.max(0.05);
    validated(|gpu| {
        for case in cases(shows_a_panorama) {
            let name = &case.scene;
            let scene = load(name);
            let size = [128, 64];
            let options = iprt::options::RenderOptions {
                size,
                projection: Projection::Equirect,
                without_objects: true,
                ..options(Method::Iprt, &[])
            };
            let mut renderer = Renderer::new(gpu, &scene, options).expect("fits");
            renderer.render(&scene, 0.0).expect("renders");
            let picture = renderer.picture().expect("read");
            let texel = |x: u32, y: u32| picture[(y * size[0] + x) as usize];
            for &(x, y, right, tolerance) in &case.pixels {
                let found = texel(x, y);
                // Of the brightest channel, as a camera's code is.
                let most = tolerance * right.into_iter().fold(0.0, f32::max);
                let fits = right.iter().zip(found).all(|(right, found)| (found - right).abs() <= most);
                assert!(fits, "{name}: ({x}, {y}) is {found:?}, not {right:?}: {}", case.what);
            }
            for &(x, y, least) in &case.atleast {
                assert!(texel(x, y)[..3].iter().all(|value| *value >= least), "{name}: {:?}", texel(x, y));
            }
            let frame = scene.panorama.load(0).expect("loads");
            for &(x, y, right, tolerance) in &case.depth {
                let found = frame.depth[(y * frame.depth_size[0] + x) as usize];
                assert!(near(found, right, tolerance), "{name}: depth at ({x}, {y}) is {found}, not {right}");
            }
        }
    });
}

/// A triangle of the world: its corners, uv and material, by which pictures of two scenes are the same.
#[derive(Debug)]
struct Triangle {
    corners: [Vec3; 3],
    uv: [glam::Vec2; 3],
    colors: [Vec3; 3],
    finish: [f32; 4],
    texels: Vec<u32>,
}

fn triangles(scene: &Scene, time: f64) -> Vec<Triangle> {
    let packed = &scene.packed;
    let mut triangles = Vec::new();
    for instance in scene.at(time, time).instances.instances {
        let rows = instance.object_to_world.map(glam::Vec4::from);
        let world = |p: Vec3| Vec3::from_array(rows.map(|row| row.dot(p.extend(1.0))));
        // Nodes are in depth-first order, so a mesh ends where the next begins.
        let roots = packed.nodes[instance.root as usize..].iter();
        for node in roots {
            let (first, count) = (node.leaf >> 3, node.leaf & 7);
            for index in first..first + if node.leaf == 0 { 0 } else { count } {
                let (at, shading) = (packed.triangles[index as usize], packed.shading[index as usize]);
                let material = packed.materials[shading.material as usize];
                let uv = [shading.v0, shading.v1, shading.v2].map(|v| packed.vertices[v as usize].uv);
                let texels = packed
                    .textures
                    .get(material.textures[Slot::BaseColor as usize] as usize)
                    .map_or(&[][..], |texture| {
                        &packed.texels[texture.offset as usize..][..(texture.width * texture.height) as usize]
                    });
                triangles.push(Triangle {
                    corners: [at.v0, at.v0 + at.e1, at.v0 + at.e2].map(world),
                    uv: if texels.is_empty() { Default::default() } else { uv },
                    colors: [material.base_color, material.emissive, material.specular_color],
                    finish: [material.metallic, material.roughness, material.specular, material.ior],
                    texels: texels.to_vec(),
                });
            }
            if node.leaf != 0 && node.next == iprt::scene::packed::NONE {
                break;
            }
        }
    }
    triangles
}

#[test]
fn models_look_like_their_plain_twins() {
    for case in cases(|case| case.same.is_some()) {
        let first =
            case.frames.as_deref().map_or(0, |f| f.split('.').next().and_then(|n| n.parse().ok()).expect("a range"));
        let [shown, twin] = [&case.scene, case.same.as_ref().expect("one")].map(|name| {
            let scene = load(name);
            triangles(&scene, scene.panorama.frame_time(first))
        });
        assert!(!twin.is_empty() && shown.len() == twin.len(), "{}: {} triangles", case.scene, shown.len());
        for triangle in &twin {
            let near = |a: &Vec3, b: &Vec3| a.abs_diff_eq(*b, 2e-3);
            let same = shown.iter().any(|other| {
                (0..3).any(|turn| {
                    (0..3).all(|k| {
                        near(&other.corners[(k + turn) % 3], &triangle.corners[k])
                            && other.uv[(k + turn) % 3].abs_diff_eq(triangle.uv[k], 2e-3)
                    })
                }) && other.colors.iter().zip(&triangle.colors).all(|(a, b)| near(a, b))
                    && other.finish.iter().zip(triangle.finish).all(|(a, b)| (a - b).abs() < 2e-3)
                    && other.texels == triangle.texels
            });
            assert!(same, "{}: {}: nothing is like {triangle:?}", case.scene, case.what);
        }
    }
}

#[test]
fn a_flattened_model_is_a_card() {
    validated(|gpu| {
        let scene = load("gltf_flat");
        let bounds = scene.object_bounds(0, 0.0);
        let size = bounds.max - bounds.min;
        assert!(size.abs_diff_eq(vec3(0.75, 0.5, 0.0), 2e-3), "{size}");
        let mut renderer = Renderer::new(gpu, &scene, options(Method::Iprt, &[])).expect("fits");
        accumulate(&mut renderer, &scene, 0, 4);
        let size = renderer.options().size;
        let at = project(&scene.camera, 0.0, size, vec3(0.0, 0.25, -1.3)).as_uvec2();
        let [r, g, b, _] = renderer.picture().expect("read")[(at.y * size[0] + at.x) as usize];
        assert!(r > 3.0 * g.max(b) && r > 0.02, "{:?}", Vec3::new(r, g, b));
    });
}

#[test]
fn what_is_odd_is_told_by_check_and_render() {
    let out = Folder::empty();
    for case in cases(|case| case.warn.is_some() || case.rc.is_some()) {
        let scene = folder().join(format!("{}.toml", case.scene));
        let scene = scene.to_str().expect("UTF-8");
        for arguments in
            [&["check", scene][..], &["render", scene, "-o", "a.png", "--size", "16x12", "--warmup", "0"][..]]
        {
            let output = out.run_with(arguments);
            let stderr = String::from_utf8_lossy(&output.stderr);
            let right = case.rc.unwrap_or(0);
            assert_eq!(output.status.code(), Some(right), "{}: {arguments:?}: {stderr}", case.what);
            let told = case.warn.as_deref().is_none_or(|word| stderr.lines().any(|line| line.contains(word)));
            assert!(told, "{}: {arguments:?}: {stderr}", case.what);
        }
    }
}

#[test]
fn unlit_rooms_are_captured_as_they_are() {
    for case in cases(|case| case.capture.is_some()) {
        let out = Folder::empty();
        let room = folder().join(&case.scene);
        out.succeeds_with(&["capture", room.to_str().expect("UTF-8"), "-o", "c", "--spp", "1", "--size", "32x16"]);
        let color = iprt::image_file::read::read(&out.path("c/color.exr")).and_then(|image| image.into_color("c"));
        let right = case.capture.expect("one");
        for texel in color.expect("an image").texels {
            let fits = texel.iter().zip(right).all(|(found, right)| (found - right).abs() < 1e-3);
            assert!(fits, "{texel:?}, not {right:?}");
        }
    }
}
