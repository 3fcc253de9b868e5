//! Frames of images, sequences and videos, one at a time. All who ask for a frame share it, and the next one is made
//! on a thread of its own while frames are asked for in order.

use super::{
    clipped::{self, Clipped},
    cube,
    frame::{Picture, make_frame},
    source::{LampRule, PanoramaFrame},
    tracks::{Pick, Plan, Track},
};
use crate::{Error, Result, media::Decoder};
use std::{
    collections::VecDeque,
    fmt,
    sync::{
        Arc, Mutex, PoisonError,
        mpsc::{Receiver, SyncSender, sync_channel},
    },
    thread::JoinHandle,
};

/// Reads and decodes frames, best in order.
struct Reader {
    plan: Arc<Plan>,
    color: Option<Decoder>,
    depth: Option<Decoder>,
    last: Option<Made>,
}

/// The last frame that was made, and from what. The same pictures again are the same frame.
struct Made {
    pick: Pick,
    codes: [Option<Arc<Vec<u8>>>; 2],
    frame: Arc<PanoramaFrame>,
}

impl Reader {
    fn new(plan: Arc<Plan>) -> Self {
        let decoder = |track: Option<&Track>| track.and_then(Track::video).map(|info| Decoder::new(Arc::clone(info)));
        let (color, depth) = (decoder(Some(&plan.color)), decoder(plan.depth.as_ref()));
        Self { plan, color, depth, last: None }
    }

    /// Makes a frame, and returns it with the codes of its colour if they are a video's.
    fn load(&mut self, index: usize) -> Loaded {
        let frame = self.frame(index)?;
        Ok((frame, self.last.as_ref().and_then(|last| last.codes[0].clone())))
    }

    fn frame(&mut self, index: usize) -> Result<Arc<PanoramaFrame>> {
        let plan = Arc::clone(&self.plan);
        let pick = plan.picks[index];
        if let Some(last) = self.last.as_ref().filter(|last| last.pick == pick) {
            return Ok(Arc::clone(&last.frame));
        }
        let old = |which: usize, same: bool| {
            let last = self.last.as_ref().filter(|_| same)?;
            last.codes[which].clone()
        };
        // A still picture beside a moving one is decoded once.
        let kept = self.last.as_ref().map(|last| last.pick);
        let old = [
            old(0, kept.is_some_and(|kept| kept.color == pick.color)),
            old(1, kept.is_some_and(|kept| kept.depth == pick.depth)),
        ];
        let [old_color, old_depth] = old;
        let decode = |decoder: &mut Option<Decoder>, old: Option<Arc<Vec<u8>>>, number: u32| match (decoder, old) {
            (Some(_), Some(codes)) => Ok(Some(codes)),
            (Some(decoder), None) => decoder.read(number as usize).map(|codes| Some(Arc::new(codes))),
            (None, _) => Ok(None),
        };
        let color = decode(&mut self.color, old_color, pick.color)?;
        let depth = decode(&mut self.depth, old_depth, pick.depth)?;
        // The same codes as before make the same frame, which then need not be processed again.
        if let Some(last) = &mut self.last {
            let is_same = |new: &Option<Arc<Vec<u8>>>,
                           old: &Option<Arc<Vec<u8>>>,
                           track: Option<&Track>,
                           same: bool| match (new, old) {
                (Some(new), Some(old)) => Arc::ptr_eq(new, old) || new == old,
                _ => track.is_none() || same,
            };
            let same_color = is_same(&color, &last.codes[0], Some(&plan.color), last.pick.color == pick.color);
            let same_depth = is_same(&depth, &last.codes[1], plan.depth.as_ref(), last.pick.depth == pick.depth);
            let masked = plan.spec.mask.is_some() && last.pick.color != pick.color;
            if same_color && same_depth && !masked {
                last.pick = pick;
                return Ok(Arc::clone(&last.frame));
            }
        }
        let file = |track: &Track, number: u32| match track {
            Track::Images(pattern) => pattern.file(number),
            Track::Video(info) => info.path.clone(),
        };
        let picture = |track: &Track, number: u32, codes: &Option<Arc<Vec<u8>>>| -> Result<Picture> {
            let path = file(track, number);
            let subject = path.display().to_string();
            match (track, codes) {
                (Track::Video(info), Some(codes)) => {
                    Ok(Picture::Video { subject, info: Arc::clone(info), codes: Arc::clone(codes) })
                }
                _ => Ok(Picture::File { subject, path }),
            }
        };
        let color_picture = picture(&plan.color, pick.color, &color)?;
        let depth_picture = plan.depth.as_ref().map(|track| picture(track, pick.depth, &depth)).transpose()?;
        let (mut frame, size) = make_frame(&plan.spec, pick.color, index == 0, color_picture, depth_picture)?;
        if let Some(white) = frame.white {
            if index > 0 && plan.spec.lamps == LampRule::Estimate && plan.clipped.get().is_none() {
                Self::new(Arc::clone(&plan)).frame(0)?; // the first frame tells
                plan.clipped.get_or_init(Clipped::default); // it may not be one that clips
            }
            plan.spec.lamps.clipped(&plan.clipped, || clipped::estimate(&frame, white)).raise(&mut frame, white);
        }
        let frame = Arc::new(frame);
        let _ = plan.picture_size.set(size); // that of the first frame counts
        self.last = Some(Made { pick, codes: [color, depth], frame: Arc::clone(&frame) });
        Ok(frame)
    }
}

