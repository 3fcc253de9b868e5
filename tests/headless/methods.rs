//! Methods are settings: each way of doing a thing against the other, alone.

use crate::common::*;
use glam::{Vec3, vec3};
use iprt::{
    gpu::Gpu,
    options::RenderOptions,
    renderer::Renderer,
    scene::{Scene, shapes::Shape, viewpoint::Projection},
    settings::{Method, Settings},
};

/// A dark board that stands on the floor and faces the camera: what the floor before it sees of it is in view.
fn board_scene() -> Scene {
    let board = object(Shape::Box.mesh(vec3(1.2, 0.7, 0.01)), lambert(0.1), vec3(0.1, -1.15, -1.3));
    scene(floor(), camera(Vec3::ZERO, vec3(0.0, -1.4, -1.0), 60.0), vec![board])
}

/// Means of E_RV/E_R over blocks of 4×4 pixels that show only floor.
fn ratios(renderer: &Renderer) -> Vec<Option<f32>> {
    let images = ["irradiance_mixed", "irradiance_real", "real_coverage"];
    let [mixed, real, coverage] = images.map(|name| aov(renderer, name));
    let [width, height] = renderer.options().size.map(|n| n as usize);
    let block = |i: usize| {
        let (x, y) = (i % (width / 4) * 4, i / (width / 4) * 4);
        let pixels: Vec<usize> = (0..16).map(|k| (y + k / 4) * width + x + k % 4).collect();
        let sum = |image: &Texels| pixels.iter().map(|p| image[*p][1]).sum::<f32>();
        pixels.iter().all(|p| coverage[*p][0] == 1.0).then(|| sum(&mixed) / sum(&real))
    };
    (0..(width / 4) * (height / 4)).map(block).collect()
}

#[test]
fn what_the_picture_shows_wholly_casts_the_same_shadow_from_the_screen() {
    validated(|gpu| {
        let scene = board_scene();
        for projection in [Projection::Perspective, Projection::Equirect] {
            let of = |tracer| {
                let set = [("virtual_tracer", tracer), ("relight_levels", "0"), ("coverage_samples", "1")];
                let options = converged(Method::Iprt, &set);
                ratios(&rendered(gpu, &scene, RenderOptions { projection, ..options }, 160))
            };
            let (bvh, screen) = (of("bvh"), of("screen"));
            let pairs: Vec<_> = bvh.iter().zip(&screen).filter_map(|(a, b)| Some(((*a)?, (*b)?))).collect();
            let largest = pairs.iter().map(|(a, b)| (a - b).abs()).fold(0.0, f32::max);
            let darkest = pairs.iter().map(|(a, _)| *a).fold(1.0, f32::min);
            assert!(pairs.len() > 60 && darkest < 0.9, "{projection:?}: {} blocks, the darkest {darkest}", pairs.len());
            // 2560 paths a block: the standard error of a difference is up to 0.014
            let rms = (pairs.iter().map(|(a, b)| (a - b) * (a - b)).sum::<f32>() / pairs.len() as f32).sqrt();
            assert!(largest < 0.07 && rms < 0.02, "{projection:?}: {largest}, {rms}");
        }
    });
}

#[test]
fn thickness_stride_and_jitter_of_the_screen_tracer_count() {
    validated(|gpu| {
        // a ball: how far it reaches behind what is seen is what thickness guesses
        let track = camera(Vec3::ZERO, vec3(0.0, -1.5, -1.2), 60.0);
        let scene = scene(floor(), track, vec![ball(0.3, lambert(0.2), vec3(0.0, -1.2, -1.2))]);
        let of = |set: &[(&str, &str)]| {
            let mut all = vec![("virtual_tracer", "screen"), ("relight_levels", "0"), ("coverage_samples", "1")];
            all.extend(set);
            let ratios = ratios(&rendered(gpu, &scene, converged(Method::Iprt, &all), 48));
            ratios.into_iter().flatten().sum::<f32>()
        };
        let plain = of(&[]);
        let thin = of(&[("screen_thickness", "0.001")]);
        let long = of(&[("screen_stride", "24")]);
        assert!(thin > plain + 0.1, "a thin shell casts less: {thin} against {plain}");
        assert!(long > plain + 0.1, "long steps miss: {long} against {plain}");
        let stiff = of(&[("screen_stride", "24"), ("screen_jitter", "0")]);
        assert!(
            (stiff - long).abs() > 0.01,
            "without jitter the same pixels are missed by all: {stiff} against {long}"
        );
    });
}

