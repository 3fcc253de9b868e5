//! Keeps the truths of one picture in the cache folder, under a hash of all that they depend on.
//!
//! A truth consists of *batches*: independent pictures, each with its own seed and file. An interrupted run
//! loses only the batch in flight. Even and odd batches make two halves, whose difference is the truth's own
//! noise. In each half a pixel's brightest batches are left out, if they are outliers: `docs/truth.md` says
//! why, [`Truth::outliers`] how much light that takes away.

use super::path_trace::{PathSettings, PathTracer, hash_scene};
use crate::{
    Error, Result,
    gpu::Gpu,
    image_file::{
        checked::{read_checked, write_checked},
        write::make_cache_folder,
    },
    options::RenderOptions,
    passes::view::ViewData,
    renderer::Renderer,
    scene::{
        CompleteScene, Scene,
        camera::Camera,
        viewpoint::{Projection, Viewpoint},
    },
    settings::{Method, Settings},
    shaders,
};
use glam::Vec3;
use rayon::prelude::*;
use std::{
    path::Path,
    sync::atomic::{AtomicBool, Ordering},
};

const MAGIC: &[u8] = b"iprt truth 1\n";
/// Changes when this program computes truths in another way without a change of a shader.
const VERSION: u32 = 2;
/// Samples of a batch of scene truth.
pub const SCENE_BATCH: u32 = 16;
/// Paths of a batch of model truth.
pub const MODEL_BATCH: u32 = 16;
/// Frames that the relit panorama of each half of model truth is accumulated for before the first batch.
pub const MODEL_WARM_UP: u32 = 64;
/// Added to the seed, so that no picture is compared with a truth made of the same random numbers.
const SEED: u32 = 0x7472_7574;
const BATCHES: u32 = 8;
/// A batch that is this many times as bright as the rest is left out.
pub const OUTLIER: f32 = 4.0;

/// Says where truths are kept and when to stop.
#[derive(Clone, Copy, Debug)]
pub struct Keep<'a> {
    /// The folder of truths ([`cache_folder`](super::capture::cache_folder)). Without one nothing is kept.
    pub folder: Option<&'a Path>,
    /// Ends the work once it is set.
    pub stop: &'a AtomicBool,
}

impl Keep<'_> {
    /// # Errors
    /// Fails with [`Error::Interrupted`] if the work is to stop.
    pub fn go_on(&self, subject: &str) -> Result<()> {
        if !self.stop.load(Ordering::Relaxed) {
            return Ok(());
        }
        Err(Error::Interrupted {
            subject: subject.to_owned(),
            at: "as asked".to_owned(),
            remedy: "what was done is kept: give the same command to go on".to_owned(),
        })
    }
}

/// A truth and its noise.
#[derive(Clone, Debug, PartialEq)]
pub struct Truth {
    /// Width and height, pixels.
    pub size: [u32; 2],
    /// Mean of both halves: linear radiance, RGBA, row 0 on top.
    pub radiance: Vec<[f32; 4]>,
    /// Independent estimates, with half the samples each.
    pub halves: [Vec<[f32; 4]>; 2],
    /// Samples a pixel, both halves together.
    pub spp: u32,
    /// The share of the picture's luminance that was in outliers and is left out.
    pub outliers: f64,
}

/// Returns the truth of the complete true scene at a time in seconds. Of `options`, size, projection and seed
/// count. `spp` is rounded up to two equal numbers of batches. `tick` is called after each sample, including
/// those that were kept.
///
/// # Errors
/// Fails as [`PathTracer::new`] does, or with [`Error::Interrupted`].
pub fn truth_of_scene(
    gpu: &Gpu,
    scene: &CompleteScene,
    options: &RenderOptions,
    time: f64,
    spp: u32,
    keep: Keep,
    tick: &mut dyn FnMut(),
) -> Result<Truth> {
    let state = scene.at(time);
    let viewpoint = scene_viewpoint(options, &state.camera);
    let [batch, count] = batches(spp, SCENE_BATCH);
    let mut view = ViewData { size: options.size, seed: options.seed, ..Default::default() };
    view.look(&viewpoint, &viewpoint);
    let mut hasher = hash_scene(&scene.packed, &state.instances)?;
    hasher.update(bytemuck::bytes_of(&view)).update(bytemuck::bytes_of(&state.camera.position));
    let name = name(hasher, "scene", batch);
    let mut kept: Option<PathTracer> = None;
    let make = |index: u32, tick: &mut dyn FnMut()| {
        let seed = options.seed.wrapping_add(SEED + index);
        let tracer = match &mut kept {
            Some(tracer) => tracer,
            None => {
                let settings = PathSettings::unbiased(options.size, seed);
                let centre = state.camera.position;
                kept.insert(PathTracer::new(gpu, &scene.packed, &state.instances, centre, &viewpoint, &settings)?)
            }
        };
        tracer.restart(seed);
        for _ in 0..batch {
            keep.go_on(&scene.name)?;
            tracer.sample()?;
            tick();
        }
        Ok(tracer.read()?.radiance())
    };
    collect(options.size, [batch, count], &name, keep, make, tick)
}

