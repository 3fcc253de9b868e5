//! `capture`: the RGBD panorama of a room, path-traced from a point in it. Colour is box-filtered over each texel, depth is the
//! radial distance at its centre.

use super::{
    denoise::{self, denoise},
    path_trace::{PathSettings, PathTracer},
};
use crate::{
    Error, Result,
    gpu::Gpu,
    image_file::{
        exr_file::ExrLayer,
        read::{decode, read_bytes},
        write::{write_bytes, write_exr},
    },
    panorama::{
        depth::Quantisation,
        source::{PanoramaFrame, PanoramaSource},
    },
    passes::view::Viewpoint,
    scene::{
        Scene, bvh,
        file::RenderSettings,
        model::Model,
        pack::pack,
        packed::{Instance, PackedInstances, PackedScene},
        rooms::Room,
    },
    shaders,
};
use glam::{Affine3A, Quat, Vec3};
use indicatif::{ProgressBar, ProgressStyle};
use std::{
    env, fs,
    path::{Path, PathBuf},
};

/// The colour's file name in a captured folder.
pub const COLOR_FILE: &str = "color.exr";
/// The depth's, metres in channel Y.
pub const DEPTH_FILE: &str = "depth.exr";
/// In a cached folder: the hash of both files, written last.
const CHECK_FILE: &str = "blake3";

/// What can be chosen.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct CaptureSettings {
    /// Width and height, texels.
    pub size: [u32; 2],
    /// Samples a texel.
    pub samples: u32,
    /// Random seed.
    pub seed: u32,
    /// Whether the light is filtered, see [`denoise`](mod@denoise).
    pub denoise: bool,
    /// Whether to show progress on stderr.
    pub progress: bool,
}

impl Default for CaptureSettings {
    /// As the built-in scenes are captured when they are first used: clean within a minute on two CPU cores.
    fn default() -> Self {
        Self { size: [1024, 512], samples: 12, seed: 0, denoise: true, progress: true }
    }
}

/// Captures a room.
///
/// # Errors
/// A model that cannot be packed, a lost device.
pub fn capture(gpu: &Gpu, room: &Model, position: Vec3, settings: &CaptureSettings) -> Result<PanoramaFrame> {
    let (scene, state) = pack_room(room)?;
    trace(gpu, &scene, &state, position, settings)
}

/// As [`capture`], kept in a folder under `cache` (see [`cache_folder`]). A file that is damaged is made again; where nothing can
/// be written, nothing is kept.
///
/// # Errors
/// As [`capture`].
pub fn capture_cached(
    gpu: &Gpu,
    room: &Model,
    position: Vec3,
    settings: &CaptureSettings,
    cache: Option<&Path>,
) -> Result<PanoramaFrame> {
    let (scene, state) = pack_room(room)?;
    let Some(cache) = cache else { return trace(gpu, &scene, &state, position, settings) };
    let folder = cache.join(format!("capture-{}", key(&scene, &state, position, settings)));
    if let Some(frame) = load_cached(&folder) {
        return Ok(frame);
    }
    let frame = trace(gpu, &scene, &state, position, settings)?;
    if let Err(error) = store_cached(&folder, &frame) {
        tracing::warn!("the captured panorama is not kept: {error}");
    }
    Ok(frame)
}

/// A built-in room as a scene: captured, or read from the cache, with its objects in it.
///
/// # Errors
/// As [`capture`].
pub fn built_in_scene(gpu: &Gpu, room: &Room, settings: &CaptureSettings) -> Result<Scene> {
    let cache = cache_folder();
    let frame = capture_cached(gpu, &room.model, room.capture_position, settings, cache.as_deref())?;
    let panorama = PanoramaSource::from_frames(vec![frame], 30.0, room.capture_position, 0.0)?;
    Scene::assemble(room.name, panorama, room.camera.clone(), room.objects.clone(), RenderSettings::default())
}

/// Writes [`COLOR_FILE`] and [`DEPTH_FILE`] into a folder, which is made where it does not exist.
///
/// # Errors
/// What cannot be written.
pub fn write(frame: &PanoramaFrame, folder: &Path) -> Result<()> {
    fs::create_dir_all(folder).map_err(|error| {
        Error::input(folder.display(), format!("cannot be made: {error}"), "give a folder that can be written")
    })?;
    write_exr(&folder.join(COLOR_FILE), &[ExrLayer::rgb("", frame.color_size, &frame.radiance)])?;
    let depth =
        ExrLayer { name: String::new(), size: frame.depth_size, channels: vec![("Y".to_owned(), frame.depth.clone())] };
    write_exr(&folder.join(DEPTH_FILE), &[depth])
}

