//! Scores pictures against both truths, by region.
//!
//! A picture is compared with *model truth* as it is. Against *scene truth*, real pixels are scored on the
//! relighting: their yardstick is L_cam · (truth with objects / truth without). The panorama's resolution is
//! then not counted as the method's error. Where a pixel is not wholly real, the yardstick is the truth
//! itself.

use super::{
    metrics::{Metrics, NoiseFree, Picture, compare_regions},
    regions::Regions,
};
use crate::{
    Result,
    gpu::Gpu,
    options::RenderOptions,
    reference::cache::Truth,
    renderer::Renderer,
    scene::Scene,
    settings::{Method, Settings},
};
use serde::{Deserialize, Serialize};

/// Where the truth without objects is darker than this radiance, it is not divided by.
const LEAST: f32 = 1e-4;

/// Metrics by region. A region without a pixel has none.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Score {
    /// All pixels.
    pub whole: Metrics,
    /// Pixels that are less than half real.
    #[serde(rename = "virtual")]
    pub virtual_: Option<Metrics>,
    /// Real pixels that objects change by more than 2 %.
    pub influenced: Option<Metrics>,
}

impl Score {
    /// Name and metrics of each region that has a pixel.
    pub fn regions(&self) -> Vec<(&'static str, &Metrics)> {
        let all = [Some(&self.whole), self.virtual_.as_ref(), self.influenced.as_ref()];
        REGIONS.iter().zip(all).filter_map(|(name, metrics)| Some((*name, metrics?))).collect()
    }

    /// The metrics of a region by its name.
    pub fn region(&self, name: &str) -> Option<&Metrics> {
        self.regions().into_iter().find_map(|(region, metrics)| (region == name).then_some(metrics))
    }
}

/// The names of the regions, in the order of all tables.
pub const REGIONS: [&str; 3] = ["whole", "virtual", "influenced"];

/// The scores of a picture against both truths.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Scores {
    /// What sampling, sparsity and filtering cost. It includes the cost of another geometry where the method
    /// has one, as `ibl` has.
    pub model: Score,
    /// What the model costs in addition. It is there only if the true scene is known.
    pub scene: Option<Score>,
}

/// The truth that a picture is compared with.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum TruthKind {
    /// The truth that `reference --model panorama` computes.
    Model,
    /// The truth that `reference --model scene` computes.
    Scene,
}

impl TruthKind {
    /// Both kinds, the better one first.
    pub const ALL: [Self; 2] = [Self::Scene, Self::Model];

    /// The name for people.
    pub fn name(self) -> &'static str {
        match self {
            Self::Model => "model truth",
            Self::Scene => "scene truth",
        }
    }

    /// The score against this truth, if there is one.
    pub fn of(self, scores: &Scores) -> Option<&Score> {
        match self {
            Self::Model => Some(&scores.model),
            Self::Scene => scores.scene.as_ref(),
        }
    }
}

/// A truth that pictures are compared with, and its own noise.
#[derive(Clone, Debug)]
pub struct Yardstick {
    /// Linear radiance.
    pub radiance: Vec<[f32; 4]>,
    /// Two independent estimates of it, with half of the samples each.
    pub halves: [Vec<[f32; 4]>; 2],
    /// The score of one half of the truth against the other half.
    pub noise: Score,
}

impl Yardstick {
    /// Makes a yardstick of model truth.
    ///
    /// # Errors
    /// Fails if the regions have another size, or if a radiance is not finite.
    pub fn of_model(truth: &Truth, regions: &Regions, exposure: f32) -> Result<Self> {
        Self::new(truth.size, truth.radiance.clone(), truth.halves.clone(), regions, exposure)
    }

    /// Makes a yardstick of scene truth, from the truths with the objects and without.
    ///
    /// # Errors
    /// Fails if the truths have another size than the view, or if a radiance is not finite.
    pub fn of_scene(view: &RealView, truths: [&Truth; 2], regions: &Regions, exposure: f32) -> Result<Self> {
        let [with, without] = truths;
        let halves = [0, 1].map(|i| relit(view, &with.halves[i], &without.halves[i]));
        Self::new(with.size, relit(view, &with.radiance, &without.radiance), halves, regions, exposure)
    }

    fn new(
        size: [u32; 2],
        radiance: Vec<[f32; 4]>,
        halves: [Vec<[f32; 4]>; 2],
        regions: &Regions,
        exposure: f32,
    ) -> Result<Self> {
        let noise = score(size, &halves[0], &halves[1], regions, exposure)?;
        Ok(Self { radiance, halves, noise })
    }

    /// Makes a yardstick of the picture without objects. It is exact, and it has only one region.
    ///
    /// # Errors
    /// Fails if a radiance is not finite.
    pub fn of_nothing(view: &RealView, size: [u32; 2], regions: &Regions, exposure: f32) -> Result<Self> {
        let radiance = view.camera_radiance.clone();
        Self::new(size, radiance.clone(), [radiance.clone(), radiance], regions, exposure)
    }

