//! What converges to the same: shadows wherever the camera looks, light by every way of drawing directions; and a lamp near by to its closed form.

use crate::common::*;
use glam::{Vec2, Vec3, vec2, vec3};
use iprt::{
    gpu::Gpu,
    options::RenderOptions,
    renderer::Renderer,
    scene::{Scene, camera::CameraTrack},
    settings::Method,
};

const SMALL: [u32; 2] = [32, 24];

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
