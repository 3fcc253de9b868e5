//! Loads panorama frames from image files, from image sequences, from videos or from memory.

use super::{
    clipped::{self, Clipped},
    depth::{Quantisation, Rule, box_depth, length_words, unit_warning},
    level::Levelling,
    pattern::Pattern,
    stream::{Pick, Plan, Stream, Track},
    tone,
};
use crate::{
    Error, Result,
    image_file::{CodeImage, ColorImage, FileImage, Raster, Samples, layers::Taken, read, srgb::srgb_to_linear},
    media::{
        VideoInfo,
        film::SourceCodes,
        planes::{Part, Planes},
    },
};
use glam::Vec3;
use rayon::prelude::*;
use std::{
    path::PathBuf,
    sync::{Arc, OnceLock},
};

/// One equirectangular frame. Row 0 is towards +Y.
#[derive(Clone, Debug, Default)]
pub struct PanoramaFrame {
    /// Width and height of `radiance`.
    pub color_size: [u32; 2],
    /// Linear Rec. 709, finite and ≥ 0. Exposure and inverse tone mapping are applied. Alpha is by how much
    /// more a texel shines than it shows: 1, or the factor of a clipped lamp.
    pub radiance: Vec<[f32; 4]>,
    /// The radiance at which the capture clips; `None` if it does not.
    pub white: Option<f32>,
    /// Width and height of `depth`. They may differ from the colour's.
    pub depth_size: [u32; 2],
    /// Radial metres; 0 is a hole.
    pub depth: Vec<f32>,
    /// The spacing of the depth's codes.
    pub quantisation: Quantisation,
    /// What was mended, or is unusual, in these files.
    pub warnings: Vec<String>,
    /// Which channels of an EXR hold the colour and the depth, and what else there was.
    pub taken: [Option<String>; 2],
}

/// The source of depth.
#[derive(Clone, Debug, PartialEq)]
pub enum DepthSource {
    /// The path of an image or of a video, or a pattern.
    Files(PathBuf),
    /// A sphere of this radius, metres.
    Sphere(f32),
    /// A box of the world seen from inside, with its full extents and centre in metres.
    Box { size: Vec3, center: Vec3 },
    /// Depth is the second half of the colour image.
    Packed,
}

/// How colour and depth share an image. Colour comes first.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Packing {
    Separate,
    TopBottom,
    LeftRight,
}

/// The frames `first`, `first + step`, … up to and including `last`.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct FrameRange {
    pub first: u32,
    pub last: u32,
    pub step: u32,
}

/// The table `[panorama]` of a scene file.
#[derive(Clone, Debug, PartialEq)]
pub struct PanoramaSpec {
    /// The path of an image or of a video, or a pattern.
    pub color: PathBuf,
    /// The layer of an EXR that holds the colour; by default the one whose name means colour.
    pub color_layer: Option<String>,
    pub depth: DepthSource,
    /// An image that is dark where nothing is known; a path or a pattern.
    pub mask: Option<PathBuf>,
    /// Degrees by which the picture is turned before its yaw, so that its floor is level: about +X, after
    /// that about +Z.
    pub pitch_degrees: f32,
    pub roll_degrees: f32,
    /// The layer or channel of an EXR that holds the depth; by default the one whose name means depth.
    pub depth_layer: Option<String>,
    pub packing: Packing,
    pub frames: Option<FrameRange>,
    /// Frames a second of a sequence.
    pub fps: f64,
    /// The rule that turns depth codes into metres.
    pub rule: Rule,
    /// The capture point in the world, metres.
    pub position: Vec3,
    /// The panorama's turn, right-handed about +Y.
    pub yaw_degrees: f32,
    /// A factor on radiance.
    pub exposure: f32,
    /// The linear value that a saturated LDR texel becomes, before `exposure`. 1 leaves such texels as they
    /// are.
    pub inverse_tonemap: f32,
    /// How bright clipped lamps are.
    pub lamps: LampRule,
}

