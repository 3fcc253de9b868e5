//! How light is shown that is brighter than white.

use glam::Vec3;

/// What becomes of radiance, after exposure, before it is encoded as sRGB.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, clap::ValueEnum)]
pub enum Tonemap {
    /// All that is brighter than white is white.
    #[default]
    Clip,
    /// Khronos PBR Neutral: colours of surfaces stay nearly as they are, and highlights are compressed.
    Neutral,
}

/// Values up to this one are not compressed.
const START: f32 = 0.8 - 0.04;
/// How fast compressed colours become white.
const DESATURATION: f32 = 0.15;

impl Tonemap {
    /// The words of a scene file, in the order of the variants.
    pub const NAMES: [&str; 2] = ["clip", "neutral"];
    pub const ALL: [Self; 2] = [Self::Clip, Self::Neutral];

    /// Returns the word of a scene file.
    pub fn name(self) -> &'static str {
        Self::NAMES[self as usize]
    }

    /// Maps linear Rec. 709 to what is shown of it, from 0 to 1. `display.comp` does the same.
    pub fn map(self, color: Vec3) -> Vec3 {
        // NaN becomes 0.
        let color = color.max(Vec3::ZERO);
        if self == Self::Clip {
            return color.min(Vec3::ONE);
        }
        let least = color.min_element();
        let color = color - if least < 0.08 { least - 6.25 * least * least } else { 0.04 };
        let most = color.max_element();
        if most < START {
            return color;
        }
        let room = 1.0 - START;
        let compressed = 1.0 - room * room / (most + room - START);
        let white = 1.0 - 1.0 / (DESATURATION * (most - compressed) + 1.0);
        (color * (compressed / most)).lerp(Vec3::splat(compressed), white)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn neutral_is_smooth_and_stays_under_white() {
        let shown = |x: f32| Tonemap::Neutral.map(Vec3::new(x, 0.5 * x, 0.2 * x));
        let mut last = Vec3::ZERO;
        for i in 1..4000 {
            let color = shown(0.01 * i as f32);
            assert!(color.max_element() < 1.0 && (color - last).max_element() < 0.011, "{color}");
            assert!(color.x >= last.x, "{color}");
            last = color;
        }
        assert!(
            (shown(0.5) - Vec3::new(0.46, 0.21, 0.06)).abs().max_element() < 1e-6,
            "a dielectric's 4 % are taken off"
        );
        assert_eq!(Tonemap::Neutral.map(Vec3::ZERO), Vec3::ZERO);
        assert_eq!(Tonemap::Clip.map(Vec3::new(2.0, 0.5, f32::NAN)), Vec3::new(1.0, 0.5, 0.0));
    }
}
