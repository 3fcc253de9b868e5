//! Frames as planes of codes, and what the codes mean.

use crate::{
    Error, Result,
    image_file::{
        CodeImage, ColorImage, FileImage, Raster, Samples,
        color_space::{ColorSpace, Transfer},
    },
};
use glam::Vec3;
use rayon::prelude::*;
use std::fmt;

/// What the planes are.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Kind {
    /// One plane.
    Gray,
    /// Luma, and two planes of chroma that may be smaller.
    Yuv,
    /// Green, blue, red.
    Gbr,
}

/// How frames cross a pipe: planes of 8 bits, or of 16 in little-endian order of which `bits` are used.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Format {
    name: &'static str,
    pub kind: Kind,
    pub bits: u32,
    /// By how many powers of two chroma is narrower and lower.
    pub sub: [u32; 2],
}

macro_rules! formats {
    ($($name:literal $kind:ident $bits:literal $x:literal $y:literal;)*) => {
        const FORMATS: &[Format] = &[$(Format { name: $name, kind: Kind::$kind, bits: $bits, sub: [$x, $y] }),*];
    };
}

formats! {
    "gray" Gray 8 0 0; "gray9le" Gray 9 0 0; "gray10le" Gray 10 0 0; "gray12le" Gray 12 0 0; "gray14le" Gray 14 0 0;
    "gray16le" Gray 16 0 0;
    "gbrp" Gbr 8 0 0; "gbrp9le" Gbr 9 0 0; "gbrp10le" Gbr 10 0 0; "gbrp12le" Gbr 12 0 0; "gbrp14le" Gbr 14 0 0;
    "gbrp16le" Gbr 16 0 0;
    "yuvj420p" Yuv 8 1 1; "yuvj422p" Yuv 8 1 0; "yuvj444p" Yuv 8 0 0; "yuvj440p" Yuv 8 0 1;
    "yuv410p" Yuv 8 2 2; "yuv411p" Yuv 8 2 0; "yuv420p" Yuv 8 1 1; "yuv422p" Yuv 8 1 0; "yuv440p" Yuv 8 0 1;
    "yuv444p" Yuv 8 0 0;
    "yuv420p9le" Yuv 9 1 1; "yuv422p9le" Yuv 9 1 0; "yuv444p9le" Yuv 9 0 0;
    "yuv420p10le" Yuv 10 1 1; "yuv422p10le" Yuv 10 1 0; "yuv440p10le" Yuv 10 0 1; "yuv444p10le" Yuv 10 0 0;
    "yuv420p12le" Yuv 12 1 1; "yuv422p12le" Yuv 12 1 0; "yuv440p12le" Yuv 12 0 1; "yuv444p12le" Yuv 12 0 0;
    "yuv420p14le" Yuv 14 1 1; "yuv422p14le" Yuv 14 1 0; "yuv444p14le" Yuv 14 0 0;
    "yuv420p16le" Yuv 16 1 1; "yuv422p16le" Yuv 16 1 0; "yuv444p16le" Yuv 16 0 0;
}

impl Format {
    /// The format of this name.
    pub fn named(name: &str) -> Option<Self> {
        FORMATS.iter().copied().find(|format| format.name == name)
    }

    /// The format that holds all that is stored as `stored`, which is one of `ffmpeg`'s names. Opacity is left out.
    pub fn of(stored: &str) -> Self {
        let little = match stored.strip_suffix("be") {
            Some(stem) => format!("{stem}le"),
            None => stored.to_owned(),
        };
        let opaque = little.replace("yuva", "yuv").replace("gbrap", "gbrp");
        let alias = match opaque.as_str() {
            "nv12" | "nv21" => "yuv420p",
            "nv16" | "yuyv422" | "uyvy422" | "yvyu422" => "yuv422p",
            "nv24" | "nv42" | "vuya" | "vuyx" | "ayuv" => "yuv444p",
            "p010le" => "yuv420p10le",
            "p012le" => "yuv420p12le",
            "p016le" => "yuv420p16le",
            "nv20le" | "p210le" | "y210le" => "yuv422p10le",
            "p212le" | "y212le" => "yuv422p12le",
            "p216le" => "yuv422p16le",
            "p410le" | "xv30le" => "yuv444p10le",
            "p412le" | "xv36le" => "yuv444p12le",
            "p416le" | "ayuv64le" => "yuv444p16le",
            "ya8" | "monob" | "monow" => "gray",
            "ya16le" => "gray16le",
            "x2rgb10le" | "x2bgr10le" => "gbrp10le",
            "rgb48le" | "bgr48le" | "rgba64le" | "bgra64le" => "gbrp16le",
            other if other.starts_with("bayer") && other.ends_with("16le") => "gbrp16le",
            other => other,
        };
        // What is left is 8 bits of red, green and blue in some order, or a palette of them.
        Self::named(alias).or(Self::named("gbrp")).unwrap_or(FORMATS[0])
    }

