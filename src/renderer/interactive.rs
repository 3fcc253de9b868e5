//! What a window needs besides frames: other sizes, a fresh start, and images to show from the device.

use super::Renderer;
use crate::{
    Error, Result,
    gpu::Image,
    passes::{
        display::Source,
        unknown::Unknown,
        view::{Role, View},
    },
};

/// How many views of other sizes are kept.
const SPARE: usize = 2;

impl Renderer {
    /// Sets the size of pictures in pixels and drops the history. The images of the last sizes are kept and
    /// used again.
    ///
    /// # Errors
    /// Fails if the device is out of memory.
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

    /// Finds where the last frame shows what the capture never saw. The image is 1 there and 0 elsewhere.
    ///
    /// # Errors
    /// Fails if nothing was rendered yet, the panorama's depth is not used, or the device is lost or
    /// out of memory.
    pub fn unknown(&mut self) -> Result<Image> {
        let Some(frame) = self.video_frame else { return Err(Error::Internal("nothing was rendered yet".into())) };
        if !self.plan.boxes() {
            let remedy = "show it with a method whose rays meet real surfaces";
            return Err(Error::input("what was never seen", "is not known without the panorama's depth", remedy));
        }
        let mut unknown = match self.unknown.take() {
            Some(unknown) => unknown,
            None => Unknown::new(&self.gpu, &self.panorama, &self.plan)?,
        };
        let found = unknown.find(&self.gpu, &self.picture.resources, self.options.size, frame);
        self.unknown = Some(unknown);
        found
    }

    /// Forgets all frames, so that the next ones are those of a new renderer.
    pub fn restart(&mut self) {
        self.reset_history("a fresh start");
        for view in std::iter::once(&mut self.picture).chain(&mut self.relight) {
            view.forget();
        }
        self.previous_time = None;
        self.movers.clear();
        self.frame = 0;
    }

    /// Counts frames from this number on, from which random numbers follow: so a run that begins later draws those that the
    /// whole run draws.
    pub fn count_from(&mut self, number: u32) {
        self.frame = number;
    }

    /// Where an image of the last frame is on the device. The names are those of [`Renderer::aov_names`],
    /// but for [`UNKNOWN_LIGHT`](super::aov::UNKNOWN_LIGHT).
    ///
    /// # Errors
    /// Fails if there is no such image.
    pub fn shown(&self, name: &str) -> Result<Source> {
        self.source(name)
    }
}
