//! The thread that renders. It works on the newest request. While requests keep changing it renders quickly,
//! and once they stop it renders well. It leaves finished pictures for the window, which never waits for it.

use super::{
    painter::{Pace, Painter, SETTLED, interrupted},
    state::{Compare, EngineOutput, Notice, Order, RenderedPicture, Wanted},
};
use crate::{
    Result,
    gpu::{Gpu, Pieces},
    output::{self, FileKind},
    passes::display::Display,
    plan::Part,
};
use std::{
    sync::{
        Arc, Condvar, Mutex, MutexGuard, PoisonError,
        atomic::{AtomicBool, Ordering},
    },
    thread::JoinHandle,
    time::{Duration, Instant},
};

/// The window's handle to the rendering thread. The thread ends when the handle is dropped.
pub struct Engine {
    shared: Arc<EngineState>,
    thread: Option<JoinHandle<()>>,
}

struct EngineState {
    inbox: Mutex<Inbox>,
    bell: Condvar,
    pieces: Pieces,
    /// Whether the frame that runs now may be stopped for something newer.
    patient: AtomicBool,
    shown: Mutex<EngineOutput>,
    notices: Mutex<Vec<Notice>>,
    wake: Box<dyn Fn() + Send + Sync>,
}

#[derive(Default)]
struct Inbox {
    wanted: Option<Wanted>,
    orders: Vec<Order>,
    fresh: bool,
    quit: bool,
}

fn lock<T>(mutex: &Mutex<T>) -> MutexGuard<'_, T> {
    mutex.lock().unwrap_or_else(PoisonError::into_inner)
}

impl Engine {
    /// Starts the thread. `wake` is called whenever there is something new to show or to say.
    ///
    /// # Errors
    /// Fails if no thread can be started.
    pub fn start(gpu: Gpu, wake: impl Fn() + Send + Sync + 'static) -> Result<Self> {
        let shared = Arc::new(EngineState {
            inbox: Mutex::default(),
            bell: Condvar::new(),
            pieces: Pieces::default(),
            patient: AtomicBool::new(false),
            shown: Mutex::default(),
            notices: Mutex::default(),
            wake: Box::new(wake),
        });
        let there = Arc::clone(&shared);
        let thread = std::thread::Builder::new().name("render".into()).spawn(move || run(gpu, &there));
        let thread = thread.map_err(|error| crate::Error::Internal(format!("starting a thread: {error}")))?;
        Ok(Self { shared, thread: Some(thread) })
    }

    /// Asks for something to be shown, in place of the former request.
    pub fn want(&self, wanted: Wanted) {
        let mut inbox = lock(&self.shared.inbox);
        let other = inbox.wanted.as_ref().is_none_or(|old| !old.same_view(&wanted) || old.sides != wanted.sides);
        if other && self.shared.patient.load(Ordering::Relaxed) {
            self.shared.pieces.stop();
        }
        inbox.wanted = Some(wanted);
        inbox.fresh = true;
        self.shared.bell.notify_one();
    }

    /// Asks for something to be done once.
    pub fn order(&self, order: Order) {
        lock(&self.shared.inbox).orders.push(order);
        self.shared.bell.notify_one();
    }

    /// What there is to show.
    pub fn shown(&self) -> EngineOutput {
        lock(&self.shared.shown).clone()
    }

    /// What there is to say. Each notice is returned once.
    pub fn notices(&self) -> Vec<Notice> {
        std::mem::take(&mut lock(&self.shared.notices))
    }
}

impl Drop for Engine {
    fn drop(&mut self) {
        lock(&self.shared.inbox).quit = true;
        self.shared.pieces.stop();
        self.shared.bell.notify_one();
        if let Some(thread) = self.thread.take()
            && thread.join().is_err()
        {
            tracing::error!("the rendering thread panicked");
        }
        *lock(&self.shared.shown) = EngineOutput::default();
    }
}

fn run(gpu: Gpu, shared: &EngineState) {
    let fail = |text: String| {
        lock(&shared.notices).push(Notice::Failed(text));
        (shared.wake)();
    };
    let gpu = gpu.keeping_passes(); // a method that was shown before is there at once
    let mut work = match Worker::new(&gpu, shared) {
        Ok(work) => work,
        Err(error) => return fail(error.to_string()),
    };
    let mut wait = None;
    while let Some((wanted, orders, fresh)) = next(shared, wait) {
        work.orders.extend(orders);
        wait = match work.turn(&wanted, fresh) {
            Ok(wait) => wait,
            Err(error) if interrupted(&error) => Some(Duration::ZERO),
            Err(error) => {
                // The last picture stays. Another request may work.
                fail(error.to_string());
                None
            }
        };
    }
}

