//! What must hold whatever the scene: the picture without influence, the turned panorama, light that is a polynomial of
//! direction, shadows that do not depend on where the camera looks, light from near by.

mod common;

use common::*;
use glam::{Mat3, Vec2, Vec3, vec2, vec3};
use iprt::{
    gpu::Gpu,
    panorama::source::{PanoramaFrame, PanoramaSource},
    passes::view::Projection,
    renderer::{RenderOptions, Renderer},
    scene::{Object, Scene, camera::CameraTrack, file::RenderSettings},
    settings::Method,
};
use std::f32::consts::{PI, TAU};

/// Methods that differ in their limit: `reference` is `iprt` there.
const LIMITS: [Method; 3] = [Method::Iprt, Method::Paper, Method::Ibl];

// --- the plain panorama ---

const ROOM: [Vec3; 2] = [vec3(-2.0, -1.5, -2.5), vec3(2.0, 1.5, 2.5)];

/// A room with a table: its top 0.7 m under the capture point, its front 0.9 m ahead.
const TABLE: [Vec3; 2] = [vec3(-0.9, -1.5, -2.0), vec3(0.9, -0.7, -0.9)];

fn room_with_table() -> PanoramaFrame {
    let distance = |d: Vec3| enters(d, TABLE[0], TABLE[1]).unwrap_or(leaves(d, ROOM[0], ROOM[1]));
    surroundings([256, 128], distance, colourful)
}

#[test]
fn without_objects_the_picture_is_what_the_camera_sees_bit_for_bit() {
    validated(|gpu| {
        let target = vec3(0.3, -0.4, -1.0);
        // finer than the panorama's texels, then coarser, then off the capture point
        let track =
            views(&[(Vec3::ZERO, target, 20.0), (Vec3::ZERO, target, 100.0), (vec3(0.3, 0.2, -0.1), target, 70.0)]);
        for projection in [Projection::Perspective, Projection::Equirect] {
            let mut pictures: Vec<Texels> = vec![];
            for method in Method::ALL {
                let things =
                    if method == Method::Iprt { vec![] } else { vec![ball(0.3, lambert(0.5), vec3(0.2, -0.4, -1.5))] };
                let without_objects = !things.is_empty();
                let scene = scene(room_with_table(), track.clone(), things);
                let options = RenderOptions { projection, without_objects, ..options(method, &[]) };
                let mut renderer = rendered(gpu, &scene, options, 0);
                for second in 0..3 {
                    accumulate(&mut renderer, &scene, second, 2);
                    let (picture, seen) = (aov(&renderer, "radiance"), aov(&renderer, "camera_radiance"));
                    assert!(
                        picture.iter().zip(&seen).all(|(p, s)| p[..3] == s[..3]),
                        "{projection:?} {second}, {method:?}"
                    );
                    match pictures.get(second) {
                        None => pictures.push(picture),
                        // what was never captured, a view from elsewhere shows as the method's `thickness` says
                        Some(_) if second == 2 && method == Method::Paper => {}
                        Some(first) => {
                            assert!(*first == picture, "{projection:?} {second}: {method:?} shows another panorama")
                        }
                    }
                }
            }
        }
    });
}

#[test]
fn a_minified_panorama_is_filtered_over_the_pixels_footprint() {
    validated(|gpu| {
        // squares of one texel, black and white, 16 texels and more in a pixel: all that is left is their mean
        let size = [1024, 512];
        let mut panorama = surroundings(size, |_| 2.0, |_| Vec3::ZERO);
        for (i, texel) in panorama.radiance.iter_mut().enumerate() {
            texel[..3].fill(((i as u32 % size[0] + i as u32 / size[0]) % 2) as f32);
        }
        let scene = scene(panorama, views(&AXES.map(|target| (Vec3::ZERO, target, 60.0))), vec![]);
        let coarse = RenderOptions { size: [16, 12], ..options(Method::Iprt, &[]) };
        let mut renderer = rendered(gpu, &scene, coarse, 0);
        for (second, target) in AXES.iter().enumerate() {
            accumulate(&mut renderer, &scene, second, 1);
            for texel in aov(&renderer, "radiance") {
                assert!((texel[1] - 0.5).abs() < 1e-5, "towards {target}: {texel:?}");
            }
        }
    });
}

