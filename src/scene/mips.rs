//! Mip levels of textures.

use super::material::{TexelEncoding, Texture};
use crate::image_file::srgb::{linear_to_srgb, srgb_to_linear};
use glam::Vec4;

/// Returns how many levels a texture of this size has down to 1×1.
pub fn level_count(size: [u32; 2]) -> u32 {
    size[0].max(size[1]).max(1).ilog2() + 1
}

/// Returns the size of a level.
pub fn level_size(size: [u32; 2], level: u32) -> [u32; 2] {
    size.map(|s| (s >> level).max(1))
}

/// Returns all levels from `first_level` on, one after another, R in the low byte. Each level is the
/// box-filtered one above. sRGB colours are averaged in linear space. Normals are averaged and made unit
/// again.
///
/// If alpha is a `mask` that cuts at a value, that of all levels but the finest is the share of texels that are there.
/// The mean of alpha, cut there again, would make leaves vanish or grow with the distance.
pub fn with_mips(texture: &Texture, first_level: u32, mask: Option<f32>) -> Vec<u32> {
    let decode_table: Vec<f32> = (0..256).map(|code| srgb_to_linear(code as f32 / 255.0)).collect();
    let decode = |texel: [u8; 4]| {
        let plain = Vec4::from_array(texel.map(f32::from)) / 255.0;
        match texture.encoding {
            TexelEncoding::Srgb => {
                let [r, g, b, _] = texel.map(|code| decode_table[usize::from(code)]);
                Vec4::new(r, g, b, plain.w)
            }
            TexelEncoding::Linear => plain,
            TexelEncoding::Normal => plain * 2.0 - 1.0,
        }
    };
    let encode = |value: Vec4| {
        let plain = match texture.encoding {
            TexelEncoding::Srgb => value.truncate().map(linear_to_srgb).extend(value.w),
            TexelEncoding::Linear => value,
            TexelEncoding::Normal => 0.5 * value + 0.5,
        };
        plain.to_array().map(|c| (c * 255.0).round().clamp(0.0, 255.0) as u8)
    };
    let mut texels: Vec<u32> = Vec::new();
    let mut keep = |level: u32, row: &mut dyn Iterator<Item = [u8; 4]>| {
        if level >= first_level {
            texels.extend(row.map(u32::from_le_bytes));
        }
    };
    keep(0, &mut texture.texels.iter().copied());
    let mut above: Vec<Vec4> = texture.texels.iter().map(|texel| decode(*texel)).collect();
    if let Some(cutoff) = mask {
        above.iter_mut().for_each(|value| value.w = f32::from(u8::from(value.w >= cutoff)));
    }
    for level in 1..level_count(texture.size) {
        above = halve(&above, level_size(texture.size, level - 1), level_size(texture.size, level));
        if texture.encoding == TexelEncoding::Normal {
            for value in &mut above {
                *value = value.truncate().try_normalize().unwrap_or(glam::Vec3::Z).extend(value.w);
            }
        }
        keep(level, &mut above.iter().map(|value| encode(*value)));
    }
    texels
}

/// Box-filters to `to` from `from`: each new texel is the mean over its exact footprint, even if sizes are
/// odd.
fn halve(texels: &[Vec4], from: [u32; 2], to: [u32; 2]) -> Vec<Vec4> {
    let columns: Vec<_> = (0..to[0]).map(|x| footprint(x, from[0], to[0])).collect();
    let mut out = Vec::with_capacity((to[0] * to[1]) as usize);
    for y in 0..to[1] {
        let rows = footprint(y, from[1], to[1]);
        for column in &columns {
            let mut sum = Vec4::ZERO;
            for &(row, row_weight) in &rows {
                for &(x, weight) in column {
                    sum += texels[(row * from[0] + x) as usize] * (row_weight * weight);
                }
            }
            out.push(sum);
        }
    }
    out
}

