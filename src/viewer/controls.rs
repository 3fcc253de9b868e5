//! Answers keys, and the pointer over the picture.

use super::{
    edit::Editor,
    gizmo, pick,
    session::{Drag, Session, WindowRequest},
    state::{Compare, Side},
};
use crate::{
    panorama::mapping::{bilinear, world_to_panorama},
    settings::Method,
};
use egui::{Key, Modifiers, PointerButton};
use glam::{Quat, Vec2, Vec3, vec2};
use std::{path::PathBuf, time::Instant};

/// The keys and what they do, for the help in the window and for the documents.
pub const KEYS: &[(&str, &str)] = &[
    ("drag", "look; on an object: move it on its level"),
    ("drag an arrow", "move the selected object along that axis of the world"),
    ("Alt+drag on an object", "move it along real surfaces: onto tables, walls, the floor"),
    ("Shift+drag, Ctrl+drag on an object", "turn it, scale it"),
    ("right drag", "look, whatever is under the pointer"),
    ("wheel", "zoom; Ctrl: scale the selected object by a tenth a notch"),
    ("click", "select an object, or none"),
    ("W A S D, Q E", "move the camera level, down and up; Shift: faster"),
    ("C", "the scene's own camera"),
    ("Space", "play, pause"),
    ("Left, Right", "a frame back, forward"),
    ("Home", "the first frame"),
    ("L", "loop"),
    ("1 2 3 4", "A by iprt, paper, ibl, reference; Shift: B"),
    ("B", "A and B side by side; drag the line between them"),
    ("V", "where A and B differ"),
    ("T", "A against the accumulating truth of its model"),
    ("O, Shift+O", "the next, the previous image (AOV)"),
    ("M", "the pixels under the pointer, eight times as large"),
    ("U", "mark what the capture never saw"),
    ("R", "accumulate anew"),
    ("X, Y, Z while it is dragged", "move it along that axis of the world alone"),
    (", .", "turn the selected object by 15°"),
    ("- =", "scale it by a tenth"),
    ("Ctrl+D", "a copy of it beside it"),
    ("Delete", "remove it"),
    ("Ctrl+Z, Ctrl+Y", "undo, redo"),
    ("Ctrl+S", "save the scene"),
    ("F12, Shift+F12", "screenshot as PNG, as EXR"),
    ("F11", "full screen"),
    #[cfg(debug_assertions)]
    ("F5", "load the shaders on disk (debug builds alone)"),
    ("P", "panels"),
    ("F1", "this help"),
    ("drop a .glb or .gltf", "add it in front of the camera"),
];

/// Walking speed, metres a second.
const SPEED: f32 = 1.0;
/// The power that makes ×1.1 of egui's zoom of a notch, which is e^0.2.
const NOTCH: f32 = 0.4766;
/// How near the pointer must be to the line between A and B to grab it, points.
const GRAB: f32 = 6.0;

/// Answers keys while no text is being written.
pub fn keys(session: &mut Session, ctx: &egui::Context) {
    if ctx.egui_wants_keyboard_input() {
        session.walking = false;
        return;
    }
    let pressed = |key| ctx.input_mut(|input| input.consume_key(Modifiers::NONE, key));
    let with = |modifiers, key| ctx.input_mut(|input| input.consume_key(modifiers, key));
    // Keys with modifiers come first, since the others match whatever the modifiers are.
    if with(Modifiers::COMMAND | Modifiers::SHIFT, Key::Z) || with(Modifiers::COMMAND, Key::Y) {
        session.editor.as_mut().map(Editor::redo);
    }
    if with(Modifiers::COMMAND, Key::Z) {
        session.editor.as_mut().map(Editor::undo);
    }
    if with(Modifiers::COMMAND, Key::D) {
        let right = session.lens().map_or(Vec3::X, |lens| lens.camera.rotation * Vec3::X);
        let (time, aside) = (session.time, right.with_y(0.0).normalize_or(Vec3::X));
        let copied = session.editor.as_mut().map_or(Ok(()), |editor| editor.duplicate(time, aside));
        session.check(copied);
    }
    if with(Modifiers::COMMAND, Key::S) {
        session.save(&PathBuf::from(session.save_path.clone()));
    }
    for (key, method) in [Key::Num1, Key::Num2, Key::Num3, Key::Num4].into_iter().zip(Method::ALL) {
        if with(Modifiers::SHIFT, key) {
            session.sides[1] = Side::of(method);
        }
        if pressed(key) {
            session.sides[0] = Side::of(method);
        }
    }
    for (name, modifiers) in [("exr", Modifiers::SHIFT), ("png", Modifiers::NONE)] {
        if with(modifiers, Key::F12) {
            session.actions.push(WindowRequest::Screenshot(free_name(name)));
        }
    }
    if with(Modifiers::SHIFT, Key::O) {
        next_aov(session, -1);
    }
    if pressed(Key::O) {
        next_aov(session, 1);
    }
    switches(session, &pressed);
    selected(session, &pressed);
    walk(session, ctx);
}