/// Waits until the request changes or the time is over, and returns it with the new orders. Returns `None`
/// when the thread is to end.
fn next(shared: &EngineState, wait: Option<Duration>) -> Option<(Wanted, Vec<Order>, bool)> {
    let mut inbox = lock(&shared.inbox);
    let until = wait.map(|wait| Instant::now() + wait);
    loop {
        if inbox.quit {
            return None;
        }
        let due = until.is_some_and(|until| Instant::now() >= until);
        let fresh = inbox.fresh;
        if (fresh || due || !inbox.orders.is_empty())
            && let Some(wanted) = inbox.wanted.clone()
        {
            inbox.fresh = false;
            return Some((wanted, std::mem::take(&mut inbox.orders), fresh));
        }
        inbox = match until.filter(|_| inbox.wanted.is_some()) {
            Some(until) => {
                let left = until.saturating_duration_since(Instant::now());
                shared.bell.wait_timeout(inbox, left).unwrap_or_else(PoisonError::into_inner).0
            }
            None => shared.bell.wait(inbox).unwrap_or_else(PoisonError::into_inner),
        };
    }
}

struct Worker<'a> {
    gpu: Gpu,
    shared: &'a EngineState,
    display: Display,
    painters: [Painter; 2],
    orders: Vec<Order>,
    last: Option<Wanted>,
    changed: Instant,
    serial: u64,
    played: Option<usize>,
    surface: Option<(usize, Arc<crate::panorama::source::PanoramaFrame>)>,
}

impl<'a> Worker<'a> {
    fn new(gpu: &Gpu, shared: &'a EngineState) -> Result<Self> {
        let painter = || Painter::new(gpu, &shared.pieces);
        Ok(Self {
            gpu: gpu.clone(),
            shared,
            display: Display::new(gpu)?,
            painters: [painter(), painter()],
            orders: Vec::new(),
            last: None,
            changed: Instant::now(),
            serial: 0,
            played: None,
            surface: None,
        })
    }

    /// Renders one frame of each picture. Returns when to continue if nothing else happens.
    fn turn(&mut self, wanted: &Wanted, fresh: bool) -> Result<Option<Duration>> {
        if self.last.as_ref().is_none_or(|last| !last.same_view(wanted)) {
            self.changed = Instant::now();
        }
        self.last = Some(wanted.clone());
        #[cfg(debug_assertions)]
        if self.orders.iter().any(|order| matches!(order, Order::Reload)) {
            self.reload(wanted);
        }
        let quickly = wanted.moving || self.changed.elapsed() < SETTLED;
        self.shared.pieces.go_on();
        self.shared.patient.store(!quickly, Ordering::Relaxed);
        let count = if wanted.compare == Compare::Single { 1 } else { 2 };
        if count == 1 && self.painters[1].renderer().is_some() {
            self.painters[1].clear();
        }
        let pairs = self.painters.iter().zip(&wanted.sides).take(count);
        let next: Vec<Pace> = pairs.map(|(painter, side)| painter.next(wanted, side)).collect();
        // Both pictures proceed together. The one that is ahead waits. If they are to be compared, it begins
        // again.
        let pace = next.iter().copied().min().filter(|_| !quickly).unwrap_or(Pace::Quick);
        let differ = wanted.compare == Compare::Difference;
        let mut sizes: Vec<[u32; 2]> = self.painters.iter_mut().take(count).map(|p| p.size(wanted, pace)).collect();
        if let Some(least) = sizes.iter().copied().min().filter(|_| differ) {
            sizes.fill(least);
        }
        let (mut rendered, mut published) = (0, 0);
        for (index, side) in wanted.sides.iter().enumerate().take(count) {
            let waits = next[index] > pace && !quickly && !differ;
            let new = !waits && self.painters[index].step(wanted, side, pace, sizes[index])?;
            rendered += u64::from(new);
            // A does not wait for B, but it can only differ from a B of the same view.
            if (new && !differ) || (index + 1 == count && (fresh || rendered > published)) {
                self.publish(wanted, count, rendered - published, quickly)?;
                published = rendered;
            }
        }
        self.shared.patient.store(false, Ordering::Relaxed);
        self.obey(wanted);
        if rendered > 0 {
            return Ok(Some(Duration::ZERO));
        }
        if quickly {
            return Ok(Some(SETTLED.saturating_sub(self.changed.elapsed())));
        }
        self.look_at_surface(wanted)?;
        self.set_idle(true);
        Ok(None)
    }

