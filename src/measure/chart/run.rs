//! Measures a chart: scene by scene the truths, then all points in rounds, so that a machine that slows down meanwhile slows all of
//! them. Each result is in the chart's file before the next is begun; what is there is not measured again.

use super::{
    choices::{self, Chooser},
    measure::{TIMED, WARM_UP, measure, measure_again},
    pictures::{write_difference, write_picture},
    point::{Chart, ChartPoint, ChartScene, Conditions},
    sweep::Spec,
};
use crate::{
    Error, Result,
    gpu::Gpu,
    image_file::write::write_png,
    measure::{
        choice::store::version,
        metrics::Picture,
        regions::{self, Regions},
        score::{REGIONS, RealView, Scorer, real_view},
    },
    options::RenderOptions,
    reference::cache::{self, Keep, Truth, hash_rendered, truth_of_model, truth_of_scene},
    scene::{CompleteScene, Scene, viewpoint::Projection},
    settings::{Method, Settings},
};
use std::{collections::BTreeMap, fs, path::Path};

/// A scene to chart.
#[derive(Clone, Debug)]
pub struct Case {
    /// What people call it.
    pub name: String,
    /// What methods render.
    pub scene: Scene,
    /// The complete true scene with the objects and without, where it is known.
    pub complete: Option<[CompleteScene; 2]>,
}

impl Case {
    /// The default method's settings with those of the scene over them.
    ///
    /// # Errors
    /// One that is none.
    pub fn settings(&self) -> Result<Settings> {
        let mut settings = Settings::of(Method::Iprt);
        for (name, value) in self.scene.render.set_text() {
            settings.set(&name, &value, &self.name)?;
        }
        Ok(settings)
    }
}

/// What can be chosen.
#[derive(Clone, Debug, PartialEq)]
pub struct ChartOptions {
    /// Width and height of pictures, pixels.
    pub size: [u32; 2],
    /// How directions map to pixels.
    pub projection: Projection,
    /// Seed of all random numbers.
    pub seed: u32,
    /// The video frame that pictures show.
    pub frame: u32,
    /// Frames after which still pictures are looked at, ascending.
    pub frames: Vec<u32>,
    /// Frames of the moving scene before its picture is looked at; 0: it is not.
    pub moving_frames: u32,
    /// How often each point's time is taken.
    pub rounds: u32,
    /// Paths a pixel of model truth.
    pub model_spp: u32,
    /// Samples a pixel of scene truth.
    pub scene_spp: u32,
    /// The points.
    pub points: Vec<Spec>,
}

/// Where a chart's pictures are.
pub const PICTURES: &str = "pictures";

/// What a model truth's path costs, in a frame's time, roughly: for the time left.
const PATH_WORK: u64 = 2;

impl ChartOptions {
    /// All that [`run`] tells `tick` for so many scenes that are as given: with a true scene or without.
    pub fn work<'a>(&self, cases: impl IntoIterator<Item = &'a Case>) -> u64 {
        let points: u64 = self.points.iter().map(|spec| self.point_work(spec)).sum();
        let truth = |case: &Case| {
            let scene = if case.complete.is_some() {
                2 * u64::from(cache::rounded(self.scene_spp, cache::SCENE_BATCH))
            } else {
                0
            };
            scene + PATH_WORK * u64::from(cache::rounded(self.model_spp, cache::MODEL_BATCH))
        };
        cases.into_iter().map(|case| truth(case) + points + choices::work(self)).sum()
    }

    fn point_work(&self, spec: &Spec) -> u64 {
        (0..self.rounds).map(|round| self.round_work(spec, round)).sum()
    }

    fn round_work(&self, spec: &Spec, round: u32) -> u64 {
        u64::from(if round == 0 { self.first_frames(spec) + self.moving_frames } else { self.again_frames(spec) })
    }

    /// Still frames of the first round: as many as are looked at, and enough for times.
    pub fn first_frames(&self, spec: &Spec) -> u32 {
        spec.frames.or(self.frames.last().copied()).unwrap_or(0).max(WARM_UP + TIMED)
    }

    /// Of [`ChartOptions::frames`] the largest up to 16, or else the least.
    pub fn main_frames(&self) -> u32 {
        let fits = self.frames.iter().copied().filter(|frames| *frames <= 16).max();
        fits.or(self.frames.first().copied()).unwrap_or(1)
    }

    /// Frames of a round after the first: enough for times, and for the main picture where that takes not many.
    pub fn again_frames(&self, spec: &Spec) -> u32 {
        let timed = WARM_UP + TIMED;
        let main = spec.frames.unwrap_or(self.main_frames());
        if main <= 2 * timed { main.max(timed) } else { timed }
    }

    pub(super) fn render_options(&self, settings: Settings, method: Method) -> RenderOptions {
        RenderOptions {
            size: self.size,
            method,
            settings,
            projection: self.projection,
            seed: self.seed,
            without_objects: false,
        }
    }
}

