//! What a camera off the capture point shows where the capture saw nothing: found exactly, and filled from behind.

use crate::common::*;
use glam::{Vec3, vec3};
use iprt::settings::Method;

const EYE: Vec3 = vec3(0.7, 0.0, 0.0);
const BLOCK: [Vec3; 2] = [vec3(-0.5, -0.5, -2.2), vec3(0.3, 0.5, -1.6)];

/// A red block before blue walls.
fn block_in_room() -> iprt::panorama::source::PanoramaFrame {
    let walls = |d: Vec3| leaves(d, Vec3::splat(-4.0), Vec3::splat(4.0));
    let block = |d: Vec3| enters(d, BLOCK[0], BLOCK[1]);
    surroundings(
        [512, 256],
        move |d| block(d).unwrap_or(walls(d)),
        move |d| if block(d).is_some() { Vec3::X } else { Vec3::Z },
    )
}

/// Whether the block is really there, from where the camera stands.
fn really(direction: Vec3) -> bool {
    enters(direction, BLOCK[0] - EYE - 0.02, BLOCK[1] - EYE + 0.02).is_some()
}

#[test]
fn what_was_never_seen_is_marked_and_shows_what_is_behind() {
    validated(|gpu| {
        let track = camera(EYE, vec3(-0.1, 0.0, -3.0), 70.0);
        let at_centre = camera(Vec3::ZERO, vec3(0.0, 0.0, -1.0), 70.0);
        let red = |set: &[(&str, &str)]| {
            let scene = scene(block_in_room(), track.clone(), vec![ball(0.05, lambert(0.5), vec3(1.2, -0.9, -2.5))]);
            let mut renderer = rendered(gpu, &scene, options(Method::Iprt, set), 1);
            let unknown = renderer.unknown().expect("there is depth");
            let unknown = gpu.read_image(&unknown, 0).expect("readable");
            let picture = aov(&renderer, "camera_radiance");
            let mut wrong = 0;
            for (i, (texel, unknown)) in picture.iter().zip(&unknown).enumerate() {
                let pixel = glam::vec2((i as u32 % SIZE[0]) as f32 + 0.5, (i as u32 / SIZE[0]) as f32 + 0.5);
                let there = really(pixel_direction(&track, 0.0, SIZE, pixel));
                let is_red = texel[0] > 0.5;
                assert!(unknown[0] == 1.0 || is_red == there || on_edge(&track, pixel), "{pixel}: seen, but wrong");
                wrong += usize::from(is_red && !there && !on_edge(&track, pixel));
            }
            let marked = unknown.iter().filter(|texel| texel[0] == 1.0).count();
            assert!((20..1500).contains(&marked), "{marked} pixels of {}", unknown.len());
            wrong
        };
        let (plain, filled) = (red(&[]), red(&[("fill_unseen", "true")]));
        assert!(plain > 20, "the block appears where it is not: {plain} pixels");
        assert!(5 * filled < plain, "{filled} of {plain} are left");

        let scene = scene(block_in_room(), at_centre, vec![ball(0.05, lambert(0.5), vec3(1.2, -0.9, -2.5))]);
        let mut renderer = rendered(gpu, &scene, options(Method::Iprt, &[]), 1);
        let unknown = renderer.unknown().expect("there is depth");
        let unknown = gpu.read_image(&unknown, 0).expect("readable");
        assert!(unknown.iter().all(|texel| texel[0] == 0.0), "from the capture point all was seen");
    });
}

/// Whether the block's outline is within a pixel.
fn on_edge(track: &iprt::scene::camera::CameraTrack, pixel: glam::Vec2) -> bool {
    let around = [(-1.0, 0.0), (1.0, 0.0), (0.0, -1.0), (0.0, 1.0)].map(|(x, y)| glam::vec2(x, y));
    let there = around.map(|by| really(pixel_direction(track, 0.0, SIZE, pixel + 1.5 * by)));
    there.iter().any(|t| *t) && !there.iter().all(|t| *t)
}
