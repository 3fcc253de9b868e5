//! Pass 1, `gbuffer`: primary visibility of panorama and objects, then the fraction M at silhouettes.

use super::{
    resources::{Kernel, Resources},
    scene::SceneBuffers,
    view::{Role, View},
};
use crate::{
    Result,
    gpu::{Frame, Gpu, Threads},
    plan::{Part, Plan},
    shaders,
};

/// What a view's primary rays are for, and where they start.
#[derive(Clone, Copy, Debug)]
pub struct Look {
    /// What the view is for.
    pub role: Role,
    /// Whether the camera is away from the panorama's centre, so that rays are traced through the panorama.
    pub off_centre: bool,
}

/// The pass that finds what each pixel shows.
pub struct Gbuffer {
    centre: Kernel,
    /// Runs if objects are in view.
    coverage: Option<Kernel>,
}

impl Gbuffer {
    pub fn new(gpu: &Gpu, plan: &Plan, look: Look) -> Result<Self> {
        let shown = look.role == Role::Picture;
        let in_view = shown && plan.on(Part::VirtualSurfaces);
        let material = [
            Part::OffCentre.constant(u32::from(look.off_centre)),
            plan.constant(Part::Specular),
            plan.constant(Part::Emission),
            plan.constant(Part::Textures),
            plan.constant(Part::Motion),
            plan.constant(Part::Objects),
        ];
        let minified = Part::RadiancePyramid.constant(u32::from(plan.color_levels() > 1));
        let fill = ("FILL_UNSEEN", u32::from(plan.settings.fill_unseen)); // coverage needs no colour
        let centre = [
            &material[..],
            &[fill, minified, Part::VirtualSurfaces.constant(u32::from(in_view)), ("SHOWN", u32::from(shown))],
        ]
        .concat();
        let coverage = || Kernel::new::<()>(gpu, "coverage", shaders::COVERAGE, &material);
        Ok(Self {
            centre: Kernel::new::<()>(gpu, "gbuffer", shaders::GBUFFER, &centre)?,
            coverage: in_view.then(coverage).transpose()?,
        })
    }

    /// Records one or both dispatches.
    pub fn record(&self, frame: &mut Frame, view: &View, panorama: &Resources, scene: &SceneBuffers) -> Result<()> {
        let threads = || Threads::Size([view.size[0], view.size[1], 1]);
        let pools = [&view.resources, panorama, &scene.resources];
        frame.scope("gbuffer", |frame| {
            self.centre.dispatch(frame, &[], &pools, &(), threads())?;
            let Some(coverage) = &self.coverage else { return Ok(()) };
            frame.barrier("coverage reads its neighbours' visibility");
            coverage.dispatch(frame, &[], &pools, &(), threads())
        })
    }
}