/// Returns the truth of `iprt`'s model (`reference --model panorama`) at a time in seconds. Of `options`,
/// size, projection and seed count, and whether there are objects. The settings are those of
/// [`Method::Reference`] with `overrides` over them.
///
/// # Errors
/// Fails as [`Renderer::new`] does, or with [`Error::Interrupted`].
#[allow(clippy::too_many_arguments, reason = "each is one thing that a truth depends on")]
pub fn truth_of_model(
    gpu: &Gpu,
    scene: &Scene,
    options: &RenderOptions,
    overrides: &[(String, String)],
    time: f64,
    spp: u32,
    keep: Keep,
    tick: &mut dyn FnMut(),
) -> Result<Truth> {
    let [batch, count] = batches(spp, MODEL_BATCH);
    let mut settings = Settings::of(Method::Reference);
    settings.relight_warmup = MODEL_WARM_UP;
    for (key, value) in overrides {
        settings.set(key, value, &scene.name)?;
    }
    let options = RenderOptions { method: Method::Reference, settings, ..options.clone() };
    let mut hasher = hash_rendered(scene, time)?;
    hasher.update(describe(&options).as_bytes());
    let name = name(hasher, "model", batch);
    // Each half has a renderer of its own, so that the error of its relit panorama counts as noise of that
    // half.
    let mut of_half: Option<(u32, Renderer)> = None;
    let make = |index: u32, tick: &mut dyn FnMut()| {
        let mut renderer = match of_half.take() {
            Some((half, mut renderer)) if half == index % 2 => {
                renderer.restart_picture();
                renderer
            }
            _ => {
                let options = RenderOptions { seed: options.seed.wrapping_add(SEED + index), ..options.clone() };
                Renderer::new(gpu, scene, options)?
            }
        };
        for _ in 0..batch {
            keep.go_on(&scene.name)?;
            renderer.render(scene, time)?;
            tick();
        }
        let picture = renderer.picture()?;
        of_half = Some((index % 2, renderer));
        Ok(picture)
    };
    collect(options.size, [batch, count], &name, keep, make, tick)
}

/// Starts a hash of all that the renderer makes of a scene at one time: the scene and the shaders.
///
/// # Errors
/// Fails if the panorama cannot be read.
pub fn hash_rendered(scene: &Scene, time: f64) -> Result<blake3::Hasher> {
    let state = scene.at(time, time);
    let mut hasher = hash_scene(&scene.packed, &state.instances)?;
    let panorama = scene.panorama.load(scene.panorama.frame_at(time))?;
    hasher.update(bytemuck::cast_slice(&[panorama.color_size, panorama.depth_size]));
    hasher.update(panorama.radiance.bytes()).update(bytemuck::cast_slice(&panorama.depth));
    let place = (scene.panorama.position, scene.panorama.yaw_degrees, panorama.quantisation);
    hasher.update(format!("{place:?} {:?}", state.camera).as_bytes());
    hasher.update(&shaders::digest()?.to_le_bytes()).update(&VERSION.to_le_bytes());
    Ok(hasher)
}

/// Returns all settings as text.
pub fn describe(options: &RenderOptions) -> String {
    let RenderOptions { size, method: _, settings, projection, seed, without_objects, eye } = options;
    format!("{size:?} {projection:?} {seed} {without_objects} {eye} {:?}", settings.values())
}

fn scene_viewpoint(options: &RenderOptions, camera: &Camera) -> Viewpoint {
    match options.projection {
        Projection::Perspective => {
            Viewpoint::perspective(Vec3::ZERO, camera.rotation, camera.fov_y_degrees, options.size)
        }
        Projection::Equirect => Viewpoint::equirect(Vec3::ZERO, camera.rotation),
    }
}

/// Returns the samples of a batch, and an even number of batches that hold `spp`, at least four a half.
fn batches(spp: u32, most: u32) -> [u32; 2] {
    let batch = (spp / BATCHES).clamp(1, most);
    [batch, 2 * spp.div_ceil(2 * batch).max(BATCHES / 2)]
}

/// Returns how many samples are taken where `spp` are asked for, in batches of at most `most`.
pub fn rounded(spp: u32, most: u32) -> u32 {
    let [batch, count] = batches(spp, most);
    batch * count
}

fn name(mut hasher: blake3::Hasher, model: &str, batch: u32) -> String {
    hasher.update(model.as_bytes()).update(&batch.to_le_bytes()).update(&VERSION.to_le_bytes());
    format!("truth-{}", &hasher.finalize().to_hex()[..32])
}

