//! Measures a chart. For each scene it computes the truths, and then measures all points in rounds, so that a
//! machine that slows down for a while slows all points alike. Each result is written to the chart's file
//! before the next one is begun. What is in the file is not measured again.

use super::{
    options::{ChartInput, ChartOptions},
    pictures::PICTURES,
    point::{Chart, Conditions},
    prepare::PreparedScene,
    rounds,
};
use crate::{
    Error, Result, gpu::Gpu, image_file::write::make_folder, measure::choice::store::version, reference::cache::Keep,
};
use std::path::Path;

/// Measures all that is not in `folder` yet. `tick` is called with the work that was done, in units of
/// [`ChartOptions::work`], and with what comes next.
///
/// # Errors
/// Fails if the folder cannot be written or holds a chart of another device, size or version, or if something
/// cannot be rendered. Fails with [`Error::Interrupted`] if it is stopped. All finished results are then in
/// the folder.
pub fn run(
    gpu: &Gpu,
    inputs: &[ChartInput],
    options: &ChartOptions,
    folder: &Path,
    keep: Keep,
    tick: &mut dyn FnMut(u64, &str),
) -> Result<Chart> {
    let mut chart = open(gpu, options, folder)?;
    for input in inputs {
        let prepared = PreparedScene::new(gpu, input, options, folder, keep, tick)?;
        let scene = prepared.scene.clone();
        chart.points.retain(|point| point.scene != scene.name || prepared.counts(point));
        match chart.scenes.iter_mut().find(|known| known.name == scene.name) {
            Some(known) => *known = scene,
            None => chart.scenes.push(scene),
        }
        chart.save(folder)?;
        for round in 0..options.rounds {
            for (spec, key) in options.points.iter().zip(&prepared.keys) {
                keep.go_on(&folder.display().to_string())?;
                let label = format!("{}, {}", input.name, spec.name);
                tick(0, &label);
                let known = chart.points.iter_mut().find(|point| point.key == *key && point.scene == input.name);
                match known {
                    Some(point) if point.rounds.len() as u32 > round => {}
                    Some(point) => {
                        point.rounds.push(rounds::another(gpu, &prepared.task(spec, round)?, keep)?);
                        point.summarise();
                        chart.save(folder)?;
                    }
                    None => {
                        let point = rounds::first(gpu, &prepared.task(spec, 0)?, key, keep)?;
                        chart.points.push(point);
                        chart.save(folder)?;
                    }
                }
                tick(options.round_work(spec, round), &label);
            }
        }
        let label = format!("{}, choices for targets", input.name);
        tick(0, &label);
        prepared.chooser(gpu, keep)?.run(&mut chart, &|chart| chart.save(folder), &mut |work| tick(work, &label))?;
    }
    Ok(chart)
}

/// Reads the chart in a folder, or makes an empty one.
fn open(gpu: &Gpu, options: &ChartOptions, folder: &Path) -> Result<Chart> {
    make_folder(&folder.join(PICTURES))?;
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
    /// The conditions in a line for people.
    pub fn text(&self) -> String {
        let [width, height] = self.size;
        format!(
            "{} ({}), {width}×{height} {}, seed {}, looks {:?}, moving {}, truth-spp {:?}, version {}",
            self.device, self.driver, self.projection, self.seed, self.looks, self.moving, self.truth_spp, self.version
        )
    }
}
