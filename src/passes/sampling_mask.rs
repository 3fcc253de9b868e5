//! Pass 2, `sampling_mask`: chooses the pixels that are traced this frame, and lists them.

use super::{
    resources::Kernel,
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
    }
}

gpu_struct! {
    /// Push constants of `tiles.comp`.
    pub struct TilesPush { pub turns: u32 }
}

/// How the pixels of a layer are chosen.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Choice {
    /// By the mask, in a picture that has moved.
    Moved,
    /// By the mask, in a still picture.
    Still,
    /// All that are in the tiles.
    All,
}

/// The pass: which tiles are visited, and which of their pixels are traced.
pub struct SamplingMask {
    tiles: Kernel,
    pixels: Vec<(u32, Choice, Kernel)>,
    /// How many still frames it takes until tiles may take turns. `None` if they never do.
    turns_after: Option<u32>,
}

impl SamplingMask {
    pub fn new(gpu: &Gpu, plan: &Plan, role: Role) -> Result<Self> {
        let settings = &plan.settings;
        let dense = !settings.sampling_mask;
        let kernel = |layer: u32, choice: Choice| {
            let constants = [
                ("LAYER", layer),
                ("STILL", u32::from(choice != Choice::Moved)),
                ("DENSE", u32::from(dense || choice == Choice::All)),
                ("BY_DISCONTINUITY", u32::from(settings.mask_by == MaskBy::Discontinuity)),
                ("MARK_UNTRACED", u32::from(settings.sampling_mask && !settings.interpolate)),
                role.projection(plan),
            ];
            let kernel = Kernel::new::<SamplingMaskPush>(gpu, "sampling_mask", shaders::SAMPLING_MASK, &constants)?;
            Ok((layer, choice, kernel))
        };
        // What is not traced must have a history, to which a later turn adds.
        let turns = !dense
            && settings.mask_by == MaskBy::History
            && plan.on(Part::Temporal)
            && settings.short_history > 0
            && settings.filter_order == FilterOrder::TemporalFirst;
        let mut pixels = Vec::new();
        for &layer in role.layers(plan) {
            pixels.extend([kernel(layer, Choice::Moved)?, kernel(layer, Choice::Still)?]);
            if layer == REAL && turns {
                pixels.push(kernel(layer, Choice::All)?);
            }
        }
        let turns_after = turns.then_some(settings.short_history);
        Ok(Self { tiles: Kernel::new::<TilesPush>(gpu, "tiles", shaders::TILES, &[])?, pixels, turns_after })
    }

    /// Records the clearing of the lists, and the dispatches. `still` is how many frames have shown the same
    /// as the one before.
    pub fn record(
        &self,
        frame: &mut Frame,
        view: &View,
        settings: &Settings,
        still: u32,
        history_valid: bool,
    ) -> Result<()> {
        let push = SamplingMaskPush {
            history_valid: u32::from(history_valid),
            short_history: settings.short_history,
            sharp_roughness: settings.sharp_roughness,
            mask_cosine: settings.mask_angle.to_radians().cos(),
            mask_distance: settings.mask_distance,
        };
        let turns = self.turns_after.is_some_and(|frames| still > frames);
        frame.scope("sampling_mask", |frame| {
            frame.fill(&view.arguments, 0);
            frame.fill(&view.tile_arguments, 0);
            frame.barrier("sampling_mask counts from zero");
            let [width, height] = view.size.map(|side| side.div_ceil(8));
            let threads = Threads::Size([2 * width * height, 1, 1]);
            self.tiles.dispatch(frame, &[], &[&view.resources], &TilesPush { turns: u32::from(turns) }, threads)?;
            frame.barrier("sampling_mask visits the tiles");
            for (layer, choice, kernel) in &self.pixels {
                let wanted = match still {
                    0 => Choice::Moved,
                    _ if turns && *layer == REAL => Choice::All,
                    _ => Choice::Still,
                };
                if *choice == wanted {
                    frame.barrier(LAYERS_FOLLOW);
                    kernel.dispatch(frame, &[], &[&view.resources], &push, view.tiles(*layer))?;
                }
            }
            Ok(())
        })
    }
}
