//! Captures the RGBD panorama of a room by path tracing from a point in it. Colour is box-filtered over each
//! texel. Depth is the radial distance at its centre.

use super::{
    denoise::{self, denoise},
    path_trace::{PathSettings, PathTracer, hash_scene},
};
use crate::{
    Error, Result,
    gpu::Gpu,
    image_file::{
        exr_file::ExrLayer,
        read::{decode, read_bytes},
        write::{make_folder, write_bytes, write_exr},
    },
    panorama::{
        depth::Quantisation,
        source::{PanoramaFrame, PanoramaSource},
    },
    scene::{CompleteScene, Scene, file::RenderSettings, packed::PackedInstances, rooms::Room, viewpoint::Viewpoint},
};
use glam::{Quat, Vec3};
use indicatif::{ProgressBar, ProgressStyle};
use std::{
    env,
    path::{Path, PathBuf},
};

/// The file name of the colour in a captured folder.
pub const COLOR_FILE: &str = "color.exr";
/// The file name of the depth, which holds metres in channel Y.
pub const DEPTH_FILE: &str = "depth.exr";
/// The file name of the hash of both files in a cached folder. It is written last.
const CHECK_FILE: &str = "blake3";

/// What a capture can be made with.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct CaptureSettings {
    /// Width and height, texels.
    pub size: [u32; 2],
    /// Samples a texel.
    pub samples: u32,
    /// Random seed.
    pub seed: u32,
    /// Whether the light is filtered ([`denoise`](mod@denoise)).
    pub denoise: bool,
    /// Whether progress is shown on stderr.
    pub progress: bool,
}

impl Default for CaptureSettings {
    /// The settings for the built-in scenes: the result is clean within a minute on two CPU cores.
    fn default() -> Self {
        Self { size: [1024, 512], samples: 12, seed: 0, denoise: true, progress: true }
    }
}

/// Captures a room as it is at a time in seconds.
///
/// # Errors
/// Fails if the room does not fit the device, or if the device is lost.
pub fn capture(
    gpu: &Gpu,
    room: &CompleteScene,
    time: f64,
    position: Vec3,
    settings: &CaptureSettings,
) -> Result<PanoramaFrame> {
    trace_with_bar(gpu, room, &room.at(time).instances, position, settings)
}

/// Captures a room at time 0, or reads it from a folder under `cache` ([`cache_folder`]). A damaged file is
/// made again. If nothing can be written, nothing is kept.
///
/// # Errors
/// Fails as [`capture`] does.
pub fn capture_cached(
    gpu: &Gpu,
    room: &CompleteScene,
    position: Vec3,
    settings: &CaptureSettings,
    cache: Option<&Path>,
) -> Result<PanoramaFrame> {
    state_cached(gpu, room, &room.at(0.0).instances, position, settings, cache)
}

fn state_cached(
    gpu: &Gpu,
    room: &CompleteScene,
    state: &PackedInstances,
    position: Vec3,
    settings: &CaptureSettings,
    cache: Option<&Path>,
) -> Result<PanoramaFrame> {
    let Some(cache) = cache else { return trace_with_bar(gpu, room, state, position, settings) };
    let folder = cache.join(format!("capture-{}", key(room, state, position, settings)?));
    if let Some(frame) = load_cached(&folder) {
        return Ok(frame);
    }
    let frame = trace_with_bar(gpu, room, state, position, settings)?;
    if let Err(error) = store_cached(&folder, &frame) {
        tracing::warn!("the captured panorama is not kept: {error}");
    }
    Ok(frame)
}

/// Makes a scene of a built-in room: captured, or read from the cache, with its objects in it.
///
/// # Errors
/// Fails as [`capture`] does.
pub fn built_in_scene(gpu: &Gpu, room: &Room, settings: &CaptureSettings) -> Result<Scene> {
    let cache = cache_folder();
    let frames = room_frames(gpu, room, settings, cache.as_deref())?;
    let fps = room.video.map_or(30.0, |video| video.fps);
    let panorama = PanoramaSource::from_frames(frames, fps, room.capture_position, 0.0)?;
    Scene::assemble(room.name, panorama, room.camera.clone(), room.objects.clone(), RenderSettings::default())
}

