//! What the window asks of the thread that renders, and what that shows.

use crate::{
    gpu::{Image, Timings},
    panorama::source::PanoramaFrame,
    scene::Scene,
    settings::{Method, Settings},
};
use std::{path::PathBuf, sync::Arc};

/// How one picture is made.
#[derive(Clone, Debug, PartialEq)]
pub struct Side {
    /// The preset that the settings started from.
    pub method: Method,
    /// All approximations.
    pub settings: Settings,
}

/// Frames by which the relit panorama of the model's truth converges before the first picture of it.
const TRUTH_WARMUP: u32 = 32;
/// Frames after which a picture that stands still is left alone.
const REFINED: u32 = 64;
/// The same where it converges.
const CONVERGED: u32 = 4096;

impl Side {
    /// A method as it is by default.
    pub fn of(method: Method) -> Self {
        let mut settings = Settings::of(method);
        settings.fill_unseen = true;
        if method == Method::Reference {
            settings.relight_warmup = TRUTH_WARMUP;
        }
        Self { method, settings }
    }

    /// How many frames of a still view are worth while.
    pub fn enough(&self) -> u32 {
        if self.method == Method::Reference { CONVERGED } else { REFINED }
    }
}

/// How two pictures are compared.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Compare {
    /// A alone.
    Single,
    /// A on the left of a divider, B on its right.
    Split,
    /// Where they differ.
    Difference,
}

/// What is to be seen. The newest counts; what came before is forgotten.
#[derive(Clone, Debug)]
pub struct Wanted {
    /// The scene, seen by the window's camera.
    pub scene: Arc<Scene>,
    /// Seconds.
    pub time: f64,
    /// Full size of the picture, pixels.
    pub size: [u32; 2],
    /// A and B; B is made only where it is compared.
    pub sides: [Side; 2],
    /// How.
    pub compare: Compare,
    /// The image to show.
    pub aov: String,
    /// Factor on radiance.
    pub exposure: f32,
    /// Marks what the capture never saw.
    pub mark_unknown: bool,
    /// Whether it keeps changing, so that a quick picture is better than a good one.
    pub moving: bool,
    /// What a frame may take while that is so, milliseconds.
    pub target_ms: f64,
    /// Another number starts the accumulation again.
    pub restart: u64,
    /// Which request this is, counted up; pictures carry it.
    pub number: u64,
}

impl Wanted {
    /// Whether both ask for the same.
    pub fn same(&self, other: &Self) -> bool {
        let marks = (self.mark_unknown, self.moving) == (other.mark_unknown, other.moving);
        let numbers = (self.exposure, self.target_ms) == (other.exposure, other.target_ms);
        let pictures = self.sides == other.sides && self.compare == other.compare;
        self.same_view(other) && pictures && self.aov == other.aov && marks && numbers
    }

    /// Whether the same is looked at from the same place.
    pub fn same_view(&self, other: &Self) -> bool {
        let still = Arc::ptr_eq(&self.scene, &other.scene) && self.time == other.time && self.size == other.size;
        still && self.restart == other.restart
    }
}

/// A finished picture and how it came about.
#[derive(Clone, Debug)]
pub struct Picture {
    /// Ready to be copied to the window.
    pub image: Image,
    /// Its size, pixels: less than `full` while things move.
    pub size: [u32; 2],
    /// The size that was asked for.
    pub full: [u32; 2],
    /// Frames accumulated with this view.
    pub frames: u32,
    /// What the frame took in all, milliseconds.
    pub frame_ms: f64,
    /// Time of each pass.
    pub timings: Arc<Timings>,
    /// Whether that is by the clock, as the frame was submitted in pieces.
    pub by_clock: bool,
    /// Seconds, of the scene.
    pub time: f64,
    /// Whether the relit panorama was left as it was.
    pub held_relight: bool,
    /// Whether it is the real scene alone, until the first as asked for is there.
    pub preview: bool,
    /// Number of this picture, counted up.
    pub serial: u64,
    /// The request that it answers.
    pub number: u64,
}

impl Picture {
    /// Whether it has the size that was asked for.
    pub fn is_full(&self) -> bool {
        self.size == self.full
    }
}

/// What the rendering thread has to show.
#[derive(Clone, Default)]
pub struct Shown {
    /// A and B.
    pub pictures: [Option<Picture>; 2],
    /// Where A and B differ.
    pub difference: Option<Picture>,
    /// Names of the images that can be shown.
    pub aovs: Vec<String>,
    /// Each part of the model in A: its name, whether it is there, and why.
    pub plan: Vec<(&'static str, bool, String)>,
    /// The depth of the video frame shown, for what is dragged over real surfaces.
    pub surface: Option<Arc<PanoramaFrame>>,
    /// Pictures made.
    pub rendered: u64,
    /// Video frames that playing passed over.
    pub dropped: u64,
    /// Whether all that was asked for is shown as well as it will be.
    pub idle: bool,
}

/// What is done once.
#[derive(Clone, Debug)]
pub enum Order {
    /// Writes A's picture, linear or as displayed by the name, once it has been refined for this many frames.
    Screenshot { path: PathBuf, frames: u32 },
}

/// What the rendering thread has to say.
#[derive(Debug)]
pub enum Notice {
    /// Done as ordered: the file, its size, and the frames that its picture was accumulated for.
    Written { path: PathBuf, size: [u32; 2], frames: u32 },
    /// Something failed and was left as it was.
    Failed(String),
}
