//! `radiance_pyramid`, once per video frame: mip levels of the radiance, for pictures coarser than it.

use super::{
    panorama::Panorama,
    resources::{Kernel, Resources},
};
use crate::{
    Result,
    gpu::{Constant, Format, Frame, Gpu, Image, Threads},
    shaders,
};

pub struct RadiancePyramid {
    kernel: Kernel,
    /// Are bound instead of levels of the format that the panorama does not have.
    others: [Image; 2],
}

impl RadiancePyramid {
    /// `halves` says whether the panorama is of 16-bit floats.
    pub fn new(gpu: &Gpu, halves: Constant) -> Result<Self> {
        let format = if halves.1 == 0 { Format::Rgba16f } else { Format::Rgba32f };
        let other = |gpu: &Gpu| gpu.image("no panorama radiance", [1, 1], 1, 1, format);
        Ok(Self {
            kernel: Kernel::new::<()>(gpu, "radiance_pyramid", shaders::RADIANCE_PYRAMID, &[halves])?,
            others: [other(gpu)?, other(gpu)?],
        })
    }

    pub fn record(&self, frame: &mut Frame, panorama: &Panorama) -> Result<()> {
        let image = panorama.radiance();
        frame.scope("radiance_pyramid", |frame| {
            (1..image.levels()).try_for_each(|level| {
                frame.barrier("radiance_pyramid reads the level below");
                let [width, height] = image.level_size(level);
                let levels = [image.level(level - 1), image.level(level)];
                let others = self.others.each_ref().map(|other| other.level(0));
                let [[from, to], [half_from, half_to]] =
                    if image.format() == Format::Rgba32f { [levels, others] } else { [others, levels] };
                let special =
                    [("in_level", from), ("out_level", to), ("in_half_level", half_from), ("out_half_level", half_to)];
                let threads = Threads::Size([width, height, 1]);
                frame.scope(&format!("level {level}"), |frame| {
                    self.kernel.dispatch(frame, &special, &[&Resources::default()], &(), threads)
                })
            })
        })
    }
}
