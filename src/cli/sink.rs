//! Where `iprt render` puts its pictures: files, a video, or a stream for another program.

use super::render::require_folder;
use crate::{
    Error, Result,
    image_file::tonemap::Tonemap,
    media::{
        encode::{Codec, Container, Encoding, Wanted},
        film::{Extras, Film, Look, Shot},
        rate,
        spherical::Views,
        stream::RawStream,
    },
    output::{self, FileKind, shows_all, stacked, write_alpha},
    panorama::pattern::Pattern,
    renderer::Renderer,
    scene::Scene,
};
use std::{
    path::{Path, PathBuf},
    sync::Arc,
};

/// The flags of videos and streams.
#[derive(Clone, Debug, Default, clap::Args)]
pub struct VideoArgs {
    /// How a video is compressed [default: h264; hevc for HDR, vp9 in .webm]
    #[arg(long, value_enum)]
    pub codec: Option<Codec>,
    /// Quality of a video: 0 is the best, and lossless with h264, hevc and vp9 [default: 18 with h264, 20 with hevc, 24 with
    /// vp9, 28 with av1]
    #[arg(long, value_name = "N")]
    pub crf: Option<u32>,
    /// The pixels of a video or of a stream, in ffmpeg's words: yuv420p, yuv422p10, gbrp, …; a stream also takes rgb24 and
    /// rgb48
    #[arg(long, value_name = "NAME")]
    pub pix_fmt: Option<String>,
    /// Leave the source's sound out of a video
    #[arg(long)]
    pub no_audio: bool,
}

/// The kinds of outputs, by their names.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Target {
    Files(FileKind),
    Video,
    Stream,
}

impl Target {
    /// Finds the kind, and checks the flags that go with it.
    ///
    /// # Errors
    /// Fails if the name says nothing known, or if a flag does not fit.
    pub fn of(path: &Path, video: &VideoArgs) -> Result<Self> {
        let target = match Container::of(path) {
            _ if path == Path::new("-") => Self::Stream,
            Some(_) => Self::Video,
            None => Self::Files(FileKind::of(path).map_err(|_| {
                let problem = "is neither .png nor .exr, nor a video";
                Error::input(path.display(), problem, "give one of these extensions, or .mp4, .mov, .webm or .mkv")
            })?),
        };
        let flags = [
            ("--codec", video.codec.is_some(), target == Self::Video),
            ("--crf", video.crf.is_some(), target == Self::Video),
            ("--pix-fmt", video.pix_fmt.is_some(), !matches!(target, Self::Files(_))),
        ];
        if let Some((flag, _, _)) = flags.iter().find(|(_, given, fits)| *given && !*fits) {
            return Err(Error::input(
                flag,
                format!("has no meaning for {}", path.display()),
                "leave it out, or write a video",
            ));
        }
        if target == Self::Video && path.is_dir() {
            return Err(Error::input(path.display(), "is a folder", "give a file name"));
        }
        if target != Self::Stream {
            require_folder(path)?;
        }
        Ok(target)
    }
}

/// An output that takes one picture after another.
pub enum Sink {
    Files { pattern: Pattern, kind: FileKind, aovs: Vec<String>, alpha: bool, tone: (f32, Tonemap) },
    Film { film: Box<Film>, path: PathBuf, extras: Extras, timing: Timing },
    Stream { stream: Box<RawStream>, look: Look, timing: Timing },
}

/// How often each frame is shown where the rate is constant.
pub struct Timing {
    /// Frames a second.
    pub rate: [u32; 2],
    /// When each frame is shown and ends, in frames of that rate.
    starts: Vec<u64>,
    first: u32,
}

impl Timing {
    /// Follows a scene's video. Without a scene all frames take equally long.
    pub fn of(scene: Option<&Scene>, fps: f64, [first, last]: [u32; 2]) -> Self {
        let Some(scene) = scene else {
            return Self { rate: rate::rational(fps), starts: Vec::new(), first };
        };
        let rate = constant_rate(scene);
        let fps = f64::from(rate[0]) / f64::from(rate[1]);
        let time = |frame: u32| scene.panorama.frame_time(frame as usize);
        let starts = (first..=last + 1).map(|frame| ((time(frame) - time(first)) * fps).round() as u64).collect();
        Self { rate, starts, first }
    }

    /// How often a frame is shown.
    pub fn times(&self, frame: u32) -> u32 {
        let at = (frame - self.first) as usize;
        let lasts = self.starts.get(at + 1).zip(self.starts.get(at)).map(|(end, start)| end.saturating_sub(*start));
        lasts.unwrap_or(1).clamp(1, 100_000) as u32
    }
}

/// How a scene's radiance is shown.
pub fn look_of(scene: &Scene, exposure: f32, tonemap: Tonemap) -> Look {
    let panorama = scene.panorama.clone();
    Look { exposure, tonemap, for_display: Arc::new(move |light| panorama.for_display(light)) }
}

