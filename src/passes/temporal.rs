//! Pass 5, `temporal`: accumulation along motion vectors.

use super::{
    resources::Kernel,
    view::{LAYERS_FOLLOW, Role, View},
};
use crate::{
    Result,
    gpu::{Bind, Frame, Gpu, Image},
    gpu_struct,
    plan::{Part, Plan},
    settings::{ClampWhen, FilterOrder, MaskBy},
    shaders,
};

gpu_struct! {
    /// Push constants of `temporal.comp`.
    pub struct TemporalPush { pub history_valid: u32, pub clamp_spread: f32, pub clamp_real: u32, pub history_change: f32 }
}

/// How a frame follows the one before.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Since {
    /// Whether there is a history.
    pub history: bool,
    /// Whether real and virtual surfaces stand still.
    pub still: [bool; 2],
    /// How far history may be from this frame's light, standard deviations; 0 for no clamping.
    pub clamp: f32,
    /// Whether the light of the real scene has changed, too.
    pub video: bool,
}

/// The pass, with pipelines by layer, by whether it stands still, and by whether history is clamped.
pub struct Temporal {
    kernels: Vec<(u32, [bool; 2], Kernel)>,
    history_change: f32,
}

impl Temporal {
    pub fn new(gpu: &Gpu, plan: &Plan, role: Role) -> Result<Self> {
        let settings = &plan.settings;
        let clamps = settings.clamp > 0.0;
        let always = clamps && settings.clamp_when == ClampWhen::Always;
        let sometimes = clamps && (always || plan.on(Part::Motion));
        let lattice = settings.sampling_mask
            && settings.mask_by == MaskBy::History
            && settings.rays_per_pixel == 0.25
            && settings.filter_order == FilterOrder::TemporalFirst;
        let kernel = |layer: u32, [still, clamp]: [bool; 2]| {
            let constants = [
                ("LAYER", layer),
                ("STILL", u32::from(still)),
                ("CLAMP", u32::from(clamp)),
                ("LATTICE", u32::from(lattice)),
                ("HALVES", u32::from(plan.history_in_halves())),
                ("FILTERED", u32::from(settings.filter_order == FilterOrder::SpatialFirst)),
                plan.constant(Part::Specular),
                plan.constant(Part::Motion),
                role.projection(plan),
            ];
            let kernel = Kernel::new::<TemporalPush>(gpu, "temporal", shaders::TEMPORAL, &constants)?;
            Ok((layer, [still, clamp], kernel))
        };
        let kinds = [[true, false], [false, false], [true, true], [false, true]];
        let kinds = kinds.into_iter().filter(|[_, clamp]| if *clamp { sometimes } else { !always });
        let all = kinds.flat_map(|kind| role.layers(plan).iter().map(move |layer| (*layer, kind)));
        let kernels = all.map(|(layer, kind)| kernel(layer, kind)).collect::<Result<_>>()?;
        Ok(Self { kernels, history_change: settings.history_change })
    }

    /// Records the dispatches, which accumulate this frame's irradiance or what atrous made of it.
    pub fn record(&self, frame: &mut Frame, view: &View, input: &Image, since: Since) -> Result<()> {
        let push = TemporalPush {
            history_valid: u32::from(since.history),
            clamp_spread: since.clamp,
            clamp_real: u32::from(since.video),
            history_change: self.history_change,
        };
        let special = [("in_irradiance", Bind::from(input))];
        frame.scope("temporal", |frame| {
            let wanted = |(layer, kind, _): &&(u32, [bool; 2], Kernel)| {
                *kind == [since.still[*layer as usize], since.clamp > 0.0]
            };
            self.kernels.iter().filter(wanted).try_for_each(|(layer, _, kernel)| {
                frame.barrier(LAYERS_FOLLOW);
                kernel.dispatch(frame, &special, &[&view.resources], &push, view.tiles(*layer))
            })
        })
    }
}
