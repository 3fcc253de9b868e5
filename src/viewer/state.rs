//! What the window asks of the rendering thread, and what that thread shows.

use crate::{
    gpu::{Image, Timings},
    image_file::tonemap::Tonemap,
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

/// Number of frames for which the relit panorama of the model's truth converges before its first picture.
const TRUTH_WARMUP: u32 = 32;
/// Number of frames after which a still picture is left alone.
const REFINED: u32 = 64;
/// The same number for a picture that converges.
const CONVERGED: u32 = 4096;

impl Side {
    /// A method with its default settings.
    pub fn of(method: Method) -> Self {
        let mut settings = Settings::of(method);
        settings.fill_unseen = true;
        if method == Method::Reference {
            settings.relight_warmup = TRUTH_WARMUP;
        }
        Self { method, settings }
    }

    /// How many frames of a still view are worthwhile.
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

/// A request of what is to be seen. The newest request counts, and former ones are forgotten.
#[derive(Clone, Debug)]
pub struct Wanted {
    /// The scene, seen by the window's camera.
    pub scene: Arc<Scene>,
    /// Time of the scene, seconds.
    pub time: f64,
    /// Full size of the picture, pixels.
    pub size: [u32; 2],
    /// A and B. B is made only if it is compared.
    pub sides: [Side; 2],
    /// How A and B are compared.
    pub compare: Compare,
    /// Name of the image to show.
    pub aov: String,
    /// Factor on radiance before display.
    pub exposure: f32,
    /// How light beyond white is shown.
    pub tonemap: Tonemap,
    /// Whether to mark what the capture never saw.
    pub mark_unknown: bool,
    /// Whether the view keeps changing. A quick picture is then better than a good one.
    pub moving: bool,
    /// Milliseconds that a frame may take meanwhile.
    pub target_ms: f64,
    /// A number that starts the accumulation again when it changes.
    pub restart: u64,
    /// The number of this request. Requests are counted up, and pictures carry the number.
    pub number: u64,
}

impl Wanted {
    /// Whether both requests ask for the same.
    pub fn same(&self, other: &Self) -> bool {
        let marks = (self.mark_unknown, self.moving) == (other.mark_unknown, other.moving);
        let numbers = (self.exposure, self.tonemap, self.target_ms) == (other.exposure, other.tonemap, other.target_ms);
        let pictures = self.sides == other.sides && self.compare == other.compare;
        self.same_view(other) && pictures && self.aov == other.aov && marks && numbers
    }

    /// Whether both requests look at the same from the same place.
    pub fn same_view(&self, other: &Self) -> bool {
        let still = Arc::ptr_eq(&self.scene, &other.scene) && self.time == other.time && self.size == other.size;
        still && self.restart == other.restart
    }
}

/// A finished picture, and how it was made.
#[derive(Clone, Debug)]
pub struct RenderedPicture {
    /// The image, ready to be copied to the window.
    pub image: Image,
    /// Its size, pixels. It is less than `full` while things move.
    pub size: [u32; 2],
    /// The size that was asked for.
    pub full: [u32; 2],
    /// The name of the image that it shows, and whether what was never seen is marked in it.
    pub aov: String,
    pub marked: bool,
    /// Number of frames that were accumulated with this view.
    pub frames: u32,
    /// Wall time of the last frame, milliseconds.
    pub frame_ms: f64,
    /// The time of each pass.
    pub timings: Arc<Timings>,
    /// Whether these times are wall times, because the frame was submitted in pieces.
    pub by_clock: bool,
    /// Time of the scene, seconds.
    pub time: f64,
    /// Whether the relit panorama was left as it was.
    pub held_relight: bool,
    /// Whether it shows the real scene alone, while the first picture as asked for is being made.
    pub preview: bool,
    /// The number of this picture. Pictures are counted up.
    pub serial: u64,
    /// The number of the request that it answers.
    pub number: u64,
}

impl RenderedPicture {
    /// Whether it has the size that was asked for.
    pub fn is_full(&self) -> bool {
        self.size == self.full
    }
}

/// What the rendering thread shows.
#[derive(Clone, Default)]
pub struct EngineOutput {
    /// A and B.
    pub pictures: [Option<RenderedPicture>; 2],
    /// Where A and B differ.
    pub difference: Option<RenderedPicture>,
    /// Names of the images that can be shown.
    pub aovs: Vec<String>,
    /// Each part of the model in A, with its name, whether it is there, and why.
    pub plan: Vec<(&'static str, bool, String)>,
    /// The depth of the shown video frame, for dragging objects over real surfaces.
    pub surface: Option<Arc<PanoramaFrame>>,
    /// Number of pictures made.
    pub rendered: u64,
    /// Number of video frames that playing skipped.
    pub dropped: u64,
    /// Whether all that was asked for is shown as well as it will be.
    pub idle: bool,
}

/// Something that is done once.
#[derive(Clone, Debug)]
pub enum Order {
    /// Writes A's picture once it has been refined for this many frames. The file's extension tells whether
    /// it is linear or as displayed.
    Screenshot { path: PathBuf, frames: u32 },
    /// Takes up the shaders on disk.
    #[cfg(debug_assertions)]
    Reload,
}

/// What the rendering thread has to say.
#[derive(Debug)]
pub enum Notice {
    /// An order was carried out. The notice has the file, its size, and the frames that its picture was
    /// accumulated for.
    Written { path: PathBuf, size: [u32; 2], frames: u32 },
    /// Something was done as ordered.
    #[cfg(debug_assertions)]
    Done(String),
    /// Something failed and was left as it was.
    Failed(String),
}
