//! What a panorama's depth says about the room: floor, ceiling, and whether its numbers can be metres.

use super::{
    cloud::{Cloud, plane},
    depth::{DepthEncoding, Rule, length_words as metres, swap_warning, unit, unit_words},
    level::{rotation, upright},
    mapping::{bilinear, texel_direction},
    source::{PanoramaFrame, PanoramaSpec},
};
use glam::{Quat, Vec3};
use serde::Serialize;

/// A large horizontal surface.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct Level {
    /// Metres under the capture point (floor) or over it (ceiling).
    pub distance: f32,
    /// Degrees from horizontal.
    pub tilt: f32,
    /// Unit normal, towards the capture point.
    pub normal: [f32; 3],
    /// The share of the sphere that it covers.
    pub share: f32,
}

impl Level {
    /// Returns the height of its plane at x and z, all relative to the capture point, metres. `None` if it is
    /// no floor.
    pub fn height(&self, x: f32, z: f32) -> Option<f32> {
        let normal = Vec3::from(self.normal);
        // n·p is the same everywhere on the plane, and −n.y·distance straight down.
        (normal.y > 0.5).then(|| (-normal.y * self.distance - normal.x * x - normal.z * z) / normal.y)
    }
}

/// Finds the lowest large horizontal surface under the camera, or the highest over it.
pub fn level(cloud: &Cloud, below: bool) -> Option<Level> {
    let sign = if below { 1.0 } else { -1.0 };
    let up = Vec3::Y * sign;
    let side = |index: &usize| cloud.directions[*index].dot(up) < -0.1 && cloud.normals[*index] != Vec3::ZERO;
    let mut cells: Vec<usize> =
        (0..cloud.depth.len()).filter(|i| side(i) && cloud.normals[*i].dot(up) > 25_f32.to_radians().cos()).collect();
    // The panorama itself may be tilted, so heights are along what most of these normals say.
    let mean = |cells: &[usize]| {
        cells.iter().map(|i| cloud.normals[*i] * cloud.weights[*i]).sum::<Vec3>().try_normalize().unwrap_or(up)
    };
    let mut along = mean(&cells);
    for _ in 0..3 {
        let near: Vec<usize> =
            cells.iter().copied().filter(|i| cloud.normals[*i].dot(along) > 10_f32.to_radians().cos()).collect();
        along = mean(&near);
    }
    cells.retain(|i| cloud.normals[*i].dot(along) > 12_f32.to_radians().cos());
    let distance = |i: usize| -cloud.directions[i].dot(along) * cloud.depth[i];
    // Bins of 4 %, each counted with its neighbours.
    let bin = |i: usize| ((distance(i).max(1e-6).ln() / 0.04).floor()) as i64;
    let mut bins = std::collections::BTreeMap::new();
    for cell in &cells {
        *bins.entry(bin(*cell)).or_insert(0.0_f32) += cloud.weights[*cell];
    }
    let smooth = |at: i64| (at - 1..=at + 1).filter_map(|k| bins.get(&k)).sum::<f32>();
    let most = bins.keys().map(|at| smooth(*at)).fold(0.0, f32::max);
    let total: f32 = cloud.weights.iter().sum();
    if most < 0.005 * total {
        return None;
    }
    // The lowest large one; then the best bin around it.
    let far = bins.keys().rev().copied().find(|at| smooth(*at) >= 0.35 * most)?;
    let peak = (far - 3..=far).max_by(|a, b| smooth(*a).total_cmp(&smooth(*b)))?;
    let centre = (0.04 * (peak as f32 + 0.5)).exp();
    let mut inliers: Vec<usize> = cells.iter().copied().filter(|i| (distance(*i) / centre).ln().abs() < 0.07).collect();
    let mut fitted = along * (-1.0 / centre);
    for tolerance in [0.08, 0.05, 0.04] {
        let samples = inliers.iter().map(|i| (cloud.directions[*i], 1.0 / cloud.depth[*i], cloud.weights[*i]));
        fitted = plane(samples)?;
        inliers = cells
            .iter()
            .copied()
            .filter(|i| (fitted.dot(cloud.directions[*i]) * cloud.depth[*i] - 1.0).abs() < tolerance)
            .collect();
    }
    let (normal, straight) = (-fitted.normalize(), -fitted.dot(up));
    let share = inliers.iter().map(|i| cloud.weights[*i]).sum::<f32>() / total;
    let tilt = normal.dot(up).clamp(-1.0, 1.0).acos().to_degrees();
    (straight > 0.0).then(|| Level { distance: 1.0 / straight, tilt, normal: normal.to_array(), share })
}

