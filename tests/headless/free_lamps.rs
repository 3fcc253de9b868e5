//! Small lamps that hang free send what they do in the capture, to receivers all around them: bulbs of 1 to 100 texels, at 1/20 of the distance to
//! what lies behind and just before it, in an otherwise black sphere of a room, where E has a closed form. And rays meet them where they are.

use crate::common::*;
use glam::{DVec3, Vec3, vec3};
use iprt::{
    options::RenderOptions,
    panorama::{
        lamps::{self, FreeLamps},
        mapping::texel_direction,
        source::{PanoramaFrame, PanoramaSource},
    },
    passes::trace_rays::{LAMP, RayTracer, TracedRay, Tracer},
    plan::{Part, Plan},
    scene::{Scene, file::RenderSettings, viewpoint::Projection},
    settings::{Method, Settings},
};

const PANORAMA: [u32; 2] = [512, 256];
/// The radius of the room.
const WALL: f32 = 3.0;
const RADIANCE: f32 = 50.0;

/// A ball that shines evenly.
#[derive(Clone, Copy, Debug)]
struct Bulb {
    center: Vec3,
    radius: f32,
}

impl Bulb {
    /// At a distance in a direction, as large as this many texels.
    fn new(towards: Vec3, distance: f32, texels: f32) -> Self {
        let texel = std::f32::consts::PI / PANORAMA[1] as f32;
        let sine = (texels / std::f32::consts::PI).sqrt() * texel;
        Self { center: towards.normalize() * distance, radius: distance * sine }
    }

    /// Where a ray from the capture point meets it.
    fn meets(&self, d: Vec3) -> Option<f32> {
        let along = d.dot(self.center);
        let square = along * along - self.center.length_squared() + self.radius * self.radius;
        (square > 0.0 && along > 0.0).then(|| along - square.sqrt())
    }

    /// The irradiance of a surface all of whose hemisphere sees it; `None` if its horizon cuts the bulb.
    fn irradiance(&self, at: Vec3, normal: Vec3) -> Option<f32> {
        let way = self.center - at;
        let (height, sine2) = (way.dot(normal), self.radius * self.radius / way.length_squared());
        (height > self.radius).then(|| std::f32::consts::PI * RADIANCE * sine2 * height / way.length())
    }
}

/// The capture of bulbs before walls of any radiance: 8×8 rays a texel for colour, one for depth.
fn captured(bulbs: &[Bulb], wall: impl Fn(Vec3) -> f32, radiance: impl Fn(Vec3) -> f32) -> PanoramaFrame {
    let mut frame = surroundings(PANORAMA, &wall, |d| Vec3::splat(radiance(d)));
    let nearest = |d: Vec3| bulbs.iter().filter_map(|bulb| bulb.meets(d)).min_by(f32::total_cmp);
    for k in 0..(PANORAMA[0] * PANORAMA[1]) as usize {
        let (i, j) = (k as u32 % PANORAMA[0], k as u32 / PANORAMA[0]);
        let centre = texel_direction(i, j, PANORAMA).as_vec3();
        let near =
            |bulb: &Bulb| centre.dot(bulb.center.normalize()) > (bulb.radius / bulb.center.length() + 0.05).cos();
        if !bulbs.iter().any(near) {
            continue;
        }
        let seen = (0..64).filter(|s| {
            let fine = [PANORAMA[0] * 8, PANORAMA[1] * 8];
            nearest(texel_direction(i * 8 + s % 8, j * 8 + s / 8, fine).as_vec3()).is_some()
        });
        let share = seen.count() as f32 / 64.0;
        let l = share * RADIANCE + (1.0 - share) * radiance(centre);
        frame.radiance.set(k, [l, l, l, 1.0]);
        frame.depth[k] = nearest(centre).unwrap_or(frame.depth[k]);
    }
    frame
}

/// One texel of a given depth, as it stands.
fn single_texel(at: [u32; 2], distance: f32) -> (PanoramaFrame, Bulb) {
    let mut frame = captured(&[], |_| WALL, |_| 0.0);
    let k = (at[1] * PANORAMA[0] + at[0]) as usize;
    frame.radiance.set(k, [RADIANCE, RADIANCE, RADIANCE, 1.0]);
    frame.depth[k] = distance;
    let sine = (std::f64::consts::PI * (f64::from(at[1]) + 0.5) / f64::from(PANORAMA[1])).sin();
    let center = texel_direction(at[0], at[1], PANORAMA).as_vec3() * distance;
    (frame, Bulb { radius: Bulb::new(Vec3::X, distance, sine as f32).radius, center })
}

