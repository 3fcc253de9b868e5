//! Measures one point: a first round with pictures, their scores and times, and later rounds with other
//! seeds.

use super::{
    options::ChartOptions,
    pictures::{PICTURES, file_name, stretch, write_difference, write_picture},
    point::{ChartPoint, CostUnit, ScoredPicture},
    sweep::PointSpec,
};
use crate::{
    Result,
    gpu::Gpu,
    measure::{
        clock::{self, FrameClock, Round, RoundScores, STEADY, Spread},
        metrics::Picture,
        score::{REGIONS, Scorer},
        sequence::{self, Sequence},
    },
    options::RenderOptions,
    reference::cache::Keep,
    renderer::{Renderer, Wishes},
    scene::Scene,
    settings::Settings,
};
use std::{collections::BTreeMap, path::Path};

/// Frames that are timed in a later round.
pub const TIMED: u32 = 8;
/// Frames a second of the moving scene.
const MOVING_FPS: f64 = 30.0;

/// A round of a point on a scene.
pub(super) struct Task<'a> {
    pub scene: &'a Scene,
    pub name: &'a str,
    pub spec: &'a PointSpec,
    /// For the chart's picture size.
    pub options: RenderOptions,
    /// The number of the round, from 0. Each round has its own seed.
    pub round: u32,
    pub chart: &'a ChartOptions,
    pub scorer: &'a Scorer,
    /// Seconds.
    pub time: f64,
    pub folder: &'a Path,
}

impl Task<'_> {
    fn go_on(&self, keep: Keep) -> Result<()> {
        keep.go_on(&self.folder.display().to_string())
    }
}

