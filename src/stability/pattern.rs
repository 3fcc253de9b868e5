//! What is painted on a box's faces. It looks the same turned and mirrored, so that it does not
//! matter how a face's coordinates run.

use crate::{
    image_file::srgb::linear_to_srgb,
    scene::material::{TexelEncoding, Texture, Wrap},
};
use glam::{Vec2, vec2};

/// A pattern. Coordinates run over a face from 0 to 1.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Pattern {
    Plain,
    /// This many squares along each side, an odd number; every other is dark.
    Checker(u32),
}

/// The albedo of dark squares, as a share of that of the others.
const DARK: f32 = 0.1;

impl Pattern {
    /// Returns what albedo is multiplied by.
    pub fn albedo(self, uv: Vec2) -> f32 {
        let Self::Checker(squares) = self else { return 1.0 };
        let cell = (uv * squares as f32).floor();
        if (cell.x + cell.y).rem_euclid(2.0) == 0.0 { 1.0 } else { DARK }
    }

    /// Makes the texture: the same in its texels' centres.
    pub fn texture(self) -> Option<Texture> {
        let Self::Checker(squares) = self else { return None };
        let side = 8 * squares;
        let texel = |i: u32| {
            let uv = (vec2((i % side) as f32, (i / side) as f32) + 0.5) / side as f32;
            let code = (255.0 * linear_to_srgb(self.albedo(uv))).round() as u8;
            [code, code, code, 255]
        };
        Some(Texture {
            name: "pattern".into(),
            size: [side; 2],
            texels: (0..side * side).map(texel).collect(),
            encoding: TexelEncoding::Srgb,
            wrap: [Wrap::ClampToEdge; 2],
            nearest: false,
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn turned_and_mirrored_they_are_the_same() {
        let texture = Pattern::Checker(9).texture().expect("a pattern");
        let side = texture.size[0] as usize;
        for (i, texel) in texture.texels.iter().enumerate() {
            let (x, y) = (i % side, i / side);
            assert_eq!(*texel, texture.texels[x * side + y]);
            assert_eq!(*texel, texture.texels[y * side + side - 1 - x]);
        }
    }
}
