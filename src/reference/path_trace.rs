//! Scene truth. A path tracer (`path_trace.comp`) runs over a complete scene, one sample a pixel at a time.
//!
//! Sums do not drift: the device adds [`BATCH`] samples in single precision, and the host adds batches in
//! double.

use crate::{
    Error, Result,
    gpu::{Bind, Buffer, Format, Gpu, Image, Threads, Ticket},
    gpu_struct,
    passes::{
        resources::Kernel,
        scene::{SceneBuffers, relative_to},
        view::ViewData,
    },
    plan::facts::material_constants,
    scene::{
        deform,
        lights::light_table,
        packed::{PackedInstances, PackedScene},
        viewpoint::Viewpoint,
    },
    shaders,
};
use glam::Vec3;
use rayon::prelude::*;

/// Pixels of one dispatch. On a CPU it takes a fraction of a second, so no driver's watchdog bites and the
/// terminal stays alive.
const PIXELS_PER_DISPATCH: u32 = 1 << 16;

/// Samples that are summed in single precision.
pub const BATCH: u32 = 32;

/// How surfaces that shine are found.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum LightSampling {
    /// By points on them and by the lobes' own directions, weighed against each other (Veach 1997).
    #[default]
    Mis,
    /// By points on them alone, except for what mirrors show.
    Lights,
    /// By the lobes' directions alone.
    Lobes,
}

/// What a path tracer can be made with.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PathSettings {
    /// Width and height of the picture, pixels.
    pub size: [u32; 2],
    /// Random seed.
    pub seed: u32,
    /// The most bounces of a path: 0 is emission alone, 1 adds direct light.
    pub bounces: u32,
    /// Bounces before a path may end at random (Russian roulette).
    pub roulette: u32,
    /// All three give the same picture, with different noise.
    pub sampling: LightSampling,
}

impl PathSettings {
    /// Settings for all bounces: only Russian roulette ends paths.
    pub fn unbiased(size: [u32; 2], seed: u32) -> Self {
        Self { size, seed, bounces: u32::MAX, roulette: 3, sampling: LightSampling::Mis }
    }
}

gpu_struct! {
    struct Push {
        pub first_row: u32, pub rows: u32, pub light_count: u32, pub inverse_power: f32, pub bounces: u32, pub roulette: u32,
        pub sampling: u32, pub fresh: u32,
    }
}

/// The number of images that are summed over samples. They are the first of [`PathTracer`]'s images.
const SUMMED: usize = 3;

/// Sums over samples for each pixel, from the top left. `path_trace.comp` explains them.
#[derive(Clone, Debug, Default)]
pub struct Sums {
    /// Width and height.
    pub size: [u32; 2],
    /// Samples a pixel.
    pub samples: u32,
    /// Radiance reflected by the surface at the pixel's centre; w: how many samples met it.
    pub reflected: Vec<[f32; 4]>,
    /// All other radiance; w: squared luminance of `reflected`'s samples.
    pub other: Vec<[f32; 4]>,
    /// Lambert albedo of the surface at the centre; w: squared luminance of all radiance.
    pub albedo: Vec<[f32; 4]>,
    /// Normal at the pixel's centre and distance in metres (0: nothing is there). These are not summed.
    pub centre: Vec<[f32; 4]>,
}

impl Sums {
    /// Returns mean radiance, box-filtered over the pixel, with alpha 1.
    pub fn radiance(&self) -> Vec<[f32; 4]> {
        let scale = 1.0 / self.samples.max(1) as f32;
        let mean =
            |(a, b): (&[f32; 4], &[f32; 4])| [(a[0] + b[0]) * scale, (a[1] + b[1]) * scale, (a[2] + b[2]) * scale, 1.0];
        self.reflected.iter().zip(&self.other).map(mean).collect()
    }

    /// Returns the standard error of the pixels' mean luminance (root mean square over pixels), as a share of
    /// the picture's mean. Stratification makes the true error smaller.
    pub fn relative_noise(&self) -> f64 {
        let n = f64::from(self.samples);
        let luminance = |c: [f32; 4]| 0.2126 * f64::from(c[0]) + 0.7152 * f64::from(c[1]) + 0.0722 * f64::from(c[2]);
        let (mut mean_sum, mut variance_sum) = (0.0, 0.0);
        for (radiance, albedo) in self.radiance().into_iter().zip(&self.albedo) {
            let mean = luminance(radiance);
            mean_sum += mean;
            variance_sum += (f64::from(albedo[3]) / n - mean * mean).max(0.0) / (n - 1.0).max(1.0);
        }
        let pixels = self.albedo.len().max(1) as f64;
        if mean_sum > 0.0 { (variance_sum / pixels).sqrt() / (mean_sum / pixels) } else { 0.0 }
    }
}

