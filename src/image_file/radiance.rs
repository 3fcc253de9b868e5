//! Radiance's HDR files, with what its header may hold: any signature, line ends, exposure, colours, and any
//! order of rows and columns. The `image` crate decodes the scan lines.

use super::{
    color_space::{ColorSpace, Primaries, xyz_to_rec709},
    read::{Raster, Samples, check_size, check_strips, one_line, plain_io},
    rows::{Rows, STRIP, Strips},
};
use crate::{Error, Result, budget};
use glam::{Mat3, Vec3};
use image::{ImageDecoder as _, codecs::hdr::HdrDecoder};
use std::{
    fs::File,
    io::{BufReader, Cursor, Read, Seek as _},
};

/// Radiance's own primaries, with white of equal energy.
const EQUAL_ENERGY: [f64; 2] = [1.0 / 3.0, 1.0 / 3.0];
/// XYZ are photometric: so many lumens are a watt of white light, and 1 of RGB (Radiance's file formats).
const LUMENS_A_WATT: f32 = 179.0;

/// What the header says.
struct Header {
    /// What radiance was multiplied by to give the stored numbers.
    factor: Vec3,
    /// The part of it that stands in the header.
    exposure: Vec3,
    /// Whether the numbers are CIE XYZ.
    xyz: bool,
    to_rec709: Option<Mat3>,
    /// The axis and sign of each dimension, slow one first, with its length.
    axes: [(bool, char, u32); 2],
    /// Where the scan lines begin.
    start: usize,
}

pub(super) fn is_radiance(bytes: &[u8]) -> bool {
    bytes.starts_with(b"#?R")
}

/// What a file says of its pixels.
struct Picture {
    header: Header,
    size: [u32; 2],
    color: ColorSpace,
    notes: Vec<String>,
}

fn damaged(problem: &str, subject: &str) -> Error {
    Error::input(subject, format!("cannot be decoded: {problem}"), "write it again")
}

impl Picture {
    fn of(start: &[u8], subject: &str) -> Result<Self> {
        let header = header(start).map_err(|problem| damaged(problem, subject))?;
        let [(_, slow, rows), (_, fast, columns)] = header.axes;
        if (slow, fast) != ('Y', 'X') && (slow, fast) != ('X', 'Y') {
            return Err(damaged("its resolution has no X and Y", subject));
        }
        check_strips([columns, rows], subject)?;
        let mut notes = Vec::new();
        // Converters write luminance as radiance with its lumens in EXPOSURE, and then nothing changes.
        if header.exposure != Vec3::ONE && (header.factor - Vec3::ONE).abs().max_element() > 1e-3 {
            let [r, g, b] = header.exposure.to_array();
            let factor = if r == g && g == b { format!("{r}") } else { format!("{r}, {g}, {b}") };
            notes.push(format!("its EXPOSURE or COLORCORR of {factor} was divided out"));
        } else if header.xyz && header.exposure == Vec3::ONE {
            notes.push(format!("its XYZ are luminance in cd/m²: {LUMENS_A_WATT} are taken for 1"));
        }
        let size = if slow == 'Y' { [columns, rows] } else { [rows, columns] };
        let color = ColorSpace { to_rec709: header.to_rec709, ..ColorSpace::LINEAR };
        Ok(Self { header, size, color, notes })
    }

    /// Decodes scan lines, some at a time, and hands out their first one and their pixels: stored numbers divided by the
    /// exposure, which gives radiance.
    fn scan(&self, mut lines: impl Read, subject: &str, mut each: impl FnMut(u32, &[Vec3])) -> Result<()> {
        let failed = |error: image::ImageError| damaged(&one_line(&error), subject);
        let [(_, _, rows), (_, _, columns)] = self.header.axes;
        let some = (STRIP as u32 / columns).clamp(1, rows);
        let mut stored = vec![[0_f32; 3]; some as usize * columns as usize];
        for first in (0..rows).step_by(some as usize) {
            let count = some.min(rows - first);
            let plain = format!("#?RADIANCE\nFORMAT=32-bit_rle_rgbe\n\n-Y {count} +X {columns}\n");
            let decoder = HdrDecoder::new(Cursor::new(plain).chain(&mut lines)).map_err(failed)?;
            let stored = &mut stored[..count as usize * columns as usize];
            decoder.read_image(bytemuck::cast_slice_mut(stored)).map_err(failed)?;
            let pixels: Vec<Vec3> = stored.iter().map(|pixel| Vec3::from_array(*pixel) / self.header.factor).collect();
            each(first, &pixels);
        }
        Ok(())
    }

