//! Writes the chart as one page that needs no other file.

use super::{
    choices,
    draw::{escape, flip_text, group_color, pass_color, short},
    figure::panel_title,
    pictures::file_name,
    point::{Chart, ChartPoint, ChartScene, CostUnit},
    scatter::{self, Panel},
    sentences::NOTE,
};
use crate::{
    Result,
    image_file::{read::read_bytes, write::write_bytes},
    measure::score::{REGIONS, Scores, TruthKind},
    passes::PASSES,
};
use base64::Engine as _;
use std::{fmt::Write, path::Path};

const STYLE: &str = include_str!("page.css");
const SCRIPT: &str = include_str!("page.js");
const INTRODUCTION: &str = include_str!("page.html");

impl Chart {
    /// Writes `chart.html`, with the pictures from the chart's folder in it.
    ///
    /// # Errors
    /// Fails if a picture cannot be read, or if the page cannot be written.
    pub fn write_page(&self, folder: &Path) -> Result<()> {
        write_bytes(&folder.join("chart.html"), self.page(folder)?.as_bytes())
    }

    fn page(&self, folder: &Path) -> Result<String> {
        let of = &self.of;
        let mut out = format!(
            "<!doctype html><html lang=\"en\"><head><meta charset=\"utf-8\"><title>Speed against accuracy</title>\
             <style>{STYLE}</style></head><body><h1>Speed against accuracy</h1>{}",
            INTRODUCTION.replace("{frames}", &of.main_frames.to_string())
        );
        let conditions = [
            ("device", of.device.clone()),
            ("driver", of.driver.clone()),
            ("pictures", format!("{}×{} pixels, {}", of.size[0], of.size[1], of.projection)),
            ("version", of.version.clone()),
            ("seed", of.seed.to_string()),
            ("points", self.points.len().to_string()),
        ];
        out += "<table class=\"conditions\">";
        for (name, value) in conditions {
            let _ = write!(out, "<tr><th>{name}</th><td>{}</td></tr>", escape(&value));
        }
        out += "</table><p class=\"legend\"><b>Colours of passes, and of the settings that belong to them:</b> ";
        for pass in PASSES {
            let _ = write!(out, "<span><i style=\"background:{}\"></i>{}</span> ", pass.color, pass.name);
        }
        let _ =
            write!(out, "<span><i style=\"background:{}\"></i>internal resolution</span></p>", group_color("scale"));
        for scene in &self.scenes {
            self.scene(&mut out, scene, folder)?;
        }
        let _ = writeln!(out, "<div id=\"tip\"></div><script>{SCRIPT}</script></body></html>");
        Ok(out)
    }

    fn scene(&self, out: &mut String, scene: &ChartScene, folder: &Path) -> Result<()> {
        let id = file_name(&scene.name);
        let _ = write!(out, "<h2 id=\"{id}\">{}</h2>{}", escape(&scene.name), about(scene));
        out.push_str("<div class=\"pictures\">");
        for (name, what) in [
            ("scene", "scene truth, as real pixels are scored: the panorama's view, relit"),
            ("model", "model truth"),
            ("regions", "regions: virtual white, influenced grey"),
            ("floor", "model truth against scene truth: what the model costs"),
        ] {
            if let Some(file) = scene.pictures.get(name) {
                let _ = write!(out, "<figure>{}<figcaption>{what}</figcaption></figure>", image(folder, file)?);
            }
        }
        out.push_str("</div><h3>Charts</h3>");
        for (truth, moving) in [(TruthKind::Scene, false), (TruthKind::Model, false), (scene.best(), true)] {
            self.panels(out, scene, truth, moving, &id);
        }
        out.push_str("<h3>What each setting buys and what it costs</h3>");
        let findings = self.findings(scene);
        if findings.is_empty() {
            out.push_str("<p>No setting was changed.</p>");
        } else {
            let _ = write!(out, "<p>{NOTE}</p>");
        }
        out.push_str("<ul class=\"findings\">");
        for finding in findings {
            let color = group_color(&finding.setting);
            let _ = write!(
                out,
                "<li><b style=\"color:{color}\">{}</b>: {}</li>",
                escape(&finding.setting),
                escape(&finding.sentences.join(" "))
            );
        }
        out.push_str("</ul>");
        self.choices_page(out, scene);
        out.push_str("<h3>Points</h3>");
        self.points_table(out, scene, folder, &id)
    }