/// How far windows of the depth are from planes when `value` is taken for 1/metres: the lower quartile of their
/// deviations, as shares of the value. Most windows hold a corner of the room. NaN if there are too few windows.
pub(super) fn bending(cloud: &Cloud, value: impl Fn(usize) -> f32) -> f32 {
    let mut deviations = Vec::new();
    let [width, height] = cloud.size;
    for row in (height / 8..height - height / 8).step_by((height / 16).max(1)) {
        for column in (0..width).step_by((width / 32).max(1)) {
            let cells: Vec<usize> = cloud.window(row * width + column, (width / 20).max(2)).collect();
            let depths = || cells.iter().map(|i| cloud.depth[*i]);
            let (low, high) = depths().fold((f32::MAX, 0.0_f32), |(a, b), d| (a.min(d), b.max(d)));
            // Edges are no planes.
            if low <= 0.0 || high > 1.6 * low {
                continue;
            }
            let values: Vec<f32> = cells.iter().map(|i| value(*i)).collect();
            let mean = values.iter().sum::<f32>() / values.len() as f32;
            let samples = cells.iter().zip(&values).map(|(cell, value)| (cloud.directions[*cell], *value, 1.0));
            let Some(m) = plane(samples) else { continue };
            let left: f32 =
                cells.iter().zip(&values).map(|(cell, value)| (m.dot(cloud.directions[*cell]) - value).powi(2)).sum();
            deviations.push((left / values.len() as f32).sqrt() / mean);
        }
    }
    if deviations.len() < 12 {
        return f32::NAN;
    }
    deviations.sort_by(f32::total_cmp);
    deviations[deviations.len() / 4]
}

/// Depth that is this far from planes is bent. A wall taken for a piece of a sphere is 0.01 to 0.03 off. Noise
/// is no less far, but by any rule.
pub(super) const BENT: f32 = 0.003;

/// Warns of depth that cannot be what it is said to be, with the line to write. `rule` is the scene's; `None`
/// if the depth is analytic or made in memory.
pub fn depth_warnings(cloud: &Cloud, rule: Option<&Rule>, floor: Option<Level>, subject: &str) -> Vec<String> {
    let (Some(rule), Some(nearest), Some(median)) = (rule, cloud.percentile(0.01), cloud.percentile(0.5)) else {
        return Vec::new();
    };
    let farthest = cloud.percentile(0.99).unwrap_or(median);
    // Of depth that is read the wrong way round nothing else can be said.
    if let Some(swapped) = swap_warning(cloud, rule) {
        return vec![format!("{subject}: {swapped}")];
    }
    let mut warnings = Vec::new();
    let mut warn = |text: String| warnings.push(format!("{subject}: {text}"));
    let range = format!("its depth is from {} to {}", metres(nearest), metres(farthest));
    let height = floor.map(|floor| floor.distance);
    // Without a floor it is told when the frame is loaded.
    let told = unit(nearest, None).is_some();
    let other_unit = unit(nearest, height).filter(|_| rule.encoding != DepthEncoding::Disparity && !told);
    if let Some((factor, unit)) = other_unit {
        warn(unit_words(nearest, farthest, unit, rule.scale * factor));
    } else if rule.encoding == DepthEncoding::Disparity && rule.scale == 1.0 && median < 0.5 {
        let scale = height.map_or(1.5 / f64::from(median), |height| 1.6 / f64::from(height));
        let what = "a disparity without a scale has no metres";
        warn(format!("{range}: {what}; write scale = {scale:.3} if the camera stands 1.6 m over the floor"));
    } else if median < 0.25 || farthest < 1.02 {
        let scale = height.map_or(2.0 / f64::from(median), |height| 1.6 / f64::from(height)) * rule.scale;
        warn(format!(
            "{range}: relative depth has no metres; write scale = {scale:.3} if the camera stands 1.6 m over the floor"
        ));
    }
    let axis = |i: usize| cloud.directions[i].abs().max_element();
    let radial = bending(cloud, |i| 1.0 / cloud.depth[i].max(1e-6));
    match rule.encoding {
        DepthEncoding::Radial => {
            let planar = bending(cloud, |i| axis(i) / cloud.depth[i].max(1e-6));
            if radial > BENT && planar < 0.4 * radial {
                let what = "its walls are bent, and are flat if it holds distances along the axes of cube faces";
                warn(format!("{what}; write encoding = \"planar\""));
            }
        }
        DepthEncoding::Planar => {
            let unbent = bending(cloud, |i| 1.0 / (cloud.depth[i] * axis(i)).max(1e-6));
            if radial > BENT && unbent < 0.4 * radial {
                let what = "its walls are bent, and are flat if it holds radial distances";
                warn(format!("{what}; write encoding = \"radial\""));
            }
        }
        DepthEncoding::Disparity => {}
    }
    warnings
}

