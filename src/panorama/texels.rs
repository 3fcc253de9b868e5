//! The colours of a panorama in memory: 32-bit floats, or 16-bit ones where it is large, or codes of which texels are made
//! when they are asked for.

use super::codes::Codes;
use half::{
    f16,
    slice::{HalfBitsSliceExt as _, HalfFloatSliceExt as _},
};
use rayon::prelude::*;

/// A panorama of more texels (4096 × 2048) is kept as 16-bit floats, in 8 bytes a texel.
pub const LARGE: usize = 1 << 23;
/// How many texels are wide at a time.
const PIECE: usize = 1 << 18;
/// A texel with a brighter channel is kept divided by [`SCALE`], and alpha is negative.
const MOST: f32 = 65504.0;
/// A texel without a brighter channel is kept multiplied by [`SCALE`], and alpha divided by [`ROOT`].
const DARK: f32 = 1.0 / 1024.0;
const SCALE: f32 = 65536.0;
const ROOT: f32 = 4096.0;
/// The brightest radiance that is kept where texels are 16-bit floats.
pub const BRIGHTEST: f32 = MOST * SCALE;

/// Linear RGBA texels. How they are kept follows from their number alone.
#[derive(Clone, Debug)]
pub struct Texels(Kept);

#[derive(Clone, Debug)]
enum Kept {
    Full(Vec<[f32; 4]>),
    Half(Vec<[u16; 4]>),
    Codes(Box<Codes>),
}

impl PartialEq for Texels {
    fn eq(&self, other: &Self) -> bool {
        self.len() == other.len() && self.bytes() == other.bytes()
    }
}

/// Says whether so many texels are kept as 16-bit floats.
pub fn are_half(count: usize) -> bool {
    count > LARGE
}

/// Says whether a panorama of this size is kept as 16-bit floats.
pub fn is_half([width, height]: [u32; 2]) -> bool {
    are_half(width as usize * height as usize)
}

/// Bytes of so many texels in memory.
pub fn bytes(count: u64) -> u64 {
    count * if are_half(count as usize) { 8 } else { 16 }
}

/// The 32-bit float of a 16-bit one. [`f16::to_f32`] asks each time what the processor can do, which takes longer.
fn wide(bits: u16) -> f32 {
    const FROM_BIAS: f32 = f32::from_bits((127 + 127 - 15) << 23); // 2^112, the difference of the exponents
    let magnitude = f32::from_bits(u32::from(bits & 0x7fff) << 13) * FROM_BIAS;
    let finite = bits & 0x7c00 != 0x7c00;
    let magnitude = if finite { magnitude } else { f16::from_bits(bits & 0x7fff).to_f32() };
    if bits >> 15 == 0 { magnitude } else { -magnitude }
}

/// Unpacks a texel, as `halves.glsl` does.
fn widen(texel: [u16; 4]) -> [f32; 4] {
    let [r, g, b, alpha] = texel.map(wide);
    let (scale, root) = match alpha {
        ..0.0 => (SCALE, -alpha),
        ..0.5 => (1.0 / SCALE, alpha * ROOT),
        _ => (1.0, alpha),
    };
    [r * scale, g * scale, b * scale, root * root]
}

/// Packs texels. A channel keeps 11 bits, whatever its texel's radiance, and finite values stay finite. Alpha is 0 where
/// nothing is known, whose colour may get lost, or by how much more a texel shines than it shows, which is at least 1 and
/// has a wide range: its root is kept.
fn narrow(wide: &[[f32; 4]], out: &mut [[u16; 4]]) {
    for (&[r, g, b, alpha], bits) in wide.iter().zip(out) {
        let (top, root) = (r.max(g).max(b), alpha.max(0.0).sqrt());
        let (scale, root) = if top > MOST {
            (1.0 / SCALE, -root)
        } else if top < DARK || root == 0.0 {
            (SCALE, root / ROOT)
        } else {
            (1.0, root)
        };
        let kept = |value: f32| if value.is_finite() { (value * scale).clamp(-MOST, MOST) } else { value };
        bits.reinterpret_cast_mut::<f16>().convert_from_f32_slice(&[kept(r), kept(g), kept(b), root]);
    }
}

impl Texels {
    /// So many texels of zeros.
    pub fn blank(count: usize) -> Self {
        Self(if are_half(count) { Kept::Half(vec![[0; 4]; count]) } else { Kept::Full(vec![[0.0; 4]; count]) })
    }

