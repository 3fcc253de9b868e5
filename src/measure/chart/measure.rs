//! One point: its pictures and their scores, and how long its frames take.

use super::{
    pictures::{stretch, write_difference, write_picture},
    point::{ChartPoint, Cost, Outcome, Round, Spread},
    run::{ChartOptions, PICTURES, file_name},
    sweep::Spec,
};
use crate::{
    Result,
    gpu::{Gpu, Timings},
    measure::{
        bench::{PASSES, quantile},
        metrics::Picture,
        score::{REGIONS, Scorer, Scores},
        temporal::{self, Frames},
    },
    options::RenderOptions,
    reference::cache::Keep,
    renderer::Renderer,
    scene::Scene,
    settings::Settings,
};
use std::{collections::BTreeMap, path::Path, time::Instant};

/// Frames before times are taken: shaders are compiled, histories are young.
pub const WARM_UP: u32 = 5;
/// Frames that are timed in a later round.
pub const TIMED: u32 = 8;
/// Frames a second of the moving scene.
const MOVING_FPS: f64 = 30.0;

/// A point on a scene.
pub(super) struct Target<'a> {
    pub scene: &'a Scene,
    pub name: &'a str,
    pub spec: &'a Spec,
    /// Of the chart's size.
    pub options: RenderOptions,
    /// The first is 0; each has its own seed.
    pub round: u32,
    pub chart: &'a ChartOptions,
    pub scorer: &'a Scorer,
    /// Seconds.
    pub time: f64,
    pub folder: &'a Path,
}

