//! Scene truth against closed forms, against itself by other ways of sampling, and what interruption and many samples do to it.

use crate::common::{fine_ball, lambert, mean, object, sampled, validated};
use glam::{Quat, Vec3, vec3};
use iprt::{
    gpu::Gpu,
    reference::{
        path_trace::{BATCH, LightSampling, PathSettings, PathTracer, Sums},
        truth::{self, End, Goal},
    },
    scene::{
        CompleteScene, Object,
        camera::CameraTrack,
        material::Material,
        model::Model,
        punctual::{PunctualKind, PunctualLight},
        shapes::Shape,
        viewpoint::Viewpoint,
    },
};
use std::{
    f32::consts::{FRAC_PI_2, PI},
    sync::{Arc, atomic::AtomicBool},
};

fn scene(room: Model, objects: Vec<Object>) -> CompleteScene {
    CompleteScene::assemble("test", Arc::new(room), CameraTrack::at_point(Vec3::ZERO), objects).expect("a good scene")
}

fn shining(albedo: f32, radiance: f32) -> Material {
    Material { emissive: Vec3::splat(radiance), ..lambert(albedo) }
}

fn tracer(gpu: &Gpu, scene: &CompleteScene, viewpoint: &Viewpoint, settings: &PathSettings) -> PathTracer {
    let state = scene.at(0.0).instances;
    PathTracer::new(gpu, &scene.packed, &state, Vec3::ZERO, viewpoint, settings).expect("fits")
}

fn trace(gpu: &Gpu, scene: &CompleteScene, viewpoint: &Viewpoint, settings: &PathSettings, samples: u32) -> Sums {
    sampled(tracer(gpu, scene, viewpoint, settings), samples)
}

/// One point of the floor y = 0 below the origin, seen from half a metre above.
fn at_the_floor() -> Viewpoint {
    Viewpoint::perspective(vec3(0.0, 0.5, 0.0), Quat::from_rotation_x(-FRAC_PI_2), 0.5, [8, 8])
}

fn floor() -> Model {
    Model::from_mesh(Shape::Plane.mesh(vec3(30.0, 1.0, 30.0)), lambert(0.8))
}

#[test]
fn a_closed_box_that_shines_and_reflects() {
    validated(|gpu| {
        let settings = PathSettings::unbiased([16, 8], 1);
        for albedo in [0.0, 0.3, 0.8] {
            let walls = Model::from_mesh(Shape::Box.mesh(vec3(3.0, 2.0, 4.0)), shining(albedo, 0.7));
            let view = Viewpoint::equirect(vec3(0.3, -0.2, 0.5), Quat::IDENTITY);
            let found = mean(&trace(gpu, &scene(walls, Vec::new()), &view, &settings, 128));
            let expected = 0.7 / (1.0 - albedo);
            assert!((found / expected - 1.0).abs() < 0.01, "albedo {albedo}: {found} instead of {expected}");
        }
    });
}

#[test]
fn a_spherical_lamp_over_a_floor() {
    validated(|gpu| {
        // A sphere of radius r whose middle is at distance d and angle θ from the normal: E = π L (r/d)² cos θ.
        for at in [vec3(0.0, 2.0, 0.0), vec3(1.5, 1.2, -0.4)] {
            let complete = scene(floor(), vec![fine_ball(0.25, shining(0.0, 9.0), at)]);
            let settings = PathSettings { bounces: 1, ..PathSettings::unbiased([8, 8], 2) };
            let irradiance = PI * 9.0 * (0.25 / at.length()).powi(2) * at.y / at.length();
            let found = mean(&trace(gpu, &complete, &at_the_floor(), &settings, 1024));
            let expected = 0.8 / PI * irradiance;
            assert!((found / expected - 1.0).abs() < 0.01, "{at}: {found} instead of {expected}");
        }
    });
}

