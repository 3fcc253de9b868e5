//! Prepares a scene to be measured on: its truths, its regions, and the scores that need no method.

use super::{
    choices::Chooser,
    options::{ChartInput, ChartOptions, PATH_WORK},
    pictures::{PICTURES, file_name, write_difference, write_picture},
    point::{ChartPoint, ChartScene},
    rounds::Task,
    sweep::PointSpec,
};
use crate::{
    Result,
    gpu::Gpu,
    image_file::write::write_png,
    measure::{
        metrics::Picture,
        regions::{self, Regions},
        score::{REGIONS, RealView, Scorer, Scores, real_view},
    },
    options::RenderOptions,
    reference::{
        cache::{self, Keep, Truth, hash_rendered, truth_of_model, truth_of_scene},
        stored::StoredTruths,
    },
    scene::viewpoint::Projection,
    settings::{Method, Settings},
};
use std::{collections::BTreeMap, path::Path};

/// A scene that is ready to be measured on.
pub(super) struct PreparedScene<'a> {
    input: &'a ChartInput,
    options: &'a ChartOptions,
    folder: &'a Path,
    pub(super) scene: ChartScene,
    scorer: Scorer,
    of_scene: Vec<(String, String)>,
    /// The key of each point.
    pub(super) keys: Vec<String>,
}

