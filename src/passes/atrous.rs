//! Pass 5, `atrous`: the edge-avoiding filter with up to five levels.

use super::{
    resources::Kernel,
    view::{LAYERS_FOLLOW, REAL, Role, View},
};
use crate::{
    Result,
    gpu::{Bind, Frame, Gpu},
    gpu_struct,
    plan::Plan,
    settings::{FilterOrder, Settings},
    shaders,
};

gpu_struct! {
    /// Push constants of `atrous.comp`.
    pub struct AtrousPush { pub step_size: i32, pub sigma_luminance: f32, pub unseen: f32 }
}

/// A share of its light by which a real surface may differ without being seen to, in the picture.
const UNSEEN: f32 = 0.03;

/// The pass, with pipelines for each layer.
pub struct Atrous {
    first: Vec<Kernel>,
    /// The pipelines of the levels between the first and the last.
    middle: Vec<Kernel>,
    last: Vec<Kernel>,
}

impl Atrous {
    pub fn new(gpu: &Gpu, plan: &Plan, role: Role) -> Result<Self> {
        let settings = &plan.settings;
        let levels = settings.atrous_levels;
        let kernels = |first: bool, last: bool| {
            let kernel = |layer: &u32| {
                let constants = [
                    ("LAYER", *layer),
                    ("RADIUS", settings.atrous_radius),
                    ("RAW", u32::from(first && of_this_frame(settings))),
                    ("FIRST", u32::from(first)),
                    ("BRIEF", u32::from(first && plan.history_in_brief())),
                    ("LAST", u32::from(last)),
                    ("RESTS", u32::from(last && *layer == REAL && tells_noise(settings, role))),
                    role.projection(plan),
                ];
                Kernel::new::<AtrousPush>(gpu, "atrous", shaders::ATROUS, &constants)
            };
            role.layers(plan).iter().map(kernel).collect::<Result<Vec<_>>>()
        };
        Ok(Self {
            first: kernels(true, levels == 1)?,
            middle: if levels > 2 { kernels(false, false)? } else { Vec::new() },
            last: if levels > 1 { kernels(false, true)? } else { Vec::new() },
        })
    }

    /// Records the levels. The input is the accumulated a and b, or this frame's irradiance.
    pub fn record(&self, frame: &mut Frame, view: &View, settings: &Settings) -> Result<()> {
        frame.scope("atrous", |frame| {
            (0..settings.atrous_levels).try_for_each(|level| {
                frame.barrier("atrous reads the level below");
                frame.scope(&format!("level {}", level + 1), |frame| self.level(frame, view, settings, level))
            })
        })
    }

    fn level(&self, frame: &mut Frame, view: &View, settings: &Settings, level: u32) -> Result<()> {
        let kernels = match level {
            0 => &self.first,
            level if level + 1 == settings.atrous_levels => &self.last,
            _ => &self.middle,
        };
        // The map is seen in mirrors, and so coarse that all it has is seen.
        let unseen = if view.role == Role::Picture { UNSEEN } else { 0.0 };
        // The farther apart, the less may be taken for noise (after Dammertz et al. 2010, §3), where edges are shadows'.
        let narrowed = [settings.sigma_luminance / ((1 << level) as f32).sqrt(), settings.sigma_luminance];
        (0..).zip(kernels).try_for_each(|(layer, kernel)| {
            let image = |level| view.light(Self::name(level, settings), layer);
            let special = [("in_light", Bind::from(image(level)?)), ("out_light", Bind::from(image(level + 1)?))];
            let push = AtrousPush { step_size: 1 << level, sigma_luminance: narrowed[layer as usize], unseen };
            frame.barrier(LAYERS_FOLLOW);
            kernel.dispatch(frame, &special, &[&view.resources], &push, view.tiles(layer))
        })
    }

    /// The image that holds a and b after the last level.
    pub fn result(settings: &Settings) -> &'static str {
        Self::name(settings.atrous_levels, settings)
    }

    /// Whether an image holds light in brief: what this pass leaves, and what it reads if it can.
    pub fn in_brief(plan: &Plan, image: &str) -> bool {
        match image {
            "accumulated" => plan.history_in_brief(),
            "filtered" | "scratch" => true,
            _ => false,
        }
    }

    fn name(level: u32, settings: &Settings) -> &'static str {
        match level {
            0 if of_this_frame(settings) => "irradiance",
            0 => "accumulated",
            level if (settings.atrous_levels - level).is_multiple_of(2) => "filtered",
            _ => "scratch",
        }
    }
}

/// Whether the last level says how noisy each tile of real surfaces is, so that tiles may rest. Those of the relit map
/// cost little, and mirrors show them.
pub fn tells_noise(settings: &Settings, role: Role) -> bool {
    role == Role::Picture
        && settings.rest_noise > 0.0
        && settings.atrous_levels > 0
        && settings.filter_order == FilterOrder::TemporalFirst
}

/// Whether the filter reads this frame's irradiance: it comes before `temporal`, or nothing is accumulated.
fn of_this_frame(settings: &Settings) -> bool {
    settings.filter_order == FilterOrder::SpatialFirst || !settings.temporal
}
