//! Frames as planes of codes, and the pictures that they make.

use super::format::{Format, Kind, Matrix, Tags};
use crate::{
    Error, Result,
    image_file::{CodeImage, ColorImage, FileImage, Raster, Samples, color_space::Transfer},
};
use glam::Vec3;
use rayon::prelude::*;

/// A part of a frame.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Part {
    pub from: [u32; 2],
    pub size: [u32; 2],
}

impl Part {
    /// All of a frame.
    pub fn whole(size: [u32; 2]) -> Self {
        Self { from: [0, 0], size }
    }
}

/// A frame as it came out of the pipe.
pub struct Planes<'a> {
    pub size: [u32; 2],
    pub format: Format,
    pub tags: &'a Tags,
    pub bytes: &'a [u8],
}

/// A transfer curve as a table; between its steps it is taken to be straight.
#[derive(Clone, Debug)]
pub struct Curve(pub Vec<f32>);

impl Curve {
    /// How many steps lie between 0 and 1. Behind them the last value comes once more.
    pub const STEPS: usize = 8192;

    pub fn of(transfer: &Transfer) -> Self {
        let at = |step: usize| step.min(Self::STEPS) as f32 / Self::STEPS as f32;
        Self((0..=Self::STEPS + 1).map(|step| transfer.linear(at(step), 0)).collect())
    }

    pub fn linear(&self, code: f32) -> f32 {
        let at = code.clamp(0.0, 1.0) * Self::STEPS as f32;
        let below = at as usize;
        mix(self.0[below], self.0[below + 1], at - below as f32)
    }
}

/// The number of a sample among those around a panorama, of which it is at most one beyond.
fn around(index: i64, count: usize) -> usize {
    let count = count as i64;
    (if index < 0 {
        index + count
    } else if index >= count {
        index - count
    } else {
        index
    }) as usize
}

fn mix(a: f32, b: f32, weight: f32) -> f32 {
    a + (b - a) * weight
}

