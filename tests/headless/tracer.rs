//! The panorama's tracer against an oracle: in double precision, over all triangles of the surface as `docs/pipeline.md` defines it, with no
//! pyramid. Same answer (surface, skirt or free; unknown or not; the triangle's normal, a skirt's nearest vertex), distance within 1e-3 of itself.
//! Rays within a tolerance of an edge, or of where a skirt ends, or in a triangle's plane, are counted apart: single precision decides them
//! either way.

use crate::common::{room, validated};
use crate::oracle::{Oracle, YAW, cross, fault, judge};
use glam::{DVec3, Vec3, vec3};
use iprt::{
    gpu::Gpu,
    panorama::{
        mapping::{panorama_to_world, texel_direction},
        source::PanoramaFrame,
    },
    passes::trace_rays::{RayTracer, SURFACE, TracedRay, Tracer},
    settings::{Method, Settings},
};
use rayon::prelude::*;
use std::f64::consts::{PI, TAU};

const SIZE: [u32; 2] = [256, 128];
const RAYS: usize = 20_000;

fn between(random: &mut fastrand::Rng, low: f64, high: f64) -> f64 {
    low + (high - low) * random.f64()
}

fn direction(random: &mut fastrand::Rng) -> DVec3 {
    let (y, phi) = (between(random, -1.0, 1.0), TAU * random.f64());
    let r = (1.0 - y * y).sqrt();
    DVec3::new(r * phi.cos(), y, r * phi.sin())
}

/// Rays of all kinds, in turn.
const CLASSES: [&str; 8] = ["centre", "off centre", "behind", "poles", "seam", "meridians", "grazing", "axes"];

fn rays(frame: &PanoramaFrame, count: usize) -> Vec<TracedRay> {
    let mut random = fastrand::Rng::with_seed(7);
    let valid: Vec<f64> = frame.depth.iter().filter(|d| **d > 0.0).map(|d| f64::from(*d)).collect();
    let typical = if valid.is_empty() { 3.0 } else { valid.iter().sum::<f64>() / valid.len() as f64 };
    let size = frame.depth_size;
    let seam = panorama_to_world(DVec3::Z, YAW.into());
    let vertex = |random: &mut fastrand::Rng| {
        let (i, j) = ((random.f64() * f64::from(size[0])) as u32, (random.f64() * f64::from(size[1])) as u32);
        let place = |i: u32, j: u32| {
            let depth = f64::from(frame.depth[(j * size[0] + i % size[0]) as usize]);
            panorama_to_world(texel_direction(i % size[0], j, size), YAW.into()) * depth
        };
        let j = j.min(size[1].saturating_sub(2));
        let (a, b, c) = (place(i, j), place(i, (j + 1).min(size[1] - 1)), place(i + 1, j));
        (a, (b - a).cross(c - a).normalize_or(DVec3::Y))
    };
    (0..count)
        .map(|k| {
            let somewhere = direction(&mut random) * (typical * between(&mut random, 0.0, 0.7));
            let (origin, direction) = match k % CLASSES.len() {
                0 => (DVec3::ZERO, direction(&mut random)),
                1 => (somewhere, direction(&mut random)),
                2 => {
                    let (point, _) = vertex(&mut random);
                    (point * between(&mut random, 1.05, 2.5), direction(&mut random))
                }
                3 => {
                    let end = if random.f64() < 0.5 { DVec3::Y } else { DVec3::NEG_Y };
                    let target = end * typical * between(&mut random, 0.2, 3.0);
                    (somewhere, target + direction(&mut random) * (typical * 0.01) - somewhere)
                }
                4 => {
                    let target = seam * typical * between(&mut random, 0.3, 2.0)
                        + DVec3::Y * typical * between(&mut random, -1.0, 1.0);
                    (somewhere, target + direction(&mut random) * (typical * 0.02) - somewhere)
                }
                5 => {
                    // in the plane of a meridian: through vertices, between them, anywhere
                    let column = (random.f64() * f64::from(size[0])).floor();
                    let offset = [0.5, 1.0, random.f64()][(random.f64() * 3.0) as usize];
                    let phi = TAU * ((column + offset) / f64::from(size[0]) - 0.5) - f64::from(YAW).to_radians();
                    let theta = TAU * random.f64();
                    let d = DVec3::new(theta.sin() * phi.sin(), theta.cos(), -theta.sin() * phi.cos());
                    (DVec3::Y * (typical * between(&mut random, -0.5, 0.5)), d)
                }
                6 => {
                    let (point, normal) = vertex(&mut random);
                    let side = normal.any_orthonormal_vector();
                    let along = side * (PI * random.f64()).cos() + normal.cross(side) * (PI * random.f64()).sin();
                    let tilt = 10f64.powf(between(&mut random, -4.0, -0.5)) * between(&mut random, -1.0, 1.0).signum();
                    (point + normal * (typical * between(&mut random, -0.02, 0.02)), along + normal * tilt)
                }
                _ => {
                    let axis = [DVec3::X, DVec3::Y, DVec3::Z][(random.f64() * 3.0) as usize];
                    (somewhere, if random.f64() < 0.5 { axis } else { -axis })
                }
            };
            let direction = direction.normalize().as_vec3();
            TracedRay { origin: origin.as_vec3(), t_min: 0.0, direction, t_max: 1e30 }
        })
        .collect()
}