    /// The place of a pixel of a scan line. Rows are counted from the top, so that +Y goes up.
    fn place(&self, line: u32, along: u32) -> [u32; 2] {
        let mut at = [0, 0];
        for ((positive, axis, length), place) in self.header.axes.into_iter().zip([line, along]) {
            let forward = if axis == 'X' { positive } else { !positive };
            at[usize::from(axis == 'Y')] = if forward { place } else { length - 1 - place };
        }
        at
    }
}

/// Decodes a file.
pub(super) fn decode(bytes: &[u8], subject: &str) -> Result<Raster> {
    let picture = Picture::of(bytes, subject)?;
    check_size(picture.size, subject)?;
    let [width, height] = picture.size;
    budget::ask(subject, u64::from(width) * u64::from(height) * (12 + 16))?;
    let columns = picture.header.axes[1].2 as usize;
    let mut values = vec![0.0; width as usize * height as usize * 3];
    picture.scan(&bytes[picture.header.start..], subject, |first, pixels| {
        for (index, color) in pixels.iter().enumerate() {
            let [x, y] = picture.place(first + (index / columns) as u32, (index % columns) as u32);
            let place = (y as usize * width as usize + x as usize) * 3;
            values[place..place + 3].copy_from_slice(&color.to_array());
        }
    })?;
    let Picture { size, color, notes, .. } = picture;
    Ok(Raster { size, channels: 3, samples: Samples::F32(values), lossy: false, color, notes })
}

/// The colours of a file by strips of rows. One whose scan lines are columns is decoded whole.
pub(super) fn rows(mut file: BufReader<File>, subject: String) -> Result<Rows> {
    let failed = |error: std::io::Error| Error::input(&subject, plain_io(&error), "check the file");
    let mut start = Vec::new();
    file.by_ref().take(1 << 20).read_to_end(&mut start).map_err(failed)?;
    let picture = Picture::of(&start, &subject)?;
    file.rewind().map_err(failed)?;
    if picture.header.axes[0].1 == 'X' {
        let mut bytes = Vec::new();
        file.read_to_end(&mut bytes).map_err(failed)?;
        return decode(&bytes, &subject).map(Raster::into_rows);
    }
    let (size, notes) = (picture.size, picture.notes.clone());
    let decode = move |out: &mut Strips<'_>| {
        file.seek_relative(picture.header.start as i64).map_err(|error| damaged(&one_line(&error), &subject))?;
        let width = picture.size[0] as usize;
        picture.scan(file, &subject, |first, pixels| {
            let mut strip = vec![[0.0; 4]; pixels.len()];
            let last = first + (pixels.len() / width) as u32 - 1;
            let top = picture.place(first, 0)[1].min(picture.place(last, 0)[1]);
            for (index, color) in pixels.iter().enumerate() {
                let [x, y] = picture.place(first + (index / width) as u32, (index % width) as u32);
                let color = picture.color.rec709(*color);
                strip[(y - top) as usize * width + x as usize] = color.extend(f32::from(!color.is_nan())).to_array();
            }
            out(top, &mut strip);
        })
    };
    Ok(Rows { size, ldr: false, taken: None, notes, held: 0, decode: Box::new(decode) })
}

