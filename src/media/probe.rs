//! What a video file says of itself, asked of `ffprobe`. Nothing is decoded for it.

use super::{
    format::{Format, Kind, Matrix, Siting, Tags},
    planes::Planes,
    rate::rational,
    tool,
};
use crate::{Error, Result};
use serde::Deserialize;
use std::path::{Path, PathBuf};

/// A video stream and its file.
#[derive(Clone, Debug, PartialEq)]
pub struct VideoInfo {
    pub path: PathBuf,
    /// The number of the stream in its file.
    pub stream: u32,
    pub codec: String,
    /// How pixels are stored, in `ffmpeg`'s words.
    pub stored: String,
    /// How frames come out of the pipe.
    pub format: Format,
    /// Width and height, after the rotation.
    pub size: [u32; 2],
    /// Degrees by which the file asks to be turned; `ffmpeg` does it.
    pub rotation: i32,
    /// What codes mean, where the stream says nothing by the usual rules.
    pub tags: Tags,
    /// Which tags the stream lacks, and what was taken for them.
    pub assumed: Vec<String>,
    /// Frames a second, as a fraction: the mean, if it varies.
    pub rate: [u32; 2],
    /// When each frame is shown, in seconds from the first.
    pub times: Vec<f64>,
    /// How many frames there should be, if the file says so or ends too early.
    pub lacks: Option<Lack>,
    /// When the first frame is shown, seconds from the start of the file.
    pub start: f64,
    /// Whether times are not equally far apart.
    pub varies: bool,
    /// The codec of its sound, if it has any.
    pub audio: Option<String>,
    /// Mastering display and content light level of HDR10, in x265's words.
    pub mastering: Option<String>,
    pub content_light: Option<String>,
}

/// A file that is cut off.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Lack {
    /// The number of frames that its header promises, where it does.
    pub promised: Option<usize>,
}

#[derive(Deserialize)]
struct Probed {
    #[serde(default)]
    streams: Vec<ProbedStream>,
    #[serde(default)]
    format: ProbedFormat,
}

#[derive(Default, Deserialize)]
struct ProbedFormat {
    format_name: Option<String>,
    start_time: Option<String>,
}

#[derive(Deserialize)]
struct ProbedStream {
    index: u32,
    codec_type: Option<String>,
    codec_name: Option<String>,
    width: Option<u32>,
    height: Option<u32>,
    pix_fmt: Option<String>,
    color_range: Option<String>,
    color_space: Option<String>,
    color_transfer: Option<String>,
    color_primaries: Option<String>,
    chroma_location: Option<String>,
    r_frame_rate: Option<String>,
    avg_frame_rate: Option<String>,
    nb_frames: Option<String>,
    #[serde(default)]
    disposition: std::collections::HashMap<String, i64>,
    #[serde(default)]
    tags: std::collections::HashMap<String, serde_json::Value>,
    #[serde(default)]
    side_data_list: Vec<serde_json::Value>,
}

/// What a picture takes per pixel while it is decoded: its planes, and light or codes made of them.
const BYTES: u64 = 24;

