//! The clock: renders frames and takes their times. All that is timed goes through [`frames`].

use super::score::Scores;
use crate::{
    Result,
    gpu::Timings,
    passes::{Every, PASSES},
    renderer::{Renderer, UPLOAD, Wishes},
    scene::Scene,
};
use serde::{Deserialize, Serialize};
use std::{
    collections::{BTreeMap, HashSet},
    time::Instant,
};

/// The number of frames of a new renderer whose times do not count anywhere: shaders are compiled.
pub const WARM_UP: u32 = 5;

/// The number of frames of a new renderer whose times do not count in a chart: surfaces are young, and take more paths.
pub const STEADY: u32 = 16;

/// A frame that has finished.
#[derive(Clone, Debug)]
pub struct Sample {
    /// GPU times of the frame and of its passes.
    pub timings: Timings,
    /// When the frame before it ended, in milliseconds after the call of [`frames`].
    pub began_ms: f64,
    /// Wall time from the end of the frame before it to its own, milliseconds.
    pub wall_ms: f64,
}

/// Renders one frame for each time in `times`, in seconds. `each` is called after every frame, in order.
/// Two frames are in flight. All frames have finished when this returns. A caller who needs the picture of a
/// certain frame therefore ends `times` with that frame.
///
/// # Errors
/// Fails if a frame cannot be rendered, or with the first error that `each` returns.
pub fn frames(
    renderer: &mut Renderer,
    scene: &Scene,
    times: impl IntoIterator<Item = f64>,
    wishes: &Wishes,
    mut each: impl FnMut() -> Result<()>,
) -> Result<Vec<Sample>> {
    let start = Instant::now();
    let (mut began_ms, mut samples, mut paths) = (0.0, Vec::new(), HashSet::new());
    renderer.render_all(scene, times, wishes, |mut timings| {
        timings.share_paths(&mut paths);
        let ended_ms = timings.ended.unwrap_or_else(Instant::now).duration_since(start).as_secs_f64() * 1e3;
        samples.push(Sample { timings, began_ms, wall_ms: ended_ms - began_ms });
        began_ms = ended_ms;
        each()
    })?;
    Ok(samples)
}

/// Collects the times of one renderer's frames, without its first ones.
pub struct FrameClock {
    warm_up: u32,
    frames: u32,
    timed: Vec<Sample>,
}

impl FrameClock {
    /// A clock that leaves out this many frames.
    pub const fn after(warm_up: u32) -> Self {
        Self { warm_up, frames: 0, timed: Vec::new() }
    }

    /// Renders `count` frames of a still scene at `time`, in seconds. `each` is called after every frame.
    ///
    /// # Errors
    /// Fails as [`frames`] does.
    pub fn still(
        &mut self,
        renderer: &mut Renderer,
        scene: &Scene,
        time: f64,
        count: u32,
        mut each: impl FnMut() -> Result<()>,
    ) -> Result<()> {
        let times = std::iter::repeat_n(time, count as usize);
        let samples = frames(renderer, scene, times, &Wishes::default(), &mut each)?;
        self.timed.extend(samples.into_iter().skip(self.warm_up.saturating_sub(self.frames) as usize));
        self.frames += count;
        Ok(())
    }

    /// The times of this renderer's frames as a round without scores.
    pub fn round(self, renderer: &Renderer) -> Round {
        let mut passes: BTreeMap<String, Vec<f64>> = BTreeMap::new();
        for sample in &self.timed {
            for (name, ms) in PASSES.iter().filter_map(|pass| Some((pass.name, sample.timings.pass(pass.name)?))) {
                passes.entry(name.to_owned()).or_default().push(ms);
            }
        }
        // The panorama is uploaded before it is prepared.
        let once = PASSES.iter().filter(|pass| pass.every == Every::VideoFrame).map(|pass| pass.name);
        let once = once.chain([UPLOAD]);
        Round {
            frame_ms: self.timed.iter().map(|sample| sample.timings.gpu_ms).collect(),
            wall_ms: self.timed.iter().map(|sample| sample.wall_ms).collect(),
            passes: passes.into_iter().map(|(name, mut ms)| (name, quantile(&mut ms, 0.5))).collect(),
            prepare_ms: once.filter_map(|name| renderer.prepared().pass(name)).sum(),
            scores: Vec::new(),
        }
    }
}

/// One repetition of a measurement: the frames of one renderer after its warm-up.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Round {
    /// GPU milliseconds of each frame, from its first timestamp to its last.
    pub frame_ms: Vec<f64>,
    /// Wall milliseconds of each frame.
    pub wall_ms: Vec<f64>,
    /// Median GPU milliseconds of each pass that was dispatched.
    pub passes: BTreeMap<String, f64>,
    /// GPU milliseconds of the upload of a video frame and of the passes that run once for it.
    pub prepare_ms: f64,
    /// Scores of the pictures that the round looks at, with another seed in each round.
    pub scores: Vec<RoundScores>,
}

/// The scores of a picture of one round.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct RoundScores {
    /// Number of frames, including the picture's own.
    pub frames: u32,
    /// Whether the scene moved during these frames.
    pub moving: bool,
    /// The scores against both truths.
    pub scores: Scores,
}

impl Round {
    /// The scores of the picture after that many frames, if the round looked at it.
    pub fn scores_of(&self, frames: u32, moving: bool) -> Option<&Scores> {
        self.scores.iter().find(|own| (own.frames, own.moving) == (frames, moving)).map(|own| &own.scores)
    }

    /// Median GPU milliseconds of a frame; 0 if none was timed.
    pub fn median_ms(&self) -> f64 {
        median(self.frame_ms.iter().copied())
    }
}

/// A number over repetitions.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Spread {
    /// Median of the repetitions' medians.
    pub median: f64,
    /// Least of the repetitions' medians. For a single repetition it is the lower quartile.
    pub low: f64,
    /// Largest of the repetitions' medians. For a single repetition it is the upper quartile.
    pub high: f64,
}

impl Spread {
    /// Summarises repetitions of several values each. Each repetition counts by its median, however many
    /// values it has. Empty repetitions do not count, and the result is `None` if all are empty.
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

    /// A value that was found once.
    pub fn once(value: f64) -> Self {
        Self { median: value, low: value, high: value }
    }

    /// All three numbers times a factor.
    pub fn times(self, factor: f64) -> Self {
        Self { median: self.median * factor, low: self.low * factor, high: self.high * factor }
    }

    /// Whether the ranges of two spreads do not meet.
    pub fn is_apart_from(&self, other: &Self) -> bool {
        self.low > other.high || self.high < other.low
    }
}

/// Median of some values; 0 if there are none.
pub fn median(values: impl IntoIterator<Item = f64>) -> f64 {
    quantile(&mut values.into_iter().collect::<Vec<_>>(), 0.5)
}

/// Sorts the values and returns the quantile `q`, interpolated between the two nearest ranks; 0 if there are
/// no values.
pub fn quantile(values: &mut [f64], q: f64) -> f64 {
    values.sort_by(f64::total_cmp);
    let Some(last) = values.len().checked_sub(1) else { return 0.0 };
    let place = q * last as f64;
    let (low, high) = (place.floor() as usize, place.ceil() as usize);
    values[low] + (values[high] - values[low]) * (place - place.floor())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn quantiles_of_known_values() {
        assert_eq!(quantile(&mut [3.0, 1.0, 2.0], 0.5), 2.0);
        assert_eq!(quantile(&mut [4.0, 1.0, 2.0, 3.0], 0.5), 2.5);
        assert_eq!(quantile(&mut [], 0.5), 0.0);
    }

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
