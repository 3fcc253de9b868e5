//! Pictures whose colours are read by strips of rows, so that a large one is in memory once, as whoever reads it keeps it.

use super::{
    color_space::ColorSpace,
    exr_file,
    layers::Taken,
    radiance,
    read::{self, FileImage, Raster, Samples, one_line},
};
use crate::{Error, Result};
use glam::Vec3;
use image::{ImageDecoder as _, ImageFormat};
use rayon::prelude::*;
use std::{
    fs::File,
    io::{BufReader, Read as _, Seek as _},
    path::Path,
};

/// How many texels a strip has, about.
pub(super) const STRIP: usize = 1 << 18;

/// Is given the number of a row, and the texels of it and of rows that follow, as a [`ColorImage`](super::ColorImage)
/// has them. Strips come in any order. Texels that do not come are not known.
pub type Strips<'a> = dyn FnMut(u32, &mut [[f32; 4]]) + 'a;

/// The colours of a picture, before they are decoded.
pub struct Rows {
    pub size: [u32; 2],
    /// Whether it has 8 or 16 bits a channel, so that 1 is saturated.
    pub ldr: bool,
    /// The channels of an EXR that are taken.
    pub taken: Option<Taken>,
    /// What is unusual about the file.
    pub notes: Vec<String>,
    /// Bytes that are held of the whole picture while it is decoded.
    pub held: u64,
    pub(super) decode: Decode,
}

pub(super) type Decode = Box<dyn FnOnce(&mut Strips<'_>) -> Result<()>>;

/// Opens a file, and reads its first bytes.
pub(super) fn begin(path: &Path) -> Result<(BufReader<File>, Vec<u8>)> {
    let fail = |problem: String| Error::input(path.display(), problem, "check the file's name and permissions");
    let io = |error: std::io::Error| fail(read::plain_io(&error));
    // A pipe must not be opened: nobody may write to it.
    if !path.metadata().map_err(io)?.is_file() {
        return Err(fail("is not a regular file".into()));
    }
    let file = File::open(path).map_err(io)?;
    let (mut reader, mut start) = (BufReader::with_capacity(1 << 16, file), Vec::new());
    reader.by_ref().take(32).read_to_end(&mut start).map_err(io)?;
    reader.rewind().map_err(io)?;
    if start.is_empty() { Err(read::empty(&path.display().to_string())) } else { Ok((reader, start)) }
}

impl Rows {
    /// Reads what an image file says of its colours. `layer` names a layer of an EXR.
    ///
    /// # Errors
    /// Fails if the file is unreadable, empty, of an unknown type or too large, or if it has no such colours. The error
    /// names it.
    pub fn open(path: &Path, layer: Option<&str>) -> Result<Self> {
        let subject = path.display().to_string();
        let (reader, start) = begin(path)?;
        if exr_file::is_exr(&start) {
            return exr_file::rows(reader, layer, subject);
        }
        if layer.is_some() {
            return Err(read::no_layers(&subject));
        }
        if radiance::is_radiance(&start) {
            return radiance::rows(reader, subject);
        }
        match read::raster_format(&start) {
            Some(format) => match Self::of_raster(path, reader, format, &start, subject) {
                Err(_) if format == ImageFormat::Tiff => Self::of_array(path),
                rows => rows,
            },
            None => Self::of_array(path),
        }
    }

    /// What the `image` crate does not read: arrays of numbers, and TIFF of one deep number a pixel.
    fn of_array(path: &Path) -> Result<Self> {
        match read::read(path)? {
            FileImage::Raster(raster) => Ok(raster.into_rows()),
            FileImage::Exr(_) => Err(Error::Internal("an EXR without its first bytes".into())),
        }
    }

    /// Reads how large an image is, if its header says so: of arrays that is known once they are decoded.
    ///
    /// # Errors
    /// Fails if the file is unreadable, empty, damaged or too large.
    pub fn size(path: &Path) -> Result<Option<[u32; 2]>> {
        let subject = path.display().to_string();
        let (reader, start) = begin(path)?;
        if exr_file::is_exr(&start) {
            return exr_file::size(reader, &subject).map(Some);
        }
        if radiance::is_radiance(&start) {
            return radiance::rows(reader, subject).map(|rows| Some(rows.size));
        }
        let Some(format) = read::raster_format(&start) else { return Ok(None) };
        match read::head(reader, format, &subject) {
            Ok((_, head)) => Ok(Some(head.size())),
            Err(_) if format == ImageFormat::Tiff => Ok(None), // perhaps one of deep numbers, as of an array
            Err(error) => Err(error),
        }
    }

    /// Decodes the picture, and hands out its colours.
    ///
    /// # Errors
    /// Fails if the file is damaged.
    pub fn each(self, strips: &mut Strips<'_>) -> Result<()> {
        (self.decode)(strips)
    }

    /// A PNG is decoded by rows, where these are rows of the picture. Others are decoded whole, as they are stored.
    fn of_raster(
        path: &Path,
        reader: BufReader<File>,
        format: ImageFormat,
        start: &[u8],
        subject: String,
    ) -> Result<Self> {
        const INTERLACED: usize = 28; // where a PNG says it
        let (decoder, head) = read::head(reader, format, &subject)?;
        let (kind, held) = (decoder.color_type(), decoder.total_bytes());
        let floats = matches!(kind, image::ColorType::Rgb32F | image::ColorType::Rgba32F);
        let space = head.space(floats);
        let (size, ldr, notes) = (head.size(), !floats && space.transfer.saturates_at_one(), head.notes());
        let by_rows = format == ImageFormat::Png && head.is_plain() && !kind.has_alpha();
        if by_rows && start.get(INTERLACED) == Some(&0) {
            let (path, channels) = (path.to_owned(), usize::from(kind.channel_count()));
            let largest = if kind.bytes_per_pixel() > kind.channel_count() { u16::MAX } else { u8::MAX.into() };
            let decode = move |out: &mut Strips<'_>| {
                let colors = Colors::of(space, channels, Some(largest), false);
                png_rows(&path, size, &colors, &subject, out)
            };
            return Ok(Self { size, ldr, taken: None, notes, held: 0, decode: Box::new(decode) });
        }
        let decode = move |out: &mut Strips<'_>| {
            read::pixels(decoder, head, &subject)?.strips(out);
            Ok(())
        };
        Ok(Self { size, ldr, taken: None, notes, held, decode: Box::new(decode) })
    }
}

