//! A sheet of pictures by which a scene is judged at a glance: colour, depth, normals, and floor and objects
//! from above.

use super::Report;
use crate::{
    Result,
    image_file::write::{display_code, write_png},
    measure::chart::{draw::escape, figure::pixels},
    panorama::{cloud::Cloud, source::PanoramaFrame},
    scene::Scene,
};
use glam::Vec3;
use std::{fmt::Write as _, path::Path};

/// Width and height of a panel, pixels.
const PANEL: [usize; 2] = [512, 256];
/// Room for a panel's title.
const TITLE: usize = 24;
const GAP: usize = 8;

/// Writes the sheet as PNG.
///
/// # Errors
/// Fails if the file cannot be written.
pub fn write(path: &Path, report: &Report, scene: &Scene, frame: &PanoramaFrame, cloud: &Cloud) -> Result<()> {
    let text: Vec<String> =
        report.text().lines().map(str::to_owned).chain(report.warnings.iter().map(|w| format!("! {w}"))).collect();
    let width = 2 * PANEL[0] + 3 * GAP;
    let top = 2 * (PANEL[1] + TITLE) + 3 * GAP;
    let height = top + 16 * text.len() + 2 * GAP;
    let mut svg = format!(
        "<svg xmlns=\"http://www.w3.org/2000/svg\" width=\"{width}\" height=\"{height}\" font-family=\"sans-serif\" \
         font-size=\"13\"><rect width=\"100%\" height=\"100%\" fill=\"#fff\"/>"
    );
    let places = [[0, 0], [1, 0], [0, 1], [1, 1]]
        .map(|[x, y]| [GAP + x * (PANEL[0] + GAP), GAP + TITLE + y * (PANEL[1] + TITLE + GAP)]);
    let (view, range) = (above(cloud), depth_range(report));
    let titles = [
        format!("colour: {}", report.scene),
        format!("depth: {:.2} m (white) to {:.2} m (black); holes are red", range[0], range[1]),
        "normals: x red, y green, z blue".to_owned(),
        format!("from above, {:.1} m across: floor grey, walls black, objects red, camera blue", view.across),
    ];
    for ([x, y], title) in places.iter().zip(&titles) {
        let _ = write!(svg, "<text x=\"{x}\" y=\"{}\">{}</text>", y - 7, escape(title));
    }
    for (line, text) in text.iter().enumerate() {
        let color = if text.starts_with('!') { "#b00000" } else { "#222" };
        let shown: String = text.chars().take(150).collect();
        let _ = write!(
            svg,
            "<text x=\"{GAP}\" y=\"{}\" fill=\"{color}\">{}</text>",
            top + GAP + 16 * line + 12,
            escape(&shown)
        );
    }
    svg.push_str("</svg>");
    let (size, mut codes) = pixels(&svg, 1.0)?;
    let panels: [Vec<[u8; 3]>; 4] =
        [color_panel(frame), depth_panel(cloud, range), normal_panel(cloud), above_panel(cloud, scene, &view)];
    for ([x, y], panel) in places.into_iter().zip(panels) {
        for (row, line) in panel.chunks_exact(PANEL[0]).enumerate() {
            let at = ((y + row) * size[0] as usize + x) * 3;
            codes[at..at + PANEL[0] * 3].copy_from_slice(line.as_flattened());
        }
    }
    write_png(path, size, &codes, 3)
}

/// Calls `color` for each pixel with its place in an image of this size.
fn panel(size: [usize; 2], color: impl Fn(usize, usize) -> [u8; 3]) -> Vec<[u8; 3]> {
    let place = |at: usize, axis: usize| at * size[axis] / PANEL[axis];
    (0..PANEL[1])
        .flat_map(|y| (0..PANEL[0]).map(move |x| (x, y)))
        .map(|(x, y)| color(place(x, 0), place(y, 1)))
        .collect()
}

fn color_panel(frame: &PanoramaFrame) -> Vec<[u8; 3]> {
    let size = frame.color_size.map(|side| side as usize);
    panel(size, |x, y| {
        let [r, g, b, _] = frame.radiance.at(y * size[0] + x);
        [r, g, b].map(display_code)
    })
}

fn depth_range(report: &Report) -> [f32; 2] {
    report.depth.metres.map_or([1.0, 2.0], |[near, _, far]| [near, far.max(1.01 * near)])
}

fn depth_panel(cloud: &Cloud, [near, far]: [f32; 2]) -> Vec<[u8; 3]> {
    panel(cloud.size, |x, y| match cloud.depth[y * cloud.size[0] + x] {
        depth if depth > 0.0 => {
            // Equal steps of 1/metres, as near things matter most.
            let share = (1.0 / depth - 1.0 / far) / (1.0 / near - 1.0 / far);
            [(share.clamp(0.0, 1.0) * 255.0) as u8; 3]
        }
        _ => [190, 30, 30],
    })
}

fn normal_panel(cloud: &Cloud) -> Vec<[u8; 3]> {
    panel(cloud.size, |x, y| {
        let normal = cloud.normals[y * cloud.size[0] + x];
        if normal == Vec3::ZERO { [0; 3] } else { normal.to_array().map(|v| (127.5 + 127.5 * v) as u8) }
    })
}

/// What the view from above shows.
struct Above {
    /// Metres across the panel.
    across: f32,
}

fn above(cloud: &Cloud) -> Above {
    let far = cloud.percentile(0.95).unwrap_or(2.0);
    Above { across: 4.2 * far }
}

fn above_panel(cloud: &Cloud, scene: &Scene, view: &Above) -> Vec<[u8; 3]> {
    let mut out = vec![[255_u8; 3]; PANEL[0] * PANEL[1]];
    let scale = PANEL[0] as f32 / view.across;
    let pixel = |x: f32, z: f32| {
        let (column, row) = (PANEL[0] as f32 / 2.0 + x * scale, PANEL[1] as f32 / 2.0 + z * scale);
        let inside = column >= 0.0 && row >= 0.0 && column < PANEL[0] as f32 && row < PANEL[1] as f32;
        inside.then(|| row as usize * PANEL[0] + column as usize)
    };
    for index in 0..cloud.depth.len() {
        let Some(point) = cloud.point(index) else { continue };
        let up = cloud.normals[index].y;
        if up < -0.8 {
            continue; // The ceiling would hide the rest.
        }
        if let Some(at) = pixel(point.x, point.z) {
            out[at] = if up > 0.8 && out[at] != [0; 3] { [185; 3] } else { [0; 3] };
        }
    }
    let position = scene.panorama.position;
    for index in 0..scene.object_count() {
        let bounds = scene.object_bounds(index, 0.0);
        if bounds.is_empty() {
            continue;
        }
        let (low, high) = (bounds.min - position, bounds.max - position);
        let steps = 400;
        for step in 0..=steps {
            let t = step as f32 / steps as f32;
            let (x, z) = (low.x + t * (high.x - low.x), low.z + t * (high.z - low.z));
            for (x, z) in [(x, low.z), (x, high.z), (low.x, z), (high.x, z)] {
                if let Some(at) = pixel(x, z) {
                    out[at] = [215, 30, 30];
                }
            }
        }
    }
    for (x, z) in (-3..=3).flat_map(|x| (-3..=3).map(move |z| (x as f32, z as f32))) {
        if let Some(at) = pixel(x / scale, z / scale) {
            out[at] = [20, 60, 220];
        }
    }
    out
}