    /// The name by which `ffmpeg` knows it.
    pub fn name(&self) -> &'static str {
        self.name
    }

    /// Says whether it is one of the kinds that always have the full range.
    pub fn is_jpeg(&self) -> bool {
        self.name.starts_with("yuvj")
    }

    /// Bytes of a code.
    pub fn code_bytes(&self) -> usize {
        if self.bits > 8 { 2 } else { 1 }
    }

    /// Width and height of each plane.
    pub fn planes(&self, [width, height]: [u32; 2]) -> Vec<[usize; 2]> {
        let whole = [width as usize, height as usize];
        let chroma = [width.div_ceil(1 << self.sub[0]) as usize, height.div_ceil(1 << self.sub[1]) as usize];
        match self.kind {
            Kind::Gray => vec![whole],
            Kind::Yuv => vec![whole, chroma, chroma],
            Kind::Gbr => vec![whole; 3],
        }
    }

    /// Bytes of a frame.
    pub fn frame_bytes(&self, size: [u32; 2]) -> usize {
        self.planes(size).iter().map(|[w, h]| w * h).sum::<usize>() * self.code_bytes()
    }

    /// The largest code.
    pub fn largest(&self) -> f32 {
        ((1_u32 << self.bits) - 1) as f32
    }
}

/// The matrix between R'G'B' and Y'CbCr.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Matrix {
    Rgb,
    Bt709,
    Bt601,
    Bt2020,
    Smpte240m,
    Fcc,
}

impl Matrix {
    /// The matrix of one of `ffmpeg`'s names.
    pub fn named(name: &str) -> Option<Self> {
        Some(match name {
            "gbr" => Self::Rgb,
            "bt709" => Self::Bt709,
            "bt470bg" | "smpte170m" => Self::Bt601,
            "bt2020nc" | "bt2020c" => Self::Bt2020,
            "smpte240m" => Self::Smpte240m,
            "fcc" => Self::Fcc,
            _ => return None,
        })
    }

    /// The name that `ffmpeg` knows.
    pub fn name(self) -> &'static str {
        match self {
            Self::Rgb => "rgb",
            Self::Bt709 => "bt709",
            Self::Bt601 => "smpte170m",
            Self::Bt2020 => "bt2020nc",
            Self::Smpte240m => "smpte240m",
            Self::Fcc => "fcc",
        }
    }

    /// The shares of red and blue in luma.
    pub fn weights(self) -> [f32; 2] {
        match self {
            Self::Rgb | Self::Bt709 => [0.2126, 0.0722],
            Self::Bt601 => [0.299, 0.114],
            Self::Bt2020 => [0.2627, 0.0593],
            Self::Smpte240m => [0.212, 0.087],
            Self::Fcc => [0.30, 0.11],
        }
    }
}

impl fmt::Display for Matrix {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(self.name())
    }
}

/// Where chroma is sampled: this far from the first pixel's centre, in pixels over half a chroma step.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Siting {
    /// Whether chroma lies in the middle of its pixels, across and down. Otherwise it lies on the first of them.
    pub middle: [bool; 2],
}

impl Siting {
    pub const LEFT: Self = Self { middle: [false, true] };
    pub const CENTER: Self = Self { middle: [true, true] };
    pub const TOP_LEFT: Self = Self { middle: [false, false] };
    pub const TOP: Self = Self { middle: [true, false] };
}

/// What codes mean.
#[derive(Clone, Debug, PartialEq)]
pub struct Tags {
    pub matrix: Matrix,
    pub full_range: bool,
    /// `ffmpeg`'s names of primaries and transfer, as they are taken.
    pub primaries: String,
    pub transfer: String,
    pub siting: Siting,
    pub space: ColorSpace,
}

