//! Pass 6, `composite`: differential rendering with fractional M.

use super::{resources::Kernel, view::View};
use crate::{
    Result,
    gpu::{Access, Bind, Frame, Gpu, Image, Threads},
    plan::{Part, Plan},
    shaders,
};

/// See the module.
pub struct Composite(Kernel);

impl Composite {
    /// Builds the pipeline.
    pub fn new(gpu: &Gpu, plan: &Plan) -> Result<Self> {
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
            &[
                (6, plan.settings.relighting as u32),
                plan.constant(Part::VirtualSurfaces),
                plan.constant(Part::Specular),
                plan.constant(Part::Emission),
                plan.constant(Part::Objects),
            ],
        )?))
    }

    /// Records the dispatch; `irradiance` holds a and b after filtering, where there is any.
    pub fn record(&self, frame: &mut Frame, view: &View, irradiance: Option<[&Image; 2]>) -> Result<()> {
        let special = irradiance.map(|[a, b]| [("in_a", Bind::from(a)), ("in_b", Bind::from(b))]);
        let special = special.as_ref().map_or(&[][..], |special| special);
        self.0.dispatch(frame, special, &[&view.resources], &(), Threads::Size([view.size[0], view.size[1], 1]))
    }
}