/// How bright the lamps and windows are that an 8- or 16-bit capture clips.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum LampRule {
    /// As bright as the capture shows.
    AsCaptured,
    /// As bright as the light that they cast says, by the first frame ([`clipped::estimate`]).
    Estimate,
    /// This many times as bright.
    Factor(f32),
}

/// A sequence of panorama frames. Clones share the frames that are loaded.
#[derive(Clone, Debug)]
pub struct PanoramaSource {
    frames: FrameSource,
    /// Frames a second; the mean, if a video's rate varies.
    pub fps: f64,
    /// The capture point in the world, metres.
    pub position: Vec3,
    /// The panorama's turn, right-handed about +Y: world direction = rotate_y(yaw) · panorama direction.
    pub yaw_degrees: f32,
    /// The factor by which saturated LDR texels were raised ([`tone`]). It is undone where the output is LDR.
    pub inverse_tonemap: f32,
    /// How bright clipped lamps are.
    pub lamps: LampRule,
    /// What [`LampRule::Estimate`] found in the first frame.
    clipped: Arc<OnceLock<Clipped>>,
    /// What is unusual about the sequence. Each frame has warnings of its own.
    pub warnings: Vec<String>,
}

#[derive(Clone, Debug)]
enum FrameSource {
    Memory(Arc<Vec<Arc<PanoramaFrame>>>),
    Files(Arc<Stream>),
}

impl PanoramaFrame {
    /// Bytes that it takes in memory.
    pub fn bytes(&self) -> usize {
        size_of_val(&self.radiance[..]) + size_of_val(&self.depth[..])
    }
}

impl PanoramaSource {
    /// Takes frames that were made in memory.
    ///
    /// # Errors
    /// Fails if there is no frame, or if arrays do not fit their sizes.
    pub fn from_frames(frames: Vec<PanoramaFrame>, fps: f64, position: Vec3, yaw_degrees: f32) -> Result<Self> {
        let fits = |size: [u32; 2], len: usize| len > 0 && size[0] as usize * size[1] as usize == len;
        let all_fit = |f: &PanoramaFrame| fits(f.color_size, f.radiance.len()) && fits(f.depth_size, f.depth.len());
        if frames.is_empty() || !frames.iter().all(all_fit) {
            let problem = "no frames, or arrays that do not fit their sizes";
            return Err(Error::input("panorama", problem, "give width × height texels"));
        }
        Ok(Self {
            frames: FrameSource::Memory(Arc::new(frames.into_iter().map(Arc::new).collect())),
            fps,
            position,
            yaw_degrees,
            inverse_tonemap: 1.0,
            lamps: LampRule::Estimate,
            clipped: Arc::default(),
            warnings: Vec::new(),
        })
    }

    /// Returns the factor on radiance that was applied on loading.
    pub fn exposure(&self) -> f32 {
        self.spec().map(|spec| spec.exposure).filter(|exposure| *exposure > 0.0).unwrap_or(1.0)
    }

    /// Returns what the scene file says; `None` for frames that were made in memory.
    pub fn spec(&self) -> Option<&PanoramaSpec> {
        match &self.frames {
            FrameSource::Files(stream) => Some(&stream.plan().spec),
            FrameSource::Memory(_) => None,
        }
    }

    fn plan(&self) -> Option<&Plan> {
        match &self.frames {
            FrameSource::Files(stream) => Some(stream.plan()),
            FrameSource::Memory(_) => None,
        }
    }

    /// Returns the video that the colour comes from, if it does.
    pub fn video(&self) -> Option<&VideoInfo> {
        self.plan()?.color.video().map(Arc::as_ref)
    }

    /// Returns the video that the depth comes from, if it is another one.
    pub fn depth_video(&self) -> Option<&VideoInfo> {
        self.plan()?.depth.as_ref()?.video().map(Arc::as_ref)
    }

