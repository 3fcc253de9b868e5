//! The panorama's tracer against an oracle: in double precision, over all triangles of the surface as `docs/pipeline.md` defines it, with no
//! pyramid. Same answer (surface, skirt or free; unknown or not; the triangle's normal, a skirt's nearest vertex), distance within 1e-3 of itself.
//! Rays within a tolerance of an edge, or of where a skirt ends, or in a triangle's plane, are counted apart: single precision decides them
//! either way.

mod common;

use common::{room, validated};
use glam::{DVec2, DVec3, Vec3, vec3};
use iprt::{
    gpu::Gpu,
    panorama::{
        mapping::{panorama_to_world, texel_direction},
        source::PanoramaFrame,
    },
    passes::trace_rays::{FREE, RayAnswer, RayTracer, SKIRT, SURFACE, TracedRay, Tracer},
    settings::{Method, Settings},
};
use rayon::prelude::*;
use std::f64::consts::{PI, TAU};

/// Of vertex and origin distance: how near an edge a ray must pass to be counted apart. Single precision knows places to 1e-7 of that.
const TOLERANCE: f64 = 1e-5;
const YAW: f32 = 37.0;
const SIZE: [u32; 2] = [256, 128];
const RAYS: usize = 20_000;

struct Triangle {
    corners: [DVec3; 3],
    depths: [f64; 3],
    /// Texel columns and rows of the corners; rows -1 and H are the poles.
    texels: [[i64; 2]; 3],
}

/// Triangles side by side, and a sphere around them.
struct Patch {
    centre: DVec3,
    radius: f64,
    triangles: Vec<Triangle>,
}

struct Oracle {
    size: [u32; 2],
    patches: Vec<Patch>,
}

/// Where a ray meets a triangle, or passes it within the tolerance.
struct Crossing<'a> {
    t: f64,
    /// What t is uncertain by for a ray within the tolerance of this one.
    uncertain: f64,
    /// What an answer may be off by.
    allowed: f64,
    /// The ray is so nearly in the triangle's plane that a tenth of the tolerance moves t by more than that.
    edge_on: bool,
    inside: bool,
    at_edge: bool,
    /// The distance from the centre.
    radius: f64,
    triangle: &'a Triangle,
}

struct Verdict<'a> {
    kind: u32,
    t: f64,
    allowed: f64,
    unknown: bool,
    triangle: Option<&'a Triangle>,
}

impl Oracle {
    fn new(frame: &PanoramaFrame) -> Self {
        let size = frame.depth_size;
        let [width, height] = size.map(i64::from);
        let row = |j: i64| &frame.depth[(j * width) as usize..((j + 1) * width) as usize];
        let pole = |row: &[f32]| {
            let valid: Vec<f64> = row.iter().filter(|d| **d > 0.0).map(|d| f64::from(*d).recip()).collect();
            if valid.is_empty() { 0.0 } else { valid.len() as f64 / valid.iter().sum::<f64>() }
        };
        let poles = [pole(row(0)), pole(row(height - 1))];
        let vertex = |i: i64, j: i64| match j {
            -1 => (DVec3::Y * poles[0], poles[0]),
            j if j == height => (DVec3::NEG_Y * poles[1], poles[1]),
            _ => {
                let i = i % width;
                let depth = f64::from(row(j)[i as usize]);
                (panorama_to_world(texel_direction(i as u32, j as u32, size), YAW.into()) * depth, depth)
            }
        };
        let triangle = |texels: [[i64; 2]; 3]| {
            let corners = texels.map(|[i, j]| vertex(i, j));
            let near = corners.iter().fold(f64::INFINITY, |n, c| n.min(c.1));
            (near > 0.0).then(|| Triangle {
                corners: corners.map(|c| c.0),
                depths: corners.map(|c| c.1),
                texels: texels.map(|[i, j]| [i % width, j]),
            })
        };
        let mut patches = Vec::new();
        for first_row in (-1..height).step_by(8) {
            for first_column in (0..width).step_by(8) {
                let mut triangles = Vec::new();
                for j in first_row..(first_row + 8).min(height) {
                    for i in first_column..(first_column + 8).min(width) {
                        let (lower, upper) =
                            ([[i, j], [i, j + 1], [i + 1, j + 1]], [[i, j], [i + 1, j + 1], [i + 1, j]]);
                        triangles.extend((j < height - 1).then(|| triangle(lower)).flatten());
                        triangles.extend((j >= 0).then(|| triangle(upper)).flatten());
                    }
                }
                let corners = || triangles.iter().flat_map(|t| t.corners);
                let centre = corners().sum::<DVec3>() / corners().count().max(1) as f64;
                let radius = corners().map(|c| c.distance(centre)).fold(0.0, f64::max);
                patches.push(Patch { centre, radius, triangles });
            }
        }
        Self { size, patches }
    }