impl Tags {
    /// Puts tags together. What is missing is taken to be bt709, and the transfer that of images.
    ///
    /// # Errors
    /// Fails with the problem if a curve or primaries are not known.
    pub fn new(
        matrix: Matrix,
        full_range: bool,
        primaries: Option<&str>,
        transfer: Option<&str>,
        siting: Siting,
    ) -> std::result::Result<Self, String> {
        // The code points of ITU-T H.273. What differs a little from bt709 counts as that.
        let primaries = primaries.unwrap_or("bt709");
        let of_primaries = match primaries {
            "bt709" | "bt470m" | "bt470bg" | "smpte170m" | "smpte240m" | "film" | "jedec-p22" | "ebu3213" => 1,
            "bt2020" => 9,
            "smpte431" => 11,
            "smpte432" => 12,
            other => return Err(format!("its primaries {other} are not understood")),
        };
        let transfer = transfer.unwrap_or("iec61966-2-1");
        let of_transfer = match transfer {
            // Pictures for displays, all of which show them nearly as sRGB: so an image and a frame of a video mean the same.
            "bt709" | "smpte170m" | "smpte240m" | "bt2020-10" | "bt2020-12" | "iec61966-2-1" | "iec61966-2-4"
            | "bt1361e" => 13,
            "gamma22" | "bt470m" => 4,
            "gamma28" | "bt470bg" => 5,
            "linear" => 8,
            "smpte2084" => 16,
            "arib-std-b67" => 18,
            other => return Err(format!("its transfer {other} is not understood")),
        };
        let space = ColorSpace::of_code_points(of_primaries, of_transfer).unwrap_or(ColorSpace::SRGB);
        Ok(Self { matrix, full_range, primaries: primaries.into(), transfer: transfer.into(), siting, space })
    }

    /// Says whether codes stand for more light than a display's white.
    pub fn is_hdr(&self) -> bool {
        matches!(self.space.transfer, Transfer::Pq | Transfer::Hlg)
    }
}

impl fmt::Display for Tags {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let range = if self.full_range { "full" } else { "limited" };
        write!(f, "{range} range, matrix {}, primaries {}, transfer {}", self.matrix, self.primaries, self.transfer)
    }
}

/// A part of a frame.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Part {
    pub from: [u32; 2],
    pub size: [u32; 2],
}

/// A frame as it came out of the pipe.
pub struct Planes<'a> {
    pub size: [u32; 2],
    pub format: Format,
    pub tags: &'a Tags,
    pub bytes: &'a [u8],
}

/// How many steps a transfer curve is tabulated in; between them it is taken to be straight.
const STEPS: usize = 8192;

