//! Measures what a sequence does over time and its truth does not: flicker, lag, ghosts of the past and
//! unsteady motion.
//!
//! All metrics take displayed values, sRGB(clip(exposure · L)) in 0..1, channel by channel over the pixels of
//! a region. The caller leaves out the frames that warm up the history.

use super::metrics::show;
use crate::{Error, Result};
use rayon::prelude::*;
use serde::{Serialize, Serializer};

/// Linear radiance of successive frames of one size, row 0 on top.
#[derive(Clone, Copy, Debug)]
pub struct Sequence<'a> {
    /// What error messages call the sequence.
    pub subject: &'a str,
    /// Width and height, pixels.
    pub size: [u32; 2],
    /// RGBA of each frame. Alpha is not compared.
    pub frames: &'a [Vec<[f32; 4]>],
}

/// All metrics of a sequence against its truth.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct TemporalMetrics {
    /// [`flicker()`] of the test.
    pub flicker: f64,
    /// [`flicker()`] of the truth, which comes from its own noise or from motion.
    pub flicker_truth: f64,
    /// [`lag()`].
    pub lag: Lag,
    /// [`ghost_energy()`].
    pub ghost_energy: f64,
    /// [`warped_difference()`].
    pub warped_difference: f64,
}

/// How late a change is shown.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Lag {
    /// The number of frames. It is 1 if the change is shown in the very frame in which the truth has it.
    Frames(u32),
    /// The sequence does not show the change.
    Never,
    /// The truth does not change, or by no more than its own noise from frame to frame.
    NoChange,
}

impl Lag {
    /// The number of frames, if there is one.
    pub fn frames(self) -> Option<u32> {
        match self {
            Self::Frames(frames) => Some(frames),
            Self::Never | Self::NoChange => None,
        }
    }
}

/// Writes a number, "never", or null if the truth does not change.
impl Serialize for Lag {
    fn serialize<S: Serializer>(&self, to: S) -> std::result::Result<S::Ok, S::Error> {
        match self {
            Self::Frames(frames) => to.serialize_u32(*frames),
            Self::Never => to.serialize_str("never"),
            Self::NoChange => to.serialize_none(),
        }
    }
}

/// A change counts as made after this share of it.
const MADE: f64 = 0.9;
/// A root mean square change of displayed values below this is no change. It is a quarter of an 8-bit step.
const NO_CHANGE: f64 = 1e-3;

/// Computes all metrics. `motion` is as in [`warped_difference()`].
///
/// # Errors
/// Fails if one of the metrics fails.
pub fn compare_sequence(
    test: Sequence,
    truth: Sequence,
    motion: Option<&[Vec<[f32; 2]>]>,
    mask: Option<&[bool]>,
    exposure: f32,
) -> Result<TemporalMetrics> {
    let pair = Pair::new(test, truth, mask, exposure)?;
    Ok(TemporalMetrics {
        flicker: deviation(&pair.test, &pair.inside),
        flicker_truth: deviation(&pair.truth, &pair.inside),
        lag: pair.lag(),
        ghost_energy: pair.ghost_energy(),
        warped_difference: pair.warped_difference(test, motion)?,
    })
}

/// The standard deviation over the frames, as the mean over channels and pixels. It is that of a sample: the
/// sum is divided by the number of frames less one. In a still scene it is what is seen to flicker. Where the
/// scene changes, the change counts too.
///
/// # Errors
/// Fails if there are fewer than two frames, if a frame or the mask has another size, if a radiance is not
/// finite, or if the mask has no pixel.
pub fn flicker(frames: Sequence, mask: Option<&[bool]>, exposure: f32) -> Result<f64> {
    let inside = region(frames.size, mask)?;
    Ok(deviation(&displayed(frames, exposure)?, &inside))
}

/// The number of frames that the test takes until it has made 90 % of the truth's change from its first frame
/// to its last.
///
/// The progress of a frame is (frame − before)·Δ / Δ·Δ, where Δ is after − before of the truth. The products
/// are sums over channels and pixels. So each pixel counts by how much it should change and in that
/// direction, a shadow that leaves one place for another does not cancel, and noise averages out.
///
/// `before` is each sequence's own mean over the frames where the truth has made less than 10 % of the
/// change, so that a constant error is no lag. `after` is the truth's mean over the frames where it has made
/// 90 %. The lag is the number of the test's first frame with a progress of 90 %, less that of the truth,
/// plus one. It is at least one. An exponential history of weight α has a lag of ⌈ln 0.1 / ln(1 − α)⌉ after a
/// step.
///
/// # Errors
/// Fails like [`flicker()`], or if the sequences have different lengths or sizes.
pub fn lag(test: Sequence, truth: Sequence, mask: Option<&[bool]>, exposure: f32) -> Result<Lag> {
    Ok(Pair::new(test, truth, mask, exposure)?.lag())
}

