//! Records a frame, from top to bottom.

pub mod aov;
mod construction;
pub use construction::require_ray_queries;
pub mod cost;
mod interactive;
pub mod mattes;
mod state;
mod view_data;

#[cfg(feature = "faults")]
use crate::passes::fault::Fault;
use crate::{
    Error, Result,
    gpu::{Frame, FrameOptions, Gpu, Image, Ticket, Timings},
    options::RenderOptions,
    panorama::source::PanoramaFrame,
    passes::{
        atrous::Atrous,
        composite::Composite,
        depth_pyramid::DepthPyramid,
        fault::planted,
        gbuffer::Gbuffer,
        ingest::Ingest,
        interpolate::Interpolate,
        irradiance::Irradiance,
        light_table::LightTable,
        normals::Normals,
        panorama::Panorama,
        radiance_pyramid::RadiancePyramid,
        sampling_mask::SamplingMask,
        scene::SceneBuffers,
        temporal::{Since, Temporal},
        unknown::Unknown,
        view::{REAL, Role, Stands, VIRTUAL, View},
    },
    plan::Plan,
    scene::{Scene, movers::Movers},
    settings::{ClampWhen, FilterOrder, Settings},
};
use state::{FrameState, relight_viewpoint};
use std::{collections::VecDeque, sync::Weak};

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

/// The name under which uploads are timed.
pub const UPLOAD: &str = "upload";

/// How many frames [`Renderer::render_all`] keeps submitted: the one that the device draws, and the next.
const IN_FLIGHT: usize = 2;

/// The passes that run for a new video frame.
struct Preparation {
    ingest: Option<Ingest>,
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

impl Renderer {
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
        if let Some(lighting) = lighting {
            self.light(&mut frame, lighting, &self.picture, self.relight.last(), &state)?;
        }
        let light = lighting.map(|_| filtered(&self.plan.settings));
        frame.barrier("composite reads radiance and filtered light");
        let [real, _] = state.shown_in(&self.picture);
        let still = light.is_some() && self.picture.still_frames(REAL, &real) > 0;
        self.composite.record(&mut frame, &self.picture, light, still)?;

        let begun = Begun { ticket: frame.submit()?, new_video_frame: state.content.is_some() };
        self.end_frame(&state, time);
        Ok(begun)
    }

    /// Uploads what the device must know for this frame, and brings what rays meet to it.
    fn upload(&mut self, frame: &mut Frame, state: &FrameState) -> Result<()> {
        frame.scope(UPLOAD, |frame| {
            if let Some(content) = &state.content {
                self.panorama.upload(frame, content)?;
            }
            let movers = [&state.movers[..], state.touching.as_deref().unwrap_or_default()].concat();
            self.scene.upload(frame, &state.packed, &state.instances, &movers, self.plan.facts.luminance)?;
            self.upload_views(frame, state)
        })?;
        self.scene.follow(frame, &state.instances)
    }

    /// Runs once per video frame. Derives what comes from the panorama alone.
    fn prepare_panorama(&self, frame: &mut Frame, state: &FrameState) -> Result<()> {
        let (view, panorama) = (&self.picture.resources, &self.panorama);
        let (Some(content), Some(passes)) = (&state.content, &self.preparation) else { return Ok(()) };
        if let (Some(ingest), Some(_)) = (&passes.ingest, content.radiance.codes()) {
            ingest.record(frame, panorama)?;
            frame.barrier("all passes read the radiance that ingest made");
        }
        if let Some(radiance_pyramid) = &passes.radiance_pyramid {
            radiance_pyramid.record(frame, panorama)?;
        }
        if let Some(normals) = &passes.normals {
            normals.record(frame, panorama, view, panorama.quality(), self.plan.settings.normal_radius)?;
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
        // Two frames of this very view tell where objects are, and which of them reflect: another may have had its turn.
        let kept = kept[REAL as usize] && state.touching.is_some() && view.still_frames(REAL, &real) > 1;
        gbuffer.record(frame, view, &self.panorama.resources, &self.scene, kept)
    }

    /// Records passes 2 to 5 on a view whose rays see `relit`.
    fn light(
        &self,
        frame: &mut Frame,
        lighting: &Lighting,
        view: &View,
        relit: Option<&View>,
        state: &FrameState,
    ) -> Result<()> {
        let settings = &self.plan.settings;
        let history = settings.temporal && view.history_reset.is_none();
        let clamps = self.shortens(state) || settings.clamp_when == ClampWhen::Always;
        let clamp = if clamps && !planted!(self, HistoryKept) { settings.clamp } else { 0.0 };
        let [real, seen] = state.shown_in(view);
        let stands = [view.stands(REAL, &real), view.stands(VIRTUAL, &seen)];
        let relit = relit.map_or(Ok(&self.nothing), |map| map.light(filtered(settings), REAL))?;
        let since = Since { history, stands, clamp, video: state.new_light, moved: !state.movers.is_empty() };
        let temporal = |frame: &mut Frame, why, input| match &lighting.temporal {
            Some(temporal) => {
                frame.barrier(why);
                temporal.record(frame, view, input, since)
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
        // What is accumulated anew has yet to take the place of the last frame's light.
        let last = |layer: u32| match stands[layer as usize] {
            _ if !self.plan.knows_last_light() => Ok(&self.nothing),
            Stands::Nothing if self.plan.history_in_brief() => view.light("accumulated", layer),
            _ => view.light(filtered(settings), layer),
        };
        let known = [relit, last(REAL)?, last(VIRTUAL)?];
        lighting.irradiance.record(frame, view, &self.panorama.resources, &self.scene, known, since)?;
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
        Ok(())
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
}

/// The name of the image that holds a and b after both filters.
fn filtered(settings: &Settings) -> &'static str {
    match settings.filter_order {
        FilterOrder::SpatialFirst if settings.temporal => "accumulated",
        _ => Atrous::result(settings),
    }
}
