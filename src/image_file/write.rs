//! Writes image files. A file is written beside its target and then renamed, so that no output is ever
//! half-written.

use super::{
    exr_file::{self, ExrLayer},
    read::plain_io,
};
use crate::{Error, Result, image_file::srgb::linear_to_srgb, temporary::Temporary};
use std::{
    fs::File,
    io::{BufWriter, Write},
    path::Path,
};

/// Returns the folder that a file is in.
pub fn folder_of(file: &Path) -> &Path {
    file.parent().filter(|folder| !folder.as_os_str().is_empty()).unwrap_or(Path::new("."))
}

/// Writes a file with `fill`, then moves it to `path`.
///
/// # Errors
/// Fails if the folder or file cannot be written, or if `fill` fails.
pub fn write_atomically(path: &Path, fill: impl FnOnce(&mut BufWriter<&mut File>) -> Result<()>) -> Result<()> {
    let fail = |error: &std::io::Error| {
        Error::input(
            path.display(),
            format!("cannot be written: {}", plain_io(error)),
            "give a writable folder that exists",
        )
    };
    if path.is_dir() {
        return Err(Error::input(path.display(), "is a folder", "give a file name"));
    }
    let folder = folder_of(path);
    let mut file = Temporary::new(folder).map_err(|error| fail(&error))?;
    let mut writer = BufWriter::new(file.file().map_err(|error| fail(&error))?);
    fill(&mut writer)?;
    writer.flush().map_err(|error| fail(&error))?;
    drop(writer);
    file.keep(path).map_err(|error| fail(&error))
}

/// Writes bytes.
///
/// # Errors
/// Fails if the folder or file cannot be written.
pub fn write_bytes(path: &Path, bytes: &[u8]) -> Result<()> {
    write_atomically(path, |out| out.write_all(bytes).map_err(|error| write_error(path, &error)))
}

/// Makes a folder that the user names, and those that it is in, if it does not exist.
///
/// # Errors
/// Fails if the folder cannot be made.
pub fn make_folder(folder: &Path) -> Result<()> {
    make(folder, "give a folder that can be written")
}

/// Makes the folder of a file in the cache, if it does not exist.
///
/// # Errors
/// Fails if the folder cannot be made.
pub fn make_cache_folder(file: &Path) -> Result<()> {
    make(file.parent().unwrap_or(Path::new("")), "set IPRT_CACHE to a writable folder")
}

fn make(folder: &Path, remedy: &str) -> Result<()> {
    let fail = |error: std::io::Error| format!("cannot be made: {}", error.kind());
    std::fs::create_dir_all(folder).map_err(|error| Error::input(folder.display(), fail(error), remedy))
}

fn write_error(path: &Path, error: &impl ToString) -> Error {
    let problem = format!("cannot be written: {}", super::read::one_line(error));
    Error::input(path.display(), problem, "free some space")
}

/// Returns the 8-bit sRGB code of a linear value, clipped to 0..1. NaN gives 0.
pub fn display_code(linear: f32) -> u8 {
    // The cast turns NaN into 0.
    (linear_to_srgb(linear.clamp(0.0, 1.0)) * 255.0 + 0.5) as u8
}

/// Writes linear radiance as it is displayed: sRGB(clip(exposure · L)), 8 bits a channel, without alpha.
///
/// # Errors
/// Fails if the folder or file cannot be written.
pub fn write_display(path: &Path, size: [u32; 2], texels: &[[f32; 4]], exposure: f32) -> Result<()> {
    let bytes: Vec<u8> =
        texels.iter().flat_map(|[r, g, b, _]| [*r, *g, *b].map(|value| display_code(exposure * value))).collect();
    write_png(path, size, &bytes, 3)
}

/// Writes 8-bit codes as they are, with `channels` (1 grey, 3 RGB, 4 RGBA) interleaved.
///
/// # Errors
/// Fails if the folder or file cannot be written.
pub fn write_png(path: &Path, size: [u32; 2], codes: &[u8], channels: usize) -> Result<()> {
    write_png_of(path, size, codes, channels, Shown::Part)
}

/// What a picture shows, which its file says as viewers of panoramas understand it.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Shown {
    Part,
    /// All around, equirectangular.
    Around,
}

/// Google's GPano, in the XMP of a PNG.
const GPANO: &str = "<x:xmpmeta xmlns:x=\"adobe:ns:meta/\"><rdf:RDF \
    xmlns:rdf=\"http://www.w3.org/1999/02/22-rdf-syntax-ns#\"><rdf:Description rdf:about=\"\" \
    xmlns:GPano=\"http://ns.google.com/photos/1.0/panorama/\" GPano:ProjectionType=\"equirectangular\"/>\
    </rdf:RDF></x:xmpmeta>";

/// The same as [`write_png`], of a picture that may be a panorama.
///
/// # Errors
/// Fails as it does.
pub fn write_png_of(path: &Path, size: [u32; 2], codes: &[u8], channels: usize, shown: Shown) -> Result<()> {
    let color = match channels {
        1 => png::ColorType::Grayscale,
        3 => png::ColorType::Rgb,
        4 => png::ColorType::Rgba,
        _ => return Err(Error::Internal(format!("writing PNG: {channels} channels"))),
    };
    if codes.len() != size[0] as usize * size[1] as usize * channels {
        return Err(Error::Internal(format!("writing PNG: {} bytes for {size:?} × {channels}", codes.len())));
    }
    let encode = |out: &mut BufWriter<&mut File>| -> std::result::Result<(), png::EncodingError> {
        let mut encoder = png::Encoder::new(out, size[0], size[1]);
        encoder.set_color(color);
        encoder.set_compression(png::Compression::Fast);
        if shown == Shown::Around {
            encoder.add_itxt_chunk("XML:com.adobe.xmp".into(), GPANO.into())?;
        }
        let mut writer = encoder.write_header()?;
        writer.write_image_data(codes)?;
        writer.finish()
    };
    write_atomically(path, |out| encode(out).map_err(|error| write_error(path, &error)))
}

/// Writes layers of one size as float EXR. The main layer has no name.
///
/// # Errors
/// Fails if the folder or file cannot be written.
pub fn write_exr(path: &Path, layers: &[ExrLayer]) -> Result<()> {
    write_exr_of(path, layers, Shown::Part)
}

/// The same, of pictures that may be panoramas.
///
/// # Errors
/// Fails as [`write_exr`] does.
pub fn write_exr_of(path: &Path, layers: &[ExrLayer], shown: Shown) -> Result<()> {
    write_atomically(path, |out| exr_file::encode(layers, shown, &path.display().to_string(), out))
}
