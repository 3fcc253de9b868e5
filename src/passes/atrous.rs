//! Pass 5, `atrous`: the edge-avoiding filter with up to five levels.

use super::{interpolate::LIST_TILES, resources::Kernel, view::View};
use crate::{
    Result,
    gpu::{Bind, Frame, Gpu, Image, Threads},
    gpu_struct,
    plan::{Part, Plan},
    settings::{FilterOrder, Settings},
    shaders,
};

gpu_struct! {
    /// Push constants of `atrous.comp`.
    pub struct AtrousPush { pub step_size: i32, pub sigma_luminance: f32, pub raw: u32 }
}

pub struct Atrous(Kernel);

impl Atrous {
    pub fn new(gpu: &Gpu, plan: &Plan) -> Result<Self> {
        let constants = [plan.constant(Part::Specular)];
        Ok(Self(Kernel::new::<AtrousPush>(gpu, "atrous", shaders::ATROUS, &constants)?))
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
        let (from, to) = (Self::names(level, settings), Self::names(level + 1, settings));
        let special = [
            ("in_a", Bind::from(view.image(from[0])?)),
            ("in_b", Bind::from(view.image(from[1])?)),
            ("out_a", Bind::from(view.image(to[0])?)),
            ("out_b", Bind::from(view.image(to[1])?)),
        ];
        let raw = level == 0 && of_this_frame(settings);
        let push = AtrousPush { step_size: 1 << level, sigma_luminance: settings.sigma_luminance, raw: u32::from(raw) };
        self.0.dispatch(frame, &special, &[&view.resources], &push, Threads::Indirect(&view.arguments, LIST_TILES))
    }

    /// The images that hold a and b after the last level.
    pub fn result<'a>(view: &'a View, settings: &Settings) -> Result<[&'a Image; 2]> {
        let [a, b] = Self::result_names(settings);
        Ok([view.image(a)?, view.image(b)?])
    }

    /// The names of those images.
    pub fn result_names(settings: &Settings) -> [&'static str; 2] {
        Self::names(settings.atrous_levels, settings)
    }

    fn names(level: u32, settings: &Settings) -> [&'static str; 2] {
        match level {
            0 if of_this_frame(settings) => ["irradiance_a", "irradiance_b"],
            0 => ["a", "b"],
            odd if odd % 2 == 1 => ["filtered_a", "filtered_b"],
            _ => ["scratch_a", "scratch_b"],
        }
    }
}

/// Whether the filter reads this frame's irradiance: it comes before `temporal`, or nothing is accumulated.
fn of_this_frame(settings: &Settings) -> bool {
    settings.filter_order == FilterOrder::SpatialFirst || !settings.temporal
}
