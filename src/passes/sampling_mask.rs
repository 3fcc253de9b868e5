//! Pass 2, `sampling_mask`: chooses the pixels that are traced this frame, and lists them.

use super::{
    resources::{Kernel, Resources},
    view::{LAYERS_FOLLOW, REAL, Role, View},
};
use crate::{
    Result,
    gpu::{Frame, Gpu, Threads},
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
    }
}

gpu_struct! {
    /// Push constants of `tiles.comp`.
    pub struct TilesPush { pub turns: u32, pub history_valid: u32, pub history_change: f32 }
}

/// The pass: which tiles are visited, and which of their pixels are traced.
pub struct SamplingMask {
    tiles: Kernel,
    /// By layer, and by whether it stands still.
    pixels: Vec<(u32, bool, Kernel)>,
    /// How many still frames it takes until tiles may take turns. `None` if they never do.
    turns_after: Option<u32>,
}

impl SamplingMask {
    pub fn new(gpu: &Gpu, plan: &Plan, role: Role) -> Result<Self> {
        let settings = &plan.settings;
        let dense = !settings.sampling_mask;
        let kernel = |layer: u32, still: bool| {
            let constants = [
                ("LAYER", layer),
                ("STILL", u32::from(still)),
                ("DENSE", u32::from(dense)),
                plan.constant(Part::Motion),
                ("BY_DISCONTINUITY", u32::from(settings.mask_by == MaskBy::Discontinuity)),
                ("MARK_UNTRACED", u32::from(settings.sampling_mask && !settings.interpolate)),
                role.projection(plan),
            ];
            let kernel = Kernel::new::<SamplingMaskPush>(gpu, "sampling_mask", shaders::SAMPLING_MASK, &constants)?;
            Ok((layer, still, kernel))
        };
        // What is not traced must have a history, to which a later turn adds.
        let turns = !dense
            && settings.mask_by == MaskBy::History
            && plan.on(Part::Temporal)
            && settings.short_history > 0
            && settings.filter_order == FilterOrder::TemporalFirst;
        let mut pixels = Vec::new();
        for &layer in role.layers(plan) {
            pixels.extend([kernel(layer, false)?, kernel(layer, true)?]);
        }
        let turns_after = turns.then_some(settings.short_history);
        let constants = [plan.constant(Part::LightTable), plan.constant(Part::FreeLamps), plan.constant(Part::Motion)];
        let tiles = Kernel::new::<TilesPush>(gpu, "tiles", shaders::TILES, &constants)?;
        Ok(Self { tiles, pixels, turns_after })
    }

    /// Records the clearing of the lists, and the dispatches. `still` is how many frames in a row each
    /// layer has shown the same as the one before.
    pub fn record(
        &self,
        frame: &mut Frame,
        view: &View,
        settings: &Settings,
        still: [u32; 2],
        history_valid: bool,
        [panorama, scene]: [&Resources; 2],
    ) -> Result<()> {
        let push = SamplingMaskPush {
            history_valid: u32::from(history_valid),
            short_history: settings.short_history,
            sharp_roughness: settings.sharp_roughness,
            mask_cosine: settings.mask_angle.to_radians().cos(),
            mask_distance: settings.mask_distance,
            history_change: settings.history_change,
        };
        let turns = self.turns_after.is_some_and(|frames| still[REAL as usize] > frames);
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
            };
            self.tiles.dispatch(frame, &[], &[&view.resources, panorama, scene], &tiles, threads)?;
            frame.barrier("sampling_mask visits the tiles");
            for (layer, stands, kernel) in &self.pixels {
                if *stands == (still[*layer as usize] > 0) {
                    frame.barrier(LAYERS_FOLLOW);
                    kernel.dispatch(frame, &[], &[&view.resources], &push, view.tiles(*layer))?;
                }
            }
            Ok(())
        })
    }
}
