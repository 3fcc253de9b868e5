//! The colours of a video frame as the codes that they came in. The device makes radiance of them (`passes::ingest`), and
//! whoever asks for a texel here gets it made as the device makes it.

use super::{
    clipped::Clipped,
    mapping::texel_direction,
    source::{Packing, PanoramaSpec},
    texels::Texels,
    tone,
};
use crate::media::{
    VideoInfo,
    format::{Format, Kind, Matrix},
    planes::{Curve, Part, Planes},
};
use glam::{Mat3, Vec3};
use rayon::prelude::*;
use std::sync::{Arc, OnceLock};

/// A frame's codes, and what they mean.
#[derive(Clone, Debug)]
pub struct Codes {
    info: Arc<VideoInfo>,
    bytes: Arc<Vec<u8>>,
    part: Part,
    curve: Curve,
    /// What a saturated texel becomes before the exposure ([`tone::expand`]), and the exposure.
    expansion: f32,
    exposure: f32,
    /// How much brighter clipped texels are than they show, and how bright they show at least.
    clipped: Option<(Clipped, f32)>,
    /// All texels, once anybody has asked for all.
    made: OnceLock<Box<Texels>>,
}

/// The most bytes of a frame: more do not fit the image of words that `passes::ingest` reads.
const MOST_BYTES: usize = 1 << 28;

/// What all frames of a video have in common, as codes.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Coding {
    pub format: Format,
    /// Bytes of a frame.
    pub bytes: usize,
    /// Whether clipped texels are brighter than they show.
    pub raised: bool,
}

impl Codes {
    /// Says whether frames of a video are kept as codes: nothing else is done to their colours than what [`Codes`] does.
    pub fn serve(info: &VideoInfo, spec: &PanoramaSpec) -> bool {
        let changed = spec.mask.is_some() || spec.cubes[0] || spec.pitch_degrees != 0.0 || spec.roll_degrees != 0.0;
        let size = match spec.packing {
            Packing::TopBottom => [info.size[0], info.size[1] / 2],
            Packing::LeftRight => [info.size[0] / 2, info.size[1]],
            Packing::Separate => info.size,
        };
        // Chroma planes that hold red and blue are rare.
        let plain = info.format.kind != Kind::Yuv || info.tags.matrix != Matrix::Rgb;
        let fits = info.format.frame_bytes(info.size) <= MOST_BYTES;
        plain && fits && !changed && super::reduce::reduced(size).is_none()
    }

    pub fn new(info: Arc<VideoInfo>, bytes: Arc<Vec<u8>>, part: Part, spec: &PanoramaSpec) -> Self {
        let transfer = &info.tags.space.transfer;
        let expansion = if transfer.saturates_at_one() { spec.inverse_tonemap } else { 1.0 };
        let curve = Curve::of(transfer);
        let made = OnceLock::new();
        Self { curve, info, bytes, part, expansion, exposure: spec.exposure, clipped: None, made }
    }

    /// Says whether the largest code is where the camera saturates.
    pub fn is_ldr(&self) -> bool {
        self.info.tags.space.transfer.saturates_at_one()
    }

    pub fn coding(&self) -> Coding {
        Coding { format: self.info.format, bytes: self.bytes.len(), raised: self.clipped.is_some() }
    }

    /// The codes of the whole frame, plane after plane.
    pub fn frame(&self) -> &[u8] {
        &self.bytes
    }