/// Returns the frames of a built-in room's panorama: one, or those of its video at the video's size. Frames
/// in which the room is the same are captured once.
///
/// # Errors
/// Fails as [`capture`] does.
pub fn room_frames(
    gpu: &Gpu,
    room: &Room,
    settings: &CaptureSettings,
    cache: Option<&Path>,
) -> Result<Vec<PanoramaFrame>> {
    let (real, position) = (
        CompleteScene::assemble(room.name, room.model.clone(), room.camera.clone(), Vec::new())?,
        room.capture_position,
    );
    let Some(video) = room.video else {
        return Ok(vec![capture_cached(gpu, &real, position, settings, cache)?]);
    };
    let samples = settings.samples.min(video.samples);
    let settings = CaptureSettings { size: video.size, samples, ..*settings };
    let mut frames: Vec<(String, PanoramaFrame)> = Vec::new();
    for index in 0..video.frames {
        let state = real.at(f64::from(index) / video.fps).instances;
        let name = key(&real, &state, position, &settings)?;
        let frame = match frames.iter().find(|(known, _)| *known == name) {
            Some((_, frame)) => frame.clone(),
            None => state_cached(gpu, &real, &state, position, &settings, cache)?,
        };
        frames.push((name, frame));
    }
    Ok(frames.into_iter().map(|(_, frame)| frame).collect())
}

/// Captures one frame, or a video, into a folder: [`COLOR_FILE`] and [`DEPTH_FILE`], or numbered files.
/// `tick` is called after each sample. Returns whether all that was captured is black.
///
/// # Errors
/// Fails as [`capture`] does, or if a file cannot be written.
pub fn capture_sequence(
    gpu: &Gpu,
    room: &CompleteScene,
    position: Vec3,
    frames: Option<u32>,
    settings: &CaptureSettings,
    folder: &Path,
    mut tick: impl FnMut(),
) -> Result<bool> {
    let mut black = true;
    for index in 0..frames.unwrap_or(1) {
        let state = room.at(room.frame_time(index)).instances;
        // Each frame has noise of its own, as a camera's has.
        let settings = CaptureSettings { seed: settings.seed.wrapping_add(index), ..*settings };
        let frame = trace(gpu, room, &state, position, &settings, &mut tick)?;
        let name = |pattern: &str| match frames {
            Some(_) => pattern.replace(".exr", &format!("_{index:04}.exr")),
            None => pattern.to_owned(),
        };
        write_frame(&frame, &folder.join(name(COLOR_FILE)), &folder.join(name(DEPTH_FILE)))?;
        black = black && is_black(frame.radiance.iter());
    }
    Ok(black)
}

/// Says whether nothing in a picture shines.
pub fn is_black(mut texels: impl Iterator<Item = [f32; 4]>) -> bool {
    !texels.any(|[r, g, b, _]| r > 0.0 || g > 0.0 || b > 0.0)
}

/// Writes the scene file for what [`capture_sequence`] writes into `folder`. `room` is the glTF file of the
/// room, if there is one.
///
/// # Errors
/// Fails if a scene file cannot hold a path.
pub fn scene_file(folder: &Path, room: Option<&Path>, position: Vec3, frames: Option<u32>, fps: f64) -> Result<String> {
    let (stem, sequence) = match frames {
        Some(count) => ("_%04d", format!("frames = [0, {}]\nfps = {fps}\n", count - 1)),
        None => ("", String::new()),
    };
    let name = |file: &str| file.replace(".exr", &format!("{stem}.exr"));
    let [x, y, z] = position.to_array();
    let mut text = format!(
        "[panorama]\ncolor = \"{}\"\ndepth = \"{}\"\n{sequence}position = [{x}, {y}, {z}]\n",
        name(COLOR_FILE),
        name(DEPTH_FILE)
    );
    if let Some(room) = room {
        let absolute = |path: &Path| {
            path.canonicalize()
                .map_err(|error| Error::input(path.display(), error.kind(), "check the name and permissions"))
        };
        let (folder, room) = (absolute(folder)?, absolute(room)?);
        let relative = pathdiff::diff_paths(&room, &folder).unwrap_or(room);
        let Some(relative) = relative.to_str() else {
            return Err(Error::input(relative.display(), "is no Unicode text", "rename the room's file"));
        };
        // A scene file takes $NAME from the environment.
        let quoted = toml::Value::String(relative.replace('$', "$$"));
        text += &format!("\n[room]\ngltf = {quoted}\n");
    }
    Ok(text)
}

/// Writes [`COLOR_FILE`] and [`DEPTH_FILE`] into a folder, which is made if it does not exist.
///
/// # Errors
/// Fails if the folder or a file cannot be written.
pub fn write(frame: &PanoramaFrame, folder: &Path) -> Result<()> {
    make_folder(folder)?;
    write_frame(frame, &folder.join(COLOR_FILE), &folder.join(DEPTH_FILE))
}

fn write_frame(frame: &PanoramaFrame, color: &Path, depth: &Path) -> Result<()> {
    write_exr(color, &[ExrLayer::rgb("", frame.color_size, &frame.radiance.to_vec())])?;
    let channels = vec![("Y".to_owned(), frame.depth.clone())];
    write_exr(depth, &[ExrLayer { name: String::new(), size: frame.depth_size, channels }])
}

