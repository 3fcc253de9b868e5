//! Chooses settings from a chart's points as `--target-ms` and `--target-flip` would, and measures whether
//! the chosen settings keep what the points promise.

use super::{
    draw::short,
    options::{ChartInput, ChartOptions},
    pareto::front,
    point::{Chart, ChartChoice, ChartPoint, ChartScene, CostUnit},
};
use crate::{
    Result,
    gpu::Gpu,
    measure::{
        choice::{
            Candidate, Expected, FRAMES, Sheet, TRADED, Target, choose, error, fixed_shares, quick,
            store::{Store, given},
        },
        clock::{FrameClock, Round, STEADY, median},
        score::{Scorer, Scores},
    },
    options::RenderOptions,
    reference::cache::Keep,
    renderer::Renderer,
    scene::Scene,
    settings::{Method, Settings},
};
use std::{collections::BTreeMap, path::Path};

/// Where the targets lie between the best and the worst value on the front.
const BETWEEN: [f64; 3] = [0.1, 0.4, 0.8];
/// Number of frames that are timed at the larger size.
const LARGER: u32 = 4;
/// With fewer candidates than this there is little to choose from.
const LEAST: usize = 6;

/// A scene of a chart for which settings are chosen.
pub(super) struct Chooser<'a> {
    pub gpu: &'a Gpu,
    pub scene: &'a Scene,
    pub of: &'a ChartScene,
    pub scorer: &'a Scorer,
    /// The scene's own settings over the default method.
    pub settings: Settings,
    pub chart: &'a ChartOptions,
    pub keep: Keep<'a>,
}

/// The work of a scene's choices if all of them differ, in frames of the chart's size.
pub(super) fn work(chart: &ChartOptions) -> u64 {
    2 * BETWEEN.len() as u64 * choice_work(chart)
}

fn choice_work(chart: &ChartOptions) -> u64 {
    u64::from(frames(chart)) + 4 * u64::from(STEADY + LARGER)
}

/// Number of frames that is enough for the main picture and for times.
fn frames(chart: &ChartOptions) -> u32 {
    chart.main_frames().max(STEADY + LARGER)
}

impl Chooser<'_> {
    /// Chooses from the points of a chart, and measures each choice that was not measured before. `save` is
    /// called after each.
    pub fn run(&self, chart: &mut Chart, save: &dyn Fn(&Chart) -> Result<()>, tick: &mut dyn FnMut(u64)) -> Result<()> {
        let (sheet, points) = chart.sheet(self.of, &self.settings);
        let keys: Vec<[String; 2]> = points.iter().map(|point| [point.key.clone(), point.name.clone()]).collect();
        let expected = sheet.expected(None, sheet.size, false);
        let larger_size = self.chart.size.map(|side| 2 * side);
        let mut choices = Vec::new();
        let mut left = work(self.chart);
        for target in targets(&expected) {
            let Some(choice) = choose(&expected, target) else { continue };
            let [key, point] = keys[choice.index].clone();
            let candidate = &sheet.candidates[choice.index];
            let own = |choice: &&ChartChoice| choice.scene == self.of.name && choice.key == key;
            let before = chart.choices.iter().find(own).map(|before| (before.measured, before.larger_ms[1]));
            let (measured, larger_ms) = match before {
                Some(before) => before,
                None => self.measure(candidate, larger_size)?,
            };
            let choice = ChartChoice {
                scene: self.of.name.clone(),
                target,
                key,
                point,
                predicted: choice.expected,
                measured,
                larger_size,
                larger_ms: [sheet.predict(candidate, larger_size, false), larger_ms],
            };
            choices.push(choice.clone());
            if before.is_none() {
                // What earlier runs measured stays until all is done.
                chart.choices.push(choice);
                save(chart)?;
                tick(choice_work(self.chart));
                left = left.saturating_sub(choice_work(self.chart));
            }
        }
        chart.choices.retain(|choice| choice.scene != self.of.name);
        chart.choices.extend(choices);
        save(chart)?;
        tick(left);
        Ok(())
    }

    /// Measures error and time at the chart's size with a seed that no point had, and the time at the larger
    /// size.
    fn measure(&self, candidate: &Candidate, larger_size: [u32; 2]) -> Result<(Expected, f64)> {
        let method = Method::parse(&candidate.method, "the chart")?;
        let set: Vec<_> = candidate.set.iter().map(|(name, value)| (name.as_str(), value.as_str())).collect();
        let options = RenderOptions {
            size: self.chart.size,
            method,
            settings: quick::settings(method, &self.settings, &set)?,
            projection: self.chart.projection,
            seed: self.chart.seed.wrapping_add(self.chart.rounds),
            without_objects: false,
            eye: 0.0,
        };
        let (mut renderer, mut clock) =
            (Renderer::new(self.gpu, self.scene, options.clone())?, FrameClock::after(STEADY));
        let main = self.chart.main_frames();
        self.still(&mut renderer, &mut clock, main)?;
        let flip = self.error(&self.scorer.score(&renderer.picture()?)?);
        self.still(&mut renderer, &mut clock, frames(self.chart) - main)?;
        let measured = Expected { ms: clock.round(&renderer).median_ms(), flip };
        drop(renderer);
        let larger = RenderOptions { size: larger_size, ..options };
        let (mut renderer, mut clock) = (Renderer::new(self.gpu, self.scene, larger)?, FrameClock::after(STEADY));
        self.still(&mut renderer, &mut clock, STEADY + LARGER)?;
        Ok((measured, clock.round(&renderer).median_ms()))
    }

    fn still(&self, renderer: &mut Renderer, clock: &mut FrameClock, frames: u32) -> Result<()> {
        clock.still(renderer, self.scene, self.of.time, frames, || self.keep.go_on(&self.of.name))
    }

    fn error(&self, scores: &Scores) -> f64 {
        self.of.best().of(scores).map_or(f64::NAN, error)
    }
}

