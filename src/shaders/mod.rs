//! The SPIR-V of `shaders/glsl/*.comp` from `build.rs`. Each constant is named as its file in capitals.
//!
//! A release build has only these. A debug build uses the shaders on disk as they are when it starts, so that
//! a changed shader needs no rebuild. It can also load them again while it runs.

#[cfg(not(debug_assertions))]
use crate::Result;

include!(concat!(env!("OUT_DIR"), "/shaders.rs"));

#[cfg(debug_assertions)]
mod reload;
#[cfg(debug_assertions)]
pub use reload::{Compiled, Sources, current, digest, reload};

/// The SPIR-V to use in place of a build-time constant.
///
/// # Errors
/// Never fails in a release build. Fails in a debug build if a shader on disk cannot be compiled.
#[cfg(not(debug_assertions))]
pub fn current(spirv: &'static [u32]) -> Result<&'static [u32]> {
    Ok(spirv)
}

/// A hash that changes with any of the shaders.
///
/// # Errors
/// Never fails in a release build. Fails in a debug build if a shader on disk cannot be compiled.
#[cfg(not(debug_assertions))]
pub fn digest() -> Result<u64> {
    Ok(DIGEST)
}

/// The same shader with code for planted faults, if it has any.
#[cfg(feature = "faults")]
pub fn faulty(spirv: &[u32]) -> Option<&'static [u32]> {
    FAULTY.iter().find(|(whole, _)| *whole == spirv).map(|(_, faulty)| *faulty)
}
