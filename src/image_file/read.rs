//! Decodes image files, and picks the channels that hold colour or depth.

use super::{
    arrays,
    color_space::ColorSpace,
    exr_file::{self, Exr},
    layers::Taken,
    placement, png_chunks, radiance,
};
use crate::{Error, Result, budget};
use glam::Vec3;
use image::{DynamicImage, ImageDecoder, ImageFormat, ImageReader, Limits, metadata::Orientation};
use std::{io::Cursor, path::Path};

/// The most pixels that an image may have (16384 × 16384).
pub const MAX_PIXELS: u64 = 1 << 28;

/// Stored numbers, with interleaved channels.
#[derive(Clone, Debug, PartialEq)]
pub enum Samples {
    U8(Vec<u8>),
    U16(Vec<u16>),
    F32(Vec<f32>),
}

/// A PNG, JPEG, WebP, TIFF or HDR image, turned as the file says and put where it belongs in the whole.
#[derive(Clone, Debug, PartialEq)]
pub struct Raster {
    /// Width and height.
    pub size: [u32; 2],
    /// 1 is grey, 2 grey and alpha, 3 RGB, 4 RGBA.
    pub channels: usize,
    pub samples: Samples,
    /// Whether grey may have become slightly coloured.
    pub lossy: bool,
    /// What the numbers mean as colours.
    pub color: ColorSpace,
    /// What is unusual about the file.
    pub notes: Vec<String>,
}

/// Any image file.
#[derive(Clone, Debug, PartialEq)]
pub enum FileImage {
    Raster(Raster),
    Exr(Exr),
}

/// Linear Rec. 709 radiance with row 0 on top. Alpha is 1, or 0 where nothing is known.
#[derive(Clone, Debug, PartialEq)]
pub struct ColorImage {
    pub size: [u32; 2],
    pub texels: Vec<[f32; 4]>,
    /// Whether it came from 8 or 16 bits a channel, so that 1 is saturated.
    pub ldr: bool,
    /// The channels of an EXR that were taken.
    pub taken: Option<Taken>,
    /// What is unusual about the file.
    pub notes: Vec<String>,
}

/// An image with one number a pixel.
#[derive(Clone, Debug, PartialEq)]
pub struct CodeImage {
    pub size: [u32; 2],
    pub codes: Vec<f32>,
    /// Whether the numbers are whole (0..255 or 0..65535).
    pub integer: bool,
    /// The channel of an EXR that was taken.
    pub taken: Option<Taken>,
    /// What is unusual about the file.
    pub notes: Vec<String>,
}

/// Reads a whole regular file.
///
/// # Errors
/// Fails if the file cannot be read, is no regular file, or takes more memory than is allowed. The error names
/// it.
pub fn read_bytes(path: &Path) -> Result<Vec<u8>> {
    let fail = |problem: String| Error::input(path.display(), problem, "check the file's name and permissions");
    let metadata = std::fs::metadata(path).map_err(|error| fail(plain_io(&error)))?;
    if !metadata.is_file() {
        return Err(fail("is not a regular file".into()));
    }
    budget::ask(&path.display().to_string(), metadata.len())?;
    std::fs::read(path).map_err(|error| fail(plain_io(&error)))
}

/// Puts an I/O error into words.
pub fn plain_io(error: &std::io::Error) -> String {
    match error.kind() {
        std::io::ErrorKind::NotFound => "there is no such file".into(),
        std::io::ErrorKind::PermissionDenied => "permission denied".into(),
        _ => one_line(error),
    }
}

/// Removes line breaks from a message.
pub fn one_line(message: &impl ToString) -> String {
    message.to_string().split_whitespace().collect::<Vec<_>>().join(" ")
}

/// Reads an image file.
///
/// # Errors
/// Fails if the file is unreadable, empty, of an unknown type, damaged or too large. The error names it.
pub fn read(path: &Path) -> Result<FileImage> {
    decode(&read_bytes(path)?, &path.display().to_string())
}

