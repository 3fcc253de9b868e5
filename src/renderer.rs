//! The frame, from top to bottom.

use crate::{
    Error, Result,
    gpu::{Format, Frame, Gpu, Image, Timings},
    panorama::depth::Quantisation,
    passes::{
        atrous::Atrous,
        composite::Composite,
        depth_pyramid::DepthPyramid,
        gbuffer::Gbuffer,
        interpolate::Interpolate,
        irradiance::{Irradiance, Relight},
        light_table::LightTable,
        normals::Normals,
        panorama::Panorama,
        radiance_pyramid::RadiancePyramid,
        sampling_mask::SamplingMask,
        scene::SceneBuffers,
        temporal::{self, Temporal},
        view::{Projection, View, ViewData, Viewpoint},
    },
    scene::{Scene, packed::PackedInstances},
    settings::{ClampWhen, Directions, FilterOrder, Method, Settings},
};
use glam::{Quat, Vec3};

/// What a renderer is made for.
#[derive(Clone, Debug)]
pub struct RenderOptions {
    /// Width and height of the picture, pixels.
    pub size: [u32; 2],
    /// Preset that `settings` started from.
    pub method: Method,
    /// All approximations.
    pub settings: Settings,
    /// How directions map to pixels.
    pub projection: Projection,
    /// Seed of all random numbers.
    pub seed: u32,
    /// Show the real scene alone.
    pub without_objects: bool,
}

/// The six passes, with what they keep from frame to frame.
pub struct Renderer {
    gpu: Gpu,
    options: RenderOptions,
    radiance_pyramid: RadiancePyramid,
    normals: Normals,
    depth_pyramid: DepthPyramid,
    light_table: LightTable,
    gbuffer: [Gbuffer; 2],
    sampling_mask: SamplingMask,
    irradiance: Irradiance,
    interpolate: Interpolate,
    temporal: Temporal,
    atrous: Atrous,
    composite: Composite,
    panorama: Panorama,
    scene: SceneBuffers,
    picture: View,
    /// The relit panorama's maps, one a level: each sees the one before.
    relight: Vec<View>,
    /// What rays are given where nothing is relit.
    nothing: Image,
    quantisation: Quantisation,
    video_frame: Option<usize>,
    previous_time: Option<f64>,
    frame: u32,
    #[doc(hidden)]
    pub skip_barrier: Option<usize>,
    #[doc(hidden)]
    pub repeat: Option<(&'static str, u32)>,
    barriers: usize,
    prepared: Timings,
}

/// What is the same for all views of a frame.
struct FrameState {
    video_frame: usize,
    new_video_frame: bool,
    moving: bool,
    viewpoint: Viewpoint,
}

impl Renderer {
    /// Builds pipelines and allocates for a scene; nothing is rendered yet.
    pub fn new(gpu: &Gpu, scene: &Scene, options: RenderOptions) -> Result<Self> {
        let [width, height] = options.size;
        if width == 0 || height == 0 || width > 16384 || height > 16384 {
            return Err(Error::input("size", format!("{width}×{height} pixels"), "both must be from 1 to 16384"));
        }
        let settings = &options.settings;
        let state = scene.at(0.0, 0.0);
        let viewpoint = viewpoint(&options, scene, &state.camera);
        let first = scene.panorama.load(0)?;
        // mip levels only down to the pixel's footprint
        let footprint = viewpoint.pixel_angle(height) * first.color_size[1] as f32 / std::f32::consts::PI;
        let deepest = 32 - first.color_size[0].max(first.color_size[1]).leading_zeros();
        let color_levels = (1 + footprint.log2().ceil().max(0.0) as u32).min(deepest);
        let relight_size = [settings.relight_width, settings.relight_width.div_ceil(2)];
        let levels =
            if state.instances.instances.is_empty() || options.without_objects { 0 } else { settings.relight_levels };
        let relight = (0..levels)
            .map(|level| View::new(gpu, &format!("relight {level}"), relight_size))
            .collect::<Result<_>>()?;
        Ok(Self {
            gpu: gpu.clone(),
            radiance_pyramid: RadiancePyramid::new(gpu)?,
            normals: Normals::new(gpu)?,
            depth_pyramid: DepthPyramid::new(gpu)?,
            light_table: LightTable::new(gpu, settings)?,
            gbuffer: [Gbuffer::new(gpu, false, color_levels > 1)?, Gbuffer::new(gpu, true, color_levels > 1)?],
            sampling_mask: SamplingMask::new(gpu)?,
            irradiance: Irradiance::new(gpu, settings)?,
            interpolate: Interpolate::new(gpu)?,
            temporal: Temporal::new(gpu)?,
            atrous: Atrous::new(gpu)?,
            composite: Composite::new(gpu, settings)?,
            panorama: Panorama::new(gpu, first.color_size, first.depth_size, scene.panorama.yaw_degrees, color_levels)?,
            scene: SceneBuffers::new(gpu, &scene.packed, state.instances.instances.len())?,
            picture: View::new(gpu, "picture", options.size)?,
            relight,
            nothing: gpu.image("nothing relit", [1, 1], 2, 1, Format::Rgba32f)?,
            quantisation: first.quantisation,
            video_frame: None,
            previous_time: None,
            frame: 0,
            options,
            skip_barrier: None,
            repeat: None,
            barriers: 0,
            prepared: Timings::default(),
        })
    }

