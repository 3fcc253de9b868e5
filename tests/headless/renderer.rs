//! The frame: what must not change does not, bits repeat, rays are saved, hazards are found, surfaces hide each other and move.

use crate::common::*;
use glam::{Vec3, vec2, vec3};
use iprt::{
    Error,
    gpu::FrameOptions,
    options::RenderOptions,
    panorama::{
        mapping::{bilinear, direction},
        source::{PanoramaFrame, PanoramaSource},
    },
    renderer::{Renderer, Wishes},
    scene::{
        Scene,
        animation::Track,
        camera::{Aim, CameraTrack},
        file::RenderSettings,
        material::Material,
        shapes::Shape,
        viewpoint::Projection,
    },
    settings::Method,
};

/// A room of a metre and a half around the capture point.
fn small_room() -> PanoramaFrame {
    room([128, 64], vec3(4.0, 3.0, 5.0), Vec3::ZERO, colourful)
}

#[test]
fn without_objects_the_picture_is_the_panorama() {
    validated(|gpu| {
        let size = [96, 72]; // pixels finer than texels: plain bilinear
        let panorama = small_room();
        let targets = [Vec3::NEG_Z, Vec3::Y, Vec3::NEG_Y, Vec3::Z, vec3(0.3, 0.9, 1.0)];
        let keys = targets.iter().enumerate().map(|(second, target)| (second as f64, *target)).collect();
        let track = CameraTrack {
            aim: Aim::LookAt(Track::from_keys(keys, Vec3::NEG_Z)),
            ..camera(Vec3::ZERO, Vec3::NEG_Z, 50.0)
        };
        let turning = scene(small_room(), track.clone(), vec![]);
        let fine = RenderOptions { size, ..options(Method::Iprt, &[]) };
        let mut renderer = Renderer::new(gpu, &turning, fine).expect("fits");
        for (second, target) in targets.iter().enumerate() {
            renderer.render(&turning, second as f64).expect("renders");
            for (i, texel) in aov(&renderer, "radiance").iter().enumerate() {
                let pixel = vec2((i as u32 % size[0]) as f32 + 0.5, (i as u32 / size[0]) as f32 + 0.5);
                let expected = bilinear(&panorama, pixel_direction(&track, second as f64, size, pixel));
                let error = (Vec3::from_slice(texel) / expected - 1.0).abs().max_element();
                assert!(error < 1e-4, "towards {target}, pixel {pixel}: {error}");
            }
        }
        let size = [160, 80];
        let scene = scene(small_room(), camera(Vec3::ZERO, Vec3::NEG_Z, 60.0), vec![]);
        let equirect = RenderOptions { size, projection: Projection::Equirect, ..options(Method::Iprt, &[]) };
        let renderer = rendered(gpu, &scene, equirect, 1);
        for (i, texel) in aov(&renderer, "radiance").iter().enumerate() {
            let uv = (vec2((i as u32 % size[0]) as f32, (i as u32 / size[0]) as f32) + 0.5)
                / vec2(size[0] as f32, size[1] as f32);
            let expected = bilinear(&panorama, direction(uv.as_dvec2()).as_vec3());
            let error = (Vec3::from_slice(texel) / expected - 1.0).abs().max_element();
            assert!(error < 1e-4, "equirect at {uv}: {error}");
        }
    });
}

#[test]
fn pixels_that_no_object_changes_keep_their_bits() {
    validated(|gpu| {
        let track = camera(Vec3::ZERO, Vec3::NEG_Z, 60.0);
        let things = || vec![ball(0.3, lambert(0.5), vec3(0.2, -0.4, -1.5))];
        let renderer = |objects, set: &[(&str, &str)], without_objects| {
            let scene = scene(small_room(), track.clone(), objects);
            rendered(gpu, &scene, RenderOptions { without_objects, ..options(Method::Iprt, set) }, 3)
        };
        let picture = |objects, set: &[(&str, &str)], without| aov(&renderer(objects, set, without), "radiance");
        let empty = picture(vec![], &[], false);
        assert!(picture(things(), &[], true) == empty, "--without-objects is the scene without them");
        let all = [("objects", "on"), ("virtual_surfaces", "on"), ("specular", "on")];
        assert!(picture(vec![], &all, false) == empty, "and so it is by all passes, which have nothing to do");
        // without the filter, so that ΔE = 0 stays where no ray has met the ball
        let with = renderer(things(), &[("atrous_levels", "0"), ("relight_levels", "0")], false);
        let images = ["radiance", "irradiance_real", "irradiance_mixed", "real_coverage"];
        let [with, real, mixed, coverage] = images.map(|name| aov(&with, name));
        let mut untouched = 0;
        for i in 0..with.len() {
            if coverage[i][0] == 1.0 && real[i] == mixed[i] {
                untouched += 1;
                assert_eq!(with[i], empty[i], "pixel {i}");
            }
        }
        assert!(untouched > 500 && with != empty, "{untouched} pixels");
    });
}

