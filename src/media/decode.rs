//! Decodes frames of a video: one child process, read from a pipe, that is started anew to seek.

use super::{probe::VideoInfo, tool};
use crate::{Error, Result};
use std::{
    io::Read,
    process::{Child, ChildStdout},
    sync::Arc,
    thread::JoinHandle,
};

/// A frame so far ahead is sought, and nearer ones are read up to.
const NEAR: usize = 60;

/// Reads frames as raw codes, best in order.
pub struct Decoder {
    info: Arc<VideoInfo>,
    running: Option<Running>,
}

struct Running {
    child: Child,
    out: ChildStdout,
    said: Option<JoinHandle<String>>,
    /// The frame that comes next.
    next: usize,
}

impl Decoder {
    pub fn new(info: Arc<VideoInfo>) -> Self {
        Self { info, running: None }
    }

    /// Reads frame `index`, plane after plane in the video's [`format`](VideoInfo::format).
    ///
    /// # Errors
    /// Fails if the file ends before that frame, or if it cannot be decoded.
    pub fn read(&mut self, index: usize) -> Result<Vec<u8>> {
        let reached = |running: &Running| running.next <= index && index - running.next <= NEAR;
        if !self.running.as_ref().is_some_and(reached) {
            self.running = None;
            self.running = Some(self.start(index)?);
        }
        let mut bytes = vec![0; self.info.format.frame_bytes(self.info.size)];
        loop {
            let Some(running) = &mut self.running else {
                return Err(Error::Internal("no decoder".into()));
            };
            if running.out.read_exact(&mut bytes).is_err() {
                let at = running.next;
                return Err(self.ended(at));
            }
            running.next += 1;
            if running.next > index {
                return Ok(bytes);
            }
        }
    }

    fn start(&self, index: usize) -> Result<Running> {
        let info = &*self.info;
        let mut command = tool::command("ffmpeg");
        if index > 0 {
            // Half a frame early: the first frame that is not before.
            let time = info.start + 0.5 * (info.times[index] + info.times[index - 1]);
            command.args(["-ss", &format!("{time:.6}")]);
        }
        command.arg("-i").arg(tool::local(&info.path));
        command.args(["-map", &format!("0:{}", info.stream)]).args(tool::every_frame());
        command.args(["-f", "rawvideo", "-pix_fmt", info.format.name(), "pipe:1"]);
        let mut child = tool::start(&mut command, &info.path.display().to_string())?;
        let said = Some(tool::listen(child.stderr.take()));
        let Some(out) = child.stdout.take() else { return Err(Error::Internal("a child without a pipe".into())) };
        Ok(Running { child, out, said, next: index })
    }

    /// Says why there is no frame `at`.
    fn ended(&mut self, at: usize) -> Error {
        let subject = self.info.path.display().to_string();
        let Some(mut running) = self.running.take() else { return Error::Internal("no decoder".into()) };
        // Its output is closed, so it has ended or is about to.
        let status = running.child.wait().ok();
        let said = running.said.take().and_then(|said| said.join().ok()).unwrap_or_default();
        tool::killed(status, "ffmpeg", &subject)
            .unwrap_or_else(|| ended(&self.info, at, &tool::last_words(&said, &subject)))
    }
}

impl VideoInfo {
    /// Decodes the whole file and counts. Returns a warning if the decoder had something to say.
    ///
    /// # Errors
    /// Fails if the file ends early, or if it cannot be decoded.
    pub fn verify(&self) -> Result<Option<String>> {
        self.demand_all()?;
        let subject = self.path.display().to_string();
        let mut command = tool::command("ffmpeg");
        command.arg("-i").arg(tool::local(&self.path)).args(["-map", &format!("0:{}", self.stream)]);
        command.args(tool::every_frame()).args(["-progress", "pipe:1", "-nostats", "-f", "null", "-"]);
        let mut child = tool::start(&mut command, &subject)?;
        let said = tool::listen(child.stderr.take());
        let mut progress = String::new();
        if let Some(out) = &mut child.stdout {
            // Whatever cannot be read is not counted.
            let _ = out.read_to_string(&mut progress);
        }
        if let Some(error) = tool::killed(child.wait().ok(), "ffmpeg", &subject) {
            return Err(error);
        }
        // Where frames go to, which is nowhere, is no matter of the file: frames of a rate that varies go there at one time.
        let of_file = |line: &&str| !line.contains("to muxer") && !line.contains("message repeated");
        let said = said.join().unwrap_or_default().lines().filter(of_file).collect::<Vec<_>>().join("\n");
        let words = tool::last_words(&said, &subject);
        let mut counts = progress.lines().filter_map(|line| line.strip_prefix("frame=")?.trim().parse::<usize>().ok());
        let decoded = counts.next_back().unwrap_or(0);
        if decoded < self.frame_count() {
            return Err(ended(self, decoded, &words));
        }
        Ok((!words.is_empty()).then(|| format!("{subject}: it is damaged, the decoder says{words}")))
    }
}

fn ended(info: &VideoInfo, at: usize, words: &str) -> Error {
    let problem = format!("ends at frame {at}, but should have {} frames{words}", info.frame_count());
    let remedy = match at {
        0 => "the file is damaged: copy it again".to_owned(),
        _ => format!("it is damaged or cut off: copy it again, or write frames = [0, {}]", at - 1),
    };
    Error::input(info.path.display(), problem, remedy)
}

impl Drop for Running {
    fn drop(&mut self) {
        tool::end(&mut self.child);
    }
}
