//! `--target-ms` and `--target-flip` choose settings from measured points.

use super::{
    common::PictureArgs,
    progress::progress,
    signals::{interrupted, nothing_to_keep},
};
use crate::{
    Error, Result,
    gpu::Gpu,
    measure::choice::{Candidate, Choice, Expected, Sheet, Target, choose, quick, store::Store},
    options::RenderOptions,
    reference::{cache::Keep, capture::cache_folder},
    scene::Scene,
    settings::Method,
};

/// The flags of the targets.
#[derive(Clone, Debug, clap::Args)]
pub struct TargetArgs {
    /// Choose the most accurate settings that take at most T GPU milliseconds a frame on this device; with
    /// --target-flip, the cheapest settings of that error, if they are fast enough
    #[arg(long, value_name = "T", allow_hyphen_values = true)]
    pub target_ms: Option<String>,
    /// Choose the cheapest settings whose error is at most F; the error is FLIP over virtual or influenced
    /// pixels, whichever is larger, after 16 still frames (see docs/plan.md)
    #[arg(long, value_name = "F", allow_hyphen_values = true)]
    pub target_flip: Option<String>,
}

/// The chosen settings, and what they were chosen from.
#[derive(Clone, Debug, serde::Serialize)]
pub struct Chosen {
    /// What was asked for.
    pub target: Target,
    /// The chosen settings as the command line takes them.
    pub flags: String,
    /// The time and the error that are predicted for them.
    pub predicted: Expected,
    /// Width and height of the pictures that were measured, pixels.
    pub measured_at: [u32; 2],
    /// Number of measured candidates.
    pub candidates: usize,
    /// The name of the truth that errors are measured against.
    pub truth: String,
    /// That truth's own error.
    pub noise: f64,
    /// One line for each target that is out of reach.
    pub warnings: Vec<String>,
}

impl TargetArgs {
    /// # Errors
    /// Fails if a target is not a positive number.
    pub fn target(&self) -> Result<Option<Target>> {
        let ms = number(self.target_ms.as_deref(), "--target-ms", "milliseconds a frame, for example 33")?;
        let flip = number(self.target_flip.as_deref(), "--target-flip", "an error, for example 0.08")?;
        Ok((ms.is_some() || flip.is_some()).then_some(Target { ms, flip }))
    }

    /// If a target was given, chooses settings for it and puts them into `options`. The candidates are
    /// measured first if none are kept for this view. `video` says whether each frame shows a new video
    /// frame.
    ///
    /// # Errors
    /// Fails for `--method reference`, whose quality is its number of paths. Fails if something cannot be
    /// rendered, or if it is interrupted.
    pub fn apply(
        &self,
        gpu: &Gpu,
        scene: &Scene,
        picture: &PictureArgs,
        options: &mut RenderOptions,
        exposure: f32,
        video: bool,
    ) -> Result<Option<Chosen>> {
        let Some(target) = self.target()? else { return Ok(None) };
        if options.method == Method::Reference && picture.method.is_some() {
            return Err(Error::input(
                "--method",
                "reference has no settings to choose: its error falls with --spp",
                "give iprt, paper or ibl, or leave it out",
            ));
        }
        let cache = cache_folder();
        let store = Store::of(gpu, scene, options, exposure, cache.as_deref())?;
        let pixels = |sheet: &Sheet| f64::from(sheet.size[0]) * f64::from(sheet.size[1]);
        let asked = f64::from(options.size[0]) * f64::from(options.size[1]);
        let apart = |sheet: &Sheet| (pixels(sheet) / asked).ln().abs();
        let kept = store.load().into_iter().filter(|sheet| sheet.serves(options.size));
        let sheet = match kept.min_by(|a, b| apart(a).total_cmp(&apart(b))) {
            Some(sheet) => sheet,
            None => measure(gpu, scene, picture, options, exposure, &store)?,
        };
        let method = picture.method.as_ref().map(|_| options.method.name());
        let video = video && scene.panorama.frame_count() > 1;
        let expected = sheet.expected(method.as_deref(), options.size, video);
        let Some(choice) = choose(&expected, target) else {
            let problem = format!("no settings were measured for method {}", options.method.name());
            return Err(Error::input("--method", problem, "leave it out, or leave the target out"));
        };
        let candidate = &sheet.candidates[choice.index];
        options.method = Method::parse(&candidate.method, "measured points")?;
        let set: Vec<_> = candidate.set.iter().map(|(name, value)| (name.as_str(), value.as_str())).collect();
        options.settings = quick::settings(options.method, &options.settings, &set)?;
        let chosen = Chosen::new(target, &choice, candidate, &sheet, &expected);
        if !picture.quiet {
            chosen.warnings.iter().for_each(|warning| super::say(&format!("warning: {warning}")));
        }
        Ok(Some(chosen))
    }
}

