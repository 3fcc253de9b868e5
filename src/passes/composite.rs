//! Pass 6, `composite`: differential rendering with fractional M.

use super::{resources::Kernel, view::View};
use crate::{
    Result,
    gpu::{Access, Bind, Frame, Gpu, Image, Threads},
    settings::Settings,
    shaders,
};

/// See the module.
pub struct Composite(Kernel);

impl Composite {
    /// Builds the pipeline.
    pub fn new(gpu: &Gpu, settings: &Settings) -> Result<Self> {
        use Access::{Read, Write};
        const BINDINGS: &[(&str, Access)] = &[
            ("in_view", Read),
            ("in_camera_radiance", Read),
            ("in_albedo_virtual", Read),
            ("in_emission", Read),
            ("in_real_coverage", Read),
            ("in_mask", Read),
            ("in_a", Read),
            ("in_b", Read),
            ("out_radiance", Write),
        ];
        Ok(Self(Kernel::new::<()>(
            gpu,
            "composite",
            shaders::COMPOSITE,
            BINDINGS,
            &[],
            &[(6, settings.relighting as u32)],
        )?))
    }

    /// Records the dispatch; `irradiance` holds a and b after filtering.
    pub fn record(&self, frame: &mut Frame, view: &View, irradiance: [&Image; 2]) -> Result<()> {
        let special = [("in_a", Bind::from(irradiance[0])), ("in_b", Bind::from(irradiance[1]))];
        self.0.dispatch(frame, &special, &[&view.resources], &(), Threads::Size([view.size[0], view.size[1], 1]))
    }
}
