//! Estimates how much brighter than the capture shows its clipped lamps and windows are, from the light that
//! they cast.
//!
//! A diffuse surface sends ρ·E/π. E is known but for the clipped lamps: E = E₀ + Σ sₖ·Eₖ, where Eₖ is the
//! light of lamp k as captured. Along a surface of one paint ρ is even, but a lamp that is taken for too dim
//! leaves its shading in L/E. So the factors sₖ are those for which L/E varies least over pairs of points that
//! seem to be of one paint, and no surface reflects more than it gets. (After intrinsic images, and Zhang,
//! Cohen and Curless 2016, "Emptying, refurnishing, and relighting indoor spaces".)

use super::{
    cloud::Cloud,
    light::mean_luminance,
    mapping::{coordinates, neighbours, texel_direction},
    source::PanoramaFrame,
};
use glam::{Vec3, vec3};
use rayon::prelude::*;
use serde::Serialize;

/// A texel is clipped if its largest channel is at least this share of white: the code of a clipped texel may
/// be a few less than 255 after lossy coding.
const CLIPPED: f32 = 0.955;
/// The most lamps that have factors of their own. Smaller ones share one.
pub const MOST_GROUPS: usize = 10;
/// The smallest solid angle of a lamp, sr: a texel of 1024×512.
const SMALLEST: f32 = 3e-5;
/// A factor's bounds.
const FACTORS: [f32; 2] = [1.0, 200.0];
/// The largest reflectance of a real surface.
const WHITEST: f32 = 0.9;
/// What a lamp's log factor adds to the mean shading that is left: glints and small lamps cannot shine for others.
const FAR: f32 = 0.003;
/// Differences of log reflectance beyond this are paint, not shading.
const PAINT: f32 = 0.35;
/// Rays from a point for the light of what is not clipped.
const RAYS: usize = 256;
/// Points of a lamp at most.
const LAMP_POINTS: usize = 64;
/// Texels this many times as bright as the mean count as lamps, too, even if they are not clipped: rays would find
/// them too rarely.
const BRIGHT: f32 = 3.0;
/// The points that stand for these at most.
const BRIGHT_POINTS: usize = 256;

/// Clipped texels side by side.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct ClippedLamp {
    /// Towards its middle, in the panorama's frame.
    pub direction: [f32; 3],
    /// Its solid angle, steradians.
    pub solid_angle: f32,
    /// By what its radiance is multiplied.
    pub factor: f32,
}

impl ClippedLamp {
    /// The angle from its middle to its rim, if it is round.
    pub fn reach(&self) -> f32 {
        (self.solid_angle / std::f32::consts::PI).sqrt()
    }
}

/// The lamps of a capture that were clipped.
#[derive(Clone, Debug, Default, PartialEq, Serialize)]
pub struct Clipped {
    /// The largest first.
    pub lamps: Vec<ClippedLamp>,
    /// The share of all texels that is clipped.
    pub share: f32,
}

impl Clipped {
    /// All clipped texels with one factor.
    pub fn even(factor: f32) -> Self {
        let lamp = ClippedLamp { direction: [0.0, 1.0, 0.0], solid_angle: 0.0, factor };
        Self { lamps: vec![lamp], share: 0.0 }
    }

    /// Returns the factor of a clipped texel in a direction: that of the nearest lamp, by angle.
    pub(super) fn factor(&self, direction: Vec3) -> f32 {
        let near = |lamp: &&ClippedLamp| direction.angle_between(Vec3::from(lamp.direction)) - lamp.reach();
        self.lamps.iter().min_by(|a, b| near(a).total_cmp(&near(b))).map_or(1.0, |lamp| lamp.factor)
    }

    /// Whether any lamp is brighter than it shows.
    pub fn raises(&self) -> bool {
        self.lamps.iter().any(|lamp| lamp.factor != 1.0)
    }