#[test]
fn the_discontinuity_mask_follows_edges() {
    validated(|gpu| {
        // near below the camera, where the coarse panorama has no steps
        let track = camera(Vec3::ZERO, vec3(0.0, -1.5, -0.8), 45.0);
        let scene = scene(floor(), track, vec![ball(0.15, lambert(0.5), vec3(0.0, -1.35, -0.8))]);
        let set = [("mask_by", "discontinuity"), ("short_history", "0"), ("sharp_roughness", "0")];
        let mut renderer = Renderer::new(gpu, &scene, options(Method::Iprt, &set)).expect("fits");
        let mut traced = vec![0; (SIZE[0] * SIZE[1]) as usize];
        for _ in 0..16 {
            renderer.render(&scene, 0.0).expect("renders");
            aov(&renderer, "mask_real").iter().zip(&mut traced).for_each(|(m, n)| *n += u32::from(m[0] > 0.0));
        }
        // in 16 frames: 16 times beside the ball, 4 times around that, once on the floor
        let coverage = aov(&renderer, "real_coverage");
        let (width, height) = (SIZE[0] as i32, SIZE[1] as i32);
        let virtual_near = |i: usize, radius: i32| {
            let (x, y) = (i as i32 % width, i as i32 / width);
            (-radius..=radius).any(|dy| {
                (-radius..=radius).any(|dx| {
                    let (x, y) = (x + dx, y + dy);
                    (0..width).contains(&x) && (0..height).contains(&y) && coverage[(y * width + x) as usize][0] < 0.5
                })
            })
        };
        let mut counted = std::collections::BTreeMap::new();
        for i in 0..traced.len() {
            if coverage[i][0] == 1.0 {
                *counted.entry(traced[i]).or_insert(0) += 1;
                assert!(
                    traced[i] == 1 || virtual_near(i, 4) || traced[i] == 0,
                    "{} at {}, {} on open floor",
                    traced[i],
                    i as i32 % width,
                    i as i32 / width
                );
            }
        }
        assert!(counted.keys().all(|n| [1, 4, 16].contains(n)), "{counted:?}");
        assert!([1, 4, 16].iter().all(|n| counted.contains_key(n)) && counted[&1] > 2 * counted[&16], "{counted:?}");
    });
}

/// A new virtual surface gets several paths, which bring what one path brings, with less noise.
#[test]
fn early_paths_bring_the_same_light_with_less_noise() {
    validated(|gpu| {
        let track = camera(Vec3::ZERO, vec3(0.0, -1.2, -1.2), 60.0);
        // two balls, so that paths visit more than one virtual surface
        let balls = [-0.26, 0.26].map(|x| ball(0.25, lambert(0.8), vec3(x, -1.2, -1.2)));
        let scene = scene(floor(), track, balls.to_vec());
        let of = |paths: &str, frames| {
            let set = [("early_paths", paths), ("early_history", "32"), ("atrous_levels", "1")];
            rendered(gpu, &scene, options(Method::Iprt, &set), frames)
        };
        let mut renderers = [of("1", 2), of("8", 2)];
        let masks =
            renderers.each_ref().map(|renderer| aov(renderer, "mask_virtual").iter().fold(0.0_f32, |n, m| n.max(m[0])));
        assert_eq!(masks, [1.0, 8.0]);
        // the mean light of a frame where all is virtual, and how it differs from that of the next
        let [(mean, noise), (early_mean, early_noise)] = renderers.each_mut().map(|renderer| {
            let frame =
                |renderer: &Renderer| (aov(renderer, "irradiance_diffuse_virtual"), aov(renderer, "mask_virtual"));
            let (light, mask) = frame(renderer);
            renderer.render(&scene, 0.0).expect("renders");
            let (next, _) = frame(renderer);
            let pixels: Vec<usize> = (0..light.len()).filter(|i| mask[*i][0] > 0.0).collect();
            let mean = |of: &dyn Fn(usize) -> f32| pixels.iter().map(|i| of(*i)).sum::<f32>() / pixels.len() as f32;
            (mean(&|i| light[i][1]), mean(&|i| (light[i][1] - next[i][1]).powi(2)))
        });
        assert!((early_mean / mean - 1.0).abs() < 0.05, "{early_mean} with eight paths, {mean} with one");
        assert!(early_noise < 0.25 * noise, "{early_noise} with eight paths, {noise} with one");
        let [_, mut eight] = renderers;
        (0..3).for_each(|_| drop(eight.render(&scene, 0.0).expect("renders")));
        let later = aov(&eight, "mask_virtual");
        assert!(later.iter().all(|m| m[0] <= 1.0), "after four frames of eight paths there is at most one");
    });
}