/// Measures the first round of a point: it renders, scores and times, and writes the pictures.
pub(super) fn first(gpu: &Gpu, task: &Task, key: &str, keep: Keep) -> Result<ChartPoint> {
    let Task { spec, chart, .. } = task;
    let mut renderer = renderer(gpu, task)?;
    let looks = spec.frames.map_or_else(|| chart.frames.clone(), |frames| vec![frames]);
    let last = chart.first_frames(spec);
    let is_steady = |frame: u32| spec.cost == CostUnit::Frame && frame > STEADY && frame + TIMED > last;
    let is_read = |frame: &u32| looks.contains(frame) || is_steady(*frame) || *frame == last;
    let mut clock = FrameClock::after(STEADY);
    let (mut outcomes, mut steady) = (Vec::new(), Vec::new());
    let mut rendered = 0;
    for frame in (1..=last).filter(is_read) {
        clock.still(&mut renderer, task.scene, task.time, frame - rendered, || task.go_on(keep))?;
        rendered = frame;
        if looks.contains(&frame) {
            outcomes.push(outcome(task, &renderer, frame, false)?);
        }
        if is_steady(frame) {
            steady.push(picture(task, &renderer)?);
        }
    }
    let memory = gpu.device_bytes();
    let timed = clock.round(&renderer);
    let flicker = flicker(task, &steady)?;
    if play(task, &mut renderer, keep)? {
        outcomes.push(outcome(task, &renderer, chart.moving_frames, true)?);
    }
    let scores =
        outcomes.iter().map(|&ScoredPicture { frames, moving, scores, .. }| RoundScores { frames, moving, scores });
    let round = Round { scores: scores.collect(), ..timed };
    let options = renderer.options();
    let preset = Settings::of(spec.method).values();
    let values = options.settings.values();
    let differs = values.iter().zip(&preset).filter(|(value, default)| value != default);
    let own = |(name, value): &(&'static str, String)| ((*name).to_owned(), value.clone());
    let mut point = ChartPoint {
        key: key.to_owned(),
        device: gpu.device_name().to_owned(),
        driver: gpu.driver().to_owned(),
        scene: task.name.to_owned(),
        name: spec.name.clone(),
        group: spec.group.to_owned(),
        base: spec.base.clone(),
        method: spec.method.name(),
        set: differs.map(|(value, _)| own(value)).collect(),
        settings: values.iter().map(own).collect(),
        rendered: options.size,
        cost: spec.cost,
        ms: Spread::default(),
        memory,
        flicker,
        rounds: vec![round],
        outcomes,
    };
    point.summarise();
    Ok(point)
}

/// Plays the moving scene from a new history on. Returns whether anything moves.
fn play(task: &Task, renderer: &mut Renderer, keep: Keep) -> Result<bool> {
    let frames = task.chart.moving_frames;
    if task.spec.cost != CostUnit::Frame || frames == 0 || !moves(task.scene, task.time, frames) {
        return Ok(false);
    }
    renderer.reset_history("the scene starts to move");
    let times = (0..frames).rev().map(|left| moving_time(task.time, left));
    clock::frames(renderer, task.scene, times, &Wishes::default(), || task.go_on(keep))?;
    Ok(true)
}

/// Measures a later round of a point: its times, and scores with another seed. Those of a method are of all its
/// pictures, those of any other point of the main picture, where that takes few frames.
pub(super) fn another(gpu: &Gpu, task: &Task, keep: Keep) -> Result<Round> {
    let mut renderer = renderer(gpu, task)?;
    let mut clock = FrameClock::after(STEADY);
    let last = task.chart.again_frames(task.spec);
    let (mut scores, mut rendered) = (Vec::new(), 0);
    let mut score = |renderer: &Renderer, frames: u32, moving: bool| -> Result<()> {
        scores.push(RoundScores { frames, moving, scores: task.scorer.score(&picture(task, renderer)?)? });
        Ok(())
    };
    for frame in task.chart.again_looks(task.spec) {
        clock.still(&mut renderer, task.scene, task.time, frame - rendered, || task.go_on(keep))?;
        rendered = frame;
        score(&renderer, frame, false)?;
    }
    clock.still(&mut renderer, task.scene, task.time, last - rendered, || task.go_on(keep))?;
    let timed = clock.round(&renderer);
    if task.spec.is_method() && play(task, &mut renderer, keep)? {
        score(&renderer, task.chart.moving_frames, true)?;
    }
    Ok(Round { scores, ..timed })
}

/// Flicker by region over the frames of a still scene. It takes two frames or more.
fn flicker(task: &Task, frames: &[Vec<[f32; 4]>]) -> Result<BTreeMap<String, f64>> {
    if frames.len() < 2 {
        return Ok(BTreeMap::new());
    }
    let Scorer { size, exposure, ref regions, .. } = *task.scorer;
    let masks = [None, Some(&regions.virtual_), Some(&regions.influenced)];
    let seen = REGIONS.iter().zip(masks).filter(|(_, mask)| mask.is_none_or(|mask| mask.contains(&true)));
    let frames = Sequence { subject: task.name, size, frames };
    seen.map(|(name, mask)| Ok(((*name).to_owned(), sequence::flicker(frames, mask.map(Vec::as_slice), exposure)?)))
        .collect()
}

fn renderer(gpu: &Gpu, task: &Task) -> Result<Renderer> {
    let mut options = task.options.clone();
    let scaled = |side: u32| ((side as f32 * task.spec.scale).round() as u32).max(1);
    options.size = options.size.map(scaled);
    options.seed = options.seed.wrapping_add(task.round);
    Renderer::new(gpu, task.scene, options)
}

/// The time of a moving frame, seconds. The scene plays backwards and ends at the picture's time, so that the
/// truth of the still picture is also the truth of the last moving one.
fn moving_time(time: f64, frames_left: u32) -> f64 {
    time + f64::from(frames_left) / MOVING_FPS
}

fn moves(scene: &Scene, time: f64, frames: u32) -> bool {
    let end = moving_time(time, frames - 1);
    let (now, then) = (scene.at(time, time), scene.at(end, end));
    let places = |state: &crate::scene::SceneState| -> Vec<_> {
        state.instances.instances.iter().map(|instance| instance.object_to_world).collect()
    };
    places(&now) != places(&then)
        || format!("{:?}", now.camera) != format!("{:?}", then.camera)
        || scene.panorama.frame_at(time) != scene.panorama.frame_at(end)
}

/// The renderer's picture, stretched to the chart's size.
fn picture(task: &Task, renderer: &Renderer) -> Result<Vec<[f32; 4]>> {
    Ok(stretch(&renderer.picture()?, renderer.options().size, task.scorer.size))
}

fn outcome(task: &Task, renderer: &Renderer, frames: u32, moving: bool) -> Result<ScoredPicture> {
    let size = task.scorer.size;
    let texels = picture(task, renderer)?;
    let scores = task.scorer.score(&texels)?;
    let motion = if moving { "-moving" } else { "" };
    let stem = format!("{PICTURES}/{}-{}-{frames}{motion}", file_name(task.name), file_name(&task.spec.name));
    let (picture, difference) = (format!("{stem}.png"), format!("{stem}-flip.png"));
    let exposure = task.scorer.exposure;
    write_picture(&task.folder.join(&picture), &task.scene.panorama, size, &texels, exposure)?;
    let test = Picture { subject: &task.spec.name, size, texels: &texels };
    let truth = Picture { subject: "the truth", size, texels: &task.scorer.best().radiance };
    write_difference(&task.folder.join(&difference), test, truth, exposure)?;
    Ok(ScoredPicture { frames, moving, scores, picture, difference })
}
