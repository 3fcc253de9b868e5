//! The colours of a panorama in memory: 32-bit floats, or 16-bit ones where it is large.

use half::{
    f16,
    slice::{HalfBitsSliceExt as _, HalfFloatSliceExt as _},
};
use rayon::prelude::*;

/// A panorama of more texels (4096 × 2048) is kept as 16-bit floats, in 8 bytes a texel.
pub const LARGE: usize = 1 << 23;
/// How many texels are wide at a time.
const PIECE: usize = 1 << 18;

/// Linear RGBA texels. How they are kept follows from their number alone.
#[derive(Clone, Debug, PartialEq)]
pub struct Texels(Kept);

#[derive(Clone, Debug, PartialEq)]
enum Kept {
    Full(Vec<[f32; 4]>),
    Half(Vec<[u16; 4]>),
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

fn widen(texel: [u16; 4]) -> [f32; 4] {
    texel.map(|bits| f16::from_bits(bits).to_f32())
}

/// Finite values stay finite.
fn narrow(wide: &[[f32; 4]], out: &mut [[u16; 4]]) {
    let most = f16::MAX.to_f32();
    for (texel, bits) in wide.iter().zip(out) {
        let finite = texel.map(|value| if value.is_finite() { value.clamp(-most, most) } else { value });
        bits.reinterpret_cast_mut::<f16>().convert_from_f32_slice(&finite);
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
        }
    }

    /// Returns all of them in order.
    pub fn iter(&self) -> impl DoubleEndedIterator<Item = [f32; 4]> + ExactSizeIterator + Clone {
        (0..self.len()).map(|index| self.at(index))
    }

    /// The same for several threads.
    pub fn par_iter(&self) -> impl IndexedParallelIterator<Item = [f32; 4]> {
        (0..self.len()).into_par_iter().map(|index| self.at(index))
    }

    /// All of them as 32-bit floats.
    pub fn to_vec(&self) -> Vec<[f32; 4]> {
        self.iter().collect()
    }

    /// The bytes in memory.
    pub fn bytes(&self) -> &[u8] {
        match &self.0 {
            Kept::Full(texels) => bytemuck::cast_slice(texels),
            Kept::Half(texels) => bytemuck::cast_slice(texels),
        }
    }

    /// Hands out texels as 32-bit floats, at most so many at a time, each time with the number of the first. Those that are
    /// kept as such come at once.
    pub fn pieces<E>(&self, most: usize, mut piece: impl FnMut(usize, &[[f32; 4]]) -> Result<(), E>) -> Result<(), E> {
        match &self.0 {
            Kept::Full(texels) => piece(0, texels),
            Kept::Half(texels) => {
                let mut wide = Vec::with_capacity(most);
                texels.chunks(most).enumerate().try_for_each(|(number, bits)| {
                    wide.clear();
                    wide.extend(bits.iter().map(|texel| widen(*texel)));
                    piece(number * most, &wide)
                })
            }
        }
    }

    /// Changes texels in order, a piece at a time. A piece comes with the number of its first texel.
    pub fn change(&mut self, mut change: impl FnMut(usize, &mut [[f32; 4]])) {
        match &mut self.0 {
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
        match &mut self.0 {
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
        let mut many = Texels::make(LARGE + 1, |index| [index as f32, 0.1, 1e9, f32::INFINITY]);
        assert_eq!(many.bytes().len(), 8 * (LARGE + 1));
        assert_eq!(many.at(1000), [1000.0, f16::from_f32(0.1).to_f32(), 65504.0, f32::INFINITY]);
        many.change(|first, texels| {
            texels.iter_mut().enumerate().for_each(|(index, texel)| texel[0] = ((first + index) % 7) as f32);
        });
        many.write(LARGE, &[[9.0; 4]]);
        assert_eq!([many.at(LARGE - 1)[0], many.at(LARGE)[0]], [((LARGE - 1) % 7) as f32, 9.0]);
        assert_eq!(many.iter().count(), many.len());
    }
}
