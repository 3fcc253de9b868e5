//! Panoramas of every shape: sizes, holes, steps, distances, places; seen from the capture point and from elsewhere.

use crate::common::*;
use glam::{Vec3, Vec3Swizzles, vec2, vec3};
use iprt::{
    gpu::Gpu,
    options::RenderOptions,
    panorama::{
        depth::box_depth,
        mapping::bilinear,
        source::{PanoramaFrame, PanoramaSource},
    },
    scene::{Scene, camera::CameraTrack, file::RenderSettings},
    settings::Method,
};

const LOW: Vec3 = vec3(-1.8, -1.5, -2.2);
const HIGH: Vec3 = vec3(2.0, 1.1, 2.4);
const SMALL: [u32; 2] = [32, 24];

/// Straight up and down, into the seam, and into corners.
const TARGETS: [Vec3; 5] = [Vec3::NEG_Z, Vec3::Y, Vec3::NEG_Y, vec3(0.05, 0.0, 1.0), vec3(1.0, -0.8, 0.9)];

fn box_room(size: [u32; 2]) -> PanoramaFrame {
    room(size, HIGH - LOW, 0.5 * (LOW + HIGH), colourful)
}

fn placed(frame: PanoramaFrame, at: Vec3, track: CameraTrack, radius: f32) -> Scene {
    let panorama = PanoramaSource::from_frames(vec![frame], 30.0, at, 0.0).expect("a good panorama");
    // small and in a corner, so that all passes run
    let thing = ball(radius, lambert(0.5), at + vec3(1.0, -0.9, 1.0));
    Scene::assemble("test", panorama, track, vec![thing], RenderSettings::default()).expect("a good scene")
}

/// Largest error of the picture's real surfaces in each of the views, relative to the distance: of positions against `distance` from the
/// camera, over pixels for which it is known (0: a hole); radiance against the bilinear panorama at those positions. Everything is finite.
fn errors(
    gpu: &Gpu,
    frame: &PanoramaFrame,
    at: Vec3,
    list: &[(Vec3, Vec3, f32)],
    distance: impl Fn(Vec3, Vec3) -> Option<f32>,
) -> (f32, f32) {
    let moved: Vec<_> = list.iter().map(|(from, to, fov)| (at + from, at + to, *fov)).collect();
    let track = views(&moved);
    let scene = placed(frame.clone(), at, track.clone(), 0.2);
    // coarse texels of a floor seen at a slant differ by more than the usual tenth
    let set = [("relight_width", "16"), ("edge_ratio", "0.5")];
    let mut renderer = rendered(gpu, &scene, RenderOptions { size: SMALL, ..options(Method::Iprt, &set) }, 0);
    let (mut place, mut radiance) = (0.0f32, 0.0f32);
    for (second, (from, ..)) in list.iter().enumerate() {
        accumulate(&mut renderer, &scene, second, 2);
        let [position, seen] = ["position_real", "camera_radiance"].map(|name| aov(&renderer, name));
        for i in 0..position.len() {
            let pixel = vec2((i as u32 % SMALL[0]) as f32, (i as u32 / SMALL[0]) as f32) + 0.5;
            let d = pixel_direction(&track, second as f64, SMALL, pixel);
            let Some(expected) = distance(*from, d) else { continue };
            let hole = expected == 0.0;
            place = place.max(if hole { position[i][3] } else { (position[i][3] / expected - 1.0).abs() });
            let shown = bilinear(frame, if hole { d } else { from + d * expected });
            radiance = radiance.max((Vec3::from_slice(&seen[i]) - shown).abs().max_element());
        }
    }
    for name in renderer.aov_names() {
        aov(&renderer, &name); // asserts that it is finite
    }
    (place, radiance)
}

