//! Records a frame, from top to bottom.

pub mod aov;
pub mod cost;
mod interactive;
pub mod mattes;

#[cfg(feature = "faults")]
use crate::passes::fault::Fault;
use crate::{
    Error, Result,
    gpu::{Format, Frame, FrameOptions, Gpu, Image, Ticket, Timings},
    options::RenderOptions,
    panorama::source::PanoramaFrame,
    passes::{
        atrous::Atrous,
        composite::Composite,
        depth_pyramid::DepthPyramid,
        fault::planted,
        gbuffer::{Gbuffer, Look},
        interpolate::Interpolate,
        irradiance::Irradiance,
        light_table::LightTable,
        normals::Normals,
        panorama::{Needs, Panorama},
        radiance_pyramid::RadiancePyramid,
        sampling_mask::SamplingMask,
        scene::{SceneBuffers, relative_to},
        temporal::{Since, Temporal},
        unknown::Unknown,
        view::{REAL, Role, Shown, VIRTUAL, View, ViewData},
    },
    plan::{Facts, Part, Plan},
    scene::{
        Scene,
        movers::Movers,
        packed::{Instance, Mover, NONE, PackedInstances, PackedScene},
        viewpoint::{Projection, Viewpoint},
    },
    settings::{ClampWhen, FOREVER, FilterOrder, INFINITE, Settings},
};
use glam::{Quat, Vec3};
use std::{
    collections::VecDeque,
    sync::{
        Arc, Weak,
        atomic::{AtomicU32, Ordering},
    },
};

/// The six passes that the plan needs, with what they keep from frame to frame.
pub struct Renderer {
    gpu: Gpu,
    options: RenderOptions,
    plan: Plan,
    /// Present until the last new video frame.
    preparation: Option<Preparation>,
    /// The first looks the panorama up from its centre. The second traces it from elsewhere.
    gbuffer: [Option<Gbuffer>; 2],
    lighting: Option<Lighting>,
    /// The same passes for the relit panorama's maps.
    relighting: Option<(Gbuffer, Lighting)>,
    composite: Composite,
    panorama: Panorama,
    scene: SceneBuffers,
    picture: View,
    /// The relit panorama's maps, one for each level. Each map sees the one before.
    relight: Vec<View>,
    /// Bound as the relit map if nothing is relit.
    nothing: Image,
    video_frame: Option<usize>,
    /// What the panorama's images hold: the pixels may be those of later video frames, too.
    prepared_content: Weak<PanoramaFrame>,
    previous_time: Option<f64>,
    movers: Movers,
    frame: u32,
    #[cfg(feature = "faults")]
    fault: Fault,
    spare: Vec<View>,
    unknown: Option<Unknown>,
    prepared: Timings,
}

/// What the caller wants of a frame besides its scene and time.
#[derive(Clone, Debug, Default)]
pub struct Wishes {
    /// Keeps the relit panorama as it is once it has been made.
    pub hold_relight: bool,
    /// How the frame is submitted.
    pub submission: FrameOptions,
}

/// A frame that was submitted. [`Renderer::collect`] waits for it.
#[must_use = "a frame that is not collected is waited for when it is dropped"]
pub struct Begun {
    ticket: Ticket,
    new_video_frame: bool,
}

/// What uploads are timed under.
pub const UPLOAD: &str = "upload";

/// How many frames [`Renderer::render_all`] keeps submitted: the one that the device draws, and the next.
const IN_FLIGHT: usize = 2;

/// The passes that run for a new video frame.
struct Preparation {
    radiance_pyramid: Option<RadiancePyramid>,
    normals: Option<Normals>,
    depth_pyramid: Option<DepthPyramid>,
    light_table: Option<LightTable>,
}

/// Passes 2 to 5, present if there is anything to light.
struct Lighting {
    sampling_mask: SamplingMask,
    irradiance: Irradiance,
    interpolate: Option<Interpolate>,
    temporal: Option<Temporal>,
    atrous: Option<Atrous>,
}

