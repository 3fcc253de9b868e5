//! What the window shows and how it answers, without the window itself.

use super::{
    behind::Behind,
    camera::{Free, Lens},
    edit::{Editor, Made, Origin},
    save::{self, render_settings},
    state::{Compare, EngineOutput, Notice, Side, Wanted},
    timings_panel,
};
use crate::{
    Error, Result,
    gpu::{PresentMode, Timings},
    image_file::tonemap::Tonemap,
    scene::{Object, Scene, camera::Camera, file::RenderSettings},
    settings::Method,
    warnings,
};
use std::{
    path::{Path, PathBuf},
    sync::Arc,
    time::{Duration, Instant},
};

/// A word as a shell takes it.
fn quoted(word: &str) -> String {
    let is_plain = |c: char| c.is_alphanumeric() || "/._-+,:@".contains(c);
    if word.chars().all(is_plain) { word.to_owned() } else { format!("'{}'", word.replace('\'', r"'\''")) }
}

/// What the session asks of the window.
#[derive(Clone, Debug, PartialEq)]
pub enum WindowRequest {
    /// Write A's picture.
    Screenshot(PathBuf),
    /// Read a model and add it.
    Load(PathBuf),
    /// Enter or leave full screen.
    FullScreen,
    /// Close the window, whatever was changed.
    Close,
    /// Take up the shaders on disk.
    #[cfg(debug_assertions)]
    Reload,
}

/// A line over the picture.
#[derive(Clone, Debug)]
pub struct Message {
    pub text: String,
    pub error: bool,
    pub since: Instant,
}

/// How long a message stays.
const MESSAGE_TIME: Duration = Duration::from_secs(8);

/// The times of a frame.
#[derive(Clone, Debug)]
pub struct FrameRecord {
    /// Wall time of the whole frame, milliseconds.
    pub wall_ms: f64,
    pub timings: Arc<Timings>,
}

/// What the pointer is dragging.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Drag {
    /// The view.
    Look,
    /// The line between A and B.
    Divider,
    /// An object, over surfaces. `grip` is the way from the pointer to the object's foot, as a part of the
    /// picture, and `foot` where that was in the world.
    Move { grip: glam::Vec2, foot: glam::Vec3 },
    /// An object, along an axis of the world, by its arrow.
    MoveAlong { grip: glam::Vec2, foot: glam::Vec3, axis: glam::Vec3 },
    /// An object, about its vertical axis.
    Turn,
    /// The size of an object.
    Scale,
}

/// The state of the window's content.
pub struct Session {
    /// The edited scene. It is `None` while the scene is loading.
    pub editor: Option<Editor>,
    /// The camera, if it was moved by hand.
    pub free: Option<Free>,
    /// Time of the scene, seconds.
    pub time: f64,
    pub playing: bool,
    pub looping: bool,
    pub sides: [Side; 2],
    pub compare: Compare,
    /// Where A ends and B begins, from 0 to 1 across the picture.
    pub divider: f32,
    pub aov: String,
    pub exposure: f32,
    /// How light beyond white is shown.
    pub tonemap: Tonemap,
    pub mark_unknown: bool,
    /// Whether the pixels under the pointer are shown large.
    pub loupe: bool,
    /// Where the pointer is over the picture, points of the window.
    pub pointer: Option<egui::Pos2>,
    pub target_ms: f64,
    pub restart: u64,
    pub mode: PresentMode,
    pub modes: Vec<PresentMode>,
    pub panels: bool,
    pub help: bool,
    /// Whether the user is asked what becomes of changes before the window closes.
    pub closing: bool,
    pub drag: Option<Drag>,
    /// What is under the pointer, in words.
    pub under: Option<String>,
    /// Whether keys that move the camera are down.
    pub walking: bool,
    pub messages: Vec<Message>,
    /// All messages so far that were errors.
    pub errors: Vec<String>,
    /// The picture's rectangle in the window, points.
    pub picture: egui::Rect,
    pub pixels_per_point: f32,
    pub actions: Vec<WindowRequest>,
    pub save_path: String,
    pub model_path: String,
    /// Where the session saved before.
    saved: Option<PathBuf>,
    /// The scene file that it wrote then, and the camera that it wrote there.
    written: Option<(PathBuf, Option<Free>)>,
    /// Times of A's last frames, the newest last.
    pub frame_times: Vec<FrameRecord>,
    last_serial: u64,
    played_at: Option<Instant>,
    play_clock: f64,
    /// The scene as this camera sees it, and what it was made of.
    seen: Option<(Arc<Scene>, Option<Free>, Arc<Scene>)>,
    pub shown: EngineOutput,
    pub behind: Behind,
    /// When the window was asked for.
    pub started: Instant,
    /// The name of the device, for people.
    pub device: String,
}