/// What all directions around one, within some radians, have in common.
fn around<T: PartialEq>(d: Vec3, radius: f32, of: impl Fn(Vec3) -> T) -> Option<T> {
    let (x, y) = d.any_orthonormal_pair();
    let turned = |k: usize| {
        let (sin, cos) = (std::f32::consts::FRAC_PI_8 * k as f32).sin_cos();
        of((d + radius * (cos * x + sin * y)).normalize())
    };
    let here = of(d);
    (0..16).all(|k| turned(k) == here).then_some(here)
}

/// Where a ray from inside meets the walls, unless within a coarse texel of an edge, which the surface cuts.
fn to_wall(from: Vec3, d: Vec3) -> Option<f32> {
    let t = leaves(d, LOW - from, HIGH - from);
    let wall = |d: Vec3| {
        let p = (d * leaves(d, LOW, HIGH) - LOW) / (HIGH - LOW);
        [p.x < 1e-5, p.y < 1e-5, p.z < 1e-5, p.x > 0.99999, p.y > 0.99999, p.z > 0.99999]
    };
    around((from + d * t).normalize(), 0.16, wall).map(|_| t)
}

#[test]
fn a_room_is_seen_where_it_is_whatever_the_panoramas_size() {
    validated(|gpu| {
        let centred = TARGETS.map(|target| (Vec3::ZERO, target, 60.0));
        for size in [[64, 32], [65, 33], [127, 64], [100, 30]] {
            let (place, radiance) = errors(gpu, &box_room(size), Vec3::ZERO, &centred, to_wall);
            assert!(place < 1e-3 && radiance < 0.02, "{size:?}: {place}, {radiance}");
        }
    });
}

#[test]
fn a_panorama_of_a_texel_or_two_is_a_panorama() {
    validated(|gpu| {
        for size in [[1, 1], [2, 1], [1, 3], [3, 2]] {
            let frame = surroundings(size, |_| 2.0, |d| Vec3::splat(1.0) + 0.5 * d);
            let list = [(Vec3::ZERO, Vec3::NEG_Z, 60.0), (vec3(0.1, 0.0, 0.1), Vec3::Y, 90.0)];
            errors(gpu, &frame, Vec3::ZERO, &list, |_, _| None);
        }
    });
}

#[test]
fn depth_and_colour_may_differ_in_size() {
    validated(|gpu| {
        let mut frame = box_room([200, 100]);
        frame.depth_size = [96, 64];
        frame.depth = box_depth(frame.depth_size, HIGH - LOW, 0.5 * (LOW + HIGH), 0.0);
        let centred = TARGETS.map(|target| (Vec3::ZERO, target, 60.0));
        let (place, radiance) = errors(gpu, &frame, Vec3::ZERO, &centred, to_wall);
        assert!(place < 1e-3 && radiance < 0.02, "{place}, {radiance}");
    });
}

#[test]
fn the_largest_panorama_renders() {
    validated(|gpu| {
        let size = [8192, 4096];
        // the same along a row: only a row's angle is computed
        let rows = (0..size[1]).map(|j| (std::f32::consts::PI * (j as f32 + 0.5) / size[1] as f32).sin());
        let radiance: Vec<f32> = rows.flat_map(|s| std::iter::repeat_n(s, size[0] as usize)).collect();
        let frame = PanoramaFrame {
            color_size: size,
            radiance: radiance.iter().map(|s| [*s, *s, *s, 1.0]).collect(),
            depth_size: size,
            depth: vec![2.5; radiance.len()],
            ..Default::default()
        };
        let track = views(&[(Vec3::ZERO, vec3(0.0, -0.5, -1.0), 5.0)]);
        let scene = scene(frame, track.clone(), vec![ball(0.2, lambert(0.5), vec3(0.0, 0.3, 1.0))]);
        let set = [("relight_levels", "0")];
        let renderer = rendered(gpu, &scene, RenderOptions { size: SMALL, ..options(Method::Iprt, &set) }, 1);
        let [position, seen] = ["position_real", "camera_radiance"].map(|name| aov(&renderer, name));
        for i in 0..position.len() {
            let pixel = vec2((i as u32 % SMALL[0]) as f32, (i as u32 / SMALL[0]) as f32) + 0.5;
            let d = pixel_direction(&track, 0.0, SMALL, pixel);
            assert!((position[i][3] - 2.5).abs() < 1e-4, "{pixel}: {:?}", position[i]);
            assert!((seen[i][1] - d.xz().length()).abs() < 1e-3, "{pixel}: {:?}", seen[i]);
        }
    });
}

