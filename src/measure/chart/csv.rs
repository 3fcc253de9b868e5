//! Writes a chart as comma-separated values, with one line for each picture and region.

use super::point::{Chart, ChartPoint};
use crate::measure::{metrics::Metrics, score::Score};
use std::fmt::Write;

impl Chart {
    /// Each line has scene, point, frames, truth and region, then the time and all metrics. The truths' own
    /// noise, the model's floor and the view without objects are points that cost nothing.
    pub fn csv(&self) -> String {
        let mut out = "scene,point,group,method,cost,frames,moving,ms_median,ms_low,ms_high,memory_bytes,truth,region,\
            flip,psnr,ssim,rmse,relmse,max_abs,mean_ratio,pixels,flicker\n"
            .to_owned();
        for scene in &self.scenes {
            let free = |name: &str| format!("{},\"{name}\",,,,,,,,,", quoted(&scene.name));
            rows(&mut out, &free("noise of the truth"), Some(&scene.noise.model), scene.noise.scene.as_ref(), |_| None);
            rows(&mut out, &free("nothing inserted"), Some(&scene.nothing.model), scene.nothing.scene.as_ref(), |_| {
                None
            });
            rows(&mut out, &free("the model, converged"), None, scene.floor.as_ref(), |_| None);
            for point in self.of_scene(&scene.name) {
                let last = point.outcomes.iter().filter(|outcome| !outcome.moving).map(|outcome| outcome.frames).max();
                for outcome in &point.outcomes {
                    let head = head(point, outcome.frames, outcome.moving);
                    // The flicker is that of the last still frames.
                    let steady = !outcome.moving && Some(outcome.frames) == last;
                    let flicker = |region: &str| point.flicker.get(region).copied().filter(|_| steady);
                    rows(&mut out, &head, Some(&outcome.scores.model), outcome.scores.scene.as_ref(), flicker);
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
    flicker: impl Fn(&str) -> Option<f64>,
) {
    for (truth, score) in [("model", model), ("scene", scene)] {
        for (region, m) in score.into_iter().flat_map(Score::regions) {
            let flicker = flicker(region).map_or(String::new(), |flicker| format!("{flicker:.6}"));
            let _ = writeln!(out, "{head},{truth},{region},{},{flicker}", values(m));
        }
    }
}

fn values(m: &Metrics) -> String {
    format!(
        "{:.6},{:.3},{:.6},{:.6},{:.6},{:.6},{:.6},{}",
        m.flip, m.psnr, m.ssim, m.rmse, m.relmse, m.max_abs, m.mean_ratio, m.pixels
    )
}

fn quoted(text: &str) -> String {
    format!("\"{}\"", text.replace('"', "\"\""))
}
