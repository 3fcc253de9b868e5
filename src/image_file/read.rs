//! Decodes image files, and picks the channels that hold colour or depth.

use super::{
    arrays,
    color_space::ColorSpace,
    exr_file::{self, Exr},
    jpeg::{self, Extent},
    layers::Taken,
    placement::{self, Placement},
    png_chunks, radiance,
};
use crate::{Error, Result, budget};
use image::{DynamicImage, ImageDecoder, ImageFormat, ImageReader, Limits, metadata::Orientation};
use rayon::prelude::*;
use std::{
    io::{BufRead, Cursor, Seek},
    path::Path,
};

/// The most pixels of an image that is decoded as a whole (16384 × 16384).
pub const MAX_PIXELS: u64 = 1 << 28;
/// The most pixels of a picture whose colours are read by strips, which need not be in memory together.
pub(super) const MAX_STRIPS: u64 = 1 << 32;

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

/// Reads one number a pixel, as [`FileImage::codes_of`] returns them. Of an EXR nothing else is kept.
///
/// # Errors
/// Fails as [`read`] and [`FileImage::codes_of`] do.
pub fn codes(path: &Path, layer: Option<&str>) -> Result<CodeImage> {
    let subject = path.display().to_string();
    match exr_file::codes_of_file(path, layer, &subject)? {
        Some(codes) => Ok(codes),
        None => {
            let bytes = read_bytes(path)?;
            match layer.and_then(|layer| arrays::named(&bytes, layer, &subject)) {
                Some(array) => array?.into_codes(&subject),
                None => decode(&bytes, &subject)?.codes_of(layer, &subject),
            }
        }
    }
}

/// Decodes an image. `subject` names it in errors.
///
/// # Errors
/// Fails if the bytes are empty, of an unknown type, damaged or too large.
pub fn decode(bytes: &[u8], subject: &str) -> Result<FileImage> {
    if bytes.is_empty() {
        return Err(empty(subject));
    }
    if exr_file::is_exr(bytes) {
        return exr_file::decode(bytes, subject).map(FileImage::Exr);
    }
    if radiance::is_radiance(bytes) {
        return radiance::decode(bytes, subject).map(FileImage::Raster);
    }
    if let Some(array) = arrays::decode(bytes, subject) {
        return array.map(FileImage::Raster);
    }
    let Some(format) = raster_format(bytes) else { return Err(refusal(bytes, subject)) };
    let (decoder, head) = head(Cursor::new(bytes), format, subject)?;
    // What is decoded, and then colours or codes made of it.
    check_size(head.stored, subject)?;
    let texels = |[width, height]: [u32; 2]| u64::from(width) * u64::from(height);
    let placed = if head.is_plain() { 0 } else { texels(head.size()) };
    let pixel = u64::from(decoder.color_type().bytes_per_pixel());
    budget::ask(subject, texels(head.stored) * (pixel + 16) + placed * 16)?;
    pixels(decoder, head, subject).map(FileImage::Raster)
}

pub(super) fn empty(subject: &str) -> Error {
    Error::input(subject, "the file is empty", "write it again")
}

/// The format that the first bytes of a PNG, JPEG, WebP or TIFF name.
pub(super) fn raster_format(bytes: &[u8]) -> Option<ImageFormat> {
    let known = [ImageFormat::Png, ImageFormat::Jpeg, ImageFormat::WebP, ImageFormat::Tiff];
    image::guess_format(bytes).ok().filter(|format| known.contains(format))
}