fn png_rows(
    path: &Path,
    [width, height]: [u32; 2],
    colors: &Colors,
    subject: &str,
    out: &mut Strips<'_>,
) -> Result<()> {
    let damaged = |error: png::DecodingError| {
        Error::input(subject, format!("cannot be decoded: {}", one_line(&error)), "write it again")
    };
    let limits = png::Limits { bytes: read::MOST_OF_PROFILE as usize };
    let mut decoder = png::Decoder::new_with_limits(begin(path)?.0, limits);
    decoder.set_transformations(png::Transformations::EXPAND);
    let mut reader = decoder.read_info().map_err(damaged)?;
    let rows = (STRIP as u32 / width).clamp(1, height);
    for first in (0..height).step_by(rows as usize) {
        let mut stored = Vec::new();
        for _ in first..height.min(first + rows) {
            match reader.next_row().map_err(damaged)? {
                Some(row) => stored.extend_from_slice(row.data()),
                None => break,
            }
        }
        let samples = if colors.bytes == 1 {
            Samples::U8(stored)
        } else {
            Samples::U16(stored.as_chunks().0.iter().map(|code| u16::from_be_bytes(*code)).collect())
        };
        out(first, &mut colors.texels(&samples, 0));
    }
    Ok(())
}

/// Turns stored numbers into linear colours.
struct Colors {
    space: ColorSpace,
    channels: usize,
    /// Bytes of a whole number.
    bytes: usize,
    /// What whole numbers are, of red, green and blue.
    table: [Vec<f32>; 3],
    /// Whether alpha says what is known.
    alpha: bool,
}

impl Colors {
    /// `largest` is the largest number, of whole ones.
    fn of(space: ColorSpace, channels: usize, largest: Option<u16>, alpha: bool) -> Self {
        let table = std::array::from_fn(|channel| {
            let codes = largest.map(|largest| (0..=largest).map(move |code| f32::from(code) / f32::from(largest)));
            codes.into_iter().flatten().map(|code| space.transfer.linear(code, channel)).collect()
        });
        Self { space, channels, bytes: if largest == Some(255) { 1 } else { 2 }, table, alpha }
    }

