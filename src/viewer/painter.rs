//! Paints one of the two pictures. A painter has a renderer, the size that keeps the frame time, and the
//! images that the window copies.

use super::state::{Compare, RenderedPicture, Side, Wanted};
use crate::{
    Error, Result,
    gpu::{FrameOptions, Gpu, Image, Pieces, Ticket, Timings},
    options::RenderOptions,
    passes::display::{Display, Input, Meaning},
    plan::Plan,
    renderer::{Begun, Renderer, Wishes},
    scene::{Scene, packed::PackedScene, viewpoint::Projection},
};
use std::{
    collections::VecDeque,
    sync::Arc,
    time::{Duration, Instant},
};

/// Factors by which the picture may be smaller than it should be, each way.
const SHRINK: [f64; 9] = [1.0, 1.5, 2.0, 3.0, 4.0, 6.0, 8.0, 12.0, 16.0];
/// Milliseconds a pixel that are assumed before anything was measured.
const GUESS: f64 = 4e-3;
/// A frame that is expected to take longer is submitted in pieces, milliseconds.
const SHORT: f64 = 20.0;

/// Frame time of the picture that is shown first when a still picture in full size takes more than twice as
/// long, milliseconds.
const BETWEEN: f64 = 500.0;

/// How much time a frame is given, from the least to the most.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub enum Pace {
    /// As much as is asked for while things move.
    Quick,
    /// Half a second, on the way from a quick picture to a slow one.
    Between,
    /// As much as the full size takes.
    Full,
}

impl Pace {
    /// Milliseconds that a frame may take, or `None` if there is no limit.
    fn target(self, wanted: &Wanted) -> Option<f64> {
        let share = if wanted.compare == Compare::Single { 1.0 } else { 0.5 };
        match self {
            Self::Quick => Some(share * wanted.target_ms),
            Self::Between => Some(share * BETWEEN),
            Self::Full => None,
        }
    }
}

/// A renderer of one picture, and what is known of its frames.
pub struct Painter {
    gpu: Gpu,
    pieces: Pieces,
    renderer: Option<Renderer>,
    made_for: Option<(Arc<PackedScene>, Side)>,
    view: Option<Wanted>,
    /// Number of frames of this view and size.
    pub frames: u32,
    /// The pace that this view has reached.
    reached: Option<Pace>,
    cost: CostModel,
    frame_ms: f64,
    timings: Arc<Timings>,
    held_relight: bool,
    /// Whether the last frame was submitted in pieces, which are timed by the clock.
    by_clock: bool,
    /// Whether something has moved since the relit panorama began to accumulate. The next picture in full
    /// size then begins anew.
    stale: bool,
    /// Whether all frames since the last fresh start had the full size and all passes.
    pure: bool,
    /// Frames that the device has and that are not collected.
    in_flight: VecDeque<InFlight>,
    /// When the last frame was collected.
    ended: Option<Instant>,
    /// The last picture that was made for the window.
    displayed: Option<Ticket>,
    images: Vec<Image>,
    /// Whether the renderer shows the real scene alone, until the renderer that was asked for is made.
    preview: bool,
}

/// A frame that was begun.
struct InFlight {
    begun: Begun,
    start: Instant,
    size: [u32; 2],
    /// Whether it is the first frame of a new renderer.
    built: bool,
    /// Whether it was submitted in pieces, which are timed by the clock.
    by_clock: bool,
    hold_relight: bool,
}

/// A model of the time that a frame takes: a constant part, and a part for each pixel, milliseconds.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
struct CostModel {
    a_pixel: Option<f64>,
    relight: f64,
    shrink: usize,
}

impl CostModel {
    /// The size that keeps the target, in milliseconds.
    fn size(&mut self, full: [u32; 2], target: f64, relight: f64) -> [u32; 2] {
        let pixels = f64::from(full[0]) * f64::from(full[1]);
        let a_pixel = self.a_pixel.unwrap_or(GUESS);
        let takes = |shrink: f64| relight + a_pixel * pixels / (shrink * shrink);
        // A size that keeps it stays, so that the size does not go up and down.
        let now = takes(SHRINK[self.shrink]);
        if now > 1.25 * target || now < 0.4 * target {
            self.shrink = SHRINK.iter().position(|s| takes(*s) <= target).unwrap_or(SHRINK.len() - 1);
        }
        full.map(|side| ((f64::from(side) / SHRINK[self.shrink]).round() as u32).max(side.min(16)))
    }

