//! What to render, and how.

use crate::{
    scene::viewpoint::Projection,
    settings::{Method, Settings},
};

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
