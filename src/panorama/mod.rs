//! The 360° RGBD video. Files or memory become linear radiance and metres, on the equirectangular mapping.
pub mod clipped;
pub mod cloud;
pub mod depth;
mod frame;
pub mod guess;
pub mod lamps;
pub mod level;
pub mod light;
pub mod mapping;
pub mod packing;
pub mod pattern;
pub mod room;
pub mod source;
pub mod stream;
pub mod tone;
mod tracks;
