//! Writes a chart as Markdown tables between two marks of a document.

use super::{
    choices,
    draw::{flip_text, short},
    figure,
    pictures::{Codes, file_name, strip},
    point::{Chart, ChartPoint, ChartScene, CostUnit, ScoredPicture},
    sentences::NOTE,
};
use crate::{
    Error, Result,
    image_file::{
        read::read_bytes,
        write::{make_folder, write_bytes, write_png},
    },
    measure::{
        clock::Spread,
        score::{REGIONS, Score, TruthKind},
    },
};
use std::{fmt::Write, path::Path};

/// The folder beside the document that holds its pictures.
const IMAGES: &str = "images";

impl Chart {
    /// Puts the tables into a document, between its marks for `name` (see [`find`]). Pictures go to `images/`
    /// beside the document: a strip of the methods, and the whole chart if settings were changed.
    ///
    /// # Errors
    /// Fails like [`find`], or if a file cannot be read or written.
    pub fn write_markdown(&self, folder: &Path, document: &Path, name: &str) -> Result<()> {
        find(document, name)?;
        let images = document.parent().unwrap_or(Path::new("")).join(IMAGES);
        make_folder(&images)?;
        let mut text = self.markdown(|scene| {
            let Some((title, (size, codes))) = self.methods_strip(folder, scene)? else { return Ok(String::new()) };
            let file = format!("{name}-{}.png", file_name(&scene.name));
            write_png(&images.join(&file), size, &codes, 3)?;
            Ok(format!("\n![The methods in {}]({IMAGES}/{file})\n\n*{title}*\n", scene.name))
        })?;
        if self.points.iter().any(|point| !point.base.is_empty()) {
            let file = format!("{name}.png");
            let (size, codes) = figure::pixels(&self.svg(), 1.0)?;
            write_png(&images.join(&file), size, &codes, 3)?;
            let _ = write!(text, "\n![Speed against accuracy]({IMAGES}/{file})\n");
            for scene in &self.scenes {
                let _ = write!(text, "\n#### What each setting buys and costs: {}\n\n{NOTE}\n\n", scene.name);
                for finding in self.findings(scene) {
                    let _ = writeln!(text, "* `{}`: {}", finding.setting, finding.sentences.join(" "));
                }
            }
        }
        insert(document, name, &text)
    }

    /// Puts the truth and the methods' pictures after the main number of frames in a row, and below each its
    /// difference from the truth.
    fn methods_strip(&self, folder: &Path, scene: &ChartScene) -> Result<Option<(String, Codes)>> {
        let truth = match scene.best() {
            TruthKind::Scene => ["scene", "floor"],
            TruthKind::Model => ["model", "regions"],
        };
        let [Some(top), Some(below)] = truth.map(|what| scene.pictures.get(what)) else { return Ok(None) };
        let (mut pictures, mut differences, mut names) = (vec![top.as_str()], vec![below.as_str()], Vec::new());
        for point in self.of_scene(&scene.name).filter(|point| point.group == "method") {
            let Some(outcome) = point.still(self.of.main_frames) else { continue };
            pictures.push(&outcome.picture);
            differences.push(&outcome.difference);
            names.push(format!("`{}`", point.name));
        }
        let first = match scene.best() {
            TruthKind::Scene => "what `reference --model panorama` differs in",
            TruthKind::Model => "the regions: virtual white, influenced grey",
        };
        let title = format!(
            "{}: {}, then {} after {} frames; below, {first}, and each one's FLIP against {} (white: 0.5 or more)",
            scene.name,
            scene.best().name(),
            names.join(", "),
            self.of.main_frames,
            scene.best().name()
        );
        Ok(Some((title, strip(folder, &[pictures, differences])?)))
    }

    /// Writes a table for each scene, followed by what `below` returns. Errors are FLIP.
    ///
    /// # Errors
    /// Fails if `below` fails.
    pub fn markdown(&self, mut below: impl FnMut(&ChartScene) -> Result<String>) -> Result<String> {
        let of = &self.of;
        let mut out = format!(
            "Device: {}. Driver: {}. {}×{} pixels, {}, seed {}.\n",
            of.device, of.driver, of.size[0], of.size[1], of.projection, of.seed
        );
        for scene in &self.scenes {
            self.table(&mut out, scene);
            out += &below(scene)?;
            self.choices_markdown(&mut out, scene);
        }
        Ok(out)
    }

