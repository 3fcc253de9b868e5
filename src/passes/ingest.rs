//! `ingest`, once per video frame: radiance of a video's codes, as `panorama::codes` makes it.

use super::{
    panorama::{Panorama, angles},
    resources::{Kernel, Resources},
};
use crate::{
    Result,
    gpu::{Bind, Buffer, Constant, Format, Frame, Gpu, Image, Threads},
    gpu_struct,
    media::{format::Kind, planes::Curve},
    panorama::{
        clipped::MOST_GROUPS,
        codes::{self, Coding},
        tone,
    },
    shaders,
};
use glam::Vec3;

/// Words in a row of the image of codes, and steps in a row of the curve's.
const ROW: usize = 4096;

gpu_struct! {
    /// `Meaning` in `ingest.comp`: where a part's codes are, and what they mean.
    pub struct Meaning {
        pub from: [u32; 2],
        pub size: [u32; 2],
        pub planes: [u32; 3],
        pub strides: [u32; 2],
        pub chroma_from: [u32; 2],
        pub chroma_size: [u32; 2],
        pub sub: [u32; 2],
        pub shift: [u32; 2],
        pub luma: [f32; 2],
        pub chroma: [f32; 2],
        pub of_cb: Vec3,
        pub of_cr: Vec3,
        pub red: Vec3,
        pub green: Vec3,
        pub blue: Vec3,
        pub knee: f32,
        pub bend: f32,
        pub exposure: f32,
        pub clipped: f32,
        pub raised: u32,
    }
}

gpu_struct! {
    /// `Raised` in `ingest.comp`: a clipped lamp, and by what its radiance is multiplied.
    pub struct Raised {
        pub direction: Vec3,
        pub reach: f32,
        pub factor: f32,
    }
}

/// The codes of a frame on the device, and what they mean.
#[derive(Clone)]
pub struct Codes {
    words: Image,
    curve: Image,
    angles: Image,
    meaning: Buffer,
}

const MEANING_BYTES: u64 = (size_of::<Meaning>() + MOST_GROUPS * size_of::<Raised>()) as u64;

fn rows(words: usize) -> u32 {
    words.div_ceil(ROW) as u32
}

/// The size of the image of angles: a row for columns, and one for rows and both poles. Only lamps' directions need it.
fn angles_size(coding: Coding, [width, height]: [u32; 2]) -> [u32; 2] {
    if coding.raised { [width.max(height + 2), 2] } else { [1, 2] }
}

/// Bytes on the device for frames of this coding.
pub fn bytes(coding: Coding, color_size: [u32; 2]) -> u64 {
    let image = |[width, height]: [u32; 2], format: Format| u64::from(width) * u64::from(height) * format.bytes();
    image([ROW as u32, rows(coding.bytes.div_ceil(4))], Format::R32u)
        + image([ROW as u32, rows(Curve::STEPS + 1)], Format::Rg32f)
        + image(angles_size(coding, color_size), Format::Rg32f)
        + MEANING_BYTES
}

impl Codes {
    /// Allocates for frames of this coding.
    pub fn new(gpu: &Gpu, coding: Coding, color_size: [u32; 2]) -> Result<Self> {
        let image = |name, size, format| gpu.image(name, size, 1, 1, format);
        let size = angles_size(coding, color_size);
        let directions = image("texel angles", size, Format::Rg32f)?;
        if coding.raised {
            gpu.write_image(&directions, 0, 0, &angles(color_size, 0.0, size[0]))?;
        }
        Ok(Self {
            words: image("panorama codes", [ROW as u32, rows(coding.bytes.div_ceil(4))], Format::R32u)?,
            curve: image("transfer curve", [ROW as u32, rows(Curve::STEPS + 1)], Format::Rg32f)?,
            angles: directions,
            meaning: gpu.buffer("meaning of codes", MEANING_BYTES)?,
        })
    }

