//! Draws a panel: cost against error of all points of a scene, over one region and against one truth.

use super::{
    draw::{Axis, escape, group_color, short, tick_label},
    pareto::front,
    point::{Chart, ChartPoint, ChartScene},
};
use crate::measure::{clock::Spread, score::TruthKind};
use std::fmt::Write;

/// Width and height of a panel, pixels.
pub const SIZE: [f64; 2] = [400.0, 320.0];
/// The margins on the left, top, right and bottom, pixels.
const MARGIN: [f64; 4] = [52.0, 26.0, 12.0, 40.0];

/// What a panel shows.
#[derive(Clone, Copy, Debug)]
pub struct Panel<'a> {
    pub chart: &'a Chart,
    pub scene: &'a ChartScene,
    pub truth: TruthKind,
    pub region: &'a str,
    /// Whether the panel shows the moving scene instead of the still one.
    pub moving: bool,
}

/// A point in a panel.
#[derive(Clone, Debug)]
pub struct Dot<'a> {
    /// The measured point, and its index among the points of the scene.
    pub point: &'a ChartPoint,
    pub index: usize,
    /// GPU milliseconds.
    pub cost: Spread,
    /// FLIP error.
    pub error: Spread,
}

impl<'a> Panel<'a> {
    /// The points of this panel that have a cost and an error.
    pub fn dots(&self) -> Vec<Dot<'a>> {
        let chart = self.chart;
        let points = chart.points.iter().filter(|point| point.scene == self.scene.name).enumerate();
        let dot = |(index, point): (usize, &'a ChartPoint)| {
            let picture = if self.moving { point.moving() } else { point.still(chart.of.main_frames) };
            let error = point.flip(picture?, self.truth, self.region)?;
            (point.ms.median > 0.0).then_some(Dot { point, index, cost: point.ms, error })
        };
        points.filter_map(dot).collect()
    }

    /// Indices of the dots on the front, the cheapest first.
    pub fn front(&self, dots: &[Dot]) -> Vec<usize> {
        let price = |dot: &Dot| if dot.point.group == "limit" { f64::INFINITY } else { dot.cost.median };
        front(&dots.iter().map(|dot| (price(dot), dot.error.median)).collect::<Vec<_>>())
    }

    /// The noise of the panel's truth.
    pub fn noise(&self) -> Option<f64> {
        Some(self.truth.of(&self.scene.noise)?.region(self.region)?.flip)
    }

    /// Draws the panel as an SVG group at a place. `id` begins the links of its points.
    pub fn svg(&self, [x, y]: [f64; 2], title: &str, id: &str) -> String {
        let dots = self.dots();
        let noise = self.noise();
        let floor = match self.truth {
            TruthKind::Scene => self.scene.floor.as_ref().and_then(|floor| Some(floor.region(self.region)?.flip)),
            TruthKind::Model => None,
        };
        let right = SIZE[0] - MARGIN[2];
        let bottom = SIZE[1] - MARGIN[3];
        // The price of a limit does not matter, so it is put at the right edge.
        let priced = dots.iter().filter(|dot| dot.point.group != "limit");
        let across = Axis::around(priced.flat_map(|d| [d.cost.low, d.cost.high]), [MARGIN[0], right]);
        let errors = dots.iter().flat_map(|d| [d.error.low, d.error.high]).chain(noise).chain(floor);
        let up = Axis::around(errors, [bottom, MARGIN[1]]);
        let mut out = format!("<g transform=\"translate({x:.1} {y:.1})\">");
        let _ = write!(out, "<text x=\"8\" y=\"15\" font-size=\"13\" font-weight=\"bold\">{}</text>", escape(title));
        frame(&mut out, &across, &up, right, bottom);
        if let Some(noise) = noise {
            let top = up.place(noise);
            let _ = write!(
                out,
                "<rect x=\"{}\" y=\"{top:.1}\" width=\"{:.1}\" height=\"{:.1}\" fill=\"#000\" fill-opacity=\"0.07\"><title>the truth's own noise: its halves differ by {noise:.3}</title></rect>",
                MARGIN[0],
                right - MARGIN[0],
                (bottom - top).max(0.0)
            );
        }
        if let Some(floor) = floor {
            let at = up.place(floor);
            let _ = write!(
                out,
                "<path d=\"M{} {at:.1}H{right}\" stroke=\"#b2182b\" stroke-dasharray=\"5 3\"><title>what the model itself costs: {floor:.3}</title></path>",
                MARGIN[0]
            );
        }
        let best = self.front(&dots);
        steps(
            &mut out,
            &best
                .iter()
                .map(|i| (across.place(dots[*i].cost.median), up.place(dots[*i].error.median)))
                .collect::<Vec<_>>(),
        );
        for dot in &dots {
            mark(&mut out, dot, &across, &up, id);
        }
        labels(&mut out, &dots, &best, &across, &up);
        out += "</g>";
        out
    }
}

