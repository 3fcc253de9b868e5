//! Scene truth: a path tracer over a complete scene (`path_trace.comp`), one sample a pixel at a time.

use super::lights::{Light, light_table};
use crate::{
    Error, Result,
    gpu::{Access, Bind, Buffer, Format, Gpu, Image, StructLayout, Threads, struct_layout},
    gpu_struct,
    passes::{
        gbuffer::SCENE_STRUCTS,
        resources::Kernel,
        scene::SceneBuffers,
        view::{ViewData, Viewpoint},
    },
    scene::packed::{PackedInstances, PackedScene},
    shaders,
};
use glam::Vec3;

/// Pixels of one dispatch: a fraction of a second on a CPU, so that no driver's watchdog bites and the terminal stays alive.
const PIXELS_PER_DISPATCH: u32 = 1 << 16;

/// What can be chosen.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PathSettings {
    /// Width and height of the picture, pixels.
    pub size: [u32; 2],
    /// Random seed.
    pub seed: u32,
    /// Bounces of a path, at most: 0 is emission alone, 1 adds direct light.
    pub bounces: u32,
    /// Bounces before a path may be ended at random (Russian roulette).
    pub roulette: u32,
}

gpu_struct! {
    struct Push { pub first_row: u32, pub rows: u32, pub light_count: u32, pub inverse_power: f32, pub bounces: u32, pub roulette: u32 }
}

/// Sums over samples, per pixel from the top left, as `path_trace.comp` explains them.
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
    /// Normal at the pixel's centre and distance in metres (0: nothing there); not summed.
    pub centre: Vec<[f32; 4]>,
}

impl Sums {
    /// Mean radiance, box-filtered over the pixel; alpha 1.
    pub fn radiance(&self) -> Vec<[f32; 4]> {
        let scale = 1.0 / self.samples.max(1) as f32;
        let mean =
            |(a, b): (&[f32; 4], &[f32; 4])| [(a[0] + b[0]) * scale, (a[1] + b[1]) * scale, (a[2] + b[2]) * scale, 1.0];
        self.reflected.iter().zip(&self.other).map(mean).collect()
    }

    /// Standard error of the pixels' mean luminance, as a share of the picture's mean (root mean square over pixels).
    /// Stratification makes the true error smaller.
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

/// A picture being converged.
pub struct PathTracer {
    gpu: Gpu,
    kernel: Kernel,
    scene: SceneBuffers,
    view: ViewData,
    view_buffer: Buffer,
    lights: Buffer,
    push: Push,
    images: [(&'static str, Image); 4],
    samples: u32,
}

impl PathTracer {
    /// Uploads a scene as it is at one time. Positions of `viewpoint` are relative to `centre` (world, metres), which keeps
    /// them small where the scene lies far from the origin.
    ///
    /// # Errors
    /// What does not fit the device; a picture without pixels.
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
        let table = light_table(scene, state);
        let mut buffers = SceneBuffers::new(gpu, scene, state.instances.len())?;
        buffers.update(gpu, state.clone(), centre)?;
        let mut view =
            ViewData { size, seed: settings.seed, instance_count: buffers.instance_count, ..Default::default() };
        viewpoint.write(viewpoint, &mut view);
        let push = Push {
            light_count: table.lights.len() as u32,
            inverse_power: if table.power > 0.0 { (1.0 / table.power) as f32 } else { 0.0 },
            bounces: settings.bounces,
            roulette: settings.roulette,
            ..Default::default()
        };
        let image = |name| Ok((name, gpu.image(name, size, 1, 1, Format::Rgba32f)?));
        Ok(Self {
            gpu: gpu.clone(),
            kernel: kernel(gpu)?,
            scene: buffers,
            view,
            view_buffer: gpu.buffer("path_trace view", size_of::<ViewData>() as u64)?,
            lights: gpu.buffer_with("lights", &table.lights)?,
            push,
            images: [image("reflected")?, image("other")?, image("albedo")?, image("centre")?],
            samples: 0,
        })
    }

    /// Adds one sample to every pixel.
    ///
    /// # Errors
    /// A lost device.
    pub fn sample(&mut self) -> Result<()> {
        self.view.frame = self.samples;
        self.gpu.write_buffer(&self.view_buffer, 0, &[self.view])?;
        let [width, height] = self.view.size;
        let rows = (PIXELS_PER_DISPATCH / width).next_multiple_of(8).max(8);
        for first_row in (0..height).step_by(rows as usize) {
            let mut special = vec![("in_view", Bind::from(&self.view_buffer)), ("in_lights", Bind::from(&self.lights))];
            special.extend(self.images.iter().map(|(name, image)| (*name, Bind::from(image))));
            let push = Push { first_row, rows, ..self.push };
            let mut frame = self.gpu.frame()?;
            let threads = Threads::Size([width, rows.min(height - first_row), 1]);
            self.kernel.dispatch(&mut frame, &special, &[&self.scene.resources], &push, threads)?;
            frame.submit()?;
        }
        self.samples += 1;
        Ok(())
    }

    /// Samples a pixel so far.
    pub fn samples(&self) -> u32 {
        self.samples
    }

    /// Copies the sums back.
    ///
    /// # Errors
    /// A lost device.
    pub fn read(&self) -> Result<Sums> {
        let read = |index: usize| self.gpu.read_image(&self.images[index].1, 0);
        Ok(Sums {
            size: self.view.size,
            samples: self.samples,
            reflected: read(0)?,
            other: read(1)?,
            albedo: read(2)?,
            centre: read(3)?,
        })
    }
}

fn kernel(gpu: &Gpu) -> Result<Kernel> {
    use Access::{Read, ReadWrite};
    const BINDINGS: &[(&str, Access)] = &[
        ("in_view", Read),
        ("in_triangles", Read),
        ("in_shading", Read),
        ("in_vertices", Read),
        ("in_nodes", Read),
        ("in_instances", Read),
        ("in_top_nodes", Read),
        ("in_materials", Read),
        ("in_textures", Read),
        ("in_texels", Read),
        ("in_energy", Read),
        ("in_lights", Read),
        ("reflected", ReadWrite),
        ("other", ReadWrite),
        ("albedo", ReadWrite),
        ("centre", ReadWrite),
    ];
    const STRUCTS: &[StructLayout] = &{
        let mut structs = [struct_layout::<Light>("Light"); SCENE_STRUCTS.len() + 1];
        let mut i = 0;
        while i < SCENE_STRUCTS.len() {
            structs[i] = SCENE_STRUCTS[i];
            i += 1;
        }
        structs
    };
    Kernel::new::<Push>(gpu, "path_trace", shaders::PATH_TRACE, BINDINGS, STRUCTS, &[])
}