#[test]
fn what_no_object_can_influence_keeps_its_bits() {
    validated(|gpu| {
        for method in Method::ALL {
            // against the plain view, which is what the picture is without objects
            let pictures = |panorama, track: &CameraTrack, thing, size, set: &[(&str, &str)]| {
                let scene = scene(panorama, track.clone(), vec![thing]);
                let renderer = rendered(gpu, &scene, RenderOptions { size, ..options(method, set) }, 3);
                ["radiance", "camera_radiance", "position_real", "real_coverage"].map(|name| aov(&renderer, name))
            };
            // the ball is under the floor, so that nothing real sees it, whatever a method takes for real
            let closed = room([128, 64], ROOM[1] - ROOM[0], Vec3::ZERO, colourful);
            let track = camera(Vec3::ZERO, vec3(0.3, -1.5, 0.4), 40.0);
            let under = ball(0.3, lambert(0.5), vec3(0.3, -2.2, 0.4));
            let set = [("relight_width", "32"), ("virtual_surfaces", "on")];
            let [with, plain, ..] = pictures(closed, &track, under, SIZE, &set);
            assert!(
                with.iter().zip(&plain).all(|(a, b)| a[..3] == b[..3]),
                "{method:?}: the floor with a ball under it"
            );

            // The ball is on the table's top, behind its front: no ray from the front meets it, though the filter does mix the
            // two sides of the edge. Light as captured, for by way of a third surface everything in a room has influence.
            let size = [16, 160];
            let track = camera(Vec3::ZERO, vec3(0.0, -1.12, TABLE[1].z), 42.0);
            let upon = ball(0.2, lambert(0.5), vec3(0.0, -0.5, -1.2));
            let [with, plain, position, coverage] =
                pictures(room_with_table(), &track, upon, size, &[("relight_levels", "0"), ("virtual_surfaces", "on")]);
            let row = |i: usize| i as u32 / size[0];
            let on = |i: usize, axis: usize, at: f32| coverage[i][0] == 1.0 && (position[i][axis] - at).abs() < 5e-3;
            let edge =
                (0..with.len()).filter(|i| on(*i, 1, TABLE[1].y)).map(row).max().expect("the top is in the picture");
            let (mut kept, mut changed) = (0, 0);
            for i in 0..with.len() {
                let same = with[i][..3] == plain[i][..3];
                // five levels reach 2·(1 + 2 + 4 + 8 + 16) pixels, and interpolation a few more
                if on(i, 2, TABLE[1].z) && row(i) > edge + 68 {
                    kept += 1;
                    assert!(same, "{method:?}: pixel {i} of the front: {:?} and {:?}", with[i], plain[i]);
                }
                changed += u32::from(on(i, 1, TABLE[1].y) && !same);
            }
            assert!(
                kept > 100 && changed > 100,
                "{method:?}: {kept} pixels of the front, {changed} of the top changed"
            );
        }
    });
}

// --- turning and mirroring ---

/// The same panorama with its columns moved right by `k`, and the yaw in degrees that undoes it.
fn rolled(frame: &PanoramaFrame, k: usize) -> (PanoramaFrame, f32) {
    let width = frame.color_size[0] as usize;
    let mut rolled = frame.clone();
    rolled.radiance.chunks_mut(width).for_each(|row| row.rotate_right(k));
    rolled.depth.chunks_mut(width).for_each(|row| row.rotate_right(k));
    (rolled, 360.0 * k as f32 / width as f32)
}

fn turned_scene(frame: PanoramaFrame, yaw: f32, objects: Vec<Object>) -> Scene {
    let track = camera(Vec3::ZERO, vec3(0.1, -0.5, -1.0), 75.0);
    let panorama = PanoramaSource::from_frames(vec![frame], 30.0, Vec3::ZERO, yaw).expect("a good panorama");
    Scene::assemble("test", panorama, track, objects, RenderSettings::default()).expect("a good scene")
}

