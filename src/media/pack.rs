//! Turns pictures into the codes of a video. Pixels that are the source's own keep the source's codes.

use super::{
    format::{Format, Kind, Matrix, Tags},
    planes::{Part, Planes},
};
use crate::image_file::{color_space::Transfer, srgb::linear_to_srgb};
use glam::Vec3;
use rayon::prelude::*;

/// A change of less than this much of a code is none.
const SAME: f32 = 0.3;
/// Neither is one of less than this share of the pixel's brightest channel. The dark channels of saturated colours come
/// out of differences of bright ones, which large panoramas keep as 16-bit floats.
const SHARE: f32 = 1e-3;

/// How pictures become codes.
#[derive(Clone, Debug)]
pub struct Packer {
    pub size: [u32; 2],
    pub format: Format,
    pub tags: Tags,
}

/// R'G'B' of a picture, codes from 0 to 1.
pub type Shown = Vec<[f32; 3]>;

impl Tags {
    /// Returns the codes, 0..1, that show linear Rec. 709 light. 1 is white.
    pub fn shown(&self, light: Vec3) -> [f32; 3] {
        let light = match self.space.to_rec709 {
            Some(matrix) => matrix.inverse() * light,
            None => light,
        };
        light.to_array().map(|value| code(&self.space.transfer, if value > 0.0 { value } else { 0.0 }))
    }
}

/// Undoes [`Transfer::linear`].
fn code(transfer: &Transfer, linear: f32) -> f32 {
    match transfer {
        Transfer::Linear => linear.min(1.0),
        Transfer::Gamma(power) => linear.min(1.0).powf(1.0 / power),
        Transfer::Pq => {
            let power = (linear * (203.0 / 10000.0)).min(1.0).powf(0.159_301_76);
            ((0.835_937_5 + 18.851_563 * power) / (1.0 + 18.6875 * power)).powf(78.84375)
        }
        Transfer::Hlg => {
            // The reference white of 0.75 is 1.
            const WHITE: f32 = 0.264_962_56;
            let light = (linear * WHITE).min(1.0);
            if light <= 1.0 / 12.0 {
                (3.0 * light).sqrt()
            } else {
                0.178_832_77 * (12.0 * light - 0.284_668_92).ln() + 0.559_910_7
            }
        }
        // The range of a video is its planes' matter.
        Transfer::Narrow { curve, .. } => code(curve, linear),
        Transfer::Srgb | Transfer::Bt709 | Transfer::Table(_) => linear_to_srgb(linear.min(1.0)),
    }
}

impl Packer {
    /// Returns a frame's bytes. `source` is the frame of the source that has the same pixels, if there is one.
    pub fn pack(&self, shown: &[[f32; 3]], source: Option<(&Planes, Part)>) -> Vec<u8> {
        let source = source.filter(|(planes, part)| {
            let tags = |tags: &Tags| (tags.matrix, tags.full_range, tags.siting.middle);
            let layout = |format: &Format| (format.kind, format.bits, format.sub);
            let even = part.from[0] & ((1 << self.format.sub[0]) - 1) == 0
                && part.from[1] & ((1 << self.format.sub[1]) - 1) == 0;
            part.size == self.size
                && layout(&planes.format) == layout(&self.format)
                && tags(planes.tags) == tags(&self.tags)
                && even
        });
        let same = source.map(|(planes, part)| self.same(shown, planes, part));
        let width = self.size[0] as usize;
        let [kr, kb] = self.tags.matrix.weights();
        let [[offset, scale], [c_offset, c_scale]] = self.scales();
        let luma = |[r, g, b]: &[f32; 3]| kr * r + (1.0 - kr - kb) * g + kb * b;
        let kept = |plane: usize, index: usize| source.map(|(planes, part)| planes.code_in(part, plane, index));
        let is_same = |index: usize| same.as_ref().is_some_and(|same| same[index]);
        let planes = self.format.planes(self.size);
        let mut codes: Vec<Vec<u16>> = planes.iter().map(|[w, h]| vec![0; w * h]).collect();
        let largest = self.format.largest();
        let to_code = |value: f32| value.round().clamp(0.0, largest) as u16;
        let fill = |out: &mut Vec<u16>, plane: usize, value: &(dyn Fn(&[f32; 3]) -> f32 + Sync)| {
            out.par_chunks_mut(width.max(1)).enumerate().for_each(|(y, row)| {
                for (x, out) in row.iter_mut().enumerate() {
                    let index = y * width + x;
                    *out = match kept(plane, index).filter(|_| is_same(index)) {
                        Some(code) => code,
                        None => to_code(value(&shown[index])),
                    };
                }
            });
        };
        match self.format.kind {
            Kind::Gbr => {
                for (plane, channel) in [1, 2, 0].into_iter().enumerate() {
                    fill(&mut codes[plane], plane, &|rgb| rgb[channel] * largest);
                }
            }
            Kind::Gray => fill(&mut codes[0], 0, &|rgb| luma(rgb) * largest),
            Kind::Yuv => {
                fill(&mut codes[0], 0, &|rgb| luma(rgb) * scale + offset);
                for (plane, (channel, weight)) in [(2, kb), (0, kr)].into_iter().enumerate() {
                    let difference = |rgb: &[f32; 3]| (rgb[channel] - luma(rgb)) / (2.0 * (1.0 - weight));
                    let columns = planes[1][0];
                    codes[plane + 1].par_chunks_mut(columns.max(1)).enumerate().for_each(|(row, out)| {
                        for (column, out) in out.iter_mut().enumerate() {
                            let (mean, untouched) = self.chroma(shown, [column, row], &difference, &is_same);
                            *out = match source.filter(|_| untouched) {
                                Some((planes, part)) => planes.chroma_code_in(part, plane + 1, [column, row]),
                                None => to_code(mean * c_scale + c_offset),
                            };
                        }
                    });
                }
            }
        }
        let flat = codes.iter().flatten();
        if self.format.bits > 8 {
            flat.flat_map(|code| code.to_le_bytes()).collect()
        } else {
            flat.map(|code| *code as u8).collect()
        }
    }