fn header(bytes: &[u8]) -> std::result::Result<Header, &'static str> {
    let (mut factor, mut to_rec709, mut xyz) = (Vec3::ONE, None, false);
    let mut at = 0;
    let mut ended = false;
    loop {
        let rest = &bytes[at..];
        let length = rest.iter().take(4096).position(|byte| *byte == b'\n').ok_or("its header has no end")?;
        at += length + 1;
        let line = String::from_utf8_lossy(&rest[..length]);
        let line = line.trim();
        if ended {
            let axes = axes(line).ok_or("its resolution cannot be read")?;
            if xyz {
                to_rec709 = Some(xyz_to_rec709(EQUAL_ENERGY));
            }
            let usable = factor.is_finite() && factor.min_element() > 0.0;
            let exposure = if usable { factor } else { Vec3::ONE };
            let factor = exposure * if xyz { LUMENS_A_WATT } else { 1.0 };
            return Ok(Header { factor, exposure, xyz, to_rec709, axes, start: at });
        }
        ended = line.is_empty();
        let Some((key, value)) = line.split_once('=') else { continue };
        let numbers: Vec<f64> = value.split_whitespace().filter_map(|number| number.parse().ok()).collect();
        match (key.trim(), numbers.as_slice()) {
            // Each of these multiplies what those before it did.
            ("EXPOSURE", [exposure]) => factor *= *exposure as f32,
            ("COLORCORR", [r, g, b]) => factor *= Vec3::new(*r as f32, *g as f32, *b as f32),
            ("PRIMARIES", [rx, ry, gx, gy, bx, by, wx, wy]) => {
                let primaries = Primaries { red: [*rx, *ry], green: [*gx, *gy], blue: [*bx, *by], white: [*wx, *wy] };
                to_rec709 = primaries.to_rec709();
            }
            ("FORMAT", _) => xyz = value.trim().ends_with("xyze"),
            _ => {}
        }
    }
}

