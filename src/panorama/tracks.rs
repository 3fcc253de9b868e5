//! Which pictures of which files make a frame of the panorama, and when it is shown.

use super::{
    clipped::Clipped,
    cube,
    pattern::{Pattern, over_gaps},
    source::{DepthSource, PanoramaSpec},
};
use crate::{
    Error, Result,
    media::{self, VideoInfo},
};
use std::{
    iter,
    path::Path,
    sync::{Arc, OnceLock},
};

/// Where pictures of colour or of depth come from.
#[derive(Clone, Debug)]
pub(super) enum Track {
    /// An image, or numbered images.
    Images(Pattern),
    Video(Arc<VideoInfo>),
}

impl Track {
    /// Finds out which it is. A video's header is read.
    pub fn open(path: &Path) -> Result<Self> {
        if media::is_video(path) {
            return Ok(Self::Video(Arc::new(VideoInfo::of(path)?)));
        }
        Ok(Self::Images(Pattern::parse(path)?))
    }

    pub fn video(&self) -> Option<&Arc<VideoInfo>> {
        match self {
            Self::Video(info) => Some(info),
            Self::Images(_) => None,
        }
    }
}

/// The pictures of a frame: numbers of files, or of frames of a video from 0.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct Pick {
    pub color: u32,
    pub depth: u32,
}

/// The tracks and which of their pictures belong together.
#[derive(Clone, Debug)]
pub(super) struct Plan {
    pub spec: Arc<PanoramaSpec>,
    pub color: Track,
    pub depth: Option<Track>,
    pub picks: Vec<Pick>,
    /// When each frame is shown, seconds from the first.
    pub times: Vec<f64>,
    /// Frames a second, the mean if that varies.
    pub fps: f64,
    /// The same as a fraction.
    pub rate: [u32; 2],
    /// Width and height of the pictures in their files, once one was loaded.
    pub picture_size: OnceLock<[u32; 2]>,
    /// What was estimated of the clipped lamps in the first frame, once it was loaded.
    pub clipped: OnceLock<Clipped>,
}

impl Plan {
    /// Finds the files, but does not read them.
    ///
    /// # Errors
    /// Fails if a pattern is bad, if there are no frames, or if files are missing.
    pub fn of(spec: PanoramaSpec, warnings: &mut Vec<String>) -> Result<Self> {
        let color = Track::open(&spec.color)?;
        let depth = match &spec.depth {
            DepthSource::Files(path) => Some(Track::open(path)?),
            _ => None,
        };
        match (color, depth) {
            (Track::Images(color), None) => Self::of_images(spec, color, None, warnings),
            (Track::Images(color), Some(Track::Images(depth))) => Self::of_images(spec, color, Some(depth), warnings),
            (color, depth) => Self::of_videos(spec, color, depth, warnings),
        }
    }

    /// Puts images together, single or numbered.
    fn of_images(
        spec: PanoramaSpec,
        color: Pattern,
        depth: Option<Pattern>,
        warnings: &mut Vec<String>,
    ) -> Result<Self> {
        let patterns = || iter::once(&color).chain(&depth);
        let numbers: Vec<u32> = match (spec.frames, patterns().find(|pattern| pattern.is_sequence())) {
            (_, None) => vec![0],
            (Some(range), Some(_)) => (range.first..=range.last).step_by(range.step.max(1) as usize).collect(),
            (None, Some(pattern)) => {
                let numbers = pattern.existing()?;
                if numbers.is_empty() {
                    let remedy = "check the pattern or give frames = [a, b]";
                    return Err(Error::input(spec.color.display(), "no file fits this pattern", remedy));
                }
                over_gaps(&numbers, pattern, warnings)
            }
        };
        let mut files = numbers.iter().flat_map(|number| patterns().map(|pattern| pattern.file(*number)));
        files.try_for_each(|file| demand(&file))?;
        let fps = spec.fps;
        Ok(Self {
            times: (0..numbers.len()).map(|index| index as f64 / fps).collect(),
            picks: numbers.iter().map(|number| Pick { color: *number, depth: *number }).collect(),
            fps,
            rate: media::rate::rational(fps),
            picture_size: OnceLock::new(),
            clipped: OnceLock::new(),
            spec: Arc::new(spec),
            color: Track::Images(color),
            depth: depth.map(Track::Images),
        })
    }

