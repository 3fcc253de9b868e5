//! `depth_pyramid`, per video frame: the min–max boxes that rays through the panorama walk.

use super::{
    panorama::Panorama,
    resources::{Kernel, Resources},
};
use crate::{
    Result,
    gpu::{Access, Frame, Gpu, Threads},
    gpu_struct, shaders,
};

gpu_struct! {
    /// Push constants of `depth_pyramid.comp`.
    pub struct DepthPyramidPush { pub level: u32, pub width: u32, pub height: u32 }
}

/// See the module.
pub struct DepthPyramid(Kernel);

impl DepthPyramid {
    /// Builds the pipeline.
    pub fn new(gpu: &Gpu) -> Result<Self> {
        const BINDINGS: &[(&str, Access)] = &[
            ("in_view", Access::Read),
            ("in_depth", Access::Read),
            ("in_angles", Access::Read),
            ("pyramid", Access::ReadWrite),
        ];
        Ok(Self(Kernel::new::<DepthPyramidPush>(gpu, "depth_pyramid", shaders::DEPTH_PYRAMID, BINDINGS, &[], &[])?))
    }

    /// Records all levels, finest first.
    pub fn record(&self, frame: &mut Frame, panorama: &Panorama, view: &Resources) -> Result<()> {
        for (level, [width, height]) in panorama.shape.levels.iter().copied().enumerate() {
            if level > 0 {
                frame.barrier("depth_pyramid reads the level below");
            }
            let threads = Threads::Size([width.next_multiple_of(2), height.next_multiple_of(2), 1]);
            let push = DepthPyramidPush { level: level as u32, width, height };
            self.0.dispatch(frame, &[], &[&panorama.resources, view], &push, threads)?;
        }
        Ok(())
    }
}