/// Directions that are no symmetry of the panorama: level, high, and nearly straight up.
const TOWARDS: [Vec3; 3] = [vec3(0.31, 0.12, -1.0), vec3(-0.8, 0.9, 0.37), vec3(0.05, 1.0, -0.11)];

#[test]
fn bulbs_send_their_light_to_all_around_them() {
    let mut bulbs = Vec::new();
    for (k, ratio) in [1.05, 1.3, 3.0, 20.0].into_iter().enumerate() {
        for (n, texels) in [4.0, 20.0, 100.0].into_iter().enumerate() {
            bulbs.push(Bulb::new(TOWARDS[(k + n) % 3], WALL / ratio, texels));
        }
    }
    // A bulb that is wider than the gap behind it would stand in the wall.
    bulbs.retain(|bulb| bulb.center.length() + 1.1 * bulb.radius < WALL);
    let mut frames: Vec<_> = bulbs.iter().map(|bulb| captured(&[*bulb], |_| WALL, |_| 0.0)).collect();
    for (at, ratio) in [([300, 100], 1.05), ([10, 60], 4.0), ([511, 128], 20.0)] {
        let (frame, bulb) = single_texel(at, WALL / ratio);
        frames.push(frame);
        bulbs.push(bulb);
    }
    validated(|gpu| {
        let panorama = PanoramaSource::from_frames(frames, 1.0, Vec3::ZERO, 0.0).expect("frames");
        // Something that is inserted, and that nothing shows: what the real surfaces get is asked.
        let speck = ball(1e-4, lambert(0.5), vec3(0.0, -2.9, 0.0));
        let scene = Scene::assemble(
            "bulbs",
            panorama,
            camera(Vec3::ZERO, Vec3::NEG_Z, 60.0),
            vec![speck],
            RenderSettings::default(),
        );
        let scene = scene.expect("packs");
        let set = [("relight_levels", "0"), ("history_change", "inf"), ("history_moving", "64")];
        let size = [96, 48];
        let options = RenderOptions { size, projection: Projection::Equirect, ..converged(Method::Iprt, &set) };
        let mut renderer = iprt::renderer::Renderer::new(gpu, &scene, options).expect("fits");
        let mut wrong = Vec::new();
        for (k, bulb) in bulbs.iter().enumerate() {
            accumulate(&mut renderer, &scene, k, 48);
            let irradiance = aov(&renderer, "irradiance_real");
            // Patches of the sphere all around, each with its share of E.
            let mut patches = [[0.0f64; 2]; 14];
            for (i, e) in irradiance.iter().enumerate() {
                let (x, y) = (i as u32 % size[0], i as u32 / size[0]);
                let d = texel_direction(x, y, size).as_vec3();
                let beside = d.dot(bulb.center.normalize()) < (2.5 * bulb.radius / bulb.center.length() + 0.1).cos();
                let Some(expected) = bulb.irradiance(d * WALL, -d).filter(|_| beside) else { continue };
                let weight = f64::from((1.0 - d.y * d.y).sqrt());
                let level = if d.y > 0.6 {
                    12
                } else if d.y < -0.6 {
                    13
                } else {
                    (x * 6 / size[0] + 6 * u32::from(d.y > 0.0)) as usize
                };
                patches[level][0] += weight * f64::from(e[1]);
                patches[level][1] += weight * f64::from(expected);
            }
            let total = patches.iter().fold([0.0; 2], |sum, p| [sum[0] + p[0], sum[1] + p[1]]);
            let ratios: Vec<f64> = patches.iter().filter(|p| p[1] > 0.01 * total[1]).map(|p| p[0] / p[1]).collect();
            println!("{bulb:?}: all {:.4}, patches {ratios:.3?}", total[0] / total[1]);
            if (total[0] / total[1] - 1.0).abs() > 0.03 || ratios.iter().any(|r| (r - 1.0).abs() > 0.05) {
                wrong.push(format!("{bulb:?}: {ratios:?}"));
            }
        }
        assert!(wrong.is_empty(), "{wrong:#?}");
    });
}

/// A room with bulbs, a bulb at the wall, a lit panel in the wall and a window.
fn furnished() -> (PanoramaFrame, [Bulb; 3]) {
    let bulbs = [Bulb::new(TOWARDS[0], 1.2, 30.0), Bulb::new(TOWARDS[1], 2.0, 9.0), Bulb::new(-TOWARDS[1], 2.85, 60.0)];
    let panel = |d: Vec3| d.dot(vec3(1.0, 0.1, 0.2).normalize()) > 0.999;
    let window = |d: Vec3| d.dot(vec3(-1.0, 0.1, -0.6).normalize()) > 0.97;
    let frame = captured(&bulbs, |_| WALL, |d| if panel(d) || window(d) { 30.0 } else { 0.3 + 0.2 * d.y });
    (frame, bulbs)
}

