//! The window and its events.

mod play;

use super::{
    edit::{self, Made, Origin},
    engine::Engine,
    notches::Notches,
    panels,
    presenter::{Presenter, WindowFrame},
    report::SessionReport,
    script::Script,
    session::{Session, WindowRequest},
    state::{Notice, Order, Side, Wanted},
};
use crate::{
    Error, Result,
    gpu::{Gpu, GpuOptions, Paint},
    scene::{Object, Scene},
};
use std::{
    sync::{
        Arc,
        mpsc::{Receiver, Sender, channel},
    },
    time::{Duration, Instant},
};
use winit::{
    application::ApplicationHandler,
    dpi::PhysicalSize,
    event::{DeviceEvent, DeviceId, ElementState, WindowEvent},
    event_loop::{ActiveEventLoop, ControlFlow, EventLoop, EventLoopProxy},
    raw_window_handle::HasDisplayHandle,
    window::{Fullscreen, Window, WindowId},
};

/// A function that reads a scene. It runs on a thread of its own.
pub type Open = Box<dyn FnOnce(&Gpu) -> Result<Opened> + Send>;

/// A scene, and how it is shown at first.
pub struct Opened {
    pub scene: Scene,
    pub origin: Origin,
    /// How picture A is made.
    pub side: Side,
    /// Factor on radiance before display.
    pub exposure: f32,
}

/// What a window is opened with.
pub struct Options {
    pub gpu: GpuOptions,
    /// Width and height of the window, pixels.
    pub size: [u32; 2],
    /// Milliseconds that a frame may take while something moves.
    pub target_ms: f64,
    /// A script whose events are played. The window closes at its end.
    pub script: Option<Script>,
}

/// The least time between two frames of the window.
const FRAME: Duration = Duration::from_millis(16);
/// Opens the window, and returns when it is closed.
///
/// # Errors
/// Fails if there is no display or no usable device, if the scene cannot be read, if the device is lost, or
/// if a script waits in vain.
pub fn run(options: Options, open: Open) -> Result<SessionReport> {
    let set = |name| std::env::var_os(name).is_some_and(|value| !value.is_empty());
    let no_display = |problem: String| {
        let remedy = "start it in a graphical session, or under xvfb-run";
        Error::input("DISPLAY, WAYLAND_DISPLAY", problem, remedy)
    };
    if cfg!(all(unix, not(target_os = "macos"))) && !set("DISPLAY") && !set("WAYLAND_DISPLAY") {
        return Err(no_display("neither is set, and a window needs a display".into()));
    }
    let start = Instant::now();
    let one_line = |error: winit::error::EventLoopError| error.to_string().replace('\n', " ");
    let events = EventLoop::with_user_event().build().map_err(|e| no_display(one_line(e)))?;
    let display = events.display_handle().map_err(|e| no_display(e.to_string()))?.as_raw();
    let gpu = Gpu::for_windows(&options.gpu, display)?;
    let validation = options.gpu.validation;
    let mut app = App::new(gpu.clone(), options, open, events.create_proxy(), start)?;
    events.run_app(&mut app).map_err(|e| no_display(one_line(e)))?;
    let (mut report, error) = app.finish();
    if validation {
        report.messages = gpu.destroy()?;
    }
    match error {
        Some(error) => Err(error),
        None => Ok(report),
    }
}

/// A model that was read.
type Loaded = Result<(Object, Made)>;

struct App {
    gpu: Gpu,
    options: Options,
    wake: EventLoopProxy<()>,
    session: Session,
    engine: Engine,
    window: Option<OpenWindow>,
    opened: Receiver<Result<Opened>>,
    models: (Sender<Loaded>, Receiver<Loaded>),
    wanted: Option<Wanted>,
    number: u64,
    dirty: bool,
    /// Whether the script has done something that no frame has seen yet.
    stepped: bool,
    redraw_at: Option<Instant>,
    /// When the script checks again.
    look_at: Option<Instant>,
    start: Instant,
    report: SessionReport,
    error: Option<Error>,
    /// Events of the script for the next frame.
    events: Vec<egui::Event>,
    modifiers: egui::Modifiers,
    /// Whether the script wants the surface to be lost.
    lose: bool,
    /// Whether the user wants to leave.
    closed: bool,
    waiting: Waiting,
    notches: Notches,
}

/// What the script waits for.
struct Waiting {
    since: Instant,
    /// Number of pictures so far.
    pictures: u64,
    /// Number of errors when the step began.
    errors: usize,
    frame: Option<u64>,
    answers: Option<usize>,
}

struct OpenWindow {
    window: Arc<Window>,
    state: egui_winit::State,
    context: egui::Context,
    presenter: Presenter,
}