/// Draws the axes, the grid and their labels.
fn frame(out: &mut String, across: &Axis, up: &Axis, right: f64, bottom: f64) {
    let [left, top] = [MARGIN[0], MARGIN[1]];
    for tick in across.ticks() {
        let x = across.place(tick);
        let _ = write!(
            out,
            "<path d=\"M{x:.1} {top}V{bottom}\" stroke=\"#ddd\"/><text x=\"{x:.1}\" y=\"{:.1}\" font-size=\"10\" text-anchor=\"middle\">{}</text>",
            bottom + 13.0,
            tick_label(tick)
        );
    }
    for tick in up.ticks() {
        let y = up.place(tick);
        let _ = write!(
            out,
            "<path d=\"M{left} {y:.1}H{right}\" stroke=\"#ddd\"/><text x=\"{:.1}\" y=\"{:.1}\" font-size=\"10\" text-anchor=\"end\">{}</text>",
            left - 4.0,
            y + 3.5,
            tick_label(tick)
        );
    }
    let _ = write!(out, "<path d=\"M{left} {top}V{bottom}H{right}\" fill=\"none\" stroke=\"#444\"/>");
    let _ = write!(
        out,
        "<text x=\"{:.1}\" y=\"{:.1}\" font-size=\"11\" text-anchor=\"middle\">GPU milliseconds (left is faster)</text>",
        0.5 * (left + right),
        bottom + 30.0
    );
    let middle = 0.5 * (top + bottom);
    let _ = write!(
        out,
        "<text transform=\"translate(12 {middle:.1}) rotate(-90)\" font-size=\"11\" text-anchor=\"middle\">FLIP error (down is better)</text>"
    );
}

/// Draws the front. The error stays at a point's value until the next point's cost is paid.
fn steps(out: &mut String, places: &[(f64, f64)]) {
    let Some(((x, y), rest)) = places.split_first() else { return };
    let mut path = format!("M{x:.1} {y:.1}");
    for (x, y) in rest {
        let _ = write!(path, "H{x:.1}V{y:.1}");
    }
    let _ = write!(
        out,
        "<path d=\"{path}\" fill=\"none\" stroke=\"#1b7837\" stroke-width=\"1.5\"><title>Pareto front: no other point is both faster and better</title></path>"
    );
}

fn mark(out: &mut String, dot: &Dot, across: &Axis, up: &Axis, id: &str) {
    let (x, y) = (across.place(dot.cost.median), up.place(dot.error.median));
    let color = group_color(&dot.point.group);
    let _ = write!(out, "<a href=\"#{id}{}\" class=\"dot\" data-point=\"{id}{}\">", dot.index, dot.index);
    let _ = write!(
        out,
        "<path d=\"M{:.1} {y:.1}H{:.1}M{x:.1} {:.1}V{:.1}\" stroke=\"{color}\" stroke-opacity=\"0.6\"/>",
        across.place(dot.cost.low),
        across.place(dot.cost.high),
        up.place(dot.error.low),
        up.place(dot.error.high)
    );
    let shape = match dot.point.group.as_str() {
        "method" => format!("<circle cx=\"{x:.1}\" cy=\"{y:.1}\" r=\"5.5\" fill=\"{color}\" stroke=\"#fff\">"),
        "reference" => format!("<path d=\"M{x:.1} {:.1}l5 5l-5 5l-5 -5z\" fill=\"{color}\" stroke=\"#fff\">", y - 5.0),
        "limit" => format!(
            "<circle cx=\"{x:.1}\" cy=\"{y:.1}\" r=\"4.5\" fill=\"#fff\" stroke=\"{color}\" stroke-width=\"2\">"
        ),
        _ => format!(
            "<circle cx=\"{x:.1}\" cy=\"{y:.1}\" r=\"4\" fill=\"{color}\" fill-opacity=\"0.8\" stroke=\"#fff\">"
        ),
    };
    let end = if shape.starts_with("<circle") { "</circle>" } else { "</path>" };
    let _ = write!(out, "{shape}<title>{}</title>{end}</a>", escape(&dot.tip()));
}

