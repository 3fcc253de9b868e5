//! The panel of objects: which there are, where the selected one stands and what it is made of, and the steps so far.

use super::{
    edit::{Editor, shape_object},
    session::{Session, WindowRequest},
};
use crate::{
    Result,
    scene::{
        material_override::{MaterialOverride, Value},
        shapes::Shape,
    },
};
use egui::{DragValue, RichText, Ui};
use glam::{EulerRot, Quat, Vec3};
use std::path::PathBuf;

/// Lays out the panel.
pub fn show(session: &mut Session, ui: &mut Ui) {
    let time = session.time;
    let Some(editor) = &mut session.editor else { return };
    let (names, selected) = (editor.names(), editor.selected());
    ui.horizontal_wrapped(|ui| {
        for (index, name) in names.iter().enumerate() {
            if ui.selectable_label(selected == Some(index), name).clicked() {
                editor.select(if selected == Some(index) { None } else { Some(index) });
            }
        }
    });
    if let Some(index) = editor.selected() {
        place(editor, index, time, ui);
        let painted = egui::CollapsingHeader::new("material").show(ui, |ui| material(editor, index, ui));
        let painted = painted.body_returned.unwrap_or(Ok(()));
        session.check(painted);
    }
    ui.horizontal(|ui| {
        if ui.button("remove").on_hover_text("the selected object (Delete)").clicked() {
            let removed = session.editor.as_mut().map_or(Ok(()), Editor::remove);
            session.check(removed);
        }
        if ui.button("undo").on_hover_text("Ctrl+Z").clicked() {
            session.editor.as_mut().map(Editor::undo);
        }
        if ui.button("redo").on_hover_text("Ctrl+Y").clicked() {
            session.editor.as_mut().map(Editor::redo);
        }
        ui.menu_button("steps", |ui| {
            let Some(editor) = &mut session.editor else { return };
            let (steps, now) = editor.steps();
            egui::ScrollArea::vertical().max_height(300.0).show(ui, |ui| {
                for (number, step) in steps.iter().enumerate().rev() {
                    let label = if number > now { RichText::new(step).weak() } else { RichText::new(step) };
                    if ui.selectable_label(number == now, label).clicked() {
                        editor.go_to(number);
                        ui.close();
                    }
                }
            });
        })
        .response
        .on_hover_text("what was done so far, the newest on top: click to go back or forward to it");
        ui.menu_button("add", |ui| {
            for (shape, name) in Shape::ALL.into_iter().zip(Shape::NAMES) {
                if ui.button(name).clicked() {
                    let (object, made) = shape_object(shape, Vec3::splat(0.3));
                    session.add(object, made);
                    ui.close();
                }
            }
        });
    });
    ui.horizontal(|ui| {
        let path = egui::TextEdit::singleline(&mut session.model_path).hint_text(".glb, .gltf").desired_width(180.0);
        ui.add(path).on_hover_text("or drop the file on the window");
        if ui.button("add").clicked() && !session.model_path.is_empty() {
            session.actions.push(WindowRequest::Load(PathBuf::from(session.model_path.trim())));
        }
    });
    ui.horizontal(|ui| {
        ui.add(egui::TextEdit::singleline(&mut session.save_path).desired_width(180.0))
            .on_hover_text("a scene file; for a built-in room a folder");
        let label = if session.editor.as_ref().is_some_and(Editor::changed) { "save *" } else { "save" };
        if ui.button(label).on_hover_text("objects, camera, method and settings (Ctrl+S)").clicked() {
            session.save(&PathBuf::from(session.save_path.clone()));
        }
    });
}

/// Where an object stands.
fn place(editor: &mut Editor, index: usize, time: f64, ui: &mut Ui) {
    let mut to = editor.transform(index, time);
    let (y, x, z) = to.rotation.to_euler(EulerRot::YXZ);
    // Thousandths; adding 0 makes of −0 a plain one.
    let mut angles = Vec3::new(x, y, z).map(|angle| (1e3 * angle.to_degrees()).round() / 1e3 + 0.0);
    let mut begins = false;
    let mut changed = false;
    let mut row = |ui: &mut Ui, name: &str, hover: &str, value: &mut Vec3, speed: f32| -> bool {
        ui.horizontal(|ui| {
            ui.add_sized([64.0, 18.0], egui::Label::new(name)).on_hover_text(hover);
            let mut moved = false;
            for part in value.as_mut() {
                let answer = ui.add(egui::DragValue::new(part).speed(speed).max_decimals(3));
                begins |= answer.drag_started() || answer.gained_focus();
                moved |= answer.changed();
            }
            moved
        })
        .inner
    };
    changed |= row(ui, "place", "x, y, z of its origin, world, metres", &mut to.translation, 0.01);
    let turned = row(ui, "turn", "about x, y, z, degrees: first z, then x, then y", &mut angles, 1.0);
    changed |= row(ui, "scale", "along its own x, y, z", &mut to.scale, 0.01);
    if turned {
        let radians = angles.map(f32::to_radians);
        to.rotation = Quat::from_euler(EulerRot::YXZ, radians.y, radians.x, radians.z);
    }
    if begins {
        editor.begin_step();
    }
    if changed || turned {
        editor.place(index, to, time);
    }
}

/// A field for a number. What a file has may be out of range, and stays until it is changed.
fn number(value: &mut f32, [least, most]: [f32; 2]) -> DragValue<'_> {
    DragValue::new(value).range(least..=most).clamp_existing_to_range(false).max_decimals(3)
}

/// What an object is made of. What is set here replaces the values of all its materials, and their textures.
fn material(editor: &mut Editor, index: usize, ui: &mut Ui) -> Result<()> {
    let (Some(material), Some(painted)) = (editor.material(index).cloned(), editor.painted(index)) else {
        return Ok(());
    };
    let mut by = painted.by.clone();
    let mut begins = false;
    egui::Grid::new("material").num_columns(3).spacing([8.0, 2.0]).show(ui, |ui| {
        for entry in MaterialOverride::ENTRIES {
            let set = (entry.get)(&by);
            let name = RichText::new(entry.key.replace('_', " "));
            ui.label(if set.is_some() { name.strong() } else { name.weak() }).on_hover_text(entry.what);
            let [_, most] = entry.range;
            let mut value = set.unwrap_or_else(|| (entry.of)(&material));
            let answer = match &mut value {
                Value::Number(value) => {
                    let speed = if most > 1.0 { 0.01 * f64::from(value.abs().clamp(0.1, 1e3)) } else { 0.01 };
                    ui.add(number(value, entry.range).speed(speed))
                }
                Value::Color(color) if most > 1.0 => {
                    let parts = color.as_mut().iter_mut();
                    let row = |ui: &mut Ui| {
                        let drag = |part| ui.add(number(part, entry.range).speed(0.05));
                        parts.map(drag).reduce(|a, b| a | b)
                    };
                    let answer = ui.horizontal(row);
                    answer.inner.unwrap_or(answer.response)
                }
                Value::Color(color) => ui.color_edit_button_rgb(color.as_mut()),
            };
            begins |= answer.drag_started() || answer.gained_focus() || answer.clicked();
            if answer.changed() {
                (entry.set)(&mut by, Some(value));
            }
            if set.is_some() && ui.small_button("⟲").on_hover_text("as it was").clicked() {
                begins = true;
                (entry.set)(&mut by, None);
            }
            ui.end_row();
        }
    });
    if begins {
        editor.begin_step();
    }
    editor.paint(index, by)
}
