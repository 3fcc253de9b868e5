//! Pass 6, `composite`: differential rendering with a fractional M.

use super::{
    resources::Kernel,
    view::{LAYERS_FOLLOW, REAL, Role, VIRTUAL, View},
};
use crate::{
    Result,
    gpu::{Bind, Frame, Gpu, Threads},
    plan::{Part, Plan},
    shaders,
};

/// The pass that makes the picture.
pub struct Composite {
    all: Kernel,
    /// For each layer, over the tiles that were visited.
    visited: Vec<(u32, Kernel)>,
}

impl Composite {
    pub fn new(gpu: &Gpu, plan: &Plan) -> Result<Self> {
        let kernel = |layer: u32, listed: bool| {
            let constants = [
                ("RELIGHTING", plan.settings.relighting as u32),
                ("LAYER", layer),
                plan.result_in_brief(),
                ("DESPECKLE", u32::from(plan.settings.despeckle)),
                ("LISTED", u32::from(listed)),
                plan.constant(Part::VirtualSurfaces),
                plan.constant(Part::Specular),
                plan.constant(Part::Emission),
                plan.constant(Part::Objects),
            ];
            Kernel::new::<()>(gpu, "composite", shaders::COMPOSITE, &constants)
        };
        let layers = if plan.on(Part::Objects) { Role::Picture.layers(plan) } else { &[] };
        let visited = layers.iter().map(|layer| Ok((*layer, kernel(*layer, true)?))).collect::<Result<_>>()?;
        Ok(Self { all: kernel(REAL, false)?, visited })
    }

    /// Records the dispatches. `light` names what holds a and b after filtering, if the plan has any. `still` says that
    /// what is real is as it was, so that only the tiles that were visited can have changed.
    pub fn record(&self, frame: &mut Frame, view: &View, light: Option<&str>, still: bool) -> Result<()> {
        // Without any, the stand-in for what is left out is bound.
        let light = |layer| match light {
            Some(light) => view.light(light, layer).map(|image| Some(Bind::from(image))),
            None => Ok(view.resources.find("irradiance")),
        };
        let [real, seen] = [light(REAL)?, light(VIRTUAL)?];
        let special: Vec<_> = [("in_light", real), ("in_virtual_light", seen)]
            .into_iter()
            .filter_map(|(name, bind)| Some((name, bind?)))
            .collect();
        let pools = [&view.resources];
        if !still {
            let threads = Threads::Size([view.size[0], view.size[1], 1]);
            return self.all.dispatch(frame, &special, &pools, &(), threads);
        }
        frame.scope("composite", |frame| {
            self.visited.iter().try_for_each(|(layer, kernel)| {
                frame.barrier(LAYERS_FOLLOW);
                kernel.dispatch(frame, &special, &pools, &(), view.tiles(*layer))
            })
        })
    }
}
