//! Measures a few candidates within about a minute, for a view that no chart has measured.

use super::{Candidate, FRAMES, Sheet, error, fixed_shares, store::Store};
use crate::{
    Result,
    gpu::Gpu,
    measure::{
        clock::{FrameClock, Round, WARM_UP},
        regions::{self, Regions, of_scene},
        score::{RealView, TruthKind, Yardstick, real_view},
    },
    options::RenderOptions,
    reference::cache::{Keep, truth_of_model, truth_of_scene},
    renderer::Renderer,
    scene::{CompleteScene, Scene},
    settings::{Method, Settings},
};
use std::collections::BTreeMap;

/// Largest number of pixels of a measured picture.
const PIXELS: f64 = 160.0 * 90.0;
/// Samples a pixel of scene truth.
const SCENE_SPP: u32 = 64;
/// Paths a pixel of model truth, which is used if the true scene is not known.
const MODEL_SPP: u32 = 64;
/// Number of frames for which the relit panorama of model truth is accumulated first.
const MODEL_WARM_UP: &str = "16";
/// Samples of the filtered truths that the regions come from.
const REGION_SPP: u32 = 16;
/// Number of frames that are rendered for times alone, including the warm-up.
const TIMED: u32 = 10;

/// Settings over a preset.
type Set = &'static [(&'static str, &'static str)];

/// The candidates, from little work to much.
const TRIED: &[(Method, Set)] = &[
    (Method::Ibl, &[]),
    (Method::Ibl, &[("atrous_levels", "2")]),
    (Method::Paper, &[]),
    (Method::Paper, &[("atrous_levels", "2")]),
    (Method::Iprt, &[("relight_levels", "0"), ("atrous_levels", "2"), ("rays_per_pixel", "0.0625")]),
    (Method::Iprt, &[("relight_levels", "0"), ("atrous_levels", "2")]),
    (Method::Iprt, &[("relight_levels", "0")]),
    (Method::Iprt, &[("relight_levels", "0"), ("rays_per_pixel", "1")]),
    (Method::Iprt, &[("relight_width", "128"), ("atrous_levels", "2")]),
    (Method::Iprt, &[("relight_width", "128"), ("atrous_levels", "2"), ("rays_per_pixel", "1")]),
    (Method::Iprt, &[("relight_width", "128")]),
    (Method::Iprt, &[]),
    (Method::Iprt, &[("rays_per_pixel", "0.5")]),
    (Method::Iprt, &[("rays_per_pixel", "1")]),
];

/// The size that is measured for pictures of a size. It has their shape, and is not larger than they are.
pub fn size(of: [u32; 2]) -> [u32; 2] {
    let scale = (PIXELS / super::pixels(of)).sqrt().min(1.0);
    of.map(|side| ((f64::from(side) * scale).round() as u32).max(1))
}

/// How often [`measure`] calls `tick`.
pub fn work(known: bool, lit: bool, given: &Settings) -> u64 {
    let truth = match (lit, known) {
        (false, _) => 0,
        (true, true) => 2 * (SCENE_SPP + REGION_SPP),
        (true, false) => MODEL_SPP,
    };
    u64::from(truth + TIMED) + tried(given, lit).len() as u64 * u64::from(FRAMES)
}

/// The candidates of [`TRIED`] that change no setting which was given. Without objects one candidate is
/// enough, since all are alike.
fn tried(given: &Settings, lit: bool) -> Vec<(Method, Set)> {
    let free = |set: Set| set.iter().all(|(name, _)| !given.given.contains(name));
    match lit {
        true => TRIED.iter().filter(|(_, set)| free(set)).copied().collect(),
        false => vec![(Method::Iprt, &[])],
    }
}

