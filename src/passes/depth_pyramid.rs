//! `depth_pyramid`, per video frame: the boxes that rays through the panorama walk.

use super::{
    panorama::Panorama,
    resources::{Kernel, Resources},
};
use crate::{
    Result,
    gpu::{Frame, Gpu, Threads},
    gpu_struct, shaders,
};

gpu_struct! {
    /// Push constants of `depth_pyramid.comp`.
    pub struct DepthPyramidPush { pub level: u32, pub width: u32, pub height: u32, pub far_sides: u32 }
}

/// See the module.
pub struct DepthPyramid(Kernel);

impl DepthPyramid {
    /// Builds the pipeline.
    pub fn new(gpu: &Gpu) -> Result<Self> {
        Ok(Self(Kernel::new::<DepthPyramidPush>(gpu, "depth_pyramid", shaders::DEPTH_PYRAMID, &[])?))
    }

    /// Records all levels, finest first.
    pub fn record(&self, frame: &mut Frame, panorama: &Panorama, view: &Resources) -> Result<()> {
        for (level, [width, height]) in panorama.shape.levels.iter().copied().enumerate() {
            if level > 0 {
                frame.barrier("depth_pyramid reads the level below");
            }
            for far_sides in 0..=u32::from(panorama.far_sides) {
                if far_sides > 0 {
                    frame.barrier("far sides are in the same image");
                }
                let push = DepthPyramidPush { level: level as u32, width, height, far_sides };
                let pools = [&panorama.resources, view];
                self.0.dispatch(frame, &[], &pools, &push, Threads::Size([width, height, 1]))?;
            }
        }
        Ok(())
    }
}
