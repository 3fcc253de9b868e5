//! SPIR-V of `shaders/glsl/*.comp`, compiled by `build.rs`: a constant for each, named as the file's stem in capitals.
//!
//! A release build knows these alone. A debug build uses the shaders on disk as they are when it starts, so that a changed
//! shader needs no rebuild, and can take them up again while it runs.

#[cfg(not(debug_assertions))]
use crate::Result;

include!(concat!(env!("OUT_DIR"), "/shaders.rs"));

#[cfg(debug_assertions)]
mod reload;
#[cfg(debug_assertions)]
pub use reload::{Compiled, Sources, current, digest, reload};

/// What a shader is now, by the constant that it was at build time.
///
/// # Errors
/// Never in a release build; in a debug build fails if a shader on disk cannot be compiled.
#[cfg(not(debug_assertions))]
pub fn current(spirv: &'static [u32]) -> Result<&'static [u32]> {
    Ok(spirv)
}

/// Changes with any of the shaders.
///
/// # Errors
/// Never in a release build; in a debug build fails if a shader on disk cannot be compiled.
#[cfg(not(debug_assertions))]
pub fn digest() -> Result<u64> {
    Ok(DIGEST)
}

/// The same shader with planted faults in it, if it has any.
#[cfg(feature = "faults")]
pub fn faulty(spirv: &[u32]) -> Option<&'static [u32]> {
    FAULTY.iter().find(|(whole, _)| *whole == spirv).map(|(_, faulty)| *faulty)
}
