//! The pictures of a chart: what is seen, and where it differs from the truth.

use crate::{
    Result,
    image_file::write::{write_display, write_png},
    measure::metrics::{Picture, flip_map},
    panorama::source::PanoramaSource,
};
use glam::Vec3;
use std::path::Path;

/// The FLIP error that is shown white.
pub const WHITE_FLIP: f32 = 0.5;

/// Writes a picture as it is displayed; saturated texels of the panorama that were raised on loading come down again.
///
/// # Errors
/// It cannot be written.
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

/// Writes the FLIP error of each pixel: black is none, then red, then yellow; white is [`WHITE_FLIP`] or more.
///
/// # Errors
/// As [`flip_map`]; it cannot be written.
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
