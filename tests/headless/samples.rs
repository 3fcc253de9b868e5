//! More samples never make it worse: to the converged model, over the length of histories and over rays a pixel.

use crate::{common::*, mitsuba::data_file};
use iprt::{
    gpu::Gpu,
    measure::metrics::{Picture, flip_map},
    options::RenderOptions,
    scene::Scene,
    settings::Method,
};

const SEEDS: u32 = 2;
/// FLIP may rise by so much from one number of samples to the next: a step of 8 bits of grey is 0.004.
const UNSEEN: f32 = 0.002;

/// The converged picture, and its pixels that objects make and that they change.
struct Truth {
    texels: Vec<[f32; 4]>,
    regions: [Vec<usize>; 2],
}

fn truth(gpu: &Gpu, scene: &Scene) -> Truth {
    let set = [("relight_warmup", "64")];
    let renderer = rendered(gpu, scene, RenderOptions { seed: 99, ..options(Method::Reference, &set) }, 512);
    let [texels, before, coverage] = ["radiance", "camera_radiance", "real_coverage"].map(|name| aov(&renderer, name));
    let changed = |i: &usize| coverage[*i][0] >= 0.5 && (texels[*i][1] / before[*i][1] - 1.0).abs() > 0.02;
    let regions =
        [(0..texels.len()).filter(|i| coverage[*i][0] < 0.5).collect(), (0..texels.len()).filter(changed).collect()];
    Truth { texels, regions }
}

/// The mean error of each region over the seeds, and half of its range.
fn errors(gpu: &Gpu, scene: &Scene, truth: &Truth, exposure: f32, frames: u32, set: &[(&str, &str)]) -> [[f32; 2]; 2] {
    let of = |seed| {
        let renderer = rendered(gpu, scene, RenderOptions { seed, ..options(Method::Iprt, set) }, frames);
        let texels = aov(&renderer, "radiance");
        let picture = |subject, texels| Picture { subject, size: SIZE, texels };
        let flip = flip_map(picture("test", &texels), picture("truth", &truth.texels), exposure).expect("alike");
        truth.regions.each_ref().map(|region| region.iter().map(|i| flip[*i]).sum::<f32>() / region.len() as f32)
    };
    let all: Vec<_> = (1..=SEEDS).map(of).collect();
    [0, 1].map(|region| {
        let values = all.iter().map(|values| values[region]);
        let (low, high) = (values.clone().fold(f32::MAX, f32::min), values.clone().fold(0.0, f32::max));
        [values.sum::<f32>() / SEEDS as f32, 0.5 * (high - low)]
    })
}

fn assert_falls(what: &str, series: &[[[f32; 2]; 2]]) {
    for region in [0, 1] {
        let values: Vec<_> = series.iter().map(|errors| errors[region]).collect();
        println!("{what}, region {region}: {values:.4?}");
        for pair in values.windows(2) {
            let most = pair[0][0] + pair[0][1].max(pair[1][1]) + UNSEEN;
            assert!(pair[1][0] <= most, "{what}, region {region}: {values:?}");
        }
        assert!(values[values.len() - 1][0] < values[0][0], "{what}, region {region}: {values:?}");
    }
}

#[test]
fn more_samples_never_make_it_worse() {
    validated(|gpu| {
        let scene = &Scene::load(&data_file("rooms/room/scene.toml")).expect("a good scene");
        let truth = truth(gpu, scene);
        assert!(truth.regions.iter().all(|region| region.len() > 100), "both regions are seen");
        let exposure = 2.0;
        let frames = [1, 4, 16, 64].map(|frames| errors(gpu, scene, &truth, exposure, frames, &[]));
        assert_falls("frames", &frames);
        // Young surfaces are traced at every pixel, however few rays are asked for.
        let rays = ["0.0625", "0.25", "1"].map(|rays| {
            let set = [("rays_per_pixel", rays), ("early_history", "0")];
            errors(gpu, scene, &truth, exposure, 16, &set)
        });
        assert_falls("rays", &rays);
    });
}