#[test]
fn lamps_without_a_surface() {
    validated(|gpu| {
        let intensity = vec3(1.0, 2.0, 3.0);
        let lamp = |kind, range| PunctualLight { node: 1, intensity, kind, range };
        let spot = PunctualKind::Spot { inner: 0.3, outer: 0.6 };
        let at = vec3(1.2, 1.6, 0.0); // 2 m away; down is 0.6435 off the way to the origin
        let angle = (at.y / at.length()).acos();
        let ramp = ((angle - 0.2).cos() - 0.6f32.cos()) / (0.3f32.cos() - 0.6f32.cos());
        for (light, turned, expected) in [
            (lamp(PunctualKind::Point, f32::INFINITY), 0.0, 0.8 / 4.0),
            (lamp(PunctualKind::Point, 4.0), 0.0, 0.8 / 4.0 * (1.0 - 1.0 / 16.0)),
            (lamp(PunctualKind::Directional, f32::INFINITY), angle, 0.8),
            (lamp(spot, f32::INFINITY), angle, 0.8 / 4.0),
            (lamp(spot, f32::INFINITY), 0.0, 0.0),
            (lamp(spot, f32::INFINITY), 0.2, 0.8 / 4.0 * ramp * ramp),
        ] {
            let mut room = floor();
            let (sin, cos) = (-f32::sin(turned), -f32::cos(turned)); // −Z of the node turned so far from straight down
            let rotation = Quat::from_rotation_arc(Vec3::NEG_Z, vec3(sin, cos, 0.0));
            let place = glam::Affine3A::from_rotation_translation(rotation, at);
            room.rig.nodes.push(iprt::scene::model::Node {
                name: "lamp".into(),
                parent: None,
                local: iprt::scene::model::Local::Matrix(place),
                mesh: None,
                weights: vec![],
            });
            room.lights = vec![light.clone()];
            let settings = PathSettings { bounces: 1, ..PathSettings::unbiased([8, 8], 2) };
            let found = mean(&trace(gpu, &scene(room, Vec::new()), &at_the_floor(), &settings, 4));
            let expected = 0.8 / PI * intensity.y * expected; // cos θ is in `expected`
            assert!((found - expected).abs() < 0.002 * expected.max(0.1), "{light:?}: {found} instead of {expected}");
        }
    });
}

#[test]
fn light_sampling_lobe_sampling_and_both_agree() {
    validated(|gpu| {
        // a lamp large enough to be met by chance, a floor of two lobes, a ball that hides a part
        let glossy = Material { roughness: 0.4, ..Material::plain("varnish", vec3(0.6, 0.5, 0.3), 0.4) };
        let floor = Model::from_mesh(Shape::Plane.mesh(vec3(6.0, 1.0, 6.0)), glossy);
        let lamp = object(Shape::Plane.mesh(vec3(1.5, 1.0, 1.5)), shining(0.0, 4.0), vec3(0.0, 1.5, -1.0));
        let ball = fine_ball(0.3, lambert(0.7), vec3(0.4, 0.3, -0.8));
        let complete = scene(floor, vec![lamp, ball]);
        let view = Viewpoint::perspective(vec3(0.0, 1.0, 1.5), Quat::from_rotation_x(-0.5), 40.0, [16, 16]);
        let found = [LightSampling::Mis, LightSampling::Lights, LightSampling::Lobes].map(|sampling| {
            let settings = PathSettings { sampling, ..PathSettings::unbiased([16, 16], 5) };
            let sums = trace(gpu, &complete, &view, &settings, 256);
            (f64::from(mean(&sums)), sums.relative_noise() / 16.0)
        });
        for (other, noise) in &found[1..] {
            let (both, own) = found[0];
            let difference = (other / both - 1.0).abs();
            assert!(difference < 4.0 * noise.hypot(own) && *noise < 0.02, "{found:?}");
        }
        assert!(found[0].1 < found[2].1 && found[0].1 < 1.5 * found[1].1, "both together are good at both: {found:?}");
    });
}

/// Something with a bit of everything.
fn lit_box() -> (CompleteScene, Viewpoint) {
    let room = Model::from_mesh(Shape::Box.mesh(vec3(4.0, 3.0, 4.0)), lambert(0.6));
    let lamp = object(Shape::Plane.mesh(vec3(2.0, 1.0, 2.0)), shining(0.0, 2.0), vec3(0.0, 1.4, 0.0));
    let ball =
        fine_ball(0.5, Material { metallic: 1.0, ..Material::plain("gold", vec3(1.0, 0.8, 0.3), 0.3) }, Vec3::NEG_Z);
    (scene(room, vec![lamp, ball]), Viewpoint::perspective(Vec3::ZERO, Quat::IDENTITY, 60.0, [16, 12]))
}