impl VideoInfo {
    /// Asks for all that is known of a video file without decoding it.
    ///
    /// # Errors
    /// Fails if the file cannot be read, if it holds no video, or if `ffprobe` is not installed.
    pub fn of(path: &Path) -> Result<Self> {
        let subject = path.display().to_string();
        let metadata = std::fs::metadata(path).map_err(|error| {
            let problem = crate::image_file::read::plain_io(&error);
            Error::input(&subject, problem, "check the file's name and permissions")
        })?;
        if !metadata.is_file() {
            return Err(Error::input(&subject, "is not a regular file", "give a video file"));
        }
        if metadata.len() == 0 {
            return Err(Error::input(&subject, "the file is empty", "write it again"));
        }
        if let Some(problem) = super::not_done(path) {
            let remedy = "convert it, as with: avifdec picture.avif picture.png (of libavif)";
            return Err(Error::input(&subject, problem, remedy));
        }
        let broken = "the file is damaged or cut off: copy it again, or convert it with ffmpeg";
        let mut ask = tool::command("ffprobe");
        ask.args(["-print_format", "json", "-show_format", "-show_streams"]).arg(tool::local(path));
        let text = tool::output(&mut ask, &subject, "cannot be read as a video", broken)?;
        let probed: Probed = serde_json::from_slice(&text)
            .map_err(|error| Error::input(&subject, format!("ffprobe's answer is odd: {error}"), broken))?;
        let is = |stream: &&ProbedStream, kind: &str| stream.codec_type.as_deref() == Some(kind);
        if probed.streams.is_empty() {
            return Err(Error::input(&subject, "holds no stream that can be read", broken));
        }
        let picture = |stream: &&ProbedStream| {
            is(stream, "video") && stream.disposition.get("attached_pic").copied().unwrap_or(0) == 0
        };
        let Some(stream) = probed.streams.iter().find(picture) else {
            let kinds: Vec<&str> = probed.streams.iter().filter_map(|s| s.codec_type.as_deref()).collect();
            let problem = format!("has no video stream, but {}", kinds.join(", "));
            return Err(Error::input(&subject, problem, "give a file with a picture"));
        };
        let (Some(width), Some(height), Some(stored)) = (stream.width, stream.height, stream.pix_fmt.clone()) else {
            let problem =
                format!("its video ({}) cannot be decoded", stream.codec_name.as_deref().unwrap_or("unknown"));
            return Err(Error::input(&subject, problem, broken));
        };
        let rotation = rotation(stream);
        let size = if rotation.rem_euclid(180) == 90 { [height, width] } else { [width, height] };
        if size.contains(&0) || u64::from(width) * u64::from(height) > crate::image_file::read::MAX_PIXELS {
            return Err(Error::input(
                &subject,
                format!("has pictures of {width}x{height} pixels"),
                "give smaller ones",
            ));
        }
        let texels = u64::from(width) * u64::from(height);
        crate::budget::ask(&subject, texels * BYTES)?;
        let format = Format::of(&stored);
        let mut assumed = Vec::new();
        let tags = tags(stream, format, size, &subject, &mut assumed)?;
        let (stamps, packets, is_cut) = time_stamps(path, stream.index, &subject)?;
        let promised = stream.nb_frames.as_deref().and_then(|count| count.parse::<usize>().ok());
        // AVI also counts chunks without a picture.
        let is_avi = probed.format.format_name.as_deref() == Some("avi");
        let promised = promised.filter(|promised| *promised > packets && !is_avi);
        let lacks = (is_cut || promised.is_some()).then_some(Lack { promised });
        if stamps.is_empty() {
            return Err(Error::input(&subject, "its video holds no frame", broken));
        }
        let stated =
            [&stream.avg_frame_rate, &stream.r_frame_rate].into_iter().flatten().find_map(|rate| fraction(rate));
        let (times, start, rate) = timing(&stamps, stated);
        let step = f64::from(rate[1]) / f64::from(rate[0]);
        let varies = times.iter().enumerate().any(|(i, time)| (time - i as f64 * step).abs() > 0.6 * step);
        let file_start: f64 = probed.format.start_time.as_deref().and_then(|t| t.parse().ok()).unwrap_or(0.0);
        let mut of_hdr10 = mastering(&stream.side_data_list);
        if tags.transfer == "smpte2084" && of_hdr10[0].is_none() {
            of_hdr10 = mastering(&first_frame_data(path, stream.index, &subject)?);
        }
        let [mastering, content_light] = of_hdr10;
        Ok(Self {
            path: path.to_owned(),
            stream: stream.index,
            codec: stream.codec_name.clone().unwrap_or_else(|| "unknown".into()),
            stored,
            format,
            size,
            rotation,
            tags,
            assumed,
            rate,
            times,
            lacks,
            start: start.map_or(0.0, |start| start - file_start),
            varies,
            audio: probed.streams.iter().find(|stream| is(stream, "audio")).and_then(|s| s.codec_name.clone()),
            mastering,
            content_light,
        })
    }

