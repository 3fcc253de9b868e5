//! Makes panoramas smaller than their files, for devices and machines that cannot hold them or are not to wait for them.

use super::texels::Texels;
use crate::image_file::CodeImage;
use glam::{Vec3, Vec4};
use rayon::prelude::*;
use std::{
    collections::HashMap,
    sync::atomic::{AtomicU32, Ordering},
};

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
pub(super) fn reduced([width, height]: [u32; 2]) -> Option<[u32; 2]> {
    let most = WIDTH.load(Ordering::Relaxed);
    let rows = (u64::from(height) * u64::from(most)).div_ceil(u64::from(width.max(1)));
    (most > 0 && width > most).then_some([most, rows.max(1) as u32])
}

/// Returns a picture of another size, in which each texel is the mean of what it covers.
pub fn means(texels: &[[f32; 4]], from: [u32; 2], to: [u32; 2]) -> Texels {
    let mut means = Means::new(from, to);
    means.add(0, texels);
    means.end(f32::MAX)
}

/// A picture of another size, in which each texel is the mean of what it covers. It is made of rows, as they come.
pub(super) struct Means {
    from: [u32; 2],
    to: [u32; 2],
    /// Weighted colours, and the weights of what is known.
    sums: Vec<Vec4>,
    /// The weights of infinite values.
    infinite: HashMap<usize, Vec3>,
}

impl Means {
    pub fn new(from: [u32; 2], to: [u32; 2]) -> Self {
        Self { from, to, sums: vec![Vec4::ZERO; to[0] as usize * to[1] as usize], infinite: HashMap::new() }
    }

    /// What a texel covers along an axis, with the share of the first and the last.
    fn span(&self, at: u32, axis: usize) -> impl Iterator<Item = (u32, f32)> + use<> {
        let step = f64::from(self.from[axis]) / f64::from(self.to[axis]);
        let (low, high) = (f64::from(at) * step, f64::from(at + 1) * step);
        let end = (high.ceil() as u32).min(self.from[axis]);
        (low as u32..end).map(move |i| (i, (high.min(f64::from(i + 1)) - low.max(f64::from(i))) as f32))
    }

    /// Adds rows from number `first` on.
    pub fn add(&mut self, first: u32, texels: &[[f32; 4]]) {
        let (wide, columns) = (self.from[0] as usize, self.to[0] as usize);
        let end = first + (texels.len() / wide) as u32;
        let mut sums = std::mem::take(&mut self.sums);
        let row = |(row, sums): (usize, &mut [Vec4])| {
            let mut infinite = Vec::new();
            for (y, tall) in self.span(row as u32, 1).filter(|(y, _)| (first..end).contains(y)) {
                let line = &texels[(y - first) as usize * wide..][..wide];
                for (column, sum) in sums.iter_mut().enumerate() {
                    for (x, across) in self.span(column as u32, 0) {
                        let texel = Vec4::from(line[x as usize]);
                        if texel.w <= 0.0 {
                            continue;
                        }
                        let (known, color) = (tall * across, texel.truncate());
                        if color.is_finite() {
                            *sum += known * color.extend(1.0);
                        } else {
                            let weights = color.to_array().map(|value| if value.is_finite() { 0.0 } else { known });
                            infinite.push((row * columns + column, Vec3::from(weights)));
                            let finite = color.to_array().map(|value| if value.is_finite() { value } else { 0.0 });
                            *sum += known * Vec3::from(finite).extend(1.0);
                        }
                    }
                }
            }
            infinite
        };
        let infinite: Vec<_> = sums.par_chunks_mut(columns).enumerate().flat_map_iter(row).collect();
        self.sums = sums;
        for (index, weights) in infinite {
            *self.infinite.entry(index).or_default() += weights;
        }
    }

    /// Returns the means, with this for what is infinite. What is mostly unknown stays so.
    pub fn end(self, brightest: f32) -> Texels {
        let [step_x, step_y] = [0, 1].map(|axis| self.from[axis] as f32 / self.to[axis] as f32);
        let mean = |(index, sum): (usize, Vec4)| {
            let infinite = self.infinite.get(&index).copied().unwrap_or_default();
            let color = (sum.truncate() + infinite * brightest) / sum.w;
            if sum.w > 0.5 * step_x * step_y { color.extend(1.0).to_array() } else { [0.0; 4] }
        };
        self.sums.iter().copied().enumerate().map(mean).collect()
    }
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
        assert_eq!(means(&holes, [4, 1], [1, 1]).to_vec(), [[0.0; 4]]);
        assert_eq!(means(&[holes[1], holes[1], holes[0]], [3, 1], [1, 1]).to_vec(), [[2.0, 2.0, 2.0, 1.0]]);
        let unknown = [f32::NAN, 1.0, 1.0, 0.0];
        assert_eq!(means(&[holes[1], holes[1], unknown], [3, 1], [1, 1]).to_vec(), [[2.0, 2.0, 2.0, 1.0]]);
    }

    #[test]
    fn rows_come_in_any_order_and_what_is_infinite_is_as_bright_as_is_said() {
        let texels: Vec<[f32; 4]> = (0..12 * 9).map(|i| [i as f32, 1.0, (i % 5) as f32, 1.0]).collect();
        let whole = means(&texels, [12, 9], [5, 4]);
        let mut parts = Means::new([12, 9], [5, 4]);
        [(6, 9), (0, 2), (2, 6)].into_iter().for_each(|(a, b)| parts.add(a, &texels[a as usize * 12..b * 12]));
        let parts = parts.end(0.0);
        assert!(whole.iter().zip(parts.iter()).all(|(a, b)| Vec4::from(a).abs_diff_eq(Vec4::from(b), 1e-4)));
        let mut sun = Means::new([4, 1], [2, 1]);
        sun.add(0, &[[f32::INFINITY, 1.0, 2.0, 1.0], [4.0, 3.0, 2.0, 1.0], [1.0; 4], [1.0; 4]]);
        assert_eq!(sun.end(100.0).to_vec(), [[52.0, 2.0, 2.0, 1.0], [1.0; 4]]);
    }
}
