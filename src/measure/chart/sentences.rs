//! Says in words what each setting buys and costs. The words follow from the measured points alone.

use super::{
    draw::short,
    point::{Chart, ChartPoint, ChartScene},
};
use crate::measure::{clock::Spread, score::REGIONS};
use std::fmt::Write;

/// A smaller change of FLIP does not count. Two drivers may differ by as much.
const LEAST_FLIP: f64 = 0.002;

/// What readers of the sentences must know.
pub const NOTE: &str = "Errors of a still picture come with the range of their seeds; those while objects move are of one sequence a setting, \
    and how much they would differ with another seed is not known.";

/// What was found about the values of a setting.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Finding {
    /// The setting's name, or `scale`.
    pub setting: String,
    /// One sentence for each value.
    pub sentences: Vec<String>,
}

impl Chart {
    /// What each changed setting buys and costs in a scene, in the order of the points.
    pub fn findings(&self, scene: &ChartScene) -> Vec<Finding> {
        let mut findings: Vec<Finding> = Vec::new();
        for point in self.of_scene(&scene.name).filter(|point| !point.base.is_empty()) {
            let Some(base) = self.point(&scene.name, &point.base) else { continue };
            let sentence = self.sentence(scene, point, base);
            match findings.iter_mut().find(|finding| finding.setting == point.group) {
                Some(finding) => finding.sentences.push(sentence),
                None => findings.push(Finding { setting: point.group.clone(), sentences: vec![sentence] }),
            }
        }
        findings
    }

    fn sentence(&self, scene: &ChartScene, point: &ChartPoint, base: &ChartPoint) -> String {
        let (mut better, mut worse) = (Vec::new(), Vec::new());
        let truth = scene.best();
        for region in &REGIONS[1..] {
            let flip = |p: &ChartPoint| p.flip(p.still(self.of.main_frames)?, truth, region);
            if let Some((a, b)) = flip(base).zip(flip(point)) {
                tell(a, b, &format!("{region} pixels"), &mut better, &mut worse);
            }
            // It comes from one sequence, as `NOTE` says.
            let moving = |p: &ChartPoint| {
                let flip = truth.of(&p.moving()?.scores)?.region(region)?.flip;
                Some(Spread::once(flip))
            };
            if let Some((a, b)) = moving(base).zip(moving(point)) {
                tell(a, b, &format!("{region} pixels while objects move, once"), &mut better, &mut worse);
            }
        }
        let value = match point.group.as_str() {
            "scale" => format!(
                "{}×{} pixels, stretched, instead of {}×{}",
                point.rendered[0], point.rendered[1], base.rendered[0], base.rendered[1]
            ),
            setting => {
                let of = |p: &ChartPoint| p.settings.get(setting).cloned().unwrap_or_default();
                let method = if base.method == "iprt" { String::new() } else { format!(" ({})", base.method) };
                format!("{} instead of {}{method}", of(point), of(base))
            }
        };
        let once = if point.rounds.len().min(base.rounds.len()) < 2 { " (Measured once.)" } else { "" };
        format!("{value} {}{once}", verdict(base.ms, point.ms, &better, &worse))
    }
}

/// Adds a change to one of the lists. It counts if the seeds' ranges do not meet and if it is large enough to
/// be seen.
fn tell(before: Spread, after: Spread, what: &str, better: &mut Vec<String>, worse: &mut Vec<String>) {
    let change = after.median - before.median;
    if !after.is_apart_from(&before) || change.abs() < LEAST_FLIP {
        return;
    }
    let text = format!("{:.3} on {what} ({:.3} to {:.3})", change.abs(), before.median, after.median);
    if change < 0.0 { better.push(text) } else { worse.push(text) }
}

/// One sentence about time and error.
fn verdict(before: Spread, after: Spread, better: &[String], worse: &[String]) -> String {
    let share = 100.0 * (after.median / before.median.max(1e-9) - 1.0);
    let apart = after.is_apart_from(&before);
    let times = format!("{} to {} ms", short(before.median), short(after.median));
    let (mut buys, mut costs) = (Vec::new(), Vec::new());
    if apart && share <= -1.0 {
        buys.push(format!("{:.0} % of the time ({times})", -share));
    } else if apart && share >= 1.0 {
        costs.push(format!("{share:.0} % more time ({times})"));
    }
    if !better.is_empty() {
        buys.push(format!("less error: {}", better.join(", ")));
    }
    if !worse.is_empty() {
        costs.push(format!("more error: {}", worse.join(", ")));
    }
    let mut out = match buys.is_empty() {
        true => "buys nothing".to_owned(),
        false => format!("buys {}", buys.join(" and ")),
    };
    let _ = match (costs.is_empty(), buys.is_empty()) {
        (true, true) => {
            out = "makes no difference that was measured".to_owned();
            Ok(())
        }
        (true, false) if apart => write!(out, " and costs nothing that was measured"),
        (true, false) => write!(out, "; no cost was measured"),
        (false, _) => write!(out, " and costs {}", costs.join(" and ")),
    };
    if !apart {
        out += "; the times' ranges overlap";
    }
    out + "."
}

#[cfg(test)]
mod tests {
    use super::*;

    fn spread(median: f64) -> Spread {
        Spread { median, low: 0.99 * median, high: 1.01 * median }
    }

    #[test]
    fn verdicts_follow_from_numbers() {
        let (mut better, mut worse) = (Vec::new(), Vec::new());
        tell(spread(0.1), spread(0.08), "a", &mut better, &mut worse);
        tell(spread(0.1), spread(0.1015), "b", &mut better, &mut worse);
        tell(spread(0.1), Spread { median: 0.2, low: 0.05, high: 0.3 }, "c", &mut better, &mut worse);
        assert_eq!((better.as_slice(), worse.len()), (["0.020 on a (0.100 to 0.080)".to_owned()].as_slice(), 0));
        let text = verdict(spread(10.0), spread(15.0), &better, &worse);
        assert_eq!(text, "buys less error: 0.020 on a (0.100 to 0.080) and costs 50 % more time (10.0 to 15.0 ms).");
        let text = verdict(spread(10.0), spread(5.0), &worse, &better);
        assert_eq!(text, "buys 50 % of the time (10.0 to 5.00 ms) and costs more error: 0.020 on a (0.100 to 0.080).");
        let text = verdict(spread(10.0), spread(10.05), &[], &[]);
        assert_eq!(text, "makes no difference that was measured; the times' ranges overlap.");
        assert_eq!(
            verdict(spread(10.0), spread(15.0), &[], &[]),
            "buys nothing and costs 50 % more time (10.0 to 15.0 ms)."
        );
    }
}