impl Sink {
    /// Opens an output for these frames. A video that was begun goes on.
    ///
    /// # Errors
    /// Fails if what is asked for does not fit together, or if nothing can be written there.
    pub fn open(target: Target, path: &Path, asked: &Asked, scene: &Scene, eyes: &[Renderer]) -> Result<Self> {
        let panorama = &scene.panorama;
        let look = look_of(scene, asked.exposure, asked.tonemap);
        if let Target::Files(kind) = target {
            let (pattern, aovs) = (Pattern::parse(path)?, asked.aovs.to_vec());
            let tone = (asked.exposure, asked.tonemap);
            return Ok(Self::Files { pattern, kind, aovs, alpha: asked.alpha, tone });
        }
        let timing = Timing::of(Some(scene), panorama.fps, asked.frames);
        let (rate, size) = (timing.rate, output::size(eyes));
        let wanted = Wanted { codec: asked.video.codec, crf: asked.video.crf, pix_fmt: asked.video.pix_fmt.clone() };
        let source = panorama.video();
        if target == Target::Stream {
            let stream = Box::new(RawStream::open(wanted.pix_fmt.as_deref(), size, rate, source)?);
            return Ok(Self::Stream { stream, look, timing });
        }
        let encoding = Encoding::of(&wanted, path, size, rate, source)?;
        let job = format!("{} {:?}", asked.job, asked.frames[0]);
        let film = Film::begin(path, encoding, look, &job, asked.frames)?;
        let first = asked.frames[0];
        let views = if eyes.len() > 1 { Views::TopBottom } else { Views::One };
        let spherical = shows_all(eyes).then_some(views);
        let extras = Extras { audio: sound(scene, first).filter(|_| !asked.video.no_audio), spherical };
        Ok(Self::Film { film: Box::new(film), path: path.to_owned(), extras, timing })
    }

    /// The first frame that is still to be rendered.
    pub fn next(&self, first: u32) -> u32 {
        match self {
            Self::Film { film, .. } => film.next(),
            _ => first,
        }
    }

    /// Writes the picture of a renderer, or of two eyes, as this frame. Returns a line to print, or `None` if nobody reads any more.
    ///
    /// # Errors
    /// Fails if it cannot be written.
    pub fn write(&mut self, eyes: &[Renderer], scene: &Scene, frame: u32) -> Result<Option<String>> {
        match self {
            Self::Files { pattern, kind, aovs, alpha, tone } => {
                let path = pattern.file(frame);
                if *alpha {
                    write_alpha(eyes, scene, &path, *tone)?;
                } else {
                    output::write(eyes, scene, &path, *kind, *tone, aovs)?;
                }
                Ok(Some(path.display().to_string()))
            }
            Self::Film { film, timing, .. } => {
                film.write(shot(eyes, scene, frame, timing)?)?;
                Ok(Some(String::new()))
            }
            Self::Stream { stream, look, timing } => {
                let open = stream.write(&shot(eyes, scene, frame, timing)?, look)?;
                Ok(open.then(String::new))
            }
        }
    }

    /// Ends the output. Returns a line to print.
    ///
    /// # Errors
    /// Fails if something cannot be written.
    pub fn finish(self) -> Result<Option<String>> {
        match self {
            Self::Film { film, path, extras, .. } => {
                film.finish(&extras)?;
                Ok(Some(path.display().to_string()))
            }
            _ => Ok(None),
        }
    }

    /// Ends a video that is not complete. Its parts are kept.
    ///
    /// # Errors
    /// Returns what stopped it, or why the parts cannot be kept.
    pub fn interrupt(self, frame: u32) -> Error {
        let (subject, remedy) = match self {
            Self::Film { mut film, path, .. } => {
                if let Err(error) = film.stop() {
                    return error;
                }
                (path.display().to_string(), "run the same command to go on")
            }
            Self::Files { pattern, .. } => (pattern.file(frame).display().to_string(), "go on with --frames"),
            Self::Stream { .. } => ("-".to_owned(), "run it again"),
        };
        Error::Interrupted { subject, at: format!("before frame {frame}"), remedy: remedy.to_owned() }
    }
}

/// What an output must know of the command.
pub struct Asked<'a> {
    pub video: &'a VideoArgs,
    pub frames: [u32; 2],
    pub exposure: f32,
    pub tonemap: Tonemap,
    pub aovs: &'a [String],
    /// Whether a PNG shows virtual objects alone.
    pub alpha: bool,
    /// Stands for all that the pictures depend on.
    pub job: String,
}

/// A picture on its way to a video or a stream.
fn shot(eyes: &[Renderer], scene: &Scene, frame: u32, timing: &Timing) -> Result<Shot> {
    let can_match = shows_all(eyes) && eyes.len() == 1;
    let source = scene.panorama.codes(frame as usize).filter(|_| can_match);
    Ok(Shot { texels: stacked(eyes, Renderer::picture)?, source, times: timing.times(frame) })
}

/// Frames a second of an output: the source's, or where frames are not equally far apart one at which all have their times.
fn constant_rate(scene: &Scene) -> [u32; 2] {
    let panorama = &scene.panorama;
    let Some(video) = panorama.video() else { return panorama.rate() };
    let times: Vec<f64> = (0..panorama.frame_count()).map(|frame| panorama.frame_time(frame)).collect();
    let is_even = |(index, time): (usize, &f64)| (time - index as f64 / panorama.fps).abs() < 1e-6;
    if times.iter().enumerate().all(is_even) {
        return panorama.rate();
    }
    let shortest = || rate::of_shortest(&times).filter(|_| video.varies);
    rate::common(&times).or_else(shortest).unwrap_or_else(|| panorama.rate())
}

/// The sound of the source, from the time of a frame on.
pub fn sound(scene: &Scene, first: u32) -> Option<(PathBuf, String, f64)> {
    let info = scene.panorama.video()?;
    let number = scene.panorama.number_in_video(first as usize)?;
    let from = info.start + info.times.get(number)?;
    Some((info.path.clone(), info.audio.clone()?, if from < 0.02 { 0.0 } else { from }))
}
