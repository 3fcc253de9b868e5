//! Writes a video in parts, so that a run that was interrupted goes on where it was. The parts lie in a hidden folder
//! beside the video, which has its name only when it is whole.

use super::{
    encode::{Codec, Container, Encoder, Encoding},
    planes::Part,
    probe::VideoInfo,
    spherical::{self, Views},
    tool,
};
use crate::{
    Error, Result,
    image_file::{
        tonemap::Tonemap,
        write::{folder_of, make_folder, write_bytes},
    },
    temporary::Temporary,
};
use glam::Vec3;
use rayon::prelude::*;
use std::{
    fs,
    path::{Path, PathBuf},
    sync::{
        Arc,
        mpsc::{Receiver, SyncSender, sync_channel},
    },
    thread::JoinHandle,
};

/// Frames of a part. What is lost when a machine dies is at most this much.
const PART: u32 = 48;

/// A picture on its way to an encoder.
pub struct Shot {
    /// Linear radiance, RGBA.
    pub texels: Vec<[f32; 4]>,
    /// The source's frame, if a pixel of it may be a pixel of this.
    pub source: Option<SourceCodes>,
    /// How often it is shown.
    pub times: u32,
}

/// A frame of the source as its codes.
#[derive(Clone)]
pub struct SourceCodes {
    pub info: Arc<VideoInfo>,
    pub bytes: Arc<Vec<u8>>,
    /// Where the colour is.
    pub part: Part,
}

/// How light becomes what is seen.
#[derive(Clone)]
pub struct Look {
    pub exposure: f32,
    /// What becomes of light beyond white, but in HDR.
    pub tonemap: Tonemap,
    /// What is undone where the output holds no more than white.
    pub for_display: Arc<dyn Fn(Vec3) -> Vec3 + Send + Sync>,
}

impl Encoding {
    /// Returns the bytes of a picture's frame.
    pub fn frame(&self, shot: &Shot, look: &Look) -> Vec<u8> {
        let tags = &self.packer.tags;
        let shown = |texel: &[f32; 4]| {
            let light = Vec3::new(texel[0], texel[1], texel[2]);
            if tags.is_hdr() {
                return tags.shown(light * look.exposure);
            }
            let light = (look.for_display)(light) * look.exposure;
            // Codes have room for what is a little brighter than white.
            tags.shown(if look.tonemap == Tonemap::Clip { light } else { look.tonemap.map(light) })
        };
        let shown: Vec<[f32; 3]> = shot.texels.par_iter().map(shown).collect();
        match &shot.source {
            Some(SourceCodes { info, bytes, part }) => self.packer.pack(&shown, Some((&info.planes(bytes), *part))),
            None => self.packer.pack(&shown, None),
        }
    }
}

/// What joins the pictures in the file.
#[derive(Clone, Debug, Default)]
pub struct Extras {
    /// A file whose sound is copied, with its codec, from this second on.
    pub audio: Option<(PathBuf, String, f64)>,
    /// What players should take it for, if it is a panorama.
    pub spherical: Option<Views>,
}

/// A video that is being written.
pub struct Film {
    path: PathBuf,
    folder: PathBuf,
    encoding: Arc<Encoding>,
    /// The first and the last frame.
    range: [u32; 2],
    /// The frame that comes next.
    next: u32,
    sender: Option<SyncSender<Shot>>,
    thread: Option<JoinHandle<Result<()>>>,
}

impl Film {
    /// Begins a video, or goes on with one. `job` stands for all that its frames depend on.
    ///
    /// # Errors
    /// Fails if the folder of the parts cannot be made or read.
    pub fn begin(path: &Path, encoding: Encoding, look: Look, job: &str, [first, last]: [u32; 2]) -> Result<Self> {
        let folder = parts_folder(path)?;
        let job = format!("{job} {:?} {:?} {:?}\n", encoding.codec, encoding.crf, encoding.packer);
        let job = blake3::hash(job.as_bytes()).to_hex().to_string();
        let note = folder.join("job");
        if fs::read_to_string(&note).is_ok_and(|known| known != job) {
            clear(&folder)?;
        }
        make_folder(&folder)?;
        write_bytes(&note, job.as_bytes()).inspect_err(|_| clear_if_empty(&folder))?;
        let next = chain(&folder, [first, last])?.last().map_or(first, |(_, to, _)| to + 1);
        let encoding = Arc::new(encoding);
        // One picture waits while the one before is encoded.
        let (sender, shots) = sync_channel(1);
        let subject = path.display().to_string();
        let writer = Writer { encoding: Arc::clone(&encoding), look, folder: folder.clone(), next, subject };
        let thread = Some(std::thread::spawn(move || writer.run(&shots)));
        let (path, range) = (path.to_owned(), [first, last]);
        Ok(Self { path, folder, encoding, range, next, sender: Some(sender), thread })
    }

    /// The frame that comes next: the first one, unless there are parts already.
    pub fn next(&self) -> u32 {
        self.next
    }

    /// How it is encoded.
    pub fn encoding(&self) -> &Encoding {
        &self.encoding
    }