    /// Records the upload of a frame's codes.
    pub fn upload(&self, frame: &mut Frame, codes: &codes::Codes) -> Result<()> {
        let whole = |image: &Image| image.size().map(|side| side as usize).iter().product::<usize>();
        let mut bytes = codes.frame().to_vec();
        bytes.resize(4 * whole(&self.words), 0);
        frame.write_image(&self.words, 0, 0, &bytes)?;
        let mut curve: Vec<[f32; 2]> = codes.curve().0.windows(2).map(|two| [two[0], two[1] - two[0]]).collect();
        curve.resize(whole(&self.curve), [0.0; 2]);
        frame.write_image(&self.curve, 0, 0, &curve)?;
        let (meaning, raised) = meaning(codes);
        frame.write_buffer(&self.meaning, 0, &[bytemuck::bytes_of(&meaning), bytemuck::cast_slice(&raised)].concat())
    }
}

fn meaning(codes: &codes::Codes) -> (Meaning, Vec<Raised>) {
    let (planes, part) = (codes.planes(), codes.part());
    let (format, size) = (planes.format, planes.size);
    let yuv = format.kind == Kind::Yuv;
    // Other kinds have no chroma.
    let start = |index: usize| format.plane(size, index).0 as u32;
    let count = if format.kind == Kind::Gray { 1 } else { 3 };
    let chroma = [0, 1].map(|axis| planes.chroma_range(part, axis));
    let [luma, chroma_scale] = planes.scales();
    let [of_cb, of_cr] = planes.tags.matrix.columns();
    let matrix = codes.matrix();
    let lamps = codes.clipped().map_or(&[][..], |(clipped, _)| &clipped.lamps);
    let raised: Vec<Raised> = lamps
        .iter()
        .map(|lamp| Raised { direction: Vec3::from(lamp.direction), reach: lamp.reach(), factor: lamp.factor })
        .collect();
    let meaning = Meaning {
        from: part.from,
        size: part.size,
        planes: [0, 1, 2].map(|index| if index < count { start(index) } else { 0 }),
        strides: [size[0], if yuv { format.plane(size, 1).1[0] as u32 } else { size[0] }],
        chroma_from: chroma.map(|(first, _)| first as u32),
        chroma_size: chroma.map(|(_, count)| count as u32),
        sub: format.sub,
        shift: [0, 1].map(|axis| planes.shift(axis) as u32),
        luma,
        chroma: chroma_scale,
        of_cb,
        of_cr,
        red: matrix.row(0),
        green: matrix.row(1),
        blue: matrix.row(2),
        knee: tone::KNEE,
        bend: tone::bend(codes.expansion()),
        exposure: codes.exposure(),
        clipped: codes.clipped().map_or(f32::MAX, |(_, least)| *least),
        raised: raised.len() as u32,
    };
    (meaning, raised)
}

pub struct Ingest {
    kernel: Kernel,
    /// Is bound instead of an image of the format that the panorama does not have.
    other: Image,
}

impl Ingest {
    /// `halves` says whether the panorama is of 16-bit floats.
    pub fn new(gpu: &Gpu, Coding { format, raised, .. }: Coding, halves: Constant) -> Result<Self> {
        let kind = ("KIND", format.kind as u32);
        let code_bytes = ("CODE_BYTES", format.code_bytes() as u32);
        let constants = [kind, code_bytes, ("RAISED", u32::from(raised)), halves];
        let other = if halves.1 == 0 { Format::Rgba16f } else { Format::Rgba32f };
        Ok(Self {
            kernel: Kernel::new::<()>(gpu, "ingest", shaders::INGEST, &constants)?,
            other: gpu.image("no panorama radiance", [1, 1], 1, 1, other)?,
        })
    }

    pub fn record(&self, frame: &mut Frame, panorama: &Panorama) -> Result<()> {
        let (codes, radiance) = (panorama.codes()?, panorama.radiance());
        let (own, other) = (radiance.level(0), self.other.level(0));
        let (whole, half) = if radiance.format() == Format::Rgba32f { (own, other) } else { (other, own) };
        let special = [
            ("in_words", Bind::from(&codes.words)),
            ("in_curve", Bind::from(&codes.curve)),
            ("in_texel_angles", Bind::from(&codes.angles)),
            ("in_meaning", Bind::from(&codes.meaning)),
            ("out_panorama_radiance", whole),
            ("out_half_radiance", half),
        ];
        let [width, height] = panorama.color_size;
        self.kernel.dispatch(frame, &special, &[&Resources::default()], &(), Threads::Size([width, height, 1]))
    }
}
