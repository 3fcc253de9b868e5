//! Pass 4, `interpolate`: fills pixels that were not traced from traced neighbours.

use super::{resources::Kernel, view::View};
use crate::{
    Result,
    gpu::{Frame, Gpu, Threads},
    gpu_struct,
    plan::{Part, Plan},
    settings::{MaskBy, Settings},
    shaders,
};

/// Byte offset of the tile list's indirect arguments, as in `list.glsl`.
pub const LIST_TILES: u64 = 32;

gpu_struct! {
    /// Push constants of `interpolate.comp`.
    pub struct InterpolatePush { pub radius: i32 }
}

pub struct Interpolate(Kernel);

impl Interpolate {
    pub fn new(gpu: &Gpu, plan: &Plan) -> Result<Self> {
        let constants = [plan.constant(Part::Specular)];
        Ok(Self(Kernel::new::<InterpolatePush>(gpu, "interpolate", shaders::INTERPOLATE, &constants)?))
    }

    /// Records the dispatch. Its radius reaches traced pixels at every sampling rate.
    pub fn record(&self, frame: &mut Frame, view: &View, settings: &Settings) -> Result<()> {
        let sparse = settings.mask_by == MaskBy::Discontinuity || settings.rays_per_pixel < 0.25;
        let push = InterpolatePush { radius: if sparse { 4 } else { 2 } };
        self.0.dispatch(frame, &[], &[&view.resources], &push, Threads::Indirect(&view.arguments, LIST_TILES))
    }
}
