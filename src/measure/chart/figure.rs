//! Draws the chart as one figure, `chart.svg` and `chart.png`. It has a row for each scene and a column for
//! each region.

use super::{
    draw::{escape, group_color},
    pictures::Codes,
    point::{Chart, ChartScene},
    scatter::{self, Panel},
};
use crate::{
    Error, Result,
    image_file::write::{write_bytes, write_png},
    measure::score::REGIONS,
    passes::PASSES,
};
use resvg::{tiny_skia, usvg};
use std::{collections::BTreeSet, fmt::Write, path::Path};

/// Number of the PNG's pixels for one of the SVG's.
const ZOOM: f32 = 1.5;
const FONT: &str = "DejaVu Sans, Helvetica, Arial, sans-serif";

impl Chart {
    /// Draws the still pictures after the main number of frames, against the best known truth.
    pub fn svg(&self) -> String {
        let width = scatter::SIZE[0] * REGIONS.len() as f64;
        let legend = self.legend(width);
        let top = 44.0;
        let height = top + scatter::SIZE[1] * self.scenes.len() as f64 + 24.0;
        let mut out = format!(
            "<svg xmlns=\"http://www.w3.org/2000/svg\" viewBox=\"0 0 {width} {height}\" width=\"{width}\" height=\"{height}\" \
             font-family=\"{FONT}\" fill=\"#222\"><rect width=\"100%\" height=\"100%\" fill=\"#fff\"/>"
        );
        let of = &self.of;
        let _ = write!(
            out,
            "<text x=\"52\" y=\"18\" font-size=\"14\" font-weight=\"bold\">Speed against accuracy after {} frames: {}×{} pixels</text>\
             <text x=\"52\" y=\"36\" font-size=\"11\">{}</text>",
            of.main_frames,
            of.size[0],
            of.size[1],
            escape(&format!("{} ({}), version {}", of.device, of.driver, of.version))
        );
        for (row, scene) in self.scenes.iter().enumerate() {
            for (column, region) in REGIONS.iter().enumerate() {
                let panel = Panel { chart: self, scene, truth: scene.best(), region, moving: false };
                let at = [scatter::SIZE[0] * column as f64, top + scatter::SIZE[1] * row as f64];
                out += &panel.svg(at, &panel_title(scene, &panel), "");
            }
        }
        let _ = write!(out, "<g transform=\"translate(52 {})\">{legend}</g></svg>", height - 10.0);
        out
    }

    /// One line that explains colours and shapes.
    pub fn legend(&self, width: f64) -> String {
        let changed = self.points.iter().filter(|p| !["method", "reference", "limit"].contains(&p.group.as_str()));
        let used: BTreeSet<_> = changed.map(|point| group_color(&point.group)).collect();
        let passes = PASSES.iter().map(|pass| (pass.color, pass.name));
        let colors = passes.chain([(group_color("scale"), "internal resolution")]);
        let colors: Vec<_> = colors.filter(|(color, _)| used.contains(color)).collect();
        let mut out =
            "<text font-size=\"10\">● method · ◆ reference · ○ method, converged (at the edge) · a setting of:</text>"
                .to_owned();
        let (mut x, step) = (400.0, ((width - 470.0) / colors.len().max(1) as f64).min(110.0));
        for (color, name) in colors {
            let _ = write!(
                out,
                "<circle cx=\"{x:.1}\" cy=\"-4\" r=\"4\" fill=\"{color}\"/><text x=\"{:.1}\" font-size=\"10\">{name}</text>",
                x + 7.0
            );
            x += step;
        }
        out
    }

    /// Writes `chart.svg` and `chart.png`.
    ///
    /// # Errors
    /// Fails if a file cannot be written.
    pub fn write_figure(&self, folder: &Path) -> Result<()> {
        let svg = self.svg();
        write_bytes(&folder.join("chart.svg"), svg.as_bytes())?;
        let (size, codes) = pixels(&svg, ZOOM)?;
        write_png(&folder.join("chart.png"), size, &codes, 3)
    }
}

/// The title of a panel.
pub fn panel_title(scene: &ChartScene, panel: &Panel) -> String {
    let moving = if panel.moving { ", moving" } else { "" };
    let pixels = if panel.region == REGIONS[0] { "picture" } else { "pixels" };
    format!("{}: {} {pixels}{moving}, {}", scene.name, panel.region, panel.truth.name())
}

/// Says which font is meant by sans-serif. It is Arial unless that is said, and without Arial no text would be drawn.
fn name_sans_serif(fonts: &mut usvg::fontdb::Database) {
    const PREFERRED: [&str; 5] = ["DejaVu Sans", "Liberation Sans", "Noto Sans", "Cantarell", "Helvetica"];
    let query = |families: &[usvg::fontdb::Family<'_>], fonts: &usvg::fontdb::Database| {
        fonts.query(&usvg::fontdb::Query { families, ..Default::default() }).is_some()
    };
    if query(&[usvg::fontdb::Family::SansSerif], fonts) {
        return;
    }
    let any = || fonts.faces().find_map(|face| face.families.first().map(|(name, _)| name.clone()));
    let preferred = PREFERRED.into_iter().find(|name| query(&[usvg::fontdb::Family::Name(name)], fonts));
    if let Some(name) = preferred.map(str::to_owned).or_else(any) {
        fonts.set_sans_serif_family(name);
    }
}

/// Draws an SVG as 8-bit RGB, with `zoom` pixels for each of the SVG's own. Its text is drawn with fonts of
/// the system.
///
/// # Errors
/// Fails if the text is not a valid SVG.
pub fn pixels(svg: &str, zoom: f32) -> Result<Codes> {
    let internal = |error: &dyn std::fmt::Display| Error::Internal(format!("drawing the chart: {error}"));
    let mut options = usvg::Options::default();
    options.fontdb_mut().load_system_fonts();
    name_sans_serif(options.fontdb_mut());
    if options.fontdb.is_empty() {
        tracing::warn!("there is no font on this system: the PNG of the chart has no text; the SVG has");
    }
    let tree = usvg::Tree::from_str(svg, &options).map_err(|error| internal(&error))?;
    let size = tree.size().to_int_size().scale_by(zoom).ok_or_else(|| internal(&"it has no size"))?;
    let mut pixmap = tiny_skia::Pixmap::new(size.width(), size.height()).ok_or_else(|| internal(&"it is too large"))?;
    resvg::render(&tree, tiny_skia::Transform::from_scale(zoom, zoom), &mut pixmap.as_mut());
    // The figure has a white background, so no pixel is transparent.
    let codes = pixmap.data().chunks_exact(4).flat_map(|pixel| [pixel[0], pixel[1], pixel[2]]).collect();
    Ok(([size.width(), size.height()], codes))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn text_is_drawn_with_whatever_font_there_is() {
        let mut fonts = usvg::fontdb::Database::new();
        fonts.load_system_fonts();
        let svg = "<svg xmlns=\"http://www.w3.org/2000/svg\" width=\"80\" height=\"20\" font-family=\"sans-serif\">\
                   <rect width=\"100%\" height=\"100%\" fill=\"#fff\"/><text x=\"2\" y=\"15\">depth</text></svg>";
        let (size, codes) = pixels(svg, 1.0).expect("draws");
        assert_eq!(size, [80, 20]);
        let dark = codes.iter().filter(|code| **code < 100).count();
        assert!(fonts.is_empty() || dark > 20, "{dark} dark pixels with {} fonts", fonts.len());
    }
}
