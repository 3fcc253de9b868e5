//! What a chart holds, and its file.

use crate::{
    Error, Result,
    image_file::{read::read_bytes, write::write_bytes},
    measure::{
        bench::{PASSES, quantile},
        choice::{Expected, Target},
        score::{REGIONS, Score, Scores},
    },
};
use serde::{Deserialize, Serialize};
use std::{collections::BTreeMap, path::Path};

/// The chart's file in its folder.
pub const FILE: &str = "chart.json";

/// All points of one device, driver, size and version.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Chart {
    /// What all points have in common.
    #[serde(flatten)]
    pub of: Conditions,
    /// In the order of the tables.
    pub scenes: Vec<ChartScene>,
    /// Measured so far.
    pub points: Vec<ChartPoint>,
    /// What was chosen from them, and measured anew.
    pub choices: Vec<ChartChoice>,
}

/// What is chosen from a scene's points for a target, and what it then is.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct ChartChoice {
    /// The scene's name.
    pub scene: String,
    /// At the chart's size.
    pub target: Target,
    /// The chosen point's key.
    pub key: String,
    /// The chosen point's name.
    pub point: String,
    /// By the points.
    pub predicted: Expected,
    /// Measured anew, with other random numbers.
    pub measured: Expected,
    /// Width and height of a larger picture, pixels.
    pub larger_size: [u32; 2],
    /// GPU milliseconds of its frame, predicted from the chart's size and measured.
    pub larger_ms: [f64; 2],
}

/// What points must have in common to be compared.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct Conditions {
    /// Of this program: package version and a hash of its file.
    pub version: String,
    /// Vulkan device name.
    pub device: String,
    /// Driver name and version.
    pub driver: String,
    /// Width and height of pictures, pixels.
    pub size: [u32; 2],
    /// `perspective` or `equirect`.
    pub projection: String,
    /// Seed of all random numbers.
    pub seed: u32,
    /// The number of frames after which pictures are compared where one is enough; all rounds score it.
    pub main_frames: u32,
    /// Frames after which pictures are looked at.
    pub looks: Vec<u32>,
    /// Frames of the moving scene.
    pub moving: u32,
    /// Paths a pixel that were asked of model truth, samples of scene truth.
    pub truth_spp: [u32; 2],
}

/// A scene, its truths, and what no method is needed for.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct ChartScene {
    /// As in points.
    pub name: String,
    /// Changes with the scene, the view and the truths.
    pub key: String,
    /// Factor on radiance for display.
    pub exposure: f32,
    /// The picture's time, seconds.
    pub time: f64,
    /// Panorama's colour, texels.
    pub panorama: [u32; 2],
    /// Share of pixels by region.
    pub regions: BTreeMap<String, f64>,
    /// Paths a pixel of model truth.
    pub model_spp: u32,
    /// Samples a pixel of scene truth, of each of its two pictures; 0 where the true scene is not known.
    pub scene_spp: u32,
    /// Share of luminance that was left out of model truth and of scene truth as outliers.
    pub outliers: [f64; 2],
    /// The truths' own noise: the difference of two halves.
    pub noise: Scores,
    /// Model truth against scene truth: what the model itself costs.
    pub floor: Option<Score>,
    /// The view without objects.
    pub nothing: Scores,
    /// Files of the truth that pictures are shown against, and of what the differences are of.
    pub pictures: BTreeMap<String, String>,
}

/// What a time is of.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Cost {
    /// Each frame of a video costs so much, however many the picture has accumulated.
    Frame,
    /// A picture costs all its frames.
    Picture,
}

/// A number over repetitions.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Spread {
    /// Of the repetitions' medians.
    pub median: f64,
    /// Least of the repetitions' medians; of a single repetition the lower quartile.
    pub low: f64,
    /// Most of them; of a single one the upper quartile.
    pub high: f64,
}

/// One repetition, frames after warm-up.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Round {
    /// GPU milliseconds of each frame, first timestamp to last.
    pub frame_ms: Vec<f64>,
    /// Wall milliseconds of each frame.
    pub wall_ms: Vec<f64>,
    /// Median GPU milliseconds of each pass, those that were dispatched.
    pub passes: BTreeMap<String, f64>,
    /// GPU milliseconds of what is done once a video frame.
    pub prepare_ms: f64,
    /// The still picture after the chart's main number of frames, of another seed in each round; none where a round is too short.
    pub scores: Option<Scores>,
}

