//! Scene truth where light arrives only after five bounces, or after any number of them, against values computed here.

use crate::common::{lambert, object, validated};
use glam::{Quat, Vec3, dvec2, vec3};
use iprt::{
    gpu::Gpu,
    reference::path_trace::{PathSettings, PathTracer},
    scene::{
        CompleteScene, Object,
        animation::{Placement, Transform},
        camera::CameraTrack,
        material::Material,
        model::Model,
        shapes::Shape,
        viewpoint::Viewpoint,
    },
};
use std::{f64::consts::PI, sync::Arc};

const ALL: u32 = u32::MAX;

/// Mean of the green channel over a small picture.
fn mean(gpu: &Gpu, objects: &[Object], viewpoint: &Viewpoint, bounces: u32, samples: u32) -> f64 {
    let camera = CameraTrack::at_point(Vec3::ZERO);
    let scene = CompleteScene::assemble("test", Arc::new(Model::default()), camera, objects.to_vec()).expect("good");
    let unbiased = PathSettings::unbiased([8, 8], 4);
    // no path is ended at random where their length is bounded
    let settings = if bounces == ALL { unbiased } else { PathSettings { bounces, roulette: bounces, ..unbiased } };
    let state = scene.at(0.0).instances;
    let mut tracer = PathTracer::new(gpu, &scene.packed, &state, Vec3::ZERO, viewpoint, &settings).expect("fits");
    for _ in 0..samples {
        tracer.sample().expect("runs");
    }
    let radiance = tracer.read().expect("reads").radiance();
    radiance.iter().map(|c| f64::from(c[1])).sum::<f64>() / radiance.len() as f64
}

/// A square of side 1 that faces `normal`.
fn square(material: Material, at: Vec3, normal: Vec3) -> Object {
    let rotation = Quat::from_rotation_arc(Vec3::Y, normal.normalize());
    let placement = Placement::fixed(Transform { translation: at, rotation, ..Transform::IDENTITY });
    Object { placement, ..object(Shape::Plane.mesh(Vec3::ONE), material, at) }
}

#[test]
fn light_round_four_corners() {
    validated(|gpu| {
        // From the camera over four mirrors, each turning the way by 90°, to a diffuse screen that a square lamp shines on:
        // five bounces and no other number. F = b + (1 − b)(1 − cos 45°)⁵ at each mirror.
        let corners =
            [Vec3::ZERO, vec3(0.0, 0.0, -2.0), vec3(2.0, 0.0, -2.0), vec3(2.0, 0.0, -4.0), vec3(2.0, 2.0, -4.0)];
        let screen = vec3(4.0, 2.0, -4.0);
        let bases = [0.9f32, 0.8, 0.7, 0.6];
        let mirror = |k: usize| {
            let next = corners.get(k + 2).copied().unwrap_or(screen);
            let normal = (next - corners[k + 1]).normalize() - (corners[k + 1] - corners[k]).normalize();
            let metal = Material { metallic: 1.0, ..Material::plain("mirror", Vec3::splat(bases[k]), 0.0) };
            square(metal, corners[k + 1], normal)
        };
        let mut objects: Vec<Object> = (0..4).map(mirror).collect();
        objects.push(square(lambert(0.8), screen, Vec3::NEG_X));
        let (radiance, to_lamp) = (5.0f32, vec3(-1.1, 1.3, 0.0));
        let lamp = Material { emissive: Vec3::splat(radiance), ..lambert(0.0) };
        objects.push(square(lamp, screen + to_lamp, -to_lamp));

        let grazing = (1.0 - 0.5f64.sqrt()).powi(5);
        let reflected: f64 = bases.iter().map(|b| f64::from(*b) + (1.0 - f64::from(*b)) * grazing).product();
        // E = L ∫ cos θ cos θ' / d² dA, by the midpoint rule
        let facing = to_lamp.as_dvec3().normalize();
        let (across, along) = (glam::DVec3::Z, facing.cross(glam::DVec3::Z));
        let irradiance: f64 = (0..100 * 100)
            .map(|i| {
                let (u, v) = (f64::from(i % 100) / 100.0 - 0.495, f64::from(i / 100) / 100.0 - 0.495);
                let to = to_lamp.as_dvec3() + u * across + v * along;
                f64::from(radiance) * -to.x * to.dot(facing) / to.length_squared().powi(2) / 1e4
            })
            .sum();
        let expected = reflected * 0.8 / PI * irradiance;
        let view = Viewpoint::perspective(Vec3::ZERO, Quat::IDENTITY, 0.3, [8, 8]);
        let found =
            [(4, 128), (5, 128), (ALL, 4096)].map(|(bounces, samples)| mean(gpu, &objects, &view, bounces, samples));
        assert_eq!(found[0], 0.0, "four bounces do not get there");
        for (found, most) in found[1..].iter().zip([0.005, 0.01]) {
            assert!((found / expected - 1.0).abs() < most, "{found} instead of {expected}");
        }
    });
}