    /// Returns the codes of frame `index`, if its colour is a video's and it was loaded a short time ago.
    pub fn codes(&self, index: usize) -> Option<SourceCodes> {
        let FrameSource::Files(stream) = &self.frames else { return None };
        let info = stream.plan().color.video()?;
        let bytes = stream.codes(index.min(self.frame_count() - 1))?;
        let part = match stream.plan().spec.packing {
            Packing::Separate => Part { from: [0, 0], size: info.size },
            packing => {
                let [color, _] = halves(info.size, packing, "video").ok()?;
                Part { from: color.from, size: color.size }
            }
        };
        Some(SourceCodes { info: Arc::clone(info), bytes, part })
    }

    /// Returns frames a second as a fraction.
    pub fn rate(&self) -> [u32; 2] {
        self.plan().map_or_else(|| crate::media::probe::rational(self.fps), |plan| plan.rate)
    }

    /// Returns the number, in the video of its colour, of frame `index`.
    pub fn number_in_video(&self, index: usize) -> Option<usize> {
        let plan = self.plan().filter(|plan| plan.color.video().is_some())?;
        plan.picks.get(index).map(|pick| pick.color as usize)
    }

    /// Returns radiance as an LDR output shows it: what `inverse_tonemap` raised on loading comes down again.
    pub fn for_display(&self, radiance: Vec3) -> Vec3 {
        let exposure = self.exposure();
        if self.inverse_tonemap <= 1.0 {
            return radiance;
        }
        tone::compress(radiance / exposure, self.inverse_tonemap) * exposure
    }

    /// Opens frames that are read from files when they are asked for. Finds the files, but does not read
    /// them.
    ///
    /// # Errors
    /// Fails if a pattern is bad, if there are no frames, or if files are missing.
    pub fn open(spec: PanoramaSpec) -> Result<Self> {
        let tracks = match &spec.depth {
            DepthSource::Files(path) => (Track::open(&spec.color)?, Some(Track::open(path)?)),
            _ => (Track::open(&spec.color)?, None),
        };
        let (position, yaw_degrees) = (spec.position, spec.yaw_degrees);
        let (inverse_tonemap, lamps, clipped) = (spec.inverse_tonemap, spec.lamps, Arc::default());
        let mut warnings = Vec::new();
        let (color, depth) = match tracks {
            (Track::Images(color), None) => (color, None),
            (Track::Images(color), Some(Track::Images(depth))) => (color, Some(depth)),
            (color, depth) => {
                let plan = Plan::of_videos(spec, color, depth, &mut warnings)?;
                let fps = f64::from(plan.rate[0]) / f64::from(plan.rate[1]);
                let frames = FrameSource::Files(Arc::new(Stream::new(plan)));
                return Ok(Self { frames, fps, position, yaw_degrees, inverse_tonemap, lamps, clipped, warnings });
            }
        };
        let sequence = [Some(&color), depth.as_ref()].into_iter().flatten().find(|pattern| pattern.is_sequence());
        let numbers: Vec<u32> = match (spec.frames, sequence) {
            (_, None) => vec![0],
            (Some(range), Some(_)) => (range.first..=range.last).step_by(range.step.max(1) as usize).collect(),
            (None, Some(pattern)) => {
                let numbers = pattern.existing()?;
                if numbers.is_empty() {
                    let name = spec.color.display();
                    return Err(Error::input(
                        name,
                        "no file fits this pattern",
                        "check the pattern or give frames = [a, b]",
                    ));
                }
                over_gaps(&numbers, pattern, &mut warnings)
            }
        };
        for number in &numbers {
            for file in [Some(&color), depth.as_ref()].into_iter().flatten().map(|pattern| pattern.file(*number)) {
                if !file.exists() {
                    return Err(Error::input(file.display(), "there is no such file", "check the name and the frames"));
                }
            }
        }
        let fps = spec.fps;
        let plan = Plan {
            times: (0..numbers.len()).map(|index| index as f64 / fps).collect(),
            picks: numbers.iter().map(|number| Pick { color: *number, depth: *number }).collect(),
            rate: crate::media::probe::rational(fps),
            spec: Arc::new(spec),
            color: Track::Images(color),
            depth: depth.map(Track::Images),
        };
        let frames = FrameSource::Files(Arc::new(Stream::new(plan)));
        Ok(Self { frames, fps, position, yaw_degrees, inverse_tonemap, lamps, clipped, warnings })
    }

