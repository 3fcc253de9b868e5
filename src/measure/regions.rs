//! Splits a picture into the regions by which errors are reported: where virtual objects are seen, and which
//! real pixels they change.

use crate::{
    Result,
    gpu::Gpu,
    options::RenderOptions,
    reference::{
        denoise::denoise_view,
        truth::{tracer, viewpoint},
    },
    renderer::Renderer,
    scene::{CompleteScene, Scene},
};
use rayon::prelude::*;

/// Objects influence a pixel if they change the luminance of its 5×5 mean by more than this share.
const INFLUENCE: f32 = 0.02;

/// The masks of the regions, with one value for each pixel.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Regions {
    /// Pixels that are less than half real.
    pub virtual_: Vec<bool>,
    /// Real pixels whose 5×5 mean of radiance changes by more than 2 %.
    pub influenced: Vec<bool>,
}

/// Finds the regions from two truths in linear radiance, with and without the objects, and from the real
/// share `real_coverage` (M) of each pixel. Each mean is the Rec. 709 luminance over the 5×5 pixels around a
/// pixel, as far as they are in the picture.
pub fn regions(size: [u32; 2], with: &[[f32; 4]], without: &[[f32; 4]], real_coverage: &[f32]) -> Regions {
    let virtual_: Vec<bool> = real_coverage.iter().map(|m| *m < 0.5).collect();
    let (before, after) = (means(size, without), means(size, with));
    let changed = |(a, b): (&f32, &f32)| (b - a).abs() > INFLUENCE * a;
    let influenced =
        before.iter().zip(&after).map(changed).zip(&virtual_).map(|(changed, hidden)| changed && !hidden).collect();
    Regions { virtual_, influenced }
}

/// Mean luminance of the 5×5 pixels around each pixel.
fn means(size: [u32; 2], texels: &[[f32; 4]]) -> Vec<f32> {
    let [width, height] = size.map(|side| side as usize);
    let mean = |index: usize| {
        let (x, y) = (index % width, index / width);
        let (mut sum, mut count) = (0.0, 0.0);
        for row in y.saturating_sub(2)..(y + 3).min(height) {
            for [r, g, b, _] in &texels[row * width + x.saturating_sub(2)..row * width + (x + 3).min(width)] {
                sum += 0.2126 * r + 0.7152 * g + 0.0722 * b;
                count += 1.0;
            }
        }
        sum / count
    };
    (0..width * height).into_par_iter().map(mean).collect()
}

/// Finds the regions by model truth: the converged model of `options`, which include the objects, at `time`
/// seconds. Nothing in the picture without objects is random, so only the picture with objects takes
/// `samples` paths a pixel. `progress` is called `samples` + 1 times.
///
/// # Errors
/// Fails if the renderer fails.
pub fn of_model(
    gpu: &Gpu,
    scene: &Scene,
    options: &RenderOptions,
    time: f64,
    samples: u32,
    mut progress: impl FnMut(),
) -> Result<Regions> {
    let mut renderer = Renderer::new(gpu, scene, RenderOptions { without_objects: true, ..options.clone() })?;
    renderer.render(scene, time)?;
    progress();
    let without = renderer.picture()?;
    drop(renderer);
    let mut renderer = Renderer::new(gpu, scene, options.clone())?;
    for _ in 0..samples.max(1) {
        renderer.render(scene, time)?;
        progress();
    }
    Ok(regions(options.size, &renderer.picture()?, &without, &renderer.real_coverage()?))
}

/// Finds the regions by scene truth, from the true scene `with` and `without` the objects at frame `frame`.
/// Both pictures take the same random numbers, so that their noise is the same where the objects have no
/// influence. Both are filtered, so that a few samples are enough. The renderer tells which pixels are
/// virtual. `progress` is called 2 · `samples` times.
///
/// # Errors
/// Fails if the renderer or the [`PathTracer`](crate::reference::path_trace::PathTracer) fails.
pub fn of_scene(
    gpu: &Gpu,
    scene: &Scene,
    options: &RenderOptions,
    [with, without]: [&CompleteScene; 2],
    frame: u32,
    samples: u32,
    mut progress: impl FnMut(),
) -> Result<Regions> {
    let mut truth = |complete: &CompleteScene| {
        let mut tracer = tracer(gpu, complete, options.projection, options.size, options.seed, frame)?;
        for _ in 0..samples.max(1) {
            tracer.sample()?;
            progress();
        }
        Ok(denoise_view(&tracer.read()?, &viewpoint(complete, options.projection, options.size, frame)))
    };
    let (with, without) = (truth(with)?, truth(without)?);
    let mut options = options.clone();
    options.settings.relight_levels = 0; // its light is not asked for
    let mut renderer = Renderer::new(gpu, scene, options)?;
    renderer.render(scene, scene.panorama.frame_time(frame as usize))?;
    Ok(regions(renderer.options().size, &with, &without, &renderer.real_coverage()?))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_changed_pixel_influences_the_five_by_five_about_it() {
        let size = [9, 8];
        let without = vec![[1.0, 1.0, 1.0, 1.0]; 72];
        let mut with = without.clone();
        let mut coverage = vec![1.0; 72];
        // One pixel shows an object. Another one is half an object, and still counts as real.
        (coverage[8 * 9 - 1], coverage[0]) = (0.49, 0.5);
        // The 5×5 mean at (3, 3) changes by 2.1 %.
        with[3 * 9 + 3] = [1.525, 1.525, 1.525, 1.0];
        let found = regions(size, &with, &without, &coverage);
        for (i, (hidden, influenced)) in found.virtual_.iter().zip(&found.influenced).enumerate() {
            let (x, y) = (i % 9, i / 9);
            assert_eq!(*hidden, i == 71, "{x}, {y}");
            assert_eq!(*influenced, (1..=5).contains(&x) && (1..=5).contains(&y), "{x}, {y}");
        }
        with[3 * 9 + 3] = [1.475, 1.475, 1.475, 1.0];
        let found = regions(size, &with, &without, &coverage);
        // A whole window changes by 1.9 %, a window that the picture's edge cuts changes by more.
        assert!(!found.influenced[3 * 9 + 3] && found.influenced[9 + 2], "{:?}", found.influenced);
    }

    #[test]
    fn an_object_does_not_influence_its_own_pixels() {
        let (dark, bright) = ([[0.1, 0.1, 0.1, 1.0]; 25], [[5.0, 5.0, 5.0, 1.0]; 25]);
        let found = regions([5, 5], &bright, &dark, &[0.0; 25]);
        assert!(found.virtual_.iter().all(|v| *v) && !found.influenced.contains(&true));
    }
}