/// The picture of a method's filters must be its own model's, whichever order they come in.
#[test]
fn both_orders_of_the_filters_keep_the_mean() {
    validated(|gpu| {
        let scene = board_scene();
        let mean = |renderer: &Renderer| {
            let ratios: Vec<f32> = ratios(renderer).into_iter().flatten().collect();
            ratios.iter().sum::<f32>() / ratios.len() as f32
        };
        let truth = mean(&rendered(gpu, &scene, converged(Method::Iprt, &[("relight_levels", "0")]), 128));
        let orders = ["temporal_first", "spatial_first"].map(|order| {
            let set = [("filter_order", order), ("relight_levels", "0")];
            let renderer = rendered(gpu, &scene, options(Method::Iprt, &set), 24);
            (mean(&renderer), aov(&renderer, "irradiance_mixed"))
        });
        // measured +0.003 and +0.014: guided by the noise of a single frame, weights favour what most rays found
        for ((mean, _), limit) in orders.iter().zip([0.01, 0.02]) {
            assert!((mean - truth).abs() < limit, "{mean} instead of {truth}");
        }
        assert!(orders[0].1 != orders[1].1, "and they are not the same");
    });
}

/// Mean luminance of a lamp on the floor beside a white ball, against what it was.
fn lamp_ratio(gpu: &Gpu, relighting: &str) -> f32 {
    let lamp = vec3(0.0, -1.5, -1.2).normalize();
    let panorama = room([128, 64], vec3(16.0, 9.5, 16.0), vec3(0.0, 3.25, 0.0), |d| {
        Vec3::splat(if d.dot(lamp) > 0.99 { 60.0 } else { 0.5 })
    });
    let track = camera(Vec3::ZERO, vec3(0.0, -1.5, -1.2), 40.0);
    let scene = scene(panorama, track, vec![ball(0.3, lambert(0.0), vec3(0.5, -1.2, -1.2))]);
    let set = [("relighting", relighting), ("relight_levels", "0")];
    let renderer = rendered(gpu, &scene, converged(Method::Iprt, &set), 64);
    let [camera, picture, coverage] = ["camera_radiance", "radiance", "real_coverage"].map(|name| aov(&renderer, name));
    let lamp = (0..camera.len()).filter(|i| camera[*i][1] > 50.0 && coverage[*i][0] == 1.0);
    let (before, after) = lamp.fold((0.0, 0.0), |(b, a), i| (b + camera[i][1], a + picture[i][1]));
    after / before
}

#[test]
fn the_papers_equation_relights_lamps_and_ours_does_not() {
    validated(|gpu| {
        let (kept, ratio) = (lamp_ratio(gpu, "emission_kept"), lamp_ratio(gpu, "ratio"));
        assert!((kept - 1.0).abs() < 0.01, "emission is kept: {kept}");
        assert!(ratio < 0.97, "the ratio darkens a lamp: {ratio}");
    });
}

#[test]
fn every_method_renders_what_its_settings_say() {
    validated(|gpu| {
        let scene = board_scene();
        let pictures = Method::ALL.map(|method| {
            let renderer = rendered(gpu, &scene, options(method, &[]), 3);
            aov(&renderer, "radiance")
        });
        for (i, picture) in pictures.iter().enumerate() {
            assert!(pictures[..i].iter().all(|other| other != picture), "method {i} is one of its own");
        }
        // a method is its settings: iprt with paper's gives paper's picture
        let paper = Settings::of(Method::Paper).values();
        let set: Vec<_> = paper.iter().map(|(name, value)| (*name, value.as_str())).collect();
        let same = rendered(gpu, &scene, options(Method::Iprt, &set), 3);
        assert!(aov(&same, "radiance") == pictures[1]);
    });
}

#[test]
fn a_march_sees_about_what_the_surface_shows() {
    validated(|gpu| {
        let scene = board_scene();
        let of = |set: &[(&str, &str)]| {
            let mut all = vec![("relight_levels", "0"), ("coverage_samples", "1")];
            all.extend(set);
            ratios(&rendered(gpu, &scene, converged(Method::Iprt, &all), 64))
        };
        let (surface, march) = (of(&[]), of(&[("real_tracer", "march")]));
        let few = of(&[("real_tracer", "march"), ("march_steps", "2")]);
        let rms = |other: &[Option<f32>]| {
            let squares: Vec<_> = surface.iter().zip(other).filter_map(|(a, b)| Some((*a)? - (*b)?)).collect();
            (squares.iter().map(|d| d * d).sum::<f32>() / squares.len() as f32).sqrt()
        };
        assert!(rms(&march) < 0.03, "{}", rms(&march));
        assert!(march != surface && few != march, "the tracer and its steps count");
    });
}