    /// Returns the number of frames, at least 1.
    pub fn frame_count(&self) -> usize {
        match &self.frames {
            FrameSource::Memory(frames) => frames.len(),
            FrameSource::Files(stream) => stream.plan().picks.len(),
        }
    }

    /// Returns the frame shown at `time_seconds`: the first before the start, the last after the end.
    pub fn frame_at(&self, time_seconds: f64) -> usize {
        // A frame's own time must give that frame, even after rounding.
        let time = time_seconds + 1e-6 / self.fps;
        match self.plan() {
            Some(plan) => plan.times.partition_point(|start| *start <= time).max(1) - 1,
            None => ((time * self.fps).floor().max(0.0) as usize).min(self.frame_count() - 1),
        }
    }

    /// Returns the time in seconds at which frame `index` starts. Beyond the end it goes on at the mean rate.
    pub fn frame_time(&self, index: usize) -> f64 {
        let Some(plan) = self.plan() else { return index as f64 / self.fps };
        let last = index.min(plan.times.len() - 1);
        plan.times[last] + (index - last) as f64 / self.fps
    }

    /// Loads frame `index`, counted from 0. An index beyond the end gives the last frame. Frames that are equal and
    /// follow each other are the same one.
    ///
    /// # Errors
    /// Fails if a file cannot be read or used.
    pub fn load(&self, index: usize) -> Result<Arc<PanoramaFrame>> {
        let mut frame = self.read(index)?;
        if let Some(white) = frame.white {
            let clipped = self.clipped(&frame, index)?;
            if clipped.raises() {
                clipped.raise(Arc::make_mut(&mut frame), white);
            }
        }
        Ok(frame)
    }

    /// Returns what is known of the clipped lamps. `frame` is frame `index`.
    fn clipped(&self, frame: &PanoramaFrame, index: usize) -> Result<Clipped> {
        Ok(match self.lamps {
            LampRule::AsCaptured => Clipped::default(),
            LampRule::Factor(factor) => Clipped::even(factor),
            LampRule::Estimate => match self.clipped.get() {
                Some(known) => known.clone(),
                None => {
                    let first = if index == 0 { None } else { Some(self.read(0)?) };
                    let first: &PanoramaFrame = first.as_deref().unwrap_or(frame);
                    let found = first.white.map_or_else(Clipped::default, |white| clipped::estimate(first, white));
                    self.clipped.get_or_init(|| found).clone()
                }
            },
        })
    }

    /// Returns the clipped lamps of the first frame and their factors, once a frame was loaded.
    pub fn clipped_lamps(&self) -> Option<&Clipped> {
        self.clipped.get()
    }

    /// Reads a frame, lamps as captured.
    fn read(&self, index: usize) -> Result<Arc<PanoramaFrame>> {
        let index = index.min(self.frame_count() - 1);
        match &self.frames {
            FrameSource::Memory(frames) => Ok(Arc::clone(&frames[index])),
            FrameSource::Files(stream) => {
                let frame = stream.load(index)?;
                crate::warnings::tell(&frame.warnings);
                Ok(frame)
            }
        }
    }
}