    /// The texels from pixel number `first` to the last.
    fn texels(&self, samples: &Samples, first: usize) -> Vec<[f32; 4]> {
        let (from, table) = (first * self.channels, &self.table);
        match samples {
            Samples::U8(v) => self.convert(&v[from..], |code, c| table[c][usize::from(code)], |alpha| alpha > 0),
            Samples::U16(v) => self.convert(&v[from..], |code, c| table[c][usize::from(code)], |alpha| alpha > 0),
            Samples::F32(v) => self.convert(&v[from..], |value, _| value, |alpha| alpha > 0.0),
        }
    }

    fn convert<T: Copy + Sync>(
        &self,
        stored: &[T],
        linear: impl Fn(T, usize) -> f32 + Sync,
        shows: impl Fn(T) -> bool + Sync,
    ) -> Vec<[f32; 4]> {
        let texel = |pixel: &[T]| {
            let [r, g, b] = if self.channels < 3 { [pixel[0]; 3] } else { [pixel[0], pixel[1], pixel[2]] };
            let color = self.space.rec709(Vec3::new(linear(r, 0), linear(g, 1), linear(b, 2)));
            let known = !color.is_nan() && (!self.alpha || shows(pixel[self.channels - 1]));
            color.extend(f32::from(known)).to_array()
        };
        stored.par_chunks_exact(self.channels).map(texel).collect()
    }
}

impl Raster {
    /// Hands out the colours, from the last row to the first. What was handed out is freed.
    pub(super) fn strips(mut self, out: &mut Strips<'_>) {
        let largest = match self.samples {
            Samples::U8(_) => Some(u8::MAX.into()),
            Samples::U16(_) => Some(u16::MAX),
            Samples::F32(_) => None,
        };
        let colors = Colors::of(self.color.clone(), self.channels, largest, self.alpha_tells());
        let [width, height] = self.size.map(|side| side as usize);
        let rows = (STRIP / width.max(1)).max(1);
        for first in (0..height).step_by(rows).rev() {
            out(first as u32, &mut colors.texels(&self.samples, first * width));
            let left = first * width * self.channels;
            match &mut self.samples {
                Samples::U8(values) => shorten(values, left),
                Samples::U16(values) => shorten(values, left),
                Samples::F32(values) => shorten(values, left),
            }
        }
    }

    pub(super) fn into_rows(mut self) -> Rows {
        let bytes = match &self.samples {
            Samples::U8(values) => values.len(),
            Samples::U16(values) => 2 * values.len(),
            Samples::F32(values) => 4 * values.len(),
        };
        let (size, ldr, notes) = (self.size, self.is_ldr(), std::mem::take(&mut self.notes));
        let decode = move |out: &mut Strips<'_>| {
            self.strips(out);
            Ok(())
        };
        Rows { size, ldr, taken: None, notes, held: bytes as u64, decode: Box::new(decode) }
    }

    /// Whether it is of whole numbers, of which the largest is white.
    pub(super) fn is_ldr(&self) -> bool {
        !matches!(self.samples, Samples::F32(_)) && self.color.transfer.saturates_at_one()
    }
}

fn shorten<T>(values: &mut Vec<T>, left: usize) {
    values.truncate(left);
    values.shrink_to_fit();
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_tiff_of_floats_is_no_damaged_picture() {
        let path = std::env::temp_dir().join(format!("iprt-rows-{}.tif", std::process::id()));
        let mut encoder = tiff::encoder::TiffEncoder::new(File::create(&path).expect("writes")).expect("starts");
        let values = [1.0, 2.0, 3.0, 4.0, 5.0, 6.0];
        encoder.write_image::<tiff::encoder::colortype::Gray32Float>(3, 2, &values).expect("writes");
        drop(encoder);
        assert_eq!(Rows::size(&path).expect("reads"), None);
        let mut found = vec![0.0; 6];
        let rows = Rows::open(&path, None).expect("reads");
        rows.each(&mut |row, strip| {
            strip.iter().enumerate().for_each(|(i, texel)| found[row as usize * 3 + i] = texel[0]);
        })
        .expect("decodes");
        std::fs::remove_file(&path).expect("was there");
        assert_eq!(found, values);
    }
}
