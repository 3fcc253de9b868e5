//! Every approximation is a named setting. One table gives its default for each method, its range and its
//! meaning.

use crate::{Error, Result};
use std::fmt::Write;

/// Declares a setting that chooses one of several named ways.
macro_rules! choices {
    ($( $(#[$doc:meta])* $name:ident { $( $variant:ident = $text:literal: $meaning:literal, )* } )*) => { $(
        $(#[$doc])*
        #[derive(Clone, Copy, Debug, PartialEq, Eq)]
        pub enum $name { $( #[doc = $meaning] $variant, )* }

        impl Value for $name {
            const CHOICES: &'static [(&'static str, &'static str)] = &[ $( ($text, $meaning), )* ];
            fn parse(text: &str, _: [f64; 2]) -> Option<Self> {
                match text { $( $text => Some(Self::$variant), )* _ => None }
            }
            fn text(&self) -> String {
                match self { $( Self::$variant => $text, )* }.to_owned()
            }
        }
    )* };
}

choices! {
    /// How the picture is made. The methods are presets of the same settings.
    Method {
        Iprt = "iprt": "the default: as good and as fast as this project knows",
        Paper = "paper": "what the paper states: screen-space tracing of virtual objects, BRDF sampling, spatial and then temporal filter, its equation 2",
        Ibl = "ibl": "image-based lighting: the panorama by direction alone, as if infinitely far; objects still occlude and cast",
        Reference = "reference": "the model of `iprt`, converged: many paths a pixel, no mask, no filter",
    }
    /// How rays meet the real scene.
    RealTracer {
        Surface = "surface": "the surface of the depth map, exactly",
        March = "march": "the depth as an image, looked at in `march_steps` places along the ray and then refined",
        Direction = "direction": "not at all: what a ray brings depends on its direction alone",
    }
    /// How rays meet virtual objects.
    VirtualTracer {
        Bvh = "bvh": "all triangles, by a two-level BVH",
        Screen = "screen": "what the picture shows of them, by walking its depth (McGuire and Mara 2014)",
        RayQuery = "ray_query": "all triangles, by the device's ray queries (`VK_KHR_ray_query`), where it has them",
    }
    /// What draws the directions of rays.
    Directions {
        Brdf = "brdf": "the surface's lobes",
        Light = "light": "the panorama's radiance, from a table that covers all of it; never skirts",
        Mis = "mis": "lobes and lamps together, by multiple importance sampling",
    }
    /// What `sampling_mask` chooses pixels by.
    MaskBy {
        History = "history": "a regular share of the pixels, and all that are newly seen or sharp",
        Discontinuity = "discontinuity": "a ray for each pixel whose 3×3 neighbours leave its surface, for every 2×2 where its 5×5 neighbours do, for every 4×4 elsewhere",
    }
    /// Which of the two filters runs first.
    FilterOrder {
        TemporalFirst = "temporal_first": "temporal, then atrous on the accumulated mean",
        SpatialFirst = "spatial_first": "atrous on this frame, then temporal (the paper's order)",
    }
    /// When the history is clamped.
    ClampWhen {
        Moving = "moving": "while an object moves or the video changes",
        Always = "always": "in every frame",
    }
    /// Whether a part of the model is used.
    Presence {
        Auto = "auto": "where the scene needs it",
        On = "on": "always",
        Off = "off": "never",
    }
    /// How a real surface answers a change of its light.
    Relighting {
        EmissionKept = "emission_kept": "L_cam + ΔE·min(L_cam/E_R, 1/π): what exceeds a diffuse surface's reflection is a lamp, and stays",
        Ratio = "ratio": "L_cam·E_RV/E_R, the paper's equation 2",
    }
}

impl Method {
    /// All methods, the default first.
    pub const ALL: [Self; 4] = [Self::Iprt, Self::Paper, Self::Ibl, Self::Reference];

    /// Reads a method's name, as the command line or a scene file gives it.
    pub fn parse(name: &str, subject: &str) -> Result<Self> {
        let names: Vec<_> = Self::CHOICES.iter().map(|(name, _)| *name).collect();
        <Self as Value>::parse(name, [0.0; 2]).ok_or_else(|| {
            Error::input(subject, format!("unknown method \"{name}\""), format!("use {}", names.join(", ")))
        })
    }

    /// Describes the method.
    pub fn meaning(self) -> &'static str {
        Self::CHOICES[self as usize].1
    }

    /// Returns the name that [`Method::parse`] takes.
    pub fn name(self) -> String {
        self.text()
    }
}

/// A type that a setting may have.
trait Value: Sized {
    /// Whether it is a whole number.
    const WHOLE: bool = false;
    /// Names and meanings of all values, if they can be counted.
    const CHOICES: &'static [(&'static str, &'static str)] = &[];
    /// Reads a value from text. Returns `None` if it is out of range.
    fn parse(text: &str, range: [f64; 2]) -> Option<Self>;
    /// Returns the text that [`Value::parse`] takes.
    fn text(&self) -> String;
}

impl Value for bool {
    const CHOICES: &'static [(&'static str, &'static str)] = &[("true", ""), ("false", "")];
    fn parse(text: &str, _: [f64; 2]) -> Option<Self> {
        match text {
            "true" | "on" | "1" => Some(true),
            "false" | "off" | "0" => Some(false),
            _ => None,
        }
    }
    fn text(&self) -> String {
        self.to_string()
    }
}

impl Value for u32 {
    const WHOLE: bool = true;
    fn parse(text: &str, range: [f64; 2]) -> Option<Self> {
        let number = if text == "inf" { FOREVER } else { text.parse().ok()? };
        (range[0]..=range[1]).contains(&f64::from(number)).then_some(number)
    }
    fn text(&self) -> String {
        if *self == FOREVER { "inf".to_owned() } else { self.to_string() }
    }
}

impl Value for f32 {
    fn parse(text: &str, range: [f64; 2]) -> Option<Self> {
        let number: f64 = text.parse().ok()?;
        let in_range = number >= range[0] && number <= range[1];
        in_range.then_some(if number == f64::INFINITY { INFINITE } else { number as f32 })
    }
    fn text(&self) -> String {
        if *self >= INFINITE { "inf".to_owned() } else { self.to_string() }
    }
}

/// One row of the table: a setting's name, its range and its meaning.
#[derive(Clone, Copy, Debug)]
pub struct Description {
    /// The pass that the setting belongs to.
    pub pass: &'static str,
    /// The key of `--set key=value`.
    pub name: &'static str,
    /// Smallest and largest value of a number.
    pub range: [f64; 2],
    /// Whether it is a whole number.
    pub whole: bool,
    /// Names and meanings of values that are not numbers.
    pub choices: &'static [(&'static str, &'static str)],
    /// Unit, or empty.
    pub unit: &'static str,
    /// What the setting does.
    pub meaning: &'static str,
}

macro_rules! settings {
    ($( $pass:ident { $( $name:ident : $kind:ty = [$iprt:expr, $paper:expr, $ibl:expr, $reference:expr], $range:expr, $unit:literal, $meaning:literal; )* } )*) => {
        /// The values of all settings.
        #[derive(Clone, Debug, PartialEq)]
        pub struct Settings {
            $( $( #[doc = $meaning] pub $name: $kind, )* )*
            /// The names that [`Settings::set`] was given. The plan leaves these settings as they are.
            pub given: Vec<&'static str>,
        }

        impl Settings {
            /// The table that documents and parses the settings, in the order of the passes.
            pub const TABLE: &'static [Description] = &[ $( $( Description {
                pass: stringify!($pass), name: stringify!($name), range: $range, whole: <$kind as Value>::WHOLE, choices: <$kind as Value>::CHOICES, unit: $unit, meaning: $meaning,
            }, )* )* ];

            /// Returns the preset of a method.
            pub fn of(method: Method) -> Self {
                match method {
                    Method::Iprt => Self { $( $( $name: $iprt, )* )* given: Vec::new() },
                    Method::Paper => Self { $( $( $name: $paper, )* )* given: Vec::new() },
                    Method::Ibl => Self { $( $( $name: $ibl, )* )* given: Vec::new() },
                    Method::Reference => Self { $( $( $name: $reference, )* )* given: Vec::new() },
                }
            }

            /// Returns every setting's name and its value as text.
            pub fn values(&self) -> Vec<(&'static str, String)> {
                vec![ $( $( (stringify!($name), self.$name.text()), )* )* ]
            }

            /// Sets one that exists to a value that it may have; it does not count as given.
            pub(crate) fn leave_out(&mut self, name: &str, off: &str) {
                if let Some(row) = Self::TABLE.iter().find(|row| row.name == name) {
                    self.assign(row, off);
                }
            }

            fn assign(&mut self, row: &Description, text: &str) -> bool {
                match row.name {
                    $( $( stringify!($name) => Value::parse(text, row.range).map(|value| self.$name = value).is_some(), )* )*
                    _ => false,
                }
            }
        }
    };
}

/// A history length that no run reaches: light is accumulated for ever.
pub const FOREVER: u32 = 1 << 24;

/// Stands for `inf` in shaders, which may assume that there are no real infinities.
pub const INFINITE: f32 = 1e30;

/// The range of a setting that is not a number.
const ANY: [f64; 2] = [0.0, 0.0];

// The columns of values are iprt, paper, ibl, reference.
settings! {
    plan {
        objects: Presence = [Presence::Auto, Presence::Auto, Presence::Auto, Presence::Auto], ANY, "", "virtual objects, and all light that they change";
        virtual_surfaces: Presence = [Presence::Auto, Presence::Auto, Presence::Auto, Presence::Auto], ANY, "", "virtual surfaces in the picture itself, not only their shadows and reflections";
        off_centre: Presence = [Presence::Auto, Presence::Auto, Presence::Auto, Presence::Auto], ANY, "", "a camera away from the capture point: its rays are traced through the panorama";
        video: Presence = [Presence::Auto, Presence::Auto, Presence::Auto, Presence::Auto], ANY, "", "a panorama that changes; off: its first frame alone";
        motion: Presence = [Presence::Auto, Presence::Auto, Presence::Auto, Presence::Auto], ANY, "", "objects or a video that move: their motion vectors, and shorter histories where they change the light";
        reflections: Presence = [Presence::Auto, Presence::Off, Presence::Auto, Presence::Auto], ANY, "", "reflections in smooth surfaces: their history moves as the reflected picture does; off: as the surface does";
        deformation: Presence = [Presence::Auto, Presence::Auto, Presence::Auto, Presence::Auto], ANY, "", "objects that change their shape: skins and morph targets; off: their rest pose";
        free_lamps: Presence = [Presence::Auto, Presence::Off, Presence::Off, Presence::Auto], ANY, "", "small lamps that hang free before what lies behind them: ellipsoids instead of a few texels of the surface";
        ingest: Presence = [Presence::Auto, Presence::Auto, Presence::Auto, Presence::Auto], ANY, "", "a video's codes become radiance on the device; off: on the processor";
        radiance_pyramid: Presence = [Presence::Auto, Presence::Auto, Presence::Auto, Presence::Auto], ANY, "", "mip levels of a panorama that is finer than the picture";
        specular: Presence = [Presence::Auto, Presence::Auto, Presence::Auto, Presence::Auto], ANY, "", "the GGX lobe of virtual surfaces";
        emission: Presence = [Presence::Auto, Presence::Auto, Presence::Auto, Presence::Auto], ANY, "", "virtual surfaces that shine";
        emitters: Presence = [Presence::Auto, Presence::Off, Presence::Auto, Presence::Auto], ANY, "", "rays that aim at virtual surfaces that shine; off: these are met by chance";
        punctual: Presence = [Presence::Auto, Presence::Auto, Presence::Auto, Presence::Auto], ANY, "", "lights without a surface that objects bring (KHR_lights_punctual)";
        textures: Presence = [Presence::Auto, Presence::Auto, Presence::Auto, Presence::Auto], ANY, "", "textures of virtual surfaces";
        alpha: Presence = [Presence::Auto, Presence::Auto, Presence::Auto, Presence::Auto], ANY, "", "holes and half-transparent parts of virtual surfaces (alpha mask and blend)";
        transmission: Presence = [Presence::Auto, Presence::Auto, Presence::Auto, Presence::Auto], ANY, "", "virtual surfaces through which light passes: thin sheets, glass";
        clearcoat: Presence = [Presence::Auto, Presence::Auto, Presence::Auto, Presence::Auto], ANY, "", "clear coats over virtual surfaces";
        sheen: Presence = [Presence::Auto, Presence::Auto, Presence::Auto, Presence::Auto], ANY, "", "fibres over virtual surfaces";
        anisotropy: Presence = [Presence::Auto, Presence::Auto, Presence::Auto, Presence::Auto], ANY, "", "virtual surfaces that are rougher along one direction";
        iridescence: Presence = [Presence::Auto, Presence::Auto, Presence::Auto, Presence::Auto], ANY, "", "thin films over virtual surfaces";
    }
    normals {
        normal_radius: u32 = [0, 0, 0, 0], [0.0, 64.0], "texels", "radius of the plane fits that give normals; 0: from the capture (1 for float depth, wider for integer codes and noise)";
        smooth_depth: bool = [true, true, true, true], ANY, "", "depth that is noisy from texel to texel is smoothed, and its small holes are filled";
    }
    depth_pyramid {
        edge_ratio: f32 = [0.1, 0.1, 0.1, 0.1], [0.001, 10.0], "", "depths of a triangle's corners may differ by this ratio before it is a skirt, not a surface";
        thickness: f32 = [0.3, INFINITE, 0.3, 0.3], [0.0, f64::INFINITY], "metres", "how far behind a foreground edge a ray still hits its skirt; inf: solid, so that everything behind the depth is a hit";
        edge_depth: bool = [true, false, false, true], ANY, "", "skirts are as deep as the width of the thing at whose edge they hang tells (a post as wide, a cupboard 0.3 m); off: `thickness`";
        skirt_luminance: f32 = [1.0, INFINITE, INFINITE, 1.0], [0.0, f64::INFINITY], "of the panorama's mean", "how bright a skirt is at most: what the capture does not show of a lamp's or a window's edge is no light";
    }
    relight {
        relight_levels: u32 = [1, 0, 0, 2], [0.0, 4.0], "", "how often light is passed on between relit real surfaces before rays see them; 0: rays see the capture as it is";
        relight_width: u32 = [256, 256, 256, 256], [16.0, 4096.0], "texels", "width of the relit panorama's map";
        relight_warmup: u32 = [0, 0, 0, 256], [0.0, 4096.0], "frames", "frames that the map is accumulated for before the first picture";
    }
    gbuffer {
        coverage_samples: u32 = [16, 16, 16, 64], [1.0, 1024.0], "rays a pixel", "sub-pixel rays at silhouettes, which give the fraction M";
        fill_unseen: bool = [false, false, false, false], ANY, "", "a camera off the capture point shows, where the capture saw nothing, what lies behind the edge, carried on; off: the edge's nearer side, and through gaps the panorama as a backdrop (the window has it on)";
    }
    sampling_mask {
        sampling_mask: bool = [true, true, true, false], ANY, "", "trace a share of the pixels each frame; off: every pixel";
        mask_by: MaskBy = [MaskBy::History, MaskBy::Discontinuity, MaskBy::History, MaskBy::History], ANY, "", "what chooses the pixels";
        rays_per_pixel: f32 = [0.25, 0.25, 0.25, 1.0], [0.0625, 1.0], "paths a pixel and frame", "the share that `mask_by = history` traces, in sixteenths";
        short_history: u32 = [4, 0, 4, 0], [0.0, 64.0], "frames", "pixels with a shorter history are traced whatever the mask says; 0: none are";
        early_paths: u32 = [4, 1, 4, 1], [1.0, 16.0], "paths a pixel and frame", "paths of a young virtual surface";
        early_history: u32 = [60, 0, 60, 0], [0.0, 1024.0], "paths", "a virtual surface is young until its history is as long; a real one for `early_history`/`early_paths` frames, in which it is traced at every pixel; none is young whose history may not grow twice as long, by `history_change`";
        rest_noise: f32 = [0.02, 0.0, 0.02, 0.0], [0.0, 1.0], "of the light", "while real surfaces stand still, tiles of them in which light errs by less than this have a quarter of their turns; 0: none rests";
        sharp_roughness: f32 = [0.3, 0.0, 0.3, 0.0], [0.0, 1.0], "", "virtual surfaces smoother than this are traced at every pixel";
        mask_angle: f32 = [10.0, 10.0, 10.0, 10.0], [0.0, 180.0], "degrees", "neighbouring normals farther apart are a discontinuity";
        mask_distance: f32 = [0.01, 0.01, 0.01, 0.01], [0.0, 1.0], "of the distance", "neighbouring positions farther from the tangent plane are a discontinuity";
    }
    irradiance {
        real_tracer: RealTracer = [RealTracer::Surface, RealTracer::Surface, RealTracer::Direction, RealTracer::Surface], ANY, "", "how rays meet the real scene";
        least_share: f32 = [0.125, 1.0, 1.0, 1.0], [0.01, 1.0], "of the rays", "rays from real surfaces that meet no object are traced by at least this share, and all of them where objects changed the light by 4 % or more; what is not traced is made up for by weights";
        march_steps: u32 = [32, 32, 32, 32], [2.0, 4096.0], "", "`real_tracer = march`: places at equal angles along a ray";
        virtual_tracer: VirtualTracer = [VirtualTracer::Bvh, VirtualTracer::Screen, VirtualTracer::Bvh, VirtualTracer::Bvh], ANY, "", "how rays meet virtual objects; with `screen`, primary rays and the relit map's use the BVH";
        screen_thickness: f32 = [0.1, 0.1, 0.1, 0.1], [0.0, f64::INFINITY], "metres", "`virtual_tracer = screen`: how thick objects are taken to be behind what is seen";
        screen_stride: f32 = [1.0, 1.0, 1.0, 1.0], [1.0, 64.0], "pixels", "`virtual_tracer = screen`: length of a step";
        screen_jitter: f32 = [1.0, 1.0, 1.0, 1.0], [0.0, 1.0], "steps", "`virtual_tracer = screen`: random part of the first step";
        directions: Directions = [Directions::Mis, Directions::Brdf, Directions::Mis, Directions::Mis], ANY, "", "what draws the directions of rays";
        path_limit: f32 = [4.0, INFINITE, 4.0, INFINITE], [0.1, f64::INFINITY], "times the light", "how much more than a surface's light, as the last picture has it, a path may bring by chance, times eight more than the paths of its history; inf: any";
        bounces: u32 = [3, 3, 3, 8], [1.0, 64.0], "", "virtual surfaces a path may visit; beyond the last it sees the real scene alone";
    }
    interpolate {
        interpolate: bool = [true, true, true, true], ANY, "", "fill pixels that were not traced from traced neighbours";
    }
    temporal {
        temporal: bool = [true, true, true, true], ANY, "", "accumulate along motion vectors";
        history: u32 = [64, 64, 64, FOREVER], [1.0, FOREVER as f64], "frames", "longest history while nothing but the camera moves";
        history_moving: u32 = [12, 12, 12, FOREVER], [1.0, FOREVER as f64], "frames", "`history_change = inf`: longest history while an object or the video moves";
        history_change: f32 = [0.6, INFINITE, 0.6, INFINITE], [0.01, f64::INFINITY], "of the light", "how much of a surface's light moving objects and the video may change over the length of its history: where they change more, it is shorter; inf: `history_moving` instead, for all";
        clamp: f32 = [0.0, 1.0, 0.0, 0.0], [0.0, 16.0], "standard deviations", "how far history may be from this frame's 5×5 mean; 0: no clamping";
        clamp_when: ClampWhen = [ClampWhen::Moving, ClampWhen::Always, ClampWhen::Moving, ClampWhen::Moving], ANY, "", "when the history is clamped";
    }
    atrous {
        filter_order: FilterOrder = [FilterOrder::TemporalFirst, FilterOrder::SpatialFirst, FilterOrder::TemporalFirst, FilterOrder::TemporalFirst], ANY, "", "which filter comes first";
        atrous_levels: u32 = [3, 5, 3, 0], [0.0, 5.0], "", "levels of the edge-avoiding filter; each doubles the distance between taps";
        atrous_radius: u32 = [2, 2, 2, 2], [1.0, 2.0], "taps", "radius of a level's kernel: 3×3 or 5×5 taps";
        sigma_luminance: f32 = [2.5, INFINITE, 2.5, 2.5], [0.1, f64::INFINITY], "standard deviations", "luminance difference, against the noise of the two means, at which the weight of the filter's first level is 1/e; inf: luminance does not count";
    }
    composite {
        despeckle: bool = [true, false, true, false], ANY, "", "a real pixel's light changes by no more and no less than that of its neighbours: one or two pixels of noisy depth lie anywhere, even in objects";
        relighting: Relighting = [Relighting::EmissionKept, Relighting::Ratio, Relighting::EmissionKept, Relighting::EmissionKept], ANY, "", "how a real surface answers a change of its light, in the picture and in the relit map";
    }
}

impl Settings {
    /// Returns a setting's value as text.
    pub fn value(&self, name: &str) -> Option<String> {
        self.values().into_iter().find(|(known, _)| *known == name).map(|(_, value)| value)
    }

    /// Sets a value from text, as `--set name=value` gives it. `subject` says in an error where the text came
    /// from.
    pub fn set(&mut self, name: &str, value: &str, subject: &str) -> Result<()> {
        let Some(row) = Self::TABLE.iter().find(|row| row.name == name) else {
            let nearest = Self::TABLE.iter().min_by_key(|row| strsim::damerau_levenshtein(row.name, name));
            let hint = nearest.map_or(String::new(), |row| format!("did you mean \"{}\"? ", row.name));
            let all: Vec<_> = Self::TABLE.iter().map(|row| row.name).collect();
            return Err(Error::input(
                subject,
                format!("unknown setting \"{name}\""),
                format!("{hint}settings are {}", all.join(", ")),
            ));
        };
        if self.assign(row, value) {
            if !self.given.contains(&row.name) {
                self.given.push(row.name);
            }
            return Ok(());
        }
        let remedy = format!("give {}", row.allowed());
        Err(Error::input(subject, format!("setting \"{name}\" cannot be \"{value}\""), remedy))
    }

    /// Makes the same model converge by accumulation: every pixel is traced in each frame, nothing is
    /// filtered, and no history is dropped.
    pub fn converge(&mut self) {
        let reference = Self::of(Method::Reference);
        *self = Self {
            sampling_mask: reference.sampling_mask,
            rays_per_pixel: reference.rays_per_pixel,
            rest_noise: reference.rest_noise,
            early_paths: reference.early_paths,
            early_history: reference.early_history,
            short_history: reference.short_history,
            sharp_roughness: reference.sharp_roughness,
            coverage_samples: reference.coverage_samples,
            relight_warmup: reference.relight_warmup,
            temporal: reference.temporal,
            history: reference.history,
            history_moving: reference.history_moving,
            history_change: reference.history_change,
            clamp: reference.clamp,
            clamp_when: reference.clamp_when,
            filter_order: reference.filter_order,
            atrous_levels: reference.atrous_levels,
            atrous_radius: reference.atrous_radius,
            sigma_luminance: reference.sigma_luminance,
            least_share: reference.least_share,
            path_limit: reference.path_limit,
            despeckle: reference.despeckle,
            ..self.clone()
        };
    }

    /// Writes the table of all settings as Markdown, pass by pass, with a column of defaults for each method.
    pub fn markdown() -> String {
        let mut out = String::new();
        let defaults = Method::ALL.map(|method| Self::of(method).values());
        let names = Method::ALL.map(|method| format!("`{}`", method.name()));
        let mut pass = "";
        for (row, description) in Self::TABLE.iter().enumerate() {
            if description.pass != pass {
                pass = description.pass;
                let _ = writeln!(out, "\n#### {pass}\n\n| setting | {} | range | unit | meaning |", names.join(" | "));
                let _ = writeln!(out, "|---|{}---|---|---|", "---|".repeat(names.len()));
            }
            let values: Vec<_> = defaults.iter().map(|values| values[row].1.as_str()).collect();
            let ways: String = description
                .choices
                .iter()
                .filter(|(_, meaning)| !meaning.is_empty())
                .map(|(name, meaning)| format!("<br>`{name}`: {meaning}"))
                .collect();
            let _ = writeln!(
                out,
                "| `{}` | {} | {} | {} | {}{ways} |",
                description.name,
                values.join(" | "),
                description.allowed(),
                description.unit,
                description.meaning
            );
        }
        out.trim_start().to_owned()
    }
}

impl Description {
    /// Says for people which values are allowed.
    pub fn allowed(&self) -> String {
        if !self.choices.is_empty() {
            let names: Vec<_> = self.choices.iter().map(|(name, _)| *name).collect();
            return names.join(", ");
        }
        let [low, high] = self.range.map(|v| if v >= f64::from(FOREVER) { "inf".to_owned() } else { v.to_string() });
        format!("{low} to {high}")
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_default_can_be_given_as_text() {
        for method in Method::ALL {
            let mut settings = Settings::of(Method::Iprt);
            for (name, value) in Settings::of(method).values() {
                settings.set(name, &value, "test").expect("its own default");
            }
            assert_eq!(settings.values(), Settings::of(method).values());
        }
    }

    #[test]
    fn the_reference_is_iprt_converged() {
        let mut settings = Settings::of(Method::Iprt);
        settings.converge();
        let reference = Settings::of(Method::Reference);
        assert_eq!(
            Settings { bounces: reference.bounces, relight_levels: reference.relight_levels, ..settings },
            reference
        );
    }

    #[test]
    fn what_is_out_of_range_is_refused() {
        let mut settings = Settings::of(Method::Iprt);
        for (name, value) in [
            ("rays_per_pixel", "2"),
            ("rays_per_pixel", "nan"),
            ("bounces", "-1"),
            ("bounces", "1.5"),
            ("real_tracer", "x"),
        ] {
            settings.set(name, value, "test").expect_err("refused");
        }
        settings.set("thickness", "inf", "test").expect("endless");
        assert_eq!(
            settings,
            Settings { thickness: INFINITE, given: vec!["thickness"], ..Settings::of(Method::Iprt) },
            "what was refused was not given"
        );
    }
}