    /// Scores a picture of linear radiance.
    ///
    /// # Errors
    /// Fails if the picture has another size, or if a radiance is not finite.
    pub fn score(&self, size: [u32; 2], picture: &[[f32; 4]], regions: &Regions, exposure: f32) -> Result<Score> {
        let Score { mut whole, mut virtual_, mut influenced } =
            score(size, picture, &self.radiance, regions, exposure)?;
        let [a, b] = &self.halves;
        let free = |mask| NoiseFree::of(picture, [a, b], mask);
        whole.noise_free = free(None);
        for (metrics, mask) in [(&mut virtual_, &regions.virtual_), (&mut influenced, &regions.influenced)] {
            if let Some(metrics) = metrics {
                metrics.noise_free = free(Some(mask));
            }
        }
        Ok(Score { whole, virtual_, influenced })
    }
}

/// The real part of a view.
#[derive(Clone, Debug)]
pub struct RealView {
    /// The picture of the panorama alone, without objects (L_cam).
    pub camera_radiance: Vec<[f32; 4]>,
    /// Each pixel's real share M.
    pub real_coverage: Vec<f32>,
}

/// Renders the real part of a view at a time in seconds. Nothing in it is random.
///
/// # Errors
/// Fails if the renderer fails.
pub fn real_view(gpu: &Gpu, scene: &Scene, options: &RenderOptions, time: f64) -> Result<RealView> {
    let mut settings = Settings::of(Method::Reference);
    (settings.relight_levels, settings.bounces) = (0, 1);
    let with = RenderOptions { method: Method::Reference, settings, without_objects: false, ..options.clone() };
    let without = RenderOptions { without_objects: true, ..with.clone() };
    let mut renderer = Renderer::new(gpu, scene, without)?;
    renderer.render(scene, time)?;
    let camera_radiance = renderer.picture()?;
    drop(renderer);
    let mut renderer = Renderer::new(gpu, scene, with)?;
    renderer.render(scene, time)?;
    Ok(RealView { camera_radiance, real_coverage: renderer.real_coverage()? })
}

/// The truths of one view, ready to score pictures of it.
#[derive(Clone, Debug)]
pub struct Scorer {
    /// Width and height, pixels.
    pub size: [u32; 2],
    /// Factor on radiance before display.
    pub exposure: f32,
    /// The regions by scene truth if it is known, otherwise by model truth.
    pub regions: Regions,
    /// Model truth.
    pub model: Yardstick,
    /// Scene truth, if it is known.
    pub scene: Option<Yardstick>,
}

impl Scorer {
    /// Prepares the truths. `scene` is scene truth with the objects and without.
    ///
    /// # Errors
    /// Fails if the truths have another size than the view, or if a radiance is not finite.
    pub fn new(
        view: &RealView,
        regions: Regions,
        model: &Truth,
        scene: Option<[&Truth; 2]>,
        exposure: f32,
    ) -> Result<Self> {
        let size = model.size;
        let scene = scene.map(|truths| Yardstick::of_scene(view, truths, &regions, exposure)).transpose()?;
        let model = Yardstick::of_model(model, &regions, exposure)?;
        Ok(Self { size, exposure, regions, model, scene })
    }

    /// Scores a picture of linear radiance.
    ///
    /// # Errors
    /// Fails if the picture has another size, or if a radiance is not finite.
    pub fn score(&self, picture: &[[f32; 4]]) -> Result<Scores> {
        let against = |truth: &Yardstick| truth.score(self.size, picture, &self.regions, self.exposure);
        Ok(Scores { model: against(&self.model)?, scene: self.scene.as_ref().map(against).transpose()? })
    }

    /// Scene truth if it is known, otherwise model truth.
    pub fn best(&self) -> &Yardstick {
        self.scene.as_ref().unwrap_or(&self.model)
    }
}

fn score(size: [u32; 2], test: &[[f32; 4]], truth: &[[f32; 4]], regions: &Regions, exposure: f32) -> Result<Score> {
    let picture = |subject, texels| Picture { subject, size, texels };
    let masks = [None, Some(regions.virtual_.as_slice()), Some(regions.influenced.as_slice())];
    let found = compare_regions(picture("the picture", test), picture("the truth", truth), &masks, exposure)?;
    let [Some(whole), virtual_, influenced] = found[..] else {
        return Err(crate::Error::input("size", "the picture has no pixel", "give a width and a height of at least 1"));
    };
    Ok(Score { whole, virtual_, influenced })
}

