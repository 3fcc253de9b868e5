//! A chart as Markdown tables, put between two marks of a document.

use super::point::{Chart, ChartPoint, ChartScene, Cost, Outcome};
use crate::{
    Error, Result,
    image_file::{read::read_bytes, write::write_bytes},
    measure::score::{REGIONS, Score},
};
use std::{fmt::Write, path::Path};

impl Chart {
    /// A table for each scene. Errors are FLIP.
    pub fn markdown(&self) -> String {
        let of = &self.of;
        let mut out = format!(
            "Device: {}. Driver: {}. {}×{} pixels, {}, seed {}.\n",
            of.device, of.driver, of.size[0], of.size[1], of.projection, of.seed
        );
        for scene in &self.scenes {
            self.table(&mut out, scene);
        }
        out
    }

    fn table(&self, out: &mut String, scene: &ChartScene) {
        let known = scene.floor.is_some();
        let percent = |region: &str| 100.0 * scene.regions.get(region).copied().unwrap_or(0.0);
        let _ = write!(
            out,
            "\n### {}\n\nPanorama {}×{}, exposure {}. Virtual: {:.1} % of the pixels; influenced: {:.1} %. Model truth: {} paths a pixel",
            scene.name,
            scene.panorama[0],
            scene.panorama[1],
            scene.exposure,
            percent(REGIONS[1]),
            percent(REGIONS[2]),
            scene.model_spp
        );
        let _ = match known {
            true => writeln!(
                out,
                ". Scene truth: {} samples a pixel; {:.1} % of its light was in outliers and is left out.\n",
                scene.scene_spp,
                100.0 * scene.outliers[1]
            ),
            false => writeln!(out, ". The true scene is not known.\n"),
        };
        let columns = |name: &str| REGIONS.map(|region| format!(" {name}, {region} |")).concat();
        let scene_columns = if known { columns("scene") } else { String::new() };
        let _ = writeln!(out, "| method | frames | ms a frame |{}{scene_columns}", columns("model"));
        let _ = writeln!(out, "|---|---:|---:|{}", "---:|".repeat(if known { 6 } else { 3 }));
        let mut row = |name: &str, frames: &str, ms: &str, model: Option<&Score>, truth: Option<&Score>| {
            let model = cells(model);
            let truth = if known { cells(truth) } else { String::new() };
            let _ = writeln!(out, "| {name} | {frames} | {ms} |{model}{truth}");
        };
        row("nothing inserted", "", "", Some(&scene.nothing.model), scene.nothing.scene.as_ref());
        for point in self.of_scene(&scene.name) {
            for outcome in point.outcomes.iter().filter(|outcome| !outcome.moving || point.group == "method") {
                let name = format!("`{}`{}", point.name, if outcome.moving { ", moving" } else { "" });
                let scores = &outcome.scores;
                row(
                    &name,
                    &outcome.frames.to_string(),
                    &time(point, outcome),
                    Some(&scores.model),
                    scores.scene.as_ref(),
                );
            }
        }
        row("`reference`: the model", &scene.model_spp.to_string(), "", None, scene.floor.as_ref());
        row("*noise of the truth*", "", "", Some(&scene.noise.model), scene.noise.scene.as_ref());
    }
}

/// Milliseconds a frame, and the spread of the repetitions.
fn time(point: &ChartPoint, outcome: &Outcome) -> String {
    let frames = if point.cost == Cost::Picture { f64::from(outcome.frames) } else { 1.0 };
    let [low, median, high] = [point.ms.low, point.ms.median, point.ms.high].map(|ms| short(ms / frames));
    format!("{median} ({low}–{high})")
}

/// Three digits that count.
fn short(value: f64) -> String {
    match value {
        v if v >= 100.0 => format!("{v:.0}"),
        v if v >= 10.0 => format!("{v:.1}"),
        v => format!("{v:.2}"),
    }
}

fn cells(score: Option<&Score>) -> String {
    let cell = |region: &&str| match score.and_then(|score| score.region(region)) {
        Some(metrics) => format!(" {:.3} |", metrics.flip),
        None => " – |".to_owned(),
    };
    REGIONS.iter().map(cell).collect()
}

/// Puts text into a document, between `<!-- chart NAME: … -->` and `<!-- end of chart NAME -->`.
///
/// # Errors
/// As [`find`]; a document that cannot be written.
pub fn insert(document: &Path, name: &str, text: &str) -> Result<()> {
    let (old, [start, end]) = find(document, name)?;
    let new = format!("{}\n\n{}\n\n{}", &old[..start], text.trim(), &old[end..]);
    if new == old { Ok(()) } else { write_bytes(document, new.as_bytes()) }
}

/// A document, and where the text between its marks starts and ends.
///
/// # Errors
/// A document that cannot be read, or that has no such marks.
pub fn find(document: &Path, name: &str) -> Result<(String, [usize; 2])> {
    let subject = document.display();
    let text = String::from_utf8(read_bytes(document)?)
        .map_err(|_| Error::input(&subject, "is no UTF-8 text", "give a Markdown document"))?;
    let (start, end) = (format!("<!-- chart {name}:"), format!("<!-- end of chart {name} -->"));
    let place = || {
        let start = text.find(&start)?;
        let start = start + text[start..].find("-->")? + "-->".len();
        Some([start, start + text[start..].find(&end)?])
    };
    match place() {
        Some(place) => Ok((text, place)),
        None => {
            let problem = format!("has no \"{start} … -->\" followed by \"{end}\"");
            Err(Error::input(&subject, problem, "add both lines where the tables are to be"))
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn text_is_put_between_its_marks() {
        let folder = tempfile::tempdir().expect("a folder");
        let document = folder.path().join("a.md");
        std::fs::write(&document, "a\n<!-- chart b: by c -->\nold\n<!-- end of chart b -->\nd\n").expect("writes");
        insert(&document, "b", "new\n").expect("put");
        let text = std::fs::read_to_string(&document).expect("reads");
        assert_eq!(text, "a\n<!-- chart b: by c -->\n\nnew\n\n<!-- end of chart b -->\nd\n");
        let error = insert(&document, "x", "new").expect_err("no marks").to_string();
        assert!(error.contains("a.md") && error.contains("end of chart x"), "{error}");
    }
}
