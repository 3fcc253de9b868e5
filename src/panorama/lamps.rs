//! Finds small lamps that hang free before what lies behind them: bulbs, candles, lanterns.
//!
//! The capture shows such a lamp by a few texels. As triangles between texel centres most of it would be
//! edges between near and far, and its sides, which the capture does not show, would be as deep as any edge
//! is taken to be. So it becomes an ellipsoid that sends the same radiance everywhere. Seen from the capture
//! point, it covers the solid angle that sends the lamp's light, and it is as deep as it is wide.

use super::{
    depth::Quantisation,
    light::mean_luminance_by,
    mapping::{coordinates, neighbours, texel_direction, wrap},
    source::PanoramaFrame,
};
use glam::{DVec2, DVec3, Vec3, dvec2};
use rayon::prelude::*;
use std::{
    cell::Cell,
    collections::HashMap,
    f64::consts::{PI, TAU},
};

/// The most lamps of a frame, as `MOST_LAMPS` in `lamps.glsl`.
pub const MOST: usize = 32;

/// A lamp is at least this many times as bright as the panorama's mean,
const ABOVE_MEAN: f64 = 3.0;
/// and this many times as bright as what surrounds it.
const ABOVE_AROUND: f64 = 2.0;
/// A texel belongs to the lamp if it has this share of its brightest texel's luminance.
const OF_PEAK: f64 = 0.3;
/// What lies behind a lamp is farther by at least this share of the lamp's distance.
const BEHIND: f64 = 0.03;
/// It lies behind at least this share of what surrounds the lamp. The rest may be what the lamp hangs on.
const FREE: f64 = 0.7;
/// A lamp sends at least this share of the panorama's light. Glints do not.
const WORTH: f64 = 0.002;
/// The largest solid angle of a lamp, sr: 16 degrees across. Of larger ones the capture shows the shape.
const LARGEST: f64 = 0.06;

/// A lamp in the panorama's own frame, metres from the capture point.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Lamp {
    pub center: Vec3,
    /// Its half axes. The last one points at the capture point.
    pub axes: [Vec3; 3],
    /// What it sends.
    pub radiance: Vec3,
    /// The mean radiance of what surrounds it in the capture.
    pub around: Vec3,
    /// The cone of directions in which the capture shows it, with a margin: the unit vector to its middle,
    pub direction: Vec3,
    /// and the two vectors e across it for which e·d/(direction·d) is 1 on the cone.
    pub across: [Vec3; 2],
}

impl Lamp {
    /// Whether a direction of the panorama's frame is in the lamp's cone.
    pub fn hides(&self, direction: Vec3) -> bool {
        let along = direction.dot(self.direction);
        let [x, y] = self.across.map(|e| direction.dot(e));
        along > 0.0 && x * x + y * y < along * along
    }
}

/// The free lamps of a frame, the brightest first.
#[derive(Clone, Debug, Default)]
pub struct FreeLamps {
    pub lamps: Vec<Lamp>,
    /// The depth without them: what lies around is carried on behind them. Empty if there is no lamp.
    pub depth: Vec<f32>,
}

/// Finds the free lamps of a frame.
pub fn find(frame: &PanoramaFrame) -> FreeLamps {
    let mut scan = Scan::new(frame);
    // All are known before any is measured, so that none counts as another's surroundings.
    let cores: Vec<Vec<u32>> = scan.seeds().into_iter().filter_map(|seed| scan.core(seed)).collect();
    let mut found: Vec<(f64, Lamp)> = cores.iter().filter_map(|core| scan.measure(core)).collect();
    found.sort_by(|a, b| b.0.total_cmp(&a.0));
    found.truncate(MOST);
    let lamps: Vec<Lamp> = found.into_iter().map(|(_, lamp)| lamp).collect();
    let depth = if lamps.is_empty() { Vec::new() } else { depth_without(frame, &lamps) };
    FreeLamps { lamps, depth }
}

/// What a texel was found to be: nothing yet, bright but too large for a lamp, or else the number of the lamp to which, or to
/// whose rim, it belongs.
type Seen = u16;
const NO: Seen = 0;
const TOO_LARGE: Seen = Seen::MAX;

struct Scan<'a> {
    frame: &'a PanoramaFrame,
    mean: f64,
    /// The luminances that were asked for, and NaN for others, so that a video's codes are not read twice. Empty if there
    /// are no codes.
    luminances: Vec<Cell<f32>>,
    /// What each texel was found to be.
    seen: Vec<Seen>,
    lamps: Seen,
}

