//! What a view keeps from frame to frame, and what of it stands still.

use super::{REAL, Stands, VIRTUAL, View, ViewData};
use crate::scene::viewpoint::Viewpoint;

/// All that the images of `gbuffer` depend on, for one layer.
#[derive(Clone, Debug, PartialEq)]
pub struct Shown {
    pub video_frame: usize,
    /// The viewpoint, where it is not always the same.
    pub viewpoint: Option<Viewpoint>,
    /// The rows of each object's matrix, and the time of its pose, for virtual surfaces.
    pub objects: Vec<[[f32; 4]; 4]>,
}

/// What a layer of a view keeps from frame to frame.
#[derive(Clone, Debug, Default)]
pub(super) struct Kept {
    /// What the images of `gbuffer` show, and whether their motion is zero.
    shown: Option<(Shown, bool)>,
    /// How many frames with a history have shown the same since.
    still: u32,
    /// The same for frames between which the video may have changed.
    steady: u32,
    /// Which of the two images of light's history is this frame's.
    light_turn: u32,
}

impl View {
    /// Whether the previous frame showed the same of a layer.
    fn shows(&self, layer: u32, shown: &Shown) -> bool {
        self.kept[layer as usize].shown.as_ref().is_some_and(|(known, _)| known == shown)
    }

    /// Whether `gbuffer` would make what is there of a layer.
    pub fn keeps(&self, layer: u32, shown: &Shown) -> bool {
        self.kept[layer as usize].shown.as_ref().is_some_and(|(known, motionless)| *motionless && known == shown)
    }

    /// How many frames in a row, this one included, have shown the same of a layer as the one before, with its
    /// history.
    pub fn still_frames(&self, layer: u32, shown: &Shown) -> u32 {
        let still = self.shows(layer, shown) && self.history_reset.is_none();
        if still { self.kept[layer as usize].still + 1 } else { 0 }
    }

    /// The same for frames between which the video may have changed.
    pub fn steady_frames(&self, layer: u32, shown: &Shown) -> u32 {
        let Kept { shown: known, steady, .. } = &self.kept[layer as usize];
        let same = |known: &Shown| known.viewpoint == shown.viewpoint && known.objects == shown.objects;
        if self.history_reset.is_none() && known.as_ref().is_some_and(|(known, _)| same(known)) {
            steady + 1
        } else {
            0
        }
    }

    /// What stands still since the last frame.
    pub fn stands(&self, layer: u32, shown: &Shown) -> Stands {
        if self.still_frames(layer, shown) > 0 {
            Stands::Still
        } else if self.steady_frames(layer, shown) > 0 {
            Stands::Steady
        } else {
            Stands::Nothing
        }
    }

    /// Makes what the last frame wrote the history of the next. Where a layer stands still the history is the
    /// same image, which each pass changes in place.
    pub fn begin_frame(&mut self, shown: &[Shown; 2]) {
        for layer in [REAL, VIRTUAL] {
            let turns = self.steady_frames(layer, &shown[layer as usize]) == 0;
            self.kept[layer as usize].light_turn ^= u32::from(turns);
        }
    }

    /// Takes down what a frame has shown.
    pub fn end_frame(&mut self, viewpoint: Viewpoint, shown: [Shown; 2]) {
        for (layer, shown) in (0..).zip(shown) {
            let (still, steady) = (self.still_frames(layer, &shown), self.steady_frames(layer, &shown));
            let motionless = self.shows(layer, &shown);
            let kept = &mut self.kept[layer as usize];
            (kept.still, kept.steady) = (still, steady);
            kept.shown = Some((shown, motionless));
        }
        self.previous = Some(viewpoint);
        self.history_reset = None;
    }

    /// Forgets what previous frames have shown.
    pub fn forget(&mut self) {
        self.kept.iter_mut().for_each(|kept| kept.shown = None);
        self.previous = None;
    }

    /// Tells shaders which layers of images with a history are this frame's, and which the last one's.
    /// `shown` is what this frame shows.
    pub fn describe(&self, data: &mut ViewData, shown: &[Shown; 2]) {
        for layer in [REAL, VIRTUAL] {
            let light_now = self.history_layer(layer, self.light_turn(layer));
            let stands = self.stands(layer, &shown[layer as usize]);
            let at = layer as usize;
            data.light_now[at] = light_now;
            data.light_before[at] = if self.history && stands == Stands::Nothing { light_now ^ 1 } else { light_now };
        }
    }

    /// The layer of an image in which this frame has the values of real or of virtual surfaces.
    pub fn layer(&self, image: &str, layer: u32) -> u32 {
        match image {
            _ if self.histories.contains(&image) => self.history_layer(layer, self.light_turn(layer)),
            _ => layer,
        }
    }

    /// Which of the two images, or of the two layers of an image, of light's history is this frame's.
    pub(super) fn light_turn(&self, layer: u32) -> u32 {
        self.kept[layer as usize].light_turn
    }

    fn history_layer(&self, layer: u32, turn: u32) -> u32 {
        if self.history { 2 * layer + turn } else { layer }
    }
}
