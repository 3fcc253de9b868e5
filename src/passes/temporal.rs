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

/// What to accumulate.
#[derive(Clone, Copy)]
pub enum Input<'a> {
    /// Traced pixels, and interpolated ones where there is no history.
    Irradiance,
    /// What atrous made of them, where every pixel counts.
    Filtered([&'a Image; 2]),
}

pub struct Temporal {
    still: Option<Kernel>,
    clamped: Option<Kernel>,
}

impl Temporal {
    /// Builds the pipelines with and without clamping, as far as the plan can use them.
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

    /// Records the dispatch, which accumulates `input` into a and b. `clamp_spread` is in standard deviations,
    /// 0 for no clamping.
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