/// Measures the candidates that the sheet in `store` lacks, on still pictures of the scene's first frame as
/// `options` ask for it. It measures their errors after [`FRAMES`] frames and their times, and the time of
/// one at twice the width and height. `complete` is the true scene with and without objects, if it is known.
/// Each result is in `store` before the next one is begun.
///
/// # Errors
/// Fails if the renderer fails, or with [`Error::Interrupted`](crate::Error::Interrupted) if it is stopped.
#[allow(clippy::too_many_arguments, reason = "each is one thing that a measurement depends on")]
pub fn measure(
    gpu: &Gpu,
    scene: &Scene,
    complete: Option<&[CompleteScene; 2]>,
    options: &RenderOptions,
    exposure: f32,
    keep: Keep,
    store: &Store,
    tick: &mut dyn FnMut(),
) -> Result<Sheet> {
    let base = RenderOptions { size: size(options.size), seed: 0, ..options.clone() };
    let target = Baseline::new(gpu, scene, complete, &base, exposure, keep, tick)?;
    let kept = store.load().into_iter().find(|sheet| sheet.size == base.size && sheet.truth == target.truth.0);
    let mut sheet = kept.unwrap_or_else(|| Sheet {
        size: base.size,
        truth: target.truth.0.clone(),
        noise: error(&target.truth.1.noise),
        fixed: BTreeMap::new(),
        complete: false,
        candidates: Vec::new(),
    });
    let lit = scene.instance_count() > 0 && !options.without_objects;
    for (method, set) in tried(&options.settings, lit) {
        let name: BTreeMap<String, String> = set.iter().map(|(k, v)| ((*k).to_owned(), (*v).to_owned())).collect();
        if sheet.candidates.iter().any(|known| known.method == method.name() && known.set == name) {
            (0..FRAMES).for_each(|_| tick());
            continue;
        }
        let settings = settings(method, &options.settings, set)?;
        let options = RenderOptions { method, settings, ..base.clone() };
        let (round, picture) = still(gpu, scene, options, FRAMES, keep, tick)?;
        let flip = error(&target.truth.1.score(base.size, &picture, &target.regions, exposure)?);
        sheet.candidates.push(Candidate::new(method.name(), name, &[round], flip));
        store.put(sheet.clone());
    }
    let larger = base.size.map(|side| 2 * side);
    let options = RenderOptions { size: larger, ..base.clone() };
    let own = sheet.candidates.iter().find(|known| known.method == options.method.name() && known.set.is_empty());
    if let Some(own) = own {
        let (round, _) = still(gpu, scene, options, TIMED, keep, tick)?;
        sheet.fixed = fixed_shares((&own.passes, base.size), (&round.passes, larger));
    }
    sheet.complete = true;
    store.put(sheet.clone());
    Ok(sheet)
}

/// The settings of a preset, over them those that were given, and over those a candidate's own.
///
/// # Errors
/// Fails if a setting has a bad value.
pub fn settings<'a>(
    method: Method,
    given: &Settings,
    set: impl IntoIterator<Item = &'a (&'a str, &'a str)>,
) -> Result<Settings> {
    let mut settings = Settings::of(method);
    for (name, value) in super::store::given(given) {
        settings.set(name, &value, "--set")?;
    }
    for (name, value) in set {
        settings.set(name, value, "measured points")?;
    }
    Ok(settings)
}

/// Renders frames of a still scene. Returns their times and the last picture.
fn still(
    gpu: &Gpu,
    scene: &Scene,
    options: RenderOptions,
    frames: u32,
    keep: Keep,
    tick: &mut dyn FnMut(),
) -> Result<(Round, Vec<[f32; 4]>)> {
    let mut renderer = Renderer::new(gpu, scene, options)?;
    let mut clock = FrameClock::after(WARM_UP);
    clock.still(&mut renderer, scene, scene.panorama.frame_time(0), frames, || {
        tick();
        keep.go_on(&scene.name)
    })?;
    let picture = renderer.picture()?;
    Ok((clock.round(&renderer), picture))
}

/// What errors are measured against: a truth with its name, and its regions.
struct Baseline {
    truth: (String, Yardstick),
    regions: Regions,
}