    /// The mean of a chroma sample's pixels, and whether all of them are the source's own. Samples on a pixel's centre
    /// weigh the ones beside it, too.
    fn chroma(
        &self,
        shown: &[[f32; 3]],
        at: [usize; 2],
        difference: &dyn Fn(&[f32; 3]) -> f32,
        is_same: &dyn Fn(usize) -> bool,
    ) -> (f32, bool) {
        let [width, height] = self.size.map(|side| side as usize);
        let taps = |axis: usize| -> Vec<(i64, f32)> {
            let (sub, first) = (self.format.sub[axis], (at[axis] << self.format.sub[axis]) as i64);
            match (sub, self.tags.siting.middle[axis]) {
                (0, _) => vec![(first, 1.0)],
                (1, false) => vec![(first - 1, 1.0), (first, 2.0), (first + 1, 1.0)],
                _ => (0..1_i64 << sub).map(|i| (first + i, 1.0)).collect(),
            }
        };
        let (mut sum, mut weights, mut untouched) = (0.0, 0.0, true);
        let within = |value: i64, axis: usize| {
            let first = (at[axis] << self.format.sub[axis]) as i64;
            value >= first && value < first + (1 << self.format.sub[axis])
        };
        for (y, weight_y) in taps(1) {
            let row = y.clamp(0, height as i64 - 1) as usize;
            for (x, weight_x) in taps(0) {
                let index = row * width + x.rem_euclid(width as i64) as usize;
                sum += weight_x * weight_y * difference(&shown[index]);
                weights += weight_x * weight_y;
                if within(x, 0) && within(y, 1) && (x as usize) < width && (y as usize) < height {
                    untouched &= is_same(index);
                }
            }
        }
        (sum / weights, untouched)
    }

    /// Which pixels of the picture are those of the source, by what its codes show.
    fn same(&self, shown: &[[f32; 3]], planes: &Planes, part: Part) -> Vec<bool> {
        let width = self.size[0] as usize;
        let step = SAME / self.format.largest();
        let near = |was: [f32; 3], is: [f32; 3]| {
            let light = |codes: [f32; 3]| Vec3::from(codes.map(|code| self.tags.space.transfer.linear(code, 0)));
            let (was, is) = (light(was), light(is));
            (was - is).abs().max_element() < SHARE * was.max_element()
        };
        let mut same = vec![false; shown.len()];
        let row = |(y, out): (usize, &mut [bool]), codes: &mut Vec<[f32; 3]>| {
            planes.row(part, y as u32, codes);
            for (x, out) in out.iter_mut().enumerate() {
                let (was, is) = (codes[x].map(|code| code.clamp(0.0, 1.0)), shown[y * width + x]);
                *out = (0..3).all(|c| (was[c] - is[c]).abs() < step) || near(was, is);
            }
        };
        same.par_chunks_mut(width.max(1)).enumerate().for_each_init(Vec::new, |codes, y_row| row(y_row, codes));
        same
    }

