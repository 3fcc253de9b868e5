//! Loads panorama frames from image files, from image sequences, from videos or from memory.

use super::{
    clipped::{self, Clipped},
    depth::{Quality, Quantisation, Rule},
    packing::halves,
    pattern::Pattern,
    stream::Stream,
    texels::Texels,
    tone,
    tracks::Plan,
};
use crate::{
    Error, Result,
    media::{VideoInfo, film::SourceCodes, planes::Part},
};
use glam::Vec3;
use std::{
    path::PathBuf,
    sync::{Arc, OnceLock},
};

/// One equirectangular frame. Row 0 is towards +Y.
#[derive(Clone, Debug, Default)]
pub struct PanoramaFrame {
    /// Width and height of `radiance`.
    pub color_size: [u32; 2],
    /// Linear Rec. 709, finite, and ≥ 0 but where a video's colours are beyond Rec. 709. Exposure and inverse tone mapping are applied. Alpha is by how much
    /// more a texel shines than it shows: 1, or the factor of a clipped lamp.
    pub radiance: Texels,
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
    /// Whether the colour, and depth that is no panorama, are cubemaps.
    pub cubes: [bool; 2],
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
    /// What is unusual about the sequence. Each frame has warnings of its own.
    pub warnings: Vec<String>,
}

#[derive(Clone, Debug)]
enum FrameSource {
    /// Frames, and what [`LampRule::Estimate`] found in the first one.
    Memory(Arc<Vec<Arc<PanoramaFrame>>>, Arc<OnceLock<Clipped>>),
    Files(Arc<Stream>),
}

impl PanoramaSpec {
    /// All files that the frames are read from and that are there.
    pub fn files(&self) -> Vec<PathBuf> {
        let depth = match &self.depth {
            DepthSource::Files(path) => Some(path),
            DepthSource::Sphere(_) | DepthSource::Box { .. } | DepthSource::Packed => None,
        };
        let of = |path: &PathBuf| {
            let Ok(pattern) = Pattern::parse(path) else { return vec![path.clone()] };
            if !pattern.is_sequence() {
                return vec![pattern.file(0)];
            }
            pattern.existing().unwrap_or_default().into_iter().map(|number| pattern.file(number)).collect()
        };
        [Some(&self.color), depth, self.mask.as_ref()].into_iter().flatten().flat_map(of).collect()
    }
}

impl PanoramaFrame {
    /// Bytes that it takes in memory.
    pub fn bytes(&self) -> usize {
        self.radiance.kept_bytes() + size_of_val(&self.depth[..])
    }

    /// How well the depth knows its surfaces.
    pub fn quality(&self) -> Quality {
        Quality::of(&self.depth, self.depth_size, self.quantisation)
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
            frames: FrameSource::Memory(Arc::new(frames.into_iter().map(Arc::new).collect()), Arc::default()),
            fps,
            position,
            yaw_degrees,
            inverse_tonemap: 1.0,
            lamps: LampRule::Estimate,
            warnings: Vec::new(),
        })
    }

    /// Returns the factor on radiance that was applied on loading.
    pub fn exposure(&self) -> f32 {
        self.spec().map(|spec| spec.exposure).filter(|exposure| *exposure > 0.0).unwrap_or(1.0)
    }

    /// Returns what the scene file says; `None` for frames that were made in memory.
    pub fn spec(&self) -> Option<&PanoramaSpec> {
        self.plan().map(|plan| &*plan.spec)
    }

    fn plan(&self) -> Option<&Plan> {
        match &self.frames {
            FrameSource::Files(stream) => Some(stream.plan()),
            FrameSource::Memory(..) => None,
        }
    }

    /// Returns width and height of the first picture in its file, once one was loaded. The frame may be smaller.
    pub fn picture_size(&self) -> Option<[u32; 2]> {
        self.plan()?.picture_size.get().copied()
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
            Packing::Separate => Part::whole(info.size),
            packing => halves(info.size, packing, "video").ok()?[0],
        };
        Some(SourceCodes { info: Arc::clone(info), bytes, part })
    }

    /// Returns frames a second as a fraction.
    pub fn rate(&self) -> [u32; 2] {
        self.plan().map_or_else(|| crate::media::rate::rational(self.fps), |plan| plan.rate)
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
        let mut warnings = Vec::new();
        let plan = Plan::of(spec, &mut warnings)?;
        let PanoramaSpec { position, yaw_degrees, inverse_tonemap, lamps, .. } = *plan.spec;
        let fps = plan.fps;
        let frames = FrameSource::Files(Arc::new(Stream::new(plan)));
        Ok(Self { frames, fps, position, yaw_degrees, inverse_tonemap, lamps, warnings })
    }

    /// Returns the number of frames, at least 1.
    pub fn frame_count(&self) -> usize {
        match &self.frames {
            FrameSource::Memory(frames, _) => frames.len(),
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
        let index = index.min(self.frame_count() - 1);
        match &self.frames {
            FrameSource::Memory(frames, found) => {
                let mut frame = Arc::clone(&frames[index]);
                if let Some(white) = frame.white {
                    let clipped = self.lamps.clipped(found, || clipped::estimate_of(&frames[0]));
                    if clipped.raises() {
                        clipped.raise(Arc::make_mut(&mut frame), white);
                    }
                }
                Ok(frame)
            }
            FrameSource::Files(stream) => {
                let frame = stream.load(index)?;
                crate::warnings::tell(&frame.warnings);
                Ok(frame)
            }
        }
    }

    /// Returns the clipped lamps of the first frame and their factors, once a frame was loaded.
    pub fn clipped_lamps(&self) -> Option<&Clipped> {
        match &self.frames {
            FrameSource::Memory(_, found) => found.get(),
            FrameSource::Files(stream) => stream.plan().clipped.get(),
        }
    }
}

impl LampRule {
    /// Returns what is known of the clipped lamps. `found` keeps what was estimated.
    pub(super) fn clipped(self, found: &OnceLock<Clipped>, estimate: impl FnOnce() -> Clipped) -> Clipped {
        match self {
            Self::AsCaptured => Clipped::default(),
            Self::Factor(factor) => Clipped::even(factor),
            Self::Estimate => found.get_or_init(estimate).clone(),
        }
    }
}
