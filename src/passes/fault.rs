//! Deliberate faults, which tests of the stability suite plant. Only the cargo feature `faults` has them.
//! They use shaders of their own.

/// Whether a renderer has a planted fault. A build without the feature `faults` never has one.
#[cfg(feature = "faults")]
macro_rules! planted {
    ($renderer:expr, $fault:ident) => {
        $renderer.fault == $crate::passes::fault::Fault::$fault
    };
}
#[cfg(not(feature = "faults"))]
macro_rules! planted {
    ($renderer:expr, $fault:ident) => {
        false
    };
}
pub(crate) use planted;

#[cfg(feature = "faults")]
use crate::gpu::Gpu;

/// One thing done wrong on purpose. The value is the shaders' `FAULT`. From 100 on, the fault is in Rust.
#[cfg(feature = "faults")]
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash)]
pub enum Fault {
    /// No fault.
    #[default]
    None = 0,
    /// Columns of the panorama do not wrap, which leaves a gap at the seam.
    NoWrap = 1,
    /// The poles are holes.
    NoPoles = 2,
    /// Lights are drawn as if the panorama were not turned.
    YawForgotten = 3,
    /// The contribution of a path is cut down to a small value.
    EnergyClamp = 5,
    /// Motion vectors are wrong by a pixel.
    MotionOff = 6,
    /// Rays start below real surfaces.
    RaysFromBelow = 7,
    /// Holes in the depth are half a metre away.
    HolesNear = 8,
    /// Real surfaces hide no object from the camera.
    RealIgnored = 9,
    /// The camera sees the real scene from the capture point, wherever it is.
    CameraCentred = 10,
    /// Surfaces seen from behind keep their normals.
    NormalsUnturned = 11,
    /// Filters do not stop at edges.
    FilterBlind = 12,
    /// Pixels beyond the last whole tile stay black.
    LastTileLost = 13,
    /// Columns are counted in twelve bits.
    NarrowColumns = 14,
    /// Each frame the history grows by a fifth.
    Drift = 15,
    /// The history of whatever surface was there before is taken.
    HistoryOfOthers = 16,
    /// Textures are read at their finest level, however far they are.
    TexturesFinest = 17,
    /// Of the joints that move a vertex only the first counts.
    OneJoint = 18,
    /// The history never ends and is never clamped.
    HistoryKept = 100,
    /// The seed counts the frames of the whole process.
    UnsteadySeed = 101,
    /// All video frames use the depth of the first.
    DepthStale = 102,
}

#[cfg(feature = "faults")]
impl Fault {
    /// Returns a handle of the device whose passes have this fault.
    pub(crate) fn inject(self, gpu: &Gpu) -> Gpu {
        let passes: &[&str] = match self {
            Self::None | Self::HistoryKept | Self::UnsteadySeed | Self::DepthStale => return gpu.clone(),
            Self::NoWrap => &["gbuffer", "coverage", "depth_pyramid"],
            Self::NoPoles | Self::HolesNear => &["plane_fit", "normals"],
            Self::YawForgotten | Self::EnergyClamp | Self::RaysFromBelow => &["irradiance"],
            Self::Drift => &["temporal"],
            Self::HistoryOfOthers => &["sampling_mask", "temporal"],
            Self::RealIgnored | Self::CameraCentred | Self::NarrowColumns => &["gbuffer", "coverage"],
            Self::TexturesFinest => &["gbuffer", "silhouette", "surface", "irradiance"],
            Self::MotionOff => &["gbuffer", "sampling_mask", "irradiance", "temporal"],
            Self::NormalsUnturned => &["gbuffer", "coverage", "irradiance"],
            Self::FilterBlind => &["interpolate", "atrous"],
            Self::LastTileLost => &["composite"],
            Self::OneJoint => &["deform"],
        };
        gpu.with_fault(self as u32, passes)
    }
}
