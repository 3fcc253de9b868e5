//! Encodes frames: what the user may choose, and one child process that reads raw frames from a pipe.

use super::{
    format::{Format, Kind, Matrix, Siting, Tags},
    pack::Packer,
    probe::VideoInfo,
    tool,
};
use crate::{Error, Result, warnings};
use std::{
    io::Write,
    path::Path,
    process::{Child, ChildStdin, Stdio},
    thread::JoinHandle,
};

/// The kind of a video file, by its name.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Container {
    Mp4,
    Mov,
    Webm,
    Mkv,
}

impl Container {
    /// The container that a name asks for; `None` if it is no video's.
    pub fn of(path: &Path) -> Option<Self> {
        match path.extension()?.to_str()?.to_lowercase().as_str() {
            "mp4" | "m4v" => Some(Self::Mp4),
            "mov" => Some(Self::Mov),
            "webm" => Some(Self::Webm),
            "mkv" => Some(Self::Mkv),
            _ => None,
        }
    }

    /// The name by which `ffmpeg` knows it.
    pub fn muxer(self) -> &'static str {
        match self {
            Self::Mp4 => "mp4",
            Self::Mov => "mov",
            Self::Webm => "webm",
            Self::Mkv => "matroska",
        }
    }

    /// Says whether its boxes are those of MP4.
    pub fn has_boxes(self) -> bool {
        matches!(self, Self::Mp4 | Self::Mov)
    }

    /// Says whether it holds this sound as it is.
    pub fn holds_audio(self, codec: &str) -> bool {
        match self {
            Self::Mp4 => ["aac", "mp3", "ac3", "eac3", "alac", "opus", "flac"].contains(&codec),
            Self::Mov => ["aac", "mp3", "ac3", "eac3", "alac"].contains(&codec) || codec.starts_with("pcm_"),
            Self::Webm => ["opus", "vorbis"].contains(&codec),
            Self::Mkv => true,
        }
    }
}

/// How frames are compressed.
#[derive(Clone, Copy, Debug, PartialEq, Eq, clap::ValueEnum)]
pub enum Codec {
    H264,
    Hevc,
    Av1,
    Vp9,
    Prores,
    Ffv1,
}

impl Codec {
    fn encoder(self) -> &'static str {
        match self {
            Self::H264 => "libx264",
            Self::Hevc => "libx265",
            Self::Av1 => "libsvtav1",
            Self::Vp9 => "libvpx-vp9",
            Self::Prores => "prores_ks",
            Self::Ffv1 => "ffv1",
        }
    }

    fn fits(self, container: Container) -> bool {
        match container {
            Container::Mp4 => matches!(self, Self::H264 | Self::Hevc | Self::Av1 | Self::Vp9),
            Container::Mov => matches!(self, Self::H264 | Self::Hevc | Self::Prores),
            Container::Webm => matches!(self, Self::Av1 | Self::Vp9),
            Container::Mkv => true,
        }
    }

    /// The largest `--crf`, and the one that is taken.
    fn crf(self) -> Option<[u32; 2]> {
        match self {
            Self::H264 => Some([51, 18]),
            Self::Hevc => Some([51, 20]),
            Self::Av1 => Some([63, 28]),
            Self::Vp9 => Some([63, 24]),
            Self::Prores | Self::Ffv1 => None,
        }
    }

    /// Says whether its best quality loses nothing.
    fn can_be_lossless(self) -> bool {
        matches!(self, Self::H264 | Self::Hevc | Self::Vp9)
    }
}

/// What the user asks of a video file.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Wanted {
    pub codec: Option<Codec>,
    pub crf: Option<u32>,
    pub pix_fmt: Option<String>,
}

/// How a video is encoded.
#[derive(Clone, Debug)]
pub struct Encoding {
    pub container: Container,
    pub codec: Codec,
    pub crf: Option<u32>,
    pub packer: Packer,
    /// Frames a second.
    pub rate: [u32; 2],
    /// HDR10's metadata, in x265's words.
    pub mastering: Option<String>,
    pub content_light: Option<String>,
}

