//! Image files. PNG, JPEG, WebP, TIFF, Radiance HDR, OpenEXR, NPY, NPZ, PFM and DPT are read; PNG and OpenEXR are written.
//!
//! Files are told apart by their first bytes, not by their names.
mod arrays;
pub mod checked;
pub mod color_space;
pub mod exr_file;
mod jpeg;
pub mod layers;
mod placement;
mod png_chunks;
mod radiance;
pub mod read;
pub mod rows;
pub mod srgb;
pub mod tonemap;
pub mod write;

pub use exr_file::{Exr, ExrLayer};
pub use read::{CodeImage, ColorImage, FileImage, Raster, Samples};
