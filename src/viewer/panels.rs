//! The panels, which show what can be chosen and what is being shown.

use super::{
    behind::PATIENCE,
    controls, gizmo, legend,
    loupe::Loupe,
    objects_panel,
    session::{Drag, Session, WindowRequest},
    settings_panel,
    state::{Compare, RenderedPicture, Side},
    timings_panel,
};
use crate::{gpu::PresentMode, image_file::tonemap::Tonemap, passes::display::Meaning, settings::Method};
use egui::{Align2, Color32, RichText, Ui};
use glam::Vec3;
use std::{path::PathBuf, time::Duration};

/// Width of the panels, points.
const WIDTH: f32 = 330.0;
/// Loading is explained if it takes longer.
const LONG: Duration = Duration::from_secs(5);
/// A window of this width or less shows no panels.
const NARROW: f32 = 480.0;

/// Lays out everything in the window.
pub fn window(session: &mut Session, ui: &mut Ui) {
    session.pixels_per_point = ui.ctx().pixels_per_point();
    controls::keys(session, &ui.ctx().clone());
    if session.panels && ui.available_width() > NARROW {
        egui::Panel::left("panels").resizable(true).default_size(WIDTH).size_range(220.0..=520.0).show(ui, |ui| {
            egui::ScrollArea::vertical().auto_shrink(false).show(ui, |ui| panels(session, ui));
        });
    }
    egui::CentralPanel::no_frame().show(ui, |ui| {
        let (rect, response) = ui.allocate_exact_size(ui.available_size(), egui::Sense::click_and_drag());
        session.picture = rect;
        if session.editor.is_some() {
            controls::pointer(session, &response, ui);
        }
        over_picture(session, ui, rect);
    });
    if session.help {
        help(session, ui.ctx());
    }
    if session.closing {
        closing(session, ui.ctx());
    }
}

fn panels(session: &mut Session, ui: &mut Ui) {
    play(session, ui);
    section(ui, "Compare", true, |ui| compare(session, ui));
    for (index, name) in ["Settings of A", "Settings of B"].into_iter().enumerate() {
        if index == 0 || session.compare != Compare::Single {
            let side = &mut session.sides[index];
            section(ui, name, false, |ui| settings_panel::show(side, ui));
        }
    }
    section(ui, "Image", true, |ui| image(session, ui));
    section(ui, "Objects", true, |ui| objects_panel::show(session, ui));
    section(ui, "Time of passes", true, |ui| timings_panel::show(session, ui));
    section(ui, "Plan of A", false, |ui| plan(session, ui));
    section(ui, "Window", false, |ui| window_options(session, ui));
    ui.add_space(6.0);
    ui.weak("F1: keys");
}

fn section(ui: &mut Ui, name: &str, open: bool, content: impl FnOnce(&mut Ui)) {
    egui::CollapsingHeader::new(RichText::new(name).strong()).default_open(open).show(ui, content);
}

fn play(session: &mut Session, ui: &mut Ui) {
    let name = session.editor.as_ref().map(|editor| editor.scene().name.clone());
    ui.heading(name.unwrap_or_else(|| "loading the scene".into()));
    let (last, _) = session.frames();
    ui.horizontal(|ui| {
        if ui.button("⏮").on_hover_text("the first frame (Home)").clicked() {
            session.go_to(0);
        }
        if ui.button("⏴").on_hover_text("a frame back (Left)").clicked() {
            session.step(-1);
        }
        let sign = if session.playing { "⏸" } else { "▶" };
        if ui.button(sign).on_hover_text("play, pause (Space)").clicked() {
            session.playing = !session.playing;
        }
        if ui.button("⏵").on_hover_text("a frame forward (Right)").clicked() {
            session.step(1);
        }
        ui.toggle_value(&mut session.looping, "🔁").on_hover_text("loop (L)");
        ui.monospace(format!("{:.2} s", session.time));
    });
    let mut frame = session.frame();
    ui.spacing_mut().slider_width = ui.available_width() - 60.0;
    if ui.add(egui::Slider::new(&mut frame, 0..=last)).on_hover_text("frame").changed() {
        session.playing = false;
        session.go_to(frame);
    }
}