#[test]
fn what_nothing_touches_is_kept() {
    validated(|gpu| {
        let from = vec3(-0.7, -0.2, -1.2);
        let mover = moving(ball(0.2, lambert(0.5), from), from, vec3(0.7, -0.2, -1.2));
        let rest = [
            ball(0.3, lambert(0.3), vec3(0.1, -0.3, -1.8)),
            ball(0.25, metal(0.0), vec3(-0.8, -0.3, -1.6)),
            ball(0.2, metal(0.6), vec3(0.9, -0.5, -0.6)),
        ];
        let shape = growing(vec3(0.0, 0.6, 1.5));
        let objects = [vec![mover, shape], rest.to_vec()].concat();
        let scene = scene(small_room(), camera(Vec3::ZERO, vec3(0.0, -0.2, -1.0), 80.0), objects);
        let names = ["position_virtual", "normal_virtual", "albedo_virtual", "motion_virtual", "real_coverage", "hit"];
        for projection in [Projection::Perspective, Projection::Equirect] {
            let options = RenderOptions { size: [160, 80], projection, ..options(Method::Iprt, &[]) };
            let mut running = Renderer::new(gpu, &scene, options.clone()).expect("fits");
            // it goes, stands, and goes again
            let times = [0.0, 0.0, 0.0, 0.2, 0.4, 0.4, 0.4, 0.6, 0.9];
            for (frame, time) in times.into_iter().enumerate() {
                running.render(&scene, time).expect("renders");
                if frame == 0 {
                    continue;
                }
                let mut fresh = Renderer::new(gpu, &scene, options.clone()).expect("fits");
                fresh.render(&scene, times[frame - 1]).expect("renders");
                fresh.render(&scene, time).expect("renders");
                for name in names {
                    assert!(aov(&running, name) == aov(&fresh, name), "{name} of frame {frame}, {projection:?}");
                }
                let [seen, mask] = ["position_virtual", "mask_virtual"].map(|name| aov(&running, name));
                let visited = |(seen, mask): (&[f32; 4], &[f32; 4])| (*seen == [0.0; 4]) == (mask[0] == 0.0);
                assert!(seen.iter().zip(&mask).all(visited), "frame {frame}, {projection:?}: surfaces are visited");
            }
            // something moves while a picture of another size is shown
            running.set_size([80, 40]).expect("fits");
            for time in [0.7, 0.7] {
                running.render(&scene, time).expect("renders");
            }
            running.set_size([160, 80]).expect("fits");
            let mut fresh = Renderer::new(gpu, &scene, options.clone()).expect("fits");
            for renderer in [&mut running, &mut fresh] {
                for time in [0.7, 0.7] {
                    renderer.render(&scene, time).expect("renders");
                }
            }
            for name in names {
                assert!(aov(&running, name) == aov(&fresh, name), "{name} of another size's time, {projection:?}");
            }
        }
    });
}

#[test]
fn same_seed_same_bits() {
    validated(|gpu| {
        let from = vec3(-0.5, -0.6, -1.6);
        let thing = moving(ball(0.4, metal(0.2), from), from, -from.with_y(0.6).with_z(1.6));
        let scene = scene(small_room(), camera(Vec3::ZERO, vec3(0.0, -0.4, -1.0), 70.0), vec![thing]);
        let run = |seed| {
            let mut renderer =
                Renderer::new(gpu, &scene, RenderOptions { seed, ..options(Method::Iprt, &[]) }).expect("fits");
            let frame = |n: u32| {
                renderer.render(&scene, f64::from(n) / 30.0).expect("renders");
                renderer.picture().expect("reads")
            };
            (0..4).map(frame).collect::<Vec<_>>()
        };
        let first = run(7);
        assert!(first == run(7), "the same seed gives the same bits in every frame");
        let other = run(8);
        assert!(first.iter().zip(&other).all(|(a, b)| a != b), "another seed gives others");
    });
}