    fn publish(&mut self, wanted: &Wanted, count: usize, rendered: u64, quickly: bool) -> Result<()> {
        self.serial += 1;
        let mut pictures: [Option<RenderedPicture>; 2] = [None, None];
        for (slot, painter) in pictures.iter_mut().zip(&mut self.painters).take(count) {
            *slot = painter.picture(&self.display, wanted, None, self.serial)?;
        }
        let preview = pictures[0].as_ref().is_some_and(|picture| picture.preview);
        let mut difference = None;
        if wanted.compare == Compare::Difference {
            let [a, b] = &mut self.painters;
            let other = b.renderer().filter(|b| a.renderer().is_some_and(|a| a.options().size == b.options().size));
            if let Some(other) = other {
                let other = other.shown("radiance")?.image.clone();
                difference = a.picture(&self.display, wanted, Some(&other), self.serial)?;
            }
        }
        let frame = wanted.scene.panorama.frame_at(wanted.time);
        let skipped = match self.played {
            Some(played) if wanted.moving && frame > played => frame - played - 1,
            _ => 0,
        };
        self.played = Some(frame);
        let mut aovs = self.painters[0].renderer().map_or_else(Vec::new, crate::renderer::Renderer::aov_names);
        // It takes seconds, and is not held by the device.
        aovs.retain(|known| known != crate::renderer::aov::UNKNOWN_LIGHT);
        // Where there are two layers, reading these images would put them together, but nothing is read here.
        for name in ["position", "motion"] {
            if aovs.contains(&format!("{name}_virtual")) {
                aovs.retain(|known| known != name);
            }
        }
        let reasons = |renderer: &crate::renderer::Renderer| {
            let plan = renderer.plan();
            Part::ALL.map(|part| (part.name(), plan.on(part), plan.reason(part))).to_vec()
        };
        let plan = self.painters[0].renderer().map_or_else(Vec::new, reasons);
        {
            let mut shown = lock(&self.shared.shown);
            shown.pictures = pictures;
            shown.difference = difference;
            shown.aovs = aovs;
            shown.plan = plan;
            shown.rendered += rendered;
            shown.dropped += skipped as u64;
            shown.idle = false;
        }
        (self.shared.wake)();
        if !quickly || (self.surface.is_none() && !preview) {
            self.look_at_surface(wanted)?;
        }
        Ok(())
    }

    fn set_idle(&self, idle: bool) {
        lock(&self.shared.shown).idle = idle;
        (self.shared.wake)();
    }

    /// Keeps the depth of the video frame for the window.
    fn look_at_surface(&mut self, wanted: &Wanted) -> Result<()> {
        let frame = wanted.scene.panorama.frame_at(wanted.time);
        if self.surface.as_ref().is_none_or(|(known, _)| *known != frame) {
            // Shared with the renderer, whose frame it is.
            self.surface = Some((frame, wanted.scene.panorama.load(frame)?));
        }
        let surface = self.surface.as_ref().map(|(_, surface)| Arc::clone(surface));
        let mut shown = lock(&self.shared.shown);
        if shown.surface.as_ref().map(Arc::as_ptr) != surface.as_ref().map(Arc::as_ptr) {
            shown.surface = surface;
            drop(shown);
            (self.shared.wake)();
        }
        Ok(())
    }

    /// Loads the shaders on disk. If one fails to compile or binds something else, all pipelines stay as they
    /// were.
    #[cfg(debug_assertions)]
    fn reload(&mut self, wanted: &Wanted) {
        self.orders.retain(|order| !matches!(order, Order::Reload));
        let made = crate::shaders::reload(|| {
            let renderers = self.painters.iter().map(|painter| painter.remade(wanted)).collect::<Result<Vec<_>>>()?;
            Ok((Display::new(&self.gpu)?, renderers))
        });
        let result = made.map(|made| {
            let Some((display, renderers)) = made else { return "no shader has changed".to_owned() };
            self.display = display;
            self.painters.iter_mut().zip(renderers).for_each(|(painter, renderer)| painter.replace(renderer));
            "changed shaders are loaded".to_owned()
        });
        let notice = result.map_or_else(|error| Notice::Failed(error.to_string()), Notice::Done);
        lock(&self.shared.notices).push(notice);
        (self.shared.wake)();
    }

    fn obey(&mut self, wanted: &Wanted) {
        let painter = &self.painters[0];
        let Some(renderer) = painter.renderer().filter(|_| painter.is_full(wanted)) else { return };
        let mut notices = Vec::new();
        let enough = wanted.sides[0].enough();
        self.orders.retain(|order| {
            let (path, frames) = match order {
                Order::Screenshot { path, frames } => (path, *frames),
                #[cfg(debug_assertions)]
                Order::Reload => return true,
            };
            if painter.frames < frames.min(enough) {
                return true;
            }
            let written = FileKind::of(path).and_then(|kind| {
                output::write(
                    std::slice::from_ref(renderer),
                    &wanted.scene,
                    path,
                    kind,
                    (wanted.exposure, wanted.tonemap),
                    &[],
                )
            });
            notices.push(match written {
                Ok(()) => Notice::Written { path: path.clone(), size: wanted.size, frames: painter.frames },
                Err(error) => Notice::Failed(error.to_string()),
            });
            false
        });
        if !notices.is_empty() {
            lock(&self.shared.notices).extend(notices);
            (self.shared.wake)();
        }
    }
}

impl Drop for Worker<'_> {
    fn drop(&mut self) {
        tracing::debug!("the rendering thread ends on {}", self.gpu.device_name());
    }
}