    /// Writes the factors of the clipped texels of a frame whose white is `white` into their alpha.
    pub fn raise(&self, frame: &mut PanoramaFrame, white: f32) {
        if !self.raises() {
            return;
        }
        if let Some(codes) = frame.radiance.codes_mut() {
            return codes.raise(self, CLIPPED * white);
        }
        let size = frame.color_size;
        frame.radiance.change(|first, texels| {
            texels.par_iter_mut().enumerate().for_each(|(index, texel)| {
                if is_clipped(texel, white) {
                    let at = (first + index) as u32;
                    texel[3] = self.factor(texel_direction(at % size[0], at / size[0], size).as_vec3());
                }
            });
        });
    }
}

fn is_clipped(texel: &[f32; 4], white: f32) -> bool {
    texel[0].max(texel[1]).max(texel[2]) >= CLIPPED * white
}

fn luminance(t: &[f32; 4]) -> f32 {
    0.2126 * t[0] + 0.7152 * t[1] + 0.0722 * t[2]
}

/// A point of a lamp.
struct Emitter {
    at: Vec3,
    /// Towards the capture point; zero if it shines alike to all sides.
    normal: Vec3,
    /// Radiance times the area that the capture point sees.
    power: f32,
}

/// A point of a real surface that is not clipped, with its light.
struct Receiver {
    at: Vec3,
    normal: Vec3,
    luminance: f32,
    /// The shares of red and blue in the sum of the channels.
    tint: [f32; 2],
    /// E of what is not clipped, and of each lamp as captured.
    base: f32,
    lamps: Vec<f32>,
}

/// Estimates the factors of the clipped lamps of a frame, if any can be.
pub(super) fn estimate_of(frame: &PanoramaFrame) -> Clipped {
    frame.white.map_or_else(Clipped::default, |white| estimate(frame, white))
}

/// Estimates the factors of a frame's clipped lamps. `white` is the radiance at which it clips.
pub fn estimate(frame: &PanoramaFrame, white: f32) -> Clipped {
    let clipped = frame.radiance.par_iter().filter(|texel| is_clipped(texel, white)).count();
    let share = clipped as f32 / frame.radiance.len().max(1) as f32;
    let groups = if clipped > 0 { groups(frame, white) } else { Vec::new() };
    if groups.is_empty() {
        return Clipped { lamps: Vec::new(), share };
    }
    let cloud = Cloud::of(frame, 0.0);
    let mut sets: Vec<Vec<Emitter>> =
        groups.iter().map(|group| emitters(frame, &cloud, &group.texels, LAMP_POINTS)).collect();
    // Texels of lamps too small for factors of their own are among the bright ones.
    let mut own = vec![false; frame.radiance.len()];
    groups.iter().flat_map(|group| &group.texels).for_each(|at| own[*at as usize] = true);
    let bright = BRIGHT * mean_luminance(frame);
    let is_lamp = |at: usize| own[at] || luminance(&frame.radiance.at(at)) > bright;
    let others: Vec<u32> = (0..own.len()).filter(|at| !own[*at] && is_lamp(*at)).map(|at| at as u32).collect();
    sets.push(emitters(frame, &cloud, &others, BRIGHT_POINTS));
    let receivers = receivers(frame, &cloud, &is_lamp, white, &sets);
    let factors = fit(&receivers, groups.len());
    let lamps = groups.iter().zip(factors).map(|(group, factor)| ClippedLamp {
        direction: group.direction.to_array(),
        solid_angle: group.solid_angle,
        factor,
    });
    Clipped { lamps: lamps.collect(), share }
}

struct Group {
    texels: Vec<u32>,
    direction: Vec3,
    solid_angle: f32,
}

fn texel_angle(row: u32, size: [u32; 2]) -> f32 {
    let polar = std::f32::consts::PI * (row as f32 + 0.5) / size[1] as f32;
    std::f32::consts::TAU / size[0] as f32 * std::f32::consts::PI / size[1] as f32 * polar.sin()
}

