//! The time of each pass of A, now and over the last frames.

use super::session::{FrameRecord, Session};
use crate::{gpu::Node, passes::PASSES};
use egui::{Color32, Rect, Ui};

/// Number of frames that the graph shows.
pub const FRAMES: usize = 120;

/// Shows a table with bars, and a graph with a column for each frame, stacked from its passes.
pub fn show(session: &Session, ui: &mut Ui) {
    let Some(picture) = &session.shown.pictures[0] else { return };
    let passes = picture.timings.tree();
    let most = passes.iter().map(|pass| pass.ms).fold(1e-9, f64::max);
    egui::Grid::new("passes").num_columns(3).spacing([8.0, 2.0]).show(ui, |ui| {
        for Node { name, ms, .. } in &passes {
            ui.monospace(name);
            ui.monospace(format!("{ms:8.2}"));
            let (rect, _) = ui.allocate_exact_size(egui::vec2(90.0, 10.0), egui::Sense::hover());
            let bar = Rect::from_min_size(rect.min, egui::vec2(rect.width() * (ms / most) as f32, rect.height()));
            ui.painter().rect_filled(bar, 1.0, color(name));
            ui.end_row();
        }
        for (name, ms) in [("passes", picture.timings.gpu_ms), ("frame", picture.frame_ms)] {
            ui.monospace(name);
            ui.monospace(format!("{ms:8.2}"));
            ui.weak("ms");
            ui.end_row();
        }
    });
    graph(&session.frame_times, ui);
    let by = if picture.by_clock {
        "Passes by the clock: a slow frame is submitted in pieces, between which the window is drawn"
    } else {
        "Passes by GPU timestamps"
    };
    ui.weak(by);
    ui.weak(format!("{} pictures, {} video frames passed over", session.shown.rendered, session.shown.dropped));
}

/// The colour that the pass of a name has in charts.
fn color(name: &str) -> Color32 {
    let pass = PASSES.iter().find(|pass| pass.name == name);
    pass.and_then(|pass| Color32::from_hex(pass.color).ok()).unwrap_or(Color32::WHITE)
}

fn graph(frames: &[FrameRecord], ui: &mut Ui) {
    let (rect, response) = ui.allocate_exact_size(egui::vec2(ui.available_width(), 64.0), egui::Sense::hover());
    let top = frames.iter().map(|frame| frame.wall_ms).fold(1.0, f64::max);
    let painter = ui.painter_at(rect);
    painter.rect_filled(rect, 2.0, Color32::from_gray(28));
    let (width, scale) = (rect.width() / FRAMES as f32, (rect.height() - 2.0) / top as f32);
    for (place, frame) in frames.iter().enumerate() {
        let x = egui::Rangef::new(place as f32 * width, (place + 1) as f32 * width);
        let mut bottom = rect.max.y;
        let mut part = |ms: f64, color| {
            let top = bottom - ms as f32 * scale;
            let corners = [egui::pos2(rect.min.x + x.min, top), egui::pos2(rect.min.x + x.max, bottom)];
            painter.rect_filled(Rect::from_min_max(corners[0], corners[1]), 0.0, color);
            bottom = top;
        };
        for pass in frame.timings.tree() {
            part(pass.ms, color(&pass.name));
        }
        part((frame.wall_ms - frame.timings.sum()).max(0.0), Color32::from_gray(60));
    }
    response.on_hover_text("each stacked from its passes in the colours above; grey: the rest of its time");
    ui.weak(format!("the last {} frames, up to {top:.0} ms", frames.len()));
}