/// Renders, scores and times.
pub(super) fn measure(gpu: &Gpu, target: &Target, key: &str, keep: Keep) -> Result<ChartPoint> {
    let Target { spec, chart, .. } = target;
    let mut renderer = renderer(gpu, target)?;
    let looked_at = spec.frames.map_or_else(|| chart.frames.clone(), |frames| vec![frames]);
    let mut clock = Clock::default();
    let mut outcomes = Vec::new();
    let last = chart.first_frames(spec);
    let mut steady = Vec::new();
    for frame in 1..=last {
        keep.go_on(&target.folder.display().to_string())?;
        clock.frame(&mut renderer, target.scene, target.time)?;
        if looked_at.contains(&frame) {
            let outcome = outcome(target, &renderer, frame, false)?;
            if frame == spec.frames.unwrap_or(chart.main_frames()) {
                clock.scores = Some(outcome.scores);
            }
            outcomes.push(outcome);
        }
        if spec.cost == Cost::Frame && frame > WARM_UP && frame + TIMED > last {
            steady.push(picture(target, &renderer)?);
        }
    }
    let memory = gpu.device_bytes();
    let round = clock.round(&renderer);
    let flicker = flicker(target, &steady)?;
    if spec.cost == Cost::Frame && chart.moving_frames > 0 && moves(target.scene, target.time, chart.moving_frames) {
        renderer.reset_history("the scene starts to move");
        for frame in 1..=chart.moving_frames {
            keep.go_on(&target.folder.display().to_string())?;
            renderer.render(target.scene, moving_time(target.time, chart.moving_frames - frame))?;
        }
        outcomes.push(outcome(target, &renderer, chart.moving_frames, true)?);
    }
    let options = renderer.options();
    let preset = Settings::of(spec.method).values();
    let values = options.settings.values();
    let differs = values.iter().zip(&preset).filter(|(value, default)| value != default);
    let own = |(name, value): &(&'static str, String)| ((*name).to_owned(), value.clone());
    let mut point = ChartPoint {
        key: key.to_owned(),
        device: gpu.device_name().to_owned(),
        driver: gpu.driver().to_owned(),
        scene: target.name.to_owned(),
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

/// One more round: times, and the main picture of another seed.
pub(super) fn measure_again(gpu: &Gpu, target: &Target, keep: Keep) -> Result<Round> {
    let mut renderer = renderer(gpu, target)?;
    let mut clock = Clock::default();
    for frame in 1..=target.chart.again_frames(target.spec) {
        keep.go_on(&target.folder.display().to_string())?;
        clock.frame(&mut renderer, target.scene, target.time)?;
        if frame == target.spec.frames.unwrap_or(target.chart.main_frames()) {
            clock.scores = Some(target.scorer.score(&picture(target, &renderer)?)?);
        }
    }
    Ok(clock.round(&renderer))
}

/// Of the frames of a still scene, where there are two at least.
fn flicker(target: &Target, frames: &[Vec<[f32; 4]>]) -> Result<BTreeMap<String, f64>> {
    if frames.len() < 2 {
        return Ok(BTreeMap::new());
    }
    let Scorer { size, exposure, ref regions, .. } = *target.scorer;
    let masks = [None, Some(&regions.virtual_), Some(&regions.influenced)];
    let seen = REGIONS.iter().zip(masks).filter(|(_, mask)| mask.is_none_or(|mask| mask.contains(&true)));
    let frames = Frames { subject: target.name, size, frames };
    seen.map(|(name, mask)| Ok(((*name).to_owned(), temporal::flicker(frames, mask.map(Vec::as_slice), exposure)?)))
        .collect()
}

/// Passes that run once a video frame.
const PREPARE: [&str; 4] = [PASSES[0], PASSES[1], PASSES[2], PASSES[3]];

fn renderer(gpu: &Gpu, target: &Target) -> Result<Renderer> {
    let mut options = target.options.clone();
    let scaled = |side: u32| ((side as f32 * target.spec.scale).round() as u32).max(1);
    options.size = options.size.map(scaled);
    options.seed = options.seed.wrapping_add(target.round);
    Renderer::new(gpu, target.scene, options)
}

/// The scene moves backwards, and ends at the picture's time: the truth of the still picture is that of this one, too.
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

/// What is shown, in the chart's size.
fn picture(target: &Target, renderer: &Renderer) -> Result<Vec<[f32; 4]>> {
    Ok(stretch(&renderer.picture()?, renderer.options().size, target.scorer.size))
}

fn outcome(target: &Target, renderer: &Renderer, frames: u32, moving: bool) -> Result<Outcome> {
    let size = target.scorer.size;
    let texels = picture(target, renderer)?;
    let scores = target.scorer.score(&texels)?;
    let motion = if moving { "-moving" } else { "" };
    let stem = format!("{PICTURES}/{}-{}-{frames}{motion}", file_name(target.name), file_name(&target.spec.name));
    let (picture, difference) = (format!("{stem}.png"), format!("{stem}-flip.png"));
    let exposure = target.scorer.exposure;
    write_picture(&target.folder.join(&picture), &target.scene.panorama, size, &texels, exposure)?;
    let test = Picture { subject: &target.spec.name, size, texels: &texels };
    let truth = Picture { subject: "the truth", size, texels: &target.scorer.best().radiance };
    write_difference(&target.folder.join(&difference), test, truth, exposure)?;
    Ok(Outcome { frames, moving, scores, picture, difference })
}

/// Times of frames, those of warm-up left out.
#[derive(Default)]
pub(in crate::measure) struct Clock {
    frames: u32,
    timed: Vec<(Timings, f64)>,
    scores: Option<Scores>,
}

impl Clock {
    pub(in crate::measure) fn frame(&mut self, renderer: &mut Renderer, scene: &Scene, time: f64) -> Result<()> {
        let start = Instant::now();
        let timings = renderer.render(scene, time)?;
        self.frames += 1;
        if self.frames > WARM_UP {
            self.timed.push((timings, start.elapsed().as_secs_f64() * 1e3));
        }
        Ok(())
    }

    /// What was timed of this renderer.
    pub(in crate::measure) fn round(self, renderer: &Renderer) -> Round {
        let mut passes: BTreeMap<String, Vec<f64>> = BTreeMap::new();
        for (timings, _) in &self.timed {
            let mut sums: BTreeMap<&str, f64> = BTreeMap::new();
            timings.entries.iter().for_each(|(name, ms)| *sums.entry(name).or_default() += ms);
            sums.into_iter().for_each(|(name, ms)| passes.entry(name.to_owned()).or_default().push(ms));
        }
        let prepared = renderer.prepared().entries.iter().filter(|(name, _)| PREPARE.contains(&name.as_str()));
        Round {
            frame_ms: self.timed.iter().map(|(timings, _)| timings.gpu_ms).collect(),
            wall_ms: self.timed.iter().map(|(_, ms)| *ms).collect(),
            passes: passes.into_iter().map(|(name, mut ms)| (name, quantile(&mut ms, 0.5))).collect(),
            prepare_ms: prepared.map(|(_, ms)| ms).sum(),
            scores: self.scores,
        }
    }
}
