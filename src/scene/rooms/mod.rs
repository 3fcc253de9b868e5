//! The built-in rooms, made by code. Each is a closed real scene, diffuse except for the gallery's mirror,
//! which `capture` turns into a panorama, and the virtual objects that stand in it.

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
    /// The room at the origin, with its floor at y = 0. If it moves, its first clip says how.
    pub model: Arc<Model>,
    /// The capture point in the world, metres.
    pub capture_position: Vec3,
    /// The video that is captured if the real geometry moves. Other rooms are captured once.
    pub video: Option<Video>,
    /// The virtual objects. All motion repeats after 4 s.
    pub objects: Vec<Object>,
    pub camera: CameraTrack,
}

/// How a moving room is captured. Frame `i` shows it at `i / fps` seconds.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Video {
    pub frames: u32,
    pub fps: f64,
    /// Width and height of a frame, texels.
    pub size: [u32; 2],
    /// The most samples a texel.
    pub samples: u32,
}

/// The names of the built-in rooms; the first is the default scene.
pub const NAMES: [&str; 3] = ["apartment", "bedroom", "gallery"];

/// Returns the room of that name.
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