    /// Renders the scene at a time in seconds. Motion is measured from the time of the previous call.
    pub fn render(&mut self, scene: &Scene, time: f64) -> Result<Timings> {
        let state = self.advance(scene, time)?;
        if self.relight.first().is_some_and(|map| map.history_reset.is_some()) {
            self.warm_up_relight(&state)?;
        }
        self.upload_views(&state)?;
        let mut frame = self.gpu.frame()?;
        frame.skip_barrier(self.skip_barrier);
        frame.repeat(self.repeat);

        if state.new_video_frame {
            self.prepare_panorama(&mut frame)?;
        }
        self.relight_panorama(&mut frame, &state)?;
        let irradiance = self.trace(&mut frame, &self.picture, self.relight.last(), &state)?;
        frame.barrier("composite reads filtered irradiance");
        self.composite.record(&mut frame, &self.picture, irradiance)?;

        self.barriers = frame.barriers();
        let timings = frame.submit()?;
        if state.new_video_frame {
            self.prepared = timings.clone();
        }
        self.end_frame(&state, time);
        Ok(timings)
    }

    /// Once per video frame: what is derived from the panorama alone.
    fn prepare_panorama(&self, frame: &mut Frame) -> Result<()> {
        let view = &self.picture.resources;
        self.radiance_pyramid.record(frame, &self.panorama)?;
        self.normals.record(frame, &self.panorama, view, self.quantisation, self.options.settings.normal_radius)?;
        frame.barrier("depth_pyramid bounds the depth that normals wrote");
        self.depth_pyramid.record(frame, &self.panorama, view)?;
        // the passes that read the panorama come after gbuffer's own barrier; the pyramid is done before light_table's
        if self.options.settings.directions != Directions::Brdf {
            return self.light_table.record(frame, &self.panorama, view);
        }
        frame.barrier("rays walk the pyramid");
        Ok(())
    }

    /// Real surfaces, relit, for rays to see: the pipeline's own passes on a coarse panoramic view.
    fn relight_panorama(&self, frame: &mut Frame, state: &FrameState) -> Result<()> {
        frame.scope("relight");
        for (level, view) in self.relight.iter().enumerate() {
            let below = level.checked_sub(1).map(|below| &self.relight[below]);
            self.trace(frame, view, below, state)?; // rays see it after the next view's barriers
        }
        frame.scope_end();
        Ok(())
    }