impl Session {
    /// Makes a session without a scene.
    pub fn new(side: Side, target_ms: f64, device: String) -> Self {
        Self {
            editor: None,
            free: None,
            time: 0.0,
            playing: false,
            looping: true,
            sides: [side, Side::of(Method::Paper)],
            compare: Compare::Single,
            divider: 0.5,
            aov: "radiance".into(),
            exposure: 1.0,
            tonemap: Tonemap::Clip,
            mark_unknown: false,
            loupe: false,
            pointer: None,
            target_ms,
            restart: 0,
            mode: PresentMode::Fifo,
            modes: Vec::new(),
            panels: true,
            help: false,
            closing: false,
            drag: None,
            under: None,
            walking: false,
            messages: Vec::new(),
            errors: Vec::new(),
            picture: egui::Rect::ZERO,
            pixels_per_point: 1.0,
            actions: Vec::new(),
            save_path: String::new(),
            model_path: String::new(),
            saved: None,
            written: None,
            frame_times: Vec::new(),
            last_serial: 0,
            played_at: None,
            play_clock: 0.0,
            seen: None,
            shown: EngineOutput::default(),
            behind: Behind::new(),
            started: Instant::now(),
            device,
        }
    }

    /// Takes over a loaded scene.
    pub fn opened(&mut self, scene: Scene, origin: Origin, side: Side, exposure: f32) {
        warnings::tell(&scene.warnings);
        self.save_path = save::usual_place(&origin).display().to_string();
        self.sides[0] = side;
        self.exposure = exposure;
        self.tonemap = scene.render.tonemap;
        self.editor = Some(Editor::new(scene, origin));
    }

    /// Shows a message over the picture.
    pub fn say(&mut self, text: impl Into<String>) {
        self.messages.push(Message { text: text.into(), error: false, since: Instant::now() });
    }

    /// Shows an error over the picture.
    pub fn complain(&mut self, text: impl Into<String>) {
        let text = text.into();
        if self.messages.iter().any(|message| message.text == text) {
            return;
        }
        warnings::remark(&text, &text);
        self.errors.push(text.clone());
        self.messages.push(Message { text, error: true, since: Instant::now() });
    }

    /// Shows the error of a result, if it is one.
    pub fn check<T>(&mut self, result: Result<T>) -> Option<T> {
        result.map_err(|error: Error| self.complain(error.to_string())).ok()
    }

    /// Takes a notice of the rendering thread.
    pub fn hear(&mut self, notice: Notice) {
        match notice {
            Notice::Written { path, size: [w, h], frames } => {
                self.say(format!("{} written, {w}×{h}, {frames} frames", path.display()));
            }
            #[cfg(debug_assertions)]
            Notice::Done(text) => self.say(text),
            Notice::Failed(text) => self.complain(text),
        }
    }

    /// Takes the output of the rendering thread. Returns whether it is new.
    pub fn see(&mut self, shown: EngineOutput) -> bool {
        let serials = |shown: &EngineOutput| shown.pictures.each_ref().map(|p| p.as_ref().map(|p| p.serial));
        let other = serials(&shown) != serials(&self.shown) || shown.idle != self.shown.idle;
        if let Some(picture) = &shown.pictures[0]
            && picture.serial != self.last_serial
        {
            self.last_serial = picture.serial;
            self.frame_times.push(FrameRecord { wall_ms: picture.frame_ms, timings: Arc::clone(&picture.timings) });
            let extra = self.frame_times.len().saturating_sub(timings_panel::FRAMES);
            self.frame_times.drain(..extra);
        }
        self.behind.see(&shown, &self.shown);
        self.shown = shown;
        other
    }

    /// Whether a picture is still to come, or something moves on its own.
    pub fn is_moving(&self) -> bool {
        self.playing || self.walking || self.drag.is_some_and(|drag| drag != Drag::Divider)
    }