impl Planes<'_> {
    fn plane(&self, index: usize) -> (Codes<'_>, usize) {
        let (start, [width, height]) = self.format.plane(self.size, index);
        let bytes = self.format.code_bytes();
        let codes = &self.bytes[start * bytes..(start + width * height) * bytes];
        (if bytes == 1 { Codes::Bytes(codes) } else { Codes::Words(codes) }, width)
    }

    /// Offset and factor that make luma (or red, green, blue) 0..1, and the same for chroma, −½..½.
    pub fn scales(&self) -> [[f32; 2]; 2] {
        let unit = (1_u32 << (self.format.bits - 8)) as f32;
        if self.tags.full_range || self.format.kind != Kind::Yuv {
            let largest = self.format.largest();
            return [[0.0, 1.0 / largest], [-128.0 * unit, 1.0 / largest]];
        }
        [[-16.0 * unit, 1.0 / (219.0 * unit)], [-128.0 * unit, 1.0 / (224.0 * unit)]]
    }

    /// R'G'B' of the pixels of a row of a part, as codes 0..1 that may lie beyond.
    pub fn row(&self, part: Part, y: u32, out: &mut Vec<[f32; 3]>) {
        out.clear();
        let width = part.size[0] as usize;
        let [[y_offset, y_scale], [c_offset, c_scale]] = self.scales();
        let luma = |plane: usize| {
            let (codes, stride) = self.plane(plane);
            let start = (part.from[1] + y) as usize * stride + part.from[0] as usize;
            (0..width).map(move |x| (codes.at(start + x) + y_offset) * y_scale)
        };
        match self.format.kind {
            Kind::Gray => out.extend(luma(0).map(|v| [v; 3])),
            Kind::Gbr => out.extend(luma(0).zip(luma(1)).zip(luma(2)).map(|((g, b), r)| [r, g, b])),
            Kind::Yuv => {
                if self.tags.matrix == Matrix::Rgb {
                    let [cb, cr] = [1, 2].map(|plane| self.chroma_row(plane, part, y));
                    let code = |c: f32| (c + y_offset) * y_scale;
                    out.extend(luma(0).zip(cb.iter().zip(&cr)).map(|(g, (b, r))| [code(*r), g, code(*b)]));
                    return;
                }
                let [cb, cr] = [1, 2].map(|plane| self.chroma_row(plane, part, y));
                let scaled = |c: f32| (c + c_offset) * c_scale;
                let [of_cb, of_cr] = self.tags.matrix.columns();
                out.extend(
                    luma(0)
                        .zip(cb.iter().zip(&cr))
                        .map(|(y, (cb, cr))| (Vec3::splat(y) + scaled(*cb) * of_cb + scaled(*cr) * of_cr).to_array()),
                );
            }
        }
    }

    /// The place of a part's pixel among its chroma samples along an axis: the one before, and the weight of the next.
    fn place(&self, part: Part, pixel: u32, axis: usize) -> (i64, f32) {
        let sub = self.format.sub[axis];
        // In halves of a pixel.
        let (at, step) = (2 * i64::from(part.from[axis] + pixel) - self.shift(axis), 2_i64 << sub);
        ((at >> (sub + 1)) - i64::from(part.from[axis] >> sub), (at & (step - 1)) as f32 / step as f32)
    }

    /// How far the first chroma sample lies from the first pixel along an axis, in halves of a pixel.
    pub fn shift(&self, axis: usize) -> i64 {
        if self.tags.siting.middle[axis] { (1 << self.format.sub[axis]) - 1 } else { 0 }
    }

    /// The first chroma sample of a part along an axis, and how many there are.
    pub fn chroma_range(&self, part: Part, axis: usize) -> (usize, usize) {
        let sub = self.format.sub[axis];
        let (first, last) = (part.from[axis] >> sub, (part.from[axis] + part.size[axis] - 1) >> sub);
        (first as usize, (last - first + 1) as usize)
    }

    /// R'G'B' of one pixel of a part, as [`Planes::row`] has it. The matrix must not be [`Matrix::Rgb`] for planes of chroma.
    pub fn pixel(&self, part: Part, [x, y]: [u32; 2]) -> Vec3 {
        let [[y_offset, y_scale], [c_offset, c_scale]] = self.scales();
        let luma = |plane: usize| {
            let (codes, stride) = self.plane(plane);
            (codes.at((part.from[1] + y) as usize * stride + (part.from[0] + x) as usize) + y_offset) * y_scale
        };
        match self.format.kind {
            Kind::Gray => Vec3::splat(luma(0)),
            Kind::Gbr => Vec3::new(luma(2), luma(0), luma(1)),
            Kind::Yuv => {
                let ((first_x, columns), (first_y, rows)) = (self.chroma_range(part, 0), self.chroma_range(part, 1));
                let ((left, across), (above, down)) = (self.place(part, x, 0), self.place(part, y, 1));
                let columns = [left, left + 1].map(|x| first_x + around(x, columns));
                let [cb, cr] = [1, 2].map(|plane| {
                    let (codes, stride) = self.plane(plane);
                    let row = |y: i64| (first_y + y.clamp(0, rows as i64 - 1) as usize) * stride;
                    let [a, b] = columns.map(|x| mix(codes.at(row(above) + x), codes.at(row(above + 1) + x), down));
                    (mix(a, b, across) + c_offset) * c_scale
                });
                let [of_cb, of_cr] = self.tags.matrix.columns();
                Vec3::splat(luma(0)) + cb * of_cb + cr * of_cr
            }
        }
    }

    /// What the largest of R'G'B' of each pixel of a row of a part is at most.
    pub fn bounds(&self, part: Part, y: u32) -> Vec<f32> {
        let [[y_offset, y_scale], [c_offset, c_scale]] = self.scales();
        let row = |plane: usize| {
            let (codes, stride) = self.plane(plane);
            let start = (part.from[1] + y) as usize * stride + part.from[0] as usize;
            (0..part.size[0] as usize).map(move |x| (codes.at(start + x) + y_offset) * y_scale)
        };
        match self.format.kind {
            Kind::Gray => row(0).collect(),
            Kind::Gbr => row(0).zip(row(1)).zip(row(2)).map(|((g, b), r)| r.max(g).max(b)).collect(),
            Kind::Yuv => {
                // Between chroma samples nothing is beyond them.
                let ((first_x, columns), (first_y, rows)) = (self.chroma_range(part, 0), self.chroma_range(part, 1));
                let [(cb, stride), (cr, _)] = [1, 2].map(|plane| self.plane(plane));
                let [of_cb, of_cr] = self.tags.matrix.columns();
                let (above, _) = self.place(part, y, 1);
                let mut most = vec![f32::MIN; columns];
                for y in [above, above + 1] {
                    let start = (first_y + y.clamp(0, rows as i64 - 1) as usize) * stride + first_x;
                    for (x, most) in most.iter_mut().enumerate() {
                        let [cb, cr] = [cb, cr].map(|plane| (plane.at(start + x) + c_offset) * c_scale);
                        *most = most.max((cb * of_cb + cr * of_cr).max_element());
                    }
                }
                let most_at = |x: usize| {
                    let (left, _) = self.place(part, x as u32, 0);
                    most[around(left, columns)].max(most[around(left + 1, columns)])
                };
                row(0).enumerate().map(|(x, luma)| luma + most_at(x)).collect()
            }
        }
    }

    /// Chroma codes at the pixels of a row, between samples as if straight. What lies outside the part is not looked at:
    /// across it closes, as a panorama does.
    fn chroma_row(&self, plane: usize, part: Part, y: u32) -> Vec<f32> {
        let (codes, stride) = self.plane(plane);
        let ((first_x, columns), (first_y, rows)) = (self.chroma_range(part, 0), self.chroma_range(part, 1));
        let (above, weight) = self.place(part, y, 1);
        let row = |index: i64| (first_y + index.clamp(0, rows as i64 - 1) as usize) * stride + first_x;
        let (a, b) = (row(above), row(above + 1));
        let down: Vec<f32> = (0..columns).map(|x| mix(codes.at(a + x), codes.at(b + x), weight)).collect();
        let wrapped = |index: i64| down[around(index, columns)];
        (0..part.size[0])
            .map(|x| {
                let (left, weight) = self.place(part, x, 0);
                mix(wrapped(left), wrapped(left + 1), weight)
            })
            .collect()
    }

    /// The code in a plane of full size of a pixel of a part.
    pub(super) fn code_in(&self, part: Part, plane: usize, index: usize) -> u16 {
        let (codes, stride) = self.plane(plane);
        let (x, y) = (index % part.size[0] as usize, index / part.size[0] as usize);
        codes.at((part.from[1] as usize + y) * stride + part.from[0] as usize + x) as u16
    }

    /// A code in a plane of chroma, counted from the part's first.
    pub(super) fn chroma_code_in(&self, part: Part, plane: usize, [column, row]: [usize; 2]) -> u16 {
        let (codes, stride) = self.plane(plane);
        let [x, y] = [0, 1].map(|axis| (part.from[axis] >> self.format.sub[axis]) as usize);
        codes.at((y + row) * stride + x + column) as u16
    }

    /// The linear picture of a part, in Rec. 709. Where a colour is beyond it, a channel is negative.
    pub fn color(&self, part: Part) -> ColorImage {
        let space = &self.tags.space;
        let curve = Curve::of(&space.transfer);
        let linear = |code: f32| curve.linear(code);
        let width = part.size[0] as usize;
        let mut texels = vec![[0.0, 0.0, 0.0, 1.0]; width * part.size[1] as usize];
        let row = |(y, texels): (usize, &mut [[f32; 4]]), codes: &mut Vec<[f32; 3]>| {
            self.row(part, y as u32, codes);
            for (texel, codes) in texels.iter_mut().zip(codes.iter()) {
                let color = Vec3::from(codes.map(linear));
                *texel = space.to_rec709.map_or(color, |matrix| matrix * color).extend(1.0).to_array();
            }
        };
        texels.par_chunks_mut(width.max(1)).enumerate().for_each_init(Vec::new, |codes, y_row| row(y_row, codes));
        let ldr = space.transfer.saturates_at_one();
        ColorImage { size: part.size, texels, ldr, taken: None, notes: Vec::new() }
    }

    /// The whole frame as an image file would hold it, with sRGB's meaning or its own.
    pub fn image(&self) -> FileImage {
        let part = Part::whole(self.size);
        let deep = self.format.bits > 8;
        let largest = if deep { 65535.0 } else { 255.0 };
        let mut row = Vec::new();
        let mut codes: Vec<u16> = Vec::with_capacity(self.size[0] as usize * self.size[1] as usize * 3);
        for y in 0..self.size[1] {
            self.row(part, y, &mut row);
            codes.extend(row.iter().flatten().map(|code| (code.clamp(0.0, 1.0) * largest).round() as u16));
        }
        let samples =
            if deep { Samples::U16(codes) } else { Samples::U8(codes.iter().map(|code| *code as u8).collect()) };
        let color = self.tags.space.clone();
        FileImage::Raster(Raster { size: self.size, channels: 3, samples, lossy: true, color, notes: Vec::new() })
    }

    /// The codes of a grey part as an image would hold them, with the full range of its bits.
    ///
    /// # Errors
    /// Fails if the part is coloured.
    pub fn codes(&self, part: Part, subject: &str) -> Result<CodeImage> {
        self.check_grey(part, subject)?;
        let largest = self.format.largest();
        let (luma, stride) = self.plane(0);
        let [[offset, scale], _] = self.scales();
        let table: Vec<f32> = (0..=largest as u32)
            .map(|code| ((code as f32 + offset) * scale * largest).round().clamp(0.0, largest))
            .collect();
        let width = part.size[0] as usize;
        let mut codes = vec![0.0; width * part.size[1] as usize];
        codes.par_chunks_mut(width.max(1)).enumerate().for_each(|(y, row)| {
            let start = (part.from[1] as usize + y) * stride + part.from[0] as usize;
            for (x, code) in row.iter_mut().enumerate() {
                *code = table[(luma.at(start + x) as usize).min(table.len() - 1)];
            }
        });
        Ok(CodeImage { size: part.size, codes, integer: true, taken: None, notes: Vec::new() })
    }

    /// Lossy compression tints grey a little. A colour map is coloured all over.
    fn check_grey(&self, part: Part, subject: &str) -> Result<()> {
        const TINT: f32 = 0.15;
        if self.format.kind == Kind::Gray {
            return Ok(());
        }
        let (mut coloured, mut all) = (0_usize, 0_usize);
        let mut row = Vec::new();
        for y in (0..part.size[1]).step_by((part.size[1] as usize / 64).max(1)) {
            self.row(part, y, &mut row);
            for [r, g, b] in row.iter().step_by(4) {
                coloured += usize::from(r.max(*g).max(*b) - r.min(*g).min(*b) > TINT);
                all += 1;
            }
        }
        if coloured > all / 20 {
            let remedy = "give the one grey channel that holds the depth codes, not a coloured preview of it";
            return Err(Error::input(subject, "a depth video in colour has no defined codes", remedy));
        }
        Ok(())
    }
}