#[test]
fn rolling_the_panorama_and_undoing_it_by_yaw_changes_nothing() {
    validated(|gpu| {
        // so even that no directions are drawn towards lights, whose cells would move against the texels: the paths are then the same
        let mut frame = room_with_table();
        for texel in &mut frame.radiance {
            texel[..3].iter_mut().for_each(|x| *x = 1.0 + 0.08 * (*x - 0.6));
        }
        let things =
            || vec![ball(0.3, metal(0.2), vec3(0.35, -0.4, -1.3)), ball(0.25, lambert(0.7), vec3(-0.3, -0.45, -1.3))];
        for method in LIMITS {
            let picture = |k| {
                let (frame, yaw) = rolled(&frame, k);
                let scene = turned_scene(frame, yaw, things());
                aov(&rendered(gpu, &scene, converged(method, &[("relight_levels", "0")]), 8), "radiance")
            };
            let straight = picture(0);
            let turned = picture(77);
            let differ = |(a, b): &(&[f32; 4], &[f32; 4])| (0..3).any(|c| (a[c] - b[c]).abs() > 1e-3);
            let count = straight.iter().zip(&turned).filter(differ).count();
            // measured 0
            assert!(count as f32 <= 1e-3 * straight.len() as f32, "{method:?}: {count} pixels differ");
        }
    });
}

// --- light that is a polynomial of direction ---

/// Radiance of orders 0, 1 and 2: c + a·d + dᵀ Q d with Q symmetric and without trace.
#[derive(Clone, Copy)]
struct Polynomial {
    c: f32,
    a: Vec3,
    q: Mat3,
}

const LIGHT: Polynomial = Polynomial {
    c: 1.0,
    a: vec3(0.2, -0.3, 0.15),
    q: Mat3::from_cols(vec3(0.2, 0.1, -0.15), vec3(0.1, -0.35, 0.05), vec3(-0.15, 0.05, 0.15)),
};

impl Polynomial {
    fn radiance(&self, d: Vec3) -> f32 {
        self.c + self.a.dot(d) + d.dot(self.q * d)
    }

    /// Irradiance about a normal: the cosine lobe scales the orders by π, 2π/3 and π/4 (Ramamoorthi and Hanrahan 2001).
    fn irradiance(&self, n: Vec3) -> f32 {
        PI * self.c + TAU / 3.0 * self.a.dot(n) + PI / 4.0 * n.dot(self.q * n)
    }
}

const AXES: [Vec3; 6] = [Vec3::X, Vec3::Y, Vec3::Z, Vec3::NEG_X, Vec3::NEG_Y, Vec3::NEG_Z];

#[test]
fn a_polynomial_of_direction_is_reproduced() {
    validated(|gpu| {
        let panorama = surroundings([256, 128], |_| 3.0, |d| Vec3::splat(LIGHT.radiance(d)));
        for method in Method::ALL {
            let track = views(&AXES.map(|target| (Vec3::ZERO, target, 60.0)));
            let scene = scene(panorama.clone(), track.clone(), vec![]);
            let mut renderer = rendered(gpu, &scene, options(method, &[]), 0);
            for (second, target) in AXES.iter().enumerate() {
                accumulate(&mut renderer, &scene, second, 1);
                let picture = aov(&renderer, "radiance");
                for (i, texel) in picture.iter().enumerate() {
                    let at = vec2((i as u32 % SIZE[0]) as f32, (i as u32 / SIZE[0]) as f32) + 0.5;
                    let expected = LIGHT.radiance(pixel_direction(&track, second as f64, SIZE, at));
                    // measured: 2e-4
                    assert!(
                        (texel[1] - expected).abs() < 5e-4,
                        "{method:?}, towards {target}, {at}: {texel:?}, not {expected}"
                    );
                }
            }
        }
    });
}

/// Mean and largest of |E/expected − 1|, taken over means of 4×4 pixels in which `expected` is known everywhere.
fn irradiance_error(
    irradiance: &Texels,
    [width, height]: [u32; 2],
    expected: impl Fn(usize) -> Option<f32>,
) -> (f32, f32) {
    let (mut sum, mut largest, mut blocks) = (0.0f32, 0.0f32, 0);
    for pixels in (0..width * height / 16).map(|block| block_pixels(block, width)) {
        let error = |i: usize| expected(i).map(|e| irradiance[i][1] / e - 1.0);
        let Some(errors) = pixels.into_iter().map(error).collect::<Option<Vec<_>>>() else { continue };
        let error = (errors.iter().sum::<f32>() / 16.0).abs();
        (sum, largest, blocks) = (sum + error, largest.max(error), blocks + 1);
    }
    assert!(blocks > 10, "{blocks} blocks");
    (sum / blocks as f32, largest)
}