#[test]
fn the_mask_saves_rays() {
    validated(|gpu| {
        let scene = scene(
            small_room(),
            camera(Vec3::ZERO, Vec3::NEG_Z, 60.0),
            vec![ball(0.3, lambert(0.5), vec3(0.1, -0.2, -1.4))],
        );
        let pixels = (SIZE[0] * SIZE[1]) as f64;
        // one filter-free frame: what was not traced is seen as it is
        let base = [("short_history", "0"), ("atrous_levels", "0"), ("temporal", "false")];
        for rate in ["1", "0.25", "0.0625"] {
            let mut set = base.to_vec();
            set.extend([("sampling_mask", "true"), ("rays_per_pixel", rate)]);
            let rate: f64 = rate.parse().expect("a number");
            for interpolate in if rate < 0.1 { &["true", "false"][..] } else { &["true"] } {
                set.push(("interpolate", interpolate));
                let mut renderer = rendered(gpu, &scene, options(Method::Iprt, &set), 1);
                let mut seen = vec![0; pixels as usize];
                for frame in 0..(1.0 / rate) as u32 {
                    if frame > 0 {
                        renderer.render(&scene, 0.0).expect("renders");
                    }
                    aov(&renderer, "radiance");
                    let coverage = aov(&renderer, "real_coverage");
                    let mask = aov(&renderer, "mask_real");
                    let present = coverage.iter().filter(|c| c[0] > 0.0).count() as f64;
                    let traced = mask.iter().filter(|m| m[0] == 1.0).count() as f64;
                    assert!((traced / present - rate).abs() < 0.1 * rate, "{traced} of {present} at {rate}");
                    assert_eq!(mask.iter().filter(|m| m[0] != 0.0).count() as f64, present);
                    mask.iter().zip(&mut seen).for_each(|(m, s)| *s += u32::from(m[0] == 1.0));
                }
                let coverage = aov(&renderer, "real_coverage");
                assert!(
                    seen.iter().zip(&coverage).all(|(s, c)| *s == u32::from(c[0] > 0.0)),
                    "each pixel once in 1/{rate} frames"
                );
                // every pixel that the mask names was traced: a ray that found light left its E_R
                let (mask, real) = (aov(&renderer, "mask_real"), aov(&renderer, "irradiance_without_objects_real"));
                let traced = mask.iter().zip(&real).filter(|(m, _)| m[0] == 1.0);
                let (lit, all) = traced.fold((0.0, 0.0), |(l, n), (_, e)| (l + f64::from(e[0] > 0.0), n + 1.0));
                assert!(lit > 0.95 * all, "{lit} of {all}");
            }
        }
        let renderer = rendered(
            gpu,
            &scene,
            options(Method::Iprt, &[("sampling_mask", "false"), ("rays_per_pixel", "0.0625")]),
            2,
        );
        let (mask, coverage) = (aov(&renderer, "mask_real"), aov(&renderer, "real_coverage"));
        assert!(
            mask.iter().zip(&coverage).all(|(m, c)| (m[0] == 1.0) == (c[0] > 0.0)),
            "without the mask every pixel is traced"
        );
    });
}