fn compare(session: &mut Session, ui: &mut Ui) {
    for (index, name) in ["A", "B"].into_iter().enumerate() {
        ui.horizontal(|ui| {
            ui.label(name);
            let side = &mut session.sides[index];
            for method in Method::ALL {
                let label = if method == Method::Reference { "truth".to_owned() } else { method.name() };
                let hover = method.meaning();
                if ui.selectable_label(side.method == method, label).on_hover_text(hover).clicked() {
                    *side = Side::of(method);
                }
            }
        });
    }
    ui.horizontal(|ui| {
        for (way, label, hover) in [
            (Compare::Single, "A", "A alone"),
            (Compare::Split, "A | B", "A on the left of the line, B on its right; drag it (B)"),
            (Compare::Difference, "|A − B|", "where they differ (V)"),
        ] {
            if ui.selectable_label(session.compare == way, label).on_hover_text(hover).clicked() {
                session.compare = way;
            }
        }
    });
    if session.compare == Compare::Difference {
        ui.weak(Meaning::Difference.legend());
    }
}

fn image(session: &mut Session, ui: &mut Ui) {
    let names = session.shown.aovs.clone();
    egui::ComboBox::from_id_salt("image").width(ui.available_width() - 12.0).selected_text(&session.aov).show_ui(
        ui,
        |ui| {
            for name in &names {
                ui.selectable_value(&mut session.aov, name.clone(), name);
            }
        },
    );
    ui.add(egui::Label::new(RichText::new(Meaning::of(&session.aov).legend()).weak()).wrap());
    ui.horizontal(|ui| {
        let drag = egui::DragValue::new(&mut session.exposure).speed(0.01).range(1e-3..=1e3);
        ui.label("exposure");
        ui.add(drag).on_hover_text("factor on radiance before it is displayed; default 1");
        for map in Tonemap::ALL {
            let hover = match map {
                Tonemap::Clip => "what is brighter than white is white",
                Tonemap::Neutral => "highlights are compressed (Khronos PBR Neutral), here and in PNGs and videos",
            };
            ui.selectable_value(&mut session.tonemap, map, map.name()).on_hover_text(hover);
        }
    });
    ui.add(egui::Label::new(RichText::new(session.under.as_deref().unwrap_or("–")).weak()).wrap())
        .on_hover_text("what is under the pointer: metres from the camera, place in the world, captured radiance");
    ui.checkbox(&mut session.mark_unknown, "mark what was never seen").on_hover_text(
        "stripes where a ray of the camera passes behind something that hid it from the capture point (U)",
    );
}

/// Shows which parts of the model the scene needs.
fn plan(session: &Session, ui: &mut Ui) {
    egui::Grid::new("plan").num_columns(2).spacing([8.0, 2.0]).show(ui, |ui| {
        for (name, on, why) in &session.shown.plan {
            let name = if *on { RichText::new(*name).monospace() } else { RichText::new(*name).monospace().weak() };
            ui.label(name).on_hover_text(why);
            ui.label(if *on { "on" } else { "off" }).on_hover_text(why);
            ui.end_row();
        }
    });
}

fn window_options(session: &mut Session, ui: &mut Ui) {
    ui.weak(&session.device);
    ui.horizontal(|ui| {
        ui.label("present");
        for mode in session.modes.clone() {
            let hover = match mode {
                PresentMode::Fifo => "at the next refresh, in order",
                PresentMode::Mailbox => "at the next refresh, the newest",
                PresentMode::Immediate => "at once; may tear",
            };
            ui.selectable_value(&mut session.mode, mode, mode.name()).on_hover_text(hover);
        }
    });
    ui.horizontal(|ui| {
        ui.label("while moving, a frame takes");
        ui.add(egui::DragValue::new(&mut session.target_ms).range(5.0..=2000.0).suffix(" ms"))
            .on_hover_text("the picture is made smaller until it does; default 66 ms");
    });
    ui.horizontal(|ui| {
        if ui.button("full screen").on_hover_text("F11").clicked() {
            session.actions.push(WindowRequest::FullScreen);
        }
        let hover = "prints the iprt render … that gives A's picture, in the terminal";
        if ui.button("as a command").on_hover_text(hover).clicked() {
            match session.command() {
                Ok(command) => {
                    crate::terminal::say(&command);
                    session.say(command);
                }
                Err(problem) => session.complain(problem),
            }
        }
        if ui.button("help").on_hover_text("F1").clicked() {
            session.help = !session.help;
        }
    });
}