/// The sum of a solid angle's moments, for a mean direction and a shape.
#[derive(Default)]
struct Moments {
    weight: f64,
    first: DVec2,
    second: [f64; 3],
}

impl Moments {
    fn add(&mut self, at: DVec2, weight: f64) {
        self.weight += weight;
        self.first += weight * at;
        self.second[0] += weight * at.x * at.x;
        self.second[1] += weight * at.x * at.y;
        self.second[2] += weight * at.y * at.y;
    }

    /// The mean, and the covariance xx, xy, yy.
    fn spread(&self) -> (DVec2, [f64; 3]) {
        let mean = self.first / self.weight;
        let of = |sum: f64, product: f64| sum / self.weight - product;
        let [xx, xy, yy] = self.second;
        (mean, [of(xx, mean.x * mean.x), of(xy, mean.x * mean.y), of(yy, mean.y * mean.y)])
    }
}

/// The direction of the larger of the two variances of a covariance xx, xy, yy, and both.
fn principal([xx, xy, yy]: [f64; 3]) -> (f64, [f64; 2]) {
    let (middle, root) = (0.5 * (xx + yy), (0.25 * (xx - yy).powi(2) + xy * xy).sqrt());
    (0.5 * (2.0 * xy).atan2(xx - yy), [middle + root, middle - root])
}

/// An ellipse about a direction, in the plane that touches the unit sphere there.
struct Ellipse {
    direction: DVec3,
    /// Unit vectors across, along the longer and the shorter half axis.
    across: [DVec3; 2],
    half: DVec2,
}

impl Ellipse {
    fn place(&self, d: DVec3) -> Option<DVec2> {
        let along = d.dot(self.direction);
        (along > 0.05).then(|| dvec2(d.dot(self.across[0]), d.dot(self.across[1])) / along)
    }

    /// Whether a direction is in the ellipse, grown by a margin.
    fn holds(&self, d: DVec3, margin: f64) -> bool {
        self.place(d).is_some_and(|p| (p / (self.half + margin)).length_squared() < 1.0)
    }
}

fn luminance(texel: &[f32; 4]) -> f32 {
    texel[3] * (0.2126 * texel[0] + 0.7152 * texel[1] + 0.0722 * texel[2])
}

fn solid_angle(row: u32, [width, height]: [u32; 2]) -> f64 {
    let edge = |row: u32| (PI * f64::from(row) / f64::from(height)).cos();
    (edge(row) - edge(row + 1)) * TAU / f64::from(width)
}

/// The texels of an image within an angle of a direction, and some more.
fn texels_near(direction: DVec3, angle: f64, size: [u32; 2]) -> Vec<u32> {
    let [width, height] = size.map(f64::from);
    let at = coordinates(direction);
    let (first, last) = ((at.y - angle / PI) * height - 1.0, (at.y + angle / PI) * height + 1.0);
    let rows = first.max(0.0) as u32..=(last.max(0.0) as u32).min(size[1] - 1);
    let mut texels = Vec::new();
    for row in rows {
        let sine = (PI * (f64::from(row) + 0.5) / height).sin();
        let turn = if sine > 1.5 * angle.sin() { 1.6 * angle / sine } else { PI };
        let half = ((turn / TAU * width).ceil() as i64 + 1).min(i64::from(size[0]) / 2);
        let middle = (at.x * width) as i64;
        let columns =
            if 2 * half >= i64::from(size[0]) { 0..i64::from(size[0]) } else { middle - half..middle + half + 1 };
        texels.extend(columns.map(|column| row * size[0] + column.rem_euclid(i64::from(size[0])) as u32));
    }
    texels
}

impl<'a> Scan<'a> {
    fn new(frame: &'a PanoramaFrame) -> Self {
        // A texel in 0.35° tells the mean.
        let [width, height] = frame.color_size;
        let mean = mean_luminance_by(frame, height.div_ceil(512).min(width) as usize);
        let count = frame.radiance.len();
        let luminances = if frame.radiance.codes().is_some() { vec![Cell::new(f32::NAN); count] } else { Vec::new() };
        Self { frame, mean: f64::from(mean), luminances, seen: vec![NO; count], lamps: 0 }
    }

    fn luminance(&self, texel: u32) -> f32 {
        let kept = self.luminances.get(texel as usize);
        kept.map(Cell::get).filter(|kept| !kept.is_nan()).unwrap_or_else(|| {
            let value = luminance(&self.frame.radiance.at(texel as usize));
            if let Some(kept) = kept {
                kept.set(value);
            }
            value
        })
    }