/// Measures what is not in `folder` yet. `tick` is told the work done, in units of [`ChartOptions::work`], and what is next.
///
/// # Errors
/// A folder that cannot be written or that holds a chart of another device, size or version; what cannot be rendered;
/// [`Error::Interrupted`], with everything that was finished in the folder.
pub fn run(
    gpu: &Gpu,
    cases: &[Case],
    options: &ChartOptions,
    folder: &Path,
    keep: Keep,
    tick: &mut dyn FnMut(u64, &str),
) -> Result<Chart> {
    let mut chart = open(gpu, options, folder)?;
    for case in cases {
        let bench = Bench::new(gpu, case, options, folder, keep, tick)?;
        let scene = bench.scene.clone();
        chart.points.retain(|point| point.scene != scene.name || bench.counts(point));
        match chart.scenes.iter_mut().find(|known| known.name == scene.name) {
            Some(known) => *known = scene,
            None => chart.scenes.push(scene),
        }
        chart.save(folder)?;
        for round in 0..options.rounds {
            for (spec, key) in options.points.iter().zip(&bench.keys) {
                keep.go_on(&folder.display().to_string())?;
                let label = format!("{}, {}", case.name, spec.name);
                tick(0, &label);
                let known = chart.points.iter_mut().find(|point| point.key == *key && point.scene == case.name);
                match known {
                    Some(point) if point.rounds.len() as u32 > round => {}
                    Some(point) => {
                        point.rounds.push(measure_again(gpu, &bench.target(spec, round)?, keep)?);
                        point.summarise();
                        chart.save(folder)?;
                    }
                    None => {
                        let point = measure(gpu, &bench.target(spec, 0)?, key, keep)?;
                        chart.points.push(point);
                        chart.save(folder)?;
                    }
                }
                tick(options.round_work(spec, round), &label);
            }
        }
        let label = format!("{}, choices for targets", case.name);
        tick(0, &label);
        bench.chooser(gpu, keep)?.run(&mut chart, &|chart| chart.save(folder), &mut |work| tick(work, &label))?;
    }
    Ok(chart)
}

/// Makes the folder of a chart, where it does not exist.
///
/// # Errors
/// It cannot be made.
pub fn make_folder(folder: &Path) -> Result<()> {
    fs::create_dir_all(folder.join(PICTURES)).map_err(|error| {
        let problem = format!("cannot be made: {}", error.kind());
        Error::input(folder.display(), problem, "give a folder that can be written")
    })
}

/// The chart in a folder, or an empty one.
fn open(gpu: &Gpu, options: &ChartOptions, folder: &Path) -> Result<Chart> {
    make_folder(folder)?;
    let of = Conditions {
        version: version()?,
        device: gpu.device_name().to_owned(),
        driver: gpu.driver().to_owned(),
        size: options.size,
        projection: format!("{:?}", options.projection).to_lowercase(),
        seed: options.seed,
        main_frames: options.main_frames(),
        looks: options.frames.clone(),
        moving: options.moving_frames,
        truth_spp: [options.model_spp, options.scene_spp],
    };
    let Some(chart) = Chart::load(folder)? else {
        return Ok(Chart { of, scenes: Vec::new(), points: Vec::new(), choices: Vec::new() });
    };
    if chart.of == of {
        return Ok(chart);
    }
    let problem = format!("holds a chart of {}, this is of {}", chart.of.text(), of.text());
    Err(Error::input(folder.display(), problem, "give another folder, or delete that one"))
}