impl Encoding {
    /// Chooses what is not asked for: as the source has it where that can be.
    ///
    /// # Errors
    /// Fails if what is asked for does not fit together.
    pub fn of(
        wanted: &Wanted,
        path: &Path,
        size: [u32; 2],
        rate: [u32; 2],
        source: Option<&VideoInfo>,
    ) -> Result<Self> {
        let name = path.display();
        let Some(container) = Container::of(path) else {
            return Err(Error::input(name, "is no video's name", "write .mp4, .mov, .webm or .mkv"));
        };
        let hdr = source.filter(|info| info.tags.is_hdr());
        let usual = match container {
            Container::Webm => Codec::Vp9,
            _ if hdr.is_some() => Codec::Hevc,
            _ => Codec::H264,
        };
        let codec = wanted.codec.unwrap_or(usual);
        if !codec.fits(container) {
            let known = "mp4 holds h264, hevc, av1 and vp9; mov h264, hevc and prores; webm vp9 and av1; mkv all";
            return Err(Error::input("--codec", format!("{codec:?} does not fit into {name}").to_lowercase(), known));
        }
        let crf = match (codec.crf(), wanted.crf) {
            (None, Some(_)) => {
                return Err(Error::input("--crf", format!("{codec:?} has none").to_lowercase(), "leave it out"));
            }
            (Some([most, _]), Some(crf)) if crf > most => {
                return Err(Error::input("--crf", format!("{crf}"), format!("give 0 (best) to {most}")));
            }
            (Some([_, usual]), crf) => Some(crf.unwrap_or(usual)),
            (None, None) => None,
        };
        let format = format_for(codec, crf, wanted.pix_fmt.as_deref(), source)?;
        let ragged = |axis: usize| size[axis] & ((1 << format.sub[axis]) - 1) != 0;
        if codec != Codec::Ffv1 && (ragged(0) || ragged(1)) {
            let problem = format!("{}x{} cannot be halved, as {} needs", size[0], size[1], format.name());
            return Err(Error::input("--size", problem, "give even numbers, or --pix-fmt yuv444p"));
        }
        let tags = tags_for(format, source)?;
        let metadata = |what: &Option<String>| what.clone().filter(|_| codec == Codec::Hevc);
        Ok(Self {
            container,
            codec,
            crf,
            packer: Packer { size, format, tags },
            rate,
            mastering: hdr.and_then(|info| metadata(&info.mastering)),
            content_light: hdr.and_then(|info| metadata(&info.content_light)),
        })
    }

