//! Every approximation is a named setting: one table gives its default, range and meaning.

use crate::{Error, Result};

/// How the picture is made; DESIGN's methods are presets of the same settings.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Method {
    /// Fast and filtered.
    Iprt,
    /// The same model, converged: many paths a pixel, no mask, no filter, no reprojection.
    Reference,
}

impl Method {
    /// From its name on the command line or in a scene file.
    pub fn parse(name: &str, subject: &str) -> Result<Self> {
        match name {
            "iprt" => Ok(Self::Iprt),
            "reference" => Ok(Self::Reference),
            other => Err(Error::input(subject, format!("unknown method \"{other}\""), "use \"iprt\" or \"reference\"")),
        }
    }

    /// The name that [`Method::parse`] takes.
    pub fn name(self) -> &'static str {
        match self {
            Self::Iprt => "iprt",
            Self::Reference => "reference",
        }
    }
}

/// One row of the table: how a setting is called, what it may be and what it means.
#[derive(Clone, Copy, Debug)]
pub struct Description {
    /// The key of `--set key=value`.
    pub name: &'static str,
    /// Smallest and largest value; switches are 0 and 1.
    pub range: [f64; 2],
    /// Whether it takes `true` and `false`.
    pub switch: bool,
    /// Unit, or empty.
    pub unit: &'static str,
    /// What it does.
    pub meaning: &'static str,
}

macro_rules! settings {
    ($( $name:ident : $kind:tt = $iprt:expr, $reference:expr, $range:expr, $unit:literal, $meaning:literal; )*) => {
        /// The values of all settings.
        #[derive(Clone, Debug, PartialEq)]
        pub struct Settings { $( #[doc = $meaning] pub $name: settings!(@type $kind), )* }

        impl Settings {
            /// The table that documents and parses them.
            pub const TABLE: &'static [Description] = &[ $( Description {
                name: stringify!($name), range: $range, switch: settings!(@switch $kind), unit: $unit, meaning: $meaning,
            }, )* ];

            /// The preset of a method.
            pub fn of(method: Method) -> Self {
                match method {
                    Method::Iprt => Self { $( $name: $iprt, )* },
                    Method::Reference => Self { $( $name: $reference, )* },
                }
            }

            /// Every setting and its value, as text.
            pub fn values(&self) -> Vec<(&'static str, String)> {
                vec![ $( (stringify!($name), self.$name.to_string()), )* ]
            }

            fn assign(&mut self, name: &str, value: f64) {
                match name { $( stringify!($name) => self.$name = settings!(@from $kind value), )* _ => {} }
            }
        }
    };
    (@type switch) => { bool }; (@type count) => { u32 }; (@type number) => { f32 };
    (@switch switch) => { true }; (@switch $other:tt) => { false };
    (@from switch $v:ident) => { $v != 0.0 }; (@from count $v:ident) => { $v as u32 }; (@from number $v:ident) => { $v as f32 };
}

/// A history length that no run reaches: accumulate for ever.
pub const FOREVER: u32 = 1 << 24;

settings! {
    sampling_mask: switch = true, false, [0.0, 1.0], "", "trace a share of the pixels each frame; off: every pixel";
    rays_per_pixel: number = 0.25, 1.0, [0.0625, 1.0], "paths a pixel and frame", "share of the pixels that sampling_mask traces, in sixteenths";
    short_history: count = 4, 0, [0.0, 64.0], "frames", "pixels with a shorter history are traced whatever the mask says; 0: none are";
    sharp_roughness: number = 0.3, 0.0, [0.0, 1.0], "", "virtual surfaces smoother than this are traced at every pixel";
    interpolate: switch = true, false, [0.0, 1.0], "", "fill pixels that were not traced from traced neighbours";
    temporal: switch = true, true, [0.0, 1.0], "", "accumulate along motion vectors";
    history: count = 64, FOREVER, [1.0, 16777216.0], "frames", "longest history while nothing but the camera moves";
    history_moving: count = 12, FOREVER, [1.0, 16777216.0], "frames", "longest history while an object or the video moves";
    clamp: number = 1.0, 0.0, [0.0, 16.0], "standard deviations", "how far history may be from this frame's 5×5 mean while something moves; 0: no clamping";
    atrous_levels: count = 5, 0, [0.0, 5.0], "", "levels of the edge-avoiding filter; five span 65×65 pixels";
    sigma_luminance: number = 2.0, 2.0, [0.1, 100.0], "standard deviations", "luminance difference, against the noise of the mean, at which the filter's weight is 1/e";
    bounces: count = 3, 8, [1.0, 64.0], "", "virtual surfaces a path may visit; beyond the last it sees the real scene alone";
    relight_levels: count = 1, 2, [0.0, 4.0], "", "how often light is passed on between relit real surfaces before rays see them; 0: rays see the capture as it is";
    relight_width: count = 256, 256, [16.0, 4096.0], "texels", "width of the relit panorama's map";
    coverage_samples: count = 16, 64, [1.0, 1024.0], "rays a pixel", "sub-pixel rays at silhouettes, which give the fraction M";
    edge_ratio: number = 0.1, 0.1, [0.001, 10.0], "", "depths of a triangle's corners may differ by this ratio before it is a skirt, not a surface";
    thickness: number = 0.3, 0.3, [0.0, 1e30], "metres", "how far behind a foreground edge a ray still hits its skirt; inf: solid";
    normal_radius: count = 0, 0, [0.0, 64.0], "texels", "radius of the plane fits that give normals; 0: from the capture (1 for float depth, wider for integer codes)";
}

impl Settings {
    /// Sets one from text, as `--set name=value` gives it; `subject` is what an error is about.
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
        let number = match value {
            "true" | "on" if row.switch => Some(1.0),
            "false" | "off" if row.switch => Some(0.0),
            _ => value.parse::<f64>().ok(),
        };
        match number.map(|v| if v == f64::INFINITY { 1e30 } else { v }) {
            Some(v) if v >= row.range[0] && v <= row.range[1] => {
                self.assign(name, v);
                Ok(())
            }
            _ => {
                let allowed = if row.switch {
                    "true or false".to_owned()
                } else {
                    format!("a number from {} to {}", row.range[0], row.range[1])
                };
                Err(Error::input(
                    subject,
                    format!("setting \"{name}\" cannot be \"{value}\""),
                    format!("give {allowed}"),
                ))
            }
        }
    }
}
