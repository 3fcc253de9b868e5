//! The few numbers by which the cases are judged.

use super::world::WorldTruth;
use crate::{
    Result,
    image_file::srgb::linear_to_srgb,
    measure::metrics::{Picture, flip_map},
};

/// The value of a picture that holds NaN or infinities.
pub const NOT_FINITE: f64 = 1e9;

/// Linear radiance, RGBA, row 0 on top.
pub type Texels = Vec<[f32; 4]>;

/// Says whether a whole picture is finite.
pub fn is_finite(texels: &[[f32; 4]]) -> bool {
    texels.iter().flatten().all(|value| value.is_finite())
}

/// Returns the mean FLIP over the pixels of a region.
///
/// # Errors
/// Fails if the pictures differ in size.
pub fn flip(size: [u32; 2], test: &[[f32; 4]], truth: &[[f32; 4]], mask: &[bool], exposure: f32) -> Result<f64> {
    if !is_finite(test) {
        return Ok(NOT_FINITE);
    }
    let picture = |subject, texels| Picture { subject, size, texels };
    let map = flip_map(picture("picture", test), picture("truth", truth), exposure)?;
    let inside: Vec<f64> = map.iter().zip(mask).filter(|(_, inside)| **inside).map(|(e, _)| f64::from(*e)).collect();
    Ok(if inside.is_empty() { 0.0 } else { inside.iter().sum::<f64>() / inside.len() as f64 })
}

/// Returns the displayed value, 0 to 1.
pub fn shown(radiance: f32, exposure: f32) -> f32 {
    linear_to_srgb((exposure * radiance).clamp(0.0, 1.0))
}

/// Returns the difference of displayed values, in steps of 8 bits, that a share `quantile` of a region's
/// pixels stays within. Each pixel counts with its worst channel.
pub fn codes(test: &[[f32; 4]], truth: &[[f32; 4]], mask: &[bool], quantile: f64, exposure: f32) -> f64 {
    if !is_finite(test) {
        return NOT_FINITE;
    }
    let difference = |(a, b): (&[f32; 4], &[f32; 4])| {
        (0..3).map(|c| (shown(a[c], exposure) - shown(b[c], exposure)).abs()).fold(0.0, f32::max)
    };
    let mut all: Vec<f32> =
        test.iter().zip(truth).zip(mask).filter(|(_, inside)| **inside).map(|(pair, _)| difference(pair)).collect();
    all.sort_by(f32::total_cmp);
    let last = all.len().saturating_sub(1);
    all.get((quantile * last as f64).round() as usize).map_or(0.0, |d| 255.0 * f64::from(*d))
}

/// Returns |Σ test/Σ truth − 1| of radiance over a region, all channels.
pub fn energy(test: &[[f32; 4]], truth: &[[f32; 4]], mask: &[bool]) -> f64 {
    let (a, b) = (sum(test, mask), sum(truth, mask));
    let error = (a / b - 1.0).abs();
    if error.is_finite() { error } else { NOT_FINITE }
}

/// Returns the sum of radiance over a region, all channels.
pub fn sum(texels: &[[f32; 4]], mask: &[bool]) -> f64 {
    let inside = texels.iter().zip(mask).filter(|(_, inside)| **inside);
    inside.map(|(t, _)| t[..3].iter().map(|v| f64::from(*v)).sum::<f64>()).sum()
}

/// Returns how much of the light that things take or bring is missing or too much: |Σ (test − before)/Σ
/// (truth − before) − 1| over a region.
pub fn change(test: &[[f32; 4]], truth: &WorldTruth, mask: &[bool]) -> f64 {
    let before = sum(&truth.without, mask);
    let error = ((sum(test, mask) - before) / (sum(&truth.texels, mask) - before) - 1.0).abs();
    if error.is_finite() { error } else { NOT_FINITE }
}