impl App {
    fn new(gpu: Gpu, options: Options, open: Open, wake: EventLoopProxy<()>, start: Instant) -> Result<Self> {
        let bell = wake.clone();
        let engine = Engine::start(gpu.clone(), move || ring(&bell))?;
        let (sender, opened) = channel();
        let (device, bell) = (gpu.clone(), wake.clone());
        let read = move || {
            let scene = open(&device);
            drop(device); // the window may end before anyone listens
            let _ = sender.send(scene);
            ring(&bell);
        };
        let thread = std::thread::Builder::new().name("open".into()).spawn(read);
        thread.map_err(|error| Error::Internal(format!("starting a thread: {error}")))?;
        tracing::debug!("the device is there, {:.2} s", start.elapsed().as_secs_f64());
        let device = format!("{}, {}", gpu.device_name(), gpu.driver());
        let session = Session::new(Side::of(crate::settings::Method::Iprt), options.target_ms, device.clone());
        Ok(Self {
            gpu,
            options,
            wake,
            session,
            engine,
            window: None,
            opened,
            models: channel(),
            wanted: None,
            number: 0,
            dirty: true,
            stepped: true,
            redraw_at: None,
            look_at: None,
            start,
            report: SessionReport { device, ..SessionReport::default() },
            error: None,
            events: Vec::new(),
            modifiers: egui::Modifiers::NONE,
            lose: false,
            closed: false,
            notches: Notches::default(),
            waiting: Waiting { since: Instant::now(), pictures: 0, errors: 0, frame: None, answers: None },
        })
    }

    fn open_window(&mut self, events: &ActiveEventLoop) -> Result<()> {
        let [width, height] = self.options.size;
        let attributes = Window::default_attributes()
            .with_title("iprt")
            .with_inner_size(PhysicalSize::new(width, height))
            .with_min_inner_size(PhysicalSize::new(1, 1));
        let window = events
            .create_window(attributes)
            .map_err(|error| Error::input("the window", error.to_string().replace('\n', " "), "check the display"))?;
        let window = Arc::new(window);
        let bell = self.wake.clone();
        let presenter = Presenter::start(&self.gpu, window.clone(), move || ring(&bell))?;
        self.session.modes.clone_from(&presenter.modes);
        let context = egui::Context::default();
        context.set_theme(egui::Theme::Dark);
        context.all_styles_mut(|style| style.visuals.weak_text_color = Some(egui::Color32::from_gray(155)));
        context.options_mut(|options| options.zoom_with_keyboard = false);
        let scale = Some(window.scale_factor() as f32);
        let state = egui_winit::State::new(context.clone(), egui::ViewportId::ROOT, &*window, scale, None, Some(8192));
        self.window = Some(OpenWindow { window, state, context, presenter });
        tracing::debug!("the window is there, {:.2} s", self.start.elapsed().as_secs_f64());
        Ok(())
    }

    /// Takes everything that other threads have left.
    fn collect(&mut self) -> Result<()> {
        // The presenter also wakes the window, but it has nothing new to show.
        self.dirty |= self.session.see(self.engine.shown());
        for notice in self.engine.notices() {
            if let Notice::Written { path, size, frames } = &notice {
                let entry = serde_json::json!({ "file": path, "size": size, "frames": frames });
                self.report.screenshots.push(entry);
            }
            self.session.hear(notice);
            self.dirty = true;
        }
        if let Ok(opened) = self.opened.try_recv() {
            let Opened { scene, origin, side, exposure } = opened?;
            tracing::debug!("the scene is there, {:.2} s", self.start.elapsed().as_secs_f64());
            if let Some(shell) = &self.window {
                shell.window.set_title(&format!("iprt: {}", scene.name));
            }
            self.session.opened(scene, origin, side, exposure);
            self.dirty = true;
        }
        while let Ok(model) = self.models.1.try_recv() {
            if let Some((object, made)) = self.session.check(model) {
                self.session.add(object, made);
            }
            self.dirty = true;
        }
        Ok(())
    }

    /// Draws one frame of the window, if the previous frame is done.
    fn frame(&mut self) -> Result<()> {
        let Some(shell) = &mut self.window else { return Ok(()) };
        let (progress, done) = shell.presenter.progress();
        if let Some(failure) = progress.failure {
            return Err(Error::Internal(failure));
        }
        if !done {
            return Ok(());
        }
        (self.dirty, self.stepped) = (false, false);
        let size: [u32; 2] = shell.window.inner_size().into();
        let mut input = shell.state.take_egui_input(&shell.window);
        input.events.append(&mut self.events);
        // In a script the window counts as focused, whatever the display says.
        input.focused |= self.options.script.is_some();
        let session = &mut self.session;
        session.play(Instant::now());
        let output = shell.context.run_ui(input, |ui| panels::window(session, ui));
        shell.state.handle_platform_output(&shell.window, output.platform_output);
        let repaint = output.viewport_output.values().map(|view| view.repaint_delay).min().unwrap_or(Duration::MAX);
        let moving = session.playing || session.walking || !session.messages.is_empty() || !progress.last_shown;
        let delay = if moving { Duration::ZERO } else { repaint }.max(FRAME);
        self.redraw_at = Instant::now().checked_add(delay);
        let primitives = shell.context.tessellate(output.shapes, output.pixels_per_point);
        let blits = session.blits();
        if !blits.is_empty() && self.report.first_picture_ms.is_none() {
            self.report.first_picture_ms = Some(self.start.elapsed().as_secs_f64() * 1e3);
            tracing::debug!("the first picture is there, {:.2} s", self.start.elapsed().as_secs_f64());
        }
        let paint = Paint { textures: output.textures_delta, primitives, pixels_per_point: output.pixels_per_point };
        shell.presenter.send(WindowFrame {
            size,
            mode: session.mode,
            blits,
            paint,
            lose: std::mem::take(&mut self.lose),
        });
        self.act();
        Ok(())
    }