/// Decodes an image. `subject` names it in errors.
///
/// # Errors
/// Fails if the bytes are empty, of an unknown type, damaged or too large.
pub fn decode(bytes: &[u8], subject: &str) -> Result<FileImage> {
    if bytes.is_empty() {
        return Err(Error::input(subject, "the file is empty", "write it again"));
    }
    if bytes.starts_with(&[0x76, 0x2f, 0x31, 0x01]) {
        return exr_file::decode(bytes, subject).map(FileImage::Exr);
    }
    if radiance::is_radiance(bytes) {
        return radiance::decode(bytes, subject).map(FileImage::Raster);
    }
    if let Some(array) = arrays::decode(bytes, subject) {
        return array.map(FileImage::Raster);
    }
    let known = [ImageFormat::Png, ImageFormat::Jpeg, ImageFormat::WebP, ImageFormat::Tiff];
    match image::guess_format(bytes) {
        Ok(format) if known.contains(&format) => decode_raster(bytes, format, subject).map(FileImage::Raster),
        _ => Err(refusal(bytes, subject)),
    }
}

/// Says what a file is that is no picture, or none that is read.
fn refusal(bytes: &[u8], subject: &str) -> Error {
    if let Some(kind) = photograph(bytes) {
        let remedy = "convert it, as with: heif-convert photo.heic photo.png (of libheif)";
        return Error::input(subject, format!("is a picture of the kind {kind}, which is not read"), remedy);
    }
    if is_video(bytes) {
        let remedy = "give one of its frames, as from: ffmpeg -i video.mp4 -frames:v 1 frame.png";
        return Error::input(subject, "is a video, but one picture is needed", remedy);
    }
    Error::input(subject, "is not a PNG, JPEG, WebP, TIFF, EXR or HDR image", "convert it to one of these")
}

/// Recognises pictures in the containers of videos, as phones write them.
fn photograph(bytes: &[u8]) -> Option<&'static str> {
    match (bytes.get(4..8)?, bytes.get(8..12)?) {
        (b"ftyp", b"avif" | b"avis") => Some("AVIF"),
        (b"ftyp", b"heic" | b"heix" | b"heim" | b"heis" | b"hevc" | b"mif1" | b"msf1") => Some("HEIC"),
        _ => None,
    }
}

fn is_video(bytes: &[u8]) -> bool {
    bytes.get(4..8) == Some(b"ftyp")
        || bytes.starts_with(&[0x1a, 0x45, 0xdf, 0xa3])
        || bytes.get(8..12) == Some(b"AVI ")
}

