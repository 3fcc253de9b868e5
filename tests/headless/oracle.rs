//! Where a ray meets the panorama's surface, in double precision, by asking every triangle of the definition in `docs/pipeline.md`; no pyramid.

use glam::{DVec2, DVec3};
use iprt::{
    panorama::{
        mapping::{panorama_to_world, texel_direction},
        source::PanoramaFrame,
    },
    passes::trace_rays::{FREE, RayAnswer, SKIRT, SURFACE, TracedRay, UNSEEN},
    settings::{Method, Settings},
};

/// Of vertex and origin distance: how near an edge a ray must pass to be counted apart. Single precision knows places to 1e-7 of that.
pub const TOLERANCE: f64 = 1e-5;
/// A thing that is wider is as deep as one of this width, metres.
const WIDE: f64 = 1.4;
/// Of the panorama about +Y, degrees.
pub const YAW: f32 = 37.0;

pub struct Triangle {
    corners: [DVec3; 3],
    depths: [f64; 3],
    /// Texel columns and rows of the corners; rows -1 and H are the poles.
    texels: [[i64; 2]; 3],
    /// How deep the thing is that ends at each corner, by its width; `None` where rounding decides.
    deep: [Option<f64>; 3],
}

/// Triangles side by side, and a sphere around them.
pub struct Patch {
    centre: DVec3,
    radius: f64,
    pub triangles: Vec<Triangle>,
}

pub struct Oracle {
    pub size: [u32; 2],
    pub patches: Vec<Patch>,
}

/// Where a ray meets a triangle, or passes it within the tolerance.
pub struct Crossing<'a> {
    pub t: f64,
    /// What t is uncertain by for a ray within the tolerance of this one.
    pub uncertain: f64,
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

pub struct Verdict<'a> {
    pub kind: u32,
    pub t: f64,
    allowed: f64,
    pub unknown: bool,
    triangle: Option<&'a Triangle>,
}

/// How deep skirts are by `edge_depth`, at each texel: see `docs/pipeline.md`. 0 where there is no edge, infinite where
/// a plane goes on at a grazing angle, which is no skirt, `None` where rounding decides.
fn edge_depths(frame: &PanoramaFrame, edge_ratio: f64, poles: [f64; 2]) -> Vec<Option<f64>> {
    let [width, height] = frame.depth_size.map(i64::from);
    let depth = |i: i64, j: i64| match j {
        -1 => poles[0],
        j if j == height => poles[1],
        _ => f64::from(frame.depth[(j * width + i.rem_euclid(width)) as usize]),
    };
    let point = |i: i64, j: i64| texel_direction(i.rem_euclid(width) as u32, j as u32, frame.depth_size) * depth(i, j);
    let near = |a: f64, b: f64| (a - b).abs() < 2e-5 * a.max(b);
    let at = |i: i64, j: i64| -> Option<f64> {
        let own = depth(i, j);
        let farthest = (0..9).map(|k| depth(i + k % 3 - 1, (j + k / 3 - 1).clamp(-1, height))).fold(0.0, f64::max);
        if own <= 0.0 || near(farthest, own * (1.0 + edge_ratio)) {
            return if own <= 0.0 { Some(0.0) } else { None };
        }
        if farthest <= own * (1.0 + edge_ratio) {
            return Some(0.0);
        }
        // Outward is where most of what is farther lies, up to two texels away, but for a plane that goes on.
        let (mut outward, mut spread, mut ends) = (DVec2::ZERO, 0.0, false);
        for (x, y) in (-2..=2).flat_map(|y| (-2..=2).map(move |x| (x, y))) {
            let at = |x: i64, y: i64| depth(i + x, (j + y).clamp(-1, height));
            let (there, opposite) = (at(x, y), at(-x, -y));
            let onward = 2.0 / own - 1.0 / if opposite > 0.0 { opposite } else { own };
            if near(there, own * (1.0 + edge_ratio)) {
                return None;
            }
            if there > own * (1.0 + edge_ratio) {
                if (1.0 / there - 0.8 * onward).abs() < 2e-5 / own {
                    return None;
                }
                if 1.0 / there < 0.8 * onward {
                    let offset = DVec2::new(x as f64, y as f64);
                    (outward, spread) = (outward + offset, spread + offset.length());
                    ends |= x.abs() < 2 && y.abs() < 2;
                }
            }
        }
        if !ends {
            return Some(f64::INFINITY);
        }
        // The end of a walk over the thing from a texel, up to a width, and how many steps away it is. `None` where
        // rounding decides.
        let walk = |(i, j): (i64, i64), way: DVec2, most: f64| -> Option<(DVec3, i64)> {
            let (start, mut last, mut depth_there, mut far, mut before) = (point(i, j), point(i, j), depth(i, j), 0, 0);
            for _ in 0..40 {
                if 4 * far >= width {
                    break;
                }
                far += (far / 8).max(1);
                let at = way * far as f64;
                if [at.x, at.y].iter().any(|a| ((a - a.floor()) - 0.5).abs() < 1e-4) {
                    return None;
                }
                let (x, y) = (i + at.x.round() as i64, j + at.y.round() as i64);
                if !(0..height).contains(&y) {
                    break;
                }
                let (there, ratio) = (depth(x, y), 1.0 + edge_ratio * ((far - before) as f64).min(5.0));
                if near(there, depth_there * ratio) || near(there * ratio, depth_there) {
                    return None;
                }
                if there <= 0.0 || there > depth_there * ratio {
                    break;
                }
                if there * ratio < depth_there {
                    continue;
                }
                (depth_there, before, last) = (there, far, point(x, y));
                if near(last.distance(start), most) {
                    return None;
                }
                if last.distance(start) > most {
                    break;
                }
            }
            Some((last, before))
        };
        if near(outward.length(), 0.25 * spread) {
            return None;
        }
        let mut centre = (i, j);
        if outward.length() > 0.25 * spread {
            let way = -outward.normalize();
            let half = (walk(centre, way, WIDE)?.1 / 2) as f64;
            if [way.x * half, way.y * half].iter().any(|a| ((a - a.floor()) - 0.5).abs() < 1e-4) {
                return None;
            }
            let middle = (i + (way.x * half).round() as i64, j + (way.y * half).round() as i64);
            if depth(middle.0, middle.1) > 0.0 {
                centre = middle;
            }
        }
        let texel = depth(centre.0, centre.1) * std::f64::consts::PI / height as f64;
        let mut thing = WIDE;
        for way in [(1.0, 0.0), (0.0, 1.0), (1.0, 1.0), (1.0, -1.0)].map(DVec2::from) {
            let ends = walk(centre, way, thing)?.0.distance(walk(centre, -way, thing)?.0);
            thing = thing.min(ends + texel);
        }
        // Rounded down to 1 or 1.5 times a power of two, from 1/64 m on.
        let deep = thing.min(0.1 + 0.25 * thing);
        let steps: Vec<f64> =
            (0..14).map(|k| (1.0 + 0.5 * f64::from(k % 2)) * f64::from(1 << (k / 2)) / 64.0).collect();
        if deep > 0.0157 && steps.iter().any(|step| near(deep, *step)) || near(deep, 0.0157) {
            return None;
        }
        Some(steps.into_iter().rev().find(|step| *step <= deep).unwrap_or(1.0 / 64.0))
    };
    (0..height).flat_map(|j| (0..width).map(move |i| (i, j))).map(|(i, j)| at(i, j)).collect()
}

