//! The built-in rooms, made by code: a closed real scene, diffuse but for the gallery's mirror, that `capture` turns into a
//! panorama, and the virtual objects that stand in it.

mod apartment;
mod bedroom;
mod bedroom_objects;
mod exhibits;
mod furniture;
mod gallery;
mod gallery_objects;
pub mod kit;
mod objects;
mod shell;
mod sleeping;
mod textures;
mod things;

use super::{Object, camera::CameraTrack, model::Model};
use glam::Vec3;
use std::sync::Arc;

pub use apartment::apartment;
pub use bedroom::bedroom;
pub use gallery::gallery;

/// A built-in room: what is real, where it is captured from, and what is inserted.
#[derive(Clone, Debug)]
pub struct Room {
    pub name: &'static str,
    /// At the origin, floor at y = 0. Where the room moves, its first clip says how.
    pub model: Arc<Model>,
    /// World, metres.
    pub capture_position: Vec3,
    /// The frames that are captured where the real geometry moves; elsewhere one is.
    pub video: Option<Video>,
    /// Those that move repeat after 4 s.
    pub objects: Vec<Object>,
    pub camera: CameraTrack,
}

/// How a room that moves is captured: frame `i` shows it at `i / fps` seconds.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Video {
    pub frames: u32,
    pub fps: f64,
    /// Width and height of a frame, texels.
    pub size: [u32; 2],
    /// Samples a texel, at most.
    pub samples: u32,
}

/// The names of the built-in rooms; the first is the default scene.
pub const NAMES: [&str; 3] = ["apartment", "bedroom", "gallery"];

/// The room of that name.
pub fn by_name(name: &str) -> Option<Room> {
    match name {
        "apartment" => Some(apartment()),
        "bedroom" => Some(bedroom()),
        "gallery" => Some(gallery()),
        _ => None,
    }
}

#[cfg(test)]
mod tests;