fn settings(thickness: &str) -> Settings {
    let mut settings = Settings::of(Method::Iprt);
    settings.set("thickness", thickness, "test").unwrap();
    settings
}

/// Compares. Of a class at most 5 % may be counted apart; of those along meridians half, since a third runs along edges.
fn agree(gpu: &Gpu, name: &str, frame: &PanoramaFrame, count: usize) {
    let rays = rays(frame, count);
    let oracle = Oracle::new(frame);
    let crossings: Vec<_> = rays.par_iter().map(|ray| oracle.crossings(ray)).collect();
    for (thickness, edges) in [("0.3", false), ("0", false), ("inf", false), ("0.3", true)] {
        let mut settings = settings(thickness);
        settings.edge_depth = edges;
        settings.smooth_depth = false; // some of these are noise
        let tracer = RayTracer::new(gpu, frame, YAW, &settings, Tracer::FarSides).unwrap();
        let set = tracer.rays(&rays).unwrap();
        tracer.trace(&set).unwrap();
        let answers = tracer.answers(&set).unwrap();
        let (mut apart, mut kinds, mut unknown, mut wrong) = ([0usize; CLASSES.len()], [0usize; 4], 0, Vec::new());
        for (k, (answer, crossings)) in answers.iter().zip(&crossings).enumerate() {
            let Some(verdict) = judge(crossings, &settings) else {
                apart[k % CLASSES.len()] += 1;
                continue;
            };
            kinds[verdict.kind as usize] += 1;
            unknown += usize::from(verdict.unknown);
            if let Some(fault) = fault(answer, &verdict, oracle.size) {
                wrong.push(format!(
                    "{} {fault}: {:?} is {answer:?}, should be {} at {} ({})",
                    CLASSES[k % CLASSES.len()],
                    rays[k],
                    verdict.kind,
                    verdict.t,
                    verdict.unknown
                ));
            }
        }
        println!(
            "{name}, thickness {thickness}, edge_depth {edges}: free, surface, skirt, unseen {kinds:?}, unknown {unknown}, counted apart {apart:?}"
        );
        assert!(
            wrong.is_empty(),
            "{name}, thickness {thickness}, edge_depth {edges}: {} wrong\n{}",
            wrong.len(),
            wrong[..wrong.len().min(12)].join("\n")
        );
    }
}

fn map(depth: impl Fn(f64, f64) -> f64) -> PanoramaFrame {
    sized(SIZE, depth)
}

/// A depth map by (u, v).
fn sized(size: [u32; 2], depth: impl Fn(f64, f64) -> f64) -> PanoramaFrame {
    let uv = |k: u32| {
        let (i, j) = (k % size[0], k / size[0]);
        ((f64::from(i) + 0.5) / f64::from(size[0]), (f64::from(j) + 0.5) / f64::from(size[1]))
    };
    let depth = (0..size[0] * size[1])
        .map(|k| {
            let (u, v) = uv(k);
            depth(u, v) as f32
        })
        .collect();
    PanoramaFrame { color_size: [1, 1], radiance: vec![[0.0; 4]].into(), depth_size: size, depth, ..Default::default() }
}

fn box_room(size: [u32; 2]) -> PanoramaFrame {
    let mut frame = room(size, vec3(6.0, 2.7, 4.4), vec3(0.7, 0.1, -0.4), |_| Vec3::ONE);
    (frame.color_size, frame.radiance) = ([1, 1], vec![[0.0; 4]].into());
    frame
}

/// Posts and tables before the walls.
fn furnished(size: [u32; 2]) -> PanoramaFrame {
    let mut frame = box_room(size);
    for (k, depth) in (0u32..).zip(&mut frame.depth) {
        let (u, v) = (f64::from(k % size[0]) / f64::from(size[0]), f64::from(k / size[0]) / f64::from(size[1]));
        let post = (u * 12.0).fract() < 0.15 && v > 0.3;
        let table = (u * 5.0).fract() < 0.5 && (0.58..0.66).contains(&v);
        *depth = if post {
            1.1 + 0.2 * u as f32
        } else if table {
            0.8
        } else {
            *depth
        };
    }
    frame
}

#[test]
fn the_oracle_without_patches_says_the_same() {
    let frame = furnished([64, 32]);
    let oracle = Oracle::new(&frame);
    for ray in rays(&frame, 400) {
        let (origin, d) = (ray.origin.as_dvec3(), ray.direction.as_dvec3());
        let all = oracle.patches.iter().flat_map(|patch| &patch.triangles).filter_map(|t| cross(t, origin, d));
        let mut all: Vec<f64> = all.filter(|c| c.t > -c.uncertain).map(|c| c.t).collect();
        all.sort_by(f64::total_cmp);
        assert_eq!(all, oracle.crossings(&ray).iter().map(|c| c.t).collect::<Vec<_>>());
    }
}