/// Radiance of the middle of the upper of two squares of side 1, `gap` apart, after 0, 1, 2, … bounces at most: the Neumann series of
/// the radiosity equation, L ← L_e + ρ/π ∫ L gap²/d⁴ dA, by the midpoint rule. `albedo` and `emitted` are of the lower and the upper one.
fn between_squares(gap: f64, albedo: [f64; 2], emitted: [f64; 2], bounces: usize) -> Vec<f64> {
    const CELLS: usize = 40;
    let points: Vec<_> = (0..CELLS * CELLS)
        .map(|i| (dvec2((i % CELLS) as f64, (i / CELLS) as f64) + 0.5) / CELLS as f64 - 0.5)
        .collect();
    let kernel = |squared: f64| gap * gap / (gap * gap + squared).powi(2) / (PI * points.len() as f64);
    let mut light = emitted.map(|e| vec![e; points.len()]);
    let mut middle = vec![emitted[1]];
    for _ in 0..bounces {
        let gathered = |at: glam::DVec2, from: &[f64]| {
            points.iter().zip(from).map(|(p, l)| l * kernel(p.distance_squared(at))).sum::<f64>()
        };
        middle.push(emitted[1] + albedo[1] * gathered(glam::DVec2::ZERO, &light[0]));
        let lit = |side: usize| {
            points.iter().map(|p| emitted[side] + albedo[side] * gathered(*p, &light[1 - side])).collect::<Vec<f64>>()
        };
        light = [lit(0), lit(1)];
    }
    middle
}

#[test]
fn light_between_two_squares() {
    validated(|gpu| {
        let (gap, albedo, emitted) = (0.3, [0.95, 0.9], [1.0, 0.6]);
        let expected = between_squares(gap, albedo, emitted, 16);
        let side = |k: usize, height: f64, normal: Vec3| {
            let material = Material { emissive: Vec3::splat(emitted[k] as f32), ..lambert(albedo[k] as f32) };
            square(material, vec3(0.0, height as f32, 0.0), normal)
        };
        let objects = [side(0, -0.5 * gap, Vec3::Y), side(1, 0.5 * gap, Vec3::NEG_Y)];
        let up = Quat::from_rotation_x(std::f32::consts::FRAC_PI_2);
        let view = Viewpoint::perspective(Vec3::ZERO, up, 1.0, [8, 8]);
        let found = [4, 5, ALL].map(|bounces| mean(gpu, &objects, &view, bounces, 2048));
        for (found, expected) in found.iter().zip([expected[4], expected[5], expected[16]]) {
            assert!((found / expected - 1.0).abs() < 0.005, "{found} instead of {expected}");
        }
        assert!(found[0] < 0.97 * expected[5] && found[1] < 0.97 * expected[16], "a missing bounce shows: {found:?}");
    });
}