#[test]
fn every_barrier_is_needed() {
    validated(|gpu| {
        // Each call is given the second video frame, and fails, so that it is prepared in each: every pass runs. The picture is
        // coarser than the panorama.
        let video = PanoramaSource::from_frames(vec![small_room(); 2], 30.0, Vec3::ZERO, 0.0).expect("a good panorama");
        let track = camera(Vec3::ZERO, Vec3::NEG_Z, 60.0);
        let things = vec![ball(0.3, lambert(0.5), vec3(0.1, -0.2, -1.4))];
        let scene = Scene::assemble("test", video, track, things, RenderSettings::default()).expect("a good scene");
        let set = [("relight_levels", "2"), ("relight_width", "32"), ("interpolate", "true")];
        let coarse = RenderOptions { size: [12, 8], ..options(Method::Iprt, &set) };
        let mut renderer = rendered(gpu, &scene, coarse.clone(), 1);
        let barriers = Renderer::new(gpu, &scene, coarse).expect("fits").render(&scene, 0.0).expect("renders").barriers;
        assert!(barriers > 30, "{barriers}");
        let mut superfluous = vec![];
        for n in 0..barriers {
            let submission = FrameOptions { skip_barrier: Some(n), ..Default::default() };
            match renderer.begin(&scene, 1.0 / 30.0, &Wishes { submission, ..Default::default() }) {
                Err(Error::Internal(text)) => assert!(text.contains("no barrier between"), "{text}"),
                Err(other) => panic!("barrier {n}: {other}"),
                Ok(_) => superfluous.push(n),
            }
        }
        assert!(superfluous.is_empty(), "of {barriers} barriers these can be left out: {superfluous:?}");
        let timings = renderer.render(&scene, 1.0 / 30.0).expect("renders");
        assert_eq!(timings.barriers, barriers);
        for pass in iprt::passes::PASSES {
            let planned = (pass.dispatches)(renderer.plan()) > 0;
            assert_eq!(timings.pass(pass.name).is_some(), planned, "{}", pass.name);
            // These have barriers of their own tests.
            assert!(
                planned || ["deform", "acceleration", "ingest"].contains(&pass.name),
                "{} was among them",
                pass.name
            );
        }
    });
}

/// The tracker that chooses barriers also judges them, so another opinion is asked.
#[test]
fn canary_the_layer_sees_a_barrier_that_is_missing_from_a_frame() {
    let gpu = open();
    let track = camera(Vec3::ZERO, Vec3::NEG_Z, 60.0);
    let scene = scene(small_room(), track, vec![ball(0.3, lambert(0.5), vec3(0.1, -0.2, -1.4))]);
    let mut renderer = Renderer::new(&gpu, &scene, options(Method::Iprt, &[])).expect("fits");
    for _ in 0..2 {
        renderer.render(&scene, 0.0).expect("renders"); // these prepare what later frames keep, by barriers of their own
    }
    let barriers = renderer.render(&scene, 0.0).expect("renders").barriers;
    assert!(gpu.validation_messages().is_empty());
    let last = Some(barriers - 2); // composite reads what atrous wrote; the last one parts its layers
    let submission = FrameOptions { skip_barrier: last, ignore_hazards: true, ..Default::default() };
    let begun = renderer.begin(&scene, 0.0, &Wishes { submission, ..Default::default() }).expect("is submitted");
    renderer.collect(begun).expect("runs");
    drop(renderer);
    let messages = gpu.destroy().expect("nothing holds the device");
    assert!(messages.iter().any(|m| m.contains("SYNC-HAZARD-READ-AFTER-WRITE")), "{messages:?}");
}

#[test]
fn what_is_nearer_hides_what_is_farther() {
    validated(|gpu| {
        // the wall is 2.5 m ahead: one ball stands before it, one behind it, and one half in it
        let track = camera(Vec3::ZERO, Vec3::NEG_Z, 60.0);
        let place = |x: f32, distance: f32| ball(0.3, lambert(0.5), vec3(x * distance, 0.0, -distance));
        let scene = scene(small_room(), track.clone(), vec![place(-0.4, 1.8), place(0.0, 2.5), place(0.4, 3.2)]);
        let renderer = rendered(gpu, &scene, options(Method::Iprt, &[]), 1);
        let (coverage, id) = (aov(&renderer, "real_coverage"), aov(&renderer, "object_id"));
        let at = |x: f32| {
            let pixel = project(&track, 0.0, SIZE, vec3(x, 0.0, -1.0));
            pixel.y as usize * SIZE[0] as usize + pixel.x as usize
        };
        assert_eq!([-0.4, 0.0, 0.4].map(|x| (coverage[at(x)][0], id[at(x)][0])), [(0.0, 1.0), (0.0, 2.0), (1.0, 0.0)]);
        assert!(id.iter().all(|id| id[0] != 3.0), "nothing of the ball behind the wall is seen");
    });
}