#[test]
fn resumed_or_not_the_bits_are_the_same() {
    validated(|gpu| {
        let (complete, view) = lit_box();
        let settings = PathSettings::unbiased([16, 12], 7);
        let total = 2 * BATCH + 5;
        let whole = trace(gpu, &complete, &view, &settings, total);
        let folder = tempfile::tempdir().expect("a folder");
        let state = folder.path().join("a.exr.state");
        for stop in [1, BATCH - 1, BATCH, BATCH + 1, 2 * BATCH] {
            let mut first = tracer(gpu, &complete, &view, &settings);
            let goal = |samples| Goal { samples, noise: None };
            let never = AtomicBool::new(false);
            truth::converge(&mut first, goal(stop), None, &never, |_, _| {}).expect("runs");
            truth::save(&first, &state).expect("writes");
            drop(first);
            let mut second = tracer(gpu, &complete, &view, &settings);
            truth::resume(&mut second, &state).expect("its own state");
            assert_eq!(second.samples(), stop);
            truth::converge(&mut second, goal(total), None, &never, |_, _| {}).expect("runs");
            let sums = second.read().expect("reads");
            assert_eq!(
                (sums.reflected, sums.other, sums.albedo, sums.centre),
                (whole.reflected.clone(), whole.other.clone(), whole.albedo.clone(), whole.centre.clone()),
                "stopped at {stop}"
            );
        }
        // another seed, another view, another scene, a damaged state
        let refused = |scene: &CompleteScene, view: &Viewpoint, seed, word: &str| {
            let mut other = tracer(gpu, scene, view, &PathSettings::unbiased([16, 12], seed));
            let error = truth::resume(&mut other, &state).expect_err("not its own").to_string();
            assert!(error.contains(word) && error.contains("a.exr.state"), "{error}");
            assert_eq!(other.samples(), 0);
        };
        refused(&complete, &view, 8, "settings");
        refused(&complete, &Viewpoint::equirect(Vec3::ZERO, Quat::IDENTITY), 7, "settings");
        refused(&scene(floor(), Vec::new()), &view, 7, "settings");
        let mut bytes = std::fs::read(&state).expect("there");
        *bytes.last_mut().expect("some") ^= 1;
        std::fs::write(&state, bytes).expect("writes");
        refused(&complete, &view, 7, "damaged");
    });
}

#[test]
fn interruption_leaves_a_state_and_noise_ends_a_run() {
    validated(|gpu| {
        let (complete, view) = lit_box();
        let settings = PathSettings::unbiased([16, 12], 7);
        let folder = tempfile::tempdir().expect("a folder");
        let state = folder.path().join("b.exr.state");
        let mut stopped = tracer(gpu, &complete, &view, &settings);
        let stop = AtomicBool::new(false);
        let goal = Goal { samples: 50, noise: None };
        let end = truth::converge(&mut stopped, goal, Some(&state), &stop, |samples, _| {
            stop.store(samples == 3, std::sync::atomic::Ordering::Relaxed);
        });
        assert_eq!((end.expect("runs"), stopped.samples()), (End::Interrupted, 3));
        assert!(state.exists());

        let mut noisy = tracer(gpu, &complete, &view, &settings);
        stop.store(false, std::sync::atomic::Ordering::Relaxed);
        let goal = Goal { samples: 100_000, noise: Some(0.1) };
        let end = truth::converge(&mut noisy, goal, None, &stop, |_, _| {}).expect("runs");
        let sums = noisy.read().expect("reads");
        assert!(end == End::Reached && sums.relative_noise() <= 0.1 && sums.samples < 5000, "{} samples", sums.samples);
        // the noise that is told is the distance to a picture with far more samples, or more
        let truth = trace(gpu, &complete, &view, &PathSettings { seed: 99, ..settings }, 4 * sums.samples);
        let luminance = |c: &[f32; 4]| f64::from(0.2126 * c[0] + 0.7152 * c[1] + 0.0722 * c[2]);
        let pairs: Vec<_> =
            sums.radiance().iter().zip(&truth.radiance()).map(|(a, b)| (luminance(a), luminance(b))).collect();
        let mean = pairs.iter().map(|p| p.1).sum::<f64>() / pairs.len() as f64;
        let rms = (pairs.iter().map(|p| (p.0 - p.1).powi(2)).sum::<f64>() / pairs.len() as f64).sqrt() / mean;
        assert!(
            rms < 1.5 * sums.relative_noise() && rms > 0.2 * sums.relative_noise(),
            "{rms} {}",
            sums.relative_noise()
        );
    });
}

#[test]
fn many_samples_do_not_drift() {
    validated(|gpu| {
        // The same value 16,384 times: a single-precision sum is 1e-4 off by then.
        let value = 0.1f32;
        let walls = scene(Model::from_mesh(Shape::Box.mesh(Vec3::ONE), shining(0.0, value)), Vec::new());
        let settings = PathSettings { bounces: 0, ..PathSettings::unbiased([8, 8], 0) };
        let sums = trace(gpu, &walls, &Viewpoint::equirect(Vec3::ZERO, Quat::IDENTITY), &settings, 16_384);
        let naive = (0..16_384).fold(0.0f32, |sum, _| sum + value) / 16_384.0;
        assert!((naive / value - 1.0).abs() > 2e-6, "the test would see a drift: {naive}");
        for texel in sums.radiance() {
            assert!((texel[1] / value - 1.0).abs() < 1e-6, "{texel:?}");
        }
        assert!(sums.relative_noise() < 1e-5);
    });
}