impl<'a> PreparedScene<'a> {
    pub(super) fn new(
        gpu: &Gpu,
        input: &'a ChartInput,
        options: &'a ChartOptions,
        folder: &'a Path,
        keep: Keep,
        tick: &mut dyn FnMut(u64, &str),
    ) -> Result<Self> {
        let time = input.scene.panorama.frame_time(options.frame as usize);
        let of_scene = input.scene.render.set_text();
        let base = options.render_options(Settings::of(Method::Reference), Method::Reference);
        let label = format!("{}, model truth", input.name);
        tick(0, &label);
        let mut path = || tick(PATH_WORK, &label);
        let model = truth_of_model(gpu, &input.scene, &base, &of_scene, time, options.model_spp, keep, &mut path)?;
        let stored = stored(input, options, time)?;
        let source = stored.as_ref().map_or(String::new(), |(_, made_by)| format!(", stored, by {made_by}"));
        let label = format!("{}, scene truth{source}", input.name);
        tick(0, &label);
        let mut sample = || tick(1, &label);
        let (complete, stored) = match (&input.complete, stored) {
            (_, Some((truths, made_by))) => (Some(truths), Some(made_by)),
            (None, None) => (None, None),
            (Some([with, without]), None) => {
                let mut truth = |scene| truth_of_scene(gpu, scene, &base, time, options.scene_spp, keep, &mut sample);
                (Some([truth(with)?, truth(without)?]), None)
            }
        };
        let view = real_view(gpu, &input.scene, &base, time)?;
        let exposure = input.scene.render.exposure;
        let regions = regions_of(gpu, input, options, &base, &view, &model)?;
        let scorer = Scorer::new(&view, regions, &model, complete.as_ref().map(|[a, b]| [a, b]), exposure)?;
        let model_scores = scorer.score(&model.radiance)?;
        let share = |mask: &[bool]| mask.iter().filter(|inside| **inside).count() as f64 / mask.len() as f64;
        let regions = [1.0, share(&scorer.regions.virtual_), share(&scorer.regions.influenced)];
        let scene_spp = complete.as_ref().map_or(0, |[with, _]| with.spp);
        let mut hasher = hash_rendered(&input.scene, time)?;
        hasher.update(cache::describe(&base).as_bytes()).update(format!("{of_scene:?} {exposure}").as_bytes());
        hasher.update(bytemuck::cast_slice(&scorer.model.radiance));
        if let Some(truth) = &scorer.scene {
            hasher.update(bytemuck::cast_slice(&truth.radiance));
        }
        let key = hasher.finalize().to_hex()[..16].to_owned();
        let scene = ChartScene {
            name: input.name.clone(),
            exposure,
            time,
            panorama: input.scene.panorama.load(input.scene.panorama.frame_at(time))?.color_size,
            regions: REGIONS.iter().zip(regions).map(|(name, share)| ((*name).to_owned(), share)).collect(),
            model_spp: model.spp,
            scene_spp,
            stored,
            outliers: [model.outliers, complete.as_ref().map_or(0.0, |[with, _]| with.outliers)],
            noise: Scores { model: scorer.model.noise, scene: scorer.scene.as_ref().map(|truth| truth.noise) },
            floor: model_scores.scene,
            nothing: scorer.score(&view.camera_radiance)?,
            pictures: truth_pictures(input, &scorer, folder)?,
            key,
        };
        let keys = options
            .points
            .iter()
            .map(|spec| {
                let settings = spec.settings(&of_scene, &input.name)?;
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
        Ok(Self { input, options, folder, scene, scorer, of_scene, keys })
    }

    /// Whether a point that an earlier run measured still holds for this scene. It holds if it is asked for
    /// now, or if it comes from another sweep but has the same truths.
    pub(super) fn counts(&self, point: &ChartPoint) -> bool {
        let same_truths = point.key.strip_prefix(&self.scene.key).is_some_and(|rest| rest.starts_with('-'));
        let asked_for = self.options.points.iter().any(|spec| spec.name == point.name);
        self.keys.contains(&point.key) || (same_truths && !asked_for)
    }

    pub(super) fn chooser(&'a self, gpu: &'a Gpu, keep: Keep<'a>) -> Result<Chooser<'a>> {
        Ok(Chooser {
            gpu,
            scene: &self.input.scene,
            of: &self.scene,
            scorer: &self.scorer,
            settings: self.input.settings()?,
            chart: self.options,
            keep,
        })
    }

    pub(super) fn task(&'a self, spec: &'a PointSpec, round: u32) -> Result<Task<'a>> {
        let settings = spec.settings(&self.of_scene, &self.input.name)?;
        Ok(Task {
            scene: &self.input.scene,
            name: &self.input.name,
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

/// Finds the stored truths of a scene with objects and without, and what made them.
fn stored(input: &ChartInput, options: &ChartOptions, time: f64) -> Result<Option<([Truth; 2], String)>> {
    let (Some([with, without]), Some(folder)) = (&input.complete, &options.truths) else { return Ok(None) };
    if options.projection != Projection::Perspective {
        return Ok(None);
    }
    let stored = StoredTruths::open(folder)?;
    let found = stored.find(with, options.size, time)?.zip(stored.find(without, options.size, time)?);
    Ok(found.map(|((with, made_by), (without, _))| ([with, without], made_by.to_owned())))
}

/// Samples of the filtered truths that the regions come from. `masks` takes the same number.
const REGION_SPP: u32 = 64;

/// Finds the regions by scene truth if it is known, otherwise by model truth.
fn regions_of(
    gpu: &Gpu,
    input: &ChartInput,
    options: &ChartOptions,
    base: &RenderOptions,
    view: &RealView,
    model: &Truth,
) -> Result<Regions> {
    match &input.complete {
        Some([with, without]) => {
            let samples = options.scene_spp.min(REGION_SPP);
            regions::of_scene(gpu, &input.scene, base, [with, without], options.frame, samples, || ())
        }
        None => Ok(regions::regions(options.size, &model.radiance, &view.camera_radiance, &view.real_coverage)),
    }
}

fn truth_pictures(input: &ChartInput, scorer: &Scorer, folder: &Path) -> Result<BTreeMap<String, String>> {
    let mut pictures = BTreeMap::new();
    let mut write = |what: &str, write: &dyn Fn(&Path) -> Result<()>| -> Result<()> {
        let file = format!("{PICTURES}/{}-{what}.png", file_name(&input.name));
        write(&folder.join(&file))?;
        pictures.insert(what.to_owned(), file);
        Ok(())
    };
    let panorama = &input.scene.panorama;
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