/// A floor that is steeper than this is not level, degrees.
const TILTED: f32 = 2.0;

/// Returns the floor's normal if the camera was tilted: the ceiling must be as the floor is, because depth that is wrong
/// tilts each in its own way. Where there is none the floor must be steeper.
fn tilted(floor: Option<Level>, ceiling: Option<Level>) -> Option<Vec3> {
    let floor = floor?;
    let normal = Vec3::from(floor.normal);
    let tilted = match ceiling {
        Some(ceiling) => {
            let apart = (-normal.dot(Vec3::from(ceiling.normal))).clamp(-1.0, 1.0).acos().to_degrees();
            floor.tilt > TILTED && apart < (floor.tilt / 3.0).max(1.0)
        }
        None => floor.tilt > 2.5 * TILTED,
    };
    tilted.then_some(normal)
}

/// Warns of a camera that was tilted. `levels` are the floor and the ceiling, and `spec` says how the panorama is turned now.
pub fn tilt_warning(levels: [Option<Level>; 2], spec: &PanoramaSpec, subject: &str) -> Option<String> {
    let [floor, ceiling] = levels;
    let normal = tilted(floor, ceiling)?;
    let now = Quat::from_rotation_y(spec.yaw_degrees.to_radians()) * rotation(spec.pitch_degrees, spec.roll_degrees);
    let [pitch, roll] = tenths(upright(now.inverse() * normal));
    let what = format!("its floor is tilted by {:.1}°", floor?.tilt);
    Some(format!("{subject}: {what}; to level it, write pitch = {pitch:.1} and roll = {roll:.1} in [panorama]"))
}

/// Returns pitch and roll that level a panorama as it is, if its camera was tilted.
pub fn levelling(cloud: &Cloud) -> Option<[f32; 2]> {
    tilted(level(cloud, true), level(cloud, false)).map(|normal| tenths(upright(normal)))
}

/// Rounds angles to tenths of a degree. Adding 0 makes of −0 a plain one.
fn tenths(degrees: [f32; 2]) -> [f32; 2] {
    degrees.map(|x| (10.0 * x).round() / 10.0 + 0.0)
}

/// Which way round depth is.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Reading {
    /// Near is near.
    Sound,
    /// Surfaces are flat if it is read the other way round.
    Swapped,
}

/// Says whether near and far are swapped: whichever of the two readings makes the large surfaces flatter is right.
/// What is straight down lies farther than what lies ahead in most rooms that are swapped, but in corridors, too.
pub(super) fn reading(cloud: &Cloud) -> Reading {
    let axis = |i: usize| cloud.directions[i].abs().max_element();
    let inverse = |i: usize| 1.0 / cloud.depth[i].max(1e-6);
    let given = bending(cloud, inverse).min(bending(cloud, |i| axis(i) * inverse(i)));
    if given.is_nan() {
        let swapped = is_deep_below(cloud) && level(cloud, true).is_none();
        return if swapped { Reading::Swapped } else { Reading::Sound };
    }
    if given <= BENT {
        return Reading::Sound;
    }
    let disparity = bending(cloud, |i| cloud.depth[i]);
    let part = if is_deep_below(cloud) { 0.85 } else { 0.4 };
    if disparity < part * given || turned_round(cloud) < BENT.min(0.4 * given) {
        return Reading::Swapped;
    }
    Reading::Sound
}

