//! The transfer curve of sRGB (IEC 61966-2-1).

/// Turns an sRGB code (0..1) into a linear value.
pub fn srgb_to_linear(code: f32) -> f32 {
    if code <= 0.04045 { code / 12.92 } else { ((code + 0.055) / 1.055).powf(2.4) }
}

/// Turns a linear value (0..1) into an sRGB code (0..1).
pub fn linear_to_srgb(linear: f32) -> f32 {
    if linear <= 0.003_130_8 { linear * 12.92 } else { 1.055 * linear.powf(1.0 / 2.4) - 0.055 }
}