impl Planes<'_> {
    fn plane(&self, index: usize) -> (Codes<'_>, usize) {
        let planes = self.format.planes(self.size);
        let before: usize = planes[..index].iter().map(|[w, h]| w * h).sum();
        let [width, height] = planes[index];
        let bytes = self.format.code_bytes();
        let range = before * bytes..(before + width * height) * bytes;
        let codes = &self.bytes[range];
        (if bytes == 1 { Codes::Bytes(codes) } else { Codes::Words(codes) }, width)
    }

    /// Offset and factor that make luma (or red, green, blue) 0..1, and the same for chroma, −½..½.
    fn scales(&self) -> [[f32; 2]; 2] {
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
                let [kr, kb] = self.tags.matrix.weights();
                let kg = 1.0 - kr - kb;
                if self.tags.matrix == Matrix::Rgb {
                    let [cb, cr] = [1, 2].map(|plane| self.chroma_row(plane, part, y));
                    let code = |c: f32| (c + y_offset) * y_scale;
                    out.extend(luma(0).zip(cb.iter().zip(&cr)).map(|(g, (b, r))| [code(*r), g, code(*b)]));
                    return;
                }
                let [cb, cr] = [1, 2].map(|plane| self.chroma_row(plane, part, y));
                let scaled = |c: f32| (c + c_offset) * c_scale;
                out.extend(luma(0).zip(cb.iter().zip(&cr)).map(|(y, (cb, cr))| {
                    let (cb, cr) = (scaled(*cb), scaled(*cr));
                    let (r, b) = (y + 2.0 * (1.0 - kr) * cr, y + 2.0 * (1.0 - kb) * cb);
                    [r, (y - kr * r - kb * b) / kg, b]
                }));
            }
        }
    }

    /// Chroma codes at the pixels of a row, between samples as if straight. What lies outside the part is not looked at:
    /// across it closes, as a panorama does.
    fn chroma_row(&self, plane: usize, part: Part, y: u32) -> Vec<f32> {
        let (codes, stride) = self.plane(plane);
        let [sub_x, sub_y] = self.format.sub;
        let range = |axis: usize, sub: u32| {
            let first = part.from[axis] >> sub;
            let last = (part.from[axis] + part.size[axis] - 1) >> sub;
            (first as usize, (last - first + 1) as usize)
        };
        let ((first_x, columns), (first_y, rows)) = (range(0, sub_x), range(1, sub_y));
        // The place of a pixel among chroma samples: the one before, and the weight of the next.
        let place = |pixel: u32, axis: usize| {
            let (sub, first) = (self.format.sub[axis], (part.from[axis] >> self.format.sub[axis]) as f32);
            let step = (1_u32 << sub) as f32;
            let shift = if self.tags.siting.middle[axis] { 0.5 * (step - 1.0) } else { 0.0 };
            let at = ((part.from[axis] + pixel) as f32 - shift) / step - first;
            (at.floor() as i64, at - at.floor())
        };
        let (above, weight) = place(y, 1);
        let row = |index: i64| (first_y + index.clamp(0, rows as i64 - 1) as usize) * stride + first_x;
        let (a, b) = (row(above), row(above + 1));
        let down: Vec<f32> = if weight == 0.0 || a == b {
            (0..columns).map(|x| codes.at(a + x)).collect()
        } else {
            (0..columns).map(|x| codes.at(a + x) * (1.0 - weight) + codes.at(b + x) * weight).collect()
        };
        let wrapped = |index: i64| down[index.rem_euclid(columns as i64) as usize];
        (0..part.size[0])
            .map(|x| {
                let (left, weight) = place(x, 0);
                if weight == 0.0 { wrapped(left) } else { wrapped(left) * (1.0 - weight) + wrapped(left + 1) * weight }
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

    /// The linear picture of a part.
    pub fn color(&self, part: Part) -> ColorImage {
        let space = &self.tags.space;
        let curve: Vec<f32> =
            (0..=STEPS + 1).map(|i| space.transfer.linear(i.min(STEPS) as f32 / STEPS as f32, 0)).collect();
        let linear = |code: f32| {
            let at = code.clamp(0.0, 1.0) * STEPS as f32;
            let below = at as usize;
            curve[below] + (curve[below + 1] - curve[below]) * (at - below as f32)
        };
        let width = part.size[0] as usize;
        let mut texels = vec![[0.0, 0.0, 0.0, 1.0]; width * part.size[1] as usize];
        let row = |(y, texels): (usize, &mut [[f32; 4]]), codes: &mut Vec<[f32; 3]>| {
            self.row(part, y as u32, codes);
            for (texel, codes) in texels.iter_mut().zip(codes.iter()) {
                let color = space.rec709(Vec3::from(codes.map(linear)));
                *texel = color.extend(1.0).to_array();
            }
        };
        texels.par_chunks_mut(width.max(1)).enumerate().for_each_init(Vec::new, |codes, y_row| row(y_row, codes));
        let ldr = space.transfer.saturates_at_one();
        ColorImage { size: part.size, texels, ldr, taken: None, notes: Vec::new() }
    }

    /// The whole frame as an image file would hold it, with sRGB's meaning or its own.
    pub fn image(&self) -> FileImage {
        let part = Part { from: [0, 0], size: self.size };
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

    #[test]
    fn formats_hold_what_is_stored() {
        for (stored, name) in [
            ("yuv420p", "yuv420p"),
            ("nv12", "yuv420p"),
            ("p010le", "yuv420p10le"),
            ("yuva444p10be", "yuv444p10le"),
            ("gbrap16le", "gbrp16le"),
            ("rgb24", "gbrp"),
            ("pal8", "gbrp"),
            ("gray10le", "gray10le"),
        ] {
            assert_eq!(Format::of(stored).name(), name, "{stored}");
        }
        assert_eq!(Format::of("yuv420p").frame_bytes([5, 3]), 15 + 2 * 6);
    }

    #[test]
    fn limited_codes_span_the_range() {
        let tags = Tags::new(Matrix::Bt709, false, None, None, Siting::LEFT).expect("known");
        let format = Format::of("yuv444p");
        let bytes = [16, 235, 126, 128, 128, 128, 128, 128, 128];
        let planes = Planes { size: [3, 1], format, tags: &tags, bytes: &bytes };
        let part = Part { from: [0, 0], size: [3, 1] };
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
            planes.chroma_row(1, Part { from: [0, 0], size: [4, 1] }, 0)
        };
        assert_eq!(row(Siting::LEFT), [100.0, 150.0, 200.0, 150.0]);
        assert_eq!(row(Siting::CENTER), [125.0, 125.0, 175.0, 175.0]);
    }
}