#[test]
fn only_what_hangs_free_is_a_lamp() {
    let (frame, bulbs) = furnished();
    let FreeLamps { lamps, depth } = lamps::find(&frame);
    assert_eq!(lamps.len(), 3, "{lamps:#?}");
    for bulb in bulbs {
        let lamp =
            lamps.iter().find(|lamp| lamp.center.distance(bulb.center) < 0.3 * bulb.radius + 0.01).expect("found");
        let area = lamp.axes[0].length() * lamp.axes[1].length() / (bulb.radius * bulb.radius);
        // Of a few texels the rim is a good part, so size and radiance are less certain than their product.
        assert!((area * lamp.radiance.y / RADIANCE - 1.0).abs() < 0.03, "{area} {lamp:?}");
        assert!((area - 1.0).abs() < 0.4, "{area}");
        assert!((lamp.around.y - (0.3 + 0.2 * bulb.center.normalize().y)).abs() < 0.05, "{lamp:?}");
        assert!((lamp.center + lamp.axes[2]).length() < WALL);
    }
    assert!(depth.iter().all(|d| (d - WALL).abs() < 0.02), "the wall is carried on behind them");
    // Without light, or without depth, nothing is found.
    let dark = PanoramaFrame { radiance: vec![[0.0; 4]; frame.radiance.len()].into(), ..frame.clone() };
    let far = PanoramaFrame { depth: vec![0.0; frame.depth.len()], ..frame };
    for frame in [dark, far] {
        assert!(lamps::find(&frame).lamps.is_empty());
    }
}

#[test]
fn rays_meet_free_lamps_where_they_are() {
    validated(|gpu| {
        let (frame, bulbs) = furnished();
        let tracer = RayTracer::new(gpu, &frame, 0.0, &Settings::of(Method::Iprt), Tracer::Surface).expect("a tracer");
        let mut random = fastrand::Rng::with_seed(5);
        let mut point = |most: f32| Vec3::from_array([0; 3].map(|_| most * (2.0 * random.f32() - 1.0)));
        let rays: Vec<_> = (0..9000)
            .map(|k| {
                let (origin, target) = (point(1.4), bulbs[k % 3].center + point(2.0 * bulbs[k % 3].radius));
                TracedRay { origin, t_min: 0.0, direction: (target - origin).normalize(), t_max: 1e30 }
            })
            .collect();
        let set = tracer.rays(&rays).expect("rays");
        tracer.trace(&set).expect("traces");
        let (mut met, mut missed) = (0, 0);
        for (ray, answer) in rays.iter().zip(tracer.answers(&set).expect("answers")) {
            let (origin, d) = (ray.origin.as_dvec3(), ray.direction.as_dvec3());
            // The nearest bulb that the ray meets, and whether it passes the rim of any.
            let mut expected = f64::INFINITY;
            let mut rim = false;
            for bulb in &bulbs {
                let (to, radius) = (bulb.center.as_dvec3() - origin, f64::from(bulb.radius));
                let along = to.dot(d);
                let off: DVec3 = to - along * d;
                rim |= (off.length() / radius - 1.0).abs() < 0.2 || to.length() < 1.3 * radius;
                if off.length() < radius && along > 0.0 {
                    expected = expected.min(along - (radius * radius - off.length_squared()).sqrt());
                }
            }
            if rim {
                continue;
            }
            if expected.is_finite() {
                met += 1;
                assert!(
                    answer.kind >= LAMP && (f64::from(answer.t) - expected).abs() < 0.03 + 0.02 * expected,
                    "{answer:?} {expected}"
                );
            } else {
                missed += 1;
                assert!(answer.kind < LAMP, "{answer:?}");
                let end = (ray.origin + ray.direction * answer.t).length();
                assert!((end - WALL).abs() < 0.02, "the wall stands behind the lamps: {end}");
            }
        }
        assert!(met > 500 && missed > 500, "{met} {missed}");
    });
}

#[test]
fn the_plan_looks_for_them() {
    let plan = |frame, method| {
        let scene =
            scene(frame, camera(Vec3::ZERO, Vec3::NEG_Z, 60.0), vec![ball(0.2, lambert(0.5), vec3(0.0, -1.0, -1.0))]);
        Plan::of(&scene, &options(method, &[]), None).expect("a plan").on(Part::FreeLamps)
    };
    assert!(plan(furnished().0, Method::Iprt));
    assert!(!plan(captured(&[], |_| WALL, |_| 0.4), Method::Iprt), "no lamp");
    assert!(!plan(furnished().0, Method::Paper) && !plan(furnished().0, Method::Ibl));
}
