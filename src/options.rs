//! What a renderer renders, and how.

use crate::{
    scene::viewpoint::Projection,
    settings::{Method, Settings},
};

/// The options that a renderer is made with.
#[derive(Clone, Debug)]
pub struct RenderOptions {
    /// Width and height of the picture, pixels.
    pub size: [u32; 2],
    /// The preset that `settings` started from.
    pub method: Method,
    /// All approximations.
    pub settings: Settings,
    /// How the directions of rays map to pixels.
    pub projection: Projection,
    /// Seed of all random numbers.
    pub seed: u32,
    /// Whether virtual objects are left out.
    pub without_objects: bool,
}
