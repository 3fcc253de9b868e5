//! What a renderer renders, and how.

use crate::{
    Result,
    scene::{Scene, viewpoint::Projection},
    settings::{Method, Settings},
};

impl RenderOptions {
    /// Returns what a scene file asks for.
    ///
    /// # Errors
    /// Fails if its method or one of its settings is not known.
    pub fn of(scene: &Scene) -> Result<Self> {
        let method = Method::parse(&scene.render.method, &format!("{}: render.method", scene.name))?;
        let mut settings = Settings::of(method);
        for (key, text) in scene.render.set_text() {
            settings.set(&key, &text, &format!("{}: render.set", scene.name))?;
        }
        let projection = Projection::Perspective;
        Ok(Self { size: scene.camera.size, method, settings, projection, seed: 0, without_objects: false, eye: 0.0 })
    }
}

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
    /// How far to the right of the camera the picture is taken from, metres: an eye of a stereo pair. Negative is left.
    pub eye: f32,
}
