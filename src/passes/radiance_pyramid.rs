//! `radiance_pyramid`, once per video frame: mip levels of the radiance, for pictures coarser than it.

use super::{
    panorama::Panorama,
    resources::{Kernel, Resources},
};
use crate::{
    Result,
    gpu::{Frame, Gpu, Threads},
    shaders,
};

pub struct RadiancePyramid(Kernel);

impl RadiancePyramid {
    pub fn new(gpu: &Gpu) -> Result<Self> {
        Ok(Self(Kernel::new::<()>(gpu, "radiance_pyramid", shaders::RADIANCE_PYRAMID, &[])?))
    }

    pub fn record(&self, frame: &mut Frame, panorama: &Panorama) -> Result<()> {
        let image = panorama.radiance();
        frame.scope("radiance_pyramid", |frame| {
            (1..image.levels()).try_for_each(|level| {
                frame.barrier("radiance_pyramid reads the level below");
                let [width, height] = image.level_size(level);
                let special = [("in_level", image.level(level - 1)), ("out_level", image.level(level))];
                let threads = Threads::Size([width, height, 1]);
                frame.scope(&format!("level {level}"), |frame| {
                    self.0.dispatch(frame, &special, &[&Resources::default()], &(), threads)
                })
            })
        })
    }
}
