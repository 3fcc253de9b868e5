//! How a video's codes are stored, and what they mean: format, matrix, range, curve, siting of chroma.

use crate::{
    Error, Result,
    image_file::color_space::{ColorSpace, Transfer},
};
use glam::Vec3;
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

    /// The format that a user names, without the order of bytes.
    ///
    /// # Errors
    /// Fails if there is none of this name.
    pub fn asked(name: &str) -> Result<Self> {
        let known = Self::named(name).or_else(|| Self::named(&format!("{name}le"))).map(|format| format.of_any_range());
        let remedy = "give for example yuv420p, yuv422p10 or gbrp";
        known.ok_or_else(|| Error::input("--pix-fmt", format!("\"{name}\" is not known"), remedy))
    }

    /// The same without saying that its range is full.
    pub fn of_any_range(self) -> Self {
        Self::named(&self.name.replace("yuvj", "yuv")).unwrap_or(self)
    }

    /// What of pictures in this format gets lost in another: the kind, bits, and chroma; then what is more than is needed.
    pub fn lost_in(&self, other: &Self) -> [u32; 5] {
        let fewer = |a: [u32; 2], b: [u32; 2]| a[0].saturating_sub(b[0]) + a[1].saturating_sub(b[1]);
        let kind = match other.kind {
            kind if kind == self.kind => 0,
            Kind::Gray => 2,
            Kind::Yuv | Kind::Gbr => 1,
        };
        let [less, more] = [self.bits.saturating_sub(other.bits), other.bits.saturating_sub(self.bits)];
        [kind, less, fewer(other.sub, self.sub), more, fewer(self.sub, other.sub)]
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
    pub fn planes(&self, size: [u32; 2]) -> Vec<[usize; 2]> {
        let count = if self.kind == Kind::Gray { 1 } else { 3 };
        (0..count).map(|index| self.plane(size, index).1).collect()
    }

    /// Where a plane begins, counted in codes, and its width and height.
    pub fn plane(&self, [width, height]: [u32; 2], index: usize) -> (usize, [usize; 2]) {
        let whole = [width as usize, height as usize];
        let chroma = [width.div_ceil(1 << self.sub[0]) as usize, height.div_ceil(1 << self.sub[1]) as usize];
        let other = if self.kind == Kind::Yuv { chroma } else { whole };
        let area = |[width, height]: [usize; 2]| width * height;
        if index == 0 { (0, whole) } else { (area(whole) + (index - 1) * area(other), other) }
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

    /// What Cb and Cr of 1 add to R'G'B'.
    pub fn columns(self) -> [Vec3; 2] {
        let [kr, kb] = self.weights();
        let (red, blue, kg) = (2.0 * (1.0 - kr), 2.0 * (1.0 - kb), 1.0 - kr - kb);
        [Vec3::new(0.0, -kb * blue / kg, blue), Vec3::new(red, -kr * red / kg, 0.0)]
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
}
