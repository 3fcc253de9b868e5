//! What must hold whatever the scene: the picture without influence, the turned panorama, light that is a polynomial of
//! direction.

use crate::common::*;
use glam::{Mat3, Vec3, vec2, vec3};
use iprt::{
    options::RenderOptions,
    panorama::{
        source::{PanoramaFrame, PanoramaSource},
        texels,
    },
    scene::{Object, Scene, camera::CameraTrack, file::RenderSettings, viewpoint::Projection},
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
                        // what was never captured, a view from elsewhere shows as `thickness` and `edge_depth` say
                        Some(_) if second == 2 && matches!(method, Method::Paper | Method::Ibl) => {}
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
        panorama.radiance = texels::Texels::make(panorama.radiance.len(), |i| {
            let square = ((i as u32 % size[0] + i as u32 / size[0]) % 2) as f32;
            [square, square, square, 1.0]
        });
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
    rolled.radiance.change(|_, texels| texels.chunks_mut(width).for_each(|row| row.rotate_right(k)));
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
        frame.radiance.change(|_, texels| {
            texels.iter_mut().flat_map(|texel| &mut texel[..3]).for_each(|x| *x = 1.0 + 0.08 * (*x - 0.6));
        });
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