    /// Hands over the next frame.
    ///
    /// # Errors
    /// Fails if a frame before it could not be written.
    pub fn write(&mut self, shot: Shot) -> Result<()> {
        self.next += 1;
        match &self.sender {
            Some(sender) if sender.send(shot).is_ok() => Ok(()),
            _ => self.stop().and(Err(Error::Internal("the encoder's thread ended".into()))),
        }
    }

    /// Waits until what was handed over is written.
    ///
    /// # Errors
    /// Fails if something could not be written.
    pub fn stop(&mut self) -> Result<()> {
        self.sender = None;
        match self.thread.take().map(JoinHandle::join) {
            Some(Ok(result)) => result,
            Some(Err(_)) => Err(Error::Internal("the encoder's thread panicked".into())),
            None => Ok(()),
        }
    }

    /// Puts the parts together, and gives the file its name.
    ///
    /// # Errors
    /// Fails if something cannot be written.
    pub fn finish(mut self, extras: &Extras) -> Result<()> {
        self.stop()?;
        let rate = f64::from(self.encoding.rate[0]) / f64::from(self.encoding.rate[1]);
        let mut list = String::from("ffconcat version 1.0\n");
        let mut seconds = 0.0;
        for (_, _, file) in chain(&self.folder, self.range)? {
            let count =
                fs::read_to_string(file.with_extension("count")).ok().and_then(|n| n.trim().parse::<u32>().ok());
            let duration = f64::from(count.unwrap_or(0)) / rate;
            seconds += duration;
            let name = file.file_name().map(|name| name.to_string_lossy().into_owned()).unwrap_or_default();
            list.push_str(&format!("file '{name}'\nduration {duration:.9}\n"));
        }
        let list_file = self.folder.join("list");
        write_bytes(&list_file, list.as_bytes())?;
        let parent = folder_of(&self.path);
        let unwritable = |error: &std::io::Error| {
            Error::input(self.path.display(), format!("cannot be written: {}", error.kind()), "give a writable folder")
        };
        let whole = Temporary::new(parent).map_err(|error| unwritable(&error))?;
        self.join(&list_file, whole.path(), extras, seconds)?;
        whole.keep(&self.path).map_err(|error| unwritable(&error))?;
        clear(&self.folder)
    }

    fn join(&self, list: &Path, to: &Path, extras: &Extras, seconds: f64) -> Result<()> {
        let container = self.encoding.container;
        let views = extras.spherical;
        // QuickTime's parts of FFV1 do not say their range; the marks do.
        if views.is_none() && self.encoding.codec != Codec::Ffv1 {
            return self.mux(Source::List(list), to, container, extras, seconds);
        }
        let bare = self.folder.join("bare.mp4");
        let full_range = self.encoding.packer.tags.full_range;
        if container.has_boxes() {
            self.mux(Source::List(list), &bare, container, extras, seconds)?;
            return spherical::mark(&bare, to, views, full_range);
        }
        // What the boxes say is carried over into Matroska's own words.
        let silent = Extras::default();
        let with_boxes =
            if matches!(self.encoding.codec, Codec::Prores | Codec::Ffv1) { Container::Mov } else { Container::Mp4 };
        self.mux(Source::List(list), &bare, with_boxes, &silent, seconds)?;
        let marked = self.folder.join("marked.mp4");
        spherical::mark(&bare, &marked, views, full_range)?;
        self.mux(Source::File(&marked), to, container, extras, seconds)
    }

    fn mux(&self, source: Source, to: &Path, container: Container, extras: &Extras, seconds: f64) -> Result<()> {
        let subject = self.path.display().to_string();
        let mut command = tool::command("ffmpeg");
        command.arg("-y");
        match source {
            Source::List(list) => command.args(["-f", "concat", "-safe", "0", "-i"]).arg(tool::local(list)),
            Source::File(file) => command.arg("-i").arg(tool::local(file)),
        };
        if let Some((file, _, from)) = &extras.audio {
            if *from > 0.0 {
                command.args(["-ss", &format!("{from:.6}")]);
            }
            command.args(["-t", &format!("{seconds:.6}"), "-i"]).arg(tool::local(file));
        }
        command.args(["-map", "0:v:0", "-c:v", "copy"]);
        if matches!(self.encoding.codec, Codec::Hevc) && container.has_boxes() {
            command.args(["-tag:v", "hvc1"]);
        }
        if let Some((_, codec, _)) = &extras.audio {
            command.args(["-map", "1:a:0"]);
            match container {
                // Matroska knows no time before 0, and would move the picture instead.
                _ if container.holds_audio(codec)
                    && !container.has_boxes()
                    && tool::version().is_none_or(|v| v >= [5, 0]) =>
                {
                    command.args(["-c:a", "copy", "-bsf:a", "noise=drop=lt(pts\\,0)"])
                }
                _ if container.holds_audio(codec) => command.args(["-c:a", "copy"]),
                Container::Webm => command.args(["-c:a", "libopus", "-b:a", "160k"]),
                _ => command.args(["-c:a", "aac", "-b:a", "192k"]),
            };
        }
        if container.has_boxes() {
            command.args(["-movflags", "+faststart", "-strict", "unofficial"]);
        }
        command.args(["-map_metadata", "-1", "-f", container.muxer()]).arg(tool::local(to));
        tool::output(&mut command, &subject, "cannot be put together", "free some space, or choose another container")?;
        Ok(())
    }
}