fn switches(session: &mut Session, pressed: &dyn Fn(Key) -> bool) {
    for (key, switch) in [
        (Key::Space, &mut session.playing),
        (Key::L, &mut session.looping),
        (Key::U, &mut session.mark_unknown),
        (Key::M, &mut session.loupe),
        (Key::P, &mut session.panels),
        (Key::F1, &mut session.help),
    ] {
        if pressed(key) {
            *switch = !*switch;
        }
    }
    for (key, way) in [(Key::B, Compare::Split), (Key::V, Compare::Difference)] {
        if pressed(key) {
            session.compare = if session.compare == way { Compare::Single } else { way };
        }
    }
    if pressed(Key::T) {
        session.sides[1] = Side::of(Method::Reference);
        session.compare = Compare::Split;
    }
    for (key, by) in [(Key::ArrowLeft, -1), (Key::ArrowRight, 1)] {
        if pressed(key) {
            session.playing = false;
            session.step(by);
        }
    }
    if pressed(Key::Home) {
        session.go_to(0);
    }
    if pressed(Key::C) {
        session.free = None;
    }
    if pressed(Key::R) {
        session.restart += 1;
    }
    #[cfg(debug_assertions)]
    if pressed(Key::F5) {
        session.actions.push(WindowRequest::Reload);
    }
    if pressed(Key::F11) {
        session.actions.push(WindowRequest::FullScreen);
    }
    if pressed(Key::Escape) {
        (session.help, session.closing) = (false, false);
        if let Some(editor) = &mut session.editor {
            editor.select(None);
        }
    }
}

fn selected(session: &mut Session, pressed: &dyn Fn(Key) -> bool) {
    let time = session.time;
    for (key, angle) in [(Key::Comma, 15.0_f32), (Key::Period, -15.0)] {
        if pressed(key) {
            change(session, time, |to| to.rotation = Quat::from_rotation_y(angle.to_radians()) * to.rotation);
        }
    }
    for (key, factor) in [(Key::Minus, 1.0 / 1.1), (Key::Equals, 1.1)] {
        if pressed(key) {
            change(session, time, |to| to.scale *= factor);
        }
    }
    if pressed(Key::Delete) || pressed(Key::Backspace) {
        let removed = session.editor.as_mut().map_or(Ok(()), Editor::remove);
        session.check(removed);
    }
}

/// Changes the place of the selected object, as a step of its own.
fn change(session: &mut Session, time: f64, change: impl Fn(&mut crate::scene::animation::Transform)) {
    let Some(editor) = &mut session.editor else { return };
    let Some(index) = editor.selected() else { return };
    let mut to = editor.transform(index, time);
    change(&mut to);
    editor.begin_step();
    editor.place(index, to, time);
}

/// Scales the selected object. Turns that follow each other are one step.
fn turn_wheel(session: &mut Session, factor: f32, frame: u64) {
    let time = session.time;
    let Some((index, editor)) = session.editor.as_mut().and_then(|e| Some((e.selected()?, e))) else { return };
    let mut to = editor.transform(index, time);
    to.scale *= factor;
    editor.begin_wheel(Instant::now(), frame);
    editor.place(index, to, time);
}

fn walk(session: &mut Session, ctx: &egui::Context) {
    let (way, seconds) = ctx.input(|input| {
        let held = |key| f32::from(u8::from(input.key_down(key) && !input.modifiers.command));
        let way = Vec3::new(held(Key::D) - held(Key::A), held(Key::E) - held(Key::Q), held(Key::W) - held(Key::S));
        (way * if input.modifiers.shift { 4.0 } else { 1.0 }, input.unstable_dt.min(0.1))
    });
    session.walking = way != Vec3::ZERO;
    if session.walking
        && let Some(camera) = session.take_camera()
    {
        camera.walk(SPEED * seconds * way);
    }
}

fn next_aov(session: &mut Session, by: isize) {
    let names = &session.shown.aovs;
    let now = names.iter().position(|name| *name == session.aov);
    if let Some(name) = now.and_then(|now| names.get((now as isize + by).rem_euclid(names.len() as isize) as usize)) {
        session.aov = name.clone();
    }
}

/// The first file name `iprt-NNNN` that does not exist yet.
fn free_name(extension: &str) -> PathBuf {
    let names = (1..).map(|number| PathBuf::from(format!("iprt-{number:04}.{extension}")));
    names.into_iter().find(|path| !path.exists()).unwrap_or_default()
}

