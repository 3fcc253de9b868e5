//! Which points a chart has: methods, `reference` with more and more paths, and settings changed one at a time.

use super::point::Cost;
use crate::{
    Error, Result,
    settings::{Method, Settings},
};

/// A point to be measured.
#[derive(Clone, Debug, PartialEq)]
pub struct Spec {
    /// What people call it.
    pub name: String,
    /// The setting that is changed, or `method`, `reference`, `limit`.
    pub group: &'static str,
    /// The point it differs from in that setting alone.
    pub base: String,
    /// Preset.
    pub method: Method,
    /// Whether the preset is converged: every pixel traced, nothing filtered, nothing forgotten.
    pub converged: bool,
    /// Settings over the preset.
    pub set: Vec<(&'static str, &'static str)>,
    /// Width and height that are rendered, as shares of the picture's.
    pub scale: f32,
    /// What its time is of.
    pub cost: Cost,
    /// Frames after which the picture is looked at; none: the chart's own.
    pub frames: Option<u32>,
}

/// How many points.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Sweep {
    /// The methods and their limits.
    Methods,
    /// And the settings that matter most, few values of each.
    Small,
    /// And every setting.
    Full,
}

impl Sweep {
    /// All, the smallest first.
    pub const ALL: [(&'static str, Self); 3] =
        [("methods", Self::Methods), ("small", Self::Small), ("full", Self::Full)];

    /// From its name on the command line.
    ///
    /// # Errors
    /// Another name.
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

    /// Its points, the methods first.
    pub fn points(self) -> Vec<Spec> {
        let mut points: Vec<Spec> = [Method::Iprt, Method::Paper, Method::Ibl].map(Spec::method).into();
        match self {
            Self::Methods => points.extend([Method::Paper, Method::Ibl].map(|method| Spec::limit(method, 256))),
            Self::Small => points.extend([1, 4, 16].map(Spec::reference)),
            Self::Full => {
                points.extend([Method::Paper, Method::Ibl].map(|method| Spec::limit(method, 256)));
                points.extend([1, 4, 16, 64, 256].map(Spec::reference));
            }
        }
        let settings = match self {
            Self::Methods => &[][..],
            Self::Small => SMALL,
            Self::Full => FULL,
        };
        for (method, setting, values) in settings {
            points.extend(values.iter().map(|value| Spec::setting(*method, setting, value)));
        }
        let scales = match self {
            Self::Methods => &[][..],
            Self::Small => &[0.5][..],
            Self::Full => &[0.25, 0.5, 0.75][..],
        };
        points.extend(scales.iter().map(|scale| Spec::scaled(*scale)));
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
    (Method::Iprt, "clamp", &["0"]),
];

const FULL: &[Values] = &[
    (Method::Iprt, "rays_per_pixel", &["0.0625", "0.125", "0.5", "1"]),
    (Method::Iprt, "sampling_mask", &["false"]),
    (Method::Iprt, "mask_by", &["discontinuity"]),
    (Method::Iprt, "short_history", &["0", "16"]),
    (Method::Iprt, "sharp_roughness", &["0", "1"]),
    (Method::Iprt, "interpolate", &["false"]),
    (Method::Iprt, "atrous_levels", &["0", "1", "2", "3", "4"]),
    (Method::Iprt, "sigma_luminance", &["1", "4", "inf"]),
    (Method::Iprt, "filter_order", &["spatial_first"]),
    (Method::Iprt, "temporal", &["false"]),
    (Method::Iprt, "history", &["8", "16", "32", "inf"]),
    (Method::Iprt, "history_moving", &["4", "32"]),
    (Method::Iprt, "clamp", &["0", "0.5", "2"]),
    (Method::Iprt, "clamp_when", &["always"]),
    (Method::Iprt, "normal_radius", &["1", "4"]),
    (Method::Iprt, "edge_ratio", &["0.05", "0.2"]),
    (Method::Iprt, "thickness", &["0", "0.1", "1", "inf"]),
    (Method::Iprt, "real_tracer", &["march", "direction"]),
    (Method::Iprt, "virtual_tracer", &["screen"]),
    (Method::Iprt, "directions", &["brdf", "light"]),
    (Method::Iprt, "bounces", &["1", "2", "8"]),
    (Method::Iprt, "relight_levels", &["0", "2"]),
    (Method::Iprt, "relight_width", &["64", "128", "512"]),
    (Method::Iprt, "fill_unseen", &["true"]),
    (Method::Iprt, "coverage_samples", &["4", "64"]),
    (Method::Iprt, "relighting", &["ratio"]),
    (Method::Paper, "mask_angle", &["5", "20"]),
    (Method::Paper, "mask_distance", &["0.005", "0.02"]),
    (Method::Paper, "screen_thickness", &["0.03", "0.3", "inf"]),
    (Method::Paper, "screen_stride", &["4"]),
    (Method::Paper, "screen_jitter", &["0"]),
];

impl Spec {
    fn method(method: Method) -> Self {
        Self {
            name: method.name(),
            group: "method",
            base: String::new(),
            method,
            converged: false,
            set: Vec::new(),
            scale: 1.0,
            cost: Cost::Frame,
            frames: None,
        }
    }

    /// A method's own model, converged: where it would end up.
    fn limit(method: Method, paths: u32) -> Self {
        Self {
            name: format!("{}, converged", method.name()),
            group: "limit",
            converged: true,
            cost: Cost::Picture,
            frames: Some(paths),
            ..Self::method(method)
        }
    }

    /// The relit panorama gets as many paths as the picture, and no more before it: they are part of the cost.
    fn reference(paths: u32) -> Self {
        let unit = if paths == 1 { "path" } else { "paths" };
        Self {
            name: format!("reference, {paths} {unit}"),
            group: "reference",
            set: vec![("relight_warmup", "0")],
            cost: Cost::Picture,
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

    /// Rendered smaller and stretched bilinearly, as an internal resolution would be.
    fn scaled(scale: f32) -> Self {
        Self {
            name: format!("scale = {scale}"),
            group: "scale",
            base: Method::Iprt.name(),
            scale,
            ..Self::method(Method::Iprt)
        }
    }

    /// All settings: the preset, then what the scene sets, then the point's own.
    ///
    /// # Errors
    /// What the scene sets is none.
    pub fn settings(&self, of_scene: &[(String, String)], subject: &str) -> Result<Settings> {
        let mut settings = Settings::of(self.method);
        if self.converged {
            settings.converge();
            // as with `reference`, the relit panorama is paid for by the frames
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
        // the first counts only where pictures converge, the second only where rays march
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