/// The pixels of a block of 4×4.
fn block_pixels(block: u32, width: u32) -> [usize; 16] {
    let (x, y) = (block % (width / 4), block / (width / 4));
    std::array::from_fn(|k| ((4 * y + k as u32 / 4) * width + 4 * x + k as u32 % 4) as usize)
}

const SMALL: [u32; 2] = [32, 24];

#[test]
fn the_irradiance_of_a_polynomial_is_the_closed_form_on_virtual_surfaces() {
    validated(|gpu| {
        // far away in every direction, around a ball at the capture point; seen from all sides, straight up and down included
        let panorama = surroundings([256, 128], |_| 1e4, |d| Vec3::splat(LIGHT.radiance(d)));
        let things = vec![ball(0.3, lambert(1.0), Vec3::ZERO)];
        let scene = scene(panorama, views(&AXES.map(|from| (from, Vec3::ZERO, 40.0))), things);
        for method in LIMITS {
            let options = RenderOptions { size: SMALL, ..converged(method, &[("relight_levels", "0")]) };
            let mut renderer = rendered(gpu, &scene, options, 0);
            for (second, from) in AXES.iter().enumerate() {
                accumulate(&mut renderer, &scene, second, 40);
                let images = ["irradiance_virtual", "normal_virtual", "real_coverage"];
                let [irradiance, normal, coverage] = images.map(|name| aov(&renderer, name));
                let of = |i: usize| (coverage[i][0] == 0.0).then(|| LIGHT.irradiance(Vec3::from_slice(&normal[i])));
                let (mean, largest) = irradiance_error(&irradiance, SMALL, of);
                // measured: 0.014, 0.040, the noise of 40 paths
                assert!(mean < 0.025 && largest < 0.08, "{method:?}, from {from}: {mean}, {largest}");
            }
        }
    });
}

#[test]
fn on_a_sphere_around_the_capture_point_real_surfaces_have_the_closed_form() {
    validated(|gpu| {
        let panorama = surroundings([256, 128], |_| 1e4, |d| Vec3::splat(LIGHT.radiance(d)));
        // a ball under the ground, out of sight: without any, nothing is traced
        let things = vec![ball(0.1, lambert(0.5), vec3(0.0, -2e4, 0.0))];
        let track = views(&AXES.map(|target| (Vec3::ZERO, target, 60.0)));
        let scene = scene(panorama, track.clone(), things);
        for method in LIMITS {
            let options = RenderOptions { size: SMALL, ..converged(method, &[("relight_levels", "0")]) };
            let mut renderer = rendered(gpu, &scene, options, 0);
            for (second, target) in AXES.iter().enumerate() {
                accumulate(&mut renderer, &scene, second, 64);
                let of = |i: usize| {
                    let at = vec2((i as u32 % SMALL[0]) as f32, (i as u32 / SMALL[0]) as f32) + 0.5;
                    Some(match method {
                        // by direction alone it is that of an infinitely far sphere about the inward normal
                        Method::Ibl => LIGHT.irradiance(-pixel_direction(&track, second as f64, SMALL, at)),
                        // equal areas of a sphere send equal light to any of its points: π·mean(L)
                        _ => PI * LIGHT.c,
                    })
                };
                let (mean, largest) = irradiance_error(&aov(&renderer, "irradiance_real"), SMALL, of);
                // measured: 0.012, 0.046, the noise of 64 paths
                assert!(mean < 0.02 && largest < 0.08, "{method:?}, towards {target}: {mean}, {largest}");
            }
        }
    });
}

// --- what does not depend on the camera ---

/// E_RV/E_R (green) and position of the floor in a picture, in its limit.
struct Ratios {
    track: CameraTrack,
    second: f64,
    ratio: Vec<Option<f32>>,
    position: Texels,
}

const FLOOR: f32 = -1.5;