/// Shows what is being shown, and messages.
fn over_picture(session: &mut Session, ui: &mut Ui, rect: egui::Rect) {
    let painter = ui.painter_at(rect);
    let late = [0, 1].map(|side| session.behind.long(side, &session.shown));
    let since = |side: usize| late[side].map_or(String::new(), |time| format!(", for {} s", time.as_secs()));
    let line = |picture: &RenderedPicture, index: usize, name: &str| {
        let side = &session.sides[index];
        if picture.preview {
            return format!("{name}: the real scene alone; {} is being prepared{}", side.method.name(), since(index));
        }
        let [w, h] = picture.size;
        let of =
            if picture.is_full() { String::new() } else { format!(" of {}×{}", picture.full[0], picture.full[1]) };
        let held = if picture.held_relight { ", relit panorama held" } else { "" };
        let change = if late[index].is_some() { "; a change is being prepared" } else { "" };
        format!(
            "{name} {}: {w}×{h}{of}, {} frame{}, {:.0} ms{held}{change}{}",
            side.method.name(),
            picture.frames,
            if picture.frames == 1 { "" } else { "s" },
            picture.frame_ms,
            since(index)
        )
    };
    let back = Color32::from_black_alpha(170);
    let beside_legend = legend::beside(session, rect);
    let label = |at: egui::Pos2, align: Align2, text: String, color: Color32| {
        let width = if align == Align2::LEFT_BOTTOM { beside_legend } else { rect.width() - 16.0 };
        let galley = painter.layout(text, egui::FontId::proportional(13.0), color, width);
        let place = align.anchor_size(at, galley.size());
        painter.rect_filled(place.expand(4.0), 3.0, back);
        painter.galley(place.min, galley, color);
        place
    };
    if session.shown.pictures[0].is_none() {
        let mut text = String::from("loading the scene …");
        if session.started.elapsed() > LONG {
            text += "\n(the panorama of a built-in room is path-traced when it is first used: minutes; the terminal says how far it is)";
        }
        label(rect.center(), Align2::CENTER_CENTER, text, Color32::WHITE);
        ui.ctx().request_repaint_after(LONG);
    }
    let mut at = rect.left_bottom() + egui::vec2(8.0, -8.0);
    let sides = if session.compare == Compare::Single { 1 } else { 2 };
    for (index, name) in ["A", "B"].into_iter().enumerate().take(sides).rev() {
        let text = match &session.shown.pictures[index] {
            Some(picture) => line(picture, index, name),
            // Of A it is said that the scene is being loaded.
            None if index == 0 => continue,
            None => format!("{name}: {} is being prepared{}", session.sides[index].method.name(), since(index)),
        };
        at.y = label(at, Align2::LEFT_BOTTOM, text, Color32::WHITE).min.y - 10.0;
    }
    if session.compare == Compare::Split {
        let x = rect.min.x + session.divider * rect.width();
        painter.vline(x, rect.y_range(), egui::Stroke::new(2.0, Color32::WHITE));
    }
    if let (Some(editor), Some(lens)) = (&session.editor, session.lens())
        && let Some(index) = editor.selected()
    {
        let bounds = editor.bounds(index, session.time);
        outline(&painter, rect, &lens, &bounds);
        let pointer = ui.input(|input| input.pointer.hover_pos()).filter(|at| rect.contains(*at));
        let place =
            |at: egui::Pos2| glam::vec2((at.x - rect.min.x) / rect.width(), (at.y - rect.min.y) / rect.height());
        let bold = match session.drag {
            Some(Drag::MoveAlong { axis, .. }) => Some(axis),
            Some(_) => None,
            None => pointer.and_then(|at| controls::arrow_at(session, place(at))),
        };
        gizmo::draw(&painter, rect, &lens, &bounds, bold);
    }
    legend::show(session, &painter, rect);
    if let Some(loupe) = Loupe::of(session) {
        loupe.draw(&painter, session.pixels_per_point);
    }
    // The seconds go on, and begin to be told.
    if (0..sides).any(|side| session.behind.is_so(side, &session.shown)) {
        ui.ctx().request_repaint_after(PATIENCE / 2);
    }
    session.tidy();
    let mut at = rect.left_top() + egui::vec2(8.0, 8.0);
    for message in &session.messages {
        let color = if message.error { Color32::from_rgb(255, 150, 130) } else { Color32::from_rgb(190, 230, 190) };
        at.y = label(at, Align2::LEFT_TOP, message.text.clone(), color).max.y + 10.0;
    }
}