/// Says what a file is that is no picture, or none that is read.
fn refusal(bytes: &[u8], subject: &str) -> Error {
    if let Some(kind) = photograph(bytes) {
        let remedy = match kind {
            "AVIF" => "convert it, as with: avifdec picture.avif picture.png (of libavif)",
            _ => "convert it, as with: heif-convert photo.heic photo.png (of libheif)",
        };
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

/// What a PNG, JPEG, WebP or TIFF says of its pixels before they are decoded.
pub(super) struct Head {
    format: ImageFormat,
    /// Width and height as stored.
    stored: [u32; 2],
    orientation: Orientation,
    color: Option<ColorSpace>,
    /// Where the picture is in the whole, if that is larger.
    crop: Option<Placement>,
    notes: Vec<String>,
}

impl Head {
    /// Width and height of the whole picture.
    pub fn size(&self) -> [u32; 2] {
        self.crop.map_or(turned(self.stored, self.orientation), |crop| crop.whole)
    }

    /// Whether it is stored as it is shown.
    pub fn is_plain(&self) -> bool {
        self.orientation == Orientation::NoTransforms && self.crop.is_none()
    }

    pub fn space(&self, floats: bool) -> ColorSpace {
        if floats { ColorSpace::LINEAR } else { self.color.clone().unwrap_or(ColorSpace::SRGB) }
    }

    pub fn notes(&self) -> Vec<String> {
        self.notes.iter().cloned().chain(self.crop.map(|crop| crop.note())).collect()
    }
}

fn turned([width, height]: [u32; 2], orientation: Orientation) -> [u32; 2] {
    match orientation {
        Orientation::Rotate90 | Orientation::Rotate270 | Orientation::Rotate90FlipH | Orientation::Rotate270FlipH => {
            [height, width]
        }
        _ => [width, height],
    }
}

fn damaged(error: image::ImageError, subject: &str) -> Error {
    if matches!(error, image::ImageError::Limits(_)) {
        return Error::input(subject, "takes more memory than is allowed", budget::REMEDY);
    }
    Error::input(subject, format!("cannot be decoded: {}", one_line(&error)), "write it again")
}

/// The most bytes of what a PNG holds compressed beside its pixels.
pub const MOST_OF_PROFILE: u64 = 32 << 20;

/// Says if a JPEG is cut off.
fn check_jpeg(mut reader: impl BufRead + Seek, subject: &str) -> Result<Option<String>> {
    let size = ImageReader::with_format(&mut reader, ImageFormat::Jpeg).into_dimensions();
    let (width, height) = size.map_err(|error| damaged(error, subject))?;
    let _ = reader.rewind();
    let extent = jpeg::extent(&mut reader, [width, height]);
    let _ = reader.rewind();
    let problem = "ends early: some of its pixels are missing, and are grey or black";
    match extent {
        Extent::Whole => Ok(None),
        Extent::Cut => Ok(Some(problem.to_owned())),
        Extent::Bare => {
            let problem = format!("ends early: it is too short for {width}x{height} pixels");
            Err(Error::input(subject, problem, "write it again"))
        }
    }
}

/// Reads the header of a PNG, JPEG, WebP or TIFF.
pub(super) fn head<'a>(
    mut reader: impl BufRead + Seek + 'a,
    format: ImageFormat,
    subject: &str,
) -> Result<(Box<dyn ImageDecoder + 'a>, Head)> {
    let chunks = if format == ImageFormat::Png { png_chunks::color_space(&mut reader) } else { None };
    let _ = reader.rewind(); // a file that cannot be rewound cannot be decoded
    let mut notes = Vec::new();
    if format == ImageFormat::Jpeg {
        notes.extend(check_jpeg(&mut reader, subject)?);
    }
    let mut limits = Limits::default();
    // A profile is compressed, too, and a small one may claim to be large.
    let most = if format == ImageFormat::Png { MOST_OF_PROFILE } else { MAX_PIXELS * 16 };
    limits.max_alloc = Some(most.min(budget::limit()));
    let mut reader = ImageReader::with_format(reader, format);
    reader.limits(limits);
    let mut decoder = reader.into_decoder().map_err(|error| damaged(error, subject))?;
    let (width, height) = decoder.dimensions();
    let stored = [width, height];
    check_strips(stored, subject)?;
    // What is said beside the pixels is not worth refusing a picture for.
    let orientation = decoder.orientation().unwrap_or(Orientation::NoTransforms);
    let profile = decoder.icc_profile().ok().flatten();
    let xmp = decoder.xmp_metadata().ok().flatten();
    let color = chunks.or_else(|| match profile.as_deref().map(ColorSpace::of_icc)? {
        None => {
            notes.push("its colour profile cannot be used: sRGB is taken".to_owned());
            None
        }
        known => known,
    });
    let crop = xmp.and_then(|xmp| placement::gpano(&String::from_utf8_lossy(&xmp), turned(stored, orientation)));
    Ok((Box::new(decoder), Head { format, stored, orientation, color, crop, notes }))
}

/// Decodes the pixels, turns them as the header says, and puts them where they belong.
pub(super) fn pixels(decoder: Box<dyn ImageDecoder + '_>, head: Head, subject: &str) -> Result<Raster> {
    let mut decoded = DynamicImage::from_decoder(decoder).map_err(|error| damaged(error, subject))?;
    if head.orientation != Orientation::NoTransforms {
        decoded.apply_orientation(head.orientation);
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
    let color = head.space(matches!(samples, Samples::F32(_)));
    let lossy = matches!(head.format, ImageFormat::Jpeg | ImageFormat::WebP);
    let raster = Raster { size, channels, samples, lossy, color, notes: head.notes };
    Ok(match head.crop {
        Some(crop) => placement::place(raster, crop),
        None => raster,
    })
}

/// Refuses empty and absurd images before anything is allocated for them.
pub(super) fn check_size(size: [u32; 2], subject: &str) -> Result<()> {
    check_pixels(size, MAX_PIXELS, subject)
}

/// The same of a picture whose colours are read by strips.
pub(super) fn check_strips(size: [u32; 2], subject: &str) -> Result<()> {
    check_pixels(size, MAX_STRIPS, subject)
}

fn check_pixels(size: [u32; 2], most: u64, subject: &str) -> Result<()> {
    let [width, height] = size;
    if width == 0 || height == 0 {
        return Err(Error::input(subject, format!("is {width}x{height} pixels"), "give an image with pixels"));
    }
    if u64::from(width) * u64::from(height) > most {
        let side = most.isqrt();
        let problem = format!("says it has {width}x{height} pixels, more than {side}x{side}");
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

pub(super) fn no_layers(subject: &str) -> Error {
    Error::input(subject, "has no layers, as an EXR or NPZ has", "leave layer out")
}

impl Raster {
    /// Says whether alpha tells what is known: it does not if it says that all is, or that nothing is.
    pub(super) fn alpha_tells(&self) -> bool {
        fn tells<T: Copy + PartialOrd + Sync>(values: &[T], channels: usize, zero: T) -> bool {
            let alphas = || values.par_chunks_exact(channels).map(|pixel| pixel[channels - 1] > zero);
            alphas().any(|known| known) && alphas().any(|known| !known)
        }
        self.channels.is_multiple_of(2)
            && match &self.samples {
                Samples::U8(values) => tells(values, self.channels, 0),
                Samples::U16(values) => tells(values, self.channels, 0),
                Samples::F32(values) => tells(values, self.channels, 0.0),
            }
    }

    fn into_color(mut self) -> ColorImage {
        let (size, ldr, notes) = (self.size, self.is_ldr(), std::mem::take(&mut self.notes));
        let width = size[0] as usize;
        let mut texels = vec![[0.0; 4]; width * size[1] as usize];
        self.strips(&mut |row, strip| {
            texels[row as usize * width..][..strip.len()].copy_from_slice(strip);
        });
        ColorImage { size, texels, ldr, taken: None, notes }
    }

    fn into_codes(self, subject: &str) -> Result<CodeImage> {
        let (channels, alpha) = (self.channels, self.alpha_tells());
        let (integer, full) = match &self.samples {
            Samples::U8(_) => (true, 255.0),
            Samples::U16(_) => (true, 65535.0),
            Samples::F32(_) => (false, f32::INFINITY),
        };
        let value = |at: usize| match &self.samples {
            Samples::U8(codes) => f32::from(codes[at]),
            Samples::U16(codes) => f32::from(codes[at]),
            Samples::F32(values) => values[at],
        };
        // Lossy compression tints grey a little. A colour map is coloured all over.
        let tint = if self.lossy { 0.15 * full } else { 0.0 };
        let mut coloured = 0;
        let codes: Vec<f32> = (0..self.size[0] as usize * self.size[1] as usize)
            .map(|pixel| {
                let at = pixel * channels;
                let [r, g, b] = if channels < 3 { [value(at); 3] } else { [at, at + 1, at + 2].map(value) };
                coloured += usize::from(r.max(g).max(b) - r.min(g).min(b) > tint);
                if alpha && value(at + channels - 1) <= 0.0 {
                    return f32::NAN;
                }
                if r == g && g == b { r } else { (0.299 * r + 0.587 * g + 0.114 * b).round() }
            })
            .collect();
        let most = if self.lossy { codes.len() / 20 } else { 0 };
        if coloured > most {
            let remedy = "give the one grey channel that holds the depth codes, not a coloured preview of it";
            return Err(Error::input(subject, "a depth image in colour has no defined codes", remedy));
        }
        // Depth codes are not colours, so notes about a colour profile do not matter to them.
        let notes = self.notes.into_iter().filter(|note| !note.starts_with("its colour profile")).collect();
        Ok(CodeImage { size: self.size, codes, integer, taken: None, notes })
    }
}
