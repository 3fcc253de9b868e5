//! Pass 6, `composite`: differential rendering with a fractional M.

use super::{resources::Kernel, view::View};
use crate::{
    Result,
    gpu::{Bind, Frame, Gpu, Image, Threads},
    plan::{Part, Plan},
    shaders,
};

/// The pass that makes the picture.
pub struct Composite(Kernel);

impl Composite {
    pub fn new(gpu: &Gpu, plan: &Plan) -> Result<Self> {
        Ok(Self(Kernel::new::<()>(
            gpu,
            "composite",
            shaders::COMPOSITE,
            &[
                ("RELIGHTING", plan.settings.relighting as u32),
                plan.constant(Part::VirtualSurfaces),
                plan.constant(Part::Specular),
                plan.constant(Part::Emission),
                plan.constant(Part::Objects),
            ],
        )?))
    }

    /// Records the dispatch. `light` holds a and b after filtering, if the plan has any.
    pub fn record(&self, frame: &mut Frame, view: &View, light: Option<&Image>) -> Result<()> {
        // Without any, the stand-in for what is left out is bound.
        let light = light.map(Bind::from).or_else(|| view.resources.find("irradiance"));
        let special = light.map(|light| ("in_light", light));
        self.0.dispatch(
            frame,
            special.as_slice(),
            &[&view.resources],
            &(),
            Threads::Size([view.size[0], view.size[1], 1]),
        )
    }
}