impl Drop for Film {
    fn drop(&mut self) {
        // What was rendered is kept for the next run.
        let _ = self.stop();
        clear_if_empty(&self.folder);
    }
}

enum Source<'a> {
    List(&'a Path),
    File(&'a Path),
}

/// The thread that encodes.
struct Writer {
    encoding: Arc<Encoding>,
    look: Look,
    folder: PathBuf,
    next: u32,
    /// The video, for errors.
    subject: String,
}

impl Writer {
    fn run(mut self, shots: &Receiver<Shot>) -> Result<()> {
        let mut part: Option<(Encoder, u32, u32)> = None;
        let unfinished = self.folder.join(format!("unfinished.{}", self.encoding.part_extension()));
        for shot in shots {
            let bytes = self.encoding.frame(&shot, &self.look);
            let (mut encoder, first, shown) = match part.take() {
                Some(part) => part,
                None => (self.encoding.start(&unfinished, &self.subject)?, self.next, 0),
            };
            encoder.write(&bytes, shot.times)?;
            self.next += 1;
            let shown = shown + shot.times;
            if self.next - first >= PART {
                self.close(encoder, first, shown, &unfinished)?;
            } else {
                part = Some((encoder, first, shown));
            }
        }
        match part {
            Some((encoder, first, shown)) => self.close(encoder, first, shown, &unfinished),
            None => Ok(()),
        }
    }

    fn close(&self, encoder: Encoder, first: u32, shown: u32, unfinished: &Path) -> Result<()> {
        encoder.finish()?;
        let name = self.folder.join(format!("part-{first:07}-{:07}.{}", self.next - 1, self.encoding.part_extension()));
        write_bytes(&name.with_extension("count"), shown.to_string().as_bytes())?;
        fs::rename(unfinished, &name).map_err(|error| {
            Error::input(name.display(), format!("cannot be written: {}", error.kind()), "free some space")
        })
    }
}

/// The folder of a video's parts.
fn parts_folder(path: &Path) -> Result<PathBuf> {
    let name = path.file_name().map(|name| name.to_string_lossy().into_owned());
    let name = name.ok_or_else(|| Error::input(path.display(), "is no file name", "give a name"))?;
    Ok(path.with_file_name(format!(".{name}.iprt-parts")))
}

/// The parts that are whole, in order.
fn parts(folder: &Path) -> Result<Vec<(u32, u32, PathBuf)>> {
    let unreadable = |error: std::io::Error| Error::input(folder.display(), error.kind(), "check its permissions");
    let mut found = Vec::new();
    for entry in fs::read_dir(folder).map_err(unreadable)? {
        let path = entry.map_err(unreadable)?.path();
        let name = path.file_name().map(|name| name.to_string_lossy().into_owned()).unwrap_or_default();
        let stem = name.rsplit_once('.').filter(|(_, extension)| *extension != "count").map(|(stem, _)| stem);
        let Some(range) = stem.and_then(|stem| stem.strip_prefix("part-")) else { continue };
        let numbers = range.split_once('-').and_then(|(from, to)| Some((from.parse().ok()?, to.parse().ok()?)));
        if let Some((from, to)) = numbers {
            found.push((from, to, path));
        }
    }
    found.sort();
    Ok(found)
}

/// The parts that follow each other from the first frame on, up to the last one at most. Others are of longer runs.
fn chain(folder: &Path, [first, last]: [u32; 2]) -> Result<Vec<(u32, u32, PathBuf)>> {
    let mut next = first;
    let mut all = parts(folder)?;
    all.retain(|(from, to, _)| {
        let fits = *from == next && *to <= last;
        next = if fits { to + 1 } else { next };
        fits
    });
    Ok(all)
}

/// Removes a folder of parts that has none.
fn clear_if_empty(folder: &Path) {
    if parts(folder).is_ok_and(|parts| parts.is_empty()) {
        let _ = clear(folder);
    }
}

/// Removes a folder of parts, but no file that is not of this program.
fn clear(folder: &Path) -> Result<()> {
    let Ok(entries) = fs::read_dir(folder) else { return Ok(()) };
    for path in entries.filter_map(|entry| Some(entry.ok()?.path())) {
        let name = path.file_name().map(|name| name.to_string_lossy().into_owned()).unwrap_or_default();
        let own = ["job", "list", "bare.mp4", "marked.mp4"].contains(&name.as_str());
        if own || name.starts_with("part-") || name.starts_with("unfinished.") {
            let _ = fs::remove_file(&path);
        }
    }
    let _ = fs::remove_dir(folder);
    Ok(())
}