    fn seen(&self, texel: u32) -> Seen {
        self.seen[texel as usize]
    }

    /// Texels that may be a lamp's, the brightest first.
    fn seeds(&self) -> Vec<u32> {
        let least = (ABOVE_MEAN * self.mean) as f32;
        let mut seeds = self.frame.radiance.brighter(least.max(0.0), luminance);
        for (value, at) in &seeds {
            if let Some(kept) = self.luminances.get(*at as usize) {
                kept.set(*value);
            }
        }
        seeds.par_sort_unstable_by(|a, b| b.0.total_cmp(&a.0).then(a.1.cmp(&b.1)));
        seeds.into_iter().map(|(_, at)| at).collect()
    }

    fn direction(&self, texel: u32) -> DVec3 {
        let size = self.frame.color_size;
        texel_direction(texel % size[0], texel / size[0], size)
    }

    fn solid_angle(&self, texel: u32) -> f64 {
        solid_angle(texel / self.frame.color_size[0], self.frame.color_size)
    }

    /// The depth at a texel's centre; 0 in a hole.
    fn depth(&self, texel: u32) -> f64 {
        let ([width, height], [columns, rows]) = (self.frame.color_size, self.frame.depth_size);
        let at =
            |place: u32, size: u32, depths: u32| (2 * u64::from(place) + 1) * u64::from(depths) / (2 * u64::from(size));
        let (column, row) = (at(texel % width, width, columns), at(texel / width, height, rows));
        f64::from(self.frame.depth[(row * u64::from(columns) + column) as usize])
    }

    /// The connected texels about as bright as the seed. `None` if the seed is known already, or if they
    /// are too many for a lamp.
    fn core(&mut self, seed: u32) -> Option<Vec<u32>> {
        if self.seen(seed) != NO || self.lamps + 1 == TOO_LARGE {
            return None;
        }
        let least = OF_PEAK as f32 * self.luminance(seed);
        self.lamps += 1;
        let own = self.lamps;
        self.seen[seed as usize] = own;
        let (mut core, mut next, mut angle, mut large) = (vec![seed], 0, 0.0, false);
        while next < core.len() && !large {
            let texel = core[next];
            next += 1;
            angle += self.solid_angle(texel);
            large = angle > LARGEST;
            for other in neighbours(texel, self.frame.color_size) {
                if self.luminance(other) < least || self.seen(other) == own {
                    continue;
                }
                // A brighter lamp beside it, or a window of which this is a part.
                large |= self.seen(other) == TOO_LARGE;
                if self.seen(other) == NO {
                    self.seen[other as usize] = own;
                    core.push(other);
                }
            }
        }
        if large {
            core.iter().for_each(|texel| self.seen[*texel as usize] = TOO_LARGE);
            self.lamps -= 1;
            return None;
        }
        // Texels that show a part of the lamp are no lamps of their own.
        let mut rim = core.clone();
        for _ in 0..2 {
            for texel in std::mem::take(&mut rim) {
                for other in neighbours(texel, self.frame.color_size) {
                    if self.seen(other) == NO {
                        self.seen[other as usize] = own;
                        rim.push(other);
                    }
                }
            }
        }
        Some(core)
    }

    /// The ellipse of a core's light, and the angle of a texel.
    fn ellipse(&self, core: &[u32]) -> Option<(Ellipse, f64)> {
        let weight = |texel: u32| f64::from(self.luminance(texel)) * self.solid_angle(texel);
        let direction = core.iter().map(|t| self.direction(*t) * weight(*t)).sum::<DVec3>().try_normalize()?;
        let (x, y) = direction.any_orthonormal_pair();
        let mut moments = Moments::default();
        for texel in core {
            let d = self.direction(*texel);
            let along = d.dot(direction);
            if along < 0.5 {
                return None;
            }
            moments.add(dvec2(d.dot(x), d.dot(y)) / along, weight(*texel));
        }
        let texel = PI / f64::from(self.frame.color_size[1]);
        let (mean, [xx, xy, yy]) = moments.spread();
        // A texel is wide itself.
        let own = self.solid_angle(core[0]) / 12.0;
        let (xx, yy) = (xx + own, yy + own);
        let (angle, [long, short]) = principal([xx, xy, yy]);
        let (sin, cos) = angle.sin_cos();
        let half = dvec2(2.0 * long.sqrt(), 2.0 * short.max(own).sqrt());
        let direction = (direction + x * mean.x + y * mean.y).normalize();
        let first = (x * cos + y * sin).reject_from(direction).normalize();
        Some((Ellipse { direction, across: [first, direction.cross(first)], half }, texel))
    }

