//! The regions of a picture that errors are told apart by: where virtual objects are seen, and which real pixels they change.

use rayon::prelude::*;

/// A change of a 5×5 mean's luminance above this share is influence.
const INFLUENCE: f32 = 0.02;

/// Masks, one value a pixel.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Regions {
    /// Less than half of the pixel is real.
    pub virtual_: Vec<bool>,
    /// Real pixels about which the mean radiance changes by more than 2 %.
    pub influenced: Vec<bool>,
}

/// From pictures of the truth with and without the objects, linear radiance, and the share `real_coverage` (M) of each pixel that
/// is real. Means are over the 5×5 pixels about each, those of them that are in the picture; their Rec. 709 luminance counts.
pub fn regions(size: [u32; 2], with: &[[f32; 4]], without: &[[f32; 4]], real_coverage: &[f32]) -> Regions {
    let virtual_: Vec<bool> = real_coverage.iter().map(|m| *m < 0.5).collect();
    let (before, after) = (means(size, without), means(size, with));
    let changed = |(a, b): (&f32, &f32)| (b - a).abs() > INFLUENCE * a;
    let influenced =
        before.iter().zip(&after).map(changed).zip(&virtual_).map(|(changed, hidden)| changed && !hidden).collect();
    Regions { virtual_, influenced }
}

/// Mean luminance of the 5×5 pixels about each.
fn means(size: [u32; 2], texels: &[[f32; 4]]) -> Vec<f32> {
    let [width, height] = size.map(|side| side as usize);
    let mean = |index: usize| {
        let (x, y) = (index % width, index / width);
        let (mut sum, mut count) = (0.0, 0.0);
        for row in y.saturating_sub(2)..(y + 3).min(height) {
            for [r, g, b, _] in &texels[row * width + x.saturating_sub(2)..row * width + (x + 3).min(width)] {
                sum += 0.2126 * r + 0.7152 * g + 0.0722 * b;
                count += 1.0;
            }
        }
        sum / count
    };
    (0..width * height).into_par_iter().map(mean).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_changed_pixel_influences_the_five_by_five_about_it() {
        let size = [9, 8];
        let without = vec![[1.0, 1.0, 1.0, 1.0]; 72];
        let mut with = without.clone();
        let mut coverage = vec![1.0; 72];
        // An object in one pixel, and half a pixel of one that still counts as real.
        (coverage[8 * 9 - 1], coverage[0]) = (0.49, 0.5);
        // 25 · 2.1 % of the mean, at (3, 3).
        with[3 * 9 + 3] = [1.525, 1.525, 1.525, 1.0];
        let found = regions(size, &with, &without, &coverage);
        for (i, (hidden, influenced)) in found.virtual_.iter().zip(&found.influenced).enumerate() {
            let (x, y) = (i % 9, i / 9);
            assert_eq!(*hidden, i == 71, "{x}, {y}");
            assert_eq!(*influenced, (1..=5).contains(&x) && (1..=5).contains(&y), "{x}, {y}");
        }
        with[3 * 9 + 3] = [1.475, 1.475, 1.475, 1.0];
        let found = regions(size, &with, &without, &coverage);
        // 1.9 % in a whole window, but more where the picture's edge cuts it.
        assert!(!found.influenced[3 * 9 + 3] && found.influenced[9 + 2], "{:?}", found.influenced);
    }

    #[test]
    fn an_object_does_not_influence_its_own_pixels() {
        let (dark, bright) = ([[0.1, 0.1, 0.1, 1.0]; 25], [[5.0, 5.0, 5.0, 1.0]; 25]);
        let found = regions([5, 5], &bright, &dark, &[0.0; 25]);
        assert!(found.virtual_.iter().all(|v| *v) && !found.influenced.contains(&true));
    }
}