/// How much of the past is left in the picture. It is the share k that makes truth + k·(past − truth) closest
/// to the test, by least squares over all frames, all their past frames, channels and pixels:
///
/// k = Σ (test_t − truth_t)·(truth_s − truth_t) / Σ |truth_s − truth_t|², with sums over t and s < t.
///
/// A picture that is all past has k = 1. A picture that overshoots the change has a negative k. If the error
/// has nothing to do with the past, as white noise in expectation, k is 0. Where the truth stands still no
/// past can be left, and k is 0. The truth should be converged: if its noise has variance σ² where it changes
/// by Δ, it adds σ²/(Δ² + 2σ²).
///
/// # Errors
/// Fails like [`lag()`].
pub fn ghost_energy(test: Sequence, truth: Sequence, mask: Option<&[bool]>, exposure: f32) -> Result<f64> {
    Ok(Pair::new(test, truth, mask, exposure)?.ghost_energy())
}

/// Mean |frame_t − warp(frame_{t−1})| of the test, less that of the truth, over channels, pixels and frames
/// from the second on. It is negative if the test changes less than it should.
///
/// `motion` has, for each frame, each pixel's way to where its surface was one frame before, in pixels to the
/// right and down. The former frame is read there bilinearly. A way that is not finite marks a surface that
/// was not seen before. It is left out, like all that comes from outside the picture. The motion of the first
/// frame is not used. Without `motion` nothing moves.
///
/// # Errors
/// Fails like [`lag()`], if the motion has another length or size, or if no pixel was seen before.
pub fn warped_difference(
    test: Sequence,
    truth: Sequence,
    motion: Option<&[Vec<[f32; 2]>]>,
    mask: Option<&[bool]>,
    exposure: f32,
) -> Result<f64> {
    Pair::new(test, truth, mask, exposure)?.warped_difference(test, motion)
}

/// The displayed values of a frame.
type Displayed = Vec<[f32; 3]>;

struct Pair {
    size: [u32; 2],
    test: Vec<Displayed>,
    truth: Vec<Displayed>,
    /// Indices of the pixels in the region.
    inside: Vec<usize>,
}

impl Pair {
    fn new(test: Sequence, truth: Sequence, mask: Option<&[bool]>, exposure: f32) -> Result<Self> {
        let problem = if test.size != truth.size {
            let ([a, b], [c, d]) = (test.size, truth.size);
            Some((format!("is {a}×{b}, {} is {c}×{d}", truth.subject), "compare pictures of one size"))
        } else if test.frames.len() != truth.frames.len() {
            let (a, b) = (test.frames.len(), truth.frames.len());
            Some((format!("has {a} frames, {} has {b}", truth.subject), "compare sequences of one length"))
        } else {
            None
        };
        if let Some((problem, remedy)) = problem {
            return Err(Error::input(test.subject, problem, remedy));
        }
        let inside = region(test.size, mask)?;
        Ok(Self { size: test.size, test: displayed(test, exposure)?, truth: displayed(truth, exposure)?, inside })
    }

    fn lag(&self) -> Lag {
        let last = self.truth.len() - 1;
        // The first estimate takes the ends alone. The next one takes the mean of all frames that are like
        // them.
        let mut before = vec![0];
        let mut after = vec![last];
        let mut change = Change::new(&self.truth, &before, &after, &self.inside);
        if change.is_nothing(&self.truth) {
            return Lag::NoChange;
        }
        let progress: Vec<f64> = self.truth.iter().map(|frame| change.progress(frame)).collect();
        before.extend((1..last).filter(|t| progress[*t] < 1.0 - MADE));
        after.extend((1..last).filter(|t| progress[*t] >= MADE));
        change = Change::new(&self.truth, &before, &after, &self.inside);

        let reached = |frames: &[Displayed], change: &Change| frames.iter().position(|f| change.progress(f) >= MADE);
        let truth = reached(&self.truth, &change).unwrap_or(last);
        change.before = mean_frame(&self.test, &before, &self.inside);
        match reached(&self.test, &change) {
            Some(test) => Lag::Frames((test as u32 + 1).saturating_sub(truth as u32).max(1)),
            None => Lag::Never,
        }
    }

