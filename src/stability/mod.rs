//! The stability suite: short sequences in which methods of this kind fail. `docs/stability.md` says what
//! each case asks and what was measured.
//!
//! The truth of a [`Case`] is computed if that is possible ([`world`]). Otherwise the case asks for an
//! invariant: a turned panorama, a repeat with the same seed, or an equilibrium. The tests break the
//! renderer on purpose, and each case must notice.

pub mod cases;
pub mod film;
pub mod metric;
pub mod pattern;
pub mod report;
pub mod world;

#[cfg(feature = "faults")]
use crate::passes::fault::Fault;
use crate::{
    Result,
    gpu::Gpu,
    options::RenderOptions,
    renderer::Renderer,
    scene::{Scene, viewpoint::Projection},
    settings::{Method, Settings},
};
use film::Film;
use metric::Texels;
use std::{
    collections::HashMap,
    sync::{Arc, Mutex, PoisonError},
};
use world::WorldTruth;

/// The methods that a run takes by default, in the order of the tables.
pub const METHODS: [Method; 3] = [Method::Ibl, Method::Paper, Method::Iprt];

/// A case of the suite: one question.
#[derive(Clone, Copy)]
pub struct Case {
    /// The name on the command line.
    pub name: &'static str,
    /// The question, in a sentence.
    pub asks: &'static str,
    /// What the number means.
    pub metric: &'static str,
    /// The number's unit, or empty.
    pub unit: &'static str,
    /// The largest value that passes.
    pub limit: f64,
    /// The reason for this limit.
    pub reason: &'static str,
    /// Methods that must fail according to theory.
    pub must_fail: &'static [Method],
    /// Runs the case.
    pub run: fn(&Run) -> Result<Outcome>,
}

/// A renderer that is broken on purpose.
#[cfg(feature = "faults")]
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Broken {
    Planted(Fault),
    Setting(&'static str, &'static str),
}

/// The result of a case for one method.
#[derive(Clone, Debug)]
pub struct Outcome {
    /// The number, or [`metric::NOT_FINITE`] if a picture is not finite.
    pub value: f64,
    /// Width and height of the pictures.
    pub size: [u32; 2],
    /// The worst frame.
    pub worst: Texels,
    /// What that frame should be.
    pub truth: Texels,
    /// The factor on radiance with which they are shown.
    pub exposure: f32,
}

/// What the runs of a suite share: the device with its passes, and the truths.
pub struct Suite {
    gpu: Gpu,
    quick: bool,
    set: Vec<(String, String)>,
    truths: Mutex<HashMap<(&'static str, usize), Arc<WorldTruth>>>,
}

impl Suite {
    /// Makes a suite on a device. `quick` takes smaller pictures and fewer frames.
    pub fn new(gpu: &Gpu, quick: bool) -> Self {
        Self { gpu: gpu.keeping_passes(), quick, set: Vec::new(), truths: Mutex::default() }
    }

    /// Changes settings of every method.
    ///
    /// # Errors
    /// Fails if a setting is unknown or a value is bad.
    pub fn with(mut self, set: &[(&str, &str)]) -> Result<Self> {
        let mut settings = Settings::of(Method::Iprt);
        set.iter().try_for_each(|(name, value)| settings.set(name, value, "--set"))?;
        self.set = set.iter().map(|(name, value)| ((*name).to_owned(), (*value).to_owned())).collect();
        Ok(self)
    }

    /// Runs a case.
    ///
    /// # Errors
    /// Fails if a picture cannot be rendered.
    pub fn run(&self, case: &Case, method: Method) -> Result<Outcome> {
        (case.run)(&Run {
            suite: self,
            case: case.name,
            method,
            #[cfg(feature = "faults")]
            broken: None,
        })
    }

    /// Runs a case with a renderer that is broken.
    ///
    /// # Errors
    /// Fails if a picture cannot be rendered.
    #[cfg(feature = "faults")]
    pub fn run_broken(&self, case: &Case, method: Method, broken: Broken) -> Result<Outcome> {
        (case.run)(&Run { suite: self, case: case.name, method, broken: Some(broken) })
    }
}

/// A case that is being run.
pub struct Run<'a> {
    suite: &'a Suite,
    case: &'static str,
    /// The method that is tried.
    pub method: Method,
    /// What is broken in the renderer.
    #[cfg(feature = "faults")]
    broken: Option<Broken>,
}