    fn panels(&self, out: &mut String, scene: &ChartScene, truth: TruthKind, moving: bool, id: &str) {
        let panels = REGIONS.map(|region| Panel { chart: self, scene, truth, region, moving });
        if panels.iter().all(|panel| panel.dots().is_empty()) {
            return;
        }
        let [width, height] = scatter::SIZE;
        let _ = write!(out, "<div class=\"panels\">");
        for panel in panels.iter().filter(|panel| !panel.dots().is_empty()) {
            let drawing = panel.svg([0.0, 0.0], &panel_title(scene, panel), &format!("{id}-"));
            let _ = write!(
                out,
                "<svg viewBox=\"0 0 {width} {height}\" width=\"{width}\" height=\"{height}\">{drawing}</svg>"
            );
        }
        out.push_str("</div>");
    }

    fn choices_page(&self, out: &mut String, scene: &ChartScene) {
        if self.choices_of(&scene.name).next().is_none() {
            return;
        }
        out.push_str("<h3>Choosing for a target</h3>");
        let _ = write!(out, "<p>{}</p><table class=\"choices\"><tr>", choices::INTRODUCTION.replace('`', ""));
        for cell in choices::head(self, scene) {
            let _ = write!(out, "<th>{}</th>", escape(&cell));
        }
        out.push_str("</tr>");
        for choice in self.choices_of(&scene.name) {
            let cells = choice.cells().map(|cell| format!("<td>{}</td>", escape(&cell))).concat();
            let _ = write!(out, "<tr>{cells}</tr>");
        }
        out.push_str("</table>");
    }

    fn points_table(&self, out: &mut String, scene: &ChartScene, folder: &Path, id: &str) -> Result<()> {
        let truths: Vec<TruthKind> =
            TruthKind::ALL.into_iter().filter(|truth| truth.of(&scene.nothing).is_some()).collect();
        let most =
            self.of_scene(&scene.name).filter(|p| p.cost == CostUnit::Frame).map(|p| p.ms.median).fold(1e-9, f64::max);
        out.push_str("<table class=\"points\"><tr><th>point</th><th>time</th><th>after</th>");
        for truth in &truths {
            for region in REGIONS {
                let _ = write!(out, "<th>{}:<br>{region}</th>", truth.name());
            }
        }
        out.push_str("<th>picture</th><th>difference</th></tr>");
        for (index, point) in self.of_scene(&scene.name).enumerate() {
            let rows = point.outcomes.len().max(1);
            let _ = write!(
                out,
                "<tr id=\"{id}-{index}\"><td rowspan=\"{rows}\"><b style=\"color:{}\">{}</b>{}</td><td rowspan=\"{rows}\">{}{}</td>",
                group_color(&point.group),
                escape(&point.name),
                differs(point),
                times(point),
                bar(point, most)
            );
            for (row, outcome) in point.outcomes.iter().enumerate() {
                if row > 0 {
                    out.push_str("<tr>");
                }
                let frames =
                    if outcome.frames == 1 { "1 frame".to_owned() } else { format!("{} frames", outcome.frames) };
                let _ = write!(out, "<td>{frames}{}</td>", if outcome.moving { ", moving" } else { "" });
                for truth in &truths {
                    for region in REGIONS {
                        let _ = write!(out, "<td>{}</td>", flip_text(point.flip(outcome, *truth, region)));
                    }
                }
                let shown = point.still(self.of.main_frames).is_some_and(|main| main == outcome) || outcome.moving;
                for file in [&outcome.picture, &outcome.difference] {
                    let cell = if shown { image(folder, file)? } else { String::new() };
                    let _ = write!(out, "<td class=\"picture\">{cell}</td>");
                }
                out.push_str("</tr>");
            }
        }
        out.push_str("</table>");
        Ok(())
    }
}