    fn choices_markdown(&self, out: &mut String, scene: &ChartScene) {
        if self.choices_of(&scene.name).next().is_none() {
            return;
        }
        let head = choices::head(self, scene);
        let _ = write!(out, "\n{}\n\n| {} |\n|---|---|", choices::INTRODUCTION, head.join(" | "));
        let _ = writeln!(out, "{}", "---:|".repeat(head.len() - 2));
        for choice in self.choices_of(&scene.name) {
            let _ = writeln!(out, "| {} |", choice.cells().join(" | "));
        }
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
        let _ = writeln!(out, ". {}\n", scene.about_scene_truth());
        let columns = |name: &str| REGIONS.map(|region| format!(" {name}, {region} |")).concat();
        let scene_columns = if known { columns("scene") } else { String::new() };
        let _ = writeln!(out, "| method | frames | ms a frame |{}{scene_columns}", columns("model"));
        let _ = writeln!(out, "|---|---:|---:|{}", "---:|".repeat(if known { 6 } else { 3 }));
        let truths = if known { &[TruthKind::Model, TruthKind::Scene][..] } else { &[TruthKind::Model] };
        let mut row = |name: &str, frames: &str, ms: &str, flip: &dyn Fn(TruthKind, &str) -> Option<Spread>| {
            let cells =
                truths.iter().flat_map(|truth| REGIONS.map(|region| format!(" {} |", flip_text(flip(*truth, region)))));
            let _ = writeln!(out, "| {name} | {frames} | {ms} |{}", cells.collect::<String>());
        };
        let once = |score: Option<&Score>, region: &str| Some(Spread::once(score?.region(region)?.flip));
        row("nothing inserted", "", "", &|truth, region| once(truth.of(&scene.nothing), region));
        for point in self.of_scene(&scene.name) {
            // Only the main picture of a changed setting is listed.
            let told = |outcome: &&ScoredPicture| {
                point.base.is_empty() || (!outcome.moving && outcome.frames == self.of.main_frames)
            };
            for outcome in point.outcomes.iter().filter(told) {
                let name = format!("`{}`{}", point.name, if outcome.moving { ", moving" } else { "" });
                let flip = |truth, region: &str| point.flip(outcome, truth, region);
                row(&name, &outcome.frames.to_string(), &time(point, outcome), &flip);
            }
        }
        let floor = |truth, region: &str| once(scene.floor.as_ref().filter(|_| truth == TruthKind::Scene), region);
        row("`reference`: the model", &scene.model_spp.to_string(), "", &floor);
        row("*noise of the truth*", "", "", &|truth, region| once(truth.of(&scene.noise), region));
    }
}

/// Milliseconds a frame, and the spread over the repetitions.
fn time(point: &ChartPoint, outcome: &ScoredPicture) -> String {
    let frames = if point.cost == CostUnit::Picture { f64::from(outcome.frames) } else { 1.0 };
    let [low, median, high] = [point.ms.low, point.ms.median, point.ms.high].map(|ms| short(ms / frames));
    format!("{median} ({low}–{high})")
}

/// Puts text into a document, between `<!-- chart NAME: … -->` and `<!-- end of chart NAME -->`.
///
/// # Errors
/// Fails like [`find`], or if the document cannot be written.
pub fn insert(document: &Path, name: &str, text: &str) -> Result<()> {
    let (old, [start, end]) = find(document, name)?;
    let new = format!("{}\n\n{}\n\n{}", &old[..start], wrapped(text.trim()), &old[end..]);
    if new == old { Ok(()) } else { write_bytes(document, new.as_bytes()) }
}

/// Breaks long lines of prose. Tables and images stay on one line each.
fn wrapped(text: &str) -> String {
    const COLUMNS: usize = 110;
    let wrap = |line: &str| {
        if line.starts_with('|') || line.starts_with("![") {
            return line.to_owned();
        }
        let (mut out, mut column) = (String::new(), 0);
        for word in line.split(' ') {
            let length = word.chars().count();
            if column > 0 && column + 1 + length > COLUMNS {
                out += if line.starts_with("* ") { "\n  " } else { "\n" };
                column = if line.starts_with("* ") { 2 } else { 0 };
            } else if !out.is_empty() {
                out.push(' ');
                column += 1;
            }
            out += word;
            column += length;
        }
        out
    };
    text.lines().map(wrap).collect::<Vec<_>>().join("\n")
}

/// Reads a document, and finds where the text between its marks starts and ends.
///
/// # Errors
/// Fails if the document cannot be read, or if it has no such marks.
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

    #[test]
    fn prose_is_wrapped_and_tables_are_not() {
        let long = ["word"; 40].join(" ");
        let (table, image) = (format!("| {long} |"), format!("![{long}](a.png)"));
        let text = wrapped(&format!("{long}\n{table}\n{image}\n* {long}\nshort"));
        assert!(text.contains(&table) && text.contains(&image) && text.ends_with("\nshort"), "{text}");
        assert!(text.lines().filter(|line| !line.starts_with(['|', '!'])).all(|line| line.len() <= 110), "{text}");
        assert!(text.contains("\n  word"), "lists are indented: {text}");
        assert_eq!(text.matches("word").count(), 160, "nothing is lost");
    }
}