    /// Milliseconds that a frame is expected to take.
    fn of(&self, size: [u32; 2]) -> f64 {
        self.relight + self.a_pixel.unwrap_or(GUESS) * f64::from(size[0]) * f64::from(size[1])
    }

    fn learn(&mut self, frame_ms: f64, relight: f64, size: [u32; 2]) {
        if relight > 0.0 {
            self.relight = relight;
        }
        let seen = (frame_ms - relight).max(1e-3) / (f64::from(size[0]) * f64::from(size[1]));
        self.a_pixel = Some(self.a_pixel.map_or(seen, |known| 0.6 * known + 0.4 * seen));
    }
}

impl Painter {
    /// Makes a painter. It makes its renderer at the first step.
    pub fn new(gpu: &Gpu, pieces: &Pieces) -> Self {
        Self {
            gpu: gpu.clone(),
            pieces: pieces.clone(),
            renderer: None,
            made_for: None,
            view: None,
            frames: 0,
            reached: None,
            cost: CostModel::default(),
            frame_ms: 0.0,
            timings: Arc::default(),
            held_relight: false,
            by_clock: false,
            stale: false,
            pure: false,
            in_flight: VecDeque::new(),
            ended: None,
            displayed: None,
            images: Vec::new(),
            preview: false,
        }
    }

    /// The renderer, once there is one.
    pub fn renderer(&self) -> Option<&Renderer> {
        self.renderer.as_ref()
    }

    /// Whether the last picture has the size that was asked for.
    pub fn is_full(&self, wanted: &Wanted) -> bool {
        self.renderer.as_ref().is_some_and(|renderer| renderer.options().size == wanted.size)
    }

    fn is_made_for(&self, wanted: &Wanted, side: &Side) -> bool {
        self.made_for.as_ref().is_some_and(|(packed, made)| Arc::ptr_eq(packed, &wanted.scene.packed) && made == side)
    }

    /// The pace of the next frame of this view, if the view stands still.
    pub fn next(&self, wanted: &Wanted, side: &Side) -> Pace {
        let known = self.is_made_for(wanted, side) && self.view.as_ref().is_some_and(|view| view.same_view(wanted));
        match self.reached.filter(|_| known) {
            None => Pace::Quick,
            Some(Pace::Quick) if self.cost.of(wanted.size) > 2.0 * BETWEEN => Pace::Between,
            Some(_) => Pace::Full,
        }
    }

    fn holds_relight(&self, wanted: &Wanted, pace: Pace) -> bool {
        pace.target(wanted).is_some_and(|target| self.cost.relight > 0.25 * target)
    }

    /// The size in which a frame takes no longer than it may, pixels.
    pub fn size(&mut self, wanted: &Wanted, pace: Pace) -> [u32; 2] {
        let relight = if self.holds_relight(wanted, pace) { 0.0 } else { self.cost.relight };
        pace.target(wanted).map_or(wanted.size, |target| self.cost.size(wanted.size, target, relight))
    }

