//! `--target-ms` and `--target-flip` choose the cheapest settings that reach a target, from points that were
//! measured on the same device.
//!
//! A [`Sheet`] holds what a chart or [`quick`] measured at one size, and [`store`] keeps sheets for the user.
//! [`choose`] only compares numbers. [`Sheet::predict`] carries times over to other sizes.

pub mod quick;
pub mod store;

use super::{
    clock::{Round, median},
    score::{REGIONS, Score},
};
use serde::{Deserialize, Serialize};
use std::{cmp::Ordering, collections::BTreeMap};

/// The settings that a choice may change. They save time by less work, and a still picture shows the
/// difference. Settings whose effect shows only in motion, like `history` and `clamp`, are left alone.
pub const TRADED: [&str; 13] = [
    "relight_levels",
    "relight_width",
    "coverage_samples",
    "sampling_mask",
    "mask_by",
    "rays_per_pixel",
    "real_tracer",
    "virtual_tracer",
    "directions",
    "bounces",
    "least_share",
    "atrous_levels",
    "atrous_radius",
];

/// Number of frames of a still picture after which its error counts.
pub const FRAMES: u32 = 16;

/// Errors that differ by less count as equal. Two drivers may differ by as much.
pub const SAME_FLIP: f64 = 0.002;

/// The pass whose cost does not depend on the picture's size.
const RELIGHT: &str = "relight";

/// A method with settings, and what was measured of it.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Candidate {
    /// The preset's name.
    pub method: String,
    /// Settings over those of the preset, the scene and the user.
    pub set: BTreeMap<String, String>,
    /// Median GPU milliseconds of each pass of a frame.
    pub passes: BTreeMap<String, f64>,
    /// Milliseconds of a frame that belong to no pass.
    pub rest_ms: f64,
    /// Milliseconds of the passes that run once a video frame.
    pub prepare_ms: f64,
    /// The error of the picture, as [`error`] defines it.
    pub flip: f64,
}

/// Candidates that were measured on one view, at one size and against one truth.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Sheet {
    /// Width and height, pixels.
    pub size: [u32; 2],
    /// The name of the truth, for people.
    pub truth: String,
    /// The truth's own [`error`], from its two halves against each other.
    pub noise: f64,
    /// The share of each pass's time at this size that does not grow with the picture. It is 0 for a pass
    /// that is missing.
    pub fixed: BTreeMap<String, f64>,
    /// Whether all candidates have been measured.
    pub complete: bool,
    /// The candidates. Each has its own settings.
    pub candidates: Vec<Candidate>,
}

/// What a user wants: a time, an error, or both.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Target {
    /// The most GPU milliseconds a frame may take.
    #[serde(skip_serializing_if = "Option::is_none", default)]
    pub ms: Option<f64>,
    /// The largest [`error`] a picture may have.
    #[serde(skip_serializing_if = "Option::is_none", default)]
    pub flip: Option<f64>,
}

/// The time and the error of a candidate, expected or measured.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Expected {
    /// GPU milliseconds a frame.
    pub ms: f64,
    /// The [`error`] of the picture.
    pub flip: f64,
}

/// What [`choose`] found.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Choice {
    /// Index of the chosen point.
    pub index: usize,
    /// The chosen point.
    pub expected: Expected,
    /// Whether it reaches the targets.
    pub reached: Reached,
}

/// Whether each target is reached. A target that was not given counts as reached.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Reached {
    /// The target for the time.
    pub ms: bool,
    /// The target for the error.
    pub flip: bool,
}

/// The error that targets are about. It is FLIP over virtual or over influenced pixels, whichever is larger,
/// since an average over the whole picture hides a wrong shadow. In a picture where objects are not seen and
/// have no influence, it is FLIP over all pixels.
pub fn error(score: &Score) -> f64 {
    let of = REGIONS[1..].iter().filter_map(|region| Some(score.region(region)?.flip));
    of.reduce(f64::max).unwrap_or(score.whole.flip)
}

/// Chooses among points. A point does not count if it has no time, or a number that is not finite.
///
/// * For an error alone it takes the cheapest point that has at most that error, or else the most accurate
///   point.
/// * For a time alone it takes the most accurate point that takes at most that time, or else the fastest
///   point.
/// * For both it takes the cheapest point that has at most that error, if it takes at most that time.
///   Otherwise it chooses by the time alone.
///
/// Of points that are equally accurate (within [`SAME_FLIP`]) it takes the cheaper one. Of points that cost
/// the same it takes the more accurate one.
pub fn choose(points: &[Expected], target: Target) -> Option<Choice> {
    let finite = |i: &usize| points[*i].ms.is_finite() && points[*i].ms > 0.0 && points[*i].flip.is_finite();
    let all: Vec<usize> = (0..points.len()).filter(finite).collect();
    let cheapest = |among: &[usize]| among.iter().copied().min_by(|a, b| cheaper(&points[*a], &points[*b]));
    let most_accurate = |among: &[usize]| {
        let least = among.iter().map(|i| points[*i].flip).fold(f64::INFINITY, f64::min);
        cheapest(&among.iter().copied().filter(|i| points[*i].flip <= least + SAME_FLIP).collect::<Vec<_>>())
    };
    let within = |holds: &dyn Fn(&Expected) -> bool| -> Vec<usize> {
        all.iter().copied().filter(|i| holds(&points[*i])).collect()
    };
    let by_time = |ms: f64| most_accurate(&within(&|p| p.ms <= ms)).or_else(|| cheapest(&all));
    let by_error = |flip: f64| cheapest(&within(&|p| p.flip <= flip));
    let index = match target {
        Target { ms: None, flip: None } => most_accurate(&all),
        Target { ms: None, flip: Some(flip) } => by_error(flip).or_else(|| most_accurate(&all)),
        Target { ms: Some(ms), flip: None } => by_time(ms),
        Target { ms: Some(ms), flip: Some(flip) } => {
            by_error(flip).filter(|i| points[*i].ms <= ms).or_else(|| by_time(ms))
        }
    }?;
    let expected = points[index];
    let reached = Reached {
        ms: target.ms.is_none_or(|ms| expected.ms <= ms),
        flip: target.flip.is_none_or(|flip| expected.flip <= flip),
    };
    Some(Choice { index, expected, reached })
}

