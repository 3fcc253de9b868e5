//! Large panoramas, which are kept as 16-bit floats, in memory and on the device.

use crate::common::{self, *};
use glam::{Vec3, vec3};
use iprt::{
    gpu::Format,
    options::RenderOptions,
    panorama::{
        depth::box_depth,
        mapping::texel_direction,
        reduce,
        source::PanoramaFrame,
        texels::{LARGE, Texels},
    },
    passes::panorama::radiance_format,
    scene::viewpoint::Projection,
    settings::Method,
};

/// A little more than is kept as 32-bit floats.
const SIZE_LARGE: [u32; 2] = [4160, 2080];
const SIZE_SMALL: [u32; 2] = [2080, 1040];
/// Beyond the largest 16-bit float.
const LAMP: f32 = 200_000.0;
/// Where 16-bit floats have few digits.
const NIGHT: f32 = 3e-6;

/// A dim room with a lamp of `LAMP` in its ceiling. What is behind the camera is dark as `NIGHT`.
fn radiance(d: Vec3) -> Vec3 {
    let lamp = vec3(0.35, 0.9, -0.25).normalize();
    if d.dot(lamp) > 0.99 {
        return LAMP * vec3(1.0, 0.8, 0.5);
    }
    if d.z > 0.0 { NIGHT * (colourful(d) + 1.0) } else { 100.0 * colourful(d) }
}

fn panoramas() -> [PanoramaFrame; 2] {
    let count = (SIZE_LARGE[0] * SIZE_LARGE[1]) as usize;
    let [width, _] = SIZE_LARGE;
    let texel = |i: usize| {
        let d = texel_direction(i as u32 % width, i as u32 / width, SIZE_LARGE).as_vec3();
        radiance(d).extend(1.0).to_array()
    };
    let large = Texels::make(count, texel);
    assert!(count > LARGE && large.bytes().len() == 8 * count, "kept as 16-bit floats");
    let small = reduce::means(&large.to_vec(), SIZE_LARGE, SIZE_SMALL);
    let depth_size = [256, 128];
    let depth = box_depth(depth_size, vec3(4.0, 2.6, 4.0), Vec3::ZERO, 0.0);
    [(SIZE_LARGE, large), (SIZE_SMALL, small)].map(|(color_size, radiance)| PanoramaFrame {
        color_size,
        radiance,
        depth_size,
        depth: depth.clone(),
        ..Default::default()
    })
}

/// The largest relative difference of the channels of means of 4×4 pixels.
fn apart(a: &common::Texels, b: &common::Texels, width: u32) -> f32 {
    let blocks = 0..a.len() as u32 / 16;
    let mean = |texels: &common::Texels, block: u32, channel: usize| {
        block_pixels(block, width).into_iter().map(|i| texels[i][channel]).sum::<f32>() / 16.0
    };
    let differ = |block: u32, channel: usize| {
        let (a, b) = (mean(a, block, channel), mean(b, block, channel));
        (a - b).abs() / b.max(1e-9)
    };
    blocks.flat_map(|block| (0..3).map(move |channel| (block, channel))).map(|(b, c)| differ(b, c)).fold(0.0, f32::max)
}

#[test]
fn a_large_panorama_gives_the_picture_of_a_small_one() {
    assert_eq!([SIZE_SMALL, SIZE_LARGE].map(radiance_format), [Format::Rgba32f, Format::Rgba16f]);
    let panoramas = panoramas();
    validated(|gpu| {
        // All of it, by its mip levels; then texels themselves, at the lamp and in the dark.
        let whole = RenderOptions { size: [64, 32], projection: Projection::Equirect, ..options(Method::Iprt, &[]) };
        let close = views(&[(Vec3::ZERO, vec3(0.35, 0.9, -0.25), 6.0), (Vec3::ZERO, vec3(0.4, 0.1, 1.0), 2.0)]);
        let pictures = panoramas.clone().map(|panorama| {
            let plain = scene(panorama.clone(), camera(Vec3::ZERO, Vec3::NEG_Z, 60.0), vec![]);
            let whole = aov(&rendered(gpu, &plain, whole.clone(), 1), "radiance");
            let plain = scene(panorama, close.clone(), vec![]);
            let mut near = rendered(gpu, &plain, options(Method::Iprt, &[]), 0);
            let near = [0, 1].map(|second| {
                accumulate(&mut near, &plain, second, 1);
                aov(&near, "radiance")
            });
            (whole, near)
        });
        let [(large, near), (small, near_small)] = &pictures;
        assert!(apart(large, small, 64) < 5e-3, "{}", apart(large, small, 64));
        let brightest = large.iter().map(|texel| texel[0]).fold(0.0, f32::max);
        assert!(brightest > 0.99 * LAMP, "the lamp is {brightest}");
        for (large, small) in near.iter().zip(near_small) {
            assert!(apart(large, small, SIZE[0]) < 5e-3, "{}", apart(large, small, SIZE[0]));
        }
        let dark = near[1].iter().map(|texel| texel[1]).fold(f32::INFINITY, f32::min);
        assert!(dark > NIGHT && near[0].iter().all(|texel| texel[0] > 0.99 * LAMP), "{dark}");

        // What it lights.
        let lit = panoramas.map(|panorama| {
            let things = vec![ball(0.4, lambert(0.5), vec3(0.0, -0.9, -1.2))];
            let scene = scene(panorama, camera(Vec3::ZERO, vec3(0.0, -0.8, -1.2), 50.0), things);
            let renderer = rendered(gpu, &scene, options(Method::Iprt, &[("relight_width", "64")]), 24);
            aov(&renderer, "radiance")
        });
        let [large, small] = lit.map(|picture| picture.iter().map(|texel| texel[0]).collect::<Vec<_>>());
        let sum = |picture: &[f32]| picture.iter().sum::<f32>();
        let difference: f32 = large.iter().zip(&small).map(|(a, b)| (a - b).abs()).sum();
        assert!((sum(&large) / sum(&small) - 1.0).abs() < 0.01, "{} and {}", sum(&large), sum(&small));
        assert!(difference < 0.05 * sum(&small), "{}", difference / sum(&small));
        let top = large.iter().copied().fold(0.0, f32::max);
        assert!(top > 300.0, "the ball is lit by the lamp, up to {top}");
    });
}