/// Answers the pointer over the picture.
pub fn pointer(session: &mut Session, response: &egui::Response, ui: &egui::Ui) {
    let rect = response.rect;
    let place = |at: egui::Pos2| vec2((at.x - rect.min.x) / rect.width(), (at.y - rect.min.y) / rect.height());
    let modifiers = ui.input(|input| input.modifiers);
    let on_divider = |at: egui::Pos2, session: &Session| {
        session.compare == Compare::Split && (at.x - rect.min.x - session.divider * rect.width()).abs() < GRAB
    };
    session.pointer = response.hover_pos();
    session.under = response.hover_pos().and_then(|at| described(session, place(at)));
    if let Some(at) = response.hover_pos() {
        if on_divider(at, session) {
            ui.set_cursor_icon(egui::CursorIcon::ResizeHorizontal);
        }
        let (wheel, pinch) = ui.input(|input| (input.smooth_scroll_delta().y, input.zoom_delta()));
        if modifiers.command && pinch != 1.0 {
            turn_wheel(session, pinch.powf(NOTCH), ui.ctx().cumulative_frame_nr());
        } else if wheel != 0.0
            && let Some(camera) = session.take_camera()
        {
            camera.zoom((-wheel / 400.0).exp());
        }
    }
    let origin = ui.input(|input| input.pointer.press_origin());
    if response.clicked_by(PointerButton::Primary)
        && let Some(at) = response.interact_pointer_pos()
    {
        let index = under(session, place(at));
        if let Some(editor) = &mut session.editor {
            editor.select(index);
        }
    }
    if response.drag_started()
        && let Some(at) = origin
    {
        session.drag = if response.drag_started_by(PointerButton::Secondary) {
            Some(Drag::Look)
        } else if on_divider(at, session) {
            Some(Drag::Divider)
        } else {
            Some(grab(session, place(at), modifiers))
        };
    }
    if !response.dragged() {
        session.drag = None;
        return;
    }
    let by = response.drag_delta() / rect.height();
    let by = vec2(by.x, by.y);
    match session.drag {
        Some(Drag::Look) if by != Vec2::ZERO => {
            if let Some(camera) = session.take_camera() {
                camera.turn(by);
            }
        }
        Some(Drag::Divider) => {
            if let Some(at) = response.interact_pointer_pos() {
                session.divider = place(at).x.clamp(0.0, 1.0);
            }
        }
        Some(Drag::Move { grip, foot }) => {
            if let Some(at) = response.interact_pointer_pos() {
                let held = |key| ui.input(|input| input.key_down(key));
                match [(Key::X, Vec3::X), (Key::Y, Vec3::Y), (Key::Z, Vec3::Z)].into_iter().find(|(key, _)| held(*key))
                {
                    Some((_, axis)) => drag_on_axis(session, place(at) + grip, foot, axis),
                    None if modifiers.alt => drag_along(session, place(at) + grip),
                    None => drag_level(session, place(at) + grip, foot),
                }
            }
        }
        Some(Drag::MoveAlong { grip, foot, axis }) => {
            if let Some(at) = response.interact_pointer_pos() {
                drag_on_axis(session, place(at) + grip, foot, axis);
            }
        }
        Some(way @ (Drag::Turn | Drag::Scale)) if by != Vec2::ZERO => {
            let time = session.time;
            let Some((index, editor)) = session.editor.as_mut().and_then(|e| Some((e.selected()?, e))) else { return };
            let mut to = editor.transform(index, time);
            match way {
                Drag::Turn => to.rotation = Quat::from_rotation_y(4.0 * by.x) * to.rotation,
                _ => to.scale *= (-2.0 * by.y).exp(),
            }
            editor.place(index, to, time);
        }
        _ => {}
    }
}

/// The object that is seen at a place in the picture.
fn under(session: &Session, place: Vec2) -> Option<usize> {
    let (editor, lens) = (session.editor.as_ref()?, session.lens()?);
    let scene = editor.scene();
    let surface = session.shown.surface.as_deref().map(|frame| pick::RealSurface {
        frame,
        centre: scene.panorama.position,
        yaw_degrees: scene.panorama.yaw_degrees,
    });
    pick::object_at(scene, surface, &lens, place, session.time)
}