fn cheaper(a: &Expected, b: &Expected) -> Ordering {
    a.ms.total_cmp(&b.ms).then(a.flip.total_cmp(&b.flip))
}

impl Candidate {
    /// Makes a candidate from the times of one repetition or more.
    pub fn new(method: String, set: BTreeMap<String, String>, rounds: &[Round], flip: f64) -> Self {
        let names: Vec<&String> = rounds.iter().flat_map(|round| round.passes.keys()).collect();
        let of = |name: &String| median(rounds.iter().filter_map(|round| round.passes.get(name).copied()));
        let passes: BTreeMap<String, f64> = names.into_iter().map(|name| (name.clone(), of(name))).collect();
        let frame = median(rounds.iter().filter(|round| !round.frame_ms.is_empty()).map(Round::median_ms));
        Self {
            method,
            set,
            rest_ms: (frame - passes.values().sum::<f64>()).max(0.0),
            passes,
            prepare_ms: median(rounds.iter().map(|round| round.prepare_ms)),
            flip,
        }
    }

    /// The settings as the command line takes them.
    pub fn flags(&self) -> String {
        let set: String = self.set.iter().map(|(name, value)| format!(" --set {name}={value}")).collect();
        format!("--method {}{set}", self.method)
    }
}

impl Sheet {
    /// Predicts the milliseconds of a frame at another size. With `new_video_frames` each frame shows a new
    /// video frame.
    ///
    /// The time of a pass grows with the number of pixels, except for its fixed share. Relighting the
    /// panorama, preparing a video frame and the rest of a frame do not grow.
    pub fn predict(&self, candidate: &Candidate, size: [u32; 2], new_video_frames: bool) -> f64 {
        let growth = pixels(size) / pixels(self.size);
        let pass = |(name, ms): (&String, &f64)| {
            let fixed = if name == RELIGHT { 1.0 } else { self.fixed.get(name).copied().unwrap_or(0.0) };
            ms * (fixed + (1.0 - fixed) * growth)
        };
        let prepare = if new_video_frames { candidate.prepare_ms } else { 0.0 };
        candidate.rest_ms + candidate.passes.iter().map(pass).sum::<f64>() + prepare
    }

    /// What is expected of each candidate at a size. If a method is asked for, nothing is expected of the
    /// candidates of other methods.
    pub fn expected(&self, method: Option<&str>, size: [u32; 2], new_video_frames: bool) -> Vec<Expected> {
        let nothing = Expected { ms: f64::NAN, flip: f64::NAN };
        let of = |c: &Candidate| Expected { ms: self.predict(c, size, new_video_frames), flip: c.flip };
        let asked = |c: &Candidate| method.is_none_or(|method| method == c.method);
        self.candidates.iter().map(|c| if asked(c) { of(c) } else { nothing }).collect()
    }

    /// Whether the sheet can answer for pictures of a size. They must have the same shape, and the sheet's
    /// size must be large enough for them.
    pub fn serves(&self, size: [u32; 2]) -> bool {
        let shape = |[w, h]: [u32; 2]| f64::from(w) / f64::from(h);
        let alike = (shape(self.size) / shape(size)).ln().abs() < 0.03;
        self.complete && alike && pixels(self.size) >= 0.9 * pixels(quick::size(size))
    }
}

/// The share of each pass's time at the first size that does not grow with the picture, from a straight line
/// through its times at both sizes.
pub fn fixed_shares(
    first: (&BTreeMap<String, f64>, [u32; 2]),
    second: (&BTreeMap<String, f64>, [u32; 2]),
) -> BTreeMap<String, f64> {
    let (a, b) = (pixels(first.1), pixels(second.1));
    let share = |(name, at_a): (&String, &f64)| {
        let slope = (second.0.get(name)? - at_a) / (b - a);
        (*at_a > 0.0 && slope.is_finite()).then(|| (name.clone(), (1.0 - slope * a / at_a).clamp(0.0, 1.0)))
    };
    first.0.iter().filter_map(share).collect()
}

pub(super) fn pixels([width, height]: [u32; 2]) -> f64 {
    f64::from(width) * f64::from(height)
}

#[cfg(test)]
mod tests;