fn decode_raster(bytes: &[u8], format: ImageFormat, subject: &str) -> Result<Raster> {
    let damaged = |error: image::ImageError| {
        Error::input(subject, format!("cannot be decoded: {}", one_line(&error)), "write it again")
    };
    let mut limits = Limits::default();
    limits.max_alloc = Some(MAX_PIXELS * 16);
    let mut reader = ImageReader::with_format(Cursor::new(bytes), format);
    reader.limits(limits);
    let mut decoder = reader.into_decoder().map_err(damaged)?;
    let (width, height) = decoder.dimensions();
    check_size([width, height], subject)?;
    // What is decoded, and then colours or codes made of it.
    let pixel = u64::from(decoder.color_type().bytes_per_pixel()) + 16;
    budget::ask(subject, u64::from(width) * u64::from(height) * pixel)?;
    // What is said beside the pixels is not worth refusing a picture for.
    let orientation = decoder.orientation().unwrap_or(Orientation::NoTransforms);
    let profile = decoder.icc_profile().ok().flatten();
    let xmp = decoder.xmp_metadata().ok().flatten();
    let mut notes = Vec::new();
    let chunks = if format == ImageFormat::Png { png_chunks::color_space(bytes) } else { None };
    let color = chunks.or_else(|| match profile.as_deref().map(ColorSpace::of_icc)? {
        None => {
            notes.push("its colour profile cannot be used: sRGB is taken".to_owned());
            None
        }
        known => known,
    });
    let mut decoded = DynamicImage::from_decoder(decoder).map_err(damaged)?;
    if orientation != Orientation::NoTransforms {
        decoded.apply_orientation(orientation);
    }
    let size = [decoded.width(), decoded.height()];
    let (channels, samples) = match decoded {
        DynamicImage::ImageLuma8(image) => (1, Samples::U8(image.into_raw())),
        DynamicImage::ImageLumaA8(image) => (2, Samples::U8(image.into_raw())),
        DynamicImage::ImageRgb8(image) => (3, Samples::U8(image.into_raw())),
        DynamicImage::ImageRgba8(image) => (4, Samples::U8(image.into_raw())),
        DynamicImage::ImageLuma16(image) => (1, Samples::U16(image.into_raw())),
        DynamicImage::ImageLumaA16(image) => (2, Samples::U16(image.into_raw())),
        DynamicImage::ImageRgb16(image) => (3, Samples::U16(image.into_raw())),
        DynamicImage::ImageRgba16(image) => (4, Samples::U16(image.into_raw())),
        DynamicImage::ImageRgba32F(image) => (4, Samples::F32(image.into_raw())),
        other => (3, Samples::F32(other.into_rgb32f().into_raw())),
    };
    let color = match samples {
        Samples::F32(_) => ColorSpace::LINEAR,
        _ => color.unwrap_or(ColorSpace::SRGB),
    };
    let lossy = matches!(format, ImageFormat::Jpeg | ImageFormat::WebP);
    let raster = Raster { size, channels, samples, lossy, color, notes };
    let crop = xmp.and_then(|xmp| placement::gpano(&String::from_utf8_lossy(&xmp), size));
    Ok(match crop {
        Some(crop) => placement::place(raster, crop),
        None => raster,
    })
}

/// Refuses empty and absurd images before anything is allocated for them.
pub(super) fn check_size(size: [u32; 2], subject: &str) -> Result<()> {
    let [width, height] = size;
    if width == 0 || height == 0 {
        return Err(Error::input(subject, format!("is {width}x{height} pixels"), "give an image with pixels"));
    }
    if u64::from(width) * u64::from(height) > MAX_PIXELS {
        let problem = format!("says it has {width}x{height} pixels, more than 16384x16384");
        return Err(Error::input(subject, problem, "give a smaller image"));
    }
    Ok(())
}

impl FileImage {
    /// Returns linear radiance. Of an EXR it takes the layer whose name means colour.
    ///
    /// # Errors
    /// Fails if an EXR has no such channels. The error lists those that it has.
    pub fn into_color(self, subject: &str) -> Result<ColorImage> {
        self.color_of(None, subject)
    }

    /// The same of the layer that is named.
    ///
    /// # Errors
    /// Fails if there is no such layer, or if the file has no layers.
    pub fn color_of(self, layer: Option<&str>, subject: &str) -> Result<ColorImage> {
        match self {
            Self::Raster(_) if layer.is_some() => Err(no_layers(subject)),
            Self::Raster(raster) => Ok(raster.into_color()),
            Self::Exr(exr) => exr_file::color(exr, layer, subject),
        }
    }

    /// Returns one number a pixel: grey, the luma of a JPEG or WebP, or an EXR's channel whose name means
    /// depth. It is NaN where nothing is known.
    ///
    /// # Errors
    /// Fails for a coloured image, and for an EXR without such a channel.
    pub fn into_codes(self, subject: &str) -> Result<CodeImage> {
        self.codes_of(None, subject)
    }

    /// The same of the layer or channel that is named.
    ///
    /// # Errors
    /// Fails if there is no such layer, or if the file has no layers.
    pub fn codes_of(self, layer: Option<&str>, subject: &str) -> Result<CodeImage> {
        match self {
            Self::Raster(_) if layer.is_some() => Err(no_layers(subject)),
            Self::Raster(raster) => raster.into_codes(subject),
            Self::Exr(exr) => exr_file::codes(exr, layer, subject),
        }
    }
}

fn no_layers(subject: &str) -> Error {
    Error::input(subject, "has no layers, as an EXR has", "leave layer out")
}