#[test]
fn a_room_with_and_without_furniture() {
    validated(|gpu| {
        agree(gpu, "box room", &box_room(SIZE), RAYS);
        agree(gpu, "furniture", &furnished(SIZE), RAYS);
        let mut long = room([64, 32], vec3(12.0, 2.2, 20.0), vec3(0.4, 0.3, -3.0), |_| Vec3::ONE);
        (long.color_size, long.radiance) = ([1, 1], vec![[0.0; 4]].into());
        agree(gpu, "floor and walls at grazing angles", &long, RAYS);
    });
}

#[test]
fn steps_at_seam_and_poles() {
    validated(|gpu| {
        let seam = map(|u, v| if !(0.06..=0.97).contains(&u) && (0.2..0.8).contains(&v) { 1.3 } else { 3.0 });
        agree(gpu, "step at the seam", &seam, RAYS);
        let poles = map(|u, v| {
            if v < 0.1 + 0.05 * (TAU * u).sin() {
                1.2
            } else if v > 0.93 {
                0.7
            } else {
                2.5 + 0.1 * (9.0 * TAU * u).cos()
            }
        });
        agree(gpu, "steps at the poles", &poles, RAYS);
        // in the first and last rows themselves, so that fans to the poles are skirts
        let last = map(|u, v| if !(0.004..=0.996).contains(&v) && u < 0.4 { 1.0 } else { 2.0 });
        agree(gpu, "steps in the fans", &last, RAYS);
    });
}

#[test]
fn holes_and_distance_and_noise() {
    validated(|gpu| {
        let patch =
            |u: f64, v: f64| ((u * 7.0).fract() < 0.3 && (v * 5.0).fract() < 0.4) || !(0.02..=0.99).contains(&u);
        let band = |v: f64| (0.45..0.5).contains(&v) || v < 0.03;
        agree(gpu, "holes", &map(|u, v| if patch(u, v) || band(v) { 0.0 } else { 2.0 + v }), RAYS);
        agree(gpu, "all far", &map(|_, _| 20_000.0), RAYS);
        agree(gpu, "all holes", &map(|_, _| 0.0), RAYS / 10);
        let mut random = fastrand::Rng::with_seed(3);
        let noise: Vec<f64> = (0..SIZE[0] * SIZE[1]).map(|_| between(&mut random, 0.85, 1.15)).collect();
        let texel =
            |u: f64, v: f64| ((v * f64::from(SIZE[1])) as u32 * SIZE[0] + (u * f64::from(SIZE[0])) as u32) as usize;
        agree(gpu, "noise of 15 %", &map(|u, v| (2.5 + (TAU * u).sin()) * noise[texel(u, v)]), RAYS);
    });
}

/// Few texels make wide triangles, and sizes that do not halve leave nodes with empty places.
#[test]
fn small_and_odd_depth_maps() {
    validated(|gpu| {
        agree(gpu, "32×16", &furnished([32, 16]), RAYS);
        for size in [[1, 1], [2, 1], [3, 2], [5, 3], [37, 19], [63, 64]] {
            let steps = sized(size, |u, v| if (3.0 * u + 2.0 * v).fract() < 0.4 { 1.0 } else { 2.2 });
            agree(gpu, &format!("{size:?}"), &steps, RAYS / 10);
        }
    });
}

/// What the march promises, where it can: in a room without edges the same answer as the surface gives, to a texel and a step.
#[test]
fn a_march_through_a_room_finds_its_walls() {
    validated(|gpu| {
        let frame = box_room(SIZE);
        let rays: Vec<_> = rays(&frame, RAYS).into_iter().skip(1).step_by(8).collect();
        let answers = |tracer| {
            let tracer = RayTracer::new(gpu, &frame, YAW, &settings("0.3"), tracer).unwrap();
            let set = tracer.rays(&rays).unwrap();
            tracer.trace(&set).unwrap();
            tracer.answers(&set).unwrap()
        };
        let (exact, marched) = (answers(Tracer::Surface), answers(Tracer::March(64)));
        // from outside of the room rays are free, or pass a wall: the march takes its origin to be inside
        let inside =
            |ray: &TracedRay| ((ray.origin - vec3(0.7, 0.1, -0.4)).abs() - vec3(3.0, 1.35, 2.2)).max_element() < -0.05;
        let inside: Vec<_> = (0..rays.len()).filter(|k| inside(&rays[*k])).collect();
        assert!(inside.len() > 1000);
        let close =
            |k: &&usize| marched[**k].kind == SURFACE && (marched[**k].t - exact[**k].t).abs() < 0.03 * exact[**k].t;
        let share = inside.iter().filter(close).count() as f64 / inside.len() as f64;
        println!("{share} of {} marched rays within 3 %", inside.len());
        assert!(share > 0.97);
    });
}