/// A picture that is converging.
pub struct PathTracer {
    gpu: Gpu,
    kernel: Kernel,
    scene: SceneBuffers,
    view: ViewData,
    view_buffer: Buffer,
    lights: Buffer,
    push: Push,
    /// Sums since the last whole batch, and what is at the pixels' centres.
    images: [(&'static str, Image); 4],
    /// Sums of whole batches; empty before the first one.
    batches: [Vec<[f64; 4]>; SUMMED],
    samples: u32,
    /// What the device does now.
    in_flight: Option<Ticket>,
    /// The hash of the scene and of the place it is seen from.
    scene_hash: blake3::Hasher,
}

impl PathTracer {
    /// Uploads a scene as it is at one time. Positions of `viewpoint` are relative to `centre` (world,
    /// metres). That keeps them small if the scene lies far from the origin.
    ///
    /// # Errors
    /// Fails if something does not fit the device, or if the picture has no pixels.
    pub fn new(
        gpu: &Gpu,
        scene: &PackedScene,
        state: &PackedInstances,
        centre: Vec3,
        viewpoint: &Viewpoint,
        settings: &PathSettings,
    ) -> Result<Self> {
        let size = settings.size;
        if size.contains(&0) {
            return Err(Error::input(
                "size",
                format!("{size:?} has no pixels"),
                "give a width and a height of at least 1",
            ));
        }
        let scene = &deform::patched(scene, &state.poses);
        let table = light_table(scene, state);
        let buffers = SceneBuffers::new(gpu, scene, state.instances.len(), state.lights.len())?;
        let mut upload = gpu.frame()?;
        buffers.upload(&mut upload, scene, &relative_to(centre, state.clone()), &[], 0.0)?;
        upload.run()?;
        let instance_count = state.instances.len() as u32;
        let mut view = ViewData { size, seed: settings.seed, instance_count, ..Default::default() };
        view.look(viewpoint, viewpoint);
        let push = Push {
            light_count: table.lights.len() as u32,
            inverse_power: if table.power > 0.0 { (1.0 / table.power) as f32 } else { 0.0 },
            bounces: settings.bounces,
            roulette: settings.roulette,
            sampling: settings.sampling as u32,
            ..Default::default()
        };
        let image = |name| Ok((name, gpu.image(name, size, 1, 1, Format::Rgba32f)?));
        Ok(Self {
            gpu: gpu.clone(),
            kernel: Kernel::new::<Push>(gpu, "path_trace", shaders::PATH_TRACE, &material_constants(scene))?,
            scene: buffers,
            view,
            view_buffer: gpu.buffer("path_trace view", size_of::<ViewData>() as u64)?,
            lights: gpu.buffer_with("lights", &table.lights)?,
            scene_hash: hash_scene(scene, state)?.update(bytemuck::bytes_of(&centre)).clone(),
            push,
            images: [image("reflected")?, image("other")?, image("albedo")?, image("centre")?],
            batches: Default::default(),
            samples: 0,
            in_flight: None,
        })
    }

    /// Adds one sample to every pixel.
    ///
    /// # Errors
    /// Fails if the device is lost.
    pub fn sample(&mut self) -> Result<()> {
        let fresh = u32::from(self.samples.is_multiple_of(BATCH));
        if fresh == 1 && self.samples > 0 {
            self.end_batch()?;
        }
        self.view.frame = self.samples;
        let [width, height] = self.view.size;
        let rows = (PIXELS_PER_DISPATCH / width).next_multiple_of(8).max(8);
        for first_row in (0..height).step_by(rows as usize) {
            let buffers = [("in_view", &self.view_buffer), ("in_lights", &self.lights)];
            let mut special: Vec<_> = buffers.map(|(name, buffer)| (name, Bind::from(buffer))).into();
            special.extend(self.images.iter().map(|(name, image)| (*name, Bind::from(image))));
            let push = Push { first_row, rows, fresh, ..self.push };
            let mut frame = self.gpu.frame()?;
            if first_row == 0 {
                frame.write_buffer(&self.view_buffer, 0, &[self.view])?;
                frame.barrier("path_trace reads its view");
            }
            let threads = Threads::Size([width, rows.min(height - first_row), 1]);
            self.kernel.dispatch(&mut frame, &special, &[&self.scene.resources], &push, threads)?;
            // the device has one to do while the next is recorded
            if let Some(before) = self.in_flight.replace(frame.submit()?) {
                before.wait()?;
            }
        }
        self.samples += 1;
        Ok(())
    }

    /// Returns the number of samples a pixel so far.
    pub fn samples(&self) -> u32 {
        self.samples
    }

    /// Returns a hash of what the picture depends on, without the number of samples: the scene and all
    /// settings.
    pub fn hash(&self) -> [u8; 32] {
        let view = ViewData { frame: 0, ..self.view };
        let mut hasher = self.scene_hash.clone();
        hasher.update(bytemuck::bytes_of(&view)).update(bytemuck::bytes_of(&self.push)).finalize().into()
    }

    /// Forgets all samples and starts anew with another seed.
    pub fn restart(&mut self, seed: u32) {
        self.view.seed = seed;
        self.samples = 0;
        self.batches = Default::default();
    }

    /// Copies the sums back.
    ///
    /// # Errors
    /// Fails if the device is lost.
    pub fn read(&self) -> Result<Sums> {
        let sum = |index: usize| -> Result<Vec<[f32; 4]>> {
            let mut sums = self.device_sums(index)?;
            let batches = &self.batches[index];
            if !batches.is_empty() {
                let add = |(sum, batches): (&mut [f32; 4], &[f64; 4])| {
                    *sum = std::array::from_fn(|i| (f64::from(sum[i]) + batches[i]) as f32);
                };
                sums.par_iter_mut().zip(batches).for_each(add);
            }
            Ok(sums)
        };
        Ok(Sums {
            size: self.view.size,
            samples: self.samples,
            reflected: sum(0)?,
            other: sum(1)?,
            albedo: sum(2)?,
            centre: self.gpu.read_image(&self.images[SUMMED].1, 0)?,
        })
    }

    /// Returns all that [`PathTracer::restore`] needs to go on as if nothing had happened.
    ///
    /// # Errors
    /// Fails if the device is lost.
    pub fn save(&self) -> Result<Vec<u8>> {
        let mut bytes = Vec::new();
        bytes.extend(self.hash());
        bytes.extend(self.samples.to_le_bytes());
        for batches in &self.batches {
            bytes.extend(bytemuck::cast_slice::<_, u8>(batches));
        }
        for (_, image) in &self.images {
            bytes.extend(bytemuck::cast_slice::<[f32; 4], u8>(&self.gpu.read_image(image, 0)?));
        }
        Ok(bytes)
    }

    /// Goes on where another tracer of the same scene and settings was saved. Returns false, and changes
    /// nothing, if it was another scene or setting, or if the bytes are not what was saved.
    ///
    /// # Errors
    /// Fails if the device is lost.
    pub fn restore(&mut self, saved: &[u8]) -> Result<bool> {
        let pixels = self.view.size[0] as usize * self.view.size[1] as usize;
        let Some((hash, rest)) = saved.split_first_chunk::<32>() else { return Ok(false) };
        let Some((samples, rest)) = rest.split_first_chunk::<4>() else { return Ok(false) };
        let samples = u32::from_le_bytes(*samples);
        let batches = if samples > BATCH { pixels * size_of::<[f64; 4]>() } else { 0 };
        let image = pixels * size_of::<[f32; 4]>();
        if *hash != self.hash() || rest.len() != SUMMED * batches + self.images.len() * image {
            return Ok(false);
        }
        let (sums, images) = rest.split_at(SUMMED * batches);
        for ((_, to), bytes) in self.images.iter().zip(images.chunks_exact(image)) {
            self.gpu.write_image(to, 0, 0, bytes)?;
        }
        for (index, to) in self.batches.iter_mut().enumerate() {
            *to = sums[index * batches..][..batches].chunks_exact(32).map(bytemuck::pod_read_unaligned).collect();
        }
        self.samples = samples;
        Ok(true)
    }

    fn device_sums(&self, index: usize) -> Result<Vec<[f32; 4]>> {
        self.gpu.read_image(&self.images[index].1, 0)
    }

    fn end_batch(&mut self) -> Result<()> {
        for index in 0..SUMMED {
            let sums = self.device_sums(index)?;
            let batches = &mut self.batches[index];
            batches.resize(sums.len(), [0.0; 4]);
            let add = |(batches, sum): (&mut [f64; 4], &[f32; 4])| (0..4).for_each(|i| batches[i] += f64::from(sum[i]));
            batches.par_iter_mut().zip(&sums).for_each(add);
        }
        Ok(())
    }
}

/// Starts a hash that names what is computed from a scene at one time: the scene and this code.
pub(super) fn hash_scene(scene: &PackedScene, state: &PackedInstances) -> Result<blake3::Hasher> {
    let mut hasher = blake3::Hasher::new();
    let mut part = |bytes: &[u8]| {
        hasher.update(&(bytes.len() as u64).to_le_bytes());
        hasher.update(bytes);
    };
    part(bytemuck::cast_slice(&scene.triangles));
    part(bytemuck::cast_slice(&scene.shading));
    part(bytemuck::cast_slice(&scene.vertices));
    part(bytemuck::cast_slice(&scene.materials));
    part(bytemuck::cast_slice(&scene.textures));
    part(bytemuck::cast_slice(&scene.texels));
    part(bytemuck::cast_slice(&state.instances));
    part(bytemuck::cast_slice(&state.lights));
    part(bytemuck::cast_slice(shaders::current(shaders::PATH_TRACE)?));
    part(env!("CARGO_PKG_VERSION").as_bytes());
    Ok(hasher)
}
