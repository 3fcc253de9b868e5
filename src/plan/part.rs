//! The parts of the model, and how each is forced on or off.

use crate::settings::{Method, Settings};

/// A part of the model, in the order of the frame.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Part {
    /// Virtual objects, and with them all lighting.
    Objects,
    /// Virtual surfaces in the picture itself.
    VirtualSurfaces,
    /// Primary rays traced through the panorama.
    OffCentre,
    /// A panorama that changes.
    Video,
    /// Mip levels of the panorama.
    RadiancePyramid,
    /// Rays that meet real surfaces where they stand.
    RealTracer,
    /// The panorama's lamps as something to draw directions from.
    LightTable,
    /// Relit real surfaces, seen by rays.
    Relight,
    /// The GGX lobe.
    Specular,
    /// Virtual surfaces that shine.
    Emission,
    /// Textures of virtual surfaces.
    Textures,
    /// Paths from one virtual surface to another.
    Bounces,
    /// Accumulation over frames.
    Temporal,
    /// Object motion vectors, short histories, clamping.
    Motion,
    /// Tracing a share of the pixels.
    SamplingMask,
    /// Filling the others.
    Interpolate,
    /// The edge-avoiding filter.
    Atrous,
}

impl Part {
    /// All.
    pub const ALL: [Self; 17] = [
        Self::Objects,
        Self::VirtualSurfaces,
        Self::OffCentre,
        Self::Video,
        Self::RadiancePyramid,
        Self::RealTracer,
        Self::LightTable,
        Self::Relight,
        Self::Specular,
        Self::Emission,
        Self::Textures,
        Self::Bounces,
        Self::Temporal,
        Self::Motion,
        Self::SamplingMask,
        Self::Interpolate,
        Self::Atrous,
    ];

    /// Its name, and the setting that forces it on or off.
    pub fn name(self) -> &'static str {
        match self {
            Self::LightTable => "light_table",
            Self::Relight => "relight",
            Self::Atrous => "atrous",
            _ => self.setting(),
        }
    }

    /// The key of `--set` that forces it.
    pub fn setting(self) -> &'static str {
        match self {
            Self::Objects => "objects",
            Self::VirtualSurfaces => "virtual_surfaces",
            Self::OffCentre => "off_centre",
            Self::Video => "video",
            Self::RadiancePyramid => "radiance_pyramid",
            Self::RealTracer => "real_tracer",
            Self::LightTable => "directions",
            Self::Relight => "relight_levels",
            Self::Specular => "specular",
            Self::Emission => "emission",
            Self::Textures => "textures",
            Self::Bounces => "bounces",
            Self::Temporal => "temporal",
            Self::Motion => "motion",
            Self::SamplingMask => "sampling_mask",
            Self::Interpolate => "interpolate",
            Self::Atrous => "atrous_levels",
        }
    }

    /// The part without which it has no meaning.
    pub fn needs(self) -> Option<Self> {
        match self {
            Self::Objects | Self::OffCentre | Self::Video | Self::RadiancePyramid => None,
            Self::Motion => Some(Self::Temporal),
            Self::Interpolate => Some(Self::SamplingMask),
            _ => Some(Self::Objects),
        }
    }

    /// The value of its setting by which it is off.
    pub fn value_off(self) -> &'static str {
        match self {
            Self::RealTracer => "direction",
            Self::LightTable => "brdf",
            Self::Relight | Self::Atrous => "0",
            Self::Bounces => "1",
            Self::Temporal | Self::SamplingMask | Self::Interpolate => "false",
            _ => "off",
        }
    }

    /// The value by which it is on: the method's own, or, where that leaves it out, that of `iprt`.
    pub fn value_on(self, method: Method) -> String {
        match self {
            Self::RealTracer
            | Self::LightTable
            | Self::Relight
            | Self::Atrous
            | Self::Bounces
            | Self::Temporal
            | Self::SamplingMask
            | Self::Interpolate => {
                let of = |method| Settings::of(method).value(self.setting()).unwrap_or_default();
                Some(of(method)).filter(|value| value != self.value_off()).unwrap_or_else(|| of(Method::Iprt))
            }
            _ => "on".to_owned(),
        }
    }

    /// What to set, so that it is on or off whatever the scene holds.
    pub fn forced(self, on: bool, method: Method) -> Vec<(&'static str, String)> {
        if !on {
            return vec![(self.setting(), self.value_off().to_owned())];
        }
        let mut set = self.needs().map_or(Vec::new(), |other| other.forced(true, method));
        set.push((self.setting(), self.value_on(method)));
        set
    }
}
