//! Converges scene truth to a number of samples or a level of noise, and keeps its state in a file beside the
//! picture.
//!
//! A state holds the very sums, so an interrupted and resumed run gives the same bits as one that was not
//! interrupted. It names the scene and the settings by a hash, and holds a hash of itself.

use super::path_trace::{PathSettings, PathTracer};
use crate::{
    Error, Result,
    gpu::Gpu,
    image_file::checked::{read_checked, write_checked},
    scene::{
        CompleteScene,
        viewpoint::{Projection, Viewpoint},
    },
};
use glam::Vec3;
use std::{
    ffi::OsString,
    fs,
    path::{Path, PathBuf},
    sync::atomic::{AtomicBool, Ordering},
    time::{Duration, Instant},
};

const MAGIC: &[u8] = b"iprt scene truth 1\n";
/// Noise is compared with the goal at multiples of this many samples, whatever the clock says. The same goal
/// therefore gives the same bits.
pub const NOISE_EVERY: u32 = 16;
const SAVE_EVERY: Duration = Duration::from_secs(60);
const SHOW_EVERY: Duration = Duration::from_secs(3);

/// When a picture is done: at whichever of the two comes first.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Goal {
    /// This many samples a pixel.
    pub samples: u32,
    /// A standard error of this share of the mean
    /// ([`Sums::relative_noise`](super::path_trace::Sums::relative_noise)).
    pub noise: Option<f64>,
}

/// How a run ended.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum End {
    Reached,
    Interrupted,
}

/// Returns the path of a picture's state.
pub fn state_path(picture: &Path) -> PathBuf {
    let mut name = OsString::from(picture);
    name.push(".state");
    name.into()
}

/// Returns where the scene's own camera sees it from in frame `frame`, with the camera at the origin.
pub fn viewpoint(scene: &CompleteScene, projection: Projection, size: [u32; 2], frame: u32) -> Viewpoint {
    let camera = scene.camera.at(scene.frame_time(frame));
    match projection {
        Projection::Perspective => Viewpoint::perspective(Vec3::ZERO, camera.rotation, camera.fov_y_degrees, size),
        Projection::Equirect => Viewpoint::equirect(Vec3::ZERO, camera.rotation),
    }
}

/// Makes the tracer of that picture, with all bounces.
///
/// # Errors
/// Fails as [`PathTracer::new`] does.
pub fn tracer(
    gpu: &Gpu,
    scene: &CompleteScene,
    projection: Projection,
    size: [u32; 2],
    seed: u32,
    frame: u32,
) -> Result<PathTracer> {
    let state = scene.at(scene.frame_time(frame));
    let viewpoint = viewpoint(scene, projection, size, frame);
    let settings = PathSettings::unbiased(size, seed);
    PathTracer::new(gpu, &scene.packed, &state.instances, state.camera.position, &viewpoint, &settings)
}

/// Takes samples until the goal is reached or `stop` is set. Writes the state to `state` once a minute and on
/// interruption. Tells `progress` the samples so far and, every few seconds, the noise.
///
/// # Errors
/// Fails if the device is lost, or if a state cannot be written.
pub fn converge(
    tracer: &mut PathTracer,
    goal: Goal,
    state: Option<&Path>,
    stop: &AtomicBool,
    mut progress: impl FnMut(u32, Option<f64>),
) -> Result<End> {
    let (mut saved, mut shown) = (Instant::now(), Instant::now());
    loop {
        let samples = tracer.samples();
        let compare = goal.noise.filter(|_| samples > 0 && samples.is_multiple_of(NOISE_EVERY));
        let noise = if compare.is_some() || (samples > 1 && shown.elapsed() > SHOW_EVERY) {
            let noise = tracer.read()?.relative_noise();
            shown = Instant::now();
            Some(noise)
        } else {
            None
        };
        progress(samples, noise);
        if samples >= goal.samples || compare.zip(noise).is_some_and(|(most, noise)| noise <= most) {
            return Ok(End::Reached);
        }
        let interrupted = stop.load(Ordering::Relaxed);
        if let Some(state) = state
            && (interrupted || saved.elapsed() > SAVE_EVERY)
        {
            save(tracer, state)?;
            saved = Instant::now();
        }
        if interrupted {
            return Ok(End::Interrupted);
        }
        tracer.sample()?;
    }
}

/// Writes the state of a picture.
///
/// # Errors
/// Fails if the state cannot be written, or if the device is lost.
pub fn save(tracer: &PathTracer, path: &Path) -> Result<()> {
    let sums = tracer.save()?;
    write_checked(path, MAGIC, &sums)
}

/// Goes on from a state, if there is one.
///
/// # Errors
/// Fails if the state cannot be read, is damaged, or belongs to another scene or to other settings.
pub fn resume(tracer: &mut PathTracer, path: &Path) -> Result<()> {
    if !path.exists() {
        return Ok(());
    }
    let Some(sums) = read_checked(path, MAGIC)? else {
        let problem = "is damaged, or no state of this program";
        return Err(Error::input(path.display(), problem, "delete it to start anew"));
    };
    if tracer.restore(&sums)? {
        return Ok(());
    }
    let problem = "is the state of another scene, of other settings or of another version";
    Err(Error::input(path.display(), problem, "give those that it was made with, or delete it to start anew"))
}

/// Demands that there is no state, so that a forgotten flag does not cost hours of work.
///
/// # Errors
/// Fails if there is a state.
pub fn require_none(path: &Path) -> Result<()> {
    if !path.exists() {
        return Ok(());
    }
    let problem = "holds what an earlier run has done";
    Err(Error::input(path.display(), problem, "give --resume to go on with it, or delete it to start anew"))
}

/// Removes the state of a picture that is done.
pub fn remove(path: &Path) {
    if path.exists()
        && let Err(error) = fs::remove_file(path)
    {
        tracing::warn!("{}: cannot be removed: {error}", path.display());
    }
}