#[test]
fn holes_are_the_panorama_infinitely_far() {
    validated(|gpu| {
        // a patch ahead, a band below the horizon, everything around both poles, and everything
        let patch = |d: Vec3| d.dot(Vec3::NEG_Z) > 0.95;
        let band = |d: Vec3| d.y > -0.5 && d.y < -0.3;
        let poles = |d: Vec3| d.y.abs() > 0.9;
        let holes: [(&str, &dyn Fn(Vec3) -> bool); 4] =
            [("patch", &patch), ("band", &band), ("poles", &poles), ("all", &|_| true)];
        for (name, hole) in holes {
            let frame = surroundings([128, 64], |d| if hole(d) { 0.0 } else { leaves(d, LOW, HIGH) }, colourful);
            let mut list = TARGETS.map(|target| (Vec3::ZERO, target, 60.0)).to_vec();
            if name == "patch" || name == "all" {
                // from elsewhere too a ray through a hole brings what the panorama has in its direction
                list.push((vec3(0.2, 0.1, -0.3), vec3(0.2, 0.1, -3.0), 10.0));
            }
            let (place, radiance) = errors(gpu, &frame, Vec3::ZERO, &list, |from, d| match around(d, 0.08, hole)? {
                true => Some(0.0),
                false => to_wall(from, d),
            });
            assert!(place < 1e-3 && radiance < 0.02, "{name}: {place}, {radiance}");
        }
    });
}

#[test]
fn far_away_is_no_further_than_floats_reach() {
    validated(|gpu| {
        let frame = surroundings([128, 64], |_| 1e4, colourful);
        // a step to the side changes nothing that far away
        let list: Vec<_> =
            TARGETS.iter().flat_map(|t| [(Vec3::ZERO, *t, 60.0), (vec3(0.5, 0.2, -0.4), 1e3 * *t, 60.0)]).collect();
        let (place, radiance) = errors(gpu, &frame, Vec3::ZERO, &list, |_, _| Some(1e4));
        assert!(place < 2e-3 && radiance < 2e-2, "{place}, {radiance}");
    });
}

#[test]
fn steps_of_depth_at_the_seam_and_at_the_poles_stay_where_they_are() {
    validated(|gpu| {
        // near to the left of the seam, far to the right of it
        let seam = |d: Vec3| if d.z > 0.0 && d.x > 0.0 { 1.5 } else { 3.0 };
        // a near cap and a far rest, at both poles; and a pole whose row is near and far
        let caps = |d: Vec3| if d.y.abs() > 0.9 { 1.2 } else { 3.0 };
        let split = |d: Vec3| if d.x > 0.0 { 1.5 } else { 3.0 };
        let cases: [(&str, &dyn Fn(Vec3) -> f32); 3] = [("seam", &seam), ("caps", &caps), ("split poles", &split)];
        for (name, depth) in cases {
            let frame = surroundings([128, 64], depth, colourful);
            let list = [Vec3::Z, Vec3::Y, Vec3::NEG_Y, Vec3::X].map(|target| (Vec3::ZERO, target, 70.0));
            let (place, radiance) = errors(gpu, &frame, Vec3::ZERO, &list, |_, d| around(d, 0.08, depth));
            assert!(place < 1e-3 && radiance < 0.02, "{name}: {place}, {radiance}");
        }
    });
}