/// The clipped texels that touch each other.
fn groups(frame: &PanoramaFrame, white: f32) -> Vec<Group> {
    let size = frame.color_size;
    let mut left: Vec<bool> = frame.radiance.par_iter().map(|texel| is_clipped(&texel, white)).collect();
    let mut groups = Vec::new();
    for first in 0..left.len() {
        if !std::mem::take(&mut left[first]) {
            continue;
        }
        let (mut texels, mut next) = (vec![first as u32], 0);
        while next < texels.len() {
            for other in neighbours(texels[next], size) {
                if std::mem::take(&mut left[other as usize]) {
                    texels.push(other);
                }
            }
            next += 1;
        }
        let (mut direction, mut solid_angle) = (Vec3::ZERO, 0.0);
        for at in &texels {
            let weight = texel_angle(at / size[0], size);
            direction += weight * texel_direction(at % size[0], at / size[0], size).as_vec3();
            solid_angle += weight;
        }
        let direction = direction.try_normalize().unwrap_or(Vec3::Y);
        if solid_angle > SMALLEST {
            groups.push(Group { texels, direction, solid_angle });
        }
    }
    groups.sort_by(|a, b| b.solid_angle.total_cmp(&a.solid_angle));
    groups.truncate(MOST_GROUPS);
    groups
}

/// The cell of a cloud in a direction.
fn cell(cloud: &Cloud, direction: Vec3) -> usize {
    let [width, height] = cloud.size;
    let at = coordinates(direction.as_dvec3());
    let column = (at.x * width as f64) as usize % width;
    let row = ((at.y * height as f64) as usize).min(height - 1);
    row * width + column
}

fn emitters(frame: &PanoramaFrame, cloud: &Cloud, texels: &[u32], most: usize) -> Vec<Emitter> {
    let size = frame.color_size;
    // Evenly over the texels: each stands for its neighbours.
    let step = texels.len().div_ceil(most).max(1);
    let chosen: Vec<u32> = texels.iter().copied().skip(step / 2).step_by(step).collect();
    let weight = |at: u32| texel_angle(at / size[0], size) * luminance(&frame.radiance.at(at as usize));
    let whole: f32 = texels.iter().map(|at| weight(*at)).sum();
    let sum: f32 = chosen.iter().map(|at| weight(*at)).sum();
    let emitter = |at: &u32| {
        let direction = texel_direction(at % size[0], at / size[0], size).as_vec3();
        let index = cell(cloud, direction);
        // Lamps are often holes: they are taken to be where their surroundings are.
        let depth = cloud.depth[index];
        let depth = if depth > 0.0 { depth } else { nearest_depth(cloud, index)? };
        let normal = cloud.normals[index];
        // Seen at a small angle it says little.
        let normal = if normal.dot(-direction) > 0.15 { normal } else { Vec3::ZERO };
        let cosine = if normal == Vec3::ZERO { 1.0 } else { normal.dot(-direction) };
        let power = whole * weight(*at) / sum * depth * depth / cosine;
        Some(Emitter { at: direction * depth, normal, power })
    };
    chosen.iter().filter_map(emitter).collect()
}

fn nearest_depth(cloud: &Cloud, index: usize) -> Option<f32> {
    let around = |radius| {
        let known = cloud.window(index, radius).map(|cell| cloud.depth[cell]).filter(|depth| *depth > 0.0);
        known.max_by(f32::total_cmp)
    };
    [2, 6, 16].into_iter().find_map(around)
}

/// Whether nothing stands between two points, by the depth of a few places between them.
fn sees(cloud: &Cloud, from: Vec3, to: Vec3) -> bool {
    const STEPS: usize = 20;
    (1..STEPS).all(|k| {
        let point = from.lerp(to, k as f32 / STEPS as f32);
        let (depth, distance) = (cloud.depth[cell(cloud, point)], point.length());
        // What lies far behind a foreground edge is as likely free.
        depth <= 0.0 || distance < 1.04 * depth || distance > depth + 0.5
    })
}