    /// Passes 1 to 5 on one view, its rays seeing real surfaces as `relit` has them. Returns E_R | E and ΔE | specular.
    fn trace<'a>(
        &'a self,
        frame: &mut Frame,
        view: &'a View,
        relit: Option<&'a View>,
        state: &FrameState,
    ) -> Result<[&'a Image; 2]> {
        let settings = &self.options.settings;
        let is_picture = std::ptr::eq(view, &self.picture);
        let off_centre = is_picture && !state.viewpoint.centred();
        let history = settings.temporal && view.history_reset.is_none();
        let clamp = if state.moving || settings.clamp_when == ClampWhen::Always { settings.clamp } else { 0.0 };
        let relight = match relit {
            Some(map) => {
                let [real, change] = filtered(map, settings)?;
                Relight { real, change }
            }
            None => Relight { real: &self.nothing, change: &self.nothing },
        };
        let panorama = &self.panorama.resources;
        let interpolate = settings.sampling_mask && settings.interpolate;

        self.gbuffer[usize::from(off_centre)].record(frame, view, panorama, &self.scene)?;
        self.sampling_mask.record(frame, view, settings, history)?;
        frame.barrier("irradiance reads the compacted pixels");
        self.irradiance.record(frame, view, panorama, &self.scene, &relight, is_picture)?;
        if interpolate {
            frame.barrier("interpolate reads traced neighbours");
            self.interpolate.record(frame, view, settings)?;
        }
        match settings.filter_order {
            FilterOrder::TemporalFirst => {
                frame.barrier("temporal reads this frame's irradiance");
                self.temporal.record(frame, view, temporal::Input::Irradiance, history, interpolate, clamp)?;
                frame.barrier("atrous reads accumulated irradiance");
                self.atrous.record(frame, view, settings)?;
            }
            FilterOrder::SpatialFirst => {
                frame.barrier("atrous reads this frame's irradiance");
                self.atrous.record(frame, view, settings)?;
                frame.barrier("temporal reads filtered irradiance");
                let input = temporal::Input::Filtered(Atrous::result(view, settings)?);
                self.temporal.record(frame, view, input, history, interpolate, clamp)?;
            }
        }
        filtered(view, settings)
    }

    /// Where the picture is to converge, the relit panorama does so before the first one is accumulated over it.
    fn warm_up_relight(&mut self, state: &FrameState) -> Result<()> {
        for n in 0..if self.relight.is_empty() { 0 } else { self.options.settings.relight_warmup } {
            self.frame = n;
            self.upload_views(state)?;
            let mut frame = self.gpu.frame()?;
            if n == 0 {
                self.prepare_panorama(&mut frame)?;
            }
            self.relight_panorama(&mut frame, state)?;
            frame.submit()?;
            for view in &mut self.relight {
                end_view(view, relight_viewpoint(self.panorama.yaw_degrees));
                view.resources.swap_history();
            }
        }
        Ok(())
    }

    /// Loads what the time asks for, and finds out what has moved.
    fn advance(&mut self, scene: &Scene, time: f64) -> Result<FrameState> {
        let video_frame = scene.panorama.frame_at(time);
        let new_video_frame = self.video_frame != Some(video_frame);
        if new_video_frame {
            let content = scene.panorama.load(video_frame)?;
            if content.color_size != self.panorama.color_size || content.depth_size != self.panorama.depth_size {
                let problem = format!("frame {video_frame} has another size than the first");
                return Err(Error::input("panorama", problem, "all frames of a video must have one size"));
            }
            self.quantisation = content.quantisation;
            self.panorama.upload(&self.gpu, &content)?;
        }
        let mut state = scene.at(time, self.previous_time.unwrap_or(time));
        if self.options.without_objects {
            state.instances = PackedInstances::default();
        }
        let objects_move = state.instances.instances.iter().any(|i| i.object_to_world != i.previous_object_to_world);
        let moving = objects_move || (new_video_frame && self.video_frame.is_some());
        let viewpoint = viewpoint(&self.options, scene, &state.camera);
        self.scene.update(&self.gpu, state.instances, scene.panorama.position)?;
        for view in std::iter::once(&mut self.picture).chain(&mut self.relight) {
            view.resources.swap_history();
            if let Some(reason) = view.history_reset {
                tracing::debug!("history is reset: {reason}");
            }
        }
        Ok(FrameState { video_frame, new_video_frame, moving, viewpoint })
    }

    fn end_frame(&mut self, state: &FrameState, time: f64) {
        end_view(&mut self.picture, state.viewpoint);
        for view in &mut self.relight {
            end_view(view, relight_viewpoint(self.panorama.yaw_degrees));
        }
        // only now: a frame that failed leaves the panorama unprepared
        self.video_frame = Some(state.video_frame);
        self.previous_time = Some(time);
        self.frame += 1;
    }