/// Fills gaps between the numbers of a sequence, so that each frame keeps its time: in place of a frame that is
/// missing, the one before is held. Numbers that all lie equally far apart have no gaps.
fn over_gaps(numbers: &[u32], pattern: &Pattern, warnings: &mut Vec<String>) -> Vec<u32> {
    let gcd = |mut a: u32, mut b: u32| {
        while b > 0 {
            (a, b) = (b, a % b);
        }
        a
    };
    let step = numbers.windows(2).fold(0, |step, pair| gcd(step, pair[1] - pair[0]));
    let (Some(first), Some(last)) = (numbers.first(), numbers.last()) else { return Vec::new() };
    let frames = (last - first).checked_div(step).map_or(1, |count| count as usize + 1);
    if frames == numbers.len() || frames > MAX_HELD * numbers.len() {
        return numbers.to_vec();
    }
    let mut held = Vec::with_capacity(frames);
    let mut missing = Vec::new();
    for number in (*first..=*last).step_by(step as usize) {
        let known = numbers.partition_point(|known| *known <= number);
        if numbers[known - 1] != number {
            missing.push(pattern.file(number).display().to_string());
        }
        held.push(numbers[known - 1]);
    }
    let (shown, more) =
        (missing.iter().take(8).cloned().collect::<Vec<_>>().join(", "), missing.len().saturating_sub(8));
    let more = if more > 0 { format!(" and {more} more") } else { String::new() };
    warnings.push(format!("{shown}{more}: missing in the sequence; the frame before is held, so that times are kept"));
    held
}

/// A sequence with more missing frames than this for each that is there is numbered by something else.
const MAX_HELD: usize = 100;

/// A picture of colour, of depth or of both, as it was read.
pub(super) enum Picture {
    File { subject: String, image: FileImage },
    Video { subject: String, info: Arc<VideoInfo>, codes: Arc<Vec<u8>> },
}

impl Picture {
    fn subject(&self) -> &str {
        match self {
            Self::File { subject, .. } | Self::Video { subject, .. } => subject,
        }
    }

    /// Returns the colour, and the depth codes if it holds both.
    fn color(self, spec: &PanoramaSpec) -> Result<(ColorImage, Option<CodeImage>)> {
        match self {
            Self::File { subject, image } if spec.packing == Packing::Separate => {
                Ok((image.color_of(spec.color_layer.as_deref(), &subject)?, None))
            }
            Self::File { subject, image } => {
                let (color, codes) = unpack(image, spec.packing, &subject)?;
                Ok((color, Some(codes)))
            }
            Self::Video { subject, info, codes } => {
                no_layer(spec.color_layer.as_deref(), &subject)?;
                let planes = Planes { size: info.size, format: info.format, tags: &info.tags, bytes: &codes };
                if spec.packing == Packing::Separate {
                    return Ok((planes.color(Part { from: [0, 0], size: info.size }), None));
                }
                let [color, depth] = halves(info.size, spec.packing, &subject)?;
                let part = |crop: Crop| Part { from: crop.from, size: crop.size };
                Ok((planes.color(part(color)), Some(planes.codes(part(depth), &subject)?)))
            }
        }
    }

    fn codes(self, layer: Option<&str>) -> Result<CodeImage> {
        match self {
            Self::File { subject, image } => image.codes_of(layer, &subject),
            Self::Video { subject, info, codes } => {
                no_layer(layer, &subject)?;
                let planes = Planes { size: info.size, format: info.format, tags: &info.tags, bytes: &codes };
                planes.codes(Part { from: [0, 0], size: info.size }, &subject)
            }
        }
    }
}

fn no_layer(layer: Option<&str>, subject: &str) -> Result<()> {
    match layer {
        Some(_) => Err(Error::input(subject, "a video has no layers", "leave layer out")),
        None => Ok(()),
    }
}

