//! `unknown`: finds pixels that show what the capture never saw, and `unknown_light`: which share of a pixel's light
//! comes from there. Outside of the frame.

use super::{
    depth_pyramid::DepthPyramid,
    panorama::Panorama,
    resources::{Kernel, Resource, Resources},
};
use crate::{
    Result,
    gpu::{Format, Gpu, Image, Threads},
    plan::{Part, Plan},
    shaders,
};

/// The pass that marks such pixels, with its resources.
pub struct Unknown {
    kernel: Kernel,
    light: Kernel,
    depth_pyramid: DepthPyramid,
    /// The renderer's panorama, but with a pyramid of its own that also has far sides.
    panorama: Panorama,
    prepared: Option<usize>,
    image: Option<Image>,
}

impl Unknown {
    /// Builds the pipelines and allocates for a panorama.
    pub fn new(gpu: &Gpu, panorama: &Panorama, plan: &Plan) -> Result<Self> {
        let lamps = plan.constant(Part::FreeLamps);
        let light = [lamps, plan.halves(), plan.constant(Part::VirtualSurfaces)];
        Ok(Self {
            kernel: Kernel::new::<()>(gpu, "unknown", shaders::UNKNOWN, &[])?,
            light: Kernel::new::<()>(gpu, "unknown_light", shaders::UNKNOWN_LIGHT, &light)?,
            depth_pyramid: DepthPyramid::new(gpu)?,
            panorama: panorama.clone().with_far_sides(gpu)?,
            prepared: None,
            image: None,
        })
    }

    /// Finds such pixels for a view that holds the data of its last frame. `video_frame` is the panorama's.
    ///
    /// # Errors
    /// Fails if the device is lost or out of memory.
    pub fn find(&mut self, gpu: &Gpu, view: &Resources, size: [u32; 2], video_frame: usize) -> Result<Image> {
        self.run(gpu, view, size, video_frame, false)
    }

    /// Finds the share of unknown light for a view that holds the images of its last frame.
    ///
    /// # Errors
    /// Fails if the device is lost or out of memory.
    pub fn light(&mut self, gpu: &Gpu, view: &Resources, size: [u32; 2], video_frame: usize) -> Result<Image> {
        self.run(gpu, view, size, video_frame, true)
    }

    fn run(&mut self, gpu: &Gpu, view: &Resources, size: [u32; 2], video_frame: usize, light: bool) -> Result<Image> {
        let image = match self.image.take().filter(|image| image.size() == size) {
            Some(image) => image,
            None => gpu.image("unknown", size, 1, 1, Format::R32f)?,
        };
        let mut frame = gpu.frame()?;
        if self.prepared != Some(video_frame) {
            self.depth_pyramid.record(&mut frame, &self.panorama, view)?;
            frame.barrier("unknown walks the pyramid");
            self.prepared = Some(video_frame);
        }
        let mut own = Resources::default();
        own.add("unknown", Resource::Image(image.clone()));
        let threads = Threads::Size([size[0], size[1], 1]);
        let kernel = if light { &self.light } else { &self.kernel };
        kernel.dispatch(&mut frame, &[], &[&own, view, &self.panorama.resources], &(), threads)?;
        frame.run()?;
        self.image = Some(image.clone());
        Ok(image)
    }
}