/// Draws the box of the selected object.
fn outline(
    painter: &egui::Painter,
    rect: egui::Rect,
    lens: &super::camera::Lens,
    bounds: &crate::scene::bounds::Bounds,
) {
    let corner = |i: usize| {
        let pick = |bit: usize, low: f32, high: f32| if i & bit == 0 { low } else { high };
        let (low, high) = (bounds.min, bounds.max);
        lens.project(Vec3::new(pick(1, low.x, high.x), pick(2, low.y, high.y), pick(4, low.z, high.z)))
    };
    let stroke = egui::Stroke::new(1.0, Color32::from_rgb(255, 200, 80));
    for i in 0..8 {
        for bit in [1, 2, 4].into_iter().filter(|bit| i & bit == 0) {
            if let (Some(a), Some(b)) = (corner(i), corner(i | bit)) {
                let place = |p: glam::Vec2| rect.min + egui::vec2(p.x * rect.width(), p.y * rect.height());
                painter.line_segment([place(a), place(b)], stroke);
            }
        }
    }
}

/// Asks what becomes of changes.
fn closing(session: &mut Session, ctx: &egui::Context) {
    let window = egui::Window::new("Not saved").collapsible(false).resizable(false);
    window.anchor(Align2::CENTER_CENTER, [0.0, 0.0]).show(ctx, |ui| {
        ui.label(format!("The scene was changed. Save it as {}?", session.save_path));
        ui.horizontal(|ui| {
            if ui.button("save and close").clicked() {
                session.save(&PathBuf::from(session.save_path.clone()));
                if !session.editor.as_ref().is_some_and(super::edit::Editor::changed) {
                    session.actions.push(WindowRequest::Close);
                }
            }
            if ui.button("close without saving").clicked() {
                session.actions.push(WindowRequest::Close);
            }
            if ui.button("go on").on_hover_text("Esc").clicked() {
                session.closing = false;
            }
        });
    });
}

fn help(session: &mut Session, ctx: &egui::Context) {
    let mut open = true;
    let height = (ctx.content_rect().height() - 60.0).max(100.0);
    let window = egui::Window::new("Keys").open(&mut open).collapsible(false).resizable(false);
    window.default_size([540.0, height]).anchor(Align2::CENTER_CENTER, [0.0, 0.0]).show(ctx, |ui| {
        egui::ScrollArea::vertical().max_height(height).show(ui, |ui| {
            egui::Grid::new("keys").num_columns(2).spacing([16.0, 1.0]).min_row_height(16.0).show(ui, |ui| {
                for (keys, meaning) in controls::KEYS {
                    ui.strong(*keys);
                    ui.label(RichText::new(*meaning).color(Color32::from_gray(200)));
                    ui.end_row();
                }
            });
        });
    });
    session.help &= open;
}