    /// All that a ray meets or nearly meets, in order.
    fn crossings(&self, ray: &TracedRay) -> Vec<Crossing<'_>> {
        let (origin, d) = (ray.origin.as_dvec3(), ray.direction.as_dvec3());
        let mut all = Vec::new();
        for patch in &self.patches {
            let to = patch.centre - origin;
            let beside = (to - d * (to.dot(d) / d.length_squared())).length();
            // twice the tolerance: a triangle is passed within it at a place a little farther than its corners
            if beside
                > patch.radius * (1.0 + 1e-9)
                    + 2.0 * TOLERANCE * (patch.centre.length() + patch.radius + origin.length())
            {
                continue;
            }
            all.extend(patch.triangles.iter().filter_map(|triangle| cross(triangle, origin, d)));
        }
        all.retain(|crossing| crossing.t > -crossing.uncertain);
        all.sort_by(|a, b| a.t.total_cmp(&b.t));
        all
    }
}

/// The triangle seen along the ray: signed areas of its corners about the ray.
fn cross(triangle: &Triangle, origin: DVec3, d: DVec3) -> Option<Crossing<'_>> {
    let (x, y) = d.normalize().any_orthonormal_pair();
    let seen =
        triangle.corners.map(|c| ((c - origin).dot(x), (c - origin).dot(y), (c - origin).dot(d) / d.length_squared()));
    let largest = triangle.depths.iter().fold(0.0f64, |m, d| m.max(*d));
    let tolerance = TOLERANCE * (largest + origin.length());
    let mut weights = [0.0; 3];
    let (mut nearest, mut t_edge) = (f64::INFINITY, 0.0);
    for k in 0..3 {
        let (a, b) = (seen[(k + 1) % 3], seen[(k + 2) % 3]);
        let (pa, pb) = (DVec2::new(a.0, a.1), DVec2::new(b.0, b.1));
        weights[k] = pa.perp_dot(pb);
        let along = pb - pa;
        let s =
            if along.length_squared() > 0.0 { (-pa.dot(along) / along.length_squared()).clamp(0.0, 1.0) } else { 0.0 };
        let distance = (pa + along * s).length();
        if distance < nearest {
            (nearest, t_edge) = (distance, a.2 + (b.2 - a.2) * s);
        }
    }
    let sum: f64 = weights.iter().sum();
    let inside = sum != 0.0 && weights.iter().all(|w| w * sum >= 0.0);
    let at_edge = nearest < tolerance;
    if !inside && !at_edge {
        return None;
    }
    let t = if inside { (0..3).map(|k| weights[k] * seen[k].2).sum::<f64>() / sum } else { t_edge };
    let [a, b, c] = triangle.corners;
    let slope = (b - a).cross(c - a).normalize_or_zero().dot(d).abs();
    let extent = seen.iter().map(|s| (s.2 - t).abs()).fold(0.0, f64::max);
    let uncertain = (tolerance / slope.max(1e-12)).min(extent) + tolerance;
    // next to the origin, of a hundredth of the way to the surface
    let allowed = 1e-3 * t.max(0.01 * (largest + origin.length()));
    let edge_on = 0.1 * tolerance > allowed * slope;
    Some(Crossing { t, uncertain, allowed, edge_on, inside, at_edge, radius: (origin + d * t).length(), triangle })
}