    /// Takes the bytes of a frame as planes.
    pub fn planes<'a>(&'a self, bytes: &'a [u8]) -> Planes<'a> {
        Planes { size: self.size, format: self.format, tags: &self.tags, bytes }
    }

    /// How many frames there are.
    pub fn frame_count(&self) -> usize {
        self.times.len()
    }

    /// Frames a second.
    pub fn fps(&self) -> f64 {
        f64::from(self.rate[0]) / f64::from(self.rate[1])
    }

    /// Says that the file is cut off, if more frames than it holds are needed.
    ///
    /// # Errors
    /// Fails if it is.
    pub fn demand_all(&self) -> Result<()> {
        let Some(Lack { promised }) = self.lacks else { return Ok(()) };
        let count = self.frame_count();
        let of = promised.map_or_else(String::new, |promised| format!(" of its {promised} frames"));
        let problem = format!("is cut off: it holds only {count}{of}");
        let remedy = format!("copy it again, or write frames = [0, {}]", count.saturating_sub(1));
        Err(Error::input(self.path.display(), problem, remedy))
    }

    /// How long it plays, seconds.
    pub fn duration(&self) -> f64 {
        self.times.last().copied().unwrap_or(0.0) + 1.0 / self.fps()
    }

    /// What was understood, a line for each fact.
    pub fn lines(&self) -> Vec<String> {
        let rate =
            if self.rate[1] == 1 { self.rate[0].to_string() } else { format!("{}/{}", self.rate[0], self.rate[1]) };
        let varies = if self.varies { ", by time stamps that are not equally far apart" } else { "" };
        let [width, height] = self.size;
        let turned = if self.rotation == 0 { String::new() } else { format!(", turned by {}°", self.rotation) };
        let mut lines = vec![
            format!("video      {} {width}x{height}, {}{turned}", self.codec, self.stored),
            format!("frames     {}, {rate} a second{varies}, {:.2} s", self.frame_count(), self.duration()),
            format!("colours    {}", self.tags),
        ];
        lines.extend(self.assumed.iter().map(|assumed| format!("assumed    {assumed}")));
        lines.push(format!("sound      {}", self.audio.as_deref().unwrap_or("none")));
        lines
    }
}

/// Reads `a/b`.
fn fraction(text: &str) -> Option<[u32; 2]> {
    let (a, b) = text.split_once('/')?;
    let (a, b): (u32, u32) = (a.parse().ok()?, b.parse().ok()?);
    (a > 0 && b > 0 && f64::from(a) / f64::from(b) < 10_000.0).then_some([a, b])
}

fn rotation(stream: &ProbedStream) -> i32 {
    let stated = stream.side_data_list.iter().find_map(|data| data.get("rotation")?.as_f64());
    let tagged = || stream.tags.get("rotate")?.as_str()?.parse::<f64>().ok();
    stated.or_else(tagged).filter(|angle| angle.is_finite()).map_or(0, |angle| angle.round() as i32 % 360)
}

/// When each frame is shown, in order; `None` where it is not said. Also how many packets there are, and whether the file
/// ends before its time.
fn time_stamps(path: &Path, stream: u32, subject: &str) -> Result<(Vec<Option<f64>>, usize, bool)> {
    let mut ask = tool::command("ffprobe");
    ask.args(["-select_streams", &stream.to_string(), "-show_entries", "packet=pts_time,flags", "-of", "csv=p=0"]);
    let remedy = "the file is damaged or cut off: copy it again";
    let (text, said) = tool::both(ask.arg(tool::local(path)), subject, "its frames cannot be counted", remedy)?;
    let is_cut = ["partial file", "ended prematurely", "truncated"].iter().any(|words| said.contains(words));
    let text = String::from_utf8_lossy(&text);
    let packets = text.lines().filter(|line| line.contains(',')).count();
    let shown = text.lines().filter_map(|line| {
        let mut fields = line.split(',');
        let (time, flags) = (fields.next()?, fields.next().unwrap_or(""));
        // Frames before the start of an edit are decoded, but not shown.
        (!time.is_empty() && !flags.contains('D')).then(|| time.parse::<f64>().ok())
    });
    let mut stamps: Vec<Option<f64>> = shown.collect();
    if stamps.iter().all(Option::is_some) {
        stamps.sort_by(|a, b| a.unwrap_or(0.0).total_cmp(&b.unwrap_or(0.0)));
    }
    Ok((stamps, packets, is_cut))
}