/// Returns the texels under new texel `index`, with weights that sum to 1.
fn footprint(index: u32, from: u32, to: u32) -> Vec<(u32, f32)> {
    let scale = from as f32 / to as f32;
    let (start, end) = (index as f32 * scale, (index + 1) as f32 * scale);
    let mut weights = Vec::new();
    for texel in start as u32..from {
        let overlap = end.min(texel as f32 + 1.0) - start.max(texel as f32);
        if overlap <= 1e-4 {
            break;
        }
        weights.push((texel, overlap / scale));
    }
    weights
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::scene::material::Wrap;

    fn texture(size: [u32; 2], encoding: TexelEncoding, texel: impl Fn(u32, u32) -> [u8; 4]) -> Texture {
        let texels = (0..size[1]).flat_map(|y| (0..size[0]).map(move |x| (x, y))).map(|(x, y)| texel(x, y)).collect();
        Texture { name: "t".into(), size, texels, encoding, wrap: [Wrap::Repeat; 2], nearest: false }
    }

    #[test]
    fn a_uniform_texture_stays_uniform_at_odd_sizes() {
        for encoding in [TexelEncoding::Srgb, TexelEncoding::Linear] {
            let all = with_mips(&texture([7, 3], encoding, |_, _| [10, 128, 250, 255]), 0, None);
            assert_eq!(all.len(), 7 * 3 + 3 + 1, "levels are 7×3, 3×1, 1×1");
            assert!(all.iter().all(|t| t.to_le_bytes() == [10, 128, 250, 255]));
        }
    }

    #[test]
    fn colours_are_averaged_in_linear_space() {
        let checker = |x: u32, y: u32| if (x + y).is_multiple_of(2) { [255; 4] } else { [0, 0, 0, 255] };
        let srgb = with_mips(&texture([2, 2], TexelEncoding::Srgb, checker), 0, None);
        assert_eq!(srgb[4].to_le_bytes(), [188, 188, 188, 255]);
        let linear = with_mips(&texture([2, 2], TexelEncoding::Linear, checker), 0, None);
        assert_eq!(linear[4].to_le_bytes(), [128, 128, 128, 255]);
    }

    #[test]
    fn the_mean_is_kept_at_odd_sizes() {
        let ramp = texture([5, 1], TexelEncoding::Linear, |x, _| [(x * 50) as u8; 4]);
        let all = with_mips(&ramp, 0, None);
        assert_eq!(all.len(), 5 + 2 + 1);
        assert_eq!(all[7].to_le_bytes()[0], 100);
        assert_eq!(with_mips(&ramp, 1, None), all[5..], "levels left out change nothing else");
    }

    #[test]
    fn masks_keep_their_coverage() {
        // Alpha from 0 to 240: three of sixteen texels are above 0.75. The mean is below it everywhere.
        let ramp = texture([16, 1], TexelEncoding::Srgb, |x, _| [90, 90, 90, (x * 16) as u8]);
        let alpha = |mask| with_mips(&ramp, 0, mask).iter().map(|t| t.to_le_bytes()[3]).collect::<Vec<_>>();
        let masked = alpha(Some(0.75));
        assert_eq!(masked[..16], alpha(None)[..16], "the finest level has the outline");
        assert_eq!(masked[16..24], [0, 0, 0, 0, 0, 0, 255, 255]);
        assert_eq!(masked[24..28], [0, 0, 0, 255]);
        assert_eq!(masked[30], 64, "a quarter is there");
        let odd =
            with_mips(&texture([5, 3], TexelEncoding::Linear, |x, y| [0, 0, 0, 255 * u8::from(x == y)]), 0, Some(0.5));
        assert_eq!(odd.last().map(|t| t.to_le_bytes()[3]), Some(51), "3 of 15");
    }

    #[test]
    fn normals_stay_unit() {
        let tilted =
            texture(
                [2, 1],
                TexelEncoding::Normal,
                |x, _| if x == 0 { [255, 128, 128, 255] } else { [128, 128, 255, 255] },
            );
        let [x, y, z, _] = with_mips(&tilted, 0, None)[2].to_le_bytes().map(|c| f32::from(c) / 127.5 - 1.0);
        assert!((x * x + y * y + z * z - 1.0).abs() < 0.02 && (x - z).abs() < 0.01 && y.abs() < 0.01);
    }
}