    /// The planes that they are in.
    pub fn planes(&self) -> Planes<'_> {
        self.info.planes(&self.bytes)
    }

    /// Which part of the planes they are.
    pub fn part(&self) -> Part {
        self.part
    }

    /// The curve that makes R'G'B' linear.
    pub fn curve(&self) -> &Curve {
        &self.curve
    }

    /// The matrix from linear colours to Rec. 709.
    pub fn matrix(&self) -> Mat3 {
        self.info.tags.space.to_rec709.unwrap_or(Mat3::IDENTITY)
    }

    pub fn expansion(&self) -> f32 {
        self.expansion
    }

    pub fn exposure(&self) -> f32 {
        self.exposure
    }

    /// The clipped lamps, and how bright a texel is at least that belongs to one.
    pub fn clipped(&self) -> Option<&(Clipped, f32)> {
        self.clipped.as_ref()
    }

    /// Makes texels that show at least `least` brighter than they show.
    pub fn raise(&mut self, clipped: &Clipped, least: f32) {
        self.clipped = Some((clipped.clone(), least));
        self.made = OnceLock::new();
    }

    pub fn count(&self) -> usize {
        self.part.size[0] as usize * self.part.size[1] as usize
    }

    /// The radiance of R'G'B', with alpha, at a texel.
    fn shown(&self, codes: Vec3, index: usize) -> [f32; 4] {
        let linear = Vec3::from(codes.to_array().map(|code| self.curve.linear(code)));
        let color = self.matrix() * linear;
        let shown = (tone::expand(color, self.expansion) * self.exposure).min(Vec3::splat(f32::MAX));
        let factor = self.clipped.as_ref().filter(|(_, least)| shown.max_element() >= *least).map(|(clipped, _)| {
            let [width, _] = self.part.size;
            clipped.factor(texel_direction(index as u32 % width, index as u32 / width, self.part.size).as_vec3())
        });
        shown.extend(factor.unwrap_or(1.0)).to_array()
    }

    /// One texel.
    pub fn at(&self, index: usize) -> [f32; 4] {
        match self.made.get() {
            Some(made) => made.at(index),
            None => {
                let (x, y) = (index as u32 % self.part.size[0], index as u32 / self.part.size[0]);
                Texels::rounded(self.shown(self.planes().pixel(self.part, [x, y]), index), self.count())
            }
        }
    }

    /// All texels. They are made when this is first asked for.
    pub fn all(&self) -> &Texels {
        self.made.get_or_init(|| {
            let (width, planes) = (self.part.size[0] as usize, self.planes());
            let mut all = Texels::blank(self.count());
            all.change(|first, texels| {
                // A piece may begin within a row.
                let row = |(number, texels): (usize, &mut [[f32; 4]])| {
                    let from = first + number * width;
                    let mut codes = Vec::new();
                    for (offset, texel) in texels.iter_mut().enumerate() {
                        let index = from + offset;
                        if codes.is_empty() || index % width == 0 {
                            planes.row(self.part, (index / width) as u32, &mut codes);
                        }
                        *texel = self.shown(Vec3::from(codes[index % width]), index);
                    }
                };
                texels.par_chunks_mut(width.max(1)).enumerate().for_each(row);
            });
            Box::new(all)
        })
    }

    /// Says whether all texels are made.
    pub fn are_made(&self) -> bool {
        self.made.get().is_some()
    }

    /// Bytes that they take in memory.
    pub fn bytes(&self) -> usize {
        self.bytes.len() + self.made.get().map_or(0, |all| all.bytes().len())
    }

    /// The numbers, in order, of the texels of which a channel, times alpha, may be more than `least`. Few others are among
    /// them.
    pub fn maybe_brighter(&self, least: f32) -> Vec<u32> {
        let matrix = self.matrix();
        let gain = (0..3).map(|row| matrix.row(row).max(Vec3::ZERO).element_sum()).fold(0.0, f32::max);
        let most = |code: &f32| (tone::expand(Vec3::splat(gain * code), self.expansion) * self.exposure).x;
        let raised = self.clipped.as_ref().map_or(f32::INFINITY, |(_, least)| *least);
        // Curves rise. A step is left for rounding.
        let dark = self.curve.0.partition_point(|value| most(value) <= least.min(raised)).saturating_sub(2);
        let from = dark as f32 / Curve::STEPS as f32;
        let (planes, width) = (self.planes(), self.part.size[0]);
        let row = |y: u32| {
            let bounds = planes.bounds(self.part, y);
            bounds.into_iter().zip(y * width..).filter(|(most, _)| *most >= from).map(|(_, at)| at).collect::<Vec<_>>()
        };
        (0..self.part.size[1]).into_par_iter().flat_map_iter(row).collect()
    }
}
