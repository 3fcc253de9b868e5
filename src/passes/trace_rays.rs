//! `trace_rays`: traces any rays against a panorama's surface, outside of a frame. `iprt bench --rays` times
//! it, and a test compares it with an oracle.

use super::{
    depth_pyramid::DepthPyramid,
    normals::Normals,
    panorama::{Needs, Panorama},
    resources::{Kernel, Resource, Resources},
    view::ViewData,
};
use crate::{
    Error, Result,
    gpu::{Bind, Buffer, Gpu, Threads, Timings},
    gpu_struct,
    panorama::{depth::Quality, lamps, source::PanoramaFrame},
    plan::Part,
    settings::{Presence, Settings},
    shaders,
};
use glam::{Vec2, Vec3};

gpu_struct! {
    /// A ray from `origin` (m, relative to the panorama's centre) in a unit `direction`, from `t_min` to
    /// `t_max`.
    pub struct TracedRay { pub origin: Vec3, pub t_min: f32, pub direction: Vec3, pub t_max: f32 }
}

gpu_struct! {
    /// What a ray met: [`FREE`], [`SURFACE`], [`SKIRT`], [`UNSEEN`], or a free lamp ([`LAMP`] + its number), at `t` metres (1e30 if it left). `uv` is where its
    /// radiance is read, `normal` the triangle's, of any length. `unknown` is 1 if it passed through a
    /// skirt's far side, and 0 if that was not asked.
    pub struct RayAnswer { pub t: f32, pub kind: u32, pub uv: Vec2, pub normal: Vec3, pub unknown: u32 }
}

gpu_struct! {
    struct Push { pub count: u32 }
}

/// The ray left the panorama.
pub const FREE: u32 = 0;
/// The ray met a surface.
pub const SURFACE: u32 = 1;
/// The ray met a skirt within the thickness.
pub const SKIRT: u32 = 2;
/// The ray met a skirt farther behind than the thickness, which only edges with a depth of their own have.
pub const UNSEEN: u32 = 3;
/// The ray met the first of the lamps that hang free. The others follow.
pub const LAMP: u32 = 4;

/// How rays are traced.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Tracer {
    /// Against the exact surface (`panorama_trace`).
    Surface,
    /// Also finds rays through far sides (`panorama_unknown`).
    FarSides,
    /// Marched through the depth in this many steps (`panorama_march`).
    March(u32),
}

/// A panorama that is ready for rays.
pub struct RayTracer {
    gpu: Gpu,
    kernel: Kernel,
    panorama: Panorama,
    view: Resources,
    normals: Normals,
    depth_pyramid: DepthPyramid,
    quality: Quality,
    normal_radius: u32,
}

/// Rays on the device, with room for their answers.
pub struct RaySet {
    count: u32,
    rays: Buffer,
    answers: Buffer,
}

impl RaySet {
    /// The number of rays.
    pub fn count(&self) -> u32 {
        self.count
    }
}

impl RayTracer {
    /// Uploads a panorama and prepares it as the renderer does. Only the settings of the real surface matter.
    pub fn new(
        gpu: &Gpu,
        frame: &PanoramaFrame,
        yaw_degrees: f32,
        settings: &Settings,
        tracer: Tracer,
    ) -> Result<Self> {
        let steps = if let Tracer::March(steps) = tracer { steps } else { 0 };
        let free_lamps = settings.free_lamps != Presence::Off && !lamps::find(frame).lamps.is_empty();
        let constants = [
            ("FAR_SIDES", u32::from(tracer == Tracer::FarSides)),
            ("MARCH_STEPS", steps),
            Part::FreeLamps.constant(u32::from(free_lamps)),
        ];
        let kernel = Kernel::new::<Push>(gpu, "trace_rays", shaders::TRACE_RAYS, &constants)?;
        let needs = Needs {
            color_levels: 1,
            codes: None,
            geometry: Ok(()),
            boxes: Ok(()),
            lights: Err(Part::LightTable),
            free_lamps,
            smooth_depth: settings.smooth_depth,
        };
        let mut panorama = Panorama::new(gpu, frame.color_size, frame.depth_size, yaw_degrees, needs)?;
        if tracer == Tracer::FarSides {
            panorama = panorama.with_far_sides(gpu)?;
        }
        let mut upload = gpu.frame()?;
        panorama.upload(&mut upload, frame)?;
        upload.run()?;
        let mut data = ViewData {
            edge_ratio: settings.edge_ratio,
            thickness: settings.thickness,
            edge_depth: u32::from(settings.edge_depth),
            ..ViewData::default()
        };
        panorama.describe(&mut data);
        let mut view = Resources::default();
        view.add("view", Resource::Buffer(gpu.buffer_with("rays view", &[data])?));
        let quality = panorama.quality();
        let ready = Self {
            gpu: gpu.clone(),
            kernel,
            panorama,
            view,
            normals: Normals::new(gpu)?,
            depth_pyramid: DepthPyramid::new(gpu)?,
            quality,
            normal_radius: settings.normal_radius,
        };
        ready.prepare()?;
        Ok(ready)
    }

    /// Derives from the depth what rays need, as each new video frame does.
    pub fn prepare(&self) -> Result<Timings> {
        let mut frame = self.gpu.frame()?;
        self.normals.record(&mut frame, &self.panorama, &self.view, self.quality, self.normal_radius)?;
        frame.barrier("depth_pyramid bounds the depth that normals wrote");
        self.depth_pyramid.record(&mut frame, &self.panorama, &self.view)?;
        frame.run()
    }

    /// Bytes of the pyramid.
    pub fn pyramid_bytes(&self) -> u64 {
        self.panorama.pyramid_bytes()
    }

    pub fn rays(&self, rays: &[TracedRay]) -> Result<RaySet> {
        let count = u32::try_from(rays.len()).map_err(|_| Error::Internal("too many rays".into()))?;
        let answers = self.gpu.buffer("answers", size_of_val(rays) as u64)?;
        Ok(RaySet { count, rays: self.gpu.buffer_with("rays", rays)?, answers })
    }

    /// Traces the rays. Returns milliseconds on the device.
    pub fn trace(&self, set: &RaySet) -> Result<f64> {
        let mut frame = self.gpu.frame()?;
        let special = [("in_rays", Bind::from(&set.rays)), ("out_answers", Bind::from(&set.answers))];
        let pools = [&self.panorama.resources, &self.view];
        let threads = Threads::Size([set.count, 1, 1]);
        self.kernel.dispatch(&mut frame, &special, &pools, &Push { count: set.count }, threads)?;
        Ok(frame.run()?.gpu_ms)
    }

    /// The answers from when the rays were last traced.
    pub fn answers(&self, set: &RaySet) -> Result<Vec<RayAnswer>> {
        let mut answers = self.gpu.read_buffer(&set.answers)?;
        answers.truncate(set.count as usize);
        Ok(answers)
    }
}
