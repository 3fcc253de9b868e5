//! `--target-ms` and `--target-flip`: the cheapest settings that reach a target, from points measured on this very device.
//!
//! A [`Sheet`] holds what was measured at one size, by a chart or by [`quick`], and [`store`] keeps it for the user. [`choose`] only
//! compares numbers; [`Sheet::predict`] carries times over to other sizes.

pub mod quick;
pub mod store;

use super::{
    bench::quantile,
    chart::Round,
    score::{REGIONS, Score},
};
use serde::{Deserialize, Serialize};
use std::{cmp::Ordering, collections::BTreeMap};

/// Settings that a choice may change: those that buy time by less work, and show it in a still picture. What shows only while something
/// moves (`history`, `clamp`, …) is left alone.
pub const TRADED: [&str; 11] = [
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
    "atrous_levels",
];

/// Frames of a still picture after which its error counts.
pub const FRAMES: u32 = 16;

/// Errors that differ by less are the same: two drivers may differ by so much.
pub const SAME_FLIP: f64 = 0.002;

/// The pass whose cost has nothing to do with the picture's size.
const RELIGHT: &str = "relight";

/// A method with settings, and what was measured of it.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Candidate {
    /// Preset.
    pub method: String,
    /// Settings over the preset, the scene's and the user's.
    pub set: BTreeMap<String, String>,
    /// Median GPU milliseconds of each pass of a frame.
    pub passes: BTreeMap<String, f64>,
    /// Milliseconds of a frame that are in no pass.
    pub rest_ms: f64,
    /// Milliseconds of what is done once a video frame.
    pub prepare_ms: f64,
    /// See [`error`].
    pub flip: f64,
}

/// Candidates measured on one view at one size, against one truth.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Sheet {
    /// Width and height, pixels.
    pub size: [u32; 2],
    /// What the errors are against, for people.
    pub truth: String,
    /// The truth's own, as [`error`]: its two halves against each other.
    pub noise: f64,
    /// The share of a pass's time at this size that does not grow with the picture; 0 where it is not known.
    pub fixed: BTreeMap<String, f64>,
    /// Whether all that were to be measured are here.
    pub complete: bool,
    /// Each with its own settings.
    pub candidates: Vec<Candidate>,
}

/// What is wanted: one of them, or both.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Target {
    /// GPU milliseconds a frame at most.
    #[serde(skip_serializing_if = "Option::is_none", default)]
    pub ms: Option<f64>,
    /// [`error`] at most.
    #[serde(skip_serializing_if = "Option::is_none", default)]
    pub flip: Option<f64>,
}

/// What a choice expects of a candidate, or finds.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Expected {
    /// GPU milliseconds a frame.
    pub ms: f64,
    /// See [`error`].
    pub flip: f64,
}

/// See [`choose`].
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Choice {
    /// Of the points given.
    pub index: usize,
    /// That point.
    pub expected: Expected,
    /// Whether the targets are.
    pub reached: Reached,
}

/// Whether each target is reached; one that was not given is.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Reached {
    /// The time.
    pub ms: bool,
    /// The error.
    pub flip: bool,
}

/// The number that targets are about: FLIP over virtual or over influenced pixels, whichever is larger, for an average over the whole
/// picture hides a wrong shadow; over all pixels where objects neither are seen nor have influence.
pub fn error(score: &Score) -> f64 {
    let of = REGIONS[1..].iter().filter_map(|region| Some(score.region(region)?.flip));
    of.reduce(f64::max).unwrap_or(score.whole.flip)
}

/// Chooses among points; those with a number that is not finite, or without a time, do not count.
///
/// * An error alone: the cheapest point that has at most that error. None has: the most accurate.
/// * A time alone: the most accurate point that takes at most that time. None does: the fastest.
/// * Both: the cheapest point that has at most that error, if it takes at most that time; otherwise as the time alone.
///
/// Among points that are as accurate (within [`SAME_FLIP`]) the cheaper is taken, among those that cost the same the more accurate.
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
    /// From the frames of one repetition or of several.
    pub fn new(method: String, set: BTreeMap<String, String>, rounds: &[Round], flip: f64) -> Self {
        let median = |mut of: Vec<f64>| quantile(&mut of, 0.5);
        let names: Vec<&String> = rounds.iter().flat_map(|round| round.passes.keys()).collect();
        let of = |name: &String| median(rounds.iter().filter_map(|round| round.passes.get(name).copied()).collect());
        let passes: BTreeMap<String, f64> = names.into_iter().map(|name| (name.clone(), of(name))).collect();
        let timed = rounds.iter().filter(|round| !round.frame_ms.is_empty());
        let frame = median(timed.map(|round| median(round.frame_ms.clone())).collect());
        Self {
            method,
            set,
            rest_ms: (frame - passes.values().sum::<f64>()).max(0.0),
            passes,
            prepare_ms: median(rounds.iter().map(|round| round.prepare_ms).collect()),
            flip,
        }
    }

    /// As the command line takes it.
    pub fn flags(&self) -> String {
        let set: String = self.set.iter().map(|(name, value)| format!(" --set {name}={value}")).collect();
        format!("--method {}{set}", self.method)
    }
}

impl Sheet {
    /// Milliseconds of a frame at another size; `new_video_frames`: each shows a new video frame.
    ///
    /// Times of passes grow with the number of pixels, but for their fixed share; the relit panorama, the panorama's own preparation and what is
    /// in no pass do not.
    pub fn predict(&self, candidate: &Candidate, size: [u32; 2], new_video_frames: bool) -> f64 {
        let growth = pixels(size) / pixels(self.size);
        let pass = |(name, ms): (&String, &f64)| {
            let fixed = if name == RELIGHT { 1.0 } else { self.fixed.get(name).copied().unwrap_or(0.0) };
            ms * (fixed + (1.0 - fixed) * growth)
        };
        let prepare = if new_video_frames { candidate.prepare_ms } else { 0.0 };
        candidate.rest_ms + candidate.passes.iter().map(pass).sum::<f64>() + prepare
    }

    /// What is expected of each candidate at a size; nothing of those of another method, where one is asked for.
    pub fn expected(&self, method: Option<&str>, size: [u32; 2], new_video_frames: bool) -> Vec<Expected> {
        let nothing = Expected { ms: f64::NAN, flip: f64::NAN };
        let of = |c: &Candidate| Expected { ms: self.predict(c, size, new_video_frames), flip: c.flip };
        let asked = |c: &Candidate| method.is_none_or(|method| method == c.method);
        self.candidates.iter().map(|c| if asked(c) { of(c) } else { nothing }).collect()
    }

    /// Whether it can answer for pictures of a size: of the same shape, and not smaller than they need to be.
    pub fn serves(&self, size: [u32; 2]) -> bool {
        let shape = |[w, h]: [u32; 2]| f64::from(w) / f64::from(h);
        let alike = (shape(self.size) / shape(size)).ln().abs() < 0.03;
        self.complete && alike && pixels(self.size) >= 0.9 * pixels(quick::size(size))
    }
}

/// The share of each pass's time at the first size that does not grow with the picture, by a straight line through its times at two.
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
