//! Pass 5, `temporal`: accumulation along motion vectors.

use super::{
    resources::Kernel,
    view::{LAYERS_FOLLOW, Role, View},
};
use crate::{
    Error, Result,
    gpu::{Bind, Frame, Gpu, Image},
    gpu_struct,
    plan::{Part, Plan},
    settings::{ClampWhen, FilterOrder, MaskBy},
    shaders,
};

gpu_struct! {
    /// Push constants of `temporal.comp`.
    pub struct TemporalPush { pub history_valid: u32, pub clamp_spread: f32, pub clamp_real: u32 }
}

/// How a frame follows the one before.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Since {
    /// Whether there is a history.
    pub history: bool,
    /// Whether the picture shows the same.
    pub still: bool,
    /// How far history may be from this frame's light, standard deviations; 0 for no clamping.
    pub clamp: f32,
    /// Whether the light of the real scene has changed, too.
    pub video: bool,
}

/// The pass, with pipelines for each layer, by whether a picture is still and whether history is clamped.
pub struct Temporal(Vec<([bool; 2], Vec<Kernel>)>);

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
        let kernels = |[still, clamp]: [bool; 2]| {
            let kernel = |layer: &u32| {
                let constants = [
                    ("LAYER", *layer),
                    ("STILL", u32::from(still)),
                    ("CLAMP", u32::from(clamp)),
                    ("LATTICE", u32::from(lattice)),
                    ("FILTERED", u32::from(settings.filter_order == FilterOrder::SpatialFirst)),
                    plan.constant(Part::Specular),
                    role.projection(plan),
                ];
                Kernel::new::<TemporalPush>(gpu, "temporal", shaders::TEMPORAL, &constants)
            };
            Ok(([still, clamp], role.layers(plan).iter().map(kernel).collect::<Result<_>>()?))
        };
        let kinds = [[true, false], [false, false], [true, true], [false, true]];
        let kinds = kinds.into_iter().filter(|[_, clamp]| if *clamp { sometimes } else { !always });
        kinds.map(kernels).collect::<Result<_>>().map(Self)
    }

    /// Records the dispatches, which accumulate this frame's irradiance or what atrous made of it.
    pub fn record(&self, frame: &mut Frame, view: &View, input: &Image, since: Since) -> Result<()> {
        let kernels = self.0.iter().find(|(known, _)| *known == [since.still, since.clamp > 0.0]);
        let (_, kernels) = kernels.ok_or_else(|| Error::Internal("temporal: clamping is not as planned".into()))?;
        let push = TemporalPush {
            history_valid: u32::from(since.history),
            clamp_spread: since.clamp,
            clamp_real: u32::from(since.video),
        };
        let special = [("in_irradiance", Bind::from(input)), ("out_light", Bind::from(view.image("accumulated")?))];
        frame.scope("temporal", |frame| {
            (0..).zip(kernels).try_for_each(|(layer, kernel)| {
                frame.barrier(LAYERS_FOLLOW);
                kernel.dispatch(frame, &special, &[&view.resources], &push, view.tiles(layer))
            })
        })
    }
}