    /// Makes each texel by its number.
    pub fn make(count: usize, texel: impl Fn(usize) -> [f32; 4] + Sync) -> Self {
        let mut made = Self::blank(count);
        made.change(|first, texels| {
            texels.par_iter_mut().enumerate().for_each(|(index, out)| *out = texel(first + index));
        });
        made
    }

    pub fn len(&self) -> usize {
        match &self.0 {
            Kept::Full(texels) => texels.len(),
            Kept::Half(texels) => texels.len(),
            Kept::Codes(codes) => codes.count(),
        }
    }

    pub fn is_empty(&self) -> bool {
        self.len() == 0
    }

    /// Returns a texel.
    pub fn at(&self, index: usize) -> [f32; 4] {
        match &self.0 {
            Kept::Full(texels) => texels[index],
            Kept::Half(texels) => widen(texels[index]),
            Kept::Codes(codes) => codes.at(index),
        }
    }

    /// The codes of which texels are made, if they are kept so.
    pub fn codes(&self) -> Option<&Codes> {
        match &self.0 {
            Kept::Codes(codes) => Some(codes),
            Kept::Full(_) | Kept::Half(_) => None,
        }
    }

    /// The same, to say what they mean.
    pub fn codes_mut(&mut self) -> Option<&mut Codes> {
        match &mut self.0 {
            Kept::Codes(codes) => Some(codes),
            Kept::Full(_) | Kept::Half(_) => None,
        }
    }

    /// All of them, made if they are kept as codes.
    fn all(&self) -> &Self {
        self.codes().map_or(self, Codes::all)
    }

    /// A texel as it is kept among so many.
    pub(super) fn rounded(texel: [f32; 4], count: usize) -> [f32; 4] {
        if !are_half(count) {
            return texel;
        }
        let mut bits = [[0; 4]];
        narrow(&[texel], &mut bits);
        widen(bits[0])
    }

    /// Bytes that they take in memory.
    pub fn kept_bytes(&self) -> usize {
        self.codes().map_or_else(|| self.bytes().len(), Codes::bytes)
    }

    /// The texels by which a measure is more than `least`, with their numbers, in any order. The measure of a texel is no
    /// more than its largest channel times alpha.
    pub fn brighter(&self, least: f32, measure: impl Fn(&[f32; 4]) -> f32 + Sync) -> Vec<(f32, u32)> {
        let measured = |at: u32| Some((measure(&self.at(at as usize)), at)).filter(|(value, _)| *value > least);
        match self.codes() {
            Some(codes) if !codes.are_made() => {
                codes.maybe_brighter(least).into_par_iter().filter_map(measured).collect()
            }
            _ => (0..self.len() as u32).into_par_iter().filter_map(measured).collect(),
        }
    }

    /// Returns all of them in order.
    pub fn iter(&self) -> impl DoubleEndedIterator<Item = [f32; 4]> + ExactSizeIterator + Clone {
        let all = self.all();
        (0..all.len()).map(|index| all.at(index))
    }

    /// The same for several threads.
    pub fn par_iter(&self) -> impl IndexedParallelIterator<Item = [f32; 4]> {
        let all = self.all();
        (0..all.len()).into_par_iter().map(|index| all.at(index))
    }

    /// All of them as 32-bit floats.
    pub fn to_vec(&self) -> Vec<[f32; 4]> {
        self.iter().collect()
    }

    /// The bytes in memory, which a device's image of [`crate::gpu::Format::Rgba16f`] or `Rgba32f` has, too.
    pub fn bytes(&self) -> &[u8] {
        match &self.0 {
            Kept::Full(texels) => bytemuck::cast_slice(texels),
            Kept::Half(texels) => bytemuck::cast_slice(texels),
            Kept::Codes(codes) => codes.all().bytes(),
        }
    }

    /// Keeps them as floats.
    fn make_all(&mut self) {
        if let Kept::Codes(codes) = &self.0 {
            *self = codes.all().clone();
        }
    }