    /// Puts videos together with what else there is. Fails if frames are asked for that do not exist, or if depth
    /// ends before colour.
    fn of_videos(spec: PanoramaSpec, color: Track, depth: Option<Track>, warnings: &mut Vec<String>) -> Result<Self> {
        let subject = spec.color.display().to_string();
        let color_files = files(&color)?;
        let depth_files = depth.as_ref().map(files).transpose()?;
        let (fps, by_fps) =
            (spec.fps, |count: usize, fps: f64| (0..count).map(move |i| i as f64 / fps).collect::<Vec<_>>());
        let times_of = |track: &Track, files: &Files| match (track, files) {
            (Track::Video(info), _) => Some((info.times.clone(), info.rate)),
            (_, Files::Numbers(numbers)) => Some((by_fps(numbers.len(), fps), media::rate::rational(fps))),
            (_, Files::One) => None,
        };
        let of_color = times_of(&color, &color_files);
        let of_depth = depth.as_ref().zip(depth_files.as_ref()).and_then(|(track, files)| times_of(track, files));
        let Some((times, rate)) = of_color.clone().or(of_depth.clone()) else {
            return Err(Error::Internal("no video among the tracks".into()));
        };
        let chosen: Vec<usize> = match spec.frames {
            None => (0..times.len()).collect(),
            Some(range) => {
                if range.last as usize >= times.len() {
                    let problem = format!("frames: there is no frame {} in its {} frames", range.last, times.len());
                    let remedy = format!("give a range from 0 to {}", times.len() - 1);
                    return Err(Error::input(&subject, problem, remedy));
                }
                (range.first as usize..=range.last as usize).step_by(range.step.max(1) as usize).collect()
            }
        };
        let mut depth_index = chosen.clone();
        if let (Some((color_times, color_rate)), Some((depth_times, depth_rate)), DepthSource::Files(path)) =
            (&of_color, &of_depth, &spec.depth)
        {
            let (count, all) = (depth_times.len(), color_times.len());
            let rates = [color_rate, depth_rate].map(|[a, b]| f64::from(*a) / f64::from(*b));
            let near = |ratio: f64| (ratio - 1.0).abs() <= 0.02;
            // Numbers of images have no times of their own, unless they end together.
            let of_videos = color.video().is_some() && depth.as_ref().is_some_and(|depth| depth.video().is_some());
            let timed = of_videos || near(all as f64 / count as f64 * rates[1] / rates[0]);
            let differ = timed && !near(rates[0] / rates[1]);
            let shown = if differ && count != all { at_times(color_times, depth_times) } else { (0..count).collect() };
            if let Some(needed) = chosen.iter().find(|index| **index >= shown.len()) {
                let problem =
                    format!("has {count} frames, but the colour has {all}, of which number {needed} is needed");
                let remedy = format!("give depth for all of it, or write frames = [0, {}]", shown.len().max(1) - 1);
                return Err(Error::input(path.display(), problem, remedy));
            }
            depth_index = chosen.iter().map(|index| shown[*index]).collect();
            if differ {
                let how = if count == all { "number" } else { "time" };
                let rates = rates.map(|rate| (rate * 100.0).round() / 100.0);
                let problem = format!("has {} frames a second, but the colour has {}", rates[1], rates[0]);
                warnings.push(format!("{}: {problem}: they are matched by their {how}", path.display()));
            }
            if count > all && !differ && spec.frames.is_none() {
                warnings.push(format!("{}: has more frames than the colour; the rest is left out", path.display()));
            }
        }
        if spec.frames.is_none() {
            iter::once(&color).chain(&depth).filter_map(Track::video).try_for_each(|info| info.demand_all())?;
        }
        let number = |files: &Files, index: usize| match files {
            Files::One => 0,
            Files::Numbers(numbers) => numbers.get(index).copied().unwrap_or(0),
        };
        let pick = |(color, depth): (&usize, &usize)| Pick {
            color: number(&color_files, *color),
            depth: depth_files.as_ref().map_or(0, |files| number(files, *depth)),
        };
        let picks: Vec<Pick> = chosen.iter().zip(&depth_index).map(pick).collect();
        let first = times[chosen[0]];
        let step = chosen.get(1).map_or(1, |next| next - chosen[0]) as u32;
        let rate = [rate[0], rate[1].saturating_mul(step)];
        let times = chosen.iter().map(|index| times[*index] - first).collect();
        if let Some(info) = color.video().filter(|info| !info.assumed.is_empty()) {
            warnings.push(format!("{}: assumed {}", info.path.display(), info.assumed.join("; ")));
        }
        let fps = f64::from(rate[0]) / f64::from(rate[1]);
        let (picture_size, clipped) = (OnceLock::new(), OnceLock::new());
        Ok(Self { spec: Arc::new(spec), color, depth, picks, times, fps, rate, picture_size, clipped })
    }
}

/// The pictures of a track.
enum Files {
    One,
    Numbers(Vec<u32>),
}

fn files(track: &Track) -> Result<Files> {
    Ok(match track {
        Track::Video(info) => Files::Numbers((0..info.frame_count() as u32).collect()),
        Track::Images(pattern) if pattern.is_sequence() => {
            let numbers = pattern.existing()?;
            if numbers.is_empty() {
                let problem = "no file fits this pattern";
                return Err(Error::input(pattern.file(0).display(), problem, "check the pattern"));
            }
            Files::Numbers(numbers)
        }
        Track::Images(pattern) => {
            demand(&pattern.file(0))?;
            Files::One
        }
    })
}

/// Fails if there is no such file, or if one of the six is missing that a cubemap's name stands for.
fn demand(file: &Path) -> Result<()> {
    match cube::has_faces(file) {
        true => cube::files(file).map(|_| ()),
        false if file.exists() => Ok(()),
        false => Err(Error::input(file.display(), "there is no such file", "check the name and the frames")),
    }
}

/// Which frame of depth is shown at the time of each frame of colour, as far as there is depth.
fn at_times(color: &[f64], depth: &[f64]) -> Vec<usize> {
    let last = depth.last().copied().unwrap_or(0.0);
    let end = last + if depth.len() > 1 { last / (depth.len() - 1) as f64 } else { f64::INFINITY };
    let shown = |time: &f64| depth.partition_point(|start| *start <= *time + STAMP).max(1) - 1;
    color.iter().take_while(|time| **time < end - STAMP).map(shown).collect()
}

/// Time stamps may be off by this much, seconds.
const STAMP: f64 = 1e-3;

#[cfg(test)]
mod tests {
    use super::at_times;

    #[test]
    fn depth_of_another_rate_goes_by_time() {
        let every = |fps: f64, count: usize| (0..count).map(|i| i as f64 / fps).collect::<Vec<_>>();
        assert_eq!(at_times(&every(30.0, 6), &every(15.0, 3)), [0, 0, 1, 1, 2, 2]);
        assert_eq!(at_times(&every(30.0, 8), &every(15.0, 3)), [0, 0, 1, 1, 2, 2], "depth ends before colour");
        assert_eq!(at_times(&every(10.0, 3), &every(30.0, 99)), [0, 3, 6]);
    }
}