/// How bent surfaces are if depth is a distance that was turned round, with the offset that makes them flattest.
fn turned_round(cloud: &Cloud) -> f32 {
    let (Some(near), Some(far)) = (cloud.percentile(0.0), cloud.percentile(1.0)) else { return f32::NAN };
    let offsets = [0.05, 0.1, 0.2, 0.35, 0.5, 0.75, 1.0].map(|part| far + part * (far - near));
    let bent = offsets.map(|offset| bending(cloud, |i| 1.0 / (offset - cloud.depth[i]).max(1e-6)));
    bent.into_iter().fold(f32::NAN, f32::min)
}

/// Says whether what is straight down lies much farther than what lies ahead.
fn is_deep_below(cloud: &Cloud) -> bool {
    let median = |range: [f32; 2]| {
        let mut depths: Vec<f32> = (0..cloud.depth.len())
            .filter(|i| cloud.depth[*i] > 0.0 && (range[0]..range[1]).contains(&cloud.directions[*i].y))
            .map(|i| cloud.depth[i])
            .collect();
        depths.sort_by(f32::total_cmp);
        (depths.len() > 20).then(|| depths[depths.len() / 2])
    };
    match (median([-1.0, -0.8]), median([-0.2, 0.2])) {
        (Some(down), Some(ahead)) => down > 1.3 * ahead,
        _ => false,
    }
}

/// Where the edges of depth lie on those of colour.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Fit {
    /// How many standard deviations the fit stands out: as it is, and best of all other places.
    pub here: f32,
    pub elsewhere: f32,
    /// Where the best other place is: degrees to the right, and whether left and right are swapped.
    pub degrees: f32,
    pub mirrored: bool,
    /// The same as `here` of the places alone where one surface ends before another; `None` if they are few, or if the
    /// colour has hardly any edges.
    pub steps: Option<f32>,
}

/// The share of the grid that tells how edges fit.
const LEAST_EDGES: usize = 400;
const LEAST_STEPS: usize = 250;

/// Compares the edges of depth with those of colour, turned by any angle and mirrored. `None` if the depth
/// has too few.
pub fn edges(frame: &PanoramaFrame, cloud: &Cloud) -> Option<Fit> {
    let [width, height] = cloud.size;
    let rows = height / 8..height - height / 8;
    let luminance: Vec<f32> = (0..width * height)
        .map(|i| {
            let (column, row) = (i % width, i / width);
            let direction = texel_direction(column as u32, row as u32, [width as u32, height as u32]).as_vec3();
            let color = bilinear(frame, direction);
            (color.dot(Vec3::new(0.2126, 0.7152, 0.0722)) + 0.01).ln()
        })
        .collect();
    let logarithm: Vec<f32> = cloud.depth.iter().map(|d| if *d > 0.0 { d.ln() } else { f32::NAN }).collect();
    // The values to the right and left of a cell, below and above.
    let around = |values: &[f32], i: usize| {
        let (column, row) = (i % width, i / width);
        let across = [(column + 1) % width, (column + width - 1) % width].map(|column| values[row * width + column]);
        let along = [(row + 1).min(height - 1), row.saturating_sub(1)].map(|row| values[row * width + column]);
        (across, along)
    };
    let gradient = |values: &[f32], i: usize| {
        let ([right, left], [below, above]) = around(values, i);
        let size = (right - left).hypot(below - above);
        if size.is_finite() { size } else { 0.0 }
    };
    // Where surfaces end, and not where they recede: on a plane 1/depth is smooth.
    let is_step = |i: &usize| {
        let ([right, left], [below, above]) = around(&cloud.depth, *i);
        let bend = |a: f32, b: f32| (cloud.depth[*i] * (1.0 / a + 1.0 / b) - 2.0).abs();
        let most = bend(right, left).max(bend(below, above));
        most.is_finite() && most > 0.12
    };
    let colour: Vec<f32> = (0..width * height).map(|i| gradient(&luminance, i).min(1.0)).collect();
    let depth: Vec<usize> =
        rows.flat_map(|row| row * width..(row + 1) * width).filter(|i| gradient(&logarithm, *i) > 0.15).collect();
    if depth.len() < width * height / LEAST_EDGES || width < 32 {
        return None;
    }
    let steps: Vec<usize> = depth.iter().copied().filter(is_step).collect();
    let is_clear = colour.iter().filter(|edge| **edge > 0.1).count() > width * height / 10;
    let steps = Some(steps).filter(|steps| is_clear && steps.len() >= width * height / LEAST_STEPS);
    let [here, elsewhere] = fits(&colour, &depth, width)?;
    let turned =
        if elsewhere.shift > width / 2 { elsewhere.shift as f32 - width as f32 } else { elsewhere.shift as f32 };
    Some(Fit {
        here: here.score,
        elsewhere: elsewhere.score,
        degrees: turned * 360.0 / width as f32,
        mirrored: elsewhere.mirrored,
        steps: steps.and_then(|steps| fits(&colour, &steps, width)).map(|[here, _]| here.score),
    })
}