/// Makes a frame from what was read. `number` is that of a file or of a video's frame, and
/// `is_first` says that it is the first one of the panorama.
pub(super) fn make_frame(
    spec: &PanoramaSpec,
    number: u32,
    is_first: bool,
    color: Picture,
    depth: Option<Picture>,
) -> Result<PanoramaFrame> {
    let subject = color.subject().to_owned();
    let of_video = matches!(color, Picture::Video { .. });
    let mut warnings = Vec::new();
    let (color, packed) = color.color(spec)?;
    let mut taken = [color.taken.as_ref().map(|taken| taken.note("color")), None];
    let mut color = finish_color(color, spec, &subject, &mut warnings)?;

    let rule = &spec.rule;
    let from_codes = |codes: CodeImage| {
        let quantisation = if codes.integer { rule.quantisation() } else { Quantisation::None };
        (codes.size, rule.metres(&codes.codes, codes.size), quantisation)
    };
    if let Some(mask) = &spec.mask {
        let mask = Pattern::parse(mask)?.file(number);
        forget_masked(&mut color, &read::read(&mask)?.into_color(&mask.display().to_string())?);
    }
    let level = Levelling::of(spec);
    if let Some(level) = &level {
        color.texels = level.radiance(color.size, &color.texels);
    }
    let size = color.size;
    let mut depth_subject = subject.clone();
    let (depth_size, mut depth, quantisation) = match (&spec.depth, depth, packed) {
        (DepthSource::Sphere(radius), ..) => (size, vec![*radius; color.texels.len()], Quantisation::None),
        (DepthSource::Box { size: extent, center }, ..) => {
            let depth = box_depth(size, *extent, *center - spec.position, f64::from(spec.yaw_degrees));
            (size, depth, Quantisation::None)
        }
        (DepthSource::Files(_), Some(picture), _) => {
            depth_subject = picture.subject().to_owned();
            let codes = picture.codes(spec.depth_layer.as_deref())?;
            taken[1] = codes.taken.as_ref().map(|taken| taken.note("depth"));
            tell(&codes.notes, codes.taken.as_ref(), "depth", &depth_subject, &mut warnings);
            check_aspect(codes.size, &depth_subject, &mut warnings);
            warnings.extend(coarse(&codes, rule).map(|warning| format!("{depth_subject}: {warning}")));
            from_codes(codes)
        }
        (_, _, Some(codes)) => from_codes(codes),
        _ => return Err(Error::Internal("a panorama without a depth source".into())),
    };
    if let (Some(level), DepthSource::Files(_) | DepthSource::Packed) = (&level, &spec.depth) {
        depth = level.depth(depth_size, &depth);
    }
    // All frames of a video are of one kind, so the first one tells.
    let tells = is_first || !of_video;
    let unknown = forget_unknown(&mut color, depth_size, &mut depth);
    if unknown > 0 {
        let share = 100.0 * unknown as f64 / color.texels.len() as f64;
        let problem = format!("nothing is known of {share:.1} % of its texels: black, and holes in the depth");
        warnings.push(format!("{subject}: {problem}"));
    }
    if depth.iter().all(|metres| *metres == 0.0) {
        let problem = "every depth is a hole; the panorama is treated as infinitely far";
        warnings.push(format!("{depth_subject}: {problem} (check encoding, scale, offset and invalid)"));
    }
    if tells && matches!(spec.depth, DepthSource::Files(_) | DepthSource::Packed) {
        warnings.extend(unit_warning(&depth, rule).map(|warning| format!("{depth_subject}: {warning}")));
    }
    let white = color.ldr.then(|| tone::expand(Vec3::ONE, spec.inverse_tonemap).x * spec.exposure);
    Ok(PanoramaFrame {
        color_size: size,
        radiance: color.texels,
        white,
        depth_size,
        depth,
        quantisation,
        warnings,
        taken,
    })
}

/// Passes on what is unusual about a file, and which channels were taken if that is in doubt.
fn tell(notes: &[String], taken: Option<&Taken>, key: &str, subject: &str, warnings: &mut Vec<String>) {
    let doubt = taken.filter(|taken| taken.unsure).map(|taken| taken.note(key));
    warnings.extend(notes.iter().chain(&doubt).map(|note| format!("{subject}: {note}")));
}