/// Says what is seen at a place in the picture: an object or the room, how far it is and where, and the captured radiance.
fn described(session: &Session, place: Vec2) -> Option<String> {
    let (editor, lens, frame) = (session.editor.as_ref()?, session.lens()?, session.shown.surface.as_deref()?);
    let (scene, origin, direction) = (editor.scene(), lens.camera.position, lens.direction(place));
    if let Some(index) = under(session, place) {
        let distance = scene.first_object(origin, direction, session.time)?.1;
        let [x, y, z] = (origin + distance * direction).to_array();
        return Some(format!("{}: {distance:.2} m, at ({x:.2}, {y:.2}, {z:.2})", editor.names().get(index)?));
    }
    let (centre, yaw_degrees) = (scene.panorama.position, scene.panorama.yaw_degrees);
    let (point, _) = pick::RealSurface { frame, centre, yaw_degrees }.hit(origin, direction)?;
    let to_point = world_to_panorama((point - centre).as_dvec3(), f64::from(yaw_degrees));
    let [x, y, z] = point.to_array();
    let [r, g, b] = bilinear(frame, to_point.as_vec3()).to_array();
    let distance = point.distance(origin);
    Some(format!("the room: {distance:.2} m, at ({x:.2}, {y:.2}, {z:.2}), radiance {r:.3} {g:.3} {b:.3}"))
}

/// What a drag that begins here moves.
fn grab(session: &mut Session, place: Vec2, modifiers: Modifiers) -> Drag {
    if let Some(drag) = grab_arrow(session, place) {
        return drag;
    }
    let Some(index) = under(session, place) else { return Drag::Look };
    let (lens, time) = (session.lens(), session.time);
    let Some(editor) = &mut session.editor else { return Drag::Look };
    editor.select(Some(index));
    editor.begin_step();
    session.playing = false;
    if modifiers.shift {
        Drag::Turn
    } else if modifiers.command {
        Drag::Scale
    } else {
        let foot = pick::foot(&editor.bounds(index, time));
        let seen = lens.and_then(|lens| lens.project(foot));
        Drag::Move { grip: seen.map_or(Vec2::ZERO, |seen| seen - place), foot }
    }
}

/// The axis whose arrow can be grabbed here. Where an arrow is drawn over its own object, that is grabbed.
pub fn arrow_at(session: &Session, place: Vec2) -> Option<Vec3> {
    let (lens, editor) = (session.lens()?, session.editor.as_ref()?);
    let index = editor.selected()?;
    let axis = gizmo::at(&lens, &editor.bounds(index, session.time), place)?;
    (under(session, place) != Some(index)).then_some(axis)
}

/// The drag that begins at an arrow of the selected object, if one is here.
fn grab_arrow(session: &mut Session, place: Vec2) -> Option<Drag> {
    let (axis, lens, time) = (arrow_at(session, place)?, session.lens()?, session.time);
    let editor = session.editor.as_mut()?;
    let bounds = editor.bounds(editor.selected()?, time);
    let foot = pick::foot(&bounds);
    let grip = lens.project(foot)? - place;
    editor.begin_step();
    session.playing = false;
    Some(Drag::MoveAlong { grip, foot, axis })
}

/// Moves the selected object on the level where it stood, to what is seen of that at a place in the picture.
fn drag_level(session: &mut Session, place: Vec2, foot: Vec3) {
    let Some(lens) = session.lens() else { return };
    let (origin, direction) = (lens.camera.position, lens.direction(place));
    let distance = (foot.y - origin.y) / direction.y;
    if (0.05..50.0).contains(&distance) {
        move_foot(session, origin + distance * direction);
    }
}

/// Moves the selected object along an axis through where it stood, to where that is nearest to a place in the picture.
fn drag_on_axis(session: &mut Session, place: Vec2, foot: Vec3, axis: Vec3) {
    let Some(lens) = session.lens() else { return };
    if let Some(at) = pick::along_axis(foot, axis, lens.camera.position, lens.direction(place)) {
        move_foot(session, at);
    }
}

/// Puts the foot of the selected object at a point of the world.
fn move_foot(session: &mut Session, at: Vec3) {
    let time = session.time;
    let Some((index, editor)) = session.editor.as_mut().and_then(|e| Some((e.selected()?, e))) else { return };
    let mut to = editor.transform(index, time);
    to.translation += at - pick::foot(&editor.bounds(index, time));
    editor.place(index, to, time);
}

/// Puts the selected object where the real surface is seen at a place in the picture.
fn drag_along(session: &mut Session, place: Vec2) {
    let (Some(lens), time, Some(frame)) = (session.lens(), session.time, session.shown.surface.clone()) else { return };
    let Some((index, editor)) = session.editor.as_mut().and_then(|e| Some((e.selected()?, e))) else { return };
    let panorama = &editor.scene().panorama;
    let surface = pick::RealSurface { frame: &frame, centre: panorama.position, yaw_degrees: panorama.yaw_degrees };
    let Some((point, normal)) = surface.hit(lens.camera.position, lens.direction(place)) else { return };
    // A surface that is nearly level or upright counts as exactly so, since depth is not that exact.
    let normal = [Vec3::Y, Vec3::NEG_Y].into_iter().find(|axis| normal.dot(*axis) > 0.8).unwrap_or(normal);
    let mut to = editor.transform(index, time);
    to.translation += pick::onto(&editor.bounds(index, time), point, normal);
    editor.place(index, to, time);
}