type Loaded = Result<(Arc<PanoramaFrame>, Option<Arc<Vec<u8>>>)>;

/// The frames of a plan. Clones of a source share one.
pub(super) struct Stream {
    plan: Arc<Plan>,
    state: Mutex<State>,
}

struct State {
    /// Absent while the thread has it.
    reader: Option<Reader>,
    ahead: Option<Ahead>,
    kept: VecDeque<(usize, Arc<PanoramaFrame>)>,
    /// The codes of the last frames' colour.
    codes: VecDeque<(usize, Arc<Vec<u8>>)>,
    /// The last frame that was made.
    last: Option<usize>,
}

/// A thread that makes frames before they are asked for.
struct Ahead {
    next: usize,
    frames: Receiver<Loaded>,
    thread: JoinHandle<Reader>,
}

/// Frames are kept while they take no more than this.
const KEPT_BYTES: usize = 384 << 20;
const KEPT_FRAMES: usize = 4;
/// Codes take little beside them.
const KEPT_CODES: usize = 4;

/// A frame so far ahead of the thread is read on its own.
const NEAR: usize = 4;

impl Stream {
    pub fn new(plan: Plan) -> Self {
        let plan = Arc::new(plan);
        let reader = Some(Reader::new(Arc::clone(&plan)));
        Self {
            plan,
            state: Mutex::new(State { reader, ahead: None, kept: VecDeque::new(), codes: VecDeque::new(), last: None }),
        }
    }

    pub fn plan(&self) -> &Plan {
        &self.plan
    }

    /// Returns a frame that is kept or was made ahead, or makes it.
    pub fn load(&self, index: usize) -> Result<Arc<PanoramaFrame>> {
        let mut state = self.state.lock().unwrap_or_else(PoisonError::into_inner);
        if let Some((_, frame)) = state.kept.iter().find(|(known, _)| *known == index) {
            return Ok(Arc::clone(frame));
        }
        let in_order = state.last.is_some_and(|last| last + 1 == index);
        let (frame, codes) = match state.made_ahead(index) {
            Some(frame) => frame?,
            None => {
                let mut reader = state.take_back(&self.plan);
                let loaded = reader.load(index);
                // Someone who asks for one frame after another will ask for the next one.
                if in_order && loaded.is_ok() && index + 1 < self.plan.picks.len() {
                    state.ahead = Some(Ahead::start(reader, index + 1, self.plan.picks.len()));
                } else {
                    state.reader = Some(reader);
                }
                loaded?
            }
        };
        state.keep(index, &frame);
        if let Some(codes) = codes {
            state.codes.push_back((index, codes));
            let more = state.codes.len().saturating_sub(KEPT_CODES);
            state.codes.drain(..more);
        }
        Ok(frame)
    }