/// Warns of depth in 8 bits, which is usually a preview.
fn coarse(codes: &CodeImage, rule: &Rule) -> Option<String> {
    let bits8 = codes.integer && codes.codes.iter().all(|code| code.is_nan() || *code <= 255.0);
    let Quantisation::Radial { step } = rule.quantisation() else { return None };
    (bits8 && step > 0.01).then(|| {
        let step = length_words(step);
        format!("has 8 bits, so that depth comes in steps of {step}; give the 16-bit or float output of what made it")
    })
}

/// Marks texels as unknown where a mask is dark.
fn forget_masked(color: &mut ColorImage, mask: &ColorImage) {
    let [width, height] = color.size.map(|side| side as usize);
    let place = |at: usize, from: usize, to: u32| (2 * at + 1) * to as usize / (2 * from);
    for (index, texel) in color.texels.iter_mut().enumerate() {
        let (x, y) = (place(index % width, width, mask.size[0]), place(index / width, height, mask.size[1]));
        let [r, g, b, known] = mask.texels[y * mask.size[0] as usize + x];
        if known == 0.0 || r + g + b < 1.5 * srgb_to_linear(0.5) {
            texel[3] = 0.0;
        }
    }
}

/// Makes texels of which nothing is known black, and holes in the depth. Returns how many there are.
fn forget_unknown(color: &mut ColorImage, depth_size: [u32; 2], depth: &mut [f32]) -> usize {
    let [width, height] = color.size.map(|side| side as usize);
    let unknown: Vec<bool> = color.texels.iter().map(|texel| texel[3] == 0.0).collect();
    let count = unknown.iter().filter(|unknown| **unknown).count();
    if count > 0 {
        let columns = depth_size[0] as usize;
        for (index, metres) in depth.iter_mut().enumerate() {
            let column = (index % columns * 2 + 1) * width / (2 * columns);
            let row = (index / columns * 2 + 1) * height / (2 * depth_size[1] as usize);
            if unknown[row * width + column] {
                *metres = 0.0;
            }
        }
        for texel in color.texels.iter_mut().filter(|texel| texel[3] == 0.0) {
            *texel = [0.0, 0.0, 0.0, 1.0];
        }
    }
    count
}

fn check_aspect(size: [u32; 2], subject: &str, warnings: &mut Vec<String>) {
    let [width, height] = size.map(u64::from);
    if width != 2 * height {
        warnings.push(format!("{subject}: is {width}x{height}, but a full panorama is twice as wide as high"));
    }
}

/// Mends bad texels, raises saturated ones, and applies the exposure.
fn finish_color(
    mut color: ColorImage,
    spec: &PanoramaSpec,
    subject: &str,
    warnings: &mut Vec<String>,
) -> Result<ColorImage> {
    check_aspect(color.size, subject, warnings);
    tell(&color.notes, color.taken.as_ref(), "color", subject, warnings);
    // Half precision overflows to infinity, so that is what was brightest.
    let finite = |texel: &[f32; 4]| texel[..3].iter().copied().filter(|value| value.is_finite()).fold(0.0, f32::max);
    let brightest = color.texels.par_iter().map(finite).reduce(|| f32::from(half::f16::MAX), f32::max);
    let (ldr, texels) = (color.ldr, &mut color.texels);
    let mended = |texel: &mut [f32; 4]| -> [usize; 3] {
        if texel[3] <= 0.0 {
            return [0; 3];
        }
        let rgb = [texel[0], texel[1], texel[2]];
        let (overflowed, negative) = (rgb.contains(&f32::INFINITY), rgb.iter().any(|value| *value < 0.0));
        let mut radiance = Vec3::from(rgb.map(|value| if value == f32::INFINITY { brightest } else { value.max(0.0) }));
        if ldr {
            radiance = tone::expand(radiance, spec.inverse_tonemap);
        }
        // The product must stay finite, too.
        let [r, g, b] = (radiance * spec.exposure).min(Vec3::splat(f32::MAX)).to_array();
        *texel = [r, g, b, 1.0];
        [1, usize::from(overflowed), usize::from(negative)]
    };
    let sum = |a: [usize; 3], b: [usize; 3]| std::array::from_fn(|i| a[i] + b[i]);
    let [known, overflowed, negative] = texels.par_iter_mut().map(mended).reduce(|| [0; 3], sum);
    if known == 0 {
        return Err(Error::input(subject, "holds no finite pixel", "write the image again"));
    }
    if negative > 0 {
        warnings.push(format!("{subject}: {negative} texels with negative radiance were set to 0 there"));
    }
    if overflowed > 0 {
        let problem = format!("{overflowed} texels with infinite radiance were set to {brightest}");
        warnings.push(format!("{subject}: {problem}, the brightest finite value"));
    }
    Ok(color)
}