    /// Renders one frame of this size, if another frame is worthwhile. Returns whether it did.
    ///
    /// # Errors
    /// Fails with [`Error::Interrupted`] if something newer is to be shown, and fails if the renderer fails.
    pub fn step(&mut self, wanted: &Wanted, side: &Side, pace: Pace, size: [u32; 2]) -> Result<bool> {
        let scene = &wanted.scene;
        if self.made_for.is_none() && !self.preview {
            self.show_real_scene(wanted, side)?;
            return Ok(true);
        }
        let built = !self.is_made_for(wanted, side);
        if built {
            let start = Instant::now();
            self.rebuild(wanted, side, size)?;
            tracing::debug!("a renderer was made, {:.2} s", start.elapsed().as_secs_f64());
        }
        let seen = self.view.as_ref().is_some_and(|view| view.same_view(wanted));
        let hold_relight = self.holds_relight(wanted, pace);
        let Some(renderer) = &mut self.renderer else { return Ok(false) };
        let resized = renderer.options().size != size;
        if resized {
            renderer.set_size(size)?;
        }
        let restarted = self.view.as_ref().is_none_or(|view| view.restart != wanted.restart);
        let moved = |view: &Wanted| {
            let places = |scene: &Scene| scene.objects().map(|object| object.placement.clone()).collect::<Vec<_>>();
            view.time != wanted.time || places(&view.scene) != places(&wanted.scene)
        };
        self.stale |= restarted || self.view.as_ref().is_some_and(moved);
        self.pure &= !resized;
        let fresh = restarted || (self.stale && pace == Pace::Full && !self.pure);
        if fresh {
            renderer.restart();
        }
        self.stale &= pace != Pace::Full;
        self.pure = (self.pure || fresh) && size == wanted.size && !hold_relight;
        if !seen || resized || built || fresh {
            self.frames = 0;
        }
        if self.frames >= side.enough() {
            self.collect(0)?;
            return Ok(false);
        }
        self.view = Some(wanted.clone());
        let pieces = (built || self.cost.of(size) > SHORT).then(|| self.pieces.clone());
        let by_clock = pieces.is_some();
        let wishes = Wishes { hold_relight, submission: FrameOptions { pieces, ..FrameOptions::default() } };
        let start = Instant::now();
        let begun = renderer.begin(scene, wanted.time, &wishes);
        let collected = begun.and_then(|begun| {
            self.in_flight.push_back(InFlight { begun, start, size, built, by_clock, hold_relight });
            // While something moves, the newest picture counts. Afterwards the device always has a next frame,
            // unless frames are submitted in pieces: those have run by now.
            self.collect(if pace == Pace::Quick || by_clock { 0 } else { 1 })
        });
        if let Err(error) = collected {
            if let Some(renderer) = &mut self.renderer {
                renderer.restart();
            }
            self.frames = 0;
            self.view = None;
            return Err(error);
        }
        self.frames += 1;
        self.reached = Some(pace);
        Ok(true)
    }

    /// Waits for frames until at most so many are in flight.
    fn collect(&mut self, most: usize) -> Result<()> {
        let Some(renderer) = &mut self.renderer else { return Ok(()) };
        while self.in_flight.len() > most {
            let Some(InFlight { begun, start, size, built, by_clock, hold_relight }) = self.in_flight.pop_front()
            else {
                break;
            };
            let timings = renderer.collect(begun)?;
            (self.by_clock, self.held_relight) = (by_clock, hold_relight);
            // A frame that was begun before the last one ended had to wait for that.
            let start = self.ended.filter(|ended| *ended > start).unwrap_or(start);
            self.ended = Some(Instant::now());
            self.frame_ms = start.elapsed().as_secs_f64() * 1e3;
            // The first frame compiles shaders and prepares the panorama, so its time does not count.
            if built {
                tracing::debug!("its first frame of {size:?}, {:.2} s", self.frame_ms * 1e-3);
            } else {
                self.cost.learn(timings.gpu_ms, timings.pass("relight").unwrap_or_default(), size);
            }
            self.timings = Arc::new(timings);
        }
        Ok(())
    }

    /// Shows the panorama without objects. It takes few pipelines and little time, so it is seen at once,
    /// while the other pipelines are made.
    fn show_real_scene(&mut self, wanted: &Wanted, side: &Side) -> Result<()> {
        self.preview = true; // once, also where it fails
        let mut renderer = Renderer::new(&self.gpu, &wanted.scene, options(wanted.size, side, true))?;
        let start = Instant::now();
        self.timings = Arc::new(renderer.render(&wanted.scene, wanted.time)?);
        self.frame_ms = start.elapsed().as_secs_f64() * 1e3;
        self.renderer = Some(renderer);
        Ok(())
    }

    /// A renderer like the present one, with pipelines of the shaders as they are now.
    ///
    /// # Errors
    /// Fails if a shader does not fit, or if there is not enough memory.
    #[cfg(debug_assertions)]
    pub fn remade(&self, wanted: &Wanted) -> Result<Option<Renderer>> {
        let remake =
            |old: &Renderer| Renderer::with_plan(&self.gpu, &wanted.scene, old.options().clone(), old.plan().clone());
        self.renderer.as_ref().map(remake).transpose()
    }

    /// Paints with another renderer from now on, and accumulates anew.
    #[cfg(debug_assertions)]
    pub fn replace(&mut self, renderer: Option<Renderer>) {
        self.in_flight.clear();
        self.renderer = renderer;
        (self.view, self.reached, self.frames) = (None, None, 0);
    }

