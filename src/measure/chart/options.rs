//! What a chart measures: its scenes and its options.

use super::{choices, rounds::TIMED, sweep::PointSpec};
use crate::{
    Result,
    measure::clock::STEADY,
    options::RenderOptions,
    reference::cache,
    scene::{CompleteScene, Scene, viewpoint::Projection},
    settings::{Method, Settings},
};
use std::path::PathBuf;

/// A scene to chart.
#[derive(Clone, Debug)]
pub struct ChartInput {
    /// The name for people.
    pub name: String,
    /// The scene that the methods render.
    pub scene: Scene,
    /// The complete true scene with the objects and without, if it is known.
    pub complete: Option<[CompleteScene; 2]>,
}

impl ChartInput {
    /// The default method's settings with those of the scene over them.
    ///
    /// # Errors
    /// Fails if the scene gives an unknown setting or a bad value.
    pub fn settings(&self) -> Result<Settings> {
        let mut settings = Settings::of(Method::Iprt);
        for (name, value) in self.scene.render.set_text() {
            settings.set(&name, &value, &self.name)?;
        }
        Ok(settings)
    }
}

/// The options of a chart.
#[derive(Clone, Debug, PartialEq)]
pub struct ChartOptions {
    /// Width and height of pictures, pixels.
    pub size: [u32; 2],
    /// How directions map to pixels.
    pub projection: Projection,
    /// Seed of all random numbers.
    pub seed: u32,
    /// The video frame that pictures show.
    pub frame: u32,
    /// Numbers of frames after which a still picture is scored, in ascending order.
    pub frames: Vec<u32>,
    /// Number of frames of the moving scene before its picture is scored. With 0 nothing moves.
    pub moving_frames: u32,
    /// How often each point is timed.
    pub rounds: u32,
    /// Paths a pixel of model truth.
    pub model_spp: u32,
    /// Samples a pixel of scene truth.
    pub scene_spp: u32,
    /// The folder of stored scene truths, if there is one. They are taken where they fit.
    pub truths: Option<PathBuf>,
    /// The points to measure.
    pub points: Vec<PointSpec>,
}

/// What a path of model truth costs, in frames. The number is rough, and serves to tell the time left.
pub(super) const PATH_WORK: u64 = 2;

impl ChartOptions {
    /// The total work that [`run`](super::run()) reports to `tick` for these scenes.
    pub fn work<'a>(&self, inputs: impl IntoIterator<Item = &'a ChartInput>) -> u64 {
        let points: u64 = self.points.iter().map(|spec| self.point_work(spec)).sum();
        let truth = |input: &ChartInput| {
            let scene = if input.complete.is_some() {
                2 * u64::from(cache::rounded(self.scene_spp, cache::SCENE_BATCH))
            } else {
                0
            };
            scene + PATH_WORK * u64::from(cache::rounded(self.model_spp, cache::MODEL_BATCH))
        };
        inputs.into_iter().map(|input| truth(input) + points + choices::work(self)).sum()
    }

    fn point_work(&self, spec: &PointSpec) -> u64 {
        (0..self.rounds).map(|round| self.round_work(spec, round)).sum()
    }

    pub(super) fn round_work(&self, spec: &PointSpec, round: u32) -> u64 {
        u64::from(match round {
            0 => self.first_frames(spec) + self.moving_frames,
            _ if spec.is_method() => self.again_frames(spec) + self.moving_frames,
            _ => self.again_frames(spec),
        })
    }

    /// Number of still frames in the first round: as many as are scored, and enough to be timed.
    pub fn first_frames(&self, spec: &PointSpec) -> u32 {
        spec.frames.or(self.frames.last().copied()).unwrap_or(0).max(STEADY + TIMED)
    }

    /// The largest of [`ChartOptions::frames`] up to 16, or the least of them if all are larger.
    pub fn main_frames(&self) -> u32 {
        let fits = self.frames.iter().copied().filter(|frames| *frames <= 16).max();
        fits.or(self.frames.first().copied()).unwrap_or(1)
    }

    /// Number of frames in a later round: enough to be timed, and enough for the pictures that it scores.
    pub fn again_frames(&self, spec: &PointSpec) -> u32 {
        self.again_looks(spec).last().copied().unwrap_or(0).max(STEADY + TIMED)
    }

    /// Numbers of frames after which a later round scores the still picture. A method is looked at as often as
    /// in its first round, any other point once, if that does not take many frames.
    pub(super) fn again_looks(&self, spec: &PointSpec) -> Vec<u32> {
        let main = self.main_frames_of(spec);
        if spec.is_method() {
            self.frames.clone()
        } else if main <= 2 * (STEADY + TIMED) {
            vec![main]
        } else {
            Vec::new()
        }
    }

    /// The frame number of a point's main picture: the one that its own frames end with, or the chart's.
    pub(super) fn main_frames_of(&self, spec: &PointSpec) -> u32 {
        spec.frames.unwrap_or(self.main_frames())
    }

    /// Options of a renderer for the chart's pictures.
    pub(super) fn render_options(&self, settings: Settings, method: Method) -> RenderOptions {
        RenderOptions {
            size: self.size,
            method,
            settings,
            projection: self.projection,
            seed: self.seed,
            without_objects: false,
            eye: 0.0,
        }
    }
}
