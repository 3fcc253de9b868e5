//! Pass 3, `irradiance`: one path per traced surface. Real surfaces come first, and virtual ones see them
//! relit.

use super::{
    resources::{Kernel, Resources},
    sampling_mask::early,
    scene::SceneBuffers,
    temporal::Since,
    view::{LAYERS_FOLLOW, REAL, Role, Stands, VIRTUAL, View},
};
use crate::{
    Result,
    gpu::{Bind, Frame, Gpu, Image, Threads},
    gpu_struct,
    plan::{Part, Plan},
    settings::VirtualTracer,
    shaders,
};
use rayon::prelude::*;

gpu_struct! {
    /// Push constants of `irradiance.comp`.
    pub struct IrradiancePush { pub screen_thickness: f32, pub screen_stride: f32, pub screen_jitter: f32, pub march_steps: u32, pub least_share: f32, pub history_valid: u32, pub still: u32, pub path_limit: f32, pub packed: u32 }
}

/// The pass that traces paths.
pub struct Irradiance {
    /// Leaves out rays that meet no object, if the settings allow it.
    aim: Option<Kernel>,
    /// A pipeline for each layer.
    layers: Vec<Kernel>,
    push: IrradiancePush,
}

impl Irradiance {
    pub fn new(gpu: &Gpu, plan: &Plan, role: Role) -> Result<Self> {
        let settings = &plan.settings;
        let virtual_tracer = match settings.virtual_tracer {
            // The map shows no objects, so a tracer that walks it would find none.
            VirtualTracer::Screen if role == Role::Relight => VirtualTracer::Bvh,
            tracer => tracer,
        };
        let [irradiance, aimed] = match plan.ray_queries() {
            true => [shaders::IRRADIANCE_RAY_QUERY, shaders::AIM_RAY_QUERY],
            false => [shaders::IRRADIANCE, shaders::AIM],
        };
        let roulette = plan.roulette();
        let emitters = plan.constant(Part::Emitters);
        let kernel = |layer: &u32| {
            let constants = [
                ("LAYER", *layer),
                plan.result_in_brief(),
                plan.halves(),
                ("ROULETTE", u32::from(roulette)),
                role.projection(plan),
                plan.constant(Part::RealTracer),
                ("VIRTUAL_TRACER", virtual_tracer as u32),
                ("RELIGHTING", settings.relighting as u32),
                plan.constant(Part::LightTable),
                plan.constant(Part::FreeLamps),
                plan.constant(Part::VirtualSurfaces),
                plan.constant(Part::Emission),
                emitters,
                plan.constant(Part::Punctual),
                early(plan, role),
                plan.constant(Part::Bounces),
                plan.constant(Part::Motion),
                ("REFLECTIONS", u32::from(*layer == VIRTUAL && plan.on(Part::Reflections))),
                ("PATH_LIMIT", u32::from(plan.limits_paths())),
                ("PICTURED", u32::from(*layer == VIRTUAL && plan.sees_picture())),
            ];
            let constants = [&constants[..], &plan.materials()].concat();
            Kernel::new::<IrradiancePush>(gpu, "irradiance", irradiance, &constants)
        };
        let aim = || {
            let constants = [
                plan.result_in_brief(),
                plan.constant(Part::RealTracer),
                plan.constant(Part::LightTable),
                plan.constant(Part::FreeLamps),
                emitters,
                role.projection(plan),
            ];
            Kernel::new::<IrradiancePush>(gpu, "aim", aimed, &constants)
        };
        Ok(Self {
            aim: roulette.then(aim).transpose()?,
            layers: role.layers(plan).par_iter().map(kernel).collect::<Result<_>>()?,
            push: IrradiancePush {
                screen_thickness: settings.screen_thickness,
                screen_stride: settings.screen_stride,
                screen_jitter: settings.screen_jitter,
                march_steps: settings.march_steps,
                least_share: settings.least_share,
                path_limit: settings.path_limit,
                ..Default::default()
            },
        })
    }

    /// Records a dispatch for each layer. Rays see real surfaces relit, as the map `relit` holds their light.
    /// `last` is the light of the last frame, by layer.
    pub fn record(
        &self,
        frame: &mut Frame,
        view: &View,
        panorama: &Resources,
        scene: &SceneBuffers,
        [relit, last, last_virtual]: [&Image; 3],
        since: Since,
    ) -> Result<()> {
        let push = |layer: u32| IrradiancePush {
            still: u32::from(since.stands[layer as usize] != Stands::Nothing),
            history_valid: u32::from(since.history),
            packed: u32::from(since.stands[REAL as usize] != Stands::Still),
            ..self.push
        };
        let (relit, last) = (("in_relit_light", Bind::from(relit)), ("in_light", Bind::from(last)));
        let last_virtual = ("in_virtual_light", Bind::from(last_virtual));
        let aimed = || [("in_list", Bind::from(&view.aimed)), ("in_arguments", Bind::from(&view.aimed_arguments))];
        let pools = [&view.resources, panorama, &scene.resources];
        frame.scope("irradiance", |frame| {
            if let Some(aim) = &self.aim {
                frame.fill(&view.aimed_arguments, 0);
                frame.barrier("aim counts from zero");
                aim.dispatch(frame, std::slice::from_ref(&last), &pools, &push(REAL), view.listed(REAL))?;
                frame.barrier("irradiance reads what aim left");
            }
            (0..).zip(&self.layers).try_for_each(|(layer, kernel)| {
                let name = if layer == REAL { "real" } else { "virtual" };
                let (mut special, mut threads) =
                    (vec![relit.clone(), last.clone(), last_virtual.clone()], view.listed(layer));
                if layer == REAL && self.aim.is_some() {
                    special.extend(aimed());
                    threads = Threads::Indirect(&view.aimed_arguments, 0);
                }
                frame.barrier(LAYERS_FOLLOW);
                frame.scope(name, |frame| kernel.dispatch(frame, &special, &pools, &push(layer), threads))
            })
        })
    }
}