    /// Number of the last frame, and frames a second.
    pub fn frames(&self) -> (usize, f64) {
        let Some(editor) = &self.editor else { return (0, 30.0) };
        let (scene, fps) = (editor.scene(), editor.scene().panorama.fps);
        let count = (scene.duration() * fps - 1e-6).ceil().max(1.0) as usize;
        (count - 1, fps)
    }

    /// Number of the frame that is shown.
    pub fn frame(&self) -> usize {
        (self.time * self.frames().1).round() as usize
    }

    /// Goes to a frame.
    pub fn go_to(&mut self, frame: usize) {
        let (last, fps) = self.frames();
        self.time = frame.min(last) as f64 / fps;
        self.play_clock = self.time;
    }

    /// Steps by some frames. A video that loops starts again at its end.
    pub fn step(&mut self, by: i64) {
        let (last, _) = self.frames();
        let target = self.frame() as i64 + by;
        let count = last as i64 + 1;
        self.go_to(if self.looping { target.rem_euclid(count) } else { target.clamp(0, last as i64) } as usize);
    }

    /// Lets the clock run.
    pub fn play(&mut self, now: Instant) {
        let before = self.played_at.replace(now);
        if !self.playing {
            self.play_clock = self.time;
            return;
        }
        let (last, fps) = self.frames();
        let end = (last + 1) as f64 / fps;
        self.play_clock += before.map_or(0.0, |before| (now - before).as_secs_f64());
        if self.play_clock >= end {
            if self.looping {
                self.play_clock %= end;
            } else {
                (self.play_clock, self.playing) = (last as f64 / fps, false);
            }
        }
        let frame = (self.play_clock * fps + 1e-6).floor() as usize;
        self.time = frame.min(last) as f64 / fps;
    }

    /// The camera as it is now.
    pub fn camera(&self) -> Option<Camera> {
        let scene = self.editor.as_ref()?.scene();
        let track = self.free.map(|free| free.track(scene.camera.size));
        Some(track.as_ref().unwrap_or(&scene.camera).at(self.time))
    }

    /// The picture's geometry.
    pub fn lens(&self) -> Option<Lens> {
        let size = self.picture_size()?;
        Some(Lens { camera: self.camera()?, aspect: size[0] as f32 / size[1] as f32 })
    }

    /// Takes the camera over from the scene, so that it can be moved by hand.
    pub fn take_camera(&mut self) -> Option<&mut Free> {
        if self.free.is_none() {
            self.free = Some(Free::from_camera(&self.camera()?));
        }
        self.free.as_mut()
    }

    /// Width and height of the picture in the window, pixels.
    pub fn picture_size(&self) -> Option<[u32; 2]> {
        let size = self.picture.size() * self.pixels_per_point;
        let [width, height] = [size.x, size.y].map(|side| side.round().clamp(0.0, 16384.0) as u32);
        (width >= 8 && height >= 8).then_some([width, height])
    }

    /// What is to be rendered, if there is anything.
    pub fn wanted(&mut self) -> Option<Wanted> {
        let size = self.picture_size()?;
        let scene = Arc::clone(self.editor.as_ref()?.scene());
        let same =
            |(from, free, _): &(Arc<Scene>, Option<Free>, Arc<Scene>)| Arc::ptr_eq(from, &scene) && *free == self.free;
        if !self.seen.as_ref().is_some_and(same) {
            let seen = match self.free {
                Some(free) => {
                    let mut seen = Scene::clone(&scene);
                    seen.camera = free.track(scene.camera.size);
                    Arc::new(seen)
                }
                None => Arc::clone(&scene),
            };
            self.seen = Some((scene, self.free, seen));
        }
        Some(Wanted {
            scene: Arc::clone(&self.seen.as_ref()?.2),
            time: self.time,
            size,
            sides: self.sides.clone(),
            compare: self.compare,
            aov: self.aov.clone(),
            exposure: self.exposure,
            tonemap: self.tonemap,
            mark_unknown: self.mark_unknown,
            moving: self.is_moving(),
            target_ms: self.target_ms,
            restart: self.restart,
            number: 0,
        })
    }

