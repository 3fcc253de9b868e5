//! Rays that meet virtual objects by the device's ray queries do what those by the BVH do. A device without ray queries says
//! so. `scripts/other_vulkan lavapipe` runs a command on a driver that has them.

use crate::{common::*, folder::Folder};
use glam::{Quat, Vec3, vec3};
use iprt::{
    gpu::Gpu,
    measure::metrics::{Picture, flip_map},
    options::RenderOptions,
    renderer::Renderer,
    scene::{
        Object, Scene,
        animation::{Placement, Transform},
        material::{Alpha, Material},
        shapes::Shape,
    },
    settings::Method,
};

/// Runs a test on a device that has ray queries, and demands the error of one that has not.
fn with_ray_queries(test: impl FnOnce(&Gpu)) {
    validated(|gpu| match gpu.require_ray_queries("", "") {
        Ok(()) => test(gpu),
        Err(_) => {
            let made = Renderer::new(gpu, &things(), options(Method::Iprt, &[("virtual_tracer", "ray_query")]));
            let error = made.err().expect("the device has no ray queries");
            assert_eq!(error.exit_code(), 2);
            let text = error.to_string();
            for word in ["virtual_tracer = ray_query", gpu.device_name(), "VK_KHR_ray_query", "virtual_tracer=bvh"] {
                assert!(text.contains(word), "no \"{word}\" in {text}");
            }
        }
    });
}

/// A dim room with a bright window.
fn panorama() -> iprt::panorama::source::PanoramaFrame {
    room([128, 64], vec3(4.0, 3.0, 5.0), Vec3::ZERO, |d| {
        let window = d.dot(vec3(-0.5, 0.4, -0.8).normalize()) > 0.95;
        (if window { 8.0 } else { 0.7 }) * Vec3::ONE + 0.03 * colourful(d)
    })
}

/// Objects of every kind: many triangles and few, turned, stretched, mirrored and flat, half there, of glass, moving, and
/// changing their shape.
fn things() -> Scene {
    let turned = Transform {
        translation: vec3(-0.5, -0.1, -1.6),
        rotation: Quat::from_rotation_y(0.7) * Quat::from_rotation_x(0.4),
        scale: vec3(1.0, -1.7, 0.6),
    };
    let flat = Transform { translation: vec3(0.0, -0.7, -1.6), scale: vec3(2.0, 0.0, 1.0), ..Transform::IDENTITY };
    let placed = |object: Object, transform| Object { placement: Placement::fixed(transform), ..object };
    let brick = || object(Shape::Box.mesh(Vec3::splat(0.3)), lambert(0.6), Vec3::ZERO);
    let pane = |alpha, alpha_mode, x: f32| {
        let material = Material { alpha, alpha_mode, ..lambert(0.4) };
        object(Shape::Box.mesh(vec3(0.25, 0.25, 0.01)), material, vec3(x, 0.35, -1.2))
    };
    let glass = Material { transmission: 1.0, thickness: 0.1, ..Material::plain("glass", Vec3::ONE, 0.0) };
    let objects = vec![
        fine_ball(0.25, metal(0.1), vec3(0.05, 0.0, -1.7)),
        placed(brick(), turned),
        placed(brick(), flat),
        pane(0.5, Alpha::Blend, -0.2),
        pane(0.3, Alpha::Mask(0.5), 0.1),
        pane(0.7, Alpha::Mask(0.5), 0.4),
        ball(0.12, glass, vec3(0.45, -0.25, -1.2)),
        moving(brick(), vec3(0.5, 0.1, -1.8), vec3(0.2, 0.5, -1.9)),
        growing(vec3(-0.1, -0.55, -1.3)),
        growing(vec3(0.7, -0.5, -1.9)),
    ];
    scene(panorama(), camera(Vec3::ZERO, vec3(0.0, 0.0, -1.5), 60.0), objects)
}

