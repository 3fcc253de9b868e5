//! Pass 1, `gbuffer`: primary visibility of panorama and objects, then the fraction M at silhouettes.

use super::{
    resources::{Kernel, Resources},
    scene::SceneBuffers,
    view::{REAL, Role, VIRTUAL, View},
};
use crate::{
    Result,
    gpu::{Constant, Frame, Gpu, Threads},
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
    /// Where real surfaces are kept from the last frame, and objects away from what moves: `touched`, and the same and
    /// `coverage` on the tiles that it lists.
    kept: Option<[Kernel; 3]>,
    /// Runs if objects are in view.
    objects: Option<Objects>,
}

struct Objects {
    coverage: Kernel,
    silhouette: Kernel,
    surface: Kernel,
}

impl Gbuffer {
    pub fn new(gpu: &Gpu, plan: &Plan, look: Look) -> Result<Self> {
        let shown = look.role == Role::Picture;
        let in_view = shown && plan.on(Part::VirtualSurfaces);
        let projection = look.role.projection(plan);
        let materials = plan.materials();
        let material = [
            &materials[..],
            &[plan.constant(Part::Emission), plan.constant(Part::Motion), plan.constant(Part::Deformation), projection],
        ]
        .concat();
        let rays = [
            Part::OffCentre.constant(u32::from(look.off_centre)),
            plan.constant(Part::Objects),
            plan.constant(Part::FreeLamps),
        ];
        let centre = [
            ("FILL_UNSEEN", u32::from(plan.settings.fill_unseen)), // what is behind objects needs no colour
            Part::RadiancePyramid.constant(u32::from(plan.color_levels() > 1)),
            Part::VirtualSurfaces.constant(u32::from(in_view)),
            ("SHOWN", u32::from(shown)),
            plan.halves(),
            ("PAST", u32::from(plan.on(Part::Objects) && plan.on(Part::Temporal))),
            plan.constant(Part::Emission),
            plan.constant(Part::Alpha),
            projection,
        ];
        let [visible, silhouette] = match plan.ray_queries() && in_view {
            true => [shaders::GBUFFER_RAY_QUERY, shaders::SILHOUETTE_RAY_QUERY],
            false => [shaders::GBUFFER, shaders::SILHOUETTE],
        };
        let kernel =
            |name, shader, constants: &[&[Constant]]| Kernel::new::<()>(gpu, name, shader, &constants.concat());
        let coverage = [projection, plan.constant(Part::Reflections)];
        let objects = || {
            Ok(Objects {
                coverage: kernel("coverage", shaders::COVERAGE, &[&coverage])?,
                silhouette: kernel("silhouette", silhouette, &[&material, &rays])?,
                surface: kernel("surface", shaders::SURFACE, &[&material])?,
            })
        };
        let kept = || {
            Ok([
                kernel("touched", shaders::TOUCHED, &[&[projection]])?,
                kernel("gbuffer", visible, &[&rays, &centre, &[("KEPT", 1)]])?,
                kernel("coverage", shaders::COVERAGE, &[&coverage, &[("KEPT", 1)]])?,
            ])
        };
        Ok(Self {
            centre: kernel("gbuffer", visible, &[&rays, &centre])?,
            kept: (in_view && plan.on(Part::Motion)).then(kept).transpose()?,
            objects: in_view.then(objects).transpose()?,
        })
    }

    /// Records the dispatches: for all pixels, and if objects are in view for silhouettes and for the pixels
    /// that show objects. `kept` says that the images hold already what is real, and objects that moved nowhere.
    pub fn record(
        &self,
        frame: &mut Frame,
        view: &View,
        panorama: &Resources,
        scene: &SceneBuffers,
        kept: bool,
    ) -> Result<()> {
        let kept = self.kept.as_ref().filter(|_| kept);
        let all = || Threads::Size([view.size[0], view.size[1], 1]);
        let tiles = || if kept.is_some() { view.tiles(REAL) } else { all() };
        let pools = [&view.resources, panorama, &scene.resources];
        frame.scope("gbuffer", |frame| {
            frame.fill(&view.arguments, 0);
            frame.fill(&view.held_arguments, 0);
            frame.barrier("gbuffer counts from zero");
            if let Some([touched, ..]) = kept {
                frame.fill(&view.tile_arguments, 0);
                frame.barrier("touched counts from zero");
                let [width, height] = view.size.map(|side| side.div_ceil(8));
                touched.dispatch(frame, &[], &pools, &(), Threads::Size([width * height, 1, 1]))?;
                frame.barrier("gbuffer visits the tiles that touched lists");
            }
            let centre = kept.map_or(&self.centre, |[_, centre, _]| centre);
            centre.dispatch(frame, &[], &pools, &(), tiles())?;
            let Some(objects) = &self.objects else { return Ok(()) };
            frame.barrier("coverage reads its neighbours' visibility");
            let coverage = kept.map_or(&objects.coverage, |[.., coverage]| coverage);
            coverage.dispatch(frame, &[], &pools, &(), tiles())?;
            frame.barrier("surface reads M at the centre");
            objects.surface.dispatch(frame, &[], &pools, &(), view.listed(VIRTUAL))?;
            frame.barrier("silhouette goes on with what surface found at the centre");
            objects.silhouette.dispatch(frame, &[], &pools, &(), view.listed(REAL))
        })
    }
}