fn measure(
    gpu: &Gpu,
    scene: &Scene,
    picture: &PictureArgs,
    options: &RenderOptions,
    exposure: f32,
    store: &Store,
) -> Result<Sheet> {
    let lit = scene.instance_count() > 0 && !options.without_objects;
    let complete = match lit && picture.room_known(scene) {
        true => {
            let without = PictureArgs { without_objects: true, quiet: true, ..picture.clone() };
            Some([picture.complete_scene()?, without.complete_scene()?])
        }
        false => None,
    };
    if !picture.quiet {
        let [width, height] = quick::size(options.size);
        super::say(&format!("target: nothing was measured for this view yet; measuring at {width}×{height}, once"));
    }
    let bar = progress(picture.quiet, quick::work(complete.is_some(), lit, &options.settings), "measuring");
    let cache = cache_folder();
    let keep = Keep { folder: cache.as_deref(), stop: interrupted() };
    let sheet = quick::measure(gpu, scene, complete.as_ref(), options, exposure, keep, store, &mut || bar.inc(1));
    bar.finish_and_clear();
    nothing_to_keep();
    sheet
}

impl Chosen {
    fn new(target: Target, choice: &Choice, candidate: &Candidate, sheet: &Sheet, expected: &[Expected]) -> Self {
        let least =
            |of: fn(&Expected) -> f64| expected.iter().map(of).filter(|v| v.is_finite()).fold(f64::INFINITY, f64::min);
        let mut warnings = Vec::new();
        if let Some(flip) = target.flip.filter(|_| !choice.reached.flip) {
            let best = least(|e| e.flip);
            let remedy = match best <= flip {
                true => "give more time, or a larger error".to_owned(),
                false => format!("give {:.3} or more, or another --method or --set", up(best)),
            };
            let found =
                format!("the least measured is {best:.3} (two halves of the truth differ by {:.3})", sheet.noise);
            warnings.push(format!("--target-flip {flip}: out of reach: {found}; {remedy}"));
        }
        if let Some(ms) = target.ms.filter(|_| !choice.reached.ms) {
            let found = format!("the fastest settings are predicted to take {:.1} ms at this size", least(|e| e.ms));
            warnings.push(format!("--target-ms {ms}: out of reach: {found}; give more time, or a smaller --size"));
        }
        Self {
            target,
            flags: candidate.flags(),
            predicted: choice.expected,
            measured_at: sheet.size,
            candidates: expected.iter().filter(|e| e.ms.is_finite() && e.flip.is_finite()).count(),
            truth: sheet.truth.clone(),
            noise: sheet.noise,
            warnings,
        }
    }

    /// Prints the choice on stderr.
    pub fn say(&self, quiet: bool) {
        if !quiet {
            super::say(&self.text());
        }
    }

    /// The choice in one line.
    pub fn text(&self) -> String {
        let Expected { ms, flip } = self.predicted;
        let [width, height] = self.measured_at;
        format!(
            "target: {}; predicted {ms:.1} ms a frame, FLIP {flip:.3} against {} ({} candidates measured at {width}×{height})",
            self.flags, self.truth, self.candidates
        )
    }
}

/// Rounds up to three decimals.
fn up(flip: f64) -> f64 {
    (flip * 1e3).ceil() * 1e-3
}

fn number(text: Option<&str>, flag: &str, example: &str) -> Result<Option<f64>> {
    let Some(text) = text else { return Ok(None) };
    match text.trim().parse::<f64>() {
        Ok(value) if value.is_finite() && value > 0.0 => Ok(Some(value)),
        _ => Err(Error::input(flag, format!("\"{text}\" is no positive number"), format!("give {example}"))),
    }
}