fn trace_with_bar(
    gpu: &Gpu,
    room: &CompleteScene,
    state: &PackedInstances,
    position: Vec3,
    settings: &CaptureSettings,
) -> Result<PanoramaFrame> {
    let bar = if settings.progress { ProgressBar::new(settings.samples.into()) } else { ProgressBar::hidden() };
    let style = ProgressStyle::with_template("capturing the room {bar:30} {pos}/{len} samples, {eta} left");
    bar.set_style(style.map_err(|error| Error::Internal(error.to_string()))?);
    let frame = trace(gpu, room, state, position, settings, || bar.inc(1))?;
    bar.finish_and_clear();
    Ok(frame)
}

fn trace(
    gpu: &Gpu,
    room: &CompleteScene,
    state: &PackedInstances,
    position: Vec3,
    settings: &CaptureSettings,
    mut tick: impl FnMut(),
) -> Result<PanoramaFrame> {
    let viewpoint = Viewpoint::equirect(Vec3::ZERO, Quat::IDENTITY);
    let path = PathSettings::unbiased(settings.size, settings.seed);
    let mut tracer = PathTracer::new(gpu, &room.packed, state, position, &viewpoint, &path)?;
    for _ in 0..settings.samples.max(1) {
        tracer.sample()?;
        tick();
    }
    let sums = tracer.read()?;
    Ok(PanoramaFrame {
        color_size: settings.size,
        radiance: if settings.denoise { denoise(&sums) } else { sums.radiance() }.into(),
        depth_size: settings.size,
        depth: sums.centre.iter().map(|texel| texel[3]).collect(),
        quantisation: Quantisation::None,
        warnings: Vec::new(),
        white: None,
        taken: Default::default(),
    })
}

/// Returns `$IPRT_CACHE`, or else `iprt` in the user's cache folder if there is one.
pub fn cache_folder() -> Option<PathBuf> {
    env::var_os("IPRT_CACHE")
        .filter(|path| !path.is_empty())
        .map(PathBuf::from)
        .or(dirs::cache_dir().map(|d| d.join("iprt")))
}

/// Names everything that the result depends on.
fn key(room: &CompleteScene, state: &PackedInstances, position: Vec3, settings: &CaptureSettings) -> Result<String> {
    let mut hasher = hash_scene(&room.packed, state)?;
    hasher.update(bytemuck::bytes_of(&position));
    hasher.update(bytemuck::cast_slice(&[settings.size[0], settings.size[1], settings.samples, settings.seed]));
    hasher.update(&[u8::from(settings.denoise)]);
    hasher.update(&denoise::VERSION.to_le_bytes());
    Ok(hasher.finalize().to_hex()[..32].to_owned())
}

fn check_sum(color: &[u8], depth: &[u8]) -> String {
    blake3::Hasher::new().update(color).update(depth).finalize().to_hex().to_string()
}

fn store_cached(folder: &Path, frame: &PanoramaFrame) -> Result<()> {
    write(frame, folder)?;
    let (color, depth) = (read_bytes(&folder.join(COLOR_FILE))?, read_bytes(&folder.join(DEPTH_FILE))?);
    write_bytes(&folder.join(CHECK_FILE), check_sum(&color, &depth).as_bytes())
}

/// Returns `None` if there is no such capture, or if its files are not as they were written.
fn load_cached(folder: &Path) -> Option<PanoramaFrame> {
    if !folder.join(CHECK_FILE).exists() {
        return None;
    }
    let load = || -> Result<Option<PanoramaFrame>> {
        let (color, depth) = (read_bytes(&folder.join(COLOR_FILE))?, read_bytes(&folder.join(DEPTH_FILE))?);
        if read_bytes(&folder.join(CHECK_FILE))? != check_sum(&color, &depth).as_bytes() {
            return Ok(None);
        }
        let color = decode(&color, COLOR_FILE)?.into_color(COLOR_FILE)?;
        let depth = decode(&depth, DEPTH_FILE)?.into_codes(DEPTH_FILE)?;
        Ok(Some(PanoramaFrame {
            color_size: color.size,
            radiance: color.texels.into(),
            depth_size: depth.size,
            depth: depth.codes,
            quantisation: Quantisation::None,
            warnings: Vec::new(),
            white: None,
            taken: Default::default(),
        }))
    };
    let frame = load().ok().flatten();
    if frame.is_none() {
        tracing::warn!("{}: damaged, the room is captured again", folder.display());
    }
    frame
}