    fn ghost_energy(&self) -> f64 {
        // Σ_s<t of truth_s and of |truth_s|² turn the sum over all pairs into one over frames.
        let mut past = vec![[0.0_f64; 3]; self.inside.len()];
        let (mut past_square, mut along, mut energy, mut largest) = (0.0, 0.0, 0.0, 0.0_f64);
        for (t, (test, truth)) in self.test.iter().zip(&self.truth).enumerate() {
            let count = t as f64;
            let sums = self.inside.par_chunks(CHUNK).zip(past.par_chunks(CHUNK)).map(|(inside, past)| {
                let (mut error_past, mut truth_past, mut square) = (0.0, 0.0, 0.0);
                for (&i, past) in inside.iter().zip(past) {
                    for c in 0..3 {
                        let (shown, wanted) = (f64::from(test[i][c]), f64::from(truth[i][c]));
                        error_past += (shown - wanted) * (past[c] - count * wanted);
                        truth_past += wanted * past[c];
                        square += wanted * wanted;
                    }
                }
                [error_past, truth_past, square]
            });
            let [error_past, truth_past, square] = total(sums.collect());
            let differences = past_square - 2.0 * truth_past + count * square;
            along += error_past;
            energy += differences;
            largest = largest.max(differences / count.max(1.0));
            past_square += square;
            past.par_iter_mut().zip(&self.inside).for_each(|(past, &i)| {
                (0..3).for_each(|c| past[c] += f64::from(truth[i][c]));
            });
        }
        if largest / self.samples() < NO_CHANGE * NO_CHANGE { 0.0 } else { along / energy }
    }

    fn warped_difference(&self, test: Sequence, motion: Option<&[Vec<[f32; 2]>]>) -> Result<f64> {
        if let Some(motion) = motion {
            let pixels = self.truth[0].len();
            if motion.len() != self.truth.len() || motion[1..].iter().any(|m| m.len() != pixels) {
                let problem = "its motion has another length or size";
                return Err(Error::input(test.subject, problem, "give motion for each pixel of each frame"));
            }
        }
        let (mut difference, mut count) = (0.0, 0.0);
        for t in 1..self.truth.len() {
            let sums = self.inside.par_chunks(CHUNK).map(|inside| {
                let (mut difference, mut count) = (0.0, 0.0);
                for &i in inside {
                    let way = motion.map_or([0.0; 2], |motion| motion[t][i]);
                    let Some(taps) = taps(self.size, i, way) else { continue };
                    let apart = |frames: &[Displayed]| {
                        let then =
                            |c: usize| taps.iter().map(|(i, w)| w * f64::from(frames[t - 1][*i][c])).sum::<f64>();
                        (0..3).map(|c| (f64::from(frames[t][i][c]) - then(c)).abs()).sum::<f64>()
                    };
                    difference += apart(&self.test) - apart(&self.truth);
                    count += 3.0;
                }
                [difference, count, 0.0]
            });
            let [d, n, _] = total(sums.collect());
            difference += d;
            count += n;
        }
        if count == 0.0 {
            let problem = "no pixel of the region is seen in two successive frames";
            return Err(Error::input(test.subject, problem, "give a larger region, or frames that follow each other"));
        }
        Ok(difference / count)
    }

    fn samples(&self) -> f64 {
        3.0 * self.inside.len() as f64
    }
}

/// The truth's change over the region.
struct Change<'a> {
    inside: &'a [usize],
    before: Vec<[f64; 3]>,
    by: Vec<[f64; 3]>,
    /// |by|².
    square: f64,
}

impl<'a> Change<'a> {
    fn new(truth: &[Displayed], before: &[usize], after: &[usize], inside: &'a [usize]) -> Self {
        let before = mean_frame(truth, before, inside);
        let by: Vec<_> = (mean_frame(truth, after, inside).iter().zip(&before))
            .map(|(after, before)| [0, 1, 2].map(|c| after[c] - before[c]))
            .collect();
        let square =
            total(by.par_chunks(CHUNK).map(|by| [by.iter().flatten().map(|d| d * d).sum(), 0.0, 0.0]).collect())[0];
        Self { inside, before, by, square }
    }

    /// Whether the change is too small to be seen or within the noise. The noise is the median squared
    /// difference of successive frames, without the step itself.
    fn is_nothing(&self, truth: &[Displayed]) -> bool {
        let mut between: Vec<f64> =
            (1..truth.len()).map(|t| Self::new(truth, &[t - 1], &[t], self.inside).square).collect();
        between.sort_by(f64::total_cmp);
        between.pop();
        let noise = between.get(between.len() / 2).copied().unwrap_or(0.0);
        self.square < (NO_CHANGE * NO_CHANGE * 3.0 * self.inside.len() as f64).max(2.0 * noise)
    }

    fn progress(&self, frame: &Displayed) -> f64 {
        let chunks = self.inside.par_chunks(CHUNK).zip(self.before.par_chunks(CHUNK)).zip(self.by.par_chunks(CHUNK));
        let sums = chunks.map(|((inside, before), by)| {
            let pixels = inside.iter().zip(before).zip(by);
            let dot = |((i, before), by): ((&usize, &[f64; 3]), &[f64; 3])| {
                (0..3).map(|c| (f64::from(frame[*i][c]) - before[c]) * by[c]).sum::<f64>()
            };
            [pixels.map(dot).sum(), 0.0, 0.0]
        });
        total(sums.collect())[0] / self.square
    }
}