/// What a picture is held against.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Truth {
    /// `reference --model panorama`.
    Model,
    /// `reference --model scene`.
    Scene,
}

impl Truth {
    /// Both.
    pub const ALL: [Self; 2] = [Self::Scene, Self::Model];

    /// For people.
    pub fn name(self) -> &'static str {
        match self {
            Self::Model => "model truth",
            Self::Scene => "scene truth",
        }
    }

    /// The score against it, where there is one.
    pub fn of(self, scores: &Scores) -> Option<&Score> {
        match self {
            Self::Model => Some(&scores.model),
            Self::Scene => scores.scene.as_ref(),
        }
    }
}

/// A picture after so many frames.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Outcome {
    /// Frames, the picture's own included.
    pub frames: u32,
    /// Whether the scene moved meanwhile; else all was still.
    pub moving: bool,
    /// Against both truths.
    #[serde(flatten)]
    pub scores: Scores,
    /// Its file, relative to the chart.
    pub picture: String,
    /// Its FLIP against scene truth, where known, else against model truth.
    pub difference: String,
}

/// Settings, their cost and their accuracy on one scene.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct ChartPoint {
    /// A hash of all that it depends on.
    pub key: String,
    /// Vulkan device name.
    pub device: String,
    /// Driver name and version.
    pub driver: String,
    /// The scene's name.
    pub scene: String,
    /// What people call it: the method, or the setting and its value.
    pub name: String,
    /// The setting that differs from its base, or `method`, `reference`, `limit`.
    pub group: String,
    /// The point that it differs from in that setting alone; empty for methods.
    pub base: String,
    /// Preset.
    pub method: String,
    /// Settings that differ from the preset.
    pub set: BTreeMap<String, String>,
    /// All settings.
    pub settings: BTreeMap<String, String>,
    /// Width and height that are rendered, and then stretched to the chart's.
    pub rendered: [u32; 2],
    /// What `ms` is of.
    pub cost: Cost,
    /// GPU milliseconds: of a frame, or of the picture after all its frames.
    pub ms: Spread,
    /// Device memory, bytes.
    pub memory: u64,
    /// By region, [`flicker`](crate::measure::temporal::flicker()) of its last still frames, eight at most, those of warm-up left out; nothing of
    /// pictures that cost all their frames.
    pub flicker: BTreeMap<String, f64>,
    /// The raw times.
    pub rounds: Vec<Round>,
    /// The pictures.
    pub outcomes: Vec<Outcome>,
}

impl ChartPoint {
    /// GPU milliseconds of each pass in frame order, those that were dispatched; of the picture where that is what costs.
    pub fn passes(&self) -> Vec<(&'static str, Spread)> {
        let of = |pass: &&str| {
            let each: Vec<Vec<f64>> =
                self.rounds.iter().filter_map(|round| Some(vec![*round.passes.get(*pass)?])).collect();
            Spread::of(&each).map(|spread| spread.times(self.frames_paid()))
        };
        PASSES.iter().filter_map(|pass| Some((*pass, of(pass)?))).collect()
    }

    /// Computes [`ChartPoint::ms`] from the rounds.
    pub fn summarise(&mut self) {
        let frames: Vec<Vec<f64>> = self.rounds.iter().map(|round| round.frame_ms.clone()).collect();
        self.ms = Spread::of(&frames).unwrap_or_default().times(self.frames_paid());
    }

    fn frames_paid(&self) -> f64 {
        match self.cost {
            Cost::Frame => 1.0,
            Cost::Picture => f64::from(self.outcomes.iter().map(|outcome| outcome.frames).max().unwrap_or(1)),
        }
    }

    /// The still picture after so many frames; of a picture that costs all its frames, the last.
    pub fn still(&self, frames: u32) -> Option<&Outcome> {
        let frames = if self.cost == Cost::Picture { self.frames_paid() as u32 } else { frames };
        self.outcomes.iter().find(|outcome| !outcome.moving && outcome.frames == frames)
    }

