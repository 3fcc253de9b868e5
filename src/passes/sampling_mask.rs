//! Pass 2, `sampling_mask`: chooses the pixels that are traced this frame, and lists them.

use super::{
    resources::{Kernel, Resources},
    temporal::Since,
    view::{LAYERS_FOLLOW, Role, Stands, View},
};
use crate::{
    Result,
    gpu::{Constant, Frame, Gpu, Threads},
    gpu_struct,
    plan::{Part, Plan},
    settings::{FilterOrder, MaskBy, Settings},
    shaders,
};

gpu_struct! {
    /// Push constants of `sampling_mask.comp`.
    pub struct SamplingMaskPush {
        pub history_valid: u32,
        pub short_history: u32,
        pub sharp_roughness: f32,
        pub mask_cosine: f32,
        pub mask_distance: f32,
        pub history_change: f32,
        pub early_paths: f32,
        pub early_history: f32,
    }
}

gpu_struct! {
    /// Push constants of `tiles.comp`.
    pub struct TilesPush { pub turns: u32, pub history_valid: u32, pub history_change: f32, pub rest_noise: f32, pub still: u32 }
}

/// The pass: which tiles are visited, and which of their pixels are traced.
pub struct SamplingMask {
    tiles: Kernel,
    /// By layer, and by what of it stands still.
    pixels: Vec<(u32, Stands, Kernel)>,
    /// How many steady frames it takes until tiles may take turns. `None` if they never do.
    turns_after: Option<u32>,
}

impl SamplingMask {
    pub fn new(gpu: &Gpu, plan: &Plan, role: Role) -> Result<Self> {
        let settings = &plan.settings;
        let dense = !settings.sampling_mask;
        let kernel = |layer: u32, stands: Stands| {
            let constants = [
                ("LAYER", layer),
                ("STANDS", stands as u32),
                ("DENSE", u32::from(dense)),
                plan.constant(Part::Motion),
                ("BY_DISCONTINUITY", u32::from(settings.mask_by == MaskBy::Discontinuity)),
                ("MARK_UNTRACED", u32::from(settings.sampling_mask && !settings.interpolate)),
                early(plan, role),
                role.projection(plan),
            ];
            let kernel = Kernel::new::<SamplingMaskPush>(gpu, "sampling_mask", shaders::SAMPLING_MASK, &constants)?;
            Ok((layer, stands, kernel))
        };
        // What is not traced must have a history, to which a later turn adds.
        let turns = !dense
            && settings.mask_by == MaskBy::History
            && plan.on(Part::Temporal)
            && settings.short_history > 0
            && settings.filter_order == FilterOrder::TemporalFirst;
        let mut pixels = Vec::new();
        for &layer in role.layers(plan) {
            for stands in Stands::possible(plan) {
                pixels.push(kernel(layer, stands)?);
            }
        }
        let young = if is_early(plan, role) { early_history(settings) / settings.early_paths as f32 } else { 0.0 };
        let turns_after = turns.then_some(settings.short_history.max(young as u32));
        let rests = ("RESTS", u32::from(super::atrous::tells_noise(settings, role)));
        let constants = [
            plan.constant(Part::LightTable),
            plan.constant(Part::FreeLamps),
            plan.constant(Part::Motion),
            rests,
            ("FOLLOWS", u32::from(plan.follows() && role == Role::Picture)),
        ];
        let tiles = Kernel::new::<TilesPush>(gpu, "tiles", shaders::TILES, &constants)?;
        Ok(Self { tiles, pixels, turns_after })
    }

    /// Records the clearing of the lists, and the dispatches. `steady` is how many frames in a row real
    /// surfaces have been shown from one place.
    pub fn record(
        &self,
        frame: &mut Frame,
        view: &View,
        settings: &Settings,
        since: Since,
        steady: u32,
        [panorama, scene]: [&Resources; 2],
    ) -> Result<()> {
        let push = SamplingMaskPush {
            history_valid: u32::from(since.history),
            short_history: settings.short_history,
            sharp_roughness: settings.sharp_roughness,
            mask_cosine: settings.mask_angle.to_radians().cos(),
            mask_distance: settings.mask_distance,
            history_change: settings.history_change,
            early_paths: settings.early_paths as f32,
            early_history: early_history(settings),
        };
        let turns = self.turns_after.is_some_and(|frames| steady > frames);
        frame.scope("sampling_mask", |frame| {
            frame.fill(&view.arguments, 0);
            frame.fill(&view.tile_arguments, 0);
            frame.barrier("sampling_mask counts from zero");
            let [width, height] = view.size.map(|side| side.div_ceil(8));
            let threads = Threads::Size([2 * width * height, 1, 1]);
            let tiles = TilesPush {
                turns: u32::from(turns),
                history_valid: push.history_valid,
                history_change: push.history_change,
                rest_noise: settings.rest_noise,
                still: (0..).zip(since.stands).map(|(layer, stands)| u32::from(stands == Stands::Still) << layer).sum(),
            };
            self.tiles.dispatch(frame, &[], &[&view.resources, panorama, scene], &tiles, threads)?;
            frame.barrier("sampling_mask visits the tiles");
            for (layer, stands, kernel) in &self.pixels {
                if *stands == since.stands[*layer as usize] {
                    frame.barrier(LAYERS_FOLLOW);
                    kernel.dispatch(frame, &[], &[&view.resources], &push, view.tiles(*layer))?;
                }
            }
            Ok(())
        })
    }
}

/// The constant that says whether what is new in the picture is traced more often.
pub fn early(plan: &Plan, role: Role) -> Constant {
    ("EARLY", u32::from(is_early(plan, role)))
}

/// A picture of a single frame is as young as the first of many, though the plan leaves `temporal` out.
fn is_early(plan: &Plan, role: Role) -> bool {
    let Settings { early_history, filter_order, .. } = plan.settings;
    role == Role::Picture && plan.wants_history() && filter_order == FilterOrder::TemporalFirst && early_history > 0
}

/// Returns how many paths a history holds that is no longer young: fewer than it may hold, so that it gets there.
fn early_history(settings: &Settings) -> f32 {
    (settings.early_history as f32).min(settings.history as f32 * (15.0 / 16.0))
}