/// What a ray meets: a direction of the panorama.
fn meets(cloud: &Cloud, from: Vec3, d: Vec3) -> Vec3 {
    // Steps grow with the distance from the start.
    let mut t = 0.04 * from.length();
    for _ in 0..40 {
        let point = from + t * d;
        let (depth, distance) = (cloud.depth[cell(cloud, point)], point.length());
        if depth > 0.0 && distance > depth && distance < depth + 0.5 + 0.2 * t {
            return point;
        }
        t *= 1.13;
        t += 0.01 * from.length();
    }
    d
}

/// Points of real surfaces, and what they get of each set of emitters. The last set's is put with the light of all
/// that is no lamp.
fn receivers(
    frame: &PanoramaFrame,
    cloud: &Cloud,
    is_lamp: &(impl Fn(usize) -> bool + Sync),
    white: f32,
    emitters: &[Vec<Emitter>],
) -> Vec<Receiver> {
    let [width, height] = cloud.size;
    let stride = (width / 64).max(1);
    let texel = |direction: Vec3| {
        let at = coordinates(direction.as_dvec3());
        let [columns, rows] = frame.color_size.map(|side| side as usize);
        let (x, y) = ((at.x * columns as f64) as usize % columns, ((at.y * rows as f64) as usize).min(rows - 1));
        y * columns + x
    };
    // A cell's mean over its texels, and whether any is clipped.
    let mean = |index: usize| {
        let (column, row) = (index % width, index / width);
        let mut sum = Vec3::ZERO;
        for k in 0..16u32 {
            let fine = [4 * width as u32, 4 * height as u32];
            let at = texel(texel_direction(4 * column as u32 + k % 4, 4 * row as u32 + k / 4, fine).as_vec3());
            if is_lamp(at) {
                return None;
            }
            let [r, g, b, _] = frame.radiance.at(at);
            sum += vec3(r, g, b) / 16.0;
        }
        Some(sum)
    };
    let places: Vec<usize> = (height / 16..height - height / 16)
        .step_by(stride)
        .flat_map(|row| (0..width).step_by(stride).map(move |column| row * width + column))
        .collect();
    let receiver = |(number, &index): (usize, &usize)| {
        let (at, normal) = (cloud.point(index)?, cloud.normals[index]);
        let seen = mean(index)?;
        let total = seen.element_sum();
        // What is nearly black tells nothing.
        if normal == Vec3::ZERO || normal.dot(-cloud.directions[index]) < 0.1 || total < 0.03 * white {
            return None;
        }
        let from = at + normal * (0.02 * at.length());
        let lamps = emitters.iter().map(|group| {
            let light = group.iter().map(|emitter| {
                let way = emitter.at - from;
                let (square, cosine) = (way.length_squared().max(1e-4), way.normalize_or_zero().dot(normal));
                let leaves =
                    if emitter.normal == Vec3::ZERO { 1.0 } else { -way.normalize_or_zero().dot(emitter.normal) };
                if cosine <= 0.0 || leaves <= 0.0 || !sees(cloud, from, from + 0.97 * way) {
                    return 0.0;
                }
                emitter.power * cosine * leaves / square
            });
            light.sum::<f32>()
        });
        // Cosine-weighted directions of a lattice, turned for each point.
        let (x, y) = normal.any_orthonormal_pair();
        let turn = (number as f32 * 0.618_034).fract();
        let mut base = 0.0;
        for k in 0..RAYS {
            let (u, v) = ((k as f32 + 0.5) / RAYS as f32, (k as f32 * 0.618_034 + turn).fract());
            let (sin, cos) = (std::f32::consts::TAU * v).sin_cos();
            let d = x * (u.sqrt() * cos) + y * (u.sqrt() * sin) + normal * (1.0 - u).sqrt();
            let met = texel(meets(cloud, from, d));
            if !is_lamp(met) {
                base += luminance(&frame.radiance.at(met));
            }
        }
        let luminance = seen.dot(vec3(0.2126, 0.7152, 0.0722));
        let tint = [seen.x / total, seen.z / total];
        let mut lamps: Vec<f32> = lamps.collect();
        let base = std::f32::consts::PI * base / RAYS as f32 + lamps.pop().unwrap_or(0.0);
        Some(Receiver { at, normal, luminance, tint, base, lamps })
    };
    places.par_iter().enumerate().filter_map(receiver).collect()
}