    /// Puts a model into the scene, in front of the camera and on what is there.
    pub fn add(&mut self, object: Object, made: Made) {
        let (Some(lens), time) = (self.lens(), self.time) else { return };
        let surface = self.shown.surface.clone();
        let Some(editor) = &mut self.editor else { return };
        let added = editor.add(object, made);
        if let Ok(index) = added {
            let direction = lens.direction(glam::vec2(0.5, 0.6));
            let scene = editor.scene();
            let hit = surface.and_then(|frame| {
                super::pick::RealSurface {
                    frame: &frame,
                    centre: scene.panorama.position,
                    yaw_degrees: scene.panorama.yaw_degrees,
                }
                .hit(lens.camera.position, direction)
            });
            let (point, normal) = hit.unwrap_or((lens.camera.position + 2.0 * direction, glam::Vec3::Y));
            let mut to = editor.transform(index, time);
            to.translation += super::pick::onto(&editor.bounds(index, time), point, normal);
            editor.place(index, to, time);
            editor.begin_step();
        }
        self.check(added);
    }

    /// Sets a value of the selected object's materials from text
    /// ([`set_text`](crate::scene::material_override::MaterialOverride::set_text)).
    ///
    /// # Errors
    /// Fails if there is no such value, or if the scene cannot be packed.
    pub fn paint(&mut self, key: &str, text: &str) -> Result<()> {
        let Some((index, editor)) = self.editor.as_mut().and_then(|editor| Some((editor.selected()?, editor))) else {
            return Ok(());
        };
        let mut by = editor.painted(index).map(|painted| painted.by.clone()).unwrap_or_default();
        by.set_text(key, text, "--script: material")?;
        editor.begin_step();
        editor.paint(index, by)
    }

    /// Saves the scene, and tells what was written or what is wrong.
    pub fn save(&mut self, to: &Path) {
        let Some(editor) = &self.editor else { return };
        let side = &self.sides[0];
        let view = save::SavedView {
            camera: self.free.map(|free| free.track(editor.scene().camera.size)),
            render: render_settings(side.method, &side.settings, self.exposure, self.tonemap),
        };
        let again = self.saved.as_deref() == Some(to);
        let saved = save::save(editor, &view, to, again);
        if let Some(path) = self.check(saved) {
            self.saved = Some(to.to_owned());
            self.written = Some((path.clone(), self.free));
            if let Some(editor) = &mut self.editor {
                editor.mark_saved();
            }
            self.say(format!("{} written", path.display()));
        }
    }

    /// The command that renders what picture A shows.
    ///
    /// # Errors
    /// Fails if no scene file holds what is seen.
    pub fn command(&self) -> std::result::Result<String, &'static str> {
        let editor = self.editor.as_ref().ok_or("the scene is being loaded")?;
        let camera = self.written.as_ref().and_then(|(_, camera)| *camera);
        if editor.changed() || self.free != camera {
            return Err("save the scene first: the command reads objects and camera from its file");
        }
        let scene = match (&self.written, &editor.origin) {
            (Some((path, _)), _) | (None, Origin::File(path)) => quoted(&path.display().to_string()),
            (None, Origin::Room(room)) => room.name.to_owned(),
        };
        let [width, height] = self.picture_size().ok_or("the window shows no picture")?;
        let side = &self.sides[0];
        let RenderSettings { method, exposure, tonemap, set } =
            render_settings(side.method, &side.settings, self.exposure, self.tonemap);
        let frame = self.frame();
        let frames = self.shown.pictures[0].as_ref().map_or(1, |picture| picture.frames.max(1));
        let mut command = format!("iprt render {scene} -o picture.png --size {width}x{height} --method {method}");
        for (key, value) in set {
            command += &format!(" --set {key}={}", value.as_str().unwrap_or_default());
        }
        command += &format!(" --exposure {exposure} --tonemap {} --frames {frame}..{frame}", tonemap.name());
        match side.method {
            Method::Reference => command += &format!(" --spp {frames}"),
            _ => command += &format!(" --warmup {}", frames - 1),
        }
        Ok(command)
    }

    /// Says whether the window may close. If there is anything to save, the user is asked, once.
    pub fn may_close(&mut self) -> bool {
        let changed = self.editor.as_ref().is_some_and(Editor::changed);
        std::mem::replace(&mut self.closing, changed) || !changed
    }

    /// Removes old messages.
    pub fn tidy(&mut self) {
        self.messages.retain(|message| message.since.elapsed() < MESSAGE_TIME);
    }
}