/// How cells fit the colour's edges at one of the places that are tried.
#[derive(Clone, Copy)]
struct Trial {
    /// Standard deviations over the mean of all places.
    score: f32,
    shift: usize,
    mirrored: bool,
}

/// Returns how cells of a grid `width` wide fit edges of colour best: as they are, and turned or mirrored.
fn fits(colour: &[f32], cells: &[usize], width: usize) -> Option<[Trial; 2]> {
    let score = |shift: usize, mirrored: bool| {
        let at = |i: &usize| {
            let (column, row) = (i % width, i / width);
            let column = if mirrored { width - 1 - column } else { column };
            colour[row * width + (column + shift) % width]
        };
        cells.iter().map(at).sum::<f32>() / cells.len() as f32
    };
    let mut all: Vec<Trial> = [false, true]
        .into_iter()
        .flat_map(|mirrored| (0..width).map(move |shift| (shift, mirrored)))
        .map(|(shift, mirrored)| Trial { score: score(shift, mirrored), shift, mirrored })
        .collect();
    let mean = all.iter().map(|trial| trial.score).sum::<f32>() / all.len() as f32;
    let deviation = (all.iter().map(|trial| (trial.score - mean).powi(2)).sum::<f32>() / all.len() as f32).sqrt();
    if deviation <= 0.0 {
        return None;
    }
    all.iter_mut().for_each(|trial| trial.score = (trial.score - mean) / deviation);
    let near = width / 60 + 1;
    let is_here = |trial: &&Trial| !trial.mirrored && (trial.shift <= near || trial.shift >= width - near);
    let best = |here: bool| {
        all.iter().filter(|trial| is_here(trial) == here).max_by(|a, b| a.score.total_cmp(&b.score)).copied()
    };
    Some([best(true)?, best(false)?])
}

/// Depth of another picture stands out by less than this, standard deviations, and that of real pictures by 3.5 and more.
const FITS: f32 = 2.0;

/// Warns of depth that belongs elsewhere in its colour, or to another picture.
pub fn edge_warning(fit: Option<Fit>, subject: &str) -> Option<String> {
    let fit = fit?;
    if fit.here < 2.5 && fit.elsewhere > fit.here + 2.0 && fit.elsewhere > 4.0 {
        let how = match (fit.mirrored, fit.degrees) {
            (true, _) => "mirrored left to right".to_owned(),
            (false, degrees) => format!("turned by {degrees:.0}°"),
        };
        return Some(format!(
            "{subject}: the edges of the depth fit the colour only if one of them is {how}; mend the image that is wrong"
        ));
    }
    fit.steps.filter(|steps| *steps < FITS).map(|_| {
        let what = "the edges of the depth lie nowhere on those of the colour, as if it were turned, mirrored or of another picture";
        format!("{subject}: {what}; check that color and depth name the same view")
    })
}