impl Triangle {
    /// How far from the centre the triangle is hit if it is a skirt.
    fn reach(&self, settings: &Settings) -> Option<f64> {
        let near = self.depths.iter().fold(f64::INFINITY, |near, depth| near.min(*depth));
        if !settings.edge_depth {
            return Some(near + f64::from(settings.thickness));
        }
        // Of corners as near as each other the one with the least depth behind it counts.
        let close = |k: &usize| self.depths[*k] < near * (1.0 + 4e-6);
        let deep: Vec<f64> = (0..3).filter(close).map(|k| self.deep[k]).collect::<Option<_>>()?;
        let exact = (0..3).filter(close).all(|k| self.depths[k] == near);
        let least = deep.iter().fold(f64::INFINITY, |a, b| a.min(*b));
        (exact || deep.iter().all(|d| *d == least)).then_some(near + least)
    }
}

impl Oracle {
    pub fn new(frame: &PanoramaFrame) -> Self {
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
        let deep = edge_depths(frame, f64::from(Settings::of(Method::Iprt).edge_ratio), poles);
        let deep_at = |[i, j]: [i64; 2]| match (0..height).contains(&j) {
            true => deep[(j * width + i % width) as usize],
            false => Some(0.25),
        };
        let triangle = |texels: [[i64; 2]; 3]| {
            let corners = texels.map(|[i, j]| vertex(i, j));
            let near = corners.iter().fold(f64::INFINITY, |n, c| n.min(c.1));
            (near > 0.0).then(|| Triangle {
                corners: corners.map(|c| c.0),
                depths: corners.map(|c| c.1),
                texels: texels.map(|[i, j]| [i % width, j]),
                deep: texels.map(deep_at),
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
    pub fn crossings(&self, ray: &TracedRay) -> Vec<Crossing<'_>> {
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
pub fn cross(triangle: &Triangle, origin: DVec3, d: DVec3) -> Option<Crossing<'_>> {
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
pub fn judge<'a>(crossings: &[Crossing<'a>], settings: &Settings) -> Option<Verdict<'a>> {
    let mut verdict = Verdict { kind: FREE, t: f64::INFINITY, allowed: 0.0, unknown: false, triangle: None };
    for crossing in crossings {
        // beyond what was hit nothing matters
        if crossing.t - crossing.uncertain > verdict.t {
            continue;
        }
        let depths = crossing.triangle.depths;
        let (near, far) = (depths[0].min(depths[1]).min(depths[2]), depths[0].max(depths[1]).max(depths[2]));
        let limit = near * (1.0 + f64::from(settings.edge_ratio));
        let end = if far > limit { crossing.triangle.reach(settings)? } else { f64::INFINITY };
        let skirt = far > limit && !(settings.edge_depth && end.is_infinite());
        let wall = near + f64::from(settings.thickness);
        let beyond = skirt && crossing.radius > end;
        let unsure = crossing.at_edge
            || crossing.edge_on
            || (far - limit).abs() < 1e-5 * far
            || skirt && (crossing.radius - end).abs() < crossing.uncertain
            || skirt && (crossing.radius - wall).abs() < crossing.uncertain
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
            let unseen = skirt && settings.edge_depth && crossing.radius > wall;
            let kind = if unseen {
                UNSEEN
            } else if skirt {
                SKIRT
            } else {
                SURFACE
            };
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
pub fn fault(answer: &RayAnswer, verdict: &Verdict<'_>, size: [u32; 2]) -> Option<&'static str> {
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
