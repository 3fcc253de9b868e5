//! Pass 3, `irradiance`: one path per traced surface. Real surfaces come first, and virtual ones see them
//! relit.

use super::{
    resources::{Kernel, Resource, Resources},
    scene::SceneBuffers,
    view::{Role, View},
};
use crate::{
    Result,
    gpu::{Frame, Gpu, Image, Threads},
    gpu_struct,
    plan::{Part, Plan},
    settings::VirtualTracer,
    shaders,
};

/// Byte offsets of the two lists' indirect arguments, as in `list.glsl`.
const LIST_REAL: u64 = 0;
const LIST_VIRTUAL: u64 = 16;

/// The relit panorama's map of real surfaces, which rays read.
pub struct Relight<'a> {
    /// E_R.
    pub real: &'a Image,
    /// ΔE.
    pub change: &'a Image,
}

gpu_struct! {
    /// Push constants of `irradiance.comp`.
    pub struct IrradiancePush { pub screen_thickness: f32, pub screen_stride: f32, pub screen_jitter: f32, pub march_steps: u32 }
}

/// The pass that traces paths.
pub struct Irradiance {
    real: Kernel,
    /// For virtual surfaces, if there are any in view.
    other: Option<Kernel>,
    /// For the relit map. It shows no objects, so a tracer that walks the picture would find none.
    relight: Option<Kernel>,
    push: IrradiancePush,
}

impl Irradiance {
    pub fn new(gpu: &Gpu, plan: &Plan) -> Result<Self> {
        let settings = &plan.settings;
        let kernel = |layer: u32, virtual_tracer: VirtualTracer| {
            let constants = [
                ("LAYER", layer),
                plan.constant(Part::RealTracer),
                ("VIRTUAL_TRACER", virtual_tracer as u32),
                ("RELIGHTING", settings.relighting as u32),
                plan.constant(Part::LightTable),
                plan.constant(Part::VirtualSurfaces),
                plan.constant(Part::Specular),
                plan.constant(Part::Emission),
                plan.constant(Part::Textures),
                plan.constant(Part::Bounces),
            ];
            Kernel::new::<IrradiancePush>(gpu, "irradiance", shaders::IRRADIANCE, &constants)
        };
        let (real, other) = rayon::join(
            || kernel(0, settings.virtual_tracer),
            || plan.on(Part::VirtualSurfaces).then(|| kernel(1, settings.virtual_tracer)).transpose(),
        );
        Ok(Self {
            real: real?,
            other: other?,
            relight: (plan.on(Part::Relight) && settings.virtual_tracer != VirtualTracer::Bvh)
                .then(|| kernel(0, VirtualTracer::Bvh))
                .transpose()?,
            push: IrradiancePush {
                screen_thickness: settings.screen_thickness,
                screen_stride: settings.screen_stride,
                screen_jitter: settings.screen_jitter,
                march_steps: settings.march_steps,
            },
        })
    }

    /// Records the list of real surfaces, and that of virtual ones if the view shows objects.
    pub fn record(
        &self,
        frame: &mut Frame,
        view: &View,
        panorama: &Resources,
        scene: &SceneBuffers,
        relight: &Relight,
    ) -> Result<()> {
        let mut relit = Resources::default();
        relit.add("relight_real", Resource::Image(relight.real.clone()));
        relit.add("relight_change", Resource::Image(relight.change.clone()));
        let pools = [&view.resources, panorama, &scene.resources, &relit];
        let real = self.relight.as_ref().filter(|_| view.role == Role::Relight).unwrap_or(&self.real);
        frame.scope("irradiance", |frame| {
            let list = |first| Threads::Indirect(&view.arguments, first);
            frame.scope("real", |frame| real.dispatch(frame, &[], &pools, &self.push, list(LIST_REAL)))?;
            let (Role::Picture, Some(other)) = (view.role, &self.other) else { return Ok(()) };
            // the two write different layers of the same images
            frame.barrier("virtual surfaces after real ones");
            frame.scope("virtual", |frame| other.dispatch(frame, &[], &pools, &self.push, list(LIST_VIRTUAL)))
        })
    }
}