    /// Returns the codes of a frame that was loaded a short time ago, if its colour is a video's.
    pub fn codes(&self, index: usize) -> Option<Arc<Vec<u8>>> {
        let state = self.state.lock().unwrap_or_else(PoisonError::into_inner);
        state.codes.iter().find(|(known, _)| *known == index).map(|(_, codes)| Arc::clone(codes))
    }
}

impl State {
    /// Returns a frame from the thread, if it makes that one next or soon.
    fn made_ahead(&mut self, index: usize) -> Option<Loaded> {
        let ahead = self.ahead.as_mut().filter(|ahead| ahead.next <= index && index - ahead.next < NEAR)?;
        loop {
            let frame = ahead.frames.recv().ok()?;
            ahead.next += 1;
            if frame.is_err() || ahead.next > index {
                return Some(frame);
            }
        }
    }

    /// Stops the thread.
    fn take_back(&mut self, plan: &Arc<Plan>) -> Reader {
        let returned = self.ahead.take().and_then(|ahead| {
            drop(ahead.frames);
            ahead.thread.join().ok()
        });
        self.reader.take().or(returned).unwrap_or_else(|| Reader::new(Arc::clone(plan)))
    }

    fn keep(&mut self, index: usize, frame: &Arc<PanoramaFrame>) {
        self.last = Some(index);
        self.kept.push_back((index, Arc::clone(frame)));
        let bytes =
            |kept: &VecDeque<(usize, Arc<PanoramaFrame>)>| kept.iter().map(|(_, frame)| frame.bytes()).sum::<usize>();
        while self.kept.len() > KEPT_FRAMES || (!self.kept.is_empty() && bytes(&self.kept) > KEPT_BYTES) {
            self.kept.pop_front();
        }
    }
}

impl Ahead {
    fn start(reader: Reader, next: usize, end: usize) -> Self {
        // One frame waits while the next one is made.
        let (sender, frames) = sync_channel(1);
        let thread = std::thread::spawn(move || make_frames(reader, next..end, &sender));
        Self { next, frames, thread }
    }
}

fn make_frames(mut reader: Reader, indices: std::ops::Range<usize>, frames: &SyncSender<Loaded>) -> Reader {
    for index in indices {
        let frame = reader.load(index);
        let failed = frame.is_err();
        if frames.send(frame).is_err() || failed {
            break;
        }
    }
    reader
}

impl Drop for Stream {
    fn drop(&mut self) {
        let state = self.state.get_mut().unwrap_or_else(PoisonError::into_inner);
        if let Some(ahead) = state.ahead.take() {
            drop(ahead.frames);
            let _ = ahead.thread.join();
        }
    }
}

impl fmt::Debug for Stream {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_struct("Stream").field("plan", &self.plan).finish_non_exhaustive()
    }
}

/// The first picture of a video, of a sequence or of an image file, as an image.
///
/// # Errors
/// Fails if there is none, or if it cannot be read.
pub fn first_picture(path: &std::path::Path) -> Result<crate::image_file::FileImage> {
    match Track::open(path)? {
        Track::Images(pattern) if pattern.is_sequence() => {
            let Some(number) = pattern.existing()?.first().copied() else {
                return Err(Error::input(path.display(), "no file fits this pattern", "check the pattern"));
            };
            cube::read(&pattern.file(number))
        }
        Track::Images(pattern) => cube::read(&pattern.file(0)),
        Track::Video(info) => {
            let codes = Decoder::new(Arc::clone(&info)).read(0)?;
            Ok(info.planes(&codes).image())
        }
    }
}