    /// FLIP of the still picture after `main_frames`, over the rounds: each had its own seed.
    pub fn flip(&self, main_frames: u32, truth: Truth, region: &str) -> Option<Spread> {
        let of = |scores: &Scores| Some(truth.of(scores)?.region(region)?.flip);
        let rounds: Vec<Vec<f64>> =
            self.rounds.iter().filter_map(|round| Some(vec![of(round.scores.as_ref()?)?])).collect();
        Spread::of(&rounds).or_else(|| {
            let flip = of(&self.still(main_frames)?.scores)?;
            Some(Spread { median: flip, low: flip, high: flip })
        })
    }

    /// Flicker by region, in a line for people.
    pub fn flicker_text(&self) -> String {
        let of = |region: &&str| Some(format!("{region} {:.4}", self.flicker.get(*region)?));
        REGIONS.iter().filter_map(of).collect::<Vec<_>>().join(", ")
    }

    /// The picture of the moving scene.
    pub fn moving(&self) -> Option<&Outcome> {
        self.outcomes.iter().find(|outcome| outcome.moving)
    }
}

impl Spread {
    /// Over repetitions of several values each, of which each counts alike by its median; those without a value do not count.
    pub fn of(rounds: &[Vec<f64>]) -> Option<Self> {
        let quantiles = |q| rounds.iter().filter(|r| !r.is_empty()).map(move |r| quantile(&mut r.clone(), q)).collect();
        let mut medians: Vec<f64> = quantiles(0.5);
        if medians.is_empty() {
            return None;
        }
        let median = quantile(&mut medians.clone(), 0.5);
        if let [_] = medians[..] {
            medians = [quantiles(0.25), quantiles(0.75)].concat();
        }
        let [low, high] = [f64::min as fn(f64, f64) -> f64, f64::max].map(|f| medians.iter().copied().reduce(f));
        Some(Self { median, low: low.unwrap_or(median).min(median), high: high.unwrap_or(median).max(median) })
    }

    fn times(self, factor: f64) -> Self {
        Self { median: self.median * factor, low: self.low * factor, high: self.high * factor }
    }
}

impl ChartScene {
    /// What its pictures are shown against: scene truth where it is known.
    pub fn best(&self) -> Truth {
        if self.floor.is_some() { Truth::Scene } else { Truth::Model }
    }
}

impl Chart {
    /// Reads a chart's file, if there is one.
    ///
    /// # Errors
    /// A file that is no chart.
    pub fn load(folder: &Path) -> Result<Option<Self>> {
        let path = folder.join(FILE);
        if !path.exists() {
            return Ok(None);
        }
        let chart = serde_json::from_slice(&read_bytes(&path)?).map_err(|error| {
            let problem = format!("is no chart of this version: {error}");
            Error::input(path.display(), problem, "delete it, or give another folder")
        })?;
        Ok(Some(chart))
    }

    /// Writes it.
    ///
    /// # Errors
    /// It cannot be written.
    pub fn save(&self, folder: &Path) -> Result<()> {
        let bytes = serde_json::to_vec_pretty(self).map_err(|error| Error::Internal(error.to_string()))?;
        write_bytes(&folder.join(FILE), &bytes)
    }

    /// The points of a scene.
    pub fn of_scene<'a>(&'a self, scene: &'a str) -> impl Iterator<Item = &'a ChartPoint> {
        self.points.iter().filter(move |point| point.scene == scene)
    }

    /// A point by its name.
    pub fn point(&self, scene: &str, name: &str) -> Option<&ChartPoint> {
        self.points.iter().find(|point| point.scene == scene && point.name == name)
    }
}

#[cfg(test)]
mod tests {
    use super::Spread;

    #[test]
    fn spread_is_of_the_rounds_medians() {
        let spread = Spread::of(&[vec![1.0, 2.0, 30.0], vec![], vec![4.0, 4.0, 5.0]]).expect("values");
        assert_eq!(spread, Spread { median: 3.0, low: 2.0, high: 4.0 });
        // a long round counts no more than a short one
        let long = Spread::of(&[vec![1.0; 50], vec![2.0; 3], vec![9.0; 3]]).expect("values");
        assert_eq!(long, Spread { median: 2.0, low: 1.0, high: 9.0 });
        assert_eq!(Spread::of(&[vec![], vec![]]), None);
        let once = Spread::of(&[vec![1.0, 2.0, 3.0, 4.0, 5.0]]).expect("values");
        assert_eq!(once, Spread { median: 3.0, low: 2.0, high: 4.0 });
    }
}
