//! The data of a chart, and its file.

use crate::{
    Error, Result,
    image_file::{read::read_bytes, write::write_bytes},
    measure::{
        choice::{Expected, Target},
        clock::{Round, Spread},
        score::{REGIONS, Score, Scores, TruthKind},
    },
    passes::PASSES,
};
use serde::{Deserialize, Serialize};
use std::{collections::BTreeMap, path::Path};

/// The name of the chart's file in its folder.
pub const FILE: &str = "chart.json";

/// All points that were measured on one device and driver, at one size, by one version of the program.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Chart {
    /// What all points have in common.
    #[serde(flatten)]
    pub of: Conditions,
    /// The scenes, in the order of the tables.
    pub scenes: Vec<ChartScene>,
    /// The points measured so far.
    pub points: Vec<ChartPoint>,
    /// The choices from these points, measured anew.
    pub choices: Vec<ChartChoice>,
}

/// The settings that were chosen from a scene's points for a target, and what they then were.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct ChartChoice {
    /// The scene's name.
    pub scene: String,
    /// The target at the chart's size.
    pub target: Target,
    /// The chosen point's key.
    pub key: String,
    /// The chosen point's name.
    pub point: String,
    /// What the points predict.
    pub predicted: Expected,
    /// What was measured anew, with other random numbers.
    pub measured: Expected,
    /// Width and height of a larger picture, pixels.
    pub larger_size: [u32; 2],
    /// GPU milliseconds of a frame of that size: predicted from the chart's size, and measured.
    pub larger_ms: [f64; 2],
}

/// What points must have in common to be compared.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct Conditions {
    /// Version of this program: the package's version and a hash of the program's file.
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
    /// The number of frames after which pictures are compared if one number is enough. All rounds score this
    /// picture.
    pub main_frames: u32,
    /// Numbers of frames after which pictures are scored.
    pub looks: Vec<u32>,
    /// Number of frames of the moving scene.
    pub moving: u32,
    /// Paths a pixel that were asked for model truth, and samples a pixel for scene truth.
    pub truth_spp: [u32; 2],
}

/// A scene, its truths, and the scores that need no method.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct ChartScene {
    /// The same name as in its points.
    pub name: String,
    /// A hash that changes with the scene, the view and the truths.
    pub key: String,
    /// Factor on radiance before display.
    pub exposure: f32,
    /// The picture's time, seconds.
    pub time: f64,
    /// Width and height of the panorama's colour, texels.
    pub panorama: [u32; 2],
    /// Each region's share of the pixels.
    pub regions: BTreeMap<String, f64>,
    /// Paths a pixel of model truth.
    pub model_spp: u32,
    /// Samples a pixel of each of scene truth's two pictures. It is 0 if the true scene is not known.
    pub scene_spp: u32,
    /// What made scene truth, if it was stored and not computed by this chart.
    pub stored: Option<String>,
    /// Shares of the luminance that were left out as outliers, of model truth and of scene truth.
    pub outliers: [f64; 2],
    /// The truths' own noise, which is the difference of two halves.
    pub noise: Scores,
    /// The score of model truth against scene truth, which is what the model itself costs.
    pub floor: Option<Score>,
    /// The score of the view without objects.
    pub nothing: Scores,
    /// The truths' pictures: the file of each, by what it shows.
    pub pictures: BTreeMap<String, String>,
}

/// What a time measures.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum CostUnit {
    /// The time of one frame of a video. It does not depend on how many frames the picture has accumulated.
    Frame,
    /// The time of a picture, which is that of all its frames.
    Picture,
}

/// A picture after a number of frames, with its scores.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct ScoredPicture {
    /// Number of frames, including the picture's own.
    pub frames: u32,
    /// Whether the scene moved during these frames.
    pub moving: bool,
    /// The scores against both truths.
    #[serde(flatten)]
    pub scores: Scores,
    /// The picture's file, relative to the chart's folder.
    pub picture: String,
    /// The file with its FLIP error against scene truth, or against model truth if the true scene is not
    /// known.
    pub difference: String,
}

/// Settings on one scene, with their cost and their accuracy.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct ChartPoint {
    /// A hash of all that the point depends on.
    pub key: String,
    /// Vulkan device name.
    pub device: String,
    /// Driver name and version.
    pub driver: String,
    /// The scene's name.
    pub scene: String,
    /// The name for people: the method, or the setting and its value.
    pub name: String,
    /// The setting that differs from the base point, or `method`, `reference` or `limit`.
    pub group: String,
    /// The name of the point that differs from this one in that setting alone. It is empty for methods.
    pub base: String,
    /// The preset's name.
    pub method: String,
    /// Settings that differ from the preset.
    pub set: BTreeMap<String, String>,
    /// All settings.
    pub settings: BTreeMap<String, String>,
    /// Width and height that are rendered, pixels. The picture is then stretched to the chart's size.
    pub rendered: [u32; 2],
    /// What `ms` measures.
    pub cost: CostUnit,
    /// GPU milliseconds of a frame, or of the picture with all its frames.
    pub ms: Spread,
    /// Device memory, bytes.
    pub memory: u64,
    /// The [`flicker`](crate::measure::sequence::flicker()) of its last still frames, by region. It takes
    /// eight frames at most, and none of the warm-up. A point that costs whole pictures has none.
    pub flicker: BTreeMap<String, f64>,
    /// The measured times.
    pub rounds: Vec<Round>,
    /// The scored pictures.
    pub outcomes: Vec<ScoredPicture>,
}

