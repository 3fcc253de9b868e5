//! `depth_pyramid`, once per video frame: the boxes that rays through the panorama walk.

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

/// The pass that makes the boxes.
pub struct DepthPyramid(Kernel);

impl DepthPyramid {
    pub fn new(gpu: &Gpu) -> Result<Self> {
        Ok(Self(Kernel::new::<DepthPyramidPush>(gpu, "depth_pyramid", shaders::DEPTH_PYRAMID, &[])?))
    }

    /// Records all levels, the finest first.
    pub fn record(&self, frame: &mut Frame, panorama: &Panorama, view: &Resources) -> Result<()> {
        let pools = [&panorama.resources, view];
        frame.scope("depth_pyramid", |frame| {
            for (level, [width, height]) in (0..).zip(panorama.shape.levels.iter().copied()) {
                for far_sides in 0..=u32::from(panorama.far_sides) {
                    // the far sides are in the same image
                    frame.barrier("depth_pyramid reads the level below");
                    let push = DepthPyramidPush { level, width, height, far_sides };
                    let threads = Threads::Size([width, height, 1]);
                    frame.scope(&format!("level {level}"), |frame| {
                        self.0.dispatch(frame, &[], &pools, &push, threads)
                    })?;
                }
            }
            Ok(())
        })
    }
}
