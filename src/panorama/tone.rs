//! Inverse tone mapping of LDR panoramas. Saturated texels stand for light that the camera could not record.

use glam::Vec3;

/// Linear values up to this one stay as they are (sRGB code 203).
pub const KNEE: f32 = 0.6;

/// Raises bright texels so that linear 1 becomes `factor` (≥ 1), and keeps their hue. Let m be the largest
/// channel, k the knee, and x = (m − k)/(1 − k). Above the knee m becomes k + (1 − k)·x/(1 − b·x), which has
/// slope 1 at the knee and is `factor` at x = 1.
pub fn expand(color: Vec3, factor: f32) -> Vec3 {
    let largest = color.max_element();
    if largest <= KNEE || factor <= 1.0 {
        return color;
    }
    let x = ((largest - KNEE) / (1.0 - KNEE)).min(1.0);
    let expanded = KNEE + (1.0 - KNEE) * x / (1.0 - bend(factor) * x);
    color * (expanded / largest)
}

/// Undoes [`expand`] for LDR output.
pub fn compress(color: Vec3, factor: f32) -> Vec3 {
    let largest = color.max_element();
    if largest <= KNEE || factor <= 1.0 {
        return color;
    }
    let y = (largest - KNEE) / (1.0 - KNEE);
    let compressed = KNEE + (1.0 - KNEE) * y / (1.0 + bend(factor) * y);
    color * (compressed / largest)
}

/// b of [`expand`]; 0 if it does nothing.
pub fn bend(factor: f32) -> f32 {
    if factor <= 1.0 { 0.0 } else { 1.0 - (1.0 - KNEE) / (factor - KNEE) }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn white_becomes_the_factor_smoothly_and_back() {
        assert!((expand(Vec3::ONE, 10.0).x - 10.0).abs() < 1e-4);
        assert_eq!(expand(Vec3::splat(0.5), 10.0), Vec3::splat(0.5));
        let slope = (expand(Vec3::splat(KNEE + 1e-3), 10.0).x - KNEE) / 1e-3;
        assert!((slope - 1.0).abs() < 0.01, "{slope}");
        let mut last = 0.0;
        for i in 0..=100 {
            let color = Vec3::new(i as f32 / 100.0, 0.2, 0.1);
            let expanded = expand(color, 7.0);
            assert!(expanded.x >= last);
            last = expanded.x;
            assert!(compress(expanded, 7.0).abs_diff_eq(color, 1e-5));
        }
        assert_eq!(expand(Vec3::ONE, 1.0), Vec3::ONE);
    }
}