/// The share of the picture that a ball ahead covers: an ellipse about the centre here, a circle's projection.
#[test]
fn a_silhouette_covers_its_area() {
    validated(|gpu| {
        let (radius, distance) = (0.31, 1.4);
        let scene = scene(
            small_room(),
            camera(Vec3::ZERO, Vec3::NEG_Z, 60.0),
            vec![fine_ball(radius, lambert(0.5), vec3(0.0, 0.0, -distance))],
        );
        for projection in [Projection::Perspective, Projection::Equirect] {
            let renderer = rendered(gpu, &scene, RenderOptions { projection, ..options(Method::Iprt, &[]) }, 1);
            let coverage = aov(&renderer, "real_coverage");
            let fractional = coverage.iter().filter(|c| c[0] > 0.0 && c[0] < 1.0).count();
            assert!(fractional > 10, "{fractional} pixels at the silhouette");
            let sine = radius / distance;
            let expected = match projection {
                // a disc of radius tan α on the image plane
                Projection::Perspective => {
                    let pixels_per_unit = SIZE[1] as f32 / (2.0 * 30f32.to_radians().tan());
                    std::f32::consts::PI * sine * sine / (1.0 - sine * sine) * pixels_per_unit * pixels_per_unit
                }
                // solid angle 2π(1 − cos α), where each pixel counts with its own
                Projection::Equirect => 2.0 * std::f32::consts::PI * (1.0 - (1.0 - sine * sine).sqrt()),
            };
            let weight = |i: usize| match projection {
                Projection::Perspective => 1.0,
                Projection::Equirect => {
                    let (dphi, dtheta) =
                        (std::f32::consts::TAU / SIZE[0] as f32, std::f32::consts::PI / SIZE[1] as f32);
                    dphi * dtheta * (((i as u32 / SIZE[0]) as f32 + 0.5) * dtheta).sin()
                }
            };
            let covered: f32 = coverage.iter().enumerate().map(|(i, c)| weight(i) * (1.0 - c[0])).sum();
            assert!((covered / expected - 1.0).abs() < 0.01, "{projection:?}: {covered} instead of {expected}");
        }
    });
}

#[test]
fn motion_vectors_point_to_where_things_were() {
    validated(|gpu| {
        let track = CameraTrack {
            position: Track::from_keys(vec![(0.0, vec3(-0.1, 0.0, 0.05)), (1.0, vec3(0.1, 0.05, -0.1))], Vec3::ZERO),
            aim: Aim::LookAt(Track::from_keys(
                vec![(0.0, vec3(-0.2, -0.3, -2.0)), (1.0, vec3(0.4, 0.1, -2.0))],
                Vec3::ZERO,
            )),
            ..camera(Vec3::ZERO, Vec3::ZERO, 60.0)
        };
        let (from, to) = (vec3(-0.3, -0.1, -1.2), vec3(0.1, 0.2, -1.5));
        let scene = scene(small_room(), track.clone(), vec![moving(ball(0.3, lambert(0.5), from), from, to)]);
        let mut renderer = Renderer::new(gpu, &scene, options(Method::Iprt, &[])).expect("fits");
        let (before, now) = (0.4, 0.6);
        renderer.render(&scene, before).expect("renders");
        renderer.render(&scene, now).expect("renders");
        let images = ["motion_real", "motion_virtual", "position_real", "position_virtual", "real_coverage"];
        let [real, virtual_, real_at, virtual_at, coverage] = images.map(|name| aov(&renderer, name));
        let moved = from.lerp(to, before as f32) - from.lerp(to, now as f32);
        let mut found = [0; 2];
        for i in 0..real.len() {
            let pixel = vec2((i as u32 % SIZE[0]) as f32 + 0.5, (i as u32 / SIZE[0]) as f32 + 0.5);
            for (k, (motion, at, moved)) in
                [(real[i], real_at[i], Vec3::ZERO), (virtual_[i], virtual_at[i], moved)].into_iter().enumerate()
            {
                // a silhouette's virtual surface is seen beside the pixel's centre
                if at[3] <= 0.0 || (coverage[i][0] != 1.0 && coverage[i][0] != 0.0) {
                    continue;
                }
                let point = Vec3::from_slice(&at);
                let here = project(&track, now, SIZE, point);
                assert!(here.distance(pixel) < 0.01, "the pixel sees the surface: {here} {pixel}");
                let expected = project(&track, before, SIZE, point + moved) - pixel;
                let error = vec2(motion[0], motion[1]).distance(expected);
                // That of virtual surfaces is kept in halves.
                let exact = [1e-4, 1e-3][k];
                assert!(
                    error < (exact * expected.length()).max(0.01),
                    "surface {k} at {pixel}: {motion:?} instead of {expected}"
                );
                let distance = (point + moved).distance(track.at(before).position);
                assert!(
                    (motion[2] / distance - 1.0).abs() < exact,
                    "previous distance {} instead of {distance}",
                    motion[2]
                );
                found[k] += 1;
            }
        }
        assert!(found[0] > 2000 && found[1] > 100, "{found:?}");
    });
}