impl Ratios {
    /// Bilinear, where all four neighbours are floor.
    fn at(&self, point: Vec3) -> Option<f32> {
        let camera = self.track.at(self.second);
        let local = camera.rotation.inverse() * (point - camera.position);
        let place = project(&self.track, self.second, SIZE, point) - 0.5;
        let (corner, weight) = (place.floor(), place - place.floor());
        let inside = local.z < 0.0
            && corner.cmpge(Vec2::ZERO).all()
            && corner.x < SIZE[0] as f32 - 1.0
            && corner.y < SIZE[1] as f32 - 1.0;
        let of = |x: u32, y: u32| self.ratio[((corner.y as u32 + y) * SIZE[0] + corner.x as u32 + x) as usize];
        if !inside {
            return None;
        }
        let mix = |a: f32, b: f32, t: f32| a + t * (b - a);
        Some(mix(mix(of(0, 0)?, of(1, 0)?, weight.x), mix(of(0, 1)?, of(1, 1)?, weight.x), weight.y))
    }
}

/// Root-mean-square and largest difference of two views' ratios, over means of 4×4 pixels of one that the other sees too, and
/// how dark the darkest is.
fn disagreement(a: &Ratios, b: &Ratios) -> (f32, f32, f32) {
    let (mut squares, mut largest, mut darkest, mut blocks) = (0.0, 0.0f32, 1.0f32, 0);
    for pixels in (0..SIZE[0] * SIZE[1] / 16).map(|block| block_pixels(block, SIZE[0])) {
        let pair = |i: usize| Some((a.ratio[i]?, b.at(Vec3::from_slice(&a.position[i]))?));
        let Some(pairs) = pixels.into_iter().map(pair).collect::<Option<Vec<_>>>() else { continue };
        let difference = pairs.iter().map(|(a, b)| a - b).sum::<f32>() / 16.0;
        darkest = darkest.min(pairs.iter().map(|(a, _)| a).sum::<f32>() / 16.0);
        (squares, largest, blocks) = (squares + difference * difference, largest.max(difference.abs()), blocks + 1);
    }
    assert!(blocks > 30, "{blocks} blocks are shared");
    ((squares / blocks as f32).sqrt(), largest, darkest)
}

/// A black ball close over the floor, and two cameras at the capture point that share its shadow; the second one does not see the ball.
fn shadow_views(gpu: &Gpu, method: Method) -> (f32, f32, f32) {
    let track = views(&[(Vec3::ZERO, vec3(0.0, FLOOR, -1.0), 85.0), (Vec3::ZERO, vec3(0.0, FLOOR, 0.45), 45.0)]);
    let scene = scene(floor(), track.clone(), vec![ball(0.4, lambert(0.0), vec3(0.0, -0.6, -0.55))]);
    let mut renderer = rendered(gpu, &scene, converged(method, &[("relight_levels", "0")]), 0);
    let [a, b] = [0, 1].map(|second| {
        accumulate(&mut renderer, &scene, second, 96);
        let images = ["irradiance_mixed", "irradiance_real", "position_real", "real_coverage"];
        let [mixed, real, position, coverage] = images.map(|name| aov(&renderer, name));
        let known = |i: usize| coverage[i][0] == 1.0 && (position[i][1] - FLOOR).abs() < 1e-3;
        let ratio = (0..mixed.len()).map(|i| known(i).then(|| mixed[i][1] / real[i][1])).collect();
        Ratios { track: track.clone(), second: second as f64, ratio, position }
    });
    assert!(b.ratio.iter().all(Option::is_some), "the ball is not in the second picture");
    assert!(a.ratio.iter().any(Option::is_none), "the ball is in the first picture");
    disagreement(&b, &a)
}

#[test]
fn a_shadow_does_not_depend_on_where_the_camera_looks() {
    validated(|gpu| {
        for method in [Method::Iprt, Method::Ibl] {
            let (rms, largest, darkest) = shadow_views(gpu, method);
            assert!(darkest < 0.9, "{method:?}: there is a shadow: {darkest}");
            // measured: 0.013, 0.029, the noise of 96 paths
            assert!(rms < 0.025 && largest < 0.06, "{method:?}: {rms}, {largest}");
        }
    });
}

