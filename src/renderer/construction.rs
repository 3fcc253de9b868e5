//! Makes a renderer: the pipelines, images and buffers that its plan needs.

#[cfg(feature = "faults")]
use super::Fault;
use super::{Lighting, Preparation, Renderer};
use crate::{
    Error, Result,
    gpu::{Format, Gpu, Timings},
    options::RenderOptions,
    passes::{
        atrous::Atrous,
        composite::Composite,
        depth_pyramid::DepthPyramid,
        gbuffer::{Gbuffer, Look},
        ingest::Ingest,
        interpolate::Interpolate,
        irradiance::Irradiance,
        light_table::LightTable,
        normals::Normals,
        panorama::{Needs, Panorama},
        radiance_pyramid::RadiancePyramid,
        sampling_mask::SamplingMask,
        scene::SceneBuffers,
        temporal::Temporal,
        view::{Role, View},
    },
    plan::{Part, Plan},
    scene::{Scene, movers::Movers, packed::PackedScene},
    settings::VirtualTracer,
};
use std::sync::Weak;

impl Preparation {
    fn new(gpu: &Gpu, plan: &Plan) -> Result<Self> {
        Ok(Self {
            ingest: plan.codes().map(|coding| Ingest::new(gpu, coding, plan.halves())).transpose()?,
            radiance_pyramid: (plan.color_levels() > 1)
                .then(|| RadiancePyramid::new(gpu, plan.halves()))
                .transpose()?,
            normals: plan.geometry().then(|| Normals::new(gpu)).transpose()?,
            depth_pyramid: plan.boxes().then(|| DepthPyramid::new(gpu)).transpose()?,
            light_table: plan
                .on(Part::LightTable)
                .then(|| LightTable::new(gpu, &plan.settings, plan.on(Part::FreeLamps), plan.halves()))
                .transpose()?,
        })
    }
}

impl Lighting {
    fn new(gpu: &Gpu, plan: &Plan, role: Role) -> Result<Self> {
        Ok(Self {
            sampling_mask: SamplingMask::new(gpu, plan, role)?,
            irradiance: Irradiance::new(gpu, plan, role)?,
            interpolate: plan.on(Part::Interpolate).then(|| Interpolate::new(gpu, plan, role)).transpose()?,
            temporal: plan.on(Part::Temporal).then(|| Temporal::new(gpu, plan, role)).transpose()?,
            atrous: plan.on(Part::Atrous).then(|| Atrous::new(gpu, plan, role)).transpose()?,
        })
    }
}

/// Says whether a device can trace as `virtual_tracer = ray_query` asks.
///
/// # Errors
/// Fails with [`Error::Input`] if it cannot. The error says what the device lacks.
pub fn require_ray_queries(gpu: &Gpu) -> Result<()> {
    gpu.require_ray_queries(
        "virtual_tracer = ray_query",
        "use virtual_tracer=bvh, or another device (see `iprt devices`)",
    )
}

impl Renderer {
    /// Plans for a scene, builds pipelines and allocates. Renders nothing yet.
    pub fn new(gpu: &Gpu, scene: &Scene, options: RenderOptions) -> Result<Self> {
        let plan = Plan::of(scene, &options, None)?;
        Self::with_plan(gpu, scene, options, plan)
    }

    /// As [`Renderer::new`], with something done wrong on purpose.
    #[cfg(feature = "faults")]
    pub fn with_fault(gpu: &Gpu, scene: &Scene, options: RenderOptions, fault: Fault) -> Result<Self> {
        let plan = Plan::of(scene, &options, None)?;
        let mut renderer = Self::with_plan(&fault.inject(gpu), scene, options, plan)?;
        renderer.fault = fault;
        Ok(renderer)
    }

    /// As [`Renderer::new`], with a plan that was made for this scene and these options.
    pub fn with_plan(gpu: &Gpu, scene: &Scene, options: RenderOptions, plan: Plan) -> Result<Self> {
        let [width, height] = options.size;
        if width == 0 || height == 0 || width > 16384 || height > 16384 {
            return Err(Error::input("size", format!("{width}×{height} pixels"), "both must be from 1 to 16384"));
        }
        let settings = &plan.settings;
        if settings.virtual_tracer == VirtualTracer::RayQuery {
            require_ray_queries(gpu)?;
        }
        let relight_size = [settings.relight_width, settings.relight_width.div_ceil(2)];
        let levels = if plan.on(Part::Relight) { settings.relight_levels } else { 0 };
        let relight = (0..levels)
            .map(|level| View::new(gpu, &format!("relight {level}"), relight_size, &plan, Role::Relight))
            .collect::<Result<_>>()?;
        let look = |role, off_centre| Gbuffer::new(gpu, &plan, Look { role, off_centre });
        let lighting = |role| Lighting::new(gpu, &plan, role);
        let none = PackedScene::default();
        let packed = if plan.on(Part::Objects) { &scene.packed } else { &none };
        let (color_size, depth_size) = (plan.facts.color_size, plan.facts.depth_size);
        // drivers take most of a second for the largest pipelines, each on one core
        let (lighting, others) = rayon::join(
            || plan.on(Part::Objects).then(|| lighting(Role::Picture)).transpose(),
            || -> Result<_> {
                let looked_up = plan.looks_up().then(|| look(Role::Picture, false)).transpose()?;
                let traced = plan.on(Part::OffCentre).then(|| look(Role::Picture, true)).transpose()?;
                let relighting = || Ok((look(Role::Relight, false)?, lighting(Role::Relight)?));
                Ok(([looked_up, traced], plan.on(Part::Relight).then(relighting).transpose()?))
            },
        );
        let (gbuffer, relighting) = others?;
        let mut scene_buffers = SceneBuffers::new(gpu, packed, plan.facts.instances, plan.facts.lights)?;
        if plan.on(Part::Deformation) {
            scene_buffers.add_deform(gpu, packed, plan.ray_queries())?;
        }
        if plan.ray_queries() {
            scene_buffers.add_acceleration(gpu, packed, plan.facts.instances)?;
        }
        Ok(Self {
            gpu: gpu.clone(),
            preparation: Some(Preparation::new(gpu, &plan)?),
            gbuffer,
            lighting: lighting?,
            relighting,
            composite: Composite::new(gpu, &plan)?,
            panorama: Panorama::new(gpu, color_size, depth_size, scene.panorama.yaw_degrees, Needs::of(&plan))?,
            scene: scene_buffers,
            picture: View::new(gpu, "picture", options.size, &plan, Role::Picture)?,
            relight,
            nothing: gpu.image("nothing relit", [1, 1], 1, 1, Format::Rgba32u)?,
            video_frame: None,
            prepared_content: Weak::new(),
            previous_time: None,
            movers: Movers::default(),
            frame: 0,
            plan,
            options,
            #[cfg(feature = "faults")]
            fault: Fault::None,
            spare: Vec::new(),
            unknown: None,
            prepared: Timings::default(),
        })
    }
}