impl Dot<'_> {
    /// The text that is shown on hover: name, times, errors and settings.
    pub fn tip(&self) -> String {
        let p = self.point;
        let mut tip = format!(
            "{}\n{} ms ({} to {})\nFLIP {:.4} ({:.4} to {:.4})\nmethod {}, rendered at {}×{}",
            p.name,
            short(self.cost.median),
            short(self.cost.low),
            short(self.cost.high),
            self.error.median,
            self.error.low,
            self.error.high,
            p.method,
            p.rendered[0],
            p.rendered[1]
        );
        if !p.flicker.is_empty() {
            let _ = write!(tip, "\nflicker {}", p.flicker_text());
        }
        for (name, value) in &p.settings {
            let _ = write!(tip, "\n{}{name} = {value}", if p.set.contains_key(name) { "▸ " } else { "" });
        }
        tip
    }
}

/// Labels the methods, `reference` and the points on the front, as far as there is room.
fn labels(out: &mut String, dots: &[Dot], best: &[usize], across: &Axis, up: &Axis) {
    let center = |dot: &Dot| [across.place(dot.cost.median), up.place(dot.error.median)];
    // The left, top, right and bottom of each area that is taken.
    let mut taken: Vec<[f64; 4]> = dots.iter().map(center).map(|[x, y]| [x - 5.0, y - 5.0, x + 5.0, y + 5.0]).collect();
    let mut order: Vec<usize> = (0..dots.len()).filter(|i| dots[*i].point.group == "method").collect();
    order.extend(best.iter().filter(|i| dots[**i].point.group != "method"));
    order.extend(
        (0..dots.len())
            .filter(|i| ["reference", "limit"].contains(&dots[*i].point.group.as_str()) && !best.contains(i)),
    );
    for index in order {
        let dot = &dots[index];
        let ([x, y], width) = (center(dot), 5.4 * dot.point.name.chars().count() as f64);
        let places = [
            (7.0, -4.0),
            (7.0, 12.0),
            (-7.0 - width, -4.0),
            (-7.0 - width, 12.0),
            (-0.5 * width, -9.0),
            (-0.5 * width, 17.0),
        ];
        let free = |(dx, dy): &&(f64, f64)| {
            let area = [x + dx, y + dy - 8.0, x + dx + width, y + dy + 2.0];
            let inside = area[0] >= MARGIN[0]
                && area[2] <= SIZE[0]
                && area[1] >= MARGIN[1] - 6.0
                && area[3] <= SIZE[1] - MARGIN[3];
            let own = [x - 5.0, y - 5.0, x + 5.0, y + 5.0];
            inside
                && taken
                    .iter()
                    .filter(|t| **t != own)
                    .all(|t| area[0] > t[2] || area[2] < t[0] || area[1] > t[3] || area[3] < t[1])
        };
        // The name of a method is always shown, even if it overlaps something.
        let place = places.iter().find(free).or((dot.point.group == "method").then_some(&places[0]));
        if let Some((dx, dy)) = place {
            taken.push([x + dx, y + dy - 8.0, x + dx + width, y + dy + 2.0]);
            let weight = if dot.point.group == "method" { "bold" } else { "normal" };
            let _ = write!(
                out,
                "<text x=\"{:.1}\" y=\"{:.1}\" font-size=\"10\" font-weight=\"{weight}\" pointer-events=\"none\">{}</text>",
                x + dx,
                y + dy,
                escape(&dot.point.name)
            );
        }
    }
}
