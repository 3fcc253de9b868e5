//! Virtual surfaces that are not all there: what is seen through them, their shadows, and glass.

use crate::common::*;
use glam::{Vec3, vec2, vec3};
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
        // measured 0.454 of 0.5, and 0.74 of that under the half
        assert!(dark < 0.95 * lit, "{dark} of {lit}");
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

/// A ball of glass that parts the colours, before a sky that is brighter above: in each pixel the difference between
/// red and blue, against what Snell's law gives for the two indices of refraction.
#[test]
fn glass_parts_the_colours_as_its_dispersion_says() {
    const RADIUS: f32 = 0.5;
    let centre = vec3(0.0, 0.0, -2.0);
    let sky = |d: Vec3| 0.5 + 0.4 * d.y;
    let fresnel = |cosine: f32, eta: f32| -> f32 {
        let behind = 1.0 - eta * eta * (1.0 - cosine * cosine);
        let behind = behind.max(0.0).sqrt();
        let [s, p] = [(eta * cosine, behind), (cosine, eta * behind)].map(|(a, b)| ((a - b) / (a + b)).powi(2));
        0.5 * (s + p)
    };
    // What reaches the eye by refraction, with what is reflected within the ball up to eight times.
    let through = |d: Vec3, ior: f32| -> Option<f32> {
        let middle = d.dot(centre);
        let root = middle * middle - centre.length_squared() + RADIUS * RADIUS;
        let mut x = (root > 0.0).then(|| d * (middle - root.sqrt()))?;
        let normal = (x - centre) / RADIUS;
        if -d.dot(normal) < 0.6 {
            return None; // near the rim a pixel holds too much
        }
        let (mut within, mut share) =
            (d.refract(normal, 1.0 / ior).normalize(), 1.0 - fresnel(-d.dot(normal), 1.0 / 1.5));
        let mut sum = 0.0;
        for _ in 0..8 {
            x -= within * 2.0 * within.dot(x - centre);
            let inward = (centre - x).normalize();
            let reflected = fresnel(-within.dot(inward), 1.5);
            sum += share * (1.0 - reflected) * sky(within.refract(inward, ior));
            share *= reflected;
            within = within.reflect(inward).normalize();
        }
        Some(sum)
    };
    validated(|gpu| {
        let far = room([256, 128], Vec3::splat(400.0), Vec3::ZERO, |d| Vec3::splat(sky(d)));
        let glass = Material {
            transmission: 1.0,
            thickness: 1.0,
            ior: 1.5,
            dispersion: 4.0,
            ..Material::plain("glass", Vec3::ONE, 0.0)
        };
        let look = camera(Vec3::ZERO, centre, 34.0);
        let scene = scene(far, look.clone(), vec![fine_ball(RADIUS, glass, centre)]);
        let renderer = rendered(gpu, &scene, converged(Method::Iprt, &[("bounces", "2")]), 256);
        let (mut both, mut square) = (0.0, 0.0);
        for (i, texel) in aov(&renderer, "radiance").iter().enumerate() {
            let (x, y) = (i as u32 % SIZE[0], i as u32 / SIZE[0]);
            let d = pixel_direction(&look, 0.0, SIZE, vec2(x as f32 + 0.5, y as f32 + 0.5));
            // ± half the spread of KHR_materials_dispersion: 0.025 (n − 1) · 4
            let [Some(red), Some(blue)] = [1.45, 1.55].map(|ior| through(d, ior)) else { continue };
            both += (red - blue) * (texel[0] - texel[2]);
            square += (red - blue) * (red - blue);
        }
        let slope = both / square;
        println!("{slope:.3} of what Snell's law says"); // 0.972; 0.000 without dispersion
        assert!((slope - 1.0).abs() < 0.1, "{slope}");
    });
}

/// A lamp within a ball of coloured glass: its light goes through the glass once, in the picture and in the true scene.
#[test]
fn a_solid_takes_light_of_what_is_inside_it() {
    let centre = vec3(0.0, 0.0, -2.0);
    let glass = Material {
        transmission: 1.0,
        thickness: 1.0,
        ior: 1.0001,
        attenuation_color: vec3(0.1, 0.8, 0.4),
        attenuation_distance: 0.2,
        ..Material::plain("glass", Vec3::ONE, 0.0)
    };
    let lamp = Material { emissive: Vec3::splat(0.5), ..lambert(0.0) };
    let objects = || vec![fine_ball(0.4, glass.clone(), centre), fine_ball(0.2, lamp.clone(), centre)];
    validated(|gpu| {
        let dark = room([64, 32], vec3(8.0, 4.0, 8.0), Vec3::ZERO, |_| Vec3::splat(1e-4));
        let scene = scene(dark, camera(Vec3::ZERO, centre, 10.0), objects());
        let renderer = rendered(gpu, &scene, converged(Method::Iprt, &[("bounces", "2")]), 16);
        let radiance = aov(&renderer, "radiance");
        let middle = radiance[(SIZE[0] * SIZE[1] / 2 + SIZE[0] / 2) as usize];
        for (shown, passes) in middle.iter().zip([0.1, 0.8, 0.4]) {
            assert!((shown / (0.5 * passes) - 1.0).abs() < 0.02, "{middle:?}");
        }
    });
}