/// What is the same for all views of a frame.
struct FrameState {
    video_frame: usize,
    /// The panorama, if this frame is the first to show its video frame.
    content: Option<Arc<PanoramaFrame>>,
    /// The instances, relative to the panorama's centre.
    instances: PackedInstances,
    /// What does not change of them.
    packed: Arc<PackedScene>,
    /// What of them has moved.
    movers: Vec<Mover>,
    /// Whether the light of the real scene is another than in the frame before.
    new_light: bool,
    /// Whether the relit panorama is made again.
    relight: bool,
    viewpoint: Viewpoint,
    /// The time whose poses are shown, seconds.
    pose: f32,
}

impl FrameState {
    /// What the first pass on a view depends on, for real and for virtual surfaces.
    fn shown_in(&self, view: &View) -> [Shown; 2] {
        let viewpoint = (view.role == Role::Picture).then_some(self.viewpoint);
        let real = Shown { video_frame: self.video_frame, viewpoint, objects: Vec::new() };
        // What changes its shape is another thing at another time, which its place does not tell.
        let shape = |instance: &Instance| if instance.previous == NONE { 0.0 } else { self.pose };
        let row = |instance: &Instance| {
            let [x, y, z] = instance.object_to_world;
            [x, y, z, [shape(instance), 0.0, 0.0, 0.0]]
        };
        let rows = || self.instances.instances.iter().map(row).collect();
        let seen = if view.role == Role::Picture { rows() } else { Vec::new() };
        [real.clone(), Shown { objects: seen, ..real }]
    }
}