    /// The kind of file of a part: one that keeps what the codec itself does not say, and exact times if it can.
    pub fn part_extension(&self) -> &'static str {
        match self.codec {
            Codec::H264 | Codec::Hevc | Codec::Av1 => "nut",
            Codec::Vp9 => "mp4",
            Codec::Prores | Codec::Ffv1 => "mov",
        }
    }

    /// The flags that choose and steer the encoder.
    fn flags(&self) -> Vec<String> {
        let tags = &self.packer.tags;
        let range = if tags.full_range { "pc" } else { "tv" };
        let mut flags: Vec<String> =
            ["-c:v", self.codec.encoder(), "-pix_fmt", self.packer.format.name()].map(Into::into).into();
        let mut add = |words: &[&str]| flags.extend(words.iter().map(|word| (*word).to_owned()));
        let crf = self.crf.unwrap_or(0).to_string();
        let is_lossless = self.crf == Some(0);
        let mut x265 = vec!["log-level=error".to_owned()];
        match self.codec {
            Codec::H264 if is_lossless => add(&["-preset", "medium", "-qp", "0"]),
            Codec::H264 => add(&["-preset", "medium", "-crf", &crf]),
            Codec::Hevc => {
                if is_lossless {
                    x265.push("lossless=1".into());
                } else {
                    add(&["-crf", &crf]);
                }
                if tags.is_hdr() {
                    x265.push("repeat-headers=1".into());
                    x265.push(format!(
                        "colorprim={}:transfer={}:colormatrix={}",
                        tags.primaries, tags.transfer, tags.matrix
                    ));
                }
                if tags.transfer == "smpte2084" {
                    x265.push("hdr10=1".into());
                }
                x265.extend(self.mastering.iter().map(|display| format!("master-display={display}")));
                x265.extend(self.content_light.iter().map(|light| format!("max-cll={light}")));
                add(&["-preset", "medium", "-x265-params", &x265.join(":")]);
            }
            Codec::Av1 => add(&["-preset", "8", "-crf", &crf]),
            Codec::Vp9 if is_lossless => add(&["-lossless", "1", "-row-mt", "1", "-cpu-used", "4"]),
            Codec::Vp9 => add(&["-b:v", "0", "-crf", &crf, "-row-mt", "1", "-cpu-used", "4"]),
            Codec::Prores => {
                let profile = if self.packer.format.sub[0] == 0 { "4" } else { "3" };
                // It takes colours from frames alone.
                let colors = format!(
                    "setparams=color_primaries={}:color_trc={}:colorspace={}:range={range}",
                    tags.primaries, tags.transfer, tags.matrix
                );
                add(&["-vf", &colors, "-profile:v", profile, "-vendor", "apl0"]);
            }
            Codec::Ffv1 => add(&["-level", "3", "-g", "1", "-slicecrc", "1"]),
        }
        add(&["-color_range", range, "-colorspace", tags.matrix.name(), "-color_primaries", &tags.primaries]);
        add(&["-color_trc", &tags.transfer]);
        if self.packer.format.kind == Kind::Yuv && self.packer.format.sub != [0, 0] {
            let siting = match tags.siting.middle {
                [false, true] => "left",
                [true, true] => "center",
                [false, false] => "topleft",
                [true, false] => "top",
            };
            add(&["-chroma_sample_location", siting]);
        }
        flags
    }

    /// Starts an encoder that writes this file. `subject` names the video in errors.
    ///
    /// # Errors
    /// Fails if `ffmpeg` is not installed.
    pub fn start(&self, path: &Path, subject: &str) -> Result<Encoder> {
        let mut command = tool::command("ffmpeg");
        let [width, height] = self.packer.size;
        let [rate, of] = self.rate;
        command.stdin(Stdio::piped()).stdout(Stdio::null()).arg("-y");
        command.args(["-f", "rawvideo", "-pix_fmt", self.packer.format.name(), "-s", &format!("{width}x{height}")]);
        command.args(["-color_range", if self.packer.tags.full_range { "pc" } else { "tv" }]);
        command.args(["-r", &format!("{rate}/{of}"), "-i", "pipe:0"]).args(self.flags());
        command.args(["-f", self.part_extension()]).arg(tool::local(path));
        let subject = subject.to_owned();
        let mut child = tool::start(&mut command, &subject)?;
        let said = Some(tool::listen(child.stderr.take()));
        let Some(input) = child.stdin.take() else { return Err(Error::Internal("a child without a pipe".into())) };
        Ok(Encoder { child, input: Some(input), said, subject, encoder: self.codec.encoder() })
    }
}

/// The format that is asked for, or the one that the encoder holds and that loses least. Whether its range is full is said
/// by tags alone. A loss is told, unless it is the usual one of a lossy video.
fn format_for(codec: Codec, crf: Option<u32>, asked: Option<&str>, source: Option<&VideoInfo>) -> Result<Format> {
    let held = held(codec);
    let holds = |format: &Format| held.is_empty() || held.contains(format);
    let names = || held.iter().map(Format::name).collect::<Vec<_>>().join(", ");
    if let Some(asked) = asked {
        let format = Format::asked(asked)?;
        return if holds(&format) {
            Ok(format)
        } else {
            let problem = format!("{} does not hold {}", codec.encoder(), format.name());
            Err(Error::input("--pix-fmt", problem, format!("give one of {}, or another --codec", names())))
        };
    }
    let stored = source.map(|info| info.format.of_any_range());
    let deep = stored.is_some_and(|format| format.bits > 8);
    let hdr = source.is_some_and(|info| info.tags.is_hdr());
    let is_lossless = codec == Codec::Ffv1 || (codec.can_be_lossless() && crf == Some(0));
    let wanted = match (codec, stored) {
        // Nothing is lost where the source's own format is kept.
        (_, Some(stored)) if is_lossless => stored,
        (Codec::Ffv1, None) => Format::of("gbrp"),
        (Codec::Prores, _) => Format::of("yuv422p10le"),
        (Codec::Hevc | Codec::Av1, _) if deep => Format::of("yuv420p10le"),
        _ if hdr => Format::of("yuv420p10le"),
        _ => Format::of("yuv420p"),
    };
    let format = if holds(&wanted) {
        wanted
    } else {
        held.iter().copied().min_by_key(|format| wanted.lost_in(format)).unwrap_or(wanted)
    };
    if wanted.lost_in(&format)[..3] != [0; 3] {
        let (encoder, wanted, format) = (codec.encoder(), wanted.name(), format.name());
        let problem = format!("{encoder} does not hold {wanted}: {format} is written, which loses some of the source");
        warnings::tell(&[format!("--codec: {problem} (--codec ffv1 in .mkv keeps all)")]);
    }
    Ok(format)
}