/// What the surface's definition says of a ray; nothing where it passes an edge, or where a skirt ends, too closely to tell.
fn judge<'a>(crossings: &[Crossing<'a>], settings: &Settings) -> Option<Verdict<'a>> {
    let mut verdict = Verdict { kind: FREE, t: f64::INFINITY, allowed: 0.0, unknown: false, triangle: None };
    for crossing in crossings {
        // beyond what was hit nothing matters
        if crossing.t - crossing.uncertain > verdict.t {
            continue;
        }
        let depths = crossing.triangle.depths;
        let (near, far) = (depths[0].min(depths[1]).min(depths[2]), depths[0].max(depths[1]).max(depths[2]));
        let limit = near * (1.0 + f64::from(settings.edge_ratio));
        let skirt = far > limit;
        let end = near + f64::from(settings.thickness);
        let beyond = skirt && crossing.radius > end;
        let unsure = crossing.at_edge
            || crossing.edge_on
            || (far - limit).abs() < 1e-5 * far
            || skirt && (crossing.radius - end).abs() < crossing.uncertain
            || crossing.t < crossing.uncertain;
        if unsure {
            return None;
        }
        if crossing.t > verdict.t {
            continue;
        }
        if beyond {
            verdict.unknown = true;
        } else if crossing.inside {
            let kind = if skirt { SKIRT } else { SURFACE };
            verdict = Verdict {
                kind,
                t: crossing.t,
                allowed: crossing.allowed,
                triangle: Some(crossing.triangle),
                ..verdict
            };
        }
    }
    Some(verdict)
}