/// Codes of a plane.
#[derive(Clone, Copy)]
enum Codes<'a> {
    Bytes(&'a [u8]),
    Words(&'a [u8]),
}

impl Codes<'_> {
    fn at(&self, index: usize) -> f32 {
        match self {
            Self::Bytes(bytes) => f32::from(bytes[index]),
            Self::Words(bytes) => f32::from(u16::from_le_bytes([bytes[2 * index], bytes[2 * index + 1]])),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::media::format::Siting;

    #[test]
    fn limited_codes_span_the_range() {
        let tags = Tags::new(Matrix::Bt709, false, None, None, Siting::LEFT).expect("known");
        let format = Format::of("yuv444p");
        let bytes = [16, 235, 126, 128, 128, 128, 128, 128, 128];
        let planes = Planes { size: [3, 1], format, tags: &tags, bytes: &bytes };
        let part = Part::whole([3, 1]);
        let color = planes.color(part);
        assert!(color.texels[0][0].abs() < 1e-6 && (color.texels[1][1] - 1.0).abs() < 1e-5);
        assert_eq!(planes.codes(part, "a").expect("grey").codes, [0.0, 255.0, 128.0]);
    }

    #[test]
    fn chroma_lies_where_its_siting_says() {
        let tags = |siting| Tags::new(Matrix::Bt709, true, None, None, siting).expect("known");
        let format = Format::of("yuv422p");
        let bytes = [0, 0, 0, 0, 100, 200, 128, 128];
        let row = |siting| {
            let tags = tags(siting);
            let planes = Planes { size: [4, 1], format, tags: &tags, bytes: &bytes };
            planes.chroma_row(1, Part::whole([4, 1]), 0)
        };
        assert_eq!(row(Siting::LEFT), [100.0, 150.0, 200.0, 150.0]);
        assert_eq!(row(Siting::CENTER), [125.0, 125.0, 175.0, 175.0]);
    }
}