    fn upload_views(&self, state: &FrameState) -> Result<()> {
        let relight = relight_viewpoint(self.panorama.yaw_degrees);
        for (level, view) in self.relight.iter().enumerate() {
            self.upload_view(view, relight, level > 0, level as u32 + 1, state)?;
        }
        self.upload_view(&self.picture, state.viewpoint, !self.relight.is_empty(), 0, state)
    }

    fn upload_view(
        &self,
        view: &View,
        viewpoint: Viewpoint,
        relit: bool,
        stream: u32,
        state: &FrameState,
    ) -> Result<()> {
        let settings = &self.options.settings;
        let mut data = ViewData {
            size: view.size,
            frame: self.frame,
            seed: self.options.seed.wrapping_add(stream.wrapping_mul(0x9e37_79b9)),
            edge_ratio: settings.edge_ratio,
            thickness: settings.thickness,
            instance_count: self.scene.instance_count,
            primary_objects: u32::from(stream == 0),
            bounces: settings.bounces,
            coverage_samples: settings.coverage_samples,
            rays_per_16: ((settings.rays_per_pixel * 16.0).round() as u32).clamp(1, 16),
            history_limit: if state.moving { settings.history_moving } else { settings.history },
            relit: u32::from(relit),
            relight_size: self.relight.first().map_or([1, 1], |map| map.size),
            ..ViewData::default()
        };
        self.panorama.describe(&mut data);
        viewpoint.write(&view.previous.unwrap_or(viewpoint), &mut data);
        self.gpu.write_buffer(&view.data, 0, &[data])
    }

    /// The device it runs on.
    pub fn gpu(&self) -> &Gpu {
        &self.gpu
    }

    /// What it was made for.
    pub fn options(&self) -> &RenderOptions {
        &self.options
    }

    /// Frames rendered so far.
    pub fn frames(&self) -> u32 {
        self.frame
    }

    /// Timings of the last frame that prepared a new video frame.
    pub fn prepared(&self) -> &Timings {
        &self.prepared
    }

    /// Barriers in the last frame.
    pub fn barriers(&self) -> usize {
        self.barriers
    }

    /// Whether virtual objects are shown.
    pub fn has_objects(&self) -> bool {
        self.scene.instance_count > 0
    }

    /// Drops the history of the picture and of the relit panorama.
    pub fn reset_history(&mut self, reason: &'static str) {
        for view in std::iter::once(&mut self.picture).chain(&mut self.relight) {
            view.history_reset = Some(reason);
        }
    }

    /// Drops the picture's history alone: what is accumulated next is independent of it, but for the relit panorama.
    pub fn restart_picture(&mut self) {
        self.picture.history_reset = Some("another picture is begun");
    }

    /// The picture: linear radiance, RGBA, row 0 at the top.
    pub fn picture(&self) -> Result<Vec<[f32; 4]>> {
        self.aov("radiance")
    }

    /// Standard error of the accumulated irradiance, relative to its mean: the root of the mean variance of each pixel's mean over
    /// the mean luminance, real surfaces' change and virtual surfaces' lobes together.
    pub fn standard_error(&self) -> Result<f64> {
        let (mut variance, mut mean) = (0.0, 0.0);
        for layer in 0..2 {
            for name in ["a", "b"] {
                for [r, g, b, v] in self.gpu.read_image(self.picture.image(name)?, layer)? {
                    variance += f64::from(v.max(0.0));
                    mean += f64::from(0.2126 * r + 0.7152 * g + 0.0722 * b).abs();
                }
            }
        }
        let pixels = f64::from(self.options.size[0]) * f64::from(self.options.size[1]);
        Ok(if mean > 0.0 { (variance / pixels).sqrt() / (mean / pixels) } else { 0.0 })
    }