/// The room as one instance per node with a mesh.
fn pack_room(room: &Model) -> Result<(PackedScene, PackedInstances)> {
    let placed: Vec<usize> = (0..room.rig.nodes.len()).filter(|node| room.rig.nodes[*node].mesh.is_some()).collect();
    let packed = pack(&[room], placed.len())?;
    let matrices = room.rig.node_matrices(None);
    let mut instances = Vec::new();
    let mut boxes = Vec::new();
    for node in placed {
        let mesh = room.rig.nodes[node].mesh.and_then(|mesh| packed.meshes[0].get(mesh).copied().flatten());
        let Some(mesh) = mesh else { continue };
        let to_world = rows(&matrices[node]);
        instances.push(Instance {
            object_to_world: to_world,
            world_to_object: rows(&matrices[node].inverse()),
            previous_object_to_world: to_world,
            root: mesh.root,
            id: instances.len() as u32 + 1,
            padding: [0; 2],
        });
        boxes.push(mesh.bounds.transformed(&matrices[node]).padded());
    }
    let tree = bvh::build_top(&boxes);
    let nodes = tree.pack(0, |first| tree.order[first as usize]);
    Ok((packed.scene, PackedInstances { instances, nodes }))
}

fn rows(matrix: &Affine3A) -> [[f32; 4]; 3] {
    let (linear, translation) = (matrix.matrix3, matrix.translation);
    [0, 1, 2].map(|row| [linear.x_axis[row], linear.y_axis[row], linear.z_axis[row], translation[row]])
}

fn trace(
    gpu: &Gpu,
    scene: &PackedScene,
    state: &PackedInstances,
    position: Vec3,
    settings: &CaptureSettings,
) -> Result<PanoramaFrame> {
    let viewpoint = Viewpoint::equirect(Vec3::ZERO, Quat::IDENTITY);
    let path = PathSettings { size: settings.size, seed: settings.seed, bounces: 16, roulette: 3 };
    let mut tracer = PathTracer::new(gpu, scene, state, position, &viewpoint, &path)?;
    let bar = if settings.progress { ProgressBar::new(settings.samples.into()) } else { ProgressBar::hidden() };
    let style = ProgressStyle::with_template("capturing the room {bar:30} {pos}/{len} samples, {eta} left");
    bar.set_style(style.map_err(|error| Error::Internal(error.to_string()))?);
    for _ in 0..settings.samples.max(1) {
        tracer.sample()?;
        bar.inc(1);
    }
    bar.finish_and_clear();
    let sums = tracer.read()?;
    Ok(PanoramaFrame {
        color_size: settings.size,
        radiance: if settings.denoise { denoise(&sums) } else { sums.radiance() },
        depth_size: settings.size,
        depth: sums.centre.iter().map(|texel| texel[3]).collect(),
        quantisation: Quantisation::None,
        warnings: Vec::new(),
    })
}

/// `$IPRT_CACHE`, or `iprt` in the user's cache folder, where there is one.
pub fn cache_folder() -> Option<PathBuf> {
    env::var_os("IPRT_CACHE")
        .filter(|path| !path.is_empty())
        .map(PathBuf::from)
        .or(dirs::cache_dir().map(|d| d.join("iprt")))
}

/// Names everything that the result depends on.
fn key(scene: &PackedScene, state: &PackedInstances, position: Vec3, settings: &CaptureSettings) -> String {
    let mut hasher = blake3::Hasher::new();
    let mut part = |bytes: &[u8]| {
        hasher.update(&(bytes.len() as u64).to_le_bytes());
        hasher.update(bytes);
    };
    part(bytemuck::cast_slice(&scene.triangles));
    part(bytemuck::cast_slice(&scene.shading));
    part(bytemuck::cast_slice(&scene.vertices));
    part(bytemuck::cast_slice(&scene.materials));
    part(bytemuck::cast_slice(&scene.textures));
    part(bytemuck::cast_slice(&scene.texels));
    part(bytemuck::cast_slice(&state.instances));
    part(bytemuck::cast_slice(&position.to_array()));
    part(bytemuck::cast_slice(&[settings.size[0], settings.size[1], settings.samples, settings.seed]));
    part(&[u8::from(settings.denoise)]);
    part(&denoise::VERSION.to_le_bytes());
    part(bytemuck::cast_slice(shaders::PATH_TRACE));
    part(env!("CARGO_PKG_VERSION").as_bytes());
    hasher.finalize().to_hex()[..32].to_owned()
}

fn check_sum(color: &[u8], depth: &[u8]) -> String {
    blake3::Hasher::new().update(color).update(depth).finalize().to_hex().to_string()
}

fn store_cached(folder: &Path, frame: &PanoramaFrame) -> Result<()> {
    write(frame, folder)?;
    let (color, depth) = (read_bytes(&folder.join(COLOR_FILE))?, read_bytes(&folder.join(DEPTH_FILE))?);
    write_bytes(&folder.join(CHECK_FILE), check_sum(&color, &depth).as_bytes())
}

/// `None` where there is no such capture or its files are not as they were written.
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
            radiance: color.texels,
            depth_size: depth.size,
            depth: depth.codes,
            quantisation: Quantisation::None,
            warnings: Vec::new(),
        }))
    };
    let frame = load().ok().flatten();
    if frame.is_none() {
        tracing::warn!("{}: damaged, the room is captured again", folder.display());
    }
    frame
}
