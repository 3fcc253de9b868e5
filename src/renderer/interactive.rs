//! What a window asks of a renderer besides frames: other sizes, a fresh start, images to show without reading them back.

use super::{Renderer, filtered};
use crate::{
    Error, Result,
    gpu::Image,
    passes::{
        unknown::Unknown,
        view::{Role, View},
    },
};

/// Where the values of an AOV are on the device.
#[derive(Clone, Debug)]
pub struct Source<'a> {
    /// The image.
    pub image: &'a Image,
    /// Its layer.
    pub layer: u32,
    /// To be added to it, the same layer.
    pub plus: Option<&'a Image>,
    /// The one channel that counts, of all.
    pub channel: Option<usize>,
}

/// Pictures of other sizes that are kept.
const SPARE: usize = 2;

impl Renderer {
    /// Pictures have this size from now on, in pixels. A size that was used before keeps what was allocated for it; the history is
    /// dropped.
    ///
    /// # Errors
    /// Fails if there is no memory.
    pub fn set_size(&mut self, size: [u32; 2]) -> Result<()> {
        if size == self.options.size {
            return Ok(());
        }
        let mut view = match self.spare.iter().position(|view| view.size == size) {
            Some(known) => self.spare.remove(known),
            None => {
                if self.spare.len() >= SPARE {
                    self.spare.remove(0);
                }
                View::new(&self.gpu, "picture", size, &self.plan, Role::Picture)?
            }
        };
        view.history_reset = Some("another size");
        self.spare.push(std::mem::replace(&mut self.picture, view));
        self.options.size = size;
        Ok(())
    }

    /// Where the last frame shows what the capture never saw: 1 there, 0 elsewhere.
    ///
    /// # Errors
    /// Fails if there is no memory, if the device is lost, or if nothing was rendered yet.
    pub fn unknown(&mut self) -> Result<Image> {
        let Some(frame) = self.video_frame else { return Err(Error::Internal("nothing was rendered yet".into())) };
        if !self.plan.boxes() {
            let remedy = "show it with a method whose rays meet real surfaces";
            return Err(Error::input("what was never seen", "is not known without the panorama's depth", remedy));
        }
        let mut unknown = match self.unknown.take() {
            Some(unknown) => unknown,
            None => Unknown::new(&self.gpu, &self.panorama)?,
        };
        let found = unknown.find(&self.gpu, &self.picture.resources, self.options.size, frame);
        self.unknown = Some(unknown);
        found
    }

    /// As if nothing had been rendered yet, so that the frames from here on are those of a new renderer.
    pub fn restart(&mut self) {
        self.reset_history("a fresh start");
        for view in std::iter::once(&mut self.picture).chain(&mut self.relight) {
            view.previous = None;
        }
        self.previous_time = None;
        self.previous_objects.clear();
        self.frame = 0;
    }

    /// Where an image of the last frame is; the names are those of [`Renderer::aov_names`].
    ///
    /// # Errors
    /// Fails if there is no such image.
    pub fn shown(&self, name: &str) -> Result<Source<'_>> {
        let (image, layer) = self.source(name)?;
        let plus = (name == "irradiance_mixed").then(|| filtered(&self.picture, &self.plan.settings)).transpose()?;
        Ok(Source { image, layer, plus: plus.map(|[_, change]| change), channel: (name == "object_id").then_some(3) })
    }
}
