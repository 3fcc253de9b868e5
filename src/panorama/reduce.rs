//! Makes panoramas smaller than their files, for devices and machines that cannot hold them or are not to wait for them.

use crate::image_file::{CodeImage, ColorImage};
use glam::Vec4;
use rayon::prelude::*;
use std::sync::atomic::{AtomicU32, Ordering};

/// The most texels around that the user wants; 0 if nothing was said.
static WIDTH: AtomicU32 = AtomicU32::new(0);

/// Sets how many texels a panorama has around at most.
pub fn set(width: u32) {
    WIDTH.store(width, Ordering::Relaxed);
}

/// Reads `--panorama-size`.
///
/// # Errors
/// Fails with what can be given.
pub fn parse(text: &str) -> Result<u32, String> {
    text.parse()
        .ok()
        .filter(|width| (8..=32768).contains(width))
        .ok_or_else(|| "give a width from 8 to 32768".to_owned())
}

/// The size that an image of this size gets, if it is too large.
fn reduced([width, height]: [u32; 2]) -> Option<[u32; 2]> {
    let most = WIDTH.load(Ordering::Relaxed);
    let rows = (u64::from(height) * u64::from(most)).div_ceil(u64::from(width.max(1)));
    (most > 0 && width > most).then_some([most, rows.max(1) as u32])
}

/// Returns a smaller picture, in which each texel is the mean of what it covers. One of which nothing is known stays so.
pub(super) fn color(image: ColorImage) -> ColorImage {
    match reduced(image.size) {
        Some(size) => ColorImage { texels: means(&image.texels, image.size, size), size, ..image },
        None => image,
    }
}

/// Returns a picture of another size, in which each texel is the mean of what it covers.
pub fn means(texels: &[[f32; 4]], from: [u32; 2], to: [u32; 2]) -> Vec<[f32; 4]> {
    // What a texel covers along an axis, with the share of the first and the last.
    let span = |at: u32, axis: usize| {
        let step = f64::from(from[axis]) / f64::from(to[axis]);
        let (low, high) = (f64::from(at) * step, f64::from(at + 1) * step);
        let end = (high.ceil() as u32).min(from[axis]);
        (low as u32..end).map(move |i| (i, (high.min(f64::from(i + 1)) - low.max(f64::from(i))) as f32))
    };
    let mean = |index: usize| {
        let (column, row) = (index as u32 % to[0], index as u32 / to[0]);
        let (mut sum, mut all) = (Vec4::ZERO, 0.0);
        for (y, tall) in span(row, 1) {
            for (x, wide) in span(column, 0) {
                let texel = Vec4::from(texels[y as usize * from[0] as usize + x as usize]);
                let known = if texel.w > 0.0 { tall * wide } else { 0.0 };
                all += tall * wide;
                sum += known * texel.truncate().extend(1.0);
            }
        }
        if sum.w > 0.5 * all { (sum / sum.w).to_array() } else { [0.0; 4] }
    };
    (0..to[0] as usize * to[1] as usize).into_par_iter().map(mean).collect()
}

/// Returns smaller codes. Those in the middle are taken, as a mean over an edge is nowhere.
pub(super) fn codes(image: CodeImage) -> CodeImage {
    let Some(to) = reduced(image.size) else { return image };
    let middle = |at: u32, axis: usize| (2 * at as usize + 1) * image.size[axis] as usize / (2 * to[axis] as usize);
    let rows = (0..to[1]).map(|row| middle(row, 1) * image.size[0] as usize);
    let codes =
        rows.flat_map(|row| (0..to[0]).map(move |column| row + middle(column, 0))).map(|i| image.codes[i]).collect();
    CodeImage { codes, size: to, ..image }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn texels_are_means_of_what_they_cover() {
        let row: Vec<[f32; 4]> = (0..6).map(|i| [i as f32, 1.0, 0.0, 1.0]).collect();
        assert_eq!(means(&row, [6, 1], [3, 1]).iter().map(|t| t[0]).collect::<Vec<_>>(), [0.5, 2.5, 4.5]);
        let parted: Vec<f32> = means(&row, [6, 1], [4, 1]).iter().map(|t| t[0]).collect();
        let right = [1.0 / 3.0, (0.5 + 2.0) / 1.5, (3.0 + 2.0) / 1.5, (2.0 + 5.0) / 1.5];
        assert!(parted.iter().zip(right).all(|(a, b)| (a - b).abs() < 1e-6), "{parted:?}");
        let holes = [[9.0, 9.0, 9.0, 0.0], [2.0, 2.0, 2.0, 1.0], [9.0, 9.0, 9.0, 0.0], [9.0, 9.0, 9.0, 0.0]];
        assert_eq!(means(&holes, [4, 1], [1, 1]), [[0.0; 4]]);
        assert_eq!(means(&[holes[1], holes[1], holes[0]], [3, 1], [1, 1]), [[2.0, 2.0, 2.0, 1.0]]);
    }
}
