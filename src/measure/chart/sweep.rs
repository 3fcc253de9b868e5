//! Lists the points of a chart: methods, `reference` with more and more paths, and settings that are changed
//! one at a time.

use super::point::CostUnit;
use crate::{
    Error, Result,
    settings::{Method, Settings},
};

/// A point to measure.
#[derive(Clone, Debug, PartialEq)]
pub struct PointSpec {
    /// The name for people.
    pub name: String,
    /// The changed setting, or `method`, `reference` or `limit`.
    pub group: &'static str,
    /// The name of the point that differs from this one in that setting alone. It is empty for methods.
    pub base: String,
    /// The preset.
    pub method: Method,
    /// Whether the preset is converged. Then every pixel is traced, nothing is filtered, and the history
    /// forgets nothing.
    pub converged: bool,
    /// Settings over the preset.
    pub set: Vec<(&'static str, &'static str)>,
    /// Width and height that are rendered, as a share of the picture's.
    pub scale: f32,
    /// What its time measures.
    pub cost: CostUnit,
    /// Number of frames after which its picture is scored. `None` stands for the chart's own numbers.
    pub frames: Option<u32>,
}

/// How many points a chart has.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Sweep {
    /// The methods and their limits.
    Methods,
    /// The methods, and a few values of the settings that matter most.
    Small,
    /// The methods, and values of every setting.
    Full,
}