    /// Measures a lamp. Returns its power as well, and nothing if it is none that hangs free.
    fn measure(&self, core: &[u32]) -> Option<(f64, Lamp)> {
        let (ellipse, texel) = self.ellipse(core)?;
        // Light and depth reach a little farther than the texels that are mostly lamp.
        let coarser = f64::from(self.frame.color_size[1].div_ceil(self.frame.depth_size[1]));
        let margin = texel * (1.5 + coarser);
        let outer = margin + texel * (1.0 + coarser);
        let size = self.frame.color_size;
        let reach = ellipse.half.x + outer;
        let own = self.seen(core[0]);
        let (mut inside, mut ring) = (Vec::new(), Vec::new());
        for at in texels_near(ellipse.direction, reach, size) {
            let d = self.direction(at);
            let foreign = self.seen(at) != NO && self.seen(at) != own;
            if !ellipse.holds(d, outer) || foreign {
                continue;
            }
            if ellipse.holds(d, margin) { inside.push(at) } else { ring.push(at) }
        }
        let known = |at: &u32| Some(self.depth(*at)).filter(|depth| *depth > 0.0);
        let mut depths: Vec<f64> = core.iter().filter_map(known).collect();
        depths.sort_by(f64::total_cmp);
        let front = *depths.get(depths.len() / 8)?;
        let step = match self.frame.quantisation {
            Quantisation::None => 0.0,
            Quantisation::Disparity { step } => f64::from(step) * front,
            Quantisation::Radial { step } => f64::from(step) / front,
        };
        let least = front * (1.0 + BEHIND.max(2.5 * step));
        let behind: Vec<u32> = ring.iter().copied().filter(|at| known(at).is_none_or(|depth| depth > least)).collect();
        if ring.is_empty() || (behind.len() as f64) < FREE * ring.len() as f64 {
            return None;
        }
        let distances: Vec<f64> = behind.iter().filter_map(known).map(f64::recip).collect();
        let wall =
            if distances.is_empty() { f64::INFINITY } else { distances.len() as f64 / distances.iter().sum::<f64>() };
        // A ball's rim is as far as its middle. What is farther is what lies behind.
        let rim = (front * (1.0 + 1.2 * ellipse.half.y)).max(least).min(0.5 * (front + wall).min(4.0 * front));
        depths.retain(|depth| *depth <= rim);
        if 5 * depths.len() < core.len() {
            return None;
        }

        let radiance = |at: u32| {
            let [r, g, b, factor] = self.frame.radiance.at(at as usize);
            f64::from(factor) * DVec3::new(f64::from(r), f64::from(g), f64::from(b))
        };
        let around = behind.iter().map(|at| radiance(*at)).sum::<DVec3>() / behind.len() as f64;
        let of = |c: DVec3| c.dot(DVec3::new(0.2126, 0.7152, 0.0722));
        // What the lamp adds to what surrounds it: by solid angle, in colour and luminance.
        let (mut power, mut squares, mut added) = (0.0, 0.0, DVec3::ZERO);
        let mut moments = Moments::default();
        for at in &inside {
            let (excess, weight) = (radiance(*at) - around, self.solid_angle(*at));
            let bright = of(excess).max(0.0);
            power += bright * weight;
            squares += bright * bright * weight;
            added += excess * weight;
            if let Some(place) = ellipse.place(self.direction(*at)) {
                moments.add(place, bright * weight);
            }
        }
        let bright = squares / power;
        if power < WORTH * 4.0 * PI * self.mean {
            return None;
        }
        if !(bright > (ABOVE_AROUND - 1.0) * of(around) && bright > ABOVE_MEAN * self.mean && power > 0.0) {
            return None;
        }
        let covered = power / bright;
        // A lamp that is bent or branched is no ellipse.
        let drawn = PI * ellipse.half.x * ellipse.half.y;
        if covered > LARGEST || drawn > 2.0 * covered + 4.0 * texel * texel {
            return None;
        }
        let sent = around + (added / covered).max(DVec3::ZERO);
        // The half axes of the cone that covers this much, in the ellipse's shape.
        let radius = (1.0 - (1.0 - covered / TAU).powi(2)).sqrt();
        let (middle, spread) = moments.spread();
        let (angle, [long, short]) = principal(spread);
        // Texels tell little of the shape of a lamp of a few: it is round unless they say that it is not.
        let box_filter = self.solid_angle(core[0]) / 12.0;
        let round = long - short < 0.2 * short + 4.0 * box_filter;
        let short = (short - box_filter).max(0.5 * box_filter);
        let shape = if round { 1.0 } else { ((long - box_filter) / short).max(1.0).powf(0.25) };
        let half = dvec2(radius * shape, radius / shape);
        let (mean, first) = (depths.iter().sum::<f64>() / depths.len() as f64, depths[0]);
        // Over a ball's disc the depth's mean is 1/3 of its radius behind the nearest point.
        let distance = mean + 2.0 * (mean - first).clamp(0.0, half.y * mean / 3.0);
        let distance = distance.min(0.995 * wall);
        let depth = (half.y * distance).min(0.9 * (wall - distance)).min(0.9 * distance);
        let [x, y] = ellipse.across;
        let direction = (ellipse.direction + x * middle.x + y * middle.y).normalize();
        let first = (x * angle.cos() + y * angle.sin()).reject_from(direction).normalize();
        let axes = [first * (half.x * distance), direction.cross(first) * (half.y * distance), direction * depth];
        let margins = ellipse.half + margin;
        let lamp = Lamp {
            center: (direction * distance).as_vec3(),
            axes: axes.map(|axis| axis.as_vec3()),
            radiance: sent.as_vec3(),
            around: around.as_vec3(),
            direction: ellipse.direction.as_vec3(),
            across: [x / margins.x, y / margins.y].map(|e| e.as_vec3()),
        };
        Some((power, lamp))
    }
}