/// Number of pixels that one task sums. It is fixed so that the sums do not depend on the number of threads.
const CHUNK: usize = 4096;

fn total(sums: Vec<[f64; 3]>) -> [f64; 3] {
    sums.iter().fold([0.0; 3], |a, b| [a[0] + b[0], a[1] + b[1], a[2] + b[2]])
}

/// Mean of some of the frames, over the region.
fn mean_frame(frames: &[Displayed], which: &[usize], inside: &[usize]) -> Vec<[f64; 3]> {
    let mean = |i: &usize| {
        [0, 1, 2].map(|c| which.iter().map(|t| f64::from(frames[*t][*i][c])).sum::<f64>() / which.len() as f64)
    };
    inside.par_iter().map(mean).collect()
}

fn deviation(frames: &[Displayed], inside: &[usize]) -> f64 {
    let n = frames.len() as f64;
    let sums = inside.par_chunks(CHUNK).map(|inside| {
        let deviation = |i: usize, c: usize| {
            let mean = frames.iter().map(|frame| f64::from(frame[i][c])).sum::<f64>() / n;
            let squares = frames.iter().map(|frame| (f64::from(frame[i][c]) - mean).powi(2)).sum::<f64>();
            (squares / (n - 1.0)).sqrt()
        };
        [inside.iter().map(|i| (0..3).map(|c| deviation(*i, c)).sum::<f64>()).sum(), 0.0, 0.0]
    });
    total(sums.collect())[0] / (3.0 * inside.len() as f64)
}

/// Returns where a pixel was, as pixels of the former frame and their weights. The result is `None` outside
/// the picture.
fn taps([width, height]: [u32; 2], index: usize, way: [f32; 2]) -> Option<[(usize, f64); 4]> {
    let own = [index as u32 % width, index as u32 / width];
    let at = [0, 1].map(|k| f64::from(own[k]) + f64::from(way[k]));
    let last = [width, height].map(|side| f64::from(side - 1));
    // A value that is not finite is not within the picture, either.
    if !(0..2).all(|k| (0.0..=last[k]).contains(&at[k])) {
        return None;
    }
    let low = at.map(f64::floor);
    let [fx, fy] = [at[0] - low[0], at[1] - low[1]];
    let pixel = |dx: f64, dy: f64| {
        let [x, y] = [(low[0] + dx).min(last[0]), (low[1] + dy).min(last[1])];
        y as usize * width as usize + x as usize
    };
    Some([
        (pixel(0.0, 0.0), (1.0 - fx) * (1.0 - fy)),
        (pixel(1.0, 0.0), fx * (1.0 - fy)),
        (pixel(0.0, 1.0), (1.0 - fx) * fy),
        (pixel(1.0, 1.0), fx * fy),
    ])
}

fn displayed(of: Sequence, exposure: f32) -> Result<Vec<Displayed>> {
    let pixels = of.size[0] as usize * of.size[1] as usize;
    if of.frames.len() < 2 {
        let problem = format!("has {} frames", of.frames.len());
        return Err(Error::input(of.subject, problem, "what happens over time needs two at least"));
    }
    if let Some(t) = of.frames.iter().position(|frame| frame.len() != pixels) {
        let problem = format!("its frame {t} has {} pixels instead of {pixels}", of.frames[t].len());
        return Err(Error::input(of.subject, problem, "give frames of one size"));
    }
    let finite = |texel: &[f32; 4]| texel[..3].iter().all(|v| v.is_finite());
    if let Some(t) = of.frames.iter().position(|frame| !frame.iter().all(finite)) {
        let problem = format!("its frame {t} has pixels that are not finite");
        return Err(Error::input(of.subject, problem, "nothing can be measured on them"));
    }
    let shown =
        |frame: &Vec<[f32; 4]>| frame.iter().map(|texel| [0, 1, 2].map(|c| show(exposure * texel[c]))).collect();
    Ok(of.frames.par_iter().map(shown).collect())
}

fn region(size: [u32; 2], mask: Option<&[bool]>) -> Result<Vec<usize>> {
    let pixels = size[0] as usize * size[1] as usize;
    if mask.is_some_and(|mask| mask.len() != pixels) {
        return Err(Error::input("--mask", "is of another size", "give a mask of the pictures' size"));
    }
    let inside: Vec<usize> = (0..pixels).filter(|i| mask.is_none_or(|mask| mask[*i])).collect();
    if inside.is_empty() {
        return Err(Error::input("--mask", "no pixel is in the region", "give a mask with a bright part"));
    }
    Ok(inside)
}

#[cfg(test)]
mod tests;