impl Conditions {
    /// For people, in a line.
    pub fn text(&self) -> String {
        let [width, height] = self.size;
        format!(
            "{} ({}), {width}×{height} {}, seed {}, looks {:?}, moving {}, truth-spp {:?}, version {}",
            self.device, self.driver, self.projection, self.seed, self.looks, self.moving, self.truth_spp, self.version
        )
    }
}

/// A scene, ready to be measured on.
struct Bench<'a> {
    case: &'a Case,
    options: &'a ChartOptions,
    folder: &'a Path,
    scene: ChartScene,
    scorer: Scorer,
    of_scene: Vec<(String, String)>,
    /// One a point.
    keys: Vec<String>,
}

impl<'a> Bench<'a> {
    fn new(
        gpu: &Gpu,
        case: &'a Case,
        options: &'a ChartOptions,
        folder: &'a Path,
        keep: Keep,
        tick: &mut dyn FnMut(u64, &str),
    ) -> Result<Self> {
        let time = case.scene.panorama.frame_time(options.frame as usize);
        let of_scene = case.scene.render.set_text();
        let base = options.render_options(Settings::of(Method::Reference), Method::Reference);
        let label = format!("{}, model truth", case.name);
        tick(0, &label);
        let mut path = || tick(PATH_WORK, &label);
        let model = truth_of_model(gpu, &case.scene, &base, &of_scene, time, options.model_spp, keep, &mut path)?;
        let label = format!("{}, scene truth", case.name);
        tick(0, &label);
        let mut sample = || tick(1, &label);
        let complete = match &case.complete {
            None => None,
            Some([with, without]) => {
                let mut truth = |scene| truth_of_scene(gpu, scene, &base, time, options.scene_spp, keep, &mut sample);
                Some([truth(with)?, truth(without)?])
            }
        };
        let view = real_view(gpu, &case.scene, &base, time)?;
        let exposure = case.scene.render.exposure;
        let regions = regions_of(gpu, case, options, &base, &view, &model)?;
        let scorer = Scorer::new(&view, regions, &model, complete.as_ref().map(|[a, b]| [a, b]), exposure)?;
        let model_scores = scorer.score(&model.radiance)?;
        let share = |mask: &[bool]| mask.iter().filter(|inside| **inside).count() as f64 / mask.len() as f64;
        let regions = [1.0, share(&scorer.regions.virtual_), share(&scorer.regions.influenced)];
        let scene_spp = complete.as_ref().map_or(0, |[with, _]| with.spp);
        let mut hasher = hash_rendered(&case.scene, time)?;
        hasher.update(cache::describe(&base).as_bytes()).update(format!("{of_scene:?} {exposure}").as_bytes());
        hasher.update(bytemuck::cast_slice(&scorer.model.radiance));
        if let Some(truth) = &scorer.scene {
            hasher.update(bytemuck::cast_slice(&truth.radiance));
        }
        let key = hasher.finalize().to_hex()[..16].to_owned();
        let scene = ChartScene {
            name: case.name.clone(),
            exposure,
            time,
            panorama: case.scene.panorama.load(case.scene.panorama.frame_at(time))?.color_size,
            regions: REGIONS.iter().zip(regions).map(|(name, share)| ((*name).to_owned(), share)).collect(),
            model_spp: model.spp,
            scene_spp,
            outliers: [model.outliers, complete.as_ref().map_or(0.0, |[with, _]| with.outliers)],
            noise: crate::measure::score::Scores {
                model: scorer.model.noise,
                scene: scorer.scene.as_ref().map(|truth| truth.noise),
            },
            floor: model_scores.scene,
            nothing: scorer.score(&view.camera_radiance)?,
            pictures: truth_pictures(case, &scorer, folder)?,
            key,
        };
        let keys = options
            .points
            .iter()
            .map(|spec| {
                let settings = spec.settings(&of_scene, &case.name)?;
                let what = format!(
                    "{} {:?} {:?} {} {:?}",
                    scene.key,
                    spec,
                    settings.values(),
                    options.moving_frames,
                    options.frames
                );
                Ok(format!("{}-{}", scene.key, &blake3::hash(what.as_bytes()).to_hex()[..16]))
            })
            .collect::<Result<Vec<_>>>()?;
        Ok(Self { case, options, folder, scene, scorer, of_scene, keys })
    }

