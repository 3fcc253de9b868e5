//! Writes a chart as comma-separated values, with one line for each picture and region.

use super::point::{Chart, ChartPoint};
use crate::measure::{
    metrics::Metrics,
    score::{Score, TruthKind},
};
use std::fmt::Write;

impl Chart {
    /// Each line has scene, point, frames, truth and region, then the time and all metrics. The truths' own
    /// noise, the model's floor and the view without objects are points that cost nothing. `flip_low` and
    /// `flip_high` are the range of the seeds.
    pub fn csv(&self) -> String {
        let mut out = "scene,point,group,method,cost,frames,moving,ms_median,ms_low,ms_high,memory_bytes,truth,region,\
            flip,psnr,ssim,rmse,relmse,max_abs,mean_ratio,pixels,rmse_noise_free,relmse_noise_free,flip_low,flip_high,flicker\n"
            .to_owned();
        for scene in &self.scenes {
            let free = |name: &str| format!("{},\"{name}\",,,,,,,,,", quoted(&scene.name));
            let once = |_: TruthKind, _: &str| [None; 3];
            rows(&mut out, &free("noise of the truth"), Some(&scene.noise.model), scene.noise.scene.as_ref(), once);
            rows(&mut out, &free("nothing inserted"), Some(&scene.nothing.model), scene.nothing.scene.as_ref(), once);
            rows(&mut out, &free("the model, converged"), None, scene.floor.as_ref(), once);
            for point in self.of_scene(&scene.name) {
                let last = point.outcomes.iter().filter(|outcome| !outcome.moving).map(|outcome| outcome.frames).max();
                for outcome in &point.outcomes {
                    let head = head(point, outcome.frames, outcome.moving);
                    // The flicker is that of the last still frames.
                    let steady = !outcome.moving && Some(outcome.frames) == last;
                    let last = |truth: TruthKind, region: &str| {
                        let flip = point.flip(outcome, truth, region);
                        let flicker = point.flicker.get(region).copied().filter(|_| steady);
                        [flip.map(|flip| flip.low), flip.map(|flip| flip.high), flicker]
                    };
                    rows(&mut out, &head, Some(&outcome.scores.model), outcome.scores.scene.as_ref(), last);
                }
            }
        }
        out
    }
}

fn head(point: &ChartPoint, frames: u32, moving: bool) -> String {
    let cost = format!("{:?}", point.cost).to_lowercase();
    format!(
        "{},{},{},{},{cost},{frames},{moving},{:.4},{:.4},{:.4},{}",
        quoted(&point.scene),
        quoted(&point.name),
        point.group,
        point.method,
        point.ms.median,
        point.ms.low,
        point.ms.high,
        point.memory
    )
}

fn rows(
    out: &mut String,
    head: &str,
    model: Option<&Score>,
    scene: Option<&Score>,
    last: impl Fn(TruthKind, &str) -> [Option<f64>; 3],
) {
    for (name, truth, score) in [("model", TruthKind::Model, model), ("scene", TruthKind::Scene, scene)] {
        for (region, m) in score.into_iter().flat_map(Score::regions) {
            let last = last(truth, region).map(|value| value.map_or(String::new(), |value| format!("{value:.6}")));
            let _ = writeln!(out, "{head},{name},{region},{},{}", values(m), last.join(","));
        }
    }
}

fn values(m: &Metrics) -> String {
    let [rmse, relmse] = m
        .noise_free
        .map_or([String::new(), String::new()], |free| [free.rmse, free.relmse].map(|value| format!("{value:.6}")));
    format!(
        "{:.6},{:.3},{:.6},{:.6},{:.6},{:.6},{:.6},{},{rmse},{relmse}",
        m.flip, m.psnr, m.ssim, m.rmse, m.relmse, m.max_abs, m.mean_ratio, m.pixels
    )
}

fn quoted(text: &str) -> String {
    format!("\"{}\"", text.replace('"', "\"\""))
}
