//! Virtual surfaces that are not all there: what is seen through them, their shadows, and glass.

use crate::common::*;
use glam::{Vec3, vec3};
use iprt::{
    gpu::Gpu,
    scene::{
        Object,
        material::{Alpha, Material},
        shapes::Shape,
    },
    settings::Method,
};

/// A pane of this material between the camera and the floor, over which a lamp hangs.
fn pane(material: Material) -> Object {
    object(Shape::Box.mesh(vec3(0.8, 0.01, 0.8)), material, vec3(0.0, -0.9, -1.5))
}

/// A room whose ceiling shines.
fn panorama() -> iprt::panorama::source::PanoramaFrame {
    room([128, 64], vec3(4.0, 3.0, 5.0), Vec3::ZERO, |d| Vec3::splat(if d.y > 0.75 { 8.0 } else { 0.5 }))
}

/// Mean radiance of a column of pixels of the converged picture, under the pane and beside it, and M on the pane.
fn shown(gpu: &Gpu, objects: Vec<Object>) -> ([f32; 3], [f32; 3], f32) {
    let look = camera(Vec3::ZERO, vec3(0.0, -0.9, -1.5), 60.0);
    let scene = scene(panorama(), look, objects);
    let mut options = converged(Method::Iprt, &[("relight_width", "64"), ("bounces", "4")]);
    options.size = [64, 36];
    let renderer = rendered(gpu, &scene, options, 48);
    let (picture, coverage) = (aov(&renderer, "radiance"), aov(&renderer, "real_coverage"));
    let mean = |x: std::ops::Range<usize>, y: std::ops::Range<usize>| {
        let all: Vec<[f32; 4]> = y.flat_map(|y| x.clone().map(move |x| 64 * y + x)).map(|p| picture[p]).collect();
        [0, 1, 2].map(|c| all.iter().map(|texel| texel[c]).sum::<f32>() / all.len() as f32)
    };
    (mean(28..36, 16..20), mean(28..36, 30..35), coverage[64 * 18 + 32][0])
}

#[test]
fn what_is_half_there_is_half_seen() {
    validated(|gpu| {
        let red = |alpha, alpha_mode| {
            pane(Material { alpha, alpha_mode, ..iprt::scene::rooms::kit::lambert("red", vec3(0.9, 0.05, 0.05)) })
        };
        let (nothing, floor, all) = shown(gpu, vec![red(0.3, Alpha::Mask(0.5))]);
        let (opaque, shaded, none) = shown(gpu, vec![red(0.7, Alpha::Mask(0.5))]);
        let (half, half_shaded, share) = shown(gpu, vec![red(0.5, Alpha::Blend)]);
        println!("{nothing:?} {opaque:?} {half:?}; {floor:?} {shaded:?} {half_shaded:?}; {all} {none} {share}");
        assert_eq!((all, none), (1.0, 0.0), "a mask is there or not");
        assert!((share - 0.25).abs() < 1e-3, "a pane has two sides, each of which lets half through: {share}");
        for c in 0..3 {
            assert!(half[c] > opaque[c].min(nothing[c]) - 0.02 && half[c] < opaque[c].max(nothing[c]) + 0.02);
        }
        // The shadow, seen below the pane's near edge, is a part as deep.
        let [lit, dark, part] = [floor[1], shaded[1], half_shaded[1]];
        assert!(dark < 0.9 * lit, "{dark} of {lit}");
        let depth = (lit - part) / (lit - dark);
        assert!((depth - 0.75).abs() < 0.15, "{depth} of the shadow instead of 0.75");
    });
}

#[test]
fn glass_colours_what_is_behind_it_and_its_shadow() {
    validated(|gpu| {
        let glass = |color: Vec3, thickness: f32| {
            let material = Material::plain("glass", color, 0.0);
            pane(Material { transmission: 1.0, thickness, ..material })
        };
        let (plain, floor, _) = shown(gpu, vec![glass(Vec3::ONE, 0.0)]);
        for thickness in [0.0, 0.01] {
            let (green, shadow, share) = shown(gpu, vec![glass(vec3(0.1, 0.9, 0.1), thickness)]);
            println!("{thickness}: {green:?} of {plain:?}, shadow {shadow:?} of {floor:?}, M {share}");
            assert_eq!(share, 0.0, "glass is virtual");
            assert!(green[1] > 3.0 * green[0] && green[1] < 1.05 * plain[1], "it takes its colour");
            assert!(shadow[0] < 0.97 * floor[0] && shadow[1] > shadow[0], "so does its shadow: {shadow:?}");
        }
        // An opaque pane's shadow is darker than that of clear glass.
        let (_, opaque, _) = shown(gpu, vec![pane(lambert(0.5))]);
        assert!(opaque[1] < 0.95 * floor[1], "{opaque:?} and {floor:?}");
    });
}