impl Raster {
    /// Returns whether each pixel is known, by alpha; `None` if all are, or if alpha says that none is.
    fn known(&self) -> Option<Vec<bool>> {
        let channels = self.channels;
        if channels % 2 == 1 {
            return None;
        }
        let known: Vec<bool> = match &self.samples {
            Samples::U8(values) => values.chunks_exact(channels).map(|p| p[channels - 1] > 0).collect(),
            Samples::U16(values) => values.chunks_exact(channels).map(|p| p[channels - 1] > 0).collect(),
            Samples::F32(values) => values.chunks_exact(channels).map(|p| p[channels - 1] > 0.0).collect(),
        };
        (known.contains(&false) && known.contains(&true)).then_some(known)
    }

    fn into_color(self) -> ColorImage {
        let known = self.known();
        let (space, channels) = (&self.color, self.channels);
        let gather = |value: &dyn Fn(usize, usize) -> f32, count: usize| {
            (0..count / channels)
                .map(|pixel| {
                    let at = pixel * channels;
                    let [r, g, b] = if channels < 3 { [at; 3] } else { [at, at + 1, at + 2] };
                    let color = space.rec709(Vec3::new(value(r, 0), value(g, 1), value(b, 2)));
                    let known = !color.is_nan() && known.as_ref().is_none_or(|known| known[pixel]);
                    color.extend(f32::from(known)).to_array()
                })
                .collect()
        };
        let decoded = |largest: u16| -> [Vec<f32>; 3] {
            let code = |code: u16| f32::from(code) / f32::from(largest);
            std::array::from_fn(|c| (0..=largest).map(|value| space.transfer.linear(code(value), c)).collect())
        };
        let (texels, ldr) = match &self.samples {
            Samples::U8(codes) => {
                let table = decoded(255);
                (gather(&|i, c| table[c][usize::from(codes[i])], codes.len()), space.transfer.saturates_at_one())
            }
            Samples::U16(codes) => {
                let table = decoded(65535);
                (gather(&|i, c| table[c][usize::from(codes[i])], codes.len()), space.transfer.saturates_at_one())
            }
            Samples::F32(values) => (gather(&|i, _| values[i], values.len()), false),
        };
        ColorImage { size: self.size, texels, ldr, taken: None, notes: self.notes }
    }

    fn into_codes(self, subject: &str) -> Result<CodeImage> {
        let (channels, known) = (self.channels, self.known());
        let (values, full): (Vec<f32>, f32) = match &self.samples {
            Samples::U8(codes) => (codes.iter().map(|code| f32::from(*code)).collect(), 255.0),
            Samples::U16(codes) => (codes.iter().map(|code| f32::from(*code)).collect(), 65535.0),
            Samples::F32(values) => (values.clone(), f32::INFINITY),
        };
        let integer = !matches!(self.samples, Samples::F32(_));
        // Lossy compression tints grey a little. A colour map is coloured all over.
        let tint = if self.lossy { 0.15 * full } else { 0.0 };
        let mut coloured = 0;
        let mut codes: Vec<f32> = values
            .chunks_exact(channels)
            .map(|pixel| {
                let [r, g, b] = if channels < 3 { [pixel[0]; 3] } else { [pixel[0], pixel[1], pixel[2]] };
                coloured += usize::from(r.max(g).max(b) - r.min(g).min(b) > tint);
                if r == g && g == b { r } else { (0.299 * r + 0.587 * g + 0.114 * b).round() }
            })
            .collect();
        let most = if self.lossy { codes.len() / 20 } else { 0 };
        if coloured > most {
            let remedy = "give the one grey channel that holds the depth codes, not a coloured preview of it";
            return Err(Error::input(subject, "a depth image in colour has no defined codes", remedy));
        }
        for (code, _) in codes.iter_mut().zip(known.iter().flatten()).filter(|(_, known)| !**known) {
            *code = f32::NAN;
        }
        // Depth codes are not colours, so notes about a colour profile do not matter to them.
        let notes = self.notes.into_iter().filter(|note| !note.starts_with("its colour profile")).collect();
        Ok(CodeImage { size: self.size, codes, integer, taken: None, notes })
    }
}
