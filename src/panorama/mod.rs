//! The 360° RGBD video: files or memory to linear radiance and metres, and the equirectangular mapping.
pub mod depth;
pub mod light;
pub mod mapping;
pub mod pattern;
pub mod source;
pub mod tone;
