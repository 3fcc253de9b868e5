//! `bench --rays` measures how many rays a second the panorama's tracer answers, by kind of ray and by size
//! of the depth map. It also measures what preparing a video frame for the tracer costs.

use crate::{
    Error, Result,
    gpu::Gpu,
    panorama::{
        mapping::{panorama_to_world, texel_direction},
        source::PanoramaFrame,
    },
    passes::trace_rays::{FREE, RayAnswer, RaySet, RayTracer, TracedRay, Tracer},
    scene::Scene,
    settings::Settings,
};
use glam::{DMat3, DVec2, DVec3};
use serde::Serialize;
use std::{
    f64::consts::{FRAC_1_SQRT_2, TAU},
    fmt::Write,
};

use super::clock::quantile;

/// Columns and rows of each set's picture. There is one ray for each pixel, in tiles of 8×8 like a workgroup.
const PICTURE: [u32; 2] = [512, 256];

/// The names of the kinds of rays.
pub const SETS: [&str; 3] = ["coherent", "cosine", "silhouettes"];

/// Number of steps of the march that is measured beside the exact tracer.
const MARCH_STEPS: u32 = 32;

/// The tracers and their names.
const TRACERS: [(&str, Tracer); 2] = [("surface", Tracer::Surface), ("march", Tracer::March(MARCH_STEPS))];

/// The rate of one tracer for one kind of ray.
#[derive(Clone, Debug, Serialize)]
pub struct SetRate {
    /// One of [`SETS`].
    pub name: &'static str,
    /// `surface` is exact, `march` goes in steps through the depth.
    pub tracer: &'static str,
    /// Million rays a second of GPU time, as the median over the repetitions.
    pub mrays_per_second: f64,
    /// The rate of the slowest repetition.
    pub slowest: f64,
    /// The rate of the fastest repetition.
    pub fastest: f64,
    /// The share of the rays that hit something.
    pub hits: f64,
    /// The share of the rays for which this tracer gives the same answer as `surface`: both are free, or both
    /// hit at distances that differ by at most 2 %.
    pub same: f64,
}

/// The results for one size of the depth map.
#[derive(Clone, Debug, Serialize)]
pub struct SizeRates {
    /// Width and height, texels.
    pub size: [u32; 2],
    /// Median time of `normals` in milliseconds, once a video frame.
    pub normals_ms: f64,
    /// Median time of `depth_pyramid` in milliseconds, once a video frame.
    pub depth_pyramid_ms: f64,
    /// Number of bytes that `depth_pyramid` writes.
    pub pyramid_bytes: u64,
    /// The sets of rays. A scene without depth edges has no silhouettes.
    pub sets: Vec<SetRate>,
}

/// The content of the file that `bench --rays --json` writes.
#[derive(Clone, Debug, Serialize)]
pub struct RaysReport {
    /// Vulkan device name.
    pub device: String,
    /// Driver name and version.
    pub driver: String,
    /// Scene name.
    pub scene: String,
    /// Number of rays in a set.
    pub rays: u32,
    /// How often each set was traced.
    pub repetitions: u32,
    /// The sizes in the order in which they were asked for.
    pub sizes: Vec<SizeRates>,
}

