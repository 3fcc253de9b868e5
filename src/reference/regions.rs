//! The regions of a scene's picture that errors are told apart by ([`crate::measure::regions`]), from one truth or the other.

use super::{
    denoise::denoise_view,
    truth::{tracer, viewpoint},
};
use crate::{
    Result,
    gpu::Gpu,
    measure::regions::{Regions, regions},
    renderer::{RenderOptions, Renderer},
    scene::{CompleteScene, Scene},
};

/// By model truth: the converged model of `options`, which have objects, at `time` seconds. Nothing in the picture without objects is random,
/// so only that with them takes `samples` paths a pixel. `progress` is called `samples` + 1 times.
///
/// # Errors
/// As [`Renderer`].
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
    Ok(regions(options.size, &renderer.picture()?, &without, &coverage(&renderer)?))
}

/// By scene truth, `with` objects and `without`, frame `frame`. Both take the same random numbers, so that where the objects have no influence their
/// noise is the same, and are filtered, so that a few samples are enough. Which pixels are virtual, the renderer says. `progress` is called 2 · `samples` times.
///
/// # Errors
/// As [`Renderer`] and [`PathTracer`](super::path_trace::PathTracer).
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
    Ok(regions(renderer.options().size, &with, &without, &coverage(&renderer)?))
}

/// M of each pixel.
fn coverage(renderer: &Renderer) -> Result<Vec<f32>> {
    Ok(renderer.aov("real_coverage")?.iter().map(|texel| texel[0]).collect())
}