/// Returns the depth codes of an image that holds colour and depth, beside or over each other.
///
/// # Errors
/// Fails if the image is too small, or if its depth has no codes.
pub fn packed_codes(image: FileImage, beside: bool, subject: &str) -> Result<CodeImage> {
    let packing = if beside { Packing::LeftRight } else { Packing::TopBottom };
    Ok(unpack(image, packing, subject)?.1)
}

fn unpack(image: FileImage, packing: Packing, subject: &str) -> Result<(ColorImage, CodeImage)> {
    let crop_image = |image: &FileImage, which: usize| -> Result<FileImage> {
        Ok(match image {
            FileImage::Raster(raster) => {
                let crop = halves(raster.size, packing, subject)?[which];
                let samples = match &raster.samples {
                    Samples::U8(values) => Samples::U8(crop.apply(values, raster.channels)),
                    Samples::U16(values) => Samples::U16(crop.apply(values, raster.channels)),
                    Samples::F32(values) => Samples::F32(crop.apply(values, raster.channels)),
                };
                // A packed PNG usually comes from a video, so slightly coloured greys are expected.
                let (color, notes) = (raster.color.clone(), Vec::new());
                FileImage::Raster(Raster {
                    size: crop.size,
                    channels: raster.channels,
                    samples,
                    lossy: true,
                    color,
                    notes,
                })
            }
            FileImage::Exr(exr) => {
                let mut exr = exr.clone();
                for layer in &mut exr.layers {
                    let crop = halves(layer.size, packing, subject)?[which];
                    layer.size = crop.size;
                    for (_, values) in &mut layer.channels {
                        *values = crop.apply(values, 1);
                    }
                }
                FileImage::Exr(exr)
            }
        })
    };
    Ok((crop_image(&image, 0)?.into_color(subject)?, crop_image(&image, 1)?.into_codes(subject)?))
}

/// Returns where colour and depth are in a picture that holds both.
fn halves(size: [u32; 2], packing: Packing, subject: &str) -> Result<[Crop; 2]> {
    let [width, height] = size;
    let (half, from) = match packing {
        Packing::LeftRight => ([width / 2, height], [width - width / 2, 0]),
        _ => ([width, height / 2], [0, height - height / 2]),
    };
    if half.contains(&0) {
        let problem = format!("is {width}x{height}, too small to hold colour and depth");
        return Err(Error::input(subject, problem, "check packing"));
    }
    let crop = |from| Crop { whole: size, from, size: half };
    Ok([crop([0, 0]), crop(from)])
}

#[derive(Clone, Copy)]
struct Crop {
    whole: [u32; 2],
    from: [u32; 2],
    size: [u32; 2],
}

impl Crop {
    fn apply<T: Copy>(&self, values: &[T], channels: usize) -> Vec<T> {
        let row = |y: u32| {
            let start = (y as usize * self.whole[0] as usize + self.from[0] as usize) * channels;
            &values[start..start + self.size[0] as usize * channels]
        };
        (self.from[1]..self.from[1] + self.size[1]).flat_map(row).copied().collect()
    }
}