fn collect(
    size: [u32; 2],
    [batch, count]: [u32; 2],
    name: &str,
    keep: Keep,
    mut make: impl FnMut(u32, &mut dyn FnMut()) -> Result<Vec<[f32; 4]>>,
    tick: &mut dyn FnMut(),
) -> Result<Truth> {
    let folder = keep.folder.map(|folder| folder.join(name));
    let mut all: [Vec<Vec<[f32; 4]>>; 2] = Default::default();
    // One half follows the other.
    for index in (0..count).step_by(2).chain((1..count).step_by(2)) {
        let file = folder.as_ref().map(|folder| folder.join(format!("{index:04}")));
        let kept = file.as_deref().and_then(|file| load(file, size));
        let texels = match kept {
            Some(texels) => {
                (0..batch).for_each(|_| tick());
                texels
            }
            None => {
                let texels = make(index, tick)?;
                if let Some(file) = &file
                    && let Err(error) = store(file, &texels)
                {
                    tracing::warn!("a truth is not kept: {error}");
                }
                texels
            }
        };
        all[index as usize % 2].push(texels);
    }
    let (halves, raw): (Vec<_>, Vec<f64>) = all.iter().map(|half| mean_without_outliers(half)).unzip();
    let [a, b] = <[Vec<[f32; 4]>; 2]>::try_from(halves).map_err(|_| Error::Internal("two halves".to_owned()))?;
    let radiance: Vec<[f32; 4]> = a.iter().zip(&b).map(|(a, b)| std::array::from_fn(|c| 0.5 * (a[c] + b[c]))).collect();
    let kept: f64 = 2.0 * radiance.iter().map(|texel| f64::from(luminance(texel))).sum::<f64>();
    let raw: f64 = raw.iter().sum();
    let outliers = if raw > 0.0 { ((raw - kept) / raw).max(0.0) } else { 0.0 };
    Ok(Truth { size, radiance, halves: [a, b], spp: batch * count, outliers })
}

fn luminance([r, g, b, _]: &[f32; 4]) -> f32 {
    0.2126 * r + 0.7152 * g + 0.0722 * b
}

/// Returns the mean over batches without outliers, and the luminance summed over pixels with outliers.
fn mean_without_outliers(batches: &[Vec<[f32; 4]>]) -> (Vec<[f32; 4]>, f64) {
    let pixel = |index: usize| {
        let mut values: Vec<[f32; 4]> = batches.iter().map(|batch| batch[index]).collect();
        values.sort_by(|a, b| luminance(a).total_cmp(&luminance(b)));
        let all = values.iter().map(luminance).sum::<f32>() / values.len() as f32;
        for _ in 0..batches.len() / 4 {
            let Some((last, rest)) = values.split_last() else { break };
            let mean = rest.iter().map(luminance).sum::<f32>() / rest.len() as f32;
            if luminance(last) <= OUTLIER * mean {
                break;
            }
            values.pop();
        }
        let scale = 1.0 / values.len() as f32;
        let mean: [f32; 4] = std::array::from_fn(|c| values.iter().map(|value| value[c]).sum::<f32>() * scale);
        (mean, f64::from(all))
    };
    let pixels = batches.first().map_or(0, Vec::len);
    let (texels, with): (Vec<_>, Vec<f64>) = (0..pixels).into_par_iter().map(pixel).unzip();
    (texels, with.iter().sum())
}

fn store(file: &Path, texels: &[[f32; 4]]) -> Result<()> {
    make_cache_folder(file)?;
    let values: Vec<f32> = texels.iter().flat_map(|[r, g, b, _]| [*r, *g, *b]).collect();
    write_checked(file, MAGIC, bytemuck::cast_slice(&values))
}

/// Returns `None` if there is no such batch, or if the file is not as it was written.
fn load(file: &Path, size: [u32; 2]) -> Option<Vec<[f32; 4]>> {
    if !file.exists() {
        return None;
    }
    let length = size[0] as usize * size[1] as usize * 12;
    let content = read_checked(file, MAGIC).ok().flatten().filter(|content| content.len() == length);
    if content.is_none() {
        tracing::warn!("{}: damaged, it is computed again", file.display());
    }
    let value = |bytes: &[u8]| bytemuck::pod_read_unaligned::<f32>(bytes);
    let texel = |t: &[u8]| [value(&t[..4]), value(&t[4..8]), value(&t[8..]), 1.0];
    content.map(|content| content.chunks_exact(12).map(texel).collect())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn batches_are_even_and_hold_the_samples() {
        assert_eq!(batches(1, 16), [1, 8]);
        assert_eq!(batches(8, 16), [1, 8]);
        assert_eq!(batches(64, 16), [8, 8]);
        assert_eq!(batches(65, 16), [8, 10]);
        assert_eq!(batches(256, 16), [16, 16]);
    }

    #[test]
    fn one_firefly_of_four_batches_is_left_out_and_told() {
        let grey = |v: f32| vec![[v, v, v, 1.0], [1.0, 1.0, 1.0, 1.0]];
        let (mean, with) = mean_without_outliers(&[grey(1.0), grey(50.0), grey(0.5), grey(1.5)]);
        assert_eq!(mean, grey(1.0));
        assert!((with - (53.0 / 4.0 + 1.0)).abs() < 1e-5, "{with}");
        // There is no noise, and of three batches none is an outlier.
        assert_eq!(mean_without_outliers(&[grey(1.0), grey(3.0), grey(0.5), grey(1.5)]).0, grey(1.5));
        assert_eq!(mean_without_outliers(&[grey(1.0), grey(50.0), grey(0.0)]).0, grey(17.0));
    }
}