/// Targets between the extremes of the points on the front. The times lie at equal ratios.
fn targets(points: &[Expected]) -> Vec<Target> {
    let best = front(&points.iter().map(|point| (point.ms, point.flip)).collect::<Vec<_>>());
    let (Some(fast), Some(good)) = (best.first().map(|i| points[*i]), best.last().map(|i| points[*i])) else {
        return Vec::new();
    };
    let flips = BETWEEN.map(|t| Target { flip: Some(good.flip + t * (fast.flip - good.flip)), ms: None });
    let times = BETWEEN.map(|t| Target { ms: Some(fast.ms * (good.ms / fast.ms).powf(t)), flip: None });
    let mut all: Vec<Target> = [flips, times].concat();
    all.dedup();
    all
}

impl Chart {
    /// The points of a scene that a choice may take, and a sheet with a candidate for each, in the same
    /// order. `settings` hold those that the scene gives. A choice does not change them.
    pub fn sheet<'a>(&'a self, scene: &'a ChartScene, settings: &Settings) -> (Sheet, Vec<&'a ChartPoint>) {
        let given: BTreeMap<&str, String> = given(settings).into_iter().collect();
        let truth = scene.best();
        let own = |point: &ChartPoint| -> BTreeMap<String, String> {
            let set = point.set.iter().filter(|(name, _)| !given.contains_key(name.as_str()));
            set.map(|(name, value)| (name.clone(), value.clone())).collect()
        };
        let eligible = |point: &&ChartPoint| {
            point.cost == CostUnit::Frame
                && point.rendered == self.of.size
                && own(point).keys().all(|name| TRADED.contains(&name.as_str()))
                && given.iter().all(|(name, value)| point.settings.get(*name) == Some(value))
        };
        let points: Vec<&ChartPoint> = self.of_scene(&scene.name).filter(eligible).collect();
        let candidate = |point: &&ChartPoint| {
            let flip = |scores: &Scores| truth.of(scores).map(error);
            let main = |round: &Round| flip(round.scores_of(self.of.main_frames, false)?);
            let flips: Vec<f64> = point.rounds.iter().filter_map(main).collect();
            let flip = if flips.is_empty() { f64::NAN } else { median(flips) };
            Candidate::new(point.method.clone(), own(point), &point.rounds, flip)
        };
        let sheet = Sheet {
            size: self.of.size,
            truth: truth.name().to_owned(),
            noise: truth.of(&scene.noise).map_or(f64::NAN, error),
            fixed: self.fixed(scene),
            complete: self.of.main_frames == FRAMES && points.len() >= LEAST,
            candidates: points.iter().map(candidate).collect(),
        };
        (sheet, points)
    }

    /// The fixed shares, from the default method at its smallest internal resolution and at the chart's size.
    fn fixed(&self, scene: &ChartScene) -> BTreeMap<String, f64> {
        let smaller = self.of_scene(&scene.name).filter(|point| point.group == "scale");
        let smaller = smaller.min_by_key(|point| point.rendered[0]);
        let base = smaller.and_then(|point| self.point(&scene.name, &point.base));
        let of = |point: &ChartPoint| -> BTreeMap<String, f64> {
            point.passes().into_iter().map(|(name, ms)| (name.to_owned(), ms.median)).collect()
        };
        match base.zip(smaller) {
            Some((base, smaller)) => fixed_shares((&of(base), base.rendered), (&of(smaller), smaller.rendered)),
            None => BTreeMap::new(),
        }
    }

    /// The choices of a scene.
    pub fn choices_of<'a>(&'a self, scene: &'a str) -> impl Iterator<Item = &'a ChartChoice> {
        self.choices.iter().filter(move |choice| choice.scene == scene)
    }
}