/// Why an answer is wrong, if it is.
fn fault(answer: &RayAnswer, verdict: &Verdict<'_>, size: [u32; 2]) -> Option<&'static str> {
    if answer.kind != verdict.kind {
        return Some("kind");
    }
    if (answer.unknown != 0) != verdict.unknown {
        return Some("unknown");
    }
    let Some(triangle) = verdict.triangle else { return (answer.t < 1e30).then_some("distance of nothing") };
    if (f64::from(answer.t) - verdict.t).abs() > verdict.allowed {
        return Some("distance");
    }
    let [a, b, c] = triangle.corners;
    let normal = (b - a).cross(c - a);
    if answer.normal.as_dvec3().normalize_or_zero().dot(normal.normalize()).abs() < 0.99 {
        return Some("normal");
    }
    if answer.kind == SKIRT {
        let near = (0..3).min_by(|a, b| triangle.depths[*a].total_cmp(&triangle.depths[*b])).unwrap();
        let [i, j] = triangle.texels[near];
        let v = ((j as f64 + 0.5) / f64::from(size[1])).clamp(0.0, 1.0);
        let u = (i as f64 + 0.5) / f64::from(size[0]);
        let same = |d: f64| triangle.depths.iter().filter(|other| **other == d).count() > 1;
        // a pole has no column of its own
        let apart = if j < 0 || j == i64::from(size[1]) { 0.0 } else { (f64::from(answer.uv.x) - u).abs() };
        if !same(triangle.depths[near]) && (apart > 1e-4 || (f64::from(answer.uv.y) - v).abs() > 1e-4) {
            return Some("radiance is not read at the nearest vertex");
        }
    }
    None
}

/// SplitMix64 (Steele, Lea and Flood 2014).
struct Random(u64);

impl Random {
    fn next(&mut self) -> f64 {
        self.0 = self.0.wrapping_add(0x9e37_79b9_7f4a_7c15);
        let mut z = self.0;
        z = (z ^ (z >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
        ((z ^ (z >> 31)) >> 11) as f64 / (1u64 << 53) as f64
    }

    fn between(&mut self, low: f64, high: f64) -> f64 {
        low + (high - low) * self.next()
    }

    fn direction(&mut self) -> DVec3 {
        let (y, phi) = (self.between(-1.0, 1.0), TAU * self.next());
        let r = (1.0 - y * y).sqrt();
        DVec3::new(r * phi.cos(), y, r * phi.sin())
    }
}

/// Rays of all kinds, in turn.
const CLASSES: [&str; 8] = ["centre", "off centre", "behind", "poles", "seam", "meridians", "grazing", "axes"];

fn rays(frame: &PanoramaFrame, count: usize) -> Vec<TracedRay> {
    let mut random = Random(7);
    let valid: Vec<f64> = frame.depth.iter().filter(|d| **d > 0.0).map(|d| f64::from(*d)).collect();
    let typical = if valid.is_empty() { 3.0 } else { valid.iter().sum::<f64>() / valid.len() as f64 };
    let size = frame.depth_size;
    let seam = panorama_to_world(DVec3::Z, YAW.into());
    let vertex = |random: &mut Random| {
        let (i, j) = ((random.next() * f64::from(size[0])) as u32, (random.next() * f64::from(size[1])) as u32);
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
            let somewhere = random.direction() * (typical * random.between(0.0, 0.7));
            let (origin, direction) = match k % CLASSES.len() {
                0 => (DVec3::ZERO, random.direction()),
                1 => (somewhere, random.direction()),
                2 => {
                    let (point, _) = vertex(&mut random);
                    (point * random.between(1.05, 2.5), random.direction())
                }
                3 => {
                    let end = if random.next() < 0.5 { DVec3::Y } else { DVec3::NEG_Y };
                    let target = end * typical * random.between(0.2, 3.0);
                    (somewhere, target + random.direction() * (typical * 0.01) - somewhere)
                }
                4 => {
                    let target =
                        seam * typical * random.between(0.3, 2.0) + DVec3::Y * typical * random.between(-1.0, 1.0);
                    (somewhere, target + random.direction() * (typical * 0.02) - somewhere)
                }
                5 => {
                    // in the plane of a meridian: through vertices, between them, anywhere
                    let column = (random.next() * f64::from(size[0])).floor();
                    let offset = [0.5, 1.0, random.next()][(random.next() * 3.0) as usize];
                    let phi = TAU * ((column + offset) / f64::from(size[0]) - 0.5) - f64::from(YAW).to_radians();
                    let theta = TAU * random.next();
                    let d = DVec3::new(theta.sin() * phi.sin(), theta.cos(), -theta.sin() * phi.cos());
                    (DVec3::Y * (typical * random.between(-0.5, 0.5)), d)
                }
                6 => {
                    let (point, normal) = vertex(&mut random);
                    let side = normal.any_orthonormal_vector();
                    let along = side * (PI * random.next()).cos() + normal.cross(side) * (PI * random.next()).sin();
                    let tilt = 10f64.powf(random.between(-4.0, -0.5)) * random.between(-1.0, 1.0).signum();
                    (point + normal * (typical * random.between(-0.02, 0.02)), along + normal * tilt)
                }
                _ => {
                    let axis = [DVec3::X, DVec3::Y, DVec3::Z][(random.next() * 3.0) as usize];
                    (somewhere, if random.next() < 0.5 { axis } else { -axis })
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
    for thickness in ["0.3", "0", "inf"] {
        let settings = settings(thickness);
        let tracer = RayTracer::new(gpu, frame, YAW, &settings, Tracer::FarSides).unwrap();
        let set = tracer.rays(&rays).unwrap();
        tracer.trace(&set).unwrap();
        let answers = tracer.answers(&set).unwrap();
        let (mut apart, mut kinds, mut unknown, mut wrong) = ([0usize; CLASSES.len()], [0usize; 3], 0, Vec::new());
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
            "{name}, thickness {thickness}: free, surface, skirt {kinds:?}, unknown {unknown}, counted apart {apart:?}"
        );
        assert!(
            wrong.is_empty(),
            "{name}, thickness {thickness}: {} wrong\n{}",
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
    PanoramaFrame { color_size: [1, 1], radiance: vec![[0.0; 4]], depth_size: size, depth, ..Default::default() }
}

fn box_room(size: [u32; 2]) -> PanoramaFrame {
    let mut frame = room(size, vec3(6.0, 2.7, 4.4), vec3(0.7, 0.1, -0.4), |_| Vec3::ONE);
    (frame.color_size, frame.radiance) = ([1, 1], vec![[0.0; 4]]);
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
        let mut random = Random(3);
        let noise: Vec<f64> = (0..SIZE[0] * SIZE[1]).map(|_| random.between(0.85, 1.15)).collect();
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