#[test]
fn primary_rays_hit_what_they_hit_by_the_bvh() {
    with_ray_queries(|gpu| {
        let scene = things();
        let of = |tracer| {
            let set = [("virtual_tracer", tracer), ("relight_levels", "0")];
            Renderer::new(gpu, &scene, options(Method::Iprt, &set)).expect("fits")
        };
        let (mut bvh, mut query) = (of("bvh"), of("ray_query"));
        let mut before = Texels::new();
        for (time, moves) in [(0.0, true), (0.4, true), (0.4, false), (1.0, true), (0.0, true)] {
            for renderer in [&mut bvh, &mut query] {
                renderer.render(&scene, time).expect("renders");
            }
            let hits = [&bvh, &query].map(|renderer| aov(renderer, "position_virtual"));
            let [mut met, mut same] = [0, 0];
            for (a, b) in hits[0].iter().zip(&hits[1]).filter(|(a, b)| a[3] > 0.0 || b[3] > 0.0) {
                met += 1;
                let apart = (0..4).map(|i| (a[i] - b[i]).abs()).fold(0.0, f32::max);
                same += u32::from(apart <= 1e-4 * a[3]);
            }
            println!("at {time} s {same} of {met} hits are the same");
            assert!(met > 700, "{met} pixels show objects");
            // a ray may pass an edge on the other side
            assert!(met - same <= met / 200, "at {time} s {same} of {met} hits are the same");
            assert_eq!(before != hits[1], moves, "what moves is seen to move, at {time} s");
            before.clone_from(&hits[1]);
        }
    });
}

#[test]
fn pictures_are_those_of_the_bvh() {
    with_ray_queries(|gpu| {
        let scene = things();
        for (method, converges, times) in
            [(Method::Iprt, false, [0.0, 0.3, 0.6, 0.6]), (Method::Reference, true, [0.2; 4])]
        {
            let of = |tracer: &str, seed: u32| {
                let set = [("virtual_tracer", tracer), ("relight_width", "32"), ("relight_warmup", "2")];
                let options = if converges { converged(method, &set) } else { options(method, &set) };
                let mut renderer = Renderer::new(gpu, &scene, RenderOptions { seed, ..options }).expect("fits");
                for time in times {
                    renderer.render(&scene, time).expect("renders");
                }
                aov(&renderer, "radiance")
            };
            let [bvh, query, noise] = [of("bvh", 1), of("ray_query", 1), of("bvh", 2)];
            let apart = |texels| {
                let picture = |subject, texels| Picture { subject, size: SIZE, texels };
                let flip = flip_map(picture("other", texels), picture("bvh", &bvh), 1.0).expect("of one size");
                flip.iter().sum::<f32>() / flip.len() as f32
            };
            // The last bit of a hit decides which half-transparent surfaces are there for a path.
            let (mean, noise) = (apart(&query), apart(&noise));
            println!("{method:?}: FLIP {mean}, of another seed {noise}");
            assert!(mean <= f32::max(0.002, 0.5 * noise), "{method:?}: FLIP {mean}, of another seed {noise}");
        }
    });
}

#[test]
fn the_build_is_timed_and_done_where_objects_move() {
    with_ray_queries(|gpu| {
        let scene = things();
        let mut renderer =
            Renderer::new(gpu, &scene, options(Method::Iprt, &[("virtual_tracer", "ray_query")])).expect("fits");
        let built = [0.0, 0.0, 0.1, 0.1, 0.0].map(|time| {
            let timings = renderer.render(&scene, time).expect("renders");
            timings.pass("acceleration").is_some()
        });
        assert_eq!(built, [true, false, true, false, true]);
        assert!(renderer.plan().passes().iter().any(|pass| pass.name == "acceleration" && pass.dispatches == 1));
    });
}

#[test]
fn the_command_line_refuses_what_the_device_lacks_before_anything_is_rendered() {
    let gpu = open();
    let has = gpu.require_ray_queries("", "").is_ok();
    close(gpu);
    let folder = Folder::with_scene();
    let asks = format!("{}[render]\nset = {{ virtual_tracer = \"ray_query\" }}\n", crate::folder::SCENE);
    folder.write("asks.toml", &asks);
    let words = ["virtual_tracer = ray_query", "VK_KHR_ray_query", "virtual_tracer=bvh"];
    for command in [
        "render scene.toml --size 8x8 -q -o a.exr --set virtual_tracer=ray_query",
        "render asks.toml --size 8x8 -q -o a.exr",
        "bench scene.toml --size 8x8 --frames 0..0 --warmup 0 --set virtual_tracer=ray_query",
        "check asks.toml -q",
    ] {
        if has {
            folder.succeeds(command);
        } else {
            folder.fails(command, &words);
        }
    }
    assert_eq!(folder.path("a.exr").exists(), has);
}