/// Keeps the points of each scene, so that settings can be chosen from them later. They are kept if they show
/// the first frame and are enough to choose from.
///
/// # Errors
/// Fails if a panorama cannot be read.
pub fn keep_sheets(
    gpu: &Gpu,
    inputs: &[ChartInput],
    options: &ChartOptions,
    chart: &Chart,
    folder: Option<&Path>,
) -> Result<()> {
    for input in inputs.iter().filter(|_| options.frame == 0) {
        let Some(scene) = chart.scenes.iter().find(|scene| scene.name == input.name) else { continue };
        let settings = input.settings()?;
        let (sheet, _) = chart.sheet(scene, &settings);
        if sheet.complete {
            let view = options.render_options(settings, Method::Iprt);
            Store::of(gpu, &input.scene, &view, scene.exposure, folder)?.put(sheet);
        }
    }
    Ok(())
}

/// What the table of choices shows, for its readers.
pub(super) const INTRODUCTION: &str = "What a target (`--target-flip`, `--target-ms`) makes of the points, and what the chosen settings then were: errors and times measured \
     anew, with other random numbers, and times at twice the width and height, predicted from this size. The error is FLIP over virtual or influenced pixels, \
     whichever is larger.";

/// The heads of the table's columns. The first two columns are text.
pub(super) fn head(chart: &Chart, scene: &ChartScene) -> [String; 8] {
    let at = |[width, height]: [u32; 2], what: &str| format!("{what}, {width}×{height}");
    let own = chart.of.size;
    let larger = chart.choices_of(&scene.name).next().map_or(own, |choice| choice.larger_size);
    [
        "target".to_owned(),
        "chosen".to_owned(),
        "FLIP, predicted".to_owned(),
        "FLIP, measured".to_owned(),
        at(own, "ms predicted"),
        at(own, "ms measured"),
        at(larger, "ms predicted"),
        at(larger, "ms measured"),
    ]
}

impl ChartChoice {
    /// The target for people.
    pub fn target_text(&self) -> String {
        let ms = self.target.ms.map(|ms| format!("at most {} ms", short(ms)));
        let flip = self.target.flip.map(|flip| format!("FLIP at most {flip:.3}"));
        [ms, flip].into_iter().flatten().collect::<Vec<_>>().join(", ")
    }

    /// The cells of a choice in these columns.
    pub(super) fn cells(&self) -> [String; 8] {
        let [predicted, measured] = [self.predicted, self.measured];
        let [predicted_larger, measured_larger] = self.larger_ms.map(short);
        [
            self.target_text(),
            self.point.clone(),
            format!("{:.3}", predicted.flip),
            format!("{:.3}", measured.flip),
            short(predicted.ms),
            short(measured.ms),
            predicted_larger,
            measured_larger,
        ]
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn targets_lie_between_what_can_be_had() {
        let of = |list: &[(f64, f64)]| -> Vec<Expected> {
            list.iter().map(|(ms, flip)| Expected { ms: *ms, flip: *flip }).collect()
        };
        // The second point is worse than the first, and the last was not measured.
        let points = of(&[(10.0, 0.3), (2000.0, 0.9), (1000.0, 0.1), (40.0, f64::NAN)]);
        let found = targets(&points);
        assert_eq!(found.len(), 6);
        let flips: Vec<f64> = found.iter().filter_map(|target| target.flip).collect();
        let times: Vec<f64> = found.iter().filter_map(|target| target.ms).collect();
        assert!((flips[0] - 0.12).abs() < 1e-12 && (flips[2] - 0.26).abs() < 1e-12, "{flips:?}");
        assert!((times[1] - 10.0 * 100f64.powf(0.4)).abs() < 1e-9, "{times:?}");
        assert!(found.iter().all(|target| choose(&points, *target).is_some_and(|c| c.reached.ms && c.reached.flip)));
        assert_eq!(targets(&points[..1]).len(), 2, "one point: one time, one error");
        assert_eq!(targets(&[]), []);
    }
}