/// The formats that the installed encoder holds; none if it does not say.
fn held(codec: Codec) -> Vec<Format> {
    let mut ask = tool::command("ffmpeg");
    ask.args(["-h", &format!("encoder={}", codec.encoder())]);
    let text = tool::output(&mut ask, "ffmpeg", "says nothing of its encoders", "").unwrap_or_default();
    let text = String::from_utf8_lossy(&text);
    let names = text.lines().find_map(|line| line.trim().strip_prefix("Supported pixel formats:")).unwrap_or_default();
    let mut formats: Vec<Format> = Vec::new();
    for format in names.split_whitespace().map(|name| Format::of(name).of_any_range()) {
        if !formats.contains(&format) {
            formats.push(format);
        }
    }
    formats
}

pub(super) fn tags_for(format: Format, source: Option<&VideoInfo>) -> Result<Tags> {
    let matrix = source.map_or(Matrix::Bt709, |info| info.tags.matrix).for_output(format.kind);
    let full = match source {
        _ if format.kind != Kind::Yuv => true,
        Some(info) if info.format.kind == Kind::Yuv => info.tags.full_range,
        _ => false,
    };
    let siting = source.filter(|info| info.format.sub == format.sub).map_or(Siting::LEFT, |info| info.tags.siting);
    let primaries = source.map_or("bt709", |info| info.tags.primaries.as_str());
    // Who looks for bt709 finds it, and shows it as sRGB.
    let transfer = match source.map(|info| info.tags.transfer.as_str()) {
        None | Some("iec61966-2-1") if format.kind != Kind::Gbr => "bt709",
        None => "iec61966-2-1",
        Some(transfer) => transfer,
    };
    Tags::new(matrix, full, Some(primaries), Some(transfer), siting).map_err(Error::Internal)
}

/// A running encoder.
pub struct Encoder {
    child: Child,
    input: Option<ChildStdin>,
    said: Option<JoinHandle<String>>,
    subject: String,
    encoder: &'static str,
}

impl Encoder {
    /// Hands over a frame, as often as it is shown.
    ///
    /// # Errors
    /// Fails if the encoder has ended. The error has its last words.
    pub fn write(&mut self, frame: &[u8], times: u32) -> Result<()> {
        for _ in 0..times {
            let written = self.input.as_mut().map(|input| input.write_all(frame));
            if !matches!(written, Some(Ok(()))) {
                return Err(self.failed());
            }
        }
        Ok(())
    }

    /// Waits until all is written.
    ///
    /// # Errors
    /// Fails if the encoder does.
    pub fn finish(mut self) -> Result<()> {
        self.input = None;
        match self.child.wait() {
            Ok(status) if status.success() => Ok(()),
            _ => Err(self.failed()),
        }
    }

    fn failed(&mut self) -> Error {
        self.input = None;
        if let Some(error) = tool::killed(self.child.wait().ok(), "ffmpeg", &self.subject) {
            return error;
        }
        let said = self.said.take().and_then(|said| said.join().ok()).unwrap_or_default();
        let words = tool::last_words(&said, &self.subject);
        let problem = format!("{} does not encode it{words}", self.encoder);
        Error::input(
            &self.subject,
            problem,
            "free some space, choose another --codec or --pix-fmt, or install an ffmpeg that has it",
        )
    }
}

impl Drop for Encoder {
    fn drop(&mut self) {
        if self.said.is_some() && self.input.is_some() {
            tool::end(&mut self.child);
        }
    }
}
