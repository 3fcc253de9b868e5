//! Plays a script in the window: what it does, and what it waits for.

use super::{App, Waiting};
use crate::{
    Error, Result,
    viewer::{
        report::note,
        script::Step,
        session::{Session, WindowRequest},
        state::{Compare, Order},
    },
};
use std::time::{Duration, Instant};
use winit::dpi::PhysicalSize;

/// How long a script waits for one thing without a new picture before it is given up.
const PATIENCE: Duration = Duration::from_secs(120);
/// The same after an error: most likely no more pictures come.
const PATIENCE_AFTER_ERROR: Duration = Duration::from_secs(20);
/// How often a script checks what it waits for.
const LOOK: Duration = Duration::from_millis(20);

impl App {
    /// Plays the script as far as it goes. Returns whether it is over.
    pub(super) fn play(&mut self) -> Result<bool> {
        let Some(script) = &mut self.options.script else { return Ok(false) };
        let Some(shell) = &self.window else { return Ok(false) };
        let (progress, done) = shell.presenter.progress();
        if !done || self.stepped {
            self.look_at = None; // the end of the frame wakes
            return Ok(false); // what came before is seen first
        }
        let Some(step) = script.next().cloned() else { return Ok(true) };
        let answers = self.report.screenshots.len() + self.session.errors.len();
        let waits = match &step {
            Step::Frame(frame) => progress.shown < *frame,
            Step::Wait(frames) => progress.shown < *self.waiting.frame.get_or_insert(progress.shown + frames),
            Step::Settle(frames) => !settled(&self.session, self.number, *frames),
            Step::Await(path) => !path.exists(),
            Step::Objects(number) => self.session.editor.as_ref().is_none_or(|editor| editor.made().len() != *number),
            Step::Errors(number) => self.session.errors.len() < *number,
            Step::Screenshot(path) => match self.waiting.answers {
                None => {
                    self.engine.order(Order::Screenshot { path: path.clone(), frames: 1 });
                    self.waiting.answers = Some(answers);
                    true
                }
                Some(before) => before == answers,
            },
            _ => false,
        };
        if waits {
            if std::mem::replace(&mut self.waiting.pictures, self.session.shown.rendered) != self.session.shown.rendered
            {
                self.waiting.since = Instant::now();
            }
            let failed = self.session.errors.len() > self.waiting.errors;
            if self.waiting.since.elapsed() > if failed { PATIENCE_AFTER_ERROR } else { PATIENCE } {
                let said = self.session.errors.join("; ");
                let problem =
                    format!("{step:?} does not come to an end{}{said}", if said.is_empty() { "" } else { ": " });
                return Err(Error::input("--script", problem, "correct the script"));
            }
            if matches!(step, Step::Frame(_) | Step::Wait(_)) {
                self.dirty = true;
            }
            self.look_at = Some(Instant::now() + LOOK);
            return Ok(false);
        }
        script.done();
        self.look_at = None;
        tracing::info!("script, {:.1} s: {step:?}", self.start.elapsed().as_secs_f64());
        let errors = self.session.errors.len();
        self.waiting = Waiting { since: Instant::now(), pictures: 0, errors, frame: None, answers: None };
        self.perform(step)?;
        (self.dirty, self.stepped) = (true, true);
        Ok(false)
    }

    fn perform(&mut self, step: Step) -> Result<()> {
        match step {
            Step::Key { key, modifiers, down } => {
                let now = if down { modifiers } else { egui::Modifiers::NONE };
                if now != self.modifiers {
                    self.modifiers = now;
                    self.events.push(egui::Event::ModifiersChanged(now));
                }
                let event = egui::Event::Key { key, physical_key: None, pressed: down, repeat: false, modifiers };
                self.events.push(event);
            }
            Step::Move(at) => self.events.push(egui::Event::PointerMoved(at)),
            Step::Button { button, at, down } => {
                let modifiers = self.modifiers;
                self.events.push(egui::Event::PointerButton { pos: at, button, pressed: down, modifiers });
            }
            Step::Wheel(notches) => self.events.push(egui::Event::MouseWheel {
                unit: egui::MouseWheelUnit::Line,
                delta: egui::vec2(0.0, notches),
                phase: egui::TouchPhase::Move,
                modifiers: self.modifiers,
            }),
            Step::Size([width, height]) => {
                if let Some(shell) = &self.window {
                    // The answer comes as an event, or is there at once.
                    let _ = shell.window.request_inner_size(PhysicalSize::new(width, height));
                }
            }
            Step::Lose => self.lose = true,
            Step::Close => self.closed |= self.session.may_close(),
            Step::Present(mode) => self.session.mode = mode,
            Step::Drop(path) => self.session.actions.push(WindowRequest::Load(path)),
            Step::Set { side, pair } => {
                let (key, value) = pair.split_once('=').unwrap_or((&pair, ""));
                self.session.sides[side].settings.set(key, value, "--script")?;
            }
            Step::Material(pair) => {
                let (key, value) = pair.split_once('=').unwrap_or((&pair, ""));
                self.session.paint(key, value)?;
            }
            Step::Save(path) => self.session.save(&path),
            Step::Note(word) => {
                let size = self.window.as_ref().map_or([0; 2], |shell| shell.window.inner_size().into());
                self.report.notes.push(note(&word, &self.session, size));
            }
            Step::Frame(_)
            | Step::Wait(_)
            | Step::Settle(_)
            | Step::Await(_)
            | Step::Objects(_)
            | Step::Errors(_)
            | Step::Screenshot(_) => {}
        }
        Ok(())
    }
}

/// Whether the last request is shown, and shown well, and objects can be put on what is seen.
fn settled(session: &Session, number: u64, frames: u32) -> bool {
    let sides = if session.compare == Compare::Single { 1 } else { 2 };
    session.editor.is_some()
        && session.shown.surface.is_some()
        && session.shown.pictures.iter().zip(&session.sides).take(sides).all(|(picture, side)| {
            picture.as_ref().is_some_and(|p| p.number == number && p.is_full() && p.frames >= frames.min(side.enough()))
        })
}