    /// Names of all that [`Renderer::aov`] gives.
    pub fn aov_names(&self) -> Vec<String> {
        let mut names = DERIVED.map(str::to_owned).to_vec();
        for (name, _) in &self.picture.resources.0 {
            let Some(image) = self.picture.resources.image(name) else { continue };
            match image.layers() {
                1 => names.push((*name).to_owned()),
                _ => names.extend(LAYERS.map(|layer| format!("{name}_{layer}"))),
            }
        }
        names
    }

    /// An image of the last frame by name, as RGBA: `position_real`, `normal_virtual`, `camera_radiance`, …, and the derived
    /// `irradiance_real` (E_R), `irradiance_mixed` (E_RV), `irradiance_virtual` (E of the Lambert lobe), `radiance_specular`, `object_id`,
    /// and `motion` and `position` of the surface that covers more of the pixel.
    pub fn aov(&self, name: &str) -> Result<Vec<[f32; 4]>> {
        let [a, b] = filtered(&self.picture, &self.options.settings)?;
        let opaque = |mut texels: Vec<[f32; 4]>| {
            texels.iter_mut().for_each(|t| t[3] = 1.0);
            texels
        };
        match name {
            "irradiance_real" => return Ok(opaque(self.gpu.read_image(a, 0)?)),
            "irradiance_mixed" => {
                let (real, change) = (self.gpu.read_image(a, 0)?, self.gpu.read_image(b, 0)?);
                return Ok(real
                    .iter()
                    .zip(&change)
                    .map(|(r, c)| [r[0] + c[0], r[1] + c[1], r[2] + c[2], 1.0])
                    .collect());
            }
            "irradiance_virtual" => return Ok(opaque(self.gpu.read_image(a, 1)?)),
            "radiance_specular" => return Ok(opaque(self.gpu.read_image(b, 1)?)),
            "object_id" => {
                let motion = self.picture.image("motion")?;
                return Ok(self.gpu.read_image(motion, 1)?.iter().map(|t| [t[3], t[3], t[3], 1.0]).collect());
            }
            "motion" | "position" => {
                let image = self.picture.image(name)?;
                let (mut seen, objects) = (self.gpu.read_image(image, 0)?, self.gpu.read_image(image, 1)?);
                let coverage: Vec<[f32; 4]> = self.gpu.read_image(self.picture.image("real_coverage")?, 0)?;
                for ((seen, object), [real, ..]) in seen.iter_mut().zip(objects).zip(coverage) {
                    if real < 0.5 {
                        *seen = object;
                    }
                }
                return Ok(seen);
            }
            _ => {}
        }
        if let Some(image) = self.picture.resources.image(name).filter(|image| image.layers() == 1) {
            return self.gpu.read_image(image, 0);
        }
        for (layer, suffix) in LAYERS.iter().enumerate() {
            let stem = name.strip_suffix(suffix).and_then(|stem| stem.strip_suffix('_'));
            if let Some(image) = stem.and_then(|stem| self.picture.resources.image(stem)) {
                return self.gpu.read_image(image, layer as u32);
            }
        }
        Err(Error::input(
            "--aov",
            format!("there is no image \"{name}\""),
            format!("choose from {}", self.aov_names().join(", ")),
        ))
    }
}

/// Images that are put together on reading.
const DERIVED: [&str; 7] = [
    "irradiance_real",
    "irradiance_mixed",
    "irradiance_virtual",
    "radiance_specular",
    "object_id",
    "motion",
    "position",
];

/// The two layers of per-surface images.
const LAYERS: [&str; 2] = ["real", "virtual"];

/// E_R | E and ΔE | specular radiance after both filters.
fn filtered<'a>(view: &'a View, settings: &Settings) -> Result<[&'a Image; 2]> {
    match settings.filter_order {
        FilterOrder::TemporalFirst => Atrous::result(view, settings),
        FilterOrder::SpatialFirst => Ok([view.image("a")?, view.image("b")?]),
    }
}

fn end_view(view: &mut View, viewpoint: Viewpoint) {
    view.previous = Some(viewpoint);
    view.history_reset = None;
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

/// The relit map's pixels are the panorama's texels, so it turns with it.
fn relight_viewpoint(yaw_degrees: f32) -> Viewpoint {
    Viewpoint::equirect(Vec3::ZERO, Quat::from_rotation_y(yaw_degrees.to_radians()))
}
