//! Radiance's HDR files, with what its header may hold: any signature, line ends, exposure, colours, and any
//! order of rows and columns. The `image` crate decodes the scan lines.

use super::{
    color_space::{ColorSpace, Primaries, xyz_to_rec709},
    read::{Raster, Samples, check_size, one_line},
};
use crate::{Error, Result, budget};
use glam::{Mat3, Vec3};
use image::{DynamicImage, codecs::hdr::HdrDecoder};
use std::io::{Cursor, Read as _};

/// Radiance's own primaries, with white of equal energy.
const EQUAL_ENERGY: [f64; 2] = [1.0 / 3.0, 1.0 / 3.0];

/// What the header says.
struct Header {
    /// What stored numbers were multiplied by.
    factor: Vec3,
    to_rec709: Option<Mat3>,
    /// The axis and sign of each dimension, slow one first, with its length.
    axes: [(bool, char, u32); 2],
    /// Where the scan lines begin.
    start: usize,
}

pub(super) fn is_radiance(bytes: &[u8]) -> bool {
    bytes.starts_with(b"#?R")
}

/// Decodes a file. Its numbers are divided by the exposure, which gives radiance.
pub(super) fn decode(bytes: &[u8], subject: &str) -> Result<Raster> {
    let damaged = |problem: String| Error::input(subject, format!("cannot be decoded: {problem}"), "write it again");
    let header = header(bytes).map_err(|problem| damaged(problem.into()))?;
    let [(_, slow, rows), (_, fast, columns)] = header.axes;
    if (slow, fast) != ('Y', 'X') && (slow, fast) != ('X', 'Y') {
        return Err(damaged("its resolution has no X and Y".into()));
    }
    check_size([columns, rows], subject)?;
    budget::ask(subject, u64::from(columns) * u64::from(rows) * (12 + 12 + 16))?;
    let plain = format!("#?RADIANCE\nFORMAT=32-bit_rle_rgbe\n\n-Y {rows} +X {columns}\n");
    let reader = Cursor::new(plain.as_bytes()).chain(Cursor::new(&bytes[header.start..]));
    let decoder = HdrDecoder::new(std::io::BufReader::new(reader)).map_err(|error| damaged(one_line(&error)))?;
    let stored =
        DynamicImage::from_decoder(decoder).map_err(|error| damaged(one_line(&error)))?.into_rgb32f().into_raw();

    let size = if slow == 'Y' { [columns, rows] } else { [rows, columns] };
    let mut values = vec![0.0; stored.len()];
    for (index, pixel) in stored.as_chunks::<3>().0.iter().enumerate() {
        let along = [(index as u32) / columns, (index as u32) % columns];
        let mut at = [0, 0];
        for ((positive, axis, length), place) in header.axes.into_iter().zip(along) {
            // Rows are counted from the top, so that +Y goes up.
            let forward = if axis == 'X' { positive } else { !positive };
            at[usize::from(axis == 'Y')] = if forward { place } else { length - 1 - place };
        }
        let color = Vec3::from_array(*pixel) / header.factor;
        let place = (at[1] as usize * size[0] as usize + at[0] as usize) * 3;
        values[place..place + 3].copy_from_slice(&color.to_array());
    }
    let mut notes = Vec::new();
    if header.factor != Vec3::ONE {
        let [r, g, b] = header.factor.to_array();
        let factor = if r == g && g == b { format!("{r}") } else { format!("{r}, {g}, {b}") };
        notes.push(format!("its EXPOSURE or COLORCORR of {factor} was divided out"));
    }
    let color = ColorSpace { to_rec709: header.to_rec709, ..ColorSpace::LINEAR };
    Ok(Raster { size, channels: 3, samples: Samples::F32(values), lossy: false, color, notes })
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
            return Ok(Header { factor: if usable { factor } else { Vec3::ONE }, to_rec709, axes, start: at });
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
