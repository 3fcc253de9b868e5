//! Decodes image files, and picks the channels that hold colour or depth.

use super::exr_file::{self, ExrLayer};
use crate::{Error, Result, image_file::srgb::srgb_to_linear};
use image::{DynamicImage, ImageFormat, ImageReader, Limits};
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

/// A PNG, JPEG or HDR image.
#[derive(Clone, Debug, PartialEq)]
pub struct Raster {
    /// Width and height.
    pub size: [u32; 2],
    /// 1 is grey, 2 grey and alpha, 3 RGB, 4 RGBA.
    pub channels: usize,
    pub samples: Samples,
    /// Whether grey may have become slightly coloured.
    pub lossy: bool,
}

/// Any image file.
#[derive(Clone, Debug, PartialEq)]
pub enum FileImage {
    Raster(Raster),
    Exr(Vec<ExrLayer>),
}

/// Linear Rec. 709 radiance with alpha 1 and row 0 on top.
#[derive(Clone, Debug, PartialEq)]
pub struct ColorImage {
    pub size: [u32; 2],
    pub texels: Vec<[f32; 4]>,
    /// Whether it came from 8 or 16 bits a channel and was sRGB-decoded, so that 1 is saturated.
    pub ldr: bool,
}

/// An image with one number a pixel.
#[derive(Clone, Debug, PartialEq)]
pub struct CodeImage {
    pub size: [u32; 2],
    pub codes: Vec<f32>,
    /// Whether the numbers are whole (0..255 or 0..65535).
    pub integer: bool,
}

/// Reads a whole regular file of at most 4 GiB.
///
/// # Errors
/// Fails if the file cannot be read, is no regular file, or is larger. The error names it.
pub fn read_bytes(path: &Path) -> Result<Vec<u8>> {
    let fail = |problem: String| Error::input(path.display(), problem, "check the file's name and permissions");
    let metadata = std::fs::metadata(path).map_err(|error| fail(plain_io(&error)))?;
    if !metadata.is_file() {
        return Err(fail("is not a regular file".into()));
    }
    if metadata.len() > 1 << 32 {
        return Err(fail("is larger than 4 GiB".into()));
    }
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
    let known = [ImageFormat::Png, ImageFormat::Jpeg, ImageFormat::Hdr];
    match image::guess_format(bytes) {
        Ok(format) if known.contains(&format) => decode_raster(bytes, format, subject).map(FileImage::Raster),
        _ if is_video(bytes) => Err(video_refusal(subject)),
        _ => Err(Error::input(subject, "is not a PNG, JPEG, EXR or HDR image", "convert it to one of these")),
    }
}

/// Makes the answer to a video file, which this program does not decode.
pub fn video_refusal(subject: &str) -> Error {
    let remedy =
        "extract its frames, as in: ffmpeg -i video.mp4 %04d.png, and give the pattern %04d.png with frames = [a, b]";
    Error::input(subject, "video files are not read directly", remedy)
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
    reader.limits(limits.clone());
    let (width, height) = reader.into_dimensions().map_err(damaged)?;
    check_size([width, height], subject)?;
    let mut reader = ImageReader::with_format(Cursor::new(bytes), format);
    reader.limits(limits);
    let (channels, samples) = match reader.decode().map_err(damaged)? {
        DynamicImage::ImageLuma8(image) => (1, Samples::U8(image.into_raw())),
        DynamicImage::ImageLumaA8(image) => (2, Samples::U8(image.into_raw())),
        DynamicImage::ImageRgb8(image) => (3, Samples::U8(image.into_raw())),
        DynamicImage::ImageRgba8(image) => (4, Samples::U8(image.into_raw())),
        DynamicImage::ImageLuma16(image) => (1, Samples::U16(image.into_raw())),
        DynamicImage::ImageLumaA16(image) => (2, Samples::U16(image.into_raw())),
        DynamicImage::ImageRgb16(image) => (3, Samples::U16(image.into_raw())),
        DynamicImage::ImageRgba16(image) => (4, Samples::U16(image.into_raw())),
        other => (3, Samples::F32(other.into_rgb32f().into_raw())),
    };
    Ok(Raster { size: [width, height], channels, samples, lossy: format == ImageFormat::Jpeg })
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
    /// Returns linear radiance from R, G and B, or grey from Y.
    ///
    /// # Errors
    /// Fails if an EXR has no such channels. The error lists those that it has.
    pub fn into_color(self, subject: &str) -> Result<ColorImage> {
        match self {
            Self::Raster(raster) => Ok(raster.into_color()),
            Self::Exr(layers) => exr_file::color(layers, subject),
        }
    }

    /// Returns one number a pixel: grey, the luma of a JPEG, or an EXR's Y, Z, R, depth or only channel.
    ///
    /// # Errors
    /// Fails for a coloured PNG, and for an EXR without such a channel.
    pub fn into_codes(self, subject: &str) -> Result<CodeImage> {
        match self {
            Self::Raster(raster) => raster.into_codes(subject),
            Self::Exr(layers) => exr_file::codes(layers, subject),
        }
    }
}

impl Raster {
    fn into_color(self) -> ColorImage {
        let gather = |value: &dyn Fn(usize) -> f32, count: usize| {
            (0..count / self.channels)
                .map(|pixel| {
                    let at = pixel * self.channels;
                    let [r, g, b] = if self.channels < 3 { [at; 3] } else { [at, at + 1, at + 2] };
                    [value(r), value(g), value(b), 1.0]
                })
                .collect()
        };
        let decoded = |largest: u16| -> Vec<f32> {
            (0..=largest).map(|code| srgb_to_linear(f32::from(code) / f32::from(largest))).collect()
        };
        let (texels, ldr) = match &self.samples {
            Samples::U8(codes) => {
                let table = decoded(255);
                (gather(&|i| table[usize::from(codes[i])], codes.len()), true)
            }
            Samples::U16(codes) => {
                let table = decoded(65535);
                (gather(&|i| table[usize::from(codes[i])], codes.len()), true)
            }
            Samples::F32(values) => (gather(&|i| values[i], values.len()), false),
        };
        ColorImage { size: self.size, texels, ldr }
    }

    fn into_codes(self, subject: &str) -> Result<CodeImage> {
        let channels = self.channels;
        let values: Vec<f32> = match &self.samples {
            Samples::U8(codes) => codes.iter().map(|code| f32::from(*code)).collect(),
            Samples::U16(codes) => codes.iter().map(|code| f32::from(*code)).collect(),
            Samples::F32(values) => values.clone(),
        };
        let integer = !matches!(self.samples, Samples::F32(_));
        let mut coloured = false;
        let codes = values
            .chunks_exact(channels)
            .map(|pixel| {
                let [r, g, b] = if channels < 3 { [pixel[0]; 3] } else { [pixel[0], pixel[1], pixel[2]] };
                coloured |= r != g || g != b;
                if r == g && g == b { r } else { (0.299 * r + 0.587 * g + 0.114 * b).round() }
            })
            .collect();
        if coloured && !self.lossy {
            let remedy = "give one grey channel holding the depth codes";
            return Err(Error::input(subject, "a depth image in colour has no defined codes", remedy));
        }
        Ok(CodeImage { size: self.size, codes, integer })
    }
}