/// Describes a scene and its truths.
fn about(scene: &ChartScene) -> String {
    let flips = |truth: TruthKind, scores: &Scores| -> String {
        let of = |region: &&str| Some(format!("{region} {:.3}", truth.of(scores)?.region(region)?.flip));
        REGIONS.iter().filter_map(of).collect::<Vec<_>>().join(", ")
    };
    let share = |region: &str| 100.0 * scene.regions.get(region).copied().unwrap_or(0.0);
    let mut out = format!(
        "<p>Exposure {}, panorama {}×{}. {:.1} % of the pixels are virtual, {:.1} % influenced. Model truth: {} paths a pixel; its two \
         halves differ by FLIP {}.",
        scene.exposure,
        scene.panorama[0],
        scene.panorama[1],
        share(REGIONS[1]),
        share(REGIONS[2]),
        scene.model_spp,
        flips(TruthKind::Model, &scene.noise)
    );
    let _ = write!(out, " {}", scene.about_scene_truth());
    if scene.floor.is_some() {
        let _ = write!(out, " Its two halves differ by FLIP {}.", flips(TruthKind::Scene, &scene.noise));
    }
    let _ = write!(
        out,
        " With nothing inserted the error is {} ({}).</p>",
        flips(scene.best(), &scene.nothing),
        scene.best().name()
    );
    out
}

fn differs(point: &ChartPoint) -> String {
    let of: Vec<String> = point.set.iter().map(|(name, value)| format!("{name} = {value}")).collect();
    let size = format!("{}×{}", point.rendered[0], point.rendered[1]);
    let set = if of.is_empty() { "all settings as they are".to_owned() } else { of.join(", ") };
    format!("<br><small>{}, {size}: {}</small>", escape(&point.method), escape(&set))
}

fn times(point: &ChartPoint) -> String {
    let unit = match point.cost {
        CostUnit::Frame => "ms a frame",
        CostUnit::Picture => "ms the picture",
    };
    let [median, low, high] = [point.ms.median, point.ms.low, point.ms.high].map(short);
    let flicker =
        if point.flicker.is_empty() { String::new() } else { format!("<br>flicker: {}", point.flicker_text()) };
    format!(
        "<b>{median}</b> {unit}<br><small>{low} to {high}; {:.0} MiB{flicker}</small>",
        point.memory as f64 / f64::from(1 << 20)
    )
}

/// A bar of the stacked passes. Its length is the time of a frame. The bar of a point that costs a whole
/// picture fills the width.
fn bar(point: &ChartPoint, most: f64) -> String {
    const WIDTH: f64 = 220.0;
    let passes = point.passes();
    let total: f64 = passes.iter().map(|(_, ms)| ms.median).sum();
    let scale = WIDTH / if point.cost == CostUnit::Frame { most } else { total.max(1e-9) };
    let mut out = format!("<svg width=\"{WIDTH}\" height=\"14\" class=\"bar\">");
    let mut x = 0.0;
    for (pass, ms) in passes {
        let width = ms.median * scale;
        let _ = write!(
            out,
            "<rect x=\"{x:.2}\" width=\"{width:.2}\" height=\"14\" fill=\"{}\"><title>{pass}: {} ms ({} to {})</title></rect>",
            pass_color(pass),
            short(ms.median),
            short(ms.low),
            short(ms.high)
        );
        x += width;
    }
    out + "</svg>"
}

fn image(folder: &Path, file: &str) -> Result<String> {
    let data = base64::engine::general_purpose::STANDARD.encode(read_bytes(&folder.join(file))?);
    Ok(format!("<img alt=\"{}\" src=\"data:image/png;base64,{data}\">", escape(file)))
}