/// Measures the first frame of the scene's panorama, with its depth resampled to each of `sizes`. Sizes and
/// sets take turns, so that a slow minute of the machine hits all of them. `progress` is called `repetitions
/// · sizes` times.
pub fn run(
    gpu: &Gpu,
    scene: &Scene,
    settings: &Settings,
    sizes: &[[u32; 2]],
    repetitions: u32,
    mut progress: impl FnMut(),
) -> Result<RaysReport> {
    struct SizeRun {
        size: [u32; 2],
        tracers: Vec<(&'static str, RayTracer)>,
        sets: Vec<(&'static str, RaySet, [Vec<f64>; TRACERS.len()])>,
        normals: Vec<f64>,
        pyramid: Vec<f64>,
    }
    let (frame, yaw_degrees) = (scene.panorama.load(0)?, scene.panorama.yaw_degrees);
    let mut cases = Vec::new();
    for &size in sizes {
        let depth = resample(&frame, size)?;
        let surface = DepthMesh { size, depth: &depth.depth, yaw_degrees, edge_ratio: f64::from(settings.edge_ratio) };
        let tracers = TRACERS.map(|(name, kind)| Ok((name, RayTracer::new(gpu, &depth, yaw_degrees, settings, kind)?)));
        let tracers = tracers.into_iter().collect::<Result<Vec<_>>>()?;
        let mut sets = Vec::new();
        for (name, rays) in SETS.into_iter().zip([surface.coherent(), surface.cosine(), surface.silhouettes()]) {
            if !rays.is_empty() {
                let set = tracers[0].1.rays(&rays)?;
                for (_, tracer) in &tracers {
                    tracer.trace(&set)?; // the first is slower: pages are touched, shaders compiled
                }
                sets.push((name, set, std::array::from_fn(|_| Vec::new())));
            }
        }
        cases.push(SizeRun { size, tracers, sets, normals: Vec::new(), pyramid: Vec::new() });
    }
    for _ in 0..repetitions {
        for case in &mut cases {
            let timings = case.tracers[0].1.prepare()?;
            case.normals.push(timings.pass("normals").unwrap_or_default());
            case.pyramid.push(timings.pass("depth_pyramid").unwrap_or_default());
            for (_, set, rates) in &mut case.sets {
                for ((_, tracer), rates) in case.tracers.iter().zip(rates) {
                    rates.push(f64::from(set.count()) / (tracer.trace(set)? * 1e3));
                }
            }
            progress();
        }
    }
    let mut report = RaysReport {
        device: gpu.device_name().to_owned(),
        driver: gpu.driver().to_owned(),
        scene: scene.name.clone(),
        rays: PICTURE[0] * PICTURE[1],
        repetitions,
        sizes: Vec::new(),
    };
    for mut case in cases {
        let mut sets = Vec::new();
        for (name, set, rates) in case.sets {
            let mut exact = Vec::new();
            for ((tracer, traced), mut rates) in case.tracers.iter().zip(rates) {
                traced.trace(&set)?;
                let answers = traced.answers(&set)?;
                if exact.is_empty() {
                    exact = answers.clone();
                }
                let share = |count: usize| count as f64 / answers.len() as f64;
                let same = |(a, b): &(&RayAnswer, &RayAnswer)| {
                    (a.kind == FREE) == (b.kind == FREE) && (a.kind == FREE || (a.t - b.t).abs() <= 0.02 * b.t)
                };
                sets.push(SetRate {
                    name,
                    tracer,
                    mrays_per_second: quantile(&mut rates, 0.5), // sorts
                    slowest: rates[0],
                    fastest: rates[rates.len() - 1],
                    hits: share(answers.iter().filter(|a| a.kind != FREE).count()),
                    same: share(answers.iter().zip(&exact).filter(same).count()),
                });
            }
        }
        report.sizes.push(SizeRates {
            size: case.size,
            normals_ms: quantile(&mut case.normals, 0.5),
            depth_pyramid_ms: quantile(&mut case.pyramid, 0.5),
            pyramid_bytes: case.tracers[0].1.pyramid_bytes(),
            sets,
        });
    }
    Ok(report)
}

impl RaysReport {
    /// The report as a table for people.
    pub fn table(&self) -> String {
        let mut out = String::new();
        let _ = writeln!(out, "{} ({}), {}", self.device, self.driver, self.scene);
        let _ = writeln!(
            out,
            "million rays a second: median (slowest–fastest) of {} times {} rays; same: least share of answers that are surface's\n\
             (free, or within 2 % of its distance); milliseconds a video frame: medians",
            self.repetitions, self.rays
        );
        let _ = write!(out, "{:<12}{:<9}", "depth map", "tracer");
        for name in SETS {
            let _ = write!(out, "{name:>22}");
        }
        let _ = writeln!(out, "{:>8}{:>10}{:>15}{:>8}", "same", "normals", "depth_pyramid", "MiB");
        for row in &self.sizes {
            for (tracer, _) in TRACERS {
                let _ = write!(out, "{:<12}{tracer:<9}", format!("{}×{}", row.size[0], row.size[1]));
                let mut same: f64 = 1.0;
                for name in SETS {
                    let set = row.sets.iter().find(|set| set.name == name && set.tracer == tracer);
                    same = set.map_or(same, |set| same.min(set.same));
                    let cell = set.map_or("none".to_owned(), |set| {
                        format!("{:.3} ({:.3}–{:.3})", set.mrays_per_second, set.slowest, set.fastest)
                    });
                    let _ = write!(out, "{cell:>22}");
                }
                let _ = write!(out, "{:>6.1} %", 100.0 * same);
                let mebibytes = row.pyramid_bytes as f64 / f64::from(1 << 20);
                let _ = match tracer {
                    "surface" => {
                        writeln!(out, "{:>10.1}{:>15.1}{mebibytes:>8.1}", row.normals_ms, row.depth_pyramid_ms)
                    }
                    _ => writeln!(out),
                };
            }
        }
        out
    }
}

/// Resamples the frame's depth to another size, with black radiance. Inverse depth is linear in direction on
/// planes, so it is interpolated between texels that belong together. At an edge the nearest texel is taken,
/// so that no edge is smeared.
pub(super) fn resample(frame: &PanoramaFrame, size: [u32; 2]) -> Result<PanoramaFrame> {
    let [width, height] = frame.depth_size;
    if size.contains(&0) || size.iter().any(|n| *n > 1 << 15) {
        let problem = format!("a depth map cannot be {}×{}", size[0], size[1]);
        return Err(Error::input("--depth-sizes", problem, "both must be from 1 to 32768"));
    }
    let texel = |x: i64, y: i64| {
        let (x, y) = crate::panorama::mapping::wrap(x, y, [width, height]);
        f64::from(frame.depth[(y * width + x) as usize])
    };
    let mut depth = Vec::with_capacity(size[0] as usize * size[1] as usize);
    for j in 0..size[1] {
        for i in 0..size[0] {
            let x = (f64::from(i) + 0.5) / f64::from(size[0]) * f64::from(width) - 0.5;
            let y = (f64::from(j) + 0.5) / f64::from(size[1]) * f64::from(height) - 0.5;
            let (x0, y0) = (x.floor() as i64, y.floor() as i64);
            let (fx, fy) = (x - x.floor(), y - y.floor());
            let four = [texel(x0, y0), texel(x0 + 1, y0), texel(x0, y0 + 1), texel(x0 + 1, y0 + 1)];
            let (near, far) = four.iter().fold((f64::INFINITY, 0.0f64), |(n, f), d| (n.min(*d), f.max(*d)));
            let value = if near > 0.0 && far <= 1.1 * near {
                let row = |a: f64, b: f64| (1.0 - fx) / a + fx / b;
                1.0 / ((1.0 - fy) * row(four[0], four[1]) + fy * row(four[2], four[3]))
            } else {
                texel(x.round() as i64, y.round() as i64)
            };
            depth.push(value as f32);
        }
    }
    Ok(PanoramaFrame {
        color_size: [1, 1],
        radiance: vec![[0.0; 4]].into(),
        depth_size: size,
        depth,
        quantisation: frame.quantisation,
        warnings: Vec::new(),
        white: None,
        taken: Default::default(),
    })
}

/// A depth map as a mesh. It makes the rays.
struct DepthMesh<'a> {
    size: [u32; 2],
    depth: &'a [f32],
    yaw_degrees: f32,
    edge_ratio: f64,
}

impl DepthMesh<'_> {
    fn vertex(&self, i: u32, j: u32) -> (DVec3, f64) {
        let depth = f64::from(self.depth[(j * self.size[0] + i % self.size[0]) as usize]);
        let direction = panorama_to_world(texel_direction(i % self.size[0], j, self.size), self.yaw_degrees.into());
        (direction * depth, depth)
    }

    /// Returns a point on the surface near a place in the image (0..1), and the normal that points to the
    /// centre. There is none at holes and edges.
    fn point(&self, uv: DVec2, random: &mut fastrand::Rng) -> Option<(DVec3, DVec3)> {
        let i = (uv.x * f64::from(self.size[0])) as u32 % self.size[0];
        let j = ((uv.y * f64::from(self.size[1])) as u32).min(self.size[1].checked_sub(2)?);
        let corners = [self.vertex(i, j), self.vertex(i, j + 1), self.vertex(i + 1, j + 1)];
        let depths = corners.map(|(_, depth)| depth);
        let (near, far) = (depths[0].min(depths[1]).min(depths[2]), depths[0].max(depths[1]).max(depths[2]));
        if near <= 0.0 || far > near * (1.0 + self.edge_ratio) {
            return None;
        }
        let [a, b, c] = corners.map(|(position, _)| position);
        let (s, t) = (random.f64().sqrt(), random.f64());
        let point = a * (1.0 - s) + b * (s * (1.0 - t)) + c * (s * t);
        let normal = (b - a).cross(c - a).normalize();
        Some((point, if normal.dot(point) > 0.0 { -normal } else { normal }))
    }

    /// Calls `ray` with the place (0..1) of every pixel of the picture, tile by tile.
    fn tiles(ray: impl FnMut(DVec2) -> Option<TracedRay>) -> Vec<TracedRay> {
        let pixel = |k: u32| {
            let (tile, within) = (k / 64, k % 64);
            let across = PICTURE[0] / 8;
            let (x, y) = (tile % across * 8 + within % 8, tile / across * 8 + within / 8);
            DVec2::new((f64::from(x) + 0.5) / f64::from(PICTURE[0]), (f64::from(y) + 0.5) / f64::from(PICTURE[1]))
        };
        (0..PICTURE[0] * PICTURE[1]).map(pixel).filter_map(ray).collect()
    }

    /// Maps a pixel of an equal-area picture of all directions to its place in the panorama.
    fn equal_area(pixel: DVec2) -> DVec2 {
        DVec2::new(pixel.x, (1.0 - 2.0 * pixel.y).acos() / std::f64::consts::PI)
    }

    /// Rays of a camera that stands a third of the way from the centre to what lies ahead. Its picture is 60°
    /// high.
    fn coherent(&self) -> Vec<TracedRay> {
        let ahead = self.vertex(self.size[0] / 2, self.size[1] / 2).0;
        let forward = ahead.normalize_or(DVec3::NEG_Z);
        let right = forward.cross(DVec3::Y).normalize_or(DVec3::X);
        let axes = DMat3::from_cols(right, right.cross(forward), forward);
        let tan = 30f64.to_radians().tan();
        let aspect = f64::from(PICTURE[0]) / f64::from(PICTURE[1]);
        Self::tiles(|p| {
            let d = axes * DVec3::new((2.0 * p.x - 1.0) * tan * aspect, (1.0 - 2.0 * p.y) * tan, 1.0);
            Some(ray(ahead / 3.0, d))
        })
    }

    /// Cosine-distributed rays from the surface in each direction from the centre.
    fn cosine(&self) -> Vec<TracedRay> {
        let mut random = fastrand::Rng::with_seed(1);
        Self::tiles(|p| {
            let (point, normal) = self.point(Self::equal_area(p), &mut random)?;
            let (u, phi) = (random.f64(), TAU * random.f64());
            let (tangent, other) = normal.any_orthonormal_pair();
            let d = tangent * (u.sqrt() * phi.cos()) + other * (u.sqrt() * phi.sin()) + normal * (1.0 - u).sqrt();
            Some(ray(point + normal * (2e-3 * point.length()), d))
        })
    }

    /// Rays from the same points past foreground edges, at most a texel away from them.
    fn silhouettes(&self) -> Vec<TracedRay> {
        let mut edges = Vec::new();
        for j in 0..self.size[1] {
            for i in 0..self.size[0] {
                let ((a, near), (_, far)) = (self.vertex(i, j), self.vertex(i + 1, j));
                if near > 0.0 && far > near * (1.0 + self.edge_ratio) {
                    edges.push(a);
                }
            }
        }
        let mut random = fastrand::Rng::with_seed(2);
        if edges.is_empty() {
            return Vec::new();
        }
        Self::tiles(|p| {
            let (point, normal) = self.point(Self::equal_area(p), &mut random)?;
            let edge = edges[(random.f64() * edges.len() as f64) as usize];
            let texel = TAU / f64::from(self.size[0]) * edge.length() * FRAC_1_SQRT_2;
            let jitter = DVec3::from_array(std::array::from_fn(|_| 2.0 * random.f64() - 1.0)) * texel;
            let origin = point + normal * (2e-3 * point.length());
            Some(ray(origin, edge + jitter - origin))
        })
    }
}