    /// Whether a point of this scene that an earlier run measured still holds: asked for now, or of another sweep but against these
    /// very truths.
    fn counts(&self, point: &ChartPoint) -> bool {
        let same_truths = point.key.strip_prefix(&self.scene.key).is_some_and(|rest| rest.starts_with('-'));
        let asked_for = self.options.points.iter().any(|spec| spec.name == point.name);
        self.keys.contains(&point.key) || (same_truths && !asked_for)
    }

    fn chooser(&'a self, gpu: &'a Gpu, keep: Keep<'a>) -> Result<Chooser<'a>> {
        Ok(Chooser {
            gpu,
            scene: &self.case.scene,
            of: &self.scene,
            scorer: &self.scorer,
            settings: self.case.settings()?,
            chart: self.options,
            keep,
        })
    }

    fn target(&'a self, spec: &'a Spec, round: u32) -> Result<super::measure::Target<'a>> {
        let settings = spec.settings(&self.of_scene, &self.case.name)?;
        Ok(super::measure::Target {
            scene: &self.case.scene,
            name: &self.case.name,
            spec,
            options: self.options.render_options(settings, spec.method),
            round,
            chart: self.options,
            scorer: &self.scorer,
            time: self.scene.time,
            folder: self.folder,
        })
    }
}

/// Samples of the filtered truths that tell regions apart, as `masks` takes.
const REGION_SPP: u32 = 64;

/// By scene truth where it is known, else by model truth.
fn regions_of(
    gpu: &Gpu,
    case: &Case,
    options: &ChartOptions,
    base: &RenderOptions,
    view: &RealView,
    model: &Truth,
) -> Result<Regions> {
    match &case.complete {
        Some([with, without]) => {
            let samples = options.scene_spp.min(REGION_SPP);
            regions::of_scene(gpu, &case.scene, base, [with, without], options.frame, samples, || ())
        }
        None => Ok(regions::regions(options.size, &model.radiance, &view.camera_radiance, &view.real_coverage)),
    }
}

fn truth_pictures(case: &Case, scorer: &Scorer, folder: &Path) -> Result<BTreeMap<String, String>> {
    let mut pictures = BTreeMap::new();
    let mut write = |what: &str, write: &dyn Fn(&Path) -> Result<()>| -> Result<()> {
        let file = format!("{PICTURES}/{}-{what}.png", file_name(&case.name));
        write(&folder.join(&file))?;
        pictures.insert(what.to_owned(), file);
        Ok(())
    };
    let panorama = &case.scene.panorama;
    let (size, exposure) = (scorer.size, scorer.exposure);
    let picture = |texels| Picture { subject: "truth", size, texels };
    let model = &scorer.model.radiance;
    write("model", &|path| write_picture(path, panorama, size, model, exposure))?;
    if let Some(truth) = &scorer.scene {
        write("scene", &|path| write_picture(path, panorama, size, &truth.radiance, exposure))?;
        write("floor", &|path| write_difference(path, picture(model), picture(&truth.radiance), exposure))?;
    }
    let regions = &scorer.regions;
    let mark = |i: usize| {
        if regions.virtual_[i] {
            255
        } else if regions.influenced[i] {
            128
        } else {
            0
        }
    };
    let codes: Vec<u8> = (0..regions.virtual_.len()).map(mark).collect();
    write("regions", &|path| write_png(path, size, &codes, 1))?;
    Ok(pictures)
}

/// A name that any file system takes.
pub fn file_name(name: &str) -> String {
    let plain = |c: char| if c.is_ascii_alphanumeric() || c == '.' { c } else { '_' };
    let mut out: String = name.chars().map(plain).collect();
    while out.contains("__") {
        out = out.replace("__", "_");
    }
    out
}