#[test]
fn a_slow_pass_shows_in_its_own_entry_alone() {
    validated(|gpu| {
        let scene = scene(
            small_room(),
            camera(Vec3::ZERO, Vec3::NEG_Z, 60.0),
            vec![ball(0.3, lambert(0.5), vec3(0.0, 0.0, -1.5))],
        );
        let mut renderer = Renderer::new(gpu, &scene, options(Method::Iprt, &[])).expect("fits");
        let mut composite_share = |repeat| {
            let wishes = Wishes { submission: FrameOptions { repeat, ..Default::default() }, ..Default::default() };
            let report = iprt::measure::bench::run(&mut renderer, &scene, 0, 5, 2, &wishes, || {}).expect("renders");
            let of = |name: &str| report.passes.iter().find(|p| p.name == name).expect("is a pass").median_ms;
            (of("composite"), of("atrous"))
        };
        // a share of the frame, not a time: the composite runs 400 times more, the filter does not
        let (composite, atrous) = composite_share(None);
        let (slow, unchanged) = composite_share(Some(("composite", 400)));
        assert!(slow / unchanged > 5.0 * composite / atrous, "{slow} of {unchanged}, before {composite} of {atrous}");
    });
}

/// A mirror ball that shows stripes, and a bright object beside a dark one that shines: each pixel against the mean of
/// the sixteen pixels of a picture four times as fine. All of it has moved, and stands still since.
#[test]
fn a_pixel_is_the_mean_of_what_lies_in_it() {
    validated(|gpu| {
        let moved = |object, at: Vec3| moving(object, at + vec3(0.0, 0.1, 0.0), at);
        let stripes = |d: Vec3| Vec3::splat(if (24.0 * d.x).sin() * (26.0 * d.y).sin() > 0.0 { 1.2 } else { 0.05 });
        let bar = |albedo: f32, shines: f32, x: f32| {
            let material = Material { emissive: Vec3::splat(shines), ..lambert(albedo) };
            let at = vec3(x, 0.02 * x, -1.2 - 0.01 * x);
            moved(object(Shape::Box.mesh(vec3(0.06, 0.5, 0.06)), material, at), at)
        };
        let bars =
            (0..6).map(|k| if k % 2 == 0 { bar(0.9, 0.0, 0.061 * k as f32) } else { bar(0.02, 1.0, 0.061 * k as f32) });
        let at = vec3(-0.35, 0.0, -1.2);
        let things = std::iter::once(moved(ball(0.25, metal(0.0), at), at)).chain(bars).collect();
        let room = room([256, 128], vec3(4.0, 3.0, 5.0), Vec3::ZERO, stripes);
        let scene = scene(room, camera(Vec3::ZERO, Vec3::NEG_Z, 40.0), things);
        let size = [32, 24];
        let picture = |fine: u32, frames: usize| {
            let options =
                RenderOptions { size: size.map(|s| s * fine), ..options(Method::Reference, &[("bounces", "1")]) };
            let mut renderer = Renderer::new(gpu, &scene, options).expect("fits");
            for time in [0.5, 0.9].into_iter().chain(std::iter::repeat_n(1.0, frames)) {
                renderer.render(&scene, time).expect("renders");
            }
            (aov(&renderer, "radiance"), aov(&renderer, "real_coverage"))
        };
        let ((coarse, real), (fine, _)) = (picture(1, 384), picture(4, 48));
        let (mut error, mut sum) = (0.0, 0.0);
        for (i, pixel) in coarse.iter().enumerate().filter(|(i, _)| real[*i][0] == 0.0) {
            let (x, y) = (i as u32 % size[0] * 4, i as u32 / size[0] * 4);
            let within = (0..16).map(|k| fine[((y + k / 4) * size[0] * 4 + x + k % 4) as usize][1]);
            let mean = within.sum::<f32>() / 16.0;
            error += (pixel[1] - mean).abs();
            sum += mean;
        }
        println!("mean error {:.4}", error / sum);
        assert!(error < 0.05 * sum, "{}", error / sum); // 0.32 if paths start at the centre alone
    });
}