fn ray(origin: DVec3, direction: DVec3) -> TracedRay {
    let direction = direction.normalize_or(DVec3::X).as_vec3();
    TracedRay { origin: origin.as_vec3(), t_min: 0.0, direction, t_max: 1e30 }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::panorama::depth::box_depth;
    use glam::vec3;

    fn room(size: [u32; 2]) -> PanoramaFrame {
        let depth = box_depth(size, vec3(6.0, 3.0, 4.0), vec3(0.5, 0.0, 0.3), 0.0);
        PanoramaFrame { depth_size: size, depth, ..PanoramaFrame::default() }
    }

    #[test]
    fn a_resampled_room_is_the_room() {
        let coarse = resample(&room([128, 64]), [512, 256]).unwrap();
        let mut errors: Vec<f64> =
            coarse.depth.iter().zip(&room([512, 256]).depth).map(|(a, b)| f64::from((a - b).abs() / b)).collect();
        assert!(quantile(&mut errors, 0.9) < 1e-3, "on planes to the square of a texel");
        assert!(quantile(&mut errors, 1.0) < 0.05, "in corners too");
    }

    #[test]
    fn rays_start_inside_and_look_inside() {
        let frame = room([256, 128]);
        let surface = DepthMesh { size: [256, 128], depth: &frame.depth, yaw_degrees: 0.0, edge_ratio: 0.1 };
        for rays in [surface.coherent(), surface.cosine()] {
            assert!(rays.len() > 100_000);
            for r in rays {
                let inside =
                    |p: glam::Vec3| ((p - vec3(0.5, 0.0, 0.3)).abs() - vec3(3.0, 1.5, 2.0)).max_element() < 1e-3;
                assert!(inside(r.origin) && inside(r.origin + 1e-3 * r.direction) && r.direction.is_normalized());
            }
        }
        assert!(surface.silhouettes().is_empty(), "an empty room has no edges");
    }
}