#[test]
fn the_capture_point_may_be_anywhere() {
    validated(|gpu| {
        let at = vec3(1000.0, -500.0, 2000.0);
        let list = TARGETS.map(|target| (Vec3::ZERO, target, 60.0));
        let (place, radiance) = errors(gpu, &box_room([128, 64]), at, &list, to_wall);
        assert!(place < 1e-3 && radiance < 0.02, "{place}, {radiance}");
    });
}

#[test]
fn a_camera_off_the_capture_point_sees_the_room_from_there() {
    validated(|gpu| {
        let frame = box_room([256, 128]);
        let places = [vec3(0.4, -0.3, 0.5), vec3(-1.2, 0.7, -1.5), vec3(1.5, -1.2, 1.9)];
        let list: Vec<_> = places.iter().flat_map(|from| TARGETS.map(|target| (*from, *from + target, 60.0))).collect();
        let (place, radiance) = errors(gpu, &frame, Vec3::ZERO, &list, to_wall);
        assert!(place < 1e-3 && radiance < 0.02, "{place}, {radiance}");
    });
}

/// The share of pixels whose real surface is off by more than a share of its distance or whose normal by more than some
/// degrees, within what is farther than 0.16 from any edge. Holes are off.
fn off(gpu: &Gpu, frame: PanoramaFrame, [low, high]: [Vec3; 2], share: f32, degrees: f32) -> f32 {
    let track = views(&TARGETS.map(|target| (Vec3::ZERO, target, 60.0)));
    let scene = placed(frame, Vec3::ZERO, track.clone(), 0.1);
    let mut renderer = rendered(gpu, &scene, RenderOptions { size: SMALL, ..options(Method::Iprt, &[]) }, 0);
    let (mut all, mut wrong) = (0, 0);
    for second in 0..TARGETS.len() {
        accumulate(&mut renderer, &scene, second, 1);
        let [positions, normals] = ["position_real", "normal_real"].map(|name| aov(&renderer, name));
        for (i, (position, normal)) in positions.iter().zip(&normals).enumerate() {
            let pixel = vec2((i as u32 % SMALL[0]) as f32, (i as u32 / SMALL[0]) as f32) + 0.5;
            let d = pixel_direction(&track, second as f64, SMALL, pixel);
            let inward = |d: Vec3| {
                let at = (d * leaves(d, low, high) - low) / (high - low);
                let from_middle = at - 0.5;
                let axis = from_middle.abs().max_position();
                -Vec3::AXES[axis] * from_middle[axis].signum()
            };
            let Some(expected) = around(d, 0.16, inward) else { continue };
            all += 1;
            let distance = (position[3] / leaves(d, low, high) - 1.0).abs();
            let turned = Vec3::from_slice(normal).normalize_or_zero().dot(expected).min(1.0).acos().to_degrees();
            wrong += usize::from(position[3] == 0.0 || distance > share || turned > degrees);
        }
    }
    assert!(all > 500, "{all} pixels");
    wrong as f32 / all as f32
}

#[test]
fn floors_and_walls_at_grazing_angles_are_planes() {
    validated(|gpu| {
        let long = [vec3(-2.5, -0.35, -10.0), vec3(2.5, 2.0, 4.0)];
        for size in [[64, 32], [128, 64], [256, 128]] {
            let frame = room(size, long[1] - long[0], 0.5 * (long[0] + long[1]), colourful);
            let off = off(gpu, frame, long, 1e-3, 1.0);
            assert!(off == 0.0, "{size:?}: {off}");
        }
    });
}

#[test]
fn noisy_depth_is_smoothed_and_its_small_holes_are_filled() {
    validated(|gpu| {
        let mut frame = box_room([256, 128]);
        let mut random = fastrand::Rng::with_seed(1);
        for metres in &mut frame.depth {
            let off = (0..3).map(|_| random.f32() - 0.5).sum::<f32>() / 0.5;
            *metres *= if random.f32() < 0.05 { 0.0 } else { 1.0 + 0.02 * off };
        }
        let off = off(gpu, frame, [LOW, HIGH], 0.02, 8.0);
        assert!(off < 0.02, "{off}");
    });
}