/// The yardstick of scene truth: L_cam · (with / without) where a pixel is wholly real, otherwise `with`.
fn relit(view: &RealView, with: &[[f32; 4]], without: &[[f32; 4]]) -> Vec<[f32; 4]> {
    let texel = |i: usize| {
        let (camera, with, without) = (view.camera_radiance[i], with[i], without[i]);
        std::array::from_fn(|c| match c {
            3 => 1.0,
            _ if view.real_coverage[i] < 1.0 || without[c] < LEAST => with[c],
            _ => camera[c] * (with[c] / without[c]),
        })
    };
    (0..with.len()).map(texel).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    const SIZE: [u32; 2] = [24, 16];

    fn grey(value: impl Fn(usize) -> f32) -> Vec<[f32; 4]> {
        (0..384).map(|i| [value(i), value(i), value(i), 1.0]).collect()
    }

    fn truth(halves: [Vec<[f32; 4]>; 2]) -> Truth {
        let mean = |(a, b): (&[f32; 4], &[f32; 4])| std::array::from_fn(|c| 0.5 * (a[c] + b[c]));
        let radiance = halves[0].iter().zip(&halves[1]).map(mean).collect();
        Truth { size: SIZE, radiance, halves, spp: 2, outliers: 0.0 }
    }

    fn exact(texels: &[[f32; 4]]) -> Truth {
        truth([texels.to_vec(), texels.to_vec()])
    }

    /// The left third is an object. The middle third is in its shadow, which halves the light. The panorama
    /// is a tenth too dark.
    fn shadow() -> (RealView, Truth, Truth, Truth) {
        let third = |i: usize| i % 24 / 8;
        let without = grey(|_| 0.5);
        let with = grey(|i| [0.7, 0.25, 0.5][third(i)]);
        let camera_radiance = grey(|_| 0.45);
        let model = grey(|i| [0.7, 0.225, 0.45][third(i)]);
        let real_coverage = (0..384).map(|i| if third(i) == 0 { 0.0 } else { 1.0 }).collect();
        (RealView { camera_radiance, real_coverage }, exact(&model), exact(&with), exact(&without))
    }

    fn found(view: &RealView, with: &Truth, without: &Truth) -> Regions {
        crate::measure::regions::regions(SIZE, &with.radiance, &without.radiance, &view.real_coverage)
    }

    #[test]
    fn real_pixels_are_scored_on_the_relighting() {
        let (view, model, with, without) = shadow();
        let scorer =
            Scorer::new(&view, found(&view, &with, &without), &model, Some([&with, &without]), 1.0).expect("scores");
        let scores = scorer.score(&model.radiance).expect("scores");
        for (region, metrics) in scores.model.regions().into_iter().chain(scores.scene.expect("known").regions()) {
            assert!(metrics.rmse < 1e-6 && metrics.flip < 1e-3, "{region}: {metrics:?}");
        }
        assert_eq!(scores.model.virtual_.expect("an object").pixels, 8 * 16);
        // At the shadow's edge the 5×5 windows reach 2 pixels into the light. Beside the object they include
        // the object.
        assert_eq!(scores.model.influenced.expect("a shadow").pixels, 10 * 16);
    }

    #[test]
    fn a_shadow_that_is_missing_is_an_error_of_the_influenced_region_alone() {
        let (view, model, with, without) = shadow();
        let scorer =
            Scorer::new(&view, found(&view, &with, &without), &model, Some([&with, &without]), 1.0).expect("scores");
        let lit = grey(|i| if i % 24 < 8 { 0.7 } else { 0.45 });
        let score = scorer.score(&lit).expect("scores").scene.expect("known");
        assert!((score.virtual_.expect("an object").rmse) < 1e-6);
        // 8 of 10 columns lack a shadow of 0.225.
        let expected = 0.225 * (0.8f64).sqrt();
        assert!((score.influenced.expect("a shadow").rmse - expected).abs() < 1e-6);
    }

    #[test]
    fn without_scene_truth_there_is_no_such_score() {
        let (view, model, with, without) = shadow();
        let scorer = Scorer::new(&view, found(&view, &with, &without), &model, None, 1.0).expect("scores");
        let scores = scorer.score(&model.radiance).expect("scores");
        assert!(scores.scene.is_none() && scores.model.whole.rmse == 0.0);
        assert_eq!(scores.model.influenced.expect("a shadow").pixels, 10 * 16);
        let text = serde_json::to_string(&scores).expect("JSON");
        assert_eq!(serde_json::from_str::<Scores>(&text).expect("as it was"), scores);
    }

    #[test]
    fn the_noise_is_the_difference_of_the_halves() {
        let (view, _, with, without) = shadow();
        let noisy = truth([grey(|_| 0.4), grey(|_| 0.6)]);
        let scorer =
            Scorer::new(&view, found(&view, &with, &without), &noisy, Some([&with, &without]), 1.0).expect("scores");
        assert!((scorer.model.noise.whole.rmse - 0.2).abs() < 1e-6);
        // 0.5 is between the halves, so that nothing but noise speaks against it; 0.7 is off by 0.2.
        let free = |v: f32| {
            let score = scorer.score(&grey(|_| v)).expect("scores").model.whole;
            score.noise_free.expect("two halves").rmse
        };
        assert!(free(0.5) == 0.0 && (free(0.7) - 0.03f64.sqrt()).abs() < 1e-6, "{}, {}", free(0.5), free(0.7));
        assert_eq!(scorer.scene.expect("known").noise.whole.rmse, 0.0);
    }
}