    /// Does what the session asked of the window.
    fn act(&mut self) {
        for action in std::mem::take(&mut self.session.actions) {
            match action {
                WindowRequest::Screenshot(path) => self.engine.order(Order::Screenshot { path, frames: 1 }),
                #[cfg(debug_assertions)]
                WindowRequest::Reload => self.engine.order(Order::Reload),
                WindowRequest::Close => self.closed = true,
                WindowRequest::FullScreen => {
                    if let Some(shell) = &self.window {
                        let full = shell.window.fullscreen().is_some();
                        shell.window.set_fullscreen((!full).then_some(Fullscreen::Borderless(None)));
                    }
                }
                WindowRequest::Load(path) => {
                    let (sender, bell) = (self.models.0.clone(), self.wake.clone());
                    let load = move || {
                        let _ = sender.send(edit::load_object(&path)); // nobody listens once the window is closed
                        ring(&bell);
                    };
                    if let Err(error) = std::thread::Builder::new().name("load".into()).spawn(load) {
                        self.session.complain(format!("starting a thread: {error}"));
                    }
                }
            }
        }
        if let Some(mut wanted) = self.session.wanted()
            && self.wanted.as_ref().is_none_or(|last| !last.same(&wanted))
        {
            self.number += 1;
            let Session { behind, shown, .. } = &mut self.session;
            behind.ask(self.number, shown);
            wanted.number = self.number;
            self.wanted = Some(wanted.clone());
            self.engine.want(wanted);
        }
    }

    fn turn(&mut self, events: &ActiveEventLoop) -> Result<()> {
        if self.play()? || self.closed {
            events.exit();
            return Ok(());
        }
        if self.dirty || self.redraw_at.is_some_and(|at| at <= Instant::now()) {
            self.dirty = true;
            self.frame()?;
        }
        // While the presenter is busy, its end wakes the window.
        let redraw = self.redraw_at.filter(|_| !self.dirty);
        events.set_control_flow(match redraw.into_iter().chain(self.look_at).min() {
            Some(at) => ControlFlow::WaitUntil(at),
            None => ControlFlow::Wait,
        });
        Ok(())
    }

    fn handle(&mut self, events: &ActiveEventLoop, work: impl FnOnce(&mut Self) -> Result<()>) {
        let start = Instant::now();
        if self.error.is_none()
            && let Err(error) = work(self)
        {
            self.error = Some(error);
            events.exit();
        }
        self.report.longest_event_ms = self.report.longest_event_ms.max(start.elapsed().as_secs_f64() * 1e3);
    }

    fn finish(mut self) -> (SessionReport, Option<Error>) {
        let shown = self.engine.shown();
        (self.report.pictures, self.report.dropped) = (shown.rendered, shown.dropped);
        self.report.errors = std::mem::take(&mut self.session.errors);
        if let Some(shell) = self.window.take() {
            let (progress, _) = shell.presenter.progress();
            self.report.frames = progress.shown;
            self.report.skipped = progress.skipped;
            self.report.swapchains = progress.swapchains;
        }
        (self.report, self.error)
    }
}

fn ring(bell: &EventLoopProxy<()>) {
    let _ = bell.send_event(()); // the window may be closed by now
}

impl ApplicationHandler<()> for App {
    fn resumed(&mut self, events: &ActiveEventLoop) {
        if self.window.is_none() {
            self.handle(events, |app| app.open_window(events));
        }
    }

    fn user_event(&mut self, events: &ActiveEventLoop, (): ()) {
        self.handle(events, Self::collect);
    }

    fn window_event(&mut self, events: &ActiveEventLoop, _: WindowId, event: WindowEvent) {
        self.handle(events, |app| {
            let Some(shell) = &mut app.window else { return Ok(()) };
            if matches!(event, WindowEvent::MouseWheel { .. }) && !app.notches.counts(Instant::now()) {
                return Ok(());
            }
            let answer = shell.state.on_window_event(&shell.window, &event);
            app.dirty |= answer.repaint;
            match event {
                WindowEvent::CloseRequested if app.session.may_close() => events.exit(),
                WindowEvent::CloseRequested => app.dirty = true,
                WindowEvent::DroppedFile(path) => app.session.actions.push(WindowRequest::Load(path)),
                WindowEvent::Resized(_) | WindowEvent::RedrawRequested | WindowEvent::Occluded(_) => app.dirty = true,
                _ => {}
            }
            Ok(())
        });
    }

    fn device_event(&mut self, _: &ActiveEventLoop, _: DeviceId, event: DeviceEvent) {
        if let DeviceEvent::Button { button, state: ElementState::Released } = event {
            self.notches.release(button, Instant::now());
        }
    }

    fn about_to_wait(&mut self, events: &ActiveEventLoop) {
        self.handle(events, |app| app.turn(events));
    }
}
