//! `display`: an image of the renderer as a window shows it. It is no part of the frame or of any file.

use super::resources::{Kernel, Resources};
use crate::{
    Result,
    gpu::{Bind, Format, Frame, Gpu, Image, Threads},
    gpu_struct,
    image_file::tonemap::Tonemap,
    shaders,
};

/// What the numbers of an image mean, which decides how they are shown.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Meaning {
    /// Radiance, shown as sRGB of exposure times the value.
    Radiance,
    /// A unit vector.
    Direction,
    /// A position in metres.
    Place,
    /// The motion to the previous frame, pixels.
    Motion,
    /// The number of an object.
    Id,
    /// A fraction from 0 to 1.
    Share,
    /// Which pixels were traced.
    Mask,
    /// The number of accumulated frames.
    History,
    /// The triangle that was hit.
    Code,
    /// The difference of two pictures as they are displayed.
    Difference,
}

impl Meaning {
    /// The meaning of an AOV, from its name.
    pub fn of(aov: &str) -> Self {
        let stem = aov.strip_suffix("_real").or(aov.strip_suffix("_virtual")).unwrap_or(aov);
        match stem {
            "normal" => Self::Direction,
            "position" => Self::Place,
            "motion" => Self::Motion,
            "object_id" => Self::Id,
            "hit" => Self::Code,
            "mask" => Self::Mask,
            "frames" => Self::History,
            _ if aov == "real_coverage" => Self::Share,
            _ => Self::Radiance,
        }
    }

    /// Explains the colours in words.
    pub const fn legend(self) -> &'static str {
        match self {
            Self::Radiance => "colour: sRGB of exposure · value, clipped",
            Self::Direction => "red, green, blue: x, y, z from −1 to 1; black: nothing there",
            Self::Place => {
                "red, green, blue: x, y, z, each from 0 to 1 within a metre, from the capture point; black: nothing there"
            }
            Self::Motion => {
                "red, green: where it was in the previous frame, ±16 pixels to the right and down; grey: still"
            }
            Self::Id => "a colour for each instance; dark grey: the real scene",
            Self::Share => "black 0, white 1",
            Self::Mask => "white: traced; grey: filled in; black: nothing to light",
            Self::History => "frames accumulated: from blue, 0, over green to white, 64 and more",
            Self::Code => "a colour for each triangle; dark grey: no object",
            Self::Difference => {
                "|A − B| of displayed values, mean over colours: from blue, 0, over green to white, 0.25 and more"
            }
        }
    }
}

impl Meaning {
    /// What the two ends of the scale stand for, if numbers are shown as colours on a scale.
    pub const fn scale(self) -> Option<[&'static str; 2]> {
        match self {
            Self::Share => Some(["0", "1"]),
            Self::History => Some(["0 frames", "64 and more"]),
            Self::Difference => Some(["0", "0.25 and more"]),
            _ => None,
        }
    }

    /// The colour at the place `x` of the scale, as `display.comp` has it, in sRGB codes. All
    /// numbers are from 0 to 1.
    pub fn color(self, x: f32) -> [f32; 3] {
        if self == Self::Share {
            return [x; 3];
        }
        [2.2 * x - 0.7, 1.5 * x, 0.25 + 1.2 * x * (1.0 - x) + (4.0 * x - 3.0).max(0.0)].map(|c| c.clamp(0.0, 1.0))
    }
}

gpu_struct! {
    /// Push constants of `display.comp`.
    pub struct Push {
        pub size: [u32; 2],
        pub look: u32,
        pub layer: u32,
        pub values: u32,
        pub brief: u32,
        pub light_scales: [f32; 2],
        pub exposure: f32,
        pub tonemap: u32,
        pub raised: f32,
        pub scale: f32,
        pub marks: u32,
    }
}

/// How an image holds values.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Values {
    /// As they are.
    Floats,
    /// As a of packed light.
    A,
    /// As b of packed light.
    B,
    /// As the sum of a and b.
    Sum,
    /// Packed, so that `geometry` makes an image of them: a position,
    Position,
    /// a normal and roughness,
    Normal,
    /// a motion,
    Motion,
    /// the number of an object.
    Object,
    /// As a colour in a word.
    Color,
}

impl Values {
    /// Whether the pass `geometry` unpacks them.
    pub const fn is_geometry(self) -> bool {
        matches!(self, Self::Position | Self::Normal | Self::Motion | Self::Object)
    }
}

/// Where the values of an AOV are on the device.
#[derive(Clone, Debug)]
pub struct Source {
    pub image: Image,
    /// Its layer.
    pub layer: u32,
    /// How it holds them.
    pub values: Values,
    /// Whether packed light is in brief (`light_code.glsl`).
    pub brief: bool,
    /// Factors on a and b of packed light.
    pub scales: [f32; 2],
}

/// What to show, and how.
#[derive(Clone)]
pub struct Input<'a> {
    /// Where the values are.
    pub source: Source,
    /// The picture that it is compared with.
    pub other: Option<&'a Image>,
    /// What the numbers mean.
    pub look: Meaning,
    /// The factor on radiance.
    pub exposure: f32,
    /// How light beyond white is shown.
    pub tonemap: Tonemap,
    /// The panorama's `inverse_tonemap` and exposure, which are undone for display.
    pub raised: [f32; 2],
    /// Pixels where this is not 0 are marked.
    pub marked: Option<&'a Image>,
}

/// The pass that turns an image into colours to look at.
pub struct Display {
    kernel: Kernel,
    /// Bound in place of inputs that are missing.
    nothing: [Image; 2],
}

impl Display {
    pub fn new(gpu: &Gpu) -> Result<Self> {
        let nothing = |format| gpu.image("nothing shown", [1, 1], 1, 1, format);
        Ok(Self {
            kernel: Kernel::new::<Push>(gpu, "display", shaders::DISPLAY, &[])?,
            nothing: [nothing(Format::Rgba32f)?, nothing(Format::Rgba32u)?],
        })
    }

    /// Makes an image that [`Display::record`] can write.
    pub fn picture(gpu: &Gpu, size: [u32; 2]) -> Result<Image> {
        gpu.image("shown picture", size, 1, 1, Format::Rgba8)
    }

    pub fn record(&self, frame: &mut Frame, input: &Input, picture: &Image) -> Result<()> {
        let [floats, codes] = &self.nothing;
        let Source { ref image, layer, values, brief, scales } = input.source;
        let is_code = input.look == Meaning::Code || values != Values::Floats;
        let push = Push {
            size: picture.size(),
            look: input.look as u32,
            layer,
            values: values as u32,
            brief: u32::from(brief),
            light_scales: scales,
            exposure: input.exposure,
            tonemap: input.tonemap as u32,
            raised: input.raised[0],
            scale: input.raised[1].max(1e-9),
            marks: u32::from(input.marked.is_some()),
        };
        let special = [
            ("in_image", Bind::from(if is_code { floats } else { image })),
            ("in_other", Bind::from(input.other.unwrap_or(floats))),
            ("in_codes", Bind::from(if is_code { image } else { codes })),
            ("in_marked", Bind::from(input.marked.unwrap_or(floats))),
            ("out_picture", Bind::from(picture)),
        ];
        let [width, height] = push.size;
        self.kernel.dispatch(frame, &special, &[&Resources::default()], &push, Threads::Size([width, height, 1]))
    }
}