#[test]
fn what_the_screen_does_not_show_casts_no_shadow_in_the_papers_method() {
    validated(|gpu| {
        let (rms, largest, darkest) = shadow_views(gpu, Method::Paper);
        // measured: 0.056, 0.088
        assert!(rms > 0.04 && largest > 0.07 && darkest > 0.99, "{rms}, {largest}, {darkest}");
    });
}

// --- light from near by ---

/// Irradiance of an upright point on a horizontal plane under a rectangle of radiance 1 at a height, which faces down
/// (Lambert's formula over its four edges).
fn under_rectangle(point: Vec3, low: Vec2, high: Vec2, height: f32) -> f32 {
    let corners = [vec2(low.x, low.y), vec2(high.x, low.y), vec2(high.x, high.y), vec2(low.x, high.y)];
    let arms = corners.map(|c| vec3(c.x, height, c.y).as_dvec3() - point.as_dvec3());
    let edge = |i: usize| {
        let (a, b) = (arms[i].normalize(), arms[(i + 1) % 4].normalize());
        let across = a.cross(b);
        across.y / across.length() * a.angle_between(b)
    };
    (0.5 * (0..4).map(edge).sum::<f64>().abs()) as f32
}

/// Mean and largest relative error of E_R on the floor under a lamp of the ceiling, of means over 4×4 pixels; and how much E_R varies.
fn lamp_error(gpu: &Gpu, method: Method) -> (f32, f32, f32) {
    let (low, high, ceiling) = (vec2(0.4, -1.3), vec2(1.2, -0.5), 0.6);
    let on_lamp = |d: Vec3| {
        let at = d * (ceiling / d.y);
        d.y > 0.0 && vec2(at.x, at.z).cmpge(low).all() && vec2(at.x, at.z).cmple(high).all()
    };
    let walls = [vec3(-3.0, -0.9, -3.0), vec3(3.0, ceiling, 3.0)];
    let panorama = surroundings(
        [512, 256],
        |d| leaves(d, walls[0], walls[1]),
        |d| Vec3::splat(if on_lamp(d) { 10.0 } else { 0.0 }),
    );
    // the floor is seen; a ball behind the camera keeps the lighting going
    let track = camera(Vec3::ZERO, vec3(0.0, -0.9, -0.9), 70.0);
    let scene = scene(panorama, track, vec![ball(0.05, lambert(0.0), vec3(0.0, 0.0, 2.0))]);
    let renderer = rendered(gpu, &scene, converged(method, &[("relight_levels", "0")]), 128);
    let [real, position] = ["irradiance_real", "position_real"].map(|name| aov(&renderer, name));
    let of = |i: usize| {
        let p = Vec3::from_slice(&position[i]);
        (p.y < -0.899).then(|| 10.0 * under_rectangle(p, low, high, ceiling))
    };
    let known: Vec<f32> = (0..real.len()).filter_map(of).collect();
    let range = known.iter().fold(0.0f32, |a, b| a.max(*b)) / known.iter().fold(f32::MAX, |a, b| a.min(*b));
    let (mean, largest) = irradiance_error(&real, SIZE, of);
    (mean, largest, range)
}

#[test]
fn a_lamp_near_by_lights_by_its_distance() {
    validated(|gpu| {
        let (mean, largest, range) = lamp_error(gpu, Method::Iprt);
        assert!(range > 10.0, "near and far differ: {range}");
        // measured: 0.021, 0.080, the noise of 128 paths
        assert!(mean < 0.035 && largest < 0.14, "{mean}, {largest}");
        let (mean, largest, _) = lamp_error(gpu, Method::Ibl);
        assert!(mean > 0.5 && largest > 2.0, "a light by direction alone is the same everywhere: {mean}, {largest}");
    });
}

// --- ways of drawing directions ---