impl Preparation {
    fn new(gpu: &Gpu, plan: &Plan) -> Result<Self> {
        Ok(Self {
            radiance_pyramid: (plan.color_levels() > 1).then(|| RadiancePyramid::new(gpu)).transpose()?,
            normals: plan.geometry().then(|| Normals::new(gpu)).transpose()?,
            depth_pyramid: plan.boxes().then(|| DepthPyramid::new(gpu)).transpose()?,
            light_table: plan
                .on(Part::LightTable)
                .then(|| LightTable::new(gpu, &plan.settings, plan.on(Part::FreeLamps)))
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
        Ok(Self {
            gpu: gpu.clone(),
            preparation: Some(Preparation::new(gpu, &plan)?),
            gbuffer,
            lighting: lighting?,
            relighting,
            composite: Composite::new(gpu, &plan)?,
            panorama: Panorama::new(gpu, color_size, depth_size, scene.panorama.yaw_degrees, Needs::of(&plan))?,
            scene: SceneBuffers::new(gpu, packed, plan.facts.instances)?,
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

    /// Renders the scene at a time in seconds, and waits. Motion is measured from the previous call.
    ///
    /// # Errors
    /// Fails as [`Renderer::begin`] and [`Renderer::collect`] do.
    pub fn render(&mut self, scene: &Scene, time: f64) -> Result<Timings> {
        let begun = self.begin(scene, time, &Wishes::default())?;
        self.collect(begun)
    }

    /// Renders a frame for each of these times, and passes its timings to `each` in order. Prepares the next
    /// frame while the device draws one.
    ///
    /// # Errors
    /// Fails as [`Renderer::begin`] and [`Renderer::collect`] do, or if `each` fails. No further frame is
    /// begun then.
    pub fn render_all(
        &mut self,
        scene: &Scene,
        times: impl IntoIterator<Item = f64>,
        wishes: &Wishes,
        mut each: impl FnMut(Timings) -> Result<()>,
    ) -> Result<()> {
        let mut in_flight = VecDeque::with_capacity(IN_FLIGHT);
        for time in times {
            if in_flight.len() == IN_FLIGHT
                && let Some(oldest) = in_flight.pop_front()
            {
                each(self.collect(oldest)?)?;
            }
            in_flight.push_back(self.begin(scene, time, wishes)?);
        }
        in_flight.into_iter().try_for_each(|begun| each(self.collect(begun)?))
    }

    /// Waits for a frame. Frames must be collected in the order in which they were begun.
    ///
    /// # Errors
    /// Fails with [`Error::Vulkan`] if the device is lost.
    pub fn collect(&mut self, begun: Begun) -> Result<Timings> {
        let timings = begun.ticket.wait()?;
        if begun.new_video_frame {
            self.prepared = timings.clone();
        }
        Ok(timings)
    }

    /// Submits a frame of the scene at a time in seconds. What is read afterwards is of this frame.
    ///
    /// # Errors
    /// Fails if the video frame cannot be read or has another size than the first, if the device is lost or
    /// out of memory, or with [`Error::Interrupted`] if the submission's pieces were stopped.
    pub fn begin(&mut self, scene: &Scene, time: f64, wishes: &Wishes) -> Result<Begun> {
        let state = self.advance(scene, time, wishes)?;
        if self.relight.first().is_some_and(|map| map.history_reset.is_some()) {
            self.warm_up_relight(&state, wishes)?;
        }
        let mut frame = self.gpu.frame_with(wishes.submission.clone())?;
        self.upload(&mut frame, &state)?;
        frame.barrier("all passes read what was uploaded");
        self.prepare_panorama(&mut frame, &state)?;
        if state.relight {
            self.relight_panorama(&mut frame, &state)?;
        }
        frame.barrier("gbuffer reads the panorama");
        self.look(&mut frame, &self.picture, &state)?;
        let lighting = self.lighting.as_ref();
        let light = |lighting| self.light(&mut frame, lighting, &self.picture, self.relight.last(), &state);
        let light = lighting.map(light).transpose()?;
        frame.barrier("composite reads radiance and filtered light");
        let [real, _] = state.shown_in(&self.picture);
        let still = light.is_some() && self.picture.still_frames(REAL, &real) > 0;
        self.composite.record(&mut frame, &self.picture, light, still)?;

        let begun = Begun { ticket: frame.submit()?, new_video_frame: state.content.is_some() };
        self.end_frame(&state, time);
        Ok(begun)
    }

    /// Uploads what the device must know for this frame.
    fn upload(&self, frame: &mut Frame, state: &FrameState) -> Result<()> {
        frame.scope(UPLOAD, |frame| {
            if let Some(content) = &state.content {
                self.panorama.upload(frame, content)?;
            }
            self.scene.upload(frame, &state.packed, &state.instances, &state.movers)?;
            self.upload_views(frame, state)
        })
    }

    /// Runs once per video frame. Derives what comes from the panorama alone.
    fn prepare_panorama(&self, frame: &mut Frame, state: &FrameState) -> Result<()> {
        let (view, panorama) = (&self.picture.resources, &self.panorama);
        let (Some(content), Some(passes)) = (&state.content, &self.preparation) else { return Ok(()) };
        if let Some(radiance_pyramid) = &passes.radiance_pyramid {
            radiance_pyramid.record(frame, panorama)?;
        }
        if let Some(normals) = &passes.normals {
            normals.record(frame, panorama, view, content.quantisation, self.plan.settings.normal_radius)?;
        }
        if let Some(depth_pyramid) = &passes.depth_pyramid {
            frame.barrier("depth_pyramid bounds the depth that normals wrote");
            depth_pyramid.record(frame, panorama, view)?;
        }
        if let Some(light_table) = &passes.light_table {
            light_table.record(frame, panorama, view)?;
        }
        Ok(())
    }

    /// Relights real surfaces for rays to see. Runs the pipeline's own passes on a coarse panoramic view.
    fn relight_panorama(&self, frame: &mut Frame, state: &FrameState) -> Result<()> {
        let Some((_, lighting)) = &self.relighting else { return Ok(()) };
        frame.scope("relight", |frame| {
            let mut below = None;
            for view in &self.relight {
                frame.barrier("rays see real surfaces as the map below has them");
                self.look(frame, view, state)?;
                self.light(frame, lighting, view, below, state)?;
                below = Some(view);
            }
            Ok(())
        })
    }

    /// Records pass 1 on one view, unless the view holds already what it would show.
    fn look(&self, frame: &mut Frame, view: &View, state: &FrameState) -> Result<()> {
        let [real, seen] = state.shown_in(view);
        let kept = [view.keeps(REAL, &real), view.keeps(VIRTUAL, &seen)];
        if kept == [true; 2] {
            return Ok(());
        }
        let gbuffer = match view.role {
            Role::Relight => self.relighting.as_ref().map(|(gbuffer, _)| gbuffer),
            Role::Picture => {
                let [looked_up, traced] = &self.gbuffer;
                let [first, second] = if state.viewpoint.centred() { [looked_up, traced] } else { [traced, looked_up] };
                first.as_ref().or(second.as_ref())
            }
        };
        let gbuffer = gbuffer.ok_or_else(|| Error::Internal("no gbuffer for this view".into()))?;
        gbuffer.record(frame, view, &self.panorama.resources, &self.scene, kept[REAL as usize])
    }

    /// Records passes 2 to 5 on a view whose rays see `relit`. Returns the image of the filtered light.
    fn light<'a>(
        &'a self,
        frame: &mut Frame,
        lighting: &'a Lighting,
        view: &'a View,
        relit: Option<&'a View>,
        state: &FrameState,
    ) -> Result<&'a Image> {
        let settings = &self.plan.settings;
        let history = settings.temporal && view.history_reset.is_none();
        let clamp = if planted!(self, HistoryKept) {
            0.0
        } else if self.shortens(state) || settings.clamp_when == ClampWhen::Always {
            settings.clamp
        } else {
            0.0
        };
        let [real, seen] = state.shown_in(view);
        let stands = [view.stands(REAL, &real), view.stands(VIRTUAL, &seen)];
        let relit = relit.map_or(Ok(&self.nothing), |map| map.image(filtered(settings)))?;
        let since = Since { history, stands, clamp, video: state.new_light };
        let temporal = |frame: &mut Frame, why, input| match &lighting.temporal {
            Some(temporal) => {
                frame.barrier(why);
                temporal.record(frame, view, view.image(input)?, since)
            }
            None => Ok(()),
        };
        let atrous = |frame: &mut Frame, why| match &lighting.atrous {
            Some(atrous) => {
                frame.barrier(why);
                atrous.record(frame, view, settings)
            }
            None => Ok(()),
        };

        frame.barrier("sampling_mask reads what gbuffer saw");
        let pools = [&self.panorama.resources, &self.scene.resources];
        lighting.sampling_mask.record(frame, view, settings, since, view.steady_frames(REAL, &real), pools)?;
        frame.barrier("irradiance reads the compacted pixels");
        let last = if self.plan.roulette() { view.image(filtered(settings))? } else { &self.nothing };
        lighting.irradiance.record(frame, view, &self.panorama.resources, &self.scene, [relit, last], since)?;
        if let Some(interpolate) = &lighting.interpolate {
            frame.barrier("interpolate reads traced neighbours");
            interpolate.record(frame, view)?;
        }
        match settings.filter_order {
            FilterOrder::TemporalFirst => {
                temporal(frame, "temporal reads this frame's irradiance", "irradiance")?;
                atrous(frame, "atrous reads accumulated irradiance")?;
            }
            FilterOrder::SpatialFirst => {
                atrous(frame, "atrous reads this frame's irradiance")?;
                temporal(frame, "temporal reads filtered irradiance", Atrous::result(settings))?;
            }
        }
        view.image(filtered(settings))
    }

    /// Lets the relit panorama converge before a converging picture is accumulated over it.
    fn warm_up_relight(&mut self, state: &FrameState, wishes: &Wishes) -> Result<()> {
        let mut before: Option<Ticket> = None;
        for n in 0..if self.relight.is_empty() { 0 } else { self.plan.settings.relight_warmup } {
            self.frame = n;
            let mut frame = self.gpu.frame_with(wishes.submission.clone())?;
            if n == 0 {
                self.upload(&mut frame, state)?;
                frame.barrier("all passes read what was uploaded");
                self.prepare_panorama(&mut frame, state)?;
            } else {
                self.upload_views(&mut frame, state)?;
            }
            frame.barrier("all passes read what was uploaded");
            self.relight_panorama(&mut frame, state)?;
            if let Some(before) = before.replace(frame.submit()?) {
                before.wait()?;
            }
            for view in &mut self.relight {
                view.end_frame(relight_viewpoint(self.panorama.yaw_degrees), state.shown_in(view));
                view.begin_frame(&state.shown_in(view));
            }
        }
        Ok(())
    }

    /// Loads what is shown at this time, and finds out what has moved.
    fn advance(&mut self, scene: &Scene, time: f64, wishes: &Wishes) -> Result<FrameState> {
        let video_frame = if self.plan.on(Part::Video) { scene.panorama.frame_at(time) } else { 0 };
        let mut content = match self.video_frame {
            Some(known) if known == video_frame => None,
            _ => Some(self.video_frame(scene, video_frame)?),
        };
        // Equal frames are one: their pixels are there already, and so is what was made of them.
        let known = content.as_ref().is_some_and(|content| Arc::downgrade(content).ptr_eq(&self.prepared_content));
        let video_frame = match self.video_frame {
            Some(same) if known => {
                content = None;
                same
            }
            _ => video_frame,
        };
        let new_video_frame = content.is_some();
        let mut state = scene.at(time, self.previous_time.unwrap_or(time));
        if self.options.without_objects || !self.plan.on(Part::Objects) {
            state.instances = PackedInstances::default();
        }
        if !self.plan.on(Part::Deformation) {
            state.instances.patches.clear();
            state.instances.instances.iter_mut().for_each(|instance| (instance.previous, instance.step) = (NONE, 0.0));
        }
        let (centre, unit) = (scene.panorama.position, self.plan.facts.luminance);
        let mut movers = self.movers.advance(&scene.packed, &mut state.instances.instances, centre, unit);
        if !self.plan.on(Part::Motion) || planted!(self, HistoryKept) {
            movers.clear();
        }
        let new_light = new_video_frame && self.video_frame.is_some() && self.plan.on(Part::Motion);
        let viewpoint = viewpoint(&self.options, scene, &state.camera);
        let instances = relative_to(centre, state.instances);
        let relight = !wishes.hold_relight || self.relight.iter().any(|view| view.history_reset.is_some());
        let pose = time as f32;
        let packed = scene.packed.clone();
        let state = FrameState { video_frame, content, instances, packed, movers, new_light, relight, viewpoint, pose };
        let maps = if relight { &mut self.relight[..] } else { &mut [] };
        for view in std::iter::once(&mut self.picture).chain(maps) {
            view.begin_frame(&state.shown_in(view));
            if let Some(reason) = view.history_reset {
                tracing::debug!("history is reset: {reason}");
            }
        }
        Ok(state)
    }

    fn video_frame(&self, scene: &Scene, number: usize) -> Result<Arc<PanoramaFrame>> {
        let mut content = scene.panorama.load(number)?;
        if planted!(self, DepthStale) {
            Arc::make_mut(&mut content).depth = scene.panorama.load(0)?.depth.clone();
        }
        if content.color_size != self.panorama.color_size || content.depth_size != self.panorama.depth_size {
            let problem = format!("frame {number} has another size than the first");
            return Err(Error::input("panorama", problem, "all frames of a video must have one size"));
        }
        Ok(content)
    }

    fn end_frame(&mut self, state: &FrameState, time: f64) {
        self.picture.end_frame(state.viewpoint, state.shown_in(&self.picture));
        for view in self.relight.iter_mut().filter(|_| state.relight) {
            view.end_frame(relight_viewpoint(self.panorama.yaw_degrees), state.shown_in(view));
        }
        // set only now, so that a failed frame leaves the panorama unprepared
        self.video_frame = Some(state.video_frame);
        if let Some(content) = &state.content {
            self.prepared_content = Arc::downgrade(content);
        }
        if !self.plan.on(Part::Video) && self.preparation.take().is_some() {
            self.panorama.settle();
        }
        self.previous_time = Some(time);
        self.frame += 1;
    }

    fn upload_views(&self, frame: &mut Frame, state: &FrameState) -> Result<()> {
        let relight = relight_viewpoint(self.panorama.yaw_degrees);
        for (level, view) in (0..).zip(&self.relight) {
            let data = self.view_data(view, relight, level > 0, level + 1, state);
            frame.write_buffer(&view.data, 0, &[data])?;
        }
        let data = self.view_data(&self.picture, state.viewpoint, !self.relight.is_empty(), 0, state);
        frame.write_buffer(&self.picture.data, 0, &[data])
    }

    /// The data that every pass on a view reads. `relit` says whether its rays see a relit map,
    /// and `stream` chooses its random numbers.
    fn view_data(&self, view: &View, viewpoint: Viewpoint, relit: bool, stream: u32, state: &FrameState) -> ViewData {
        let settings = &self.plan.settings;
        let mut data = ViewData {
            size: view.size,
            frame: self.frame,
            seed: self.seed().wrapping_add(stream.wrapping_mul(0x9e37_79b9)),
            edge_ratio: settings.edge_ratio,
            thickness: settings.thickness,
            edge_depth: u32::from(settings.edge_depth),
            skirt_luminance: settings.skirt_luminance * self.plan.facts.luminance,
            instance_count: state.instances.instances.len() as u32,
            mover_count: state.movers.len() as u32,
            new_video: u32::from(state.new_light && !planted!(self, HistoryKept)),
            bounces: settings.bounces,
            coverage_samples: settings.coverage_samples,
            rays_per_16: ((settings.rays_per_pixel * 16.0).round() as u32).clamp(1, 16),
            history_limit: match self.shortens(state) {
                _ if planted!(self, HistoryKept) => FOREVER,
                true => settings.history_moving,
                false => settings.history,
            },
            history_limit_real: match state.new_light && self.shortens(state) {
                _ if planted!(self, HistoryKept) => FOREVER,
                true => settings.history_moving,
                false => settings.history,
            },
            relit: u32::from(relit),
            relight_size: self.relight.first().map_or([1, 1], |map| map.size),
            light_units: self.light_units().into(),
            ..ViewData::default()
        };
        self.panorama.describe(&mut data);
        data.look(&viewpoint, &view.previous.unwrap_or(viewpoint));
        view.describe(&mut data, &state.shown_in(view));
        data
    }

    /// Whether all histories are shortened in a frame, and not only those whose light changes.
    fn shortens(&self, state: &FrameState) -> bool {
        (state.new_light || !state.movers.is_empty()) && self.plan.settings.history_change >= INFINITE
    }

    /// The factors on light in images, where halves hold it: on E_R, and on
    /// what objects change or send. Objects may shine so brightly that halves would not hold that.
    fn light_units(&self) -> [f32; 2] {
        const MOST: f32 = 1e6; // times the unit and π it is still a half
        let Facts { luminance, brightest, .. } = self.plan.facts;
        [unit(luminance), unit(luminance.max(brightest / MOST))]
    }

    fn seed(&self) -> u32 {
        static FRAMES: AtomicU32 = AtomicU32::new(0);
        if planted!(self, UnsteadySeed) { FRAMES.fetch_add(1, Ordering::Relaxed) } else { self.options.seed }
    }

    /// The device on which it renders.
    pub fn gpu(&self) -> &Gpu {
        &self.gpu
    }

    /// The options for which it was made.
    pub fn options(&self) -> &RenderOptions {
        &self.options
    }

    /// The plan by which it was built.
    pub fn plan(&self) -> &Plan {
        &self.plan
    }

    /// The number of frames rendered so far.
    pub fn frames(&self) -> u32 {
        self.frame
    }

    /// Timings of the last frame that prepared a new video frame.
    pub fn prepared(&self) -> &Timings {
        &self.prepared
    }

    /// Drops the history of the picture and of the relit panorama.
    pub fn reset_history(&mut self, reason: &'static str) {
        for view in std::iter::once(&mut self.picture).chain(&mut self.relight) {
            view.history_reset = Some(reason);
        }
    }

    /// Drops only the picture's history. Later frames depend on earlier ones through the relit panorama
    /// alone.
    pub fn restart_picture(&mut self) {
        self.picture.history_reset = Some("another picture is begun");
    }
}

/// The name of the image that holds a and b after both filters.
fn filtered(settings: &Settings) -> &'static str {
    match settings.filter_order {
        FilterOrder::SpatialFirst if settings.temporal => "accumulated",
        _ => Atrous::result(settings),
    }
}

/// The power of two that makes a number one between 1/64 and 1/32: halves are exact to a thousandth down to a
/// 250th of it, and reach four million times as far up, where single paths may be. Of 0 it is 1.
fn unit(number: f32) -> f32 {
    if number > 0.0 { (number.log2().floor().clamp(-60.0, 60.0) + 6.0).exp2().recip() } else { 1.0 }
}

fn viewpoint(options: &RenderOptions, scene: &Scene, camera: &crate::scene::camera::Camera) -> Viewpoint {
    let position = camera.position - scene.panorama.position;
    match options.projection {
        Projection::Perspective => {
            Viewpoint::perspective(position, camera.rotation, camera.fov_y_degrees, options.size)
        }
        Projection::Equirect => Viewpoint::equirect(position, camera.rotation),
    }
}

/// The viewpoint of the relit map. Its pixels are the panorama's texels, so it turns with the panorama.
fn relight_viewpoint(yaw_degrees: f32) -> Viewpoint {
    Viewpoint::equirect(Vec3::ZERO, Quat::from_rotation_y(yaw_degrees.to_radians()))
}
