//! The complete true scene: the real room and the virtual objects, all of it geometry. What scene truth is made of.

use super::{
    Object, SceneState,
    animation::{Placement, Transform},
    bounds::Bounds,
    camera::CameraTrack,
    model::Model,
    packed::PackedScene,
    state::{self, Placed},
};
use crate::Result;
use std::sync::Arc;

/// A room with objects in it. Made by [`CompleteScene::load`] from a scene file, by [`CompleteScene::assemble`] from memory.
#[derive(Clone, Debug)]
pub struct CompleteScene {
    pub name: String,
    pub camera: CameraTrack,
    /// Triangles, materials and textures of the room and of all objects.
    pub packed: PackedScene,
    /// Frames a second.
    pub fps: f64,
    /// Factor on radiance for display.
    pub exposure: f32,
    /// What is understood but not done, or was mended; one line each.
    pub warnings: Vec<String>,
    placed: Vec<Placed>,
}

impl CompleteScene {
    /// Packs a room, the first of its clips played in a loop, and objects.
    ///
    /// # Errors
    /// A model whose arrays do not fit each other, or too many triangles.
    pub fn assemble(name: &str, room: Arc<Model>, camera: CameraTrack, objects: Vec<Object>) -> Result<Self> {
        let clip = (!room.rig.clips.is_empty()).then_some(0);
        let placement = Placement::fixed(Transform::IDENTITY);
        let room = Object { name: room.name.clone(), model: room, placement, clip, speed: 1.0 };
        let all: Vec<Object> = std::iter::once(room).chain(objects).collect();
        let (packed, placed, warnings) = state::place(&all)?;
        Ok(Self { name: name.to_owned(), camera, packed, fps: 30.0, exposure: 1.0, warnings, placed })
    }

    /// The world box of everything at `time_seconds`, metres.
    pub fn bounds(&self, time_seconds: f64) -> Bounds {
        self.placed.iter().map(|placed| placed.bounds(time_seconds)).fold(Bounds::EMPTY, Bounds::union)
    }

    /// The time at which frame `index` of the video starts, seconds.
    pub fn frame_time(&self, index: u32) -> f64 {
        f64::from(index) / self.fps
    }

    /// Camera, instances, top level and lights at `time_seconds`.
    pub fn at(&self, time_seconds: f64) -> SceneState {
        let instances = state::instances_at(&self.placed, time_seconds, time_seconds);
        SceneState { camera: self.camera.at(time_seconds), instances }
    }
}
