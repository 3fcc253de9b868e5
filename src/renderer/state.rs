//! What a frame shows, and what the renderer remembers of it for the next.

use super::{Renderer, Wishes};
use crate::{
    Error, Result,
    options::RenderOptions,
    panorama::source::PanoramaFrame,
    passes::{
        fault::planted,
        scene::relative_to,
        view::{Role, Shown, View},
    },
    plan::Part,
    scene::{
        Scene,
        camera::Camera,
        packed::{Instance, Mover, NONE, PackedInstances, PackedScene},
        viewpoint::{Projection, Viewpoint},
    },
};
use glam::{Quat, Vec3};
use std::sync::Arc;

/// What is the same for all views of a frame.
pub(super) struct FrameState {
    pub video_frame: usize,
    /// The panorama, if this frame is the first to show its video frame.
    pub content: Option<Arc<PanoramaFrame>>,
    /// The instances, relative to the panorama's centre.
    pub instances: PackedInstances,
    /// What no frame changes of the scene.
    pub packed: Arc<PackedScene>,
    /// The instances that have moved.
    pub movers: Vec<Mover>,
    /// Where objects may look different from the last frame, if that is known ([`Movers::touching`]).
    pub touching: Option<Vec<Mover>>,
    /// Whether the light of the real scene is another than in the frame before.
    pub new_light: bool,
    /// Whether the relit panorama is made again.
    pub relight: bool,
    pub viewpoint: Viewpoint,
    /// The time whose poses are shown, seconds.
    pub pose: f32,
}

impl FrameState {
    /// What the first pass on a view depends on, for real and for virtual surfaces.
    pub(super) fn shown_in(&self, view: &View) -> [Shown; 2] {
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

impl Renderer {
    /// Loads what is shown at this time, and finds out what has moved.
    pub(super) fn advance(&mut self, scene: &Scene, time: f64, wishes: &Wishes) -> Result<FrameState> {
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
            state.instances.rest(&scene.packed);
        }
        let (centre, unit) = (scene.panorama.position, self.plan.facts.luminance);
        let mut movers = self.movers.advance(&scene.packed, &mut state.instances, centre, unit);
        let touching = self.movers.touching(&state.instances, &movers);
        if !self.plan.on(Part::Motion) || planted!(self, HistoryKept) {
            movers.clear();
        }
        let new_light = new_video_frame && self.video_frame.is_some() && self.plan.on(Part::Motion);
        let viewpoint = viewpoint(&self.options, scene, &state.camera);
        let instances = relative_to(centre, state.instances);
        let relight = !wishes.hold_relight || self.relight.iter().any(|view| view.history_reset.is_some());
        let pose = time as f32;
        let packed = scene.packed.clone();
        let state = FrameState {
            video_frame,
            content,
            instances,
            packed,
            movers,
            touching,
            new_light,
            relight,
            viewpoint,
            pose,
        };
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

    pub(super) fn end_frame(&mut self, state: &FrameState, time: f64) {
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
        self.scene.submitted();
        self.previous_time = Some(time);
        self.frame = self.frame.wrapping_add(1);
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

fn viewpoint(options: &RenderOptions, scene: &Scene, camera: &Camera) -> Viewpoint {
    let position = camera.position - scene.panorama.position;
    let middle = match options.projection {
        Projection::Perspective => {
            Viewpoint::perspective(position, camera.rotation, camera.fov_y_degrees, options.size)
        }
        Projection::Equirect => Viewpoint::equirect(position, camera.rotation),
    };
    middle.of_eye(options.eye)
}

/// The viewpoint of the relit map. Its pixels are the panorama's texels, so it turns with the panorama.
pub(super) fn relight_viewpoint(yaw_degrees: f32) -> Viewpoint {
    Viewpoint::equirect(Vec3::ZERO, Quat::from_rotation_y(yaw_degrees.to_radians()))
}