/// The depth with what lies around each lamp carried on behind it. Of a plane 1/depth is linear in the
/// direction, so it is made as smooth as it can be.
fn depth_without(frame: &PanoramaFrame, lamps: &[Lamp]) -> Vec<f32> {
    let size = frame.depth_size;
    let mut depth = frame.depth.clone();
    for lamp in lamps {
        let reach = lamp.across.map(|e| f64::from(e.length()).recip()).into_iter().fold(0.0, f64::max).atan();
        let texel = PI / f64::from(size[1]);
        let direction = lamp.direction.as_dvec3();
        let hidden: Vec<u32> = texels_near(direction, reach + texel, size)
            .into_iter()
            .filter(|at| lamp.hides(texel_direction(at % size[0], at / size[0], size).as_vec3()))
            .collect();
        let least = f64::from(lamp.center.length()) * (1.0 + 0.5 * BEHIND);
        let at_edge = |at: u32, depth: &[f32]| {
            let (column, row) = (i64::from(at % size[0]), i64::from(at / size[0]));
            [(-1, 0), (1, 0), (0, -1), (0, 1)].map(|(x, y)| {
                let (column, row) = wrap(column + x, row + y, size);
                let other = row * size[0] + column;
                (other, depth[other as usize])
            })
        };
        let own: HashMap<u32, usize> = hidden.iter().enumerate().map(|(k, at)| (*at, k)).collect();
        // Each texel's neighbours: of the hidden ones their number, of the others 1/depth if it lies behind.
        let neighbours: Vec<Vec<Result<usize, f64>>> = hidden
            .iter()
            .map(|at| {
                let all = at_edge(*at, &depth).into_iter().filter_map(|(other, depth)| match own.get(&other) {
                    Some(k) => Some(Ok(*k)),
                    None => (f64::from(depth) > least).then(|| Err(f64::from(depth).recip())),
                });
                all.collect()
            })
            .collect();
        let known: Vec<f64> = neighbours.iter().flatten().filter_map(|n| n.err()).collect();
        if known.is_empty() {
            hidden.iter().for_each(|at| depth[*at as usize] = 0.0);
            continue;
        }
        let mut inverse = vec![known.iter().sum::<f64>() / known.len() as f64; hidden.len()];
        // Successive over-relaxation of Laplace's equation.
        let sweeps = 20 + 4 * (hidden.len() as f64).sqrt() as usize;
        for _ in 0..sweeps {
            for (k, around) in neighbours.iter().enumerate().filter(|(_, around)| !around.is_empty()) {
                let sum: f64 =
                    around.iter().map(|other| other.map_or_else(|known| known, |other| inverse[other])).sum();
                inverse[k] += 1.7 * (sum / around.len() as f64 - inverse[k]);
            }
        }
        for (at, inverse) in hidden.iter().zip(&inverse) {
            depth[*at as usize] = inverse.recip() as f32;
        }
    }
    depth
}