    fn rebuild(&mut self, wanted: &Wanted, side: &Side, size: [u32; 2]) -> Result<()> {
        self.in_flight.clear();
        self.renderer = None;
        self.made_for = None;
        let options = options(size, side, false);
        let plan = Plan::interactive(&wanted.scene, &options, SHRINK[SHRINK.len() - 1] as f32)?;
        self.renderer = Some(Renderer::with_plan(&self.gpu, &wanted.scene, options, plan)?);
        self.made_for = Some((Arc::clone(&wanted.scene.packed), side.clone()));
        self.preview = false;
        Ok(())
    }

    /// The last frame as the window shows it. `other` is the picture that it is compared with.
    ///
    /// # Errors
    /// Fails if there is no such image, or if the device is lost.
    pub fn picture(
        &mut self,
        display: &Display,
        wanted: &Wanted,
        other: Option<&Image>,
        serial: u64,
    ) -> Result<Option<RenderedPicture>> {
        let Some(renderer) = &mut self.renderer else { return Ok(None) };
        let marked = if wanted.mark_unknown && renderer.frames() > 0 { Some(renderer.unknown()?) } else { None };
        let name = if other.is_some() { "radiance" } else { wanted.aov.as_str() };
        let known = renderer.aov_names().iter().any(|known| known == name);
        let shown = if known { name } else { "radiance" };
        let source = renderer.shown(shown)?;
        let panorama = &wanted.scene.panorama;
        let input = Input {
            source,
            other,
            look: if other.is_some() { Meaning::Difference } else { Meaning::of(name) },
            exposure: wanted.exposure,
            tonemap: wanted.tonemap,
            raised: [panorama.inverse_tonemap, panorama.exposure()],
            marked: marked.as_ref(),
        };
        let size = renderer.options().size;
        self.images.retain(|image| image.size() == size || image.is_shared());
        let free = self.images.iter().find(|image| image.size() == size && !image.is_shared());
        let image = match free {
            Some(image) => image.clone(),
            None => Display::picture(&self.gpu, size)?,
        };
        let mut frame = self.gpu.frame()?;
        display.record(&mut frame, &input, &image)?;
        // The window's own frame comes after this one, so the picture need not be finished to be handed over.
        if let Some(before) = self.displayed.replace(frame.submit()?) {
            before.wait()?;
        }
        if !self.images.iter().any(|known| known.same(&image)) {
            self.images.push(image.clone());
        }
        Ok(Some(RenderedPicture {
            image,
            size,
            full: wanted.size,
            aov: shown.to_owned(),
            marked: marked.is_some(),
            frames: self.frames,
            frame_ms: self.frame_ms,
            timings: Arc::clone(&self.timings),
            by_clock: self.by_clock,
            time: wanted.time,
            held_relight: self.held_relight,
            preview: self.preview,
            serial,
            number: wanted.number,
        }))
    }

    /// Frees all that the painter holds.
    pub fn clear(&mut self) {
        *self = Self::new(&self.gpu, &self.pieces);
    }
}

fn options(size: [u32; 2], side: &Side, without_objects: bool) -> RenderOptions {
    RenderOptions {
        size,
        method: side.method,
        settings: side.settings.clone(),
        projection: Projection::Perspective,
        seed: 0,
        without_objects,
        eye: 0.0,
    }
}

/// Whether the error is the end of a frame that something newer made useless.
pub fn interrupted(error: &Error) -> bool {
    matches!(error, Error::Interrupted { .. })
}

/// How long after a change the next change is expected.
pub const SETTLED: Duration = Duration::from_millis(250);

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_size_holds_the_frame_time() {
        let mut cost = CostModel::default();
        for (a_pixel, relight) in [(1e-6, 0.0), (1e-4, 5.0), (3e-3, 0.0), (3e-3, 30.0)] {
            cost.a_pixel = Some(a_pixel);
            let size = cost.size([1280, 720], 66.0, relight);
            let takes = relight + a_pixel * f64::from(size[0] * size[1]);
            assert!(takes <= 1.25 * 66.0, "{a_pixel}: {size:?} takes {takes} ms");
            assert!(takes >= 0.3 * 66.0 || size == [1280, 720], "{a_pixel}: {size:?} is too small, {takes} ms");
        }
    }

    #[test]
    fn what_was_measured_counts() {
        let mut cost = CostModel::default();
        for _ in 0..20 {
            cost.learn(110.0, 10.0, [100, 100]);
        }
        assert!((cost.a_pixel.unwrap() - 0.01).abs() < 1e-4);
        assert_eq!(cost.relight, 10.0);
        cost.learn(100.0, 0.0, [100, 100]);
        assert_eq!(cost.relight, 10.0, "held, not free");
    }
}