/// Means over 4×4 pixels of all that is accumulated linearly, one row for each of `repeats` independent accumulations of `frames` frames.
fn repeated(renderer: &mut Renderer, scene: &Scene, frames: u32, repeats: u32) -> Vec<Vec<f64>> {
    let run = |_| {
        accumulate(renderer, scene, 0, frames);
        let images = ["irradiance_real", "irradiance_mixed", "irradiance_virtual", "radiance_specular"];
        let blocks = |name: &str| {
            let image = aov(renderer, name);
            let mean =
                move |block| block_pixels(block, SMALL[0]).iter().map(|i| f64::from(image[*i][1])).sum::<f64>() / 16.0;
            (0..SMALL[0] * SMALL[1] / 16).map(mean)
        };
        images.into_iter().flat_map(blocks).collect()
    };
    (0..repeats).map(run).collect()
}

/// Mean and variance over the repeats, block by block.
fn moments(runs: &[Vec<f64>]) -> Vec<(f64, f64)> {
    let n = runs.len() as f64;
    let of = |i: usize| {
        let mean = runs.iter().map(|run| run[i]).sum::<f64>() / n;
        (mean, runs.iter().map(|run| (run[i] - mean).powi(2)).sum::<f64>() / (n - 1.0))
    };
    (0..runs[0].len()).map(of).collect()
}

#[test]
fn every_way_of_drawing_directions_gives_the_same_light_and_its_variance_falls_with_the_paths() {
    validated(|gpu| {
        const REPEATS: u32 = 24;
        // no skirts (so the panorama is fine enough for the far floor), no mirrors, nothing near a wall; lights bright and wide enough for every way to find
        let lights = |d: Vec3| {
            let lamp = |at: Vec3| if d.dot(at.normalize()) > 0.9 { 6.0 } else { 0.0 };
            Vec3::splat(0.5 + lamp(vec3(0.5, 0.8, 0.2)) + lamp(vec3(-0.9, 0.2, -0.5)))
        };
        let panorama = room([256, 128], vec3(6.0, 3.0, 6.0), Vec3::ZERO, lights);
        let things =
            vec![ball(0.3, lambert(0.6), vec3(-0.35, -0.5, -1.4)), ball(0.3, metal(0.8), vec3(0.4, -0.5, -1.4))];
        let scene = scene(panorama, camera(Vec3::ZERO, vec3(0.0, -0.9, -1.4), 60.0), things);
        let ways = ["brdf", "light", "mis"].map(|directions| {
            let set = [("directions", directions), ("relight_levels", "0"), ("coverage_samples", "1")];
            let options = RenderOptions { size: SMALL, ..converged(Method::Iprt, &set) };
            let mut renderer = rendered(gpu, &scene, options, 0);
            let few = moments(&repeated(&mut renderer, &scene, 3, REPEATS));
            let many = moments(&repeated(&mut renderer, &scene, 12, REPEATS));
            // geometric mean over blocks
            let logs = few.iter().zip(&many).filter(|(a, b)| a.1.min(b.1) > 1e-12).map(|(a, b)| (a.1 / b.1).ln());
            let ratio = (logs.clone().sum::<f64>() / logs.count() as f64).exp();
            // measured: brdf 4.25, light 3.37 (rare paths weigh much), mis 4.12
            assert!((ratio / 4.0 - 1.0).abs() < 0.3, "{directions}: variance falls {ratio} times from 3 to 12 paths");
            (directions, many)
        });
        for (i, (a, first)) in ways.iter().enumerate() {
            for (b, second) in &ways[..i] {
                let error = |(_, variance): (f64, f64)| variance / f64::from(REPEATS);
                let z: Vec<f64> = first
                    .iter()
                    .zip(second)
                    .filter(|(x, y)| x.1 + y.1 > 1e-12)
                    .map(|(x, y)| (x.0 - y.0) / (error(*x) + error(*y)).sqrt())
                    .collect();
                let (mut square, mut largest, mut sum) = (0.0, 0.0f64, 0.0);
                z.iter().for_each(|z| (square, largest, sum) = (square + z * z, largest.max(z.abs()), sum + z));
                let n = z.len() as f64;
                assert!(n > 60.0, "{n} blocks");
                // measured: up to 2.8, z² 0.77 to 0.99, and 0.8 of all together
                let together = sum.abs() / n.sqrt();
                assert!(largest < 5.0 && together < 4.0, "{a} and {b}: z up to {largest}, together {together}");
                assert!(square / n < 1.4, "{a} and {b}: z² is {} in the mean", square / n);
            }
        }
    });
}