/// Times from the first frame, the first frame's own, and the rate.
fn timing(stamps: &[Option<f64>], stated: Option<[u32; 2]>) -> (Vec<f64>, Option<f64>, [u32; 2]) {
    let known: Option<Vec<f64>> = stamps.iter().copied().collect();
    let known = known.filter(|times| times.windows(2).all(|pair| pair[1] > pair[0]));
    let Some(known) = known else {
        let rate = stated.unwrap_or([30, 1]);
        let step = f64::from(rate[1]) / f64::from(rate[0]);
        return ((0..stamps.len()).map(|i| i as f64 * step).collect(), None, rate);
    };
    let (first, last) = (known[0], known[known.len() - 1]);
    let mean = (known.len() > 1).then(|| (known.len() - 1) as f64 / (last - first));
    // A stated rate that the stamps contradict is that of the container's clock.
    let agrees =
        |rate: &[u32; 2]| mean.is_none_or(|mean| (f64::from(rate[0]) / f64::from(rate[1]) / mean - 1.0).abs() < 0.05);
    let rate = stated.filter(agrees).unwrap_or_else(|| rational(mean.unwrap_or(30.0)));
    let step = f64::from(rate[1]) / f64::from(rate[0]);
    // Containers round stamps to a millisecond. Equal steps are meant then.
    let equal = known.iter().enumerate().all(|(i, time)| (time - first - i as f64 * step).abs() < 0.0021);
    let times = if equal {
        (0..known.len()).map(|i| i as f64 * step).collect()
    } else {
        known.iter().map(|t| t - first).collect()
    };
    (times, Some(first), rate)
}

fn tags(
    stream: &ProbedStream,
    format: Format,
    size: [u32; 2],
    subject: &str,
    assumed: &mut Vec<String>,
) -> Result<Tags> {
    let word = |tag: &Option<String>| {
        tag.clone().filter(|word| !["unknown", "unspecified", "reserved", ""].contains(&word.as_str()))
    };
    let large = size[0] >= 1280 || size[1] > 576;
    let matrix = match (format.kind, word(&stream.color_space)) {
        (Kind::Gbr, _) => Matrix::Rgb,
        (Kind::Gray, _) => Matrix::Bt709,
        (Kind::Yuv, Some(name)) => Matrix::named(&name).ok_or_else(|| {
            let remedy = "convert it, for example: ffmpeg -i IN -vf colorspace=bt709 OUT";
            Error::input(subject, format!("its colour matrix {name} is not understood"), remedy)
        })?,
        (Kind::Yuv, None) => {
            let matrix = if large { Matrix::Bt709 } else { Matrix::Bt601 };
            assumed.push(format!(
                "matrix {matrix}: the stream does not say it, and its pictures are {}",
                if large { "large" } else { "small" }
            ));
            matrix
        }
    };
    let full = match (format.kind, word(&stream.color_range).as_deref()) {
        (Kind::Gray | Kind::Gbr, _) => true,
        _ if format.is_jpeg() => true,
        (Kind::Yuv, Some("pc" | "full" | "jpeg")) => true,
        (Kind::Yuv, Some(_)) => false,
        (Kind::Yuv, None) => {
            assumed.push("limited range: the stream does not say it".into());
            false
        }
    };
    let primaries = word(&stream.color_primaries);
    let transfer = word(&stream.color_transfer);
    if primaries.is_none() {
        assumed.push("primaries bt709: the stream does not say them".into());
    }
    if transfer.is_none() {
        assumed.push("transfer sRGB, as of images: the stream does not say it".into());
    }
    let siting = match stream.chroma_location.as_deref() {
        Some("center") => Siting::CENTER,
        Some("topleft") => Siting::TOP_LEFT,
        Some("top") => Siting::TOP,
        _ if format.is_jpeg() => Siting::CENTER,
        _ => Siting::LEFT,
    };
    Tags::new(matrix, full, primaries.as_deref(), transfer.as_deref(), siting)
        .map_err(|problem| Error::input(subject, problem, "convert it with ffmpeg to bt709, PQ or HLG"))
}

