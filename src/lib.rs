//! `iprt`: virtual objects in 360° RGBD video, lit by the video itself.

pub mod cli;
pub mod error;
#[macro_use]
pub mod gpu;
pub mod image_file;
pub mod measure;
pub mod panorama;
pub mod passes;
pub mod reference;
pub mod renderer;
pub mod scene;
pub mod settings;
pub use error::{Error, Result};
/// SPIR-V of every pass, compiled by `build.rs`.
pub mod shaders {
    include!(concat!(env!("OUT_DIR"), "/shaders.rs"));
}