impl ChartPoint {
    /// GPU milliseconds of each dispatched pass, in frame order. Where the point costs whole pictures, they
    /// are those of the picture.
    pub fn passes(&self) -> Vec<(&'static str, Spread)> {
        let of = |pass: &str| {
            let each: Vec<Vec<f64>> =
                self.rounds.iter().filter_map(|round| Some(vec![*round.passes.get(pass)?])).collect();
            Spread::of(&each).map(|spread| spread.times(self.frames_paid()))
        };
        PASSES.iter().filter_map(|pass| Some((pass.name, of(pass.name)?))).collect()
    }

    /// Computes [`ChartPoint::ms`] from the rounds.
    pub fn summarise(&mut self) {
        let frames: Vec<Vec<f64>> = self.rounds.iter().map(|round| round.frame_ms.clone()).collect();
        self.ms = Spread::of(&frames).unwrap_or_default().times(self.frames_paid());
    }

    fn frames_paid(&self) -> f64 {
        match self.cost {
            CostUnit::Frame => 1.0,
            CostUnit::Picture => f64::from(self.outcomes.iter().map(|outcome| outcome.frames).max().unwrap_or(1)),
        }
    }

    /// The still picture after a number of frames. A point that costs whole pictures returns its last one.
    pub fn still(&self, frames: u32) -> Option<&ScoredPicture> {
        let frames = if self.cost == CostUnit::Picture { self.frames_paid() as u32 } else { frames };
        self.outcomes.iter().find(|outcome| !outcome.moving && outcome.frames == frames)
    }

    /// FLIP of a picture over the rounds. Each round had its own seed.
    pub fn flip(&self, picture: &ScoredPicture, truth: TruthKind, region: &str) -> Option<Spread> {
        let of = |scores: &Scores| Some(vec![truth.of(scores)?.region(region)?.flip]);
        let rounds = self.rounds.iter().filter_map(|round| of(round.scores_of(picture.frames, picture.moving)?));
        Spread::of(&rounds.collect::<Vec<_>>())
    }

    /// The flicker of each region, in a line for people.
    pub fn flicker_text(&self) -> String {
        let of = |region: &&str| Some(format!("{region} {:.4}", self.flicker.get(*region)?));
        REGIONS.iter().filter_map(of).collect::<Vec<_>>().join(", ")
    }

    /// The picture of the moving scene.
    pub fn moving(&self) -> Option<&ScoredPicture> {
        self.outcomes.iter().find(|outcome| outcome.moving)
    }
}

impl ChartScene {
    /// Says in a sentence where scene truth comes from.
    pub fn about_scene_truth(&self) -> String {
        match &self.stored {
            _ if self.floor.is_none() => "The true scene is not known.".to_owned(),
            Some(made_by) => format!("Scene truth: stored, {} samples a pixel by {made_by}.", self.scene_spp),
            None => format!(
                "Scene truth: {} samples a pixel; {:.1} % of its light was in outliers and is left out.",
                self.scene_spp,
                100.0 * self.outliers[1]
            ),
        }
    }

    /// The truth that pictures are shown against: scene truth if it is known, otherwise model truth.
    pub fn best(&self) -> TruthKind {
        if self.floor.is_some() { TruthKind::Scene } else { TruthKind::Model }
    }
}

impl Chart {
    /// Reads a chart's file, if there is one.
    ///
    /// # Errors
    /// Fails if the file is not a chart of this version.
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

    /// Writes the chart's file.
    ///
    /// # Errors
    /// Fails if the file cannot be written.
    pub fn save(&self, folder: &Path) -> Result<()> {
        let bytes = serde_json::to_vec_pretty(self).map_err(|error| Error::Internal(error.to_string()))?;
        write_bytes(&folder.join(FILE), &bytes)
    }

    /// The points of a scene.
    pub fn of_scene<'a>(&'a self, scene: &'a str) -> impl Iterator<Item = &'a ChartPoint> {
        self.points.iter().filter(move |point| point.scene == scene)
    }

    /// A point of a scene, by its name.
    pub fn point(&self, scene: &str, name: &str) -> Option<&ChartPoint> {
        self.points.iter().find(|point| point.scene == scene && point.name == name)
    }
}
