//! The built-in rooms, made by code: a closed, purely diffuse real scene that `capture` turns into a panorama, and the
//! virtual objects that stand in it.

mod apartment;
mod furniture;
pub mod kit;
mod objects;
mod textures;

use super::{Object, camera::CameraTrack, model::Model};
use glam::Vec3;
use std::sync::Arc;

pub use apartment::apartment;

/// A built-in room: what is real, where it is captured from, and what is inserted.
#[derive(Clone, Debug)]
pub struct Room {
    pub name: &'static str,
    /// One mesh at the origin, floor at y = 0, every material pure Lambert.
    pub model: Arc<Model>,
    /// World, metres.
    pub capture_position: Vec3,
    /// Those that move repeat after 4 s.
    pub objects: Vec<Object>,
    pub camera: CameraTrack,
}

/// The names of the built-in rooms; the first is the default scene.
pub const NAMES: [&str; 1] = ["apartment"];

/// The room of that name.
pub fn by_name(name: &str) -> Option<Room> {
    match name {
        "apartment" => Some(apartment()),
        _ => None,
    }
}

#[cfg(test)]
mod tests;
