//! Pass 4, `interpolate`: fills pixels that were not traced from traced neighbours.

use super::{
    resources::Kernel,
    view::{LAYERS_FOLLOW, Role, View},
};
use crate::{
    Result,
    gpu::{Frame, Gpu},
    plan::Plan,
    settings::MaskBy,
    shaders,
};

/// The pass, with a pipeline for each layer.
pub struct Interpolate(Vec<Kernel>);

impl Interpolate {
    /// Builds the pipelines. The radius reaches traced pixels at every sampling rate.
    pub fn new(gpu: &Gpu, plan: &Plan, role: Role) -> Result<Self> {
        let sparse = plan.settings.mask_by == MaskBy::Discontinuity || plan.settings.rays_per_pixel < 0.25;
        let kernel = |layer: &u32| {
            let radius = ("RADIUS", if sparse { 4 } else { 2 });
            Kernel::new::<()>(
                gpu,
                "interpolate",
                shaders::INTERPOLATE,
                &[("LAYER", *layer), radius, role.projection(plan)],
            )
        };
        role.layers(plan).iter().map(kernel).collect::<Result<_>>().map(Self)
    }

    /// Records a dispatch for each layer.
    pub fn record(&self, frame: &mut Frame, view: &View) -> Result<()> {
        frame.scope("interpolate", |frame| {
            (0..).zip(&self.0).try_for_each(|(layer, kernel)| {
                frame.barrier(LAYERS_FOLLOW);
                kernel.dispatch(frame, &[], &[&view.resources], &(), view.tiles(layer))
            })
        })
    }
}