impl Run<'_> {
    /// Returns the usual picture's size, pixels.
    pub fn size(&self) -> [u32; 2] {
        if self.suite.quick { [48, 32] } else { [96, 64] }
    }

    /// Returns a number that is smaller in quick runs.
    pub fn count(&self, full: usize, quick: usize) -> usize {
        if self.suite.quick { quick } else { full }
    }

    /// Returns the device.
    pub fn gpu(&self) -> &Gpu {
        &self.suite.gpu
    }

    /// Returns the method's settings, changed by the case, then by the suite, and last by what is broken.
    ///
    /// # Errors
    /// Fails if a setting is unknown.
    pub fn options(&self, size: [u32; 2], set: &[(&str, &str)]) -> Result<RenderOptions> {
        let mut settings = Settings::of(self.method);
        if self.suite.quick {
            settings.relight_width = settings.relight_width.min(64);
        }
        for (name, value) in set {
            settings.set(name, value, self.case)?;
        }
        for (name, value) in &self.suite.set {
            settings.set(name, value, self.case)?;
        }
        #[cfg(feature = "faults")]
        if let Some(Broken::Setting(name, value)) = self.broken {
            settings.set(name, value, self.case)?;
        }
        let projection = Projection::Perspective;
        Ok(RenderOptions { size, method: self.method, settings, projection, seed: 1, without_objects: false, eye: 0.0 })
    }

    /// Makes a renderer for a scene.
    ///
    /// # Errors
    /// Fails if the renderer cannot be made.
    pub fn renderer(&self, scene: &Scene, options: RenderOptions) -> Result<Renderer> {
        #[cfg(feature = "faults")]
        if let Some(Broken::Planted(fault)) = self.broken {
            return Renderer::with_fault(self.gpu(), scene, options, fault);
        }
        Renderer::new(self.gpu(), scene, options)
    }

    /// Renders every frame of a film.
    ///
    /// # Errors
    /// Fails if a frame cannot be rendered.
    pub fn play(&self, film: &Film) -> Result<Vec<Texels>> {
        let mut pictures = Vec::with_capacity(film.frames);
        self.watch(film, |renderer| {
            pictures.push(renderer.picture()?);
            Ok(())
        })?;
        Ok(pictures)
    }

    /// Renders a film, and shows the renderer after each frame.
    ///
    /// # Errors
    /// Fails if a frame cannot be rendered.
    pub fn watch(&self, film: &Film, mut look: impl FnMut(&Renderer) -> Result<()>) -> Result<()> {
        let scene = film.scene()?;
        let mut renderer = self.renderer(&scene, self.options(film.size, &film.set)?)?;
        let warmup = if self.method == Method::Reference { 256 } else { film.warmup };
        for _ in 0..warmup {
            renderer.render(&scene, 0.0)?;
        }
        for n in 0..film.frames {
            renderer.render(&scene, film.time(n))?;
            look(&renderer)?;
        }
        Ok(())
    }

    /// Returns the truth of a frame, computed once for all methods. `which` numbers the films of a case.
    pub fn truth(&self, film: &Film, which: usize, frame: usize) -> Arc<WorldTruth> {
        let key = (self.case, which * 100_000 + frame);
        let known = self.suite.truths.lock().unwrap_or_else(PoisonError::into_inner).get(&key).cloned();
        known.unwrap_or_else(|| {
            let truth = Arc::new(film.truth(frame));
            self.suite.truths.lock().unwrap_or_else(PoisonError::into_inner).insert(key, truth.clone());
            truth
        })
    }

    /// Renders a film and returns the worst value of some of its frames.
    ///
    /// # Errors
    /// Fails if a frame cannot be rendered, or if `value` fails.
    pub fn worst(
        &self,
        film: &Film,
        frames: impl IntoIterator<Item = usize>,
        value: impl Fn(&Texels, &WorldTruth) -> Result<f64>,
    ) -> Result<Outcome> {
        let pictures = self.play(film)?;
        let mut worst: Option<Outcome> = None;
        for n in frames {
            let truth = self.truth(film, 0, n);
            let value = value(&pictures[n], &truth)?;
            if worst.as_ref().is_none_or(|w| value > w.value) {
                let (worst_picture, truth) = (pictures[n].clone(), truth.texels.clone());
                worst = Some(Outcome { value, size: film.size, worst: worst_picture, truth, exposure: 1.0 });
            }
        }
        worst.ok_or_else(|| crate::Error::Internal(format!("{}: no frame is measured", self.case)))
    }
}