    /// Offset and factor from luma 0..1 and from chroma −½..½ to codes.
    fn scales(&self) -> [[f32; 2]; 2] {
        let unit = (1_u32 << (self.format.bits - 8)) as f32;
        if self.tags.full_range {
            return [[0.0, self.format.largest()], [128.0 * unit, self.format.largest()]];
        }
        [[16.0 * unit, 219.0 * unit], [128.0 * unit, 224.0 * unit]]
    }
}

impl Matrix {
    /// The matrix for a format that is written.
    pub fn for_output(self, kind: Kind) -> Self {
        match (kind, self) {
            (Kind::Gbr, _) => Self::Rgb,
            (_, Self::Rgb) => Self::Bt709,
            (_, other) => other,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::media::format::Siting;

    fn tags(full: bool, transfer: &str) -> Tags {
        Tags::new(Matrix::Bt709, full, None, Some(transfer), Siting::LEFT).expect("known")
    }

    #[test]
    fn curves_are_undone() {
        for transfer in ["bt709", "iec61966-2-1", "gamma22", "linear", "smpte2084", "arib-std-b67"] {
            let tags = tags(false, transfer);
            for i in 0..=40 {
                let code = i as f32 / 40.0;
                let light = Vec3::splat(tags.space.transfer.linear(code, 0));
                assert!((tags.shown(light)[1] - code).abs() < 2e-4, "{transfer}: {code}");
            }
        }
    }

    /// Saturated colours of wide gamuts, as large panoramas keep them: with eleven bits a channel.
    #[test]
    fn pixels_beyond_rec709_keep_their_codes() {
        for (primaries, transfer) in [("bt2020", "bt2020-10"), ("bt2020", "smpte2084"), ("smpte432", "bt709")] {
            let tags = Tags::new(Matrix::Rgb, true, Some(primaries), Some(transfer), Siting::LEFT).expect("known");
            let (format, size) = (Format::of("gbrp10le"), [64, 8]);
            let code = |i: usize| [0, 1023, 40, 700][(i / 3 + i) % 4] + (i as u16 % 2) * u16::from(i % 5 == 1) * 100;
            let codes: Vec<u16> = (0..3 * 64 * 8).map(|i| code(i * 7919 % 1536).min(1023)).collect();
            let bytes: Vec<u8> = codes.iter().flat_map(|code| code.to_le_bytes()).collect();
            let planes = Planes { size, format, tags: &tags, bytes: &bytes };
            let texels = planes.color(Part::whole(size)).texels;
            assert!(texels.iter().any(|texel| texel[0] < -0.01), "{primaries}");
            let half = |value: f32| half::f16::from_f32(value).to_f32();
            let shown: Shown =
                texels.iter().map(|t| tags.shown(Vec3::new(half(t[0]), half(t[1]), half(t[2])))).collect();
            let packer = Packer { size, format, tags: tags.clone() };
            assert_eq!(packer.pack(&shown, Some((&planes, Part::whole(size)))), bytes, "{primaries}, {transfer}");
        }
    }

    /// Codes that show nothing, beyond the range or in chroma finer than a pixel, come through untouched.
    #[test]
    fn pixels_of_the_source_keep_its_codes() {
        for (name, full) in
            [("yuv420p", false), ("yuv420p10le", false), ("yuv422p", true), ("yuv444p", false), ("gbrp", true)]
        {
            let format = Format::named(name).expect("known");
            let mut tags = tags(full, "bt709");
            tags.matrix = tags.matrix.for_output(format.kind);
            let size = [8, 6];
            let noise = |i: usize| (i as u32).wrapping_mul(2_654_435_761) >> 16;
            let count = format.frame_bytes(size) / format.code_bytes();
            let codes: Vec<u16> = (0..count).map(|i| (noise(i) % (1 << format.bits)) as u16).collect();
            let bytes: Vec<u8> = match format.code_bytes() {
                1 => codes.iter().map(|code| *code as u8).collect(),
                _ => codes.iter().flat_map(|code| code.to_le_bytes()).collect(),
            };
            let planes = Planes { size, format, tags: &tags, bytes: &bytes };
            let part = Part::whole(size);
            let shown: Shown =
                planes.color(part).texels.iter().map(|t| tags.shown(Vec3::new(t[0], t[1], t[2]))).collect();
            let packer = Packer { size, format, tags: tags.clone() };
            assert_eq!(packer.pack(&shown, Some((&planes, part))), bytes, "{name}");
            let mut changed = shown.clone();
            changed[0] = changed[0].map(|code| if code > 0.5 { code - 0.3 } else { code + 0.3 });
            let other = packer.pack(&changed, Some((&planes, part)));
            let differ = other.iter().zip(&bytes).filter(|(a, b)| a != b).count();
            assert!((1..=6).contains(&differ), "{name}: {differ}");
        }
    }
}
