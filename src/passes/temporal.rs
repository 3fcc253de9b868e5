//! Pass 5, `temporal`: accumulation along motion vectors.

use super::{
    resources::Kernel,
    view::{LAYERS_FOLLOW, REAL, Role, Stands, VIRTUAL, View},
};
use crate::{
    Result,
    gpu::{Bind, Frame, Gpu},
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
    /// What of real and of virtual surfaces stands still.
    pub stands: [Stands; 2],
    /// How far history may be from this frame's light, standard deviations; 0 for no clamping.
    pub clamp: f32,
    /// Whether the light of the real scene has changed, too.
    pub video: bool,
    /// Whether any object has moved.
    pub moved: bool,
}

/// The pass, with pipelines by layer, by what stands still, and by whether history is clamped.
pub struct Temporal {
    kernels: Vec<(u32, Stands, bool, Kernel)>,
    history_change: f32,
    /// Follow what objects take along, into the image that `atrous` fills last. Their constants are those of real surfaces.
    follow: Vec<(Stands, Kernel)>,
    brief: bool,
}

impl Temporal {
    pub fn new(gpu: &Gpu, plan: &Plan, role: Role) -> Result<Self> {
        let settings = &plan.settings;
        let clamps = settings.clamp > 0.0;
        let follows = plan.follows() && role == Role::Picture;
        let always = clamps && settings.clamp_when == ClampWhen::Always;
        let sometimes = clamps && (always || plan.on(Part::Motion));
        let lattice = settings.sampling_mask
            && settings.mask_by == MaskBy::History
            && settings.rays_per_pixel == 0.25
            && settings.filter_order == FilterOrder::TemporalFirst;
        let kernel = |layer: u32, stands: Stands, clamp: bool| {
            let constants = [
                ("FOLLOWS", u32::from(follows)),
                ("LAYER", layer),
                ("STANDS", stands as u32),
                ("CLAMP", u32::from(clamp)),
                ("LATTICE", u32::from(lattice)),
                ("BRIEF", u32::from(plan.history_in_brief())),
                (
                    "INPUT_BRIEF",
                    u32::from(settings.filter_order == FilterOrder::SpatialFirst && settings.atrous_levels > 0),
                ),
                ("FILTERED", u32::from(settings.filter_order == FilterOrder::SpatialFirst)),
                plan.constant(Part::Specular),
                plan.constant(Part::Motion),
                ("REFLECTIONS", u32::from(layer == VIRTUAL && plan.on(Part::Reflections))),
                role.projection(plan),
            ];
            let kernel = Kernel::new::<TemporalPush>(gpu, "temporal", shaders::TEMPORAL, &constants)?;
            Ok((layer, stands, clamp, kernel))
        };
        let mut kernels = Vec::new();
        for clamp in [false, true].into_iter().filter(|clamp| if *clamp { sometimes } else { !always }) {
            for stands in Stands::possible(plan) {
                for &layer in role.layers(plan) {
                    kernels.push(kernel(layer, stands, clamp)?);
                }
            }
        }
        let follow = |stands: Stands| {
            let constants = [("STANDS", stands as u32), role.projection(plan)];
            Ok((stands, Kernel::new::<()>(gpu, "follow", shaders::FOLLOW, &constants)?))
        };
        Ok(Self {
            kernels,
            history_change: settings.history_change,
            follow: if follows { Stands::possible(plan).map(follow).collect::<Result<_>>()? } else { Vec::new() },
            brief: plan.history_in_brief(),
        })
    }

    /// Records the dispatches, which accumulate the light in `input`: this frame's, or what atrous made of it.
    pub fn record(&self, frame: &mut Frame, view: &View, input: &str, since: Since) -> Result<()> {
        let push = TemporalPush {
            history_valid: u32::from(since.history),
            clamp_spread: since.clamp,
            clamp_real: u32::from(since.video),
            history_change: self.history_change,
        };
        // Where a layer moves the images have changed places already.
        let moves = since.stands[REAL as usize] == Stands::Nothing;
        let [before, spare] = if moves { ["filtered", "accumulated"] } else { ["accumulated", "filtered"] };
        frame.scope("temporal", |frame| {
            let follow = self.follow.iter().find(|(stands, _)| since.moved && *stands == since.stands[REAL as usize]);
            if let Some((_, follow)) = follow {
                let special = [
                    ("in_accumulated", Bind::from(view.light(before, REAL)?)),
                    ("out_followed_light", Bind::from(view.light(spare, REAL)?)),
                ];
                follow.dispatch(frame, &special, &[&view.resources], &(), view.tiles(REAL))?;
                frame.barrier("temporal changes histories that follow has read, and reads what that found");
            }
            let wanted = |(layer, stands, clamp, _): &&(u32, Stands, bool, Kernel)| {
                (*stands, *clamp) == (since.stands[*layer as usize], since.clamp > 0.0)
            };
            self.kernels.iter().filter(wanted).try_for_each(|(layer, .., kernel)| {
                frame.barrier(LAYERS_FOLLOW);
                // Of these two one is read at most, and without a history in brief none is.
                let other = view.light(if self.brief { "filtered" } else { input }, *layer)?;
                let special = [
                    ("in_irradiance", Bind::from(view.light(input, *layer)?)),
                    ("accumulated", Bind::from(view.light("accumulated", *layer)?)),
                    ("in_accumulated", Bind::from(other)),
                    ("in_followed_light", Bind::from(other)),
                ];
                kernel.dispatch(frame, &special, &[&view.resources], &push, view.tiles(*layer))
            })
        })
    }
}
