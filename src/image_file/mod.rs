//! Image files. PNG, JPEG, Radiance HDR and OpenEXR are read; PNG and OpenEXR are written.
//!
//! Files are told apart by their first bytes, not by their names.
pub mod checked;
pub mod exr_file;
pub mod read;
pub mod srgb;
pub mod write;

pub use exr_file::ExrLayer;
pub use read::{CodeImage, ColorImage, FileImage, Raster, Samples};