/// What the first frame says beside its picture.
fn first_frame_data(path: &Path, stream: u32, subject: &str) -> Result<Vec<serde_json::Value>> {
    #[derive(Deserialize)]
    struct Frames {
        #[serde(default)]
        frames: Vec<ProbedFrame>,
    }
    #[derive(Deserialize)]
    struct ProbedFrame {
        #[serde(default)]
        side_data_list: Vec<serde_json::Value>,
    }
    let mut ask = tool::command("ffprobe");
    ask.args([
        "-select_streams",
        &stream.to_string(),
        "-read_intervals",
        "%+#1",
        "-show_frames",
        "-print_format",
        "json",
    ]);
    let remedy = "the file is damaged or cut off: copy it again";
    let text = tool::output(ask.arg(tool::local(path)), subject, "its first frame cannot be read", remedy)?;
    let frames = serde_json::from_slice::<Frames>(&text).map_or(Vec::new(), |frames| frames.frames);
    Ok(frames.into_iter().next().map_or(Vec::new(), |frame| frame.side_data_list))
}

/// HDR10's mastering display and content light level.
fn mastering(side_data: &[serde_json::Value]) -> [Option<String>; 2] {
    let of =
        |kind: &str| side_data.iter().find(|data| data.get("side_data_type").and_then(|t| t.as_str()) == Some(kind));
    let display = of("Mastering display metadata").and_then(|data| {
        let value = |name: &str, unit: f64| {
            let [a, b] = fraction_of(data.get(name)?)?;
            Some((a / b * unit).round() as u64)
        };
        let xy = |name: &str| {
            Some(format!("({},{})", value(&format!("{name}_x"), 50_000.0)?, value(&format!("{name}_y"), 50_000.0)?))
        };
        let light = format!("({},{})", value("max_luminance", 10_000.0)?, value("min_luminance", 10_000.0)?);
        Some(format!("G{}B{}R{}WP{}L{light}", xy("green")?, xy("blue")?, xy("red")?, xy("white_point")?))
    });
    let content = of("Content light level metadata").and_then(|data| {
        Some(format!("{},{}", data.get("max_content")?.as_u64()?, data.get("max_average")?.as_u64()?))
    });
    [display, content]
}

fn fraction_of(value: &serde_json::Value) -> Option<[f64; 2]> {
    let (a, b) = value.as_str()?.split_once('/')?;
    Some([a.parse().ok()?, b.parse::<f64>().ok().filter(|b| *b > 0.0)?])
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn equal_steps_survive_rounded_stamps() {
        let stamps: Vec<Option<f64>> =
            (0..90).map(|i| Some(0.08 + (f64::from(i) * 1000.0 / 29.97).round() / 1000.0)).collect();
        let (times, start, rate) = timing(&stamps, Some([30000, 1001]));
        assert_eq!((rate, start), ([30000, 1001], Some(0.08)));
        assert!(times.iter().enumerate().all(|(i, time)| (time - i as f64 * 1001.0 / 30000.0).abs() < 1e-9));
        let (times, _, rate) = timing(&[Some(0.0), Some(0.1), Some(0.5), Some(0.6)], Some([90000, 1]));
        assert_eq!((times, rate), (vec![0.0, 0.1, 0.5, 0.6], [5, 1]));
        let (times, start, _) = timing(&[None, None], None);
        assert_eq!((times, start), (vec![0.0, 1.0 / 30.0], None));
    }
}
