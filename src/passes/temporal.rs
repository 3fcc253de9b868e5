//! Pass 5, `temporal`: accumulation along motion vectors.

use super::{interpolate::LIST_TILES, resources::Kernel, view::View};
use crate::{
    Error, Result,
    gpu::{Bind, Frame, Gpu, Image, Threads},
    gpu_struct,
    plan::{Part, Plan},
    settings::ClampWhen,
    shaders,
};

gpu_struct! {
    /// Push constants of `temporal.comp`.
    pub struct TemporalPush { pub history_valid: u32, pub filtered: u32, pub clamp_spread: f32 }
}

/// What temporal accumulates.
#[derive(Clone, Copy)]
pub enum Input<'a> {
    /// The traced pixels, and the interpolated ones where history is missing.
    Irradiance,
    /// What atrous made of them: every pixel counts.
    Filtered([&'a Image; 2]),
}

/// The pass that accumulates over time.
pub struct Temporal {
    still: Option<Kernel>,
    clamped: Option<Kernel>,
}

impl Temporal {
    /// Builds the pipelines, without and with clamping, where either can be asked for.
    pub fn new(gpu: &Gpu, plan: &Plan) -> Result<Self> {
        let kernel = |clamp: u32| {
            let constants = [("CLAMP", clamp), plan.constant(Part::Specular)];
            Kernel::new::<TemporalPush>(gpu, "temporal", shaders::TEMPORAL, &constants)
        };
        let clamps = plan.settings.clamp > 0.0;
        let always = clamps && plan.settings.clamp_when == ClampWhen::Always;
        Ok(Self {
            still: (!always).then(|| kernel(0)).transpose()?,
            clamped: (clamps && (always || plan.on(Part::Motion))).then(|| kernel(1)).transpose()?,
        })
    }

    /// Records the dispatch, from this frame's irradiance, or from what atrous made of it, into a and b. `clamp_spread` in standard
    /// deviations, 0 for none.
    pub fn record(
        &self,
        frame: &mut Frame,
        view: &View,
        input: Input,
        history_valid: bool,
        clamp_spread: f32,
    ) -> Result<()> {
        let [a, b] = match input {
            Input::Irradiance => [view.image("irradiance_a")?, view.image("irradiance_b")?],
            Input::Filtered(images) => images,
        };
        let special = [("in_irradiance_a", Bind::from(a)), ("in_irradiance_b", Bind::from(b))];
        let kernel = if clamp_spread > 0.0 { &self.clamped } else { &self.still };
        let kernel = kernel.as_ref().ok_or_else(|| Error::Internal("temporal: clamping is not as planned".into()))?;
        let push = TemporalPush {
            history_valid: u32::from(history_valid),
            filtered: u32::from(matches!(input, Input::Filtered(_))),
            clamp_spread,
        };
        kernel.dispatch(frame, &special, &[&view.resources], &push, Threads::Indirect(&view.arguments, LIST_TILES))
    }
}