    /// Changes texels in order, a piece at a time. A piece comes with the number of its first texel.
    pub fn change(&mut self, mut change: impl FnMut(usize, &mut [[f32; 4]])) {
        self.make_all();
        match &mut self.0 {
            Kept::Codes(_) => {}
            Kept::Full(texels) => change(0, texels),
            Kept::Half(texels) => {
                let mut wide = Vec::with_capacity(PIECE);
                for (piece, bits) in texels.chunks_mut(PIECE).enumerate() {
                    wide.clear();
                    wide.extend(bits.iter().map(|texel| widen(*texel)));
                    change(piece * PIECE, &mut wide);
                    narrow(&wide, bits);
                }
            }
        }
    }

    /// Writes a texel.
    pub fn set(&mut self, index: usize, texel: [f32; 4]) {
        self.write(index, &[texel]);
    }

    /// Writes texels from number `first` on.
    pub fn write(&mut self, first: usize, texels: &[[f32; 4]]) {
        self.make_all();
        match &mut self.0 {
            Kept::Codes(_) => {}
            Kept::Full(all) => all[first..first + texels.len()].copy_from_slice(texels),
            Kept::Half(all) => narrow(texels, &mut all[first..first + texels.len()]),
        }
    }
}

impl Default for Texels {
    fn default() -> Self {
        Self(Kept::Full(Vec::new()))
    }
}

impl From<Codes> for Texels {
    fn from(codes: Codes) -> Self {
        Self(Kept::Codes(Box::new(codes)))
    }
}

impl From<Vec<[f32; 4]>> for Texels {
    fn from(texels: Vec<[f32; 4]>) -> Self {
        if !are_half(texels.len()) {
            return Self(Kept::Full(texels));
        }
        let mut half = Self::blank(texels.len());
        half.write(0, &texels);
        half
    }
}

impl FromIterator<[f32; 4]> for Texels {
    fn from_iter<I: IntoIterator<Item = [f32; 4]>>(texels: I) -> Self {
        texels.into_iter().collect::<Vec<_>>().into()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn many_texels_take_half_as_much() {
        let few: Texels = vec![[0.1, 1e9, -3.0, 1.0]; 2].into();
        assert_eq!((few.at(1), few.bytes().len()), ([0.1, 1e9, -3.0, 1.0], 32));
        let mut many = Texels::make(LARGE + 1, |index| [index as f32, 0.1, 7.0, 1.0]);
        assert_eq!(many.bytes().len(), 8 * (LARGE + 1));
        assert_eq!(many.at(1000), [1000.0, f16::from_f32(0.1).to_f32(), 7.0, 1.0]);
        many.change(|first, texels| {
            texels.iter_mut().enumerate().for_each(|(index, texel)| texel[0] = ((first + index) % 7) as f32);
        });
        many.write(LARGE, &[[9.0; 4]]);
        assert_eq!([many.at(LARGE - 1)[0], many.at(LARGE)[0]], [((LARGE - 1) % 7) as f32, 9.0]);
        assert_eq!(many.iter().count(), many.len());
    }

    #[test]
    fn every_16_bit_float_becomes_itself() {
        for bits in 0..=u16::MAX {
            assert_eq!(wide(bits).to_bits(), f16::from_bits(bits).to_f32().to_bits(), "{bits:#x}");
        }
    }

    #[test]
    fn sixteen_bits_hold_the_sun_and_the_night() {
        let packed = |texel: [f32; 4]| {
            let mut bits = [[0; 4]];
            narrow(&[texel], &mut bits);
            widen(bits[0])
        };
        for power in -29..=31 {
            for [r, g, alpha] in [[1.0, 0.7, 1.0], [1.3, 1.1, 1.0], [0.9, 0.6, 40.0], [1.9, 1.0, 1e6]] {
                let texel = [r * 2_f32.powi(power), g * 2_f32.powi(power), 0.0, alpha];
                let close = |(a, b): (f32, f32)| (a - b).abs() <= b / 1000.0;
                assert!(packed(texel).into_iter().zip(texel).all(close), "{texel:?}: {:?}", packed(texel));
            }
        }
        assert_eq!(packed([200_000.0, 0.0, 0.0, 1.0]), [199_936.0, 0.0, 0.0, 1.0], "alpha that is 1 stays so");
        assert_eq!(packed([1e30, 1.0, 0.0, 1.0])[0], BRIGHTEST);
        assert_eq!(packed([f32::INFINITY, 0.0, 0.0, 1.0])[0], f32::INFINITY);
        assert_eq!((packed([0.0; 4]), packed([5.0, 4.0, 3.0, 0.0])[3]), ([0.0; 4], 0.0), "unknown");
    }
}