/// Pairs of points that seem to be of one paint.
fn pairs(receivers: &[Receiver]) -> Vec<(usize, usize)> {
    let alike = |a: &Receiver, b: &Receiver| {
        let way = b.at - a.at;
        let size = a.at.length().max(b.at.length());
        a.normal.dot(b.normal) > 0.96
            && way.length() < 1.2 * size
            && way.dot(a.normal).abs() < 0.03 * size
            && a.tint.iter().zip(&b.tint).all(|(a, b)| (a - b).abs() < 0.02)
    };
    let mut random = fastrand::Rng::with_seed(1);
    let mut pairs = Vec::new();
    for (a, from) in receivers.iter().enumerate() {
        let mut found = 0;
        for _ in 0..60 {
            let b = random.usize(..receivers.len());
            if b != a && alike(from, &receivers[b]) {
                pairs.push((a, b));
                found += 1;
            }
            if found == 6 {
                break;
            }
        }
    }
    pairs
}

/// Finds the factors that leave the least shading in the reflectance.
fn fit(receivers: &[Receiver], groups: usize) -> Vec<f32> {
    let pairs = pairs(receivers);
    if pairs.len() < 50 {
        return vec![1.0; groups];
    }
    let irradiance = |factors: &[f32]| -> Vec<f32> {
        let of = |r: &Receiver| r.base + r.lamps.iter().zip(factors).map(|(e, s)| e * s).sum::<f32>();
        receivers.iter().map(of).collect()
    };
    let cost = |factors: &[f32]| {
        let light = irradiance(factors);
        let reflectance: Vec<f32> = receivers
            .iter()
            .zip(&light)
            .map(|(r, e)| (std::f32::consts::PI * r.luminance / e.max(1e-12)).max(1e-6).ln())
            .collect();
        // Beyond the threshold a difference hardly counts, as paint has edges of its own.
        let robust = |d: f32| d.abs().min(PAINT) + 0.05 * (d.abs() - PAINT).max(0.0);
        let shading =
            pairs.iter().map(|(a, b)| robust(reflectance[*a] - reflectance[*b])).sum::<f32>() / pairs.len() as f32;
        let over = reflectance.iter().map(|r| (r - WHITEST.ln()).clamp(0.0, 1.0)).sum::<f32>() / receivers.len() as f32;
        let far = factors.iter().map(|s| s.ln()).sum::<f32>();
        shading + 0.5 * over + FAR * far
    };
    let search = |factors: &mut [f32], at: Option<usize>, from: f32, to: f32, steps: i32| {
        let before = factors.to_vec();
        let mut best = (cost(&before), before.clone());
        for step in 0..=steps {
            let ratio = from * (to / from).powf(step as f32 / steps as f32);
            let mut tried = before.clone();
            for (k, factor) in tried.iter_mut().enumerate() {
                if at.is_none_or(|at| at == k) {
                    *factor = (*factor * ratio).clamp(FACTORS[0], FACTORS[1]);
                }
            }
            let cost = cost(&tried);
            if cost < best.0 - 1e-6 {
                best = (cost, tried);
            }
        }
        factors.copy_from_slice(&best.1);
    };
    // All together first, then each, coarsely and finely.
    let mut factors = vec![1.0; groups];
    search(&mut factors, None, 1.0, FACTORS[1], 40);
    for spread in [16.0, 4.0, 2.0, 1.3] {
        for k in 0..groups {
            search(&mut factors, Some(k), 1.0 / spread, spread, 16);
        }
        search(&mut factors, None, 1.0 / spread, spread, 16);
    }
    factors
}