fn axes(line: &str) -> Option<[(bool, char, u32); 2]> {
    let words: Vec<&str> = line.split_whitespace().collect();
    let axis = |name: &str, length: &str| {
        let mut letters = name.chars();
        let positive = match letters.next()? {
            '+' => true,
            '-' => false,
            _ => return None,
        };
        Some((positive, letters.next()?, length.parse().ok()?))
    };
    match words[..] {
        [a, n, b, m] => Some([axis(a, n)?, axis(b, m)?]),
        _ => None,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Two columns and three rows, flat scan lines. Red is 1 + the place in the file.
    fn file(header: &str) -> Vec<u8> {
        let mut bytes = header.as_bytes().to_vec();
        for place in 1..=6_u8 {
            bytes.extend([place * 8, 0, 0, 133]); // 8 · 2^(133 − 136) = 1
        }
        bytes
    }

    fn reds(header: &str) -> ([u32; 2], Vec<f32>) {
        let raster = decode(&file(header), "f").unwrap_or_else(|error| panic!("{error}"));
        let Samples::F32(values) = raster.samples else { panic!("floats") };
        (raster.size, values.chunks(3).map(|pixel| pixel[0]).collect())
    }

    #[test]
    fn rows_and_columns_go_where_the_file_says() {
        let plain = ([2, 3], vec![1.0, 2.0, 3.0, 4.0, 5.0, 6.0]);
        assert_eq!(reds("#?RADIANCE\n\n-Y 3 +X 2\n"), plain);
        assert_eq!(reds("#?RGBE\r\nFORMAT=32-bit_rle_rgbe\r\n\r\n-Y 3 +X 2\r\n"), plain);
        assert_eq!(reds("#?RADIANCE\n\n+Y 3 +X 2\n").1, [5.0, 6.0, 3.0, 4.0, 1.0, 2.0]);
        assert_eq!(reds("#?RADIANCE\n\n-Y 3 -X 2\n").1, [2.0, 1.0, 4.0, 3.0, 6.0, 5.0]);
        // Two columns of three.
        assert_eq!(reds("#?RADIANCE\n\n+X 2 -Y 3\n"), ([2, 3], vec![1.0, 4.0, 2.0, 5.0, 3.0, 6.0]));
        assert_eq!(reds("#?RADIANCE\n\n+X 2 +Y 3\n"), ([2, 3], vec![3.0, 6.0, 2.0, 5.0, 1.0, 4.0]));
    }

    /// The first pixel in Rec. 709, and what is said of the file.
    fn first(header: &str, stored: [u8; 4]) -> (Vec3, Vec<String>) {
        let mut bytes = header.as_bytes().to_vec();
        bytes.extend(stored);
        let raster = decode(&bytes, "f").unwrap_or_else(|error| panic!("{error}"));
        let Samples::F32(values) = raster.samples else { panic!("floats") };
        (raster.color.rec709(Vec3::from_slice(&values)), raster.notes)
    }

    /// As `ra_xyze` writes them: white of equal energy is (179, 179, 179), and of Rec. 709's primaries each is
    /// where the CIE has it.
    #[test]
    fn xyz_is_luminance_and_primaries_are_converted() {
        let near = |(color, _): (Vec3, Vec<String>), right: Vec3, what: &str| {
            assert!((color - right).abs().max_element() < 0.012, "{what}: {color}");
        };
        let xyze = |more: &str| format!("#?RADIANCE\n{more}FORMAT=32-bit_rle_xyze\n\n-Y 1 +X 1\n");
        // 179 is 179/256 · 2⁸, and 1 is 128/256 · 2¹.
        let absolute = first(&xyze(""), [179, 179, 179, 136]);
        assert!(absolute.1[0].contains("cd/m²"), "{:?}", absolute.1);
        near(absolute, Vec3::ONE, "white in cd/m²");
        let converted = first(&xyze("EXPOSURE=5.586592e-03\n"), [128, 128, 128, 129]);
        assert!(converted.1.is_empty(), "{:?}", converted.1);
        near(converted, Vec3::ONE, "white as converted");
        let darker = first(&xyze("EXPOSURE=5.586592e-03\nEXPOSURE=0.5\n"), [128, 128, 128, 129]);
        assert!(darker.1[0].contains("divided out"), "{:?}", darker.1);
        near(darker, Vec3::splat(2.0), "white that was made darker");

        let rgbe = |primaries: &str| format!("#?RADIANCE\nPRIMARIES={primaries}\n\n-Y 1 +X 1\n");
        // Rec. 709's own change nothing. Of Rec. 2020's green Rec. 709 has 1.13, and less than none of the others.
        near(
            first(&rgbe("0.64 0.33 0.30 0.60 0.15 0.06 0.3127 0.3290"), [32, 64, 128, 129]),
            Vec3::new(0.25, 0.5, 1.0),
            "Rec. 709",
        );
        near(
            first(&rgbe("0.708 0.292 0.170 0.797 0.131 0.046 0.3127 0.3290"), [0, 128, 0, 129]),
            Vec3::new(0.0, 1.133, 0.0),
            "Rec. 2020",
        );
        near(
            first(&rgbe("0.64 0.33 0.29 0.60 0.15 0.06 0.3333 0.3333"), [128, 128, 128, 129]),
            Vec3::ONE,
            "white is white",
        );
    }

    #[test]
    fn exposures_are_divided_out() {
        let (_, values) = reds("#?RADIANCE\nEXPOSURE=4\nEXPOSURE= 0.5\nCOLORCORR=2 1 1\n\n-Y 3 +X 2\n");
        assert_eq!(values[3], 1.0);
        assert_eq!(reds("#?RADIANCE\nEXPOSURE=0\n\n-Y 3 +X 2\n").1[0], 1.0);
        for bad in [
            "#?RADIANCE",
            "#?RADIANCE\n\n",
            "#?RADIANCE\n\n-Y 3\n",
            "#?RADIANCE\n\n-Y 3 +Y 2\n",
            "#?RADIANCE\n\n-Y 0 +X 2\n",
        ] {
            assert!(decode(&file(bad), "f").is_err(), "{bad}");
        }
    }
}