impl Sweep {
    /// All sweeps and their names, the smallest first.
    pub const ALL: [(&'static str, Self); 3] =
        [("methods", Self::Methods), ("small", Self::Small), ("full", Self::Full)];

    /// Finds a sweep by its name on the command line.
    ///
    /// # Errors
    /// Fails if there is no sweep of this name.
    pub fn parse(name: &str, subject: &str) -> Result<Self> {
        Self::ALL.iter().find(|(known, _)| *known == name).map(|(_, sweep)| *sweep).ok_or_else(|| {
            let names: Vec<_> = Self::ALL.iter().map(|(name, _)| *name).collect();
            Error::input(subject, format!("unknown sweep \"{name}\""), format!("use {}", names.join(", ")))
        })
    }

    /// The name that [`Sweep::parse`] takes.
    pub fn name(self) -> &'static str {
        Self::ALL.iter().find(|(_, sweep)| *sweep == self).map_or("", |(name, _)| name)
    }

    /// The points of the sweep, the methods first.
    pub fn points(self) -> Vec<PointSpec> {
        let mut points: Vec<PointSpec> = [Method::Iprt, Method::Paper, Method::Ibl].map(PointSpec::method).into();
        match self {
            Self::Methods => points.extend([Method::Paper, Method::Ibl].map(|method| PointSpec::limit(method, 256))),
            Self::Small => points.extend([1, 4, 16].map(PointSpec::reference)),
            Self::Full => {
                points.extend([Method::Paper, Method::Ibl].map(|method| PointSpec::limit(method, 256)));
                points.extend([1, 4, 16, 64, 256].map(PointSpec::reference));
            }
        }
        let settings = match self {
            Self::Methods => &[][..],
            Self::Small => SMALL,
            Self::Full => FULL,
        };
        for (method, setting, values) in settings {
            points.extend(values.iter().map(|value| PointSpec::setting(*method, setting, value)));
        }
        let scales = match self {
            Self::Methods => &[][..],
            Self::Small => &[0.5][..],
            Self::Full => &[0.25, 0.5, 0.75][..],
        };
        points.extend(scales.iter().map(|scale| PointSpec::scaled(*scale)));
        points
    }
}

/// A setting of a method, and the values that are tried besides its default.
type Values = (Method, &'static str, &'static [&'static str]);

const SMALL: &[Values] = &[
    (Method::Iprt, "rays_per_pixel", &["0.0625", "0.5", "1"]),
    (Method::Iprt, "sampling_mask", &["false"]),
    (Method::Iprt, "mask_by", &["discontinuity"]),
    (Method::Iprt, "atrous_levels", &["0", "2", "4"]),
    (Method::Iprt, "filter_order", &["spatial_first"]),
    (Method::Iprt, "temporal", &["false"]),
    (Method::Iprt, "history", &["8"]),
    (Method::Iprt, "real_tracer", &["march"]),
    (Method::Iprt, "thickness", &["inf"]),
    (Method::Iprt, "directions", &["brdf"]),
    (Method::Iprt, "relight_levels", &["0"]),
    (Method::Iprt, "relight_width", &["128"]),
    (Method::Iprt, "clamp", &["1"]),
];

const FULL: &[Values] = &[
    (Method::Iprt, "rays_per_pixel", &["0.0625", "0.125", "0.5", "1"]),
    (Method::Iprt, "sampling_mask", &["false"]),
    (Method::Iprt, "mask_by", &["discontinuity"]),
    (Method::Iprt, "short_history", &["0", "16"]),
    (Method::Iprt, "sharp_roughness", &["0", "1"]),
    (Method::Iprt, "rest_noise", &["0", "0.01", "0.04"]),
    (Method::Iprt, "early_paths", &["1", "2", "8"]),
    (Method::Iprt, "early_history", &["16", "32"]),
    (Method::Iprt, "interpolate", &["false"]),
    (Method::Iprt, "least_share", &["0.03", "1"]),
    (Method::Iprt, "atrous_levels", &["0", "1", "2", "4", "5"]),
    (Method::Iprt, "atrous_radius", &["1"]),
    (Method::Iprt, "sigma_luminance", &["1.5", "4", "inf"]),
    (Method::Iprt, "filter_order", &["spatial_first"]),
    (Method::Iprt, "temporal", &["false"]),
    (Method::Iprt, "history", &["8", "16", "32", "inf"]),
    (Method::Iprt, "history_change", &["0.2", "2"]),
    (Method::Iprt, "clamp", &["0.5", "1", "2"]),
    (Method::Iprt, "normal_radius", &["1", "4"]),
    (Method::Iprt, "smooth_depth", &["false"]),
    (Method::Iprt, "edge_ratio", &["0.05", "0.2"]),
    (Method::Iprt, "thickness", &["0", "0.1", "1", "inf"]),
    (Method::Iprt, "edge_depth", &["false"]),
    (Method::Iprt, "skirt_luminance", &["inf"]),
    (Method::Iprt, "real_tracer", &["march", "direction"]),
    (Method::Iprt, "virtual_tracer", &["screen"]),
    (Method::Iprt, "directions", &["brdf", "light"]),
    (Method::Iprt, "path_limit", &["1", "inf"]),
    (Method::Iprt, "bounces", &["1", "2", "8"]),
    (Method::Iprt, "relight_levels", &["0", "2"]),
    (Method::Iprt, "relight_width", &["64", "128", "512"]),
    (Method::Iprt, "fill_unseen", &["true"]),
    (Method::Iprt, "coverage_samples", &["4", "64"]),
    (Method::Iprt, "relighting", &["ratio"]),
    (Method::Iprt, "despeckle", &["false"]),
    (Method::Paper, "history_moving", &["4", "32"]),
    (Method::Paper, "clamp_when", &["moving"]),
    (Method::Paper, "mask_angle", &["5", "20"]),
    (Method::Paper, "mask_distance", &["0.005", "0.02"]),
    (Method::Paper, "screen_thickness", &["0.03", "0.3", "inf"]),
    (Method::Paper, "screen_stride", &["4"]),
    (Method::Paper, "screen_jitter", &["0"]),
];

impl PointSpec {
    fn method(method: Method) -> Self {
        Self {
            name: method.name(),
            group: "method",
            base: String::new(),
            method,
            converged: false,
            set: Vec::new(),
            scale: 1.0,
            cost: CostUnit::Frame,
            frames: None,
        }
    }

    /// The converged model of a method, which is what it would end up with.
    fn limit(method: Method, paths: u32) -> Self {
        Self {
            name: format!("{}, converged", method.name()),
            group: "limit",
            converged: true,
            cost: CostUnit::Picture,
            frames: Some(paths),
            ..Self::method(method)
        }
    }

    /// Path traces the model. The relit panorama gets as many paths as the picture. It gets none before the
    /// picture, so that all of them are part of the cost.
    fn reference(paths: u32) -> Self {
        let unit = if paths == 1 { "path" } else { "paths" };
        Self {
            name: format!("reference, {paths} {unit}"),
            group: "reference",
            set: vec![("relight_warmup", "0")],
            cost: CostUnit::Picture,
            frames: Some(paths),
            ..Self::method(Method::Reference)
        }
    }

    fn setting(method: Method, setting: &'static str, value: &'static str) -> Self {
        let of = if method == Method::Iprt { String::new() } else { format!("{}: ", method.name()) };
        Self {
            name: format!("{of}{setting} = {value}"),
            group: setting,
            base: method.name(),
            set: vec![(setting, value)],
            ..Self::method(method)
        }
    }

    /// Renders smaller and stretches bilinearly, like an internal resolution.
    fn scaled(scale: f32) -> Self {
        Self {
            name: format!("scale = {scale}"),
            group: "scale",
            base: Method::Iprt.name(),
            scale,
            ..Self::method(Method::Iprt)
        }
    }

    /// Whether the point is a method as it is.
    pub fn is_method(&self) -> bool {
        self.group == "method"
    }

    /// All settings of the point: the preset's, over them the scene's, and over those the point's own.
    ///
    /// # Errors
    /// Fails if the scene gives an unknown setting or a bad value.
    pub fn settings(&self, of_scene: &[(String, String)], subject: &str) -> Result<Settings> {
        let mut settings = Settings::of(self.method);
        if self.converged {
            settings.converge();
            // As with `reference`, the frames pay for the relit panorama.
            settings.relight_warmup = 0;
        }
        for (key, value) in of_scene {
            settings.set(key, value, subject)?;
        }
        for (key, value) in &self.set {
            settings.set(key, value, &self.name)?;
        }
        Ok(settings)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::collections::BTreeSet;

    #[test]
    fn every_point_can_be_set_and_has_its_own_name() {
        for (_, sweep) in Sweep::ALL {
            let mut names = BTreeSet::new();
            for point in sweep.points() {
                let settings = point.settings(&[], "test").expect("good settings");
                assert!(names.insert(point.name.clone()), "{} twice", point.name);
                let base = Settings::of(point.method);
                let differs = settings != base || point.scale != 1.0 || point.group == "method";
                assert!(differs, "{} is no other than {}", point.name, point.method.name());
            }
            for point in sweep.points() {
                assert!(point.base.is_empty() || names.contains(&point.base), "{} has no base", point.name);
            }
        }
    }

    #[test]
    fn the_full_sweep_changes_every_setting() {
        let swept: BTreeSet<&str> = FULL.iter().map(|(_, setting, _)| *setting).collect();
        // The first setting matters only while pictures converge, the second only where rays march.
        let left_out = ["relight_warmup", "march_steps"];
        let missing: Vec<_> = Settings::TABLE
            .iter()
            .filter(|row| row.pass != "plan") // parts that are left out where nobody can tell
            .map(|row| row.name)
            .filter(|name| !swept.contains(name) && !left_out.contains(name))
            .collect();
        assert!(missing.is_empty(), "{missing:?}");
    }
}
