//! Deliberate faults, which the tests of the stability suite plant. Only the cargo feature `faults` has them, with shaders
//! of their own.

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

/// One thing done wrong on purpose. The value is what the shaders' constant `FAULT` is set to; those from 100 on are the host's.
#[cfg(feature = "faults")]
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash)]
pub enum Fault {
    /// As shipped.
    #[default]
    None = 0,
    /// Columns of the panorama do not wrap: at the seam there is a gap.
    NoWrap = 1,
    /// The poles are holes.
    NoPoles = 2,
    /// Lights are drawn as if the panorama were not turned.
    YawForgotten = 3,
    /// Paths that bring more than a little are cut down to it.
    EnergyClamp = 5,
    /// Motion vectors are a pixel off.
    MotionOff = 6,
    /// Rays leave real surfaces from below.
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
    /// No end of the history, no clamping.
    HistoryKept = 100,
    /// The seed counts the frames of the whole process.
    UnsteadySeed = 101,
    /// The depth of the first video frame is that of all.
    DepthStale = 102,
}

#[cfg(feature = "faults")]
impl Fault {
    /// A handle of the device whose passes have this fault.
    pub(crate) fn inject(self, gpu: &Gpu) -> Gpu {
        let passes: &[&str] = match self {
            Self::None | Self::HistoryKept | Self::UnsteadySeed | Self::DepthStale => return gpu.clone(),
            Self::NoWrap => &["gbuffer", "coverage", "depth_pyramid"],
            Self::NoPoles | Self::HolesNear => &["plane_fit", "normals"],
            Self::YawForgotten | Self::EnergyClamp | Self::RaysFromBelow => &["irradiance"],
            Self::Drift => &["temporal"],
            Self::MotionOff | Self::RealIgnored | Self::CameraCentred | Self::NarrowColumns => &["gbuffer", "coverage"],
            Self::NormalsUnturned => &["gbuffer", "coverage", "irradiance"],
            Self::FilterBlind => &["interpolate", "atrous"],
            Self::LastTileLost => &["composite"],
        };
        gpu.with_fault(self as u32, passes)
    }
}
