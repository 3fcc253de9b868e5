//! Pass 2, `sampling_mask`: chooses the pixels that are traced this frame, and lists them.

use super::{
    resources::Kernel,
    view::{Role, View},
};
use crate::{
    Result,
    gpu::{Frame, Gpu, Threads},
    gpu_struct,
    plan::{Part, Plan},
    settings::{MaskBy, Settings},
    shaders,
};

gpu_struct! {
    /// Push constants of `sampling_mask.comp`.
    pub struct SamplingMaskPush {
        pub dense: u32,
        pub history_valid: u32,
        pub short_history: u32,
        pub sharp_roughness: f32,
        pub by_discontinuity: u32,
        pub mask_cosine: f32,
        pub mask_distance: f32,
        pub mark_untraced: u32,
    }
}

pub struct SamplingMask(Kernel);

impl SamplingMask {
    pub fn new(gpu: &Gpu, plan: &Plan, role: Role) -> Result<Self> {
        let in_view = role == Role::Picture && plan.on(Part::VirtualSurfaces);
        let constants = [Part::VirtualSurfaces.constant(u32::from(in_view)), plan.constant(Part::Specular)];
        Ok(Self(Kernel::new::<SamplingMaskPush>(gpu, "sampling_mask", shaders::SAMPLING_MASK, &constants)?))
    }

    /// Records the clearing of the lists, and the dispatch.
    pub fn record(&self, frame: &mut Frame, view: &View, settings: &Settings, history_valid: bool) -> Result<()> {
        let push = SamplingMaskPush {
            dense: u32::from(!settings.sampling_mask),
            history_valid: u32::from(history_valid),
            short_history: settings.short_history,
            sharp_roughness: settings.sharp_roughness,
            by_discontinuity: u32::from(settings.mask_by == MaskBy::Discontinuity),
            mask_cosine: settings.mask_angle.to_radians().cos(),
            mask_distance: settings.mask_distance,
            mark_untraced: u32::from(settings.sampling_mask && !settings.interpolate),
        };
        frame.scope("sampling_mask", |frame| {
            frame.fill(&view.arguments, 0);
            frame.barrier("sampling_mask counts from zero");
            let threads = Threads::Size([view.size[0], view.size[1], 1]);
            self.0.dispatch(frame, &[], &[&view.resources], &push, threads)
        })
    }
}