impl Baseline {
    fn new(
        gpu: &Gpu,
        scene: &Scene,
        complete: Option<&[CompleteScene; 2]>,
        base: &RenderOptions,
        exposure: f32,
        keep: Keep,
        tick: &mut dyn FnMut(),
    ) -> Result<Self> {
        let time = scene.panorama.frame_time(0);
        let view = real_view(gpu, scene, &RenderOptions { without_objects: false, ..base.clone() }, time)?;
        let named = |truth: TruthKind, yardstick| (truth.name().to_owned(), yardstick);
        if scene.instance_count() == 0 || base.without_objects {
            return Self::nothing(&view, base, exposure);
        }
        if let Some([with, without]) = complete {
            let frame = 0;
            let regions = of_scene(gpu, scene, base, [with, without], frame, REGION_SPP, &mut *tick)?;
            let mut truth = |complete| truth_of_scene(gpu, complete, base, time, SCENE_SPP, keep, tick);
            let truths = [truth(with)?, truth(without)?];
            let yardstick = Yardstick::of_scene(&view, [&truths[0], &truths[1]], &regions, exposure)?;
            return Ok(Self { truth: named(TruthKind::Scene, yardstick), regions });
        }
        let mut set = vec![("relight_warmup".to_owned(), MODEL_WARM_UP.to_owned())];
        set.extend(super::store::given(&base.settings).into_iter().map(|(name, value)| (name.to_owned(), value)));
        let truth = truth_of_model(gpu, scene, base, &set, time, MODEL_SPP, keep, tick)?;
        let regions = regions::regions(base.size, &truth.radiance, &view.camera_radiance, &view.real_coverage);
        let yardstick = Yardstick::of_model(&truth, &regions, exposure)?;
        Ok(Self { truth: named(TruthKind::Model, yardstick), regions })
    }

    /// The baseline of a scene without objects. Its truth is the plain view, and nothing in it is random.
    fn nothing(view: &RealView, base: &RenderOptions, exposure: f32) -> Result<Self> {
        let pixels = view.camera_radiance.len();
        let regions = Regions { virtual_: vec![false; pixels], influenced: vec![false; pixels] };
        let yardstick = Yardstick::of_nothing(view, base.size, &regions, exposure)?;
        Ok(Self { truth: ("the view without objects".to_owned(), yardstick), regions })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_is_measured_has_the_pictures_shape_and_is_not_larger() {
        assert_eq!(size([1280, 720]), [160, 90]);
        assert_eq!(size([160, 90]), [160, 90]);
        assert_eq!(size([40, 30]), [40, 30]);
        assert_eq!(size([512, 384]), [139, 104]);
        assert_eq!(size([16000, 1]), [15179, 1], "as near as it gets");
    }

    #[test]
    fn all_that_is_tried_can_be_set_and_is_tried_once() {
        let none = Settings::of(Method::Iprt);
        let mut seen = Vec::new();
        for (method, set) in tried(&none, true) {
            let settings = settings(method, &none, set).expect("good settings");
            assert!(set.iter().all(|(name, _)| super::super::TRADED.contains(name)), "{set:?}");
            let what = (method, settings.values());
            assert!(!seen.contains(&what), "{set:?} twice");
            seen.push(what);
        }
        assert_eq!(tried(&none, false).len(), 1);
    }

    #[test]
    fn what_was_given_is_kept_and_not_tried() {
        let mut given = Settings::of(Method::Iprt);
        given.set("atrous_levels", "3", "test").expect("sets");
        given.set("exposure", "3", "test").expect_err("no setting");
        let all = tried(&given, true);
        assert!(all.iter().all(|(_, set)| set.iter().all(|(name, _)| *name != "atrous_levels")));
        assert!(all.contains(&(Method::Paper, &[])) && all.len() < TRIED.len());
        let paper = settings(Method::Paper, &given, [&("bounces", "1")]).expect("sets");
        assert_eq!(
            (paper.atrous_levels, paper.bounces, paper.thickness),
            (3, 1, Settings::of(Method::Paper).thickness)
        );
    }
}
