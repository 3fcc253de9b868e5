//! Colours, logarithmic axes and escaped text, which all drawings of a chart share.

use crate::{measure::clock::Spread, passes::PASSES, settings::Settings};

/// The colour of a pass. A setting has the colour of its pass.
pub fn pass_color(pass: &str) -> &'static str {
    PASSES.iter().find(|row| row.name == pass).map_or("#222222", |row| row.color)
}

/// The colour of a point, by its [`ChartPoint::group`](super::ChartPoint::group).
pub fn group_color(group: &str) -> &'static str {
    match group {
        "method" => "#000000",
        "reference" | "limit" => "#777777",
        "scale" => "#00a0b0",
        setting => Settings::TABLE.iter().find(|row| row.name == setting).map_or("#222222", |row| pass_color(row.pass)),
    }
}

/// Escapes text for SVG and HTML. The result may stand within quotes.
pub fn escape(text: &str) -> String {
    text.replace('&', "&amp;").replace('<', "&lt;").replace('>', "&gt;").replace('"', "&quot;").replace('\n', "&#10;")
}

/// A number with three significant digits.
pub fn short(value: f64) -> String {
    match value {
        v if v >= 100.0 => format!("{v:.0}"),
        v if v >= 10.0 => format!("{v:.1}"),
        v if v >= 1.0 => format!("{v:.2}"),
        v => format!("{v:.3}"),
    }
}

/// The median of an error over the seeds, and half of their range.
pub fn flip_text(flip: Option<Spread>) -> String {
    match flip {
        Some(Spread { median, low, high }) if high > low => format!("{median:.3} ± {:.3}", 0.5 * (high - low)),
        Some(Spread { median, .. }) => format!("{median:.3}"),
        None => "–".to_owned(),
    }
}

/// A logarithmic axis between two places in a drawing.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Axis {
    values: [f64; 2],
    places: [f64; 2],
}

impl Axis {
    /// Makes an axis that holds all positive values, with some room.
    pub fn around(values: impl Iterator<Item = f64>, places: [f64; 2]) -> Self {
        let positive = values.filter(|value| value.is_finite() && *value > 0.0);
        let (low, high) = positive.fold((f64::INFINITY, 0.0f64), |(low, high), v| (low.min(v), high.max(v)));
        let values = if high > 0.0 { [0.8 * low, 1.25 * high] } else { [0.1, 1.0] };
        Self { values, places }
    }

    /// The place of a value. Values outside the axis are put at its ends.
    pub fn place(&self, value: f64) -> f64 {
        let [low, high] = self.values;
        let share = (value.max(1e-12) / low).ln() / (high / low).ln();
        self.places[0] + share.clamp(0.0, 1.0) * (self.places[1] - self.places[0])
    }

    /// Round values on the axis, as many as there is room for. A short axis has at least two, so that its
    /// scale can be read.
    pub fn ticks(&self) -> Vec<f64> {
        let [low, high] = self.values;
        let decades = low.log10().floor() as i32..=high.log10().ceil() as i32;
        let of = |steps: &'static [f64]| -> Vec<f64> {
            let all = decades.clone().flat_map(|decade| steps.iter().map(move |step| step * 10f64.powi(decade)));
            all.filter(|value| (low..=high).contains(value)).collect()
        };
        let fine: [&[f64]; 2] = [&[1.0, 1.2, 1.5, 2.0, 2.5, 3.0, 4.0, 5.0, 6.0, 8.0], &[1.0, 2.0, 5.0]];
        fine.map(of).into_iter().find(|ticks| ticks.len() <= 9).unwrap_or_else(|| of(&[1.0]))
    }
}

/// The label of a tick, without needless digits.
pub fn tick_label(value: f64) -> String {
    let power = value.log10().floor();
    let lead = value / 10f64.powf(power);
    let second = if (lead - lead.round()).abs() > 1e-6 { 1.0 } else { 0.0 };
    let digits = (second - power).max(0.0) as usize;
    format!("{value:.digits$}")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn errors_come_with_the_range_of_their_seeds() {
        assert_eq!(flip_text(Some(Spread { median: 0.05, low: 0.048, high: 0.054 })), "0.050 ± 0.003");
        assert_eq!(flip_text(Some(Spread::once(0.05))), "0.050");
        assert_eq!(flip_text(None), "–");
    }

    #[test]
    fn axes_are_logarithmic() {
        let axis = Axis::around([1.25, 80.0, 0.0, f64::NAN].into_iter(), [0.0, 200.0]);
        assert!((axis.place(1.0)).abs() < 1e-9 && (axis.place(10.0) - 100.0).abs() < 1e-9, "{axis:?}");
        assert_eq!(axis.place(0.0), 0.0);
        assert_eq!(axis.ticks(), [1.0, 2.0, 5.0, 10.0, 20.0, 50.0, 100.0]);
        let short = Axis::around([0.044, 0.047].into_iter(), [0.0, 200.0]);
        assert_eq!(short.ticks(), [0.04, 0.05]);
        let labels: Vec<_> = [0.02, 0.5, 1.0, 200.0, 0.012, 0.25, 1.5, 15.0, 120.0].map(tick_label).into();
        assert_eq!(labels, ["0.02", "0.5", "1", "200", "0.012", "0.25", "1.5", "15", "120"]);
        assert!(Axis::around(std::iter::empty(), [0.0, 1.0]).place(0.5).is_finite());
    }

    #[test]
    fn every_group_has_a_colour() {
        for spec in crate::measure::chart::Sweep::Full.points() {
            assert_ne!(group_color(spec.group), "#222222", "{}", spec.group);
        }
    }

    #[test]
    fn markup_is_escaped() {
        assert_eq!(escape("a<b & \"c\""), "a&lt;b &amp; &quot;c&quot;");
    }
}
