//! The picture files of a chart: what a method shows, and where it differs from the truth.

use crate::{
    Error, Result,
    image_file::{
        read::read,
        write::{display_code, write_display, write_png},
    },
    measure::metrics::{Picture, flip_map},
    panorama::source::PanoramaSource,
};
use glam::Vec3;
use std::path::Path;

/// The folder of a chart's pictures, inside the chart's own folder.
pub const PICTURES: &str = "pictures";

/// The FLIP error that is shown white.
pub const WHITE_FLIP: f32 = 0.5;

/// Writes a picture as it is displayed. Saturated texels of the panorama, which were raised when it was
/// loaded, are lowered again.
///
/// # Errors
/// Fails if the file cannot be written.
pub fn write_picture(
    path: &Path,
    panorama: &PanoramaSource,
    size: [u32; 2],
    texels: &[[f32; 4]],
    exposure: f32,
) -> Result<()> {
    let shown: Vec<[f32; 4]> = texels
        .iter()
        .map(|[r, g, b, a]| {
            let [r, g, b] = panorama.for_display(Vec3::new(*r, *g, *b)).to_array();
            [r, g, b, *a]
        })
        .collect();
    write_display(path, size, &shown, exposure)
}

/// Writes the FLIP error of each pixel. No error is black, then follow red and yellow, and [`WHITE_FLIP`] or
/// more is white.
///
/// # Errors
/// Fails like [`flip_map`], or if the file cannot be written.
pub fn write_difference(path: &Path, test: Picture, truth: Picture, exposure: f32) -> Result<()> {
    let codes: Vec<u8> = flip_map(test, truth, exposure)?.iter().flat_map(|error| heat(*error)).collect();
    write_png(path, test.size, &codes, 3)
}

fn heat(error: f32) -> [u8; 3] {
    let t = 3.0 * (error / WHITE_FLIP).clamp(0.0, 1.0);
    [0.0, 1.0, 2.0].map(|start| ((t - start).clamp(0.0, 1.0) * 255.0 + 0.5) as u8)
}

/// Stretches a picture bilinearly.
pub fn stretch(texels: &[[f32; 4]], from: [u32; 2], to: [u32; 2]) -> Vec<[f32; 4]> {
    if from == to {
        return texels.to_vec();
    }
    let place = |index: u32, axis: usize| {
        let at = (index as f32 + 0.5) * from[axis] as f32 / to[axis] as f32 - 0.5;
        let at = at.clamp(0.0, (from[axis] - 1) as f32);
        let low = at as u32;
        (low, (low + 1).min(from[axis] - 1), at - low as f32)
    };
    let mut out = Vec::with_capacity(to[0] as usize * to[1] as usize);
    for y in 0..to[1] {
        let (top, bottom, v) = place(y, 1);
        for x in 0..to[0] {
            let (left, right, u) = place(x, 0);
            let at = |x: u32, y: u32, c: usize| texels[(y * from[0] + x) as usize][c];
            out.push(std::array::from_fn(|c| {
                let row = |y: u32| at(left, y, c) + u * (at(right, y, c) - at(left, y, c));
                row(top) + v * (row(bottom) - row(top))
            }));
        }
    }
    out
}

/// Greatest width of a strip of pictures, pixels. A wider strip is halved until it fits.
const WIDEST: u32 = 800;

/// Width, height and 8-bit RGB, row 0 on top.
pub type Codes = ([u32; 2], Vec<u8>);

/// Puts files of a chart's folder together in rows of equal length, as 8-bit RGB.
///
/// # Errors
/// Fails if a file cannot be read, or if it has another size than the first.
pub fn strip(folder: &Path, rows: &[Vec<&str>]) -> Result<Codes> {
    let mut images = Vec::new();
    for file in rows.iter().flatten() {
        let path = folder.join(file);
        let subject = path.display().to_string();
        images.push((subject.clone(), read(&path)?.into_color(&subject)?));
    }
    let Some(size) = images.first().map(|(_, image)| image.size) else { return Ok(([0, 0], Vec::new())) };
    if let Some((subject, _)) = images.iter().find(|(_, image)| image.size != size) {
        return Err(Error::input(subject, "has another size than the others", "delete the folder and chart anew"));
    }
    let columns = rows.iter().map(Vec::len).max().unwrap_or(0) as u32;
    let whole = [size[0] * columns, size[1] * rows.len() as u32];
    let mut texels = vec![[1.0; 4]; whole[0] as usize * whole[1] as usize];
    let places = rows.iter().enumerate().flat_map(|(y, row)| (0..row.len()).map(move |x| [x, y]));
    for ((_, image), [x, y]) in images.iter().zip(places) {
        for (line, source) in image.texels.chunks_exact(size[0] as usize).enumerate() {
            let start = (y * size[1] as usize + line) * whole[0] as usize + x * size[0] as usize;
            texels[start..start + source.len()].copy_from_slice(source);
        }
    }
    let (mut size, mut texels) = (whole, texels);
    while size[0] > WIDEST {
        let half = size.map(|side| (side / 2).max(1));
        texels = stretch(&texels, size, half);
        size = half;
    }
    let codes = texels.iter().flat_map(|[r, g, b, _]| [*r, *g, *b].map(display_code)).collect();
    Ok((size, codes))
}

/// Turns a name into one that every file system accepts.
pub fn file_name(name: &str) -> String {
    let plain = |c: char| if c.is_ascii_alphanumeric() || c == '.' { c } else { '_' };
    let mut out: String = name.chars().map(plain).collect();
    while out.contains("__") {
        out = out.replace("__", "_");
    }
    out
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn stretching_keeps_a_ramp() {
        let ramp: Vec<[f32; 4]> = (0..8).map(|i| [(i % 4) as f32, (i / 4) as f32, 0.0, 1.0]).collect();
        let twice = stretch(&ramp, [4, 2], [8, 4]);
        assert_eq!(twice[8 + 3], [1.25, 0.25, 0.0, 1.0]);
        assert_eq!(stretch(&ramp, [4, 2], [4, 2]), ramp);
    }

    #[test]
    fn heat_runs_from_black_to_white() {
        assert_eq!(heat(0.0), [0, 0, 0]);
        assert_eq!(heat(WHITE_FLIP / 3.0), [255, 0, 0]);
        assert_eq!(heat(9.0), [255, 255, 255]);
    }
}
