//! `iprt capture` writes the RGBD panorama of a room whose geometry is known, and a scene file that uses it.

use super::{
    common::{DeviceArgs, parse_frames, parse_size},
    progress::progress,
    render::require_folder,
};
use crate::{
    Error, Result,
    image_file::write::{make_folder, write_bytes},
    reference::capture::{CaptureSettings, capture_sequence, scene_file},
    scene::{CompleteScene, camera::CameraTrack, export::ROOM_FILE, gltf, model::Model, rooms},
    warnings,
};
use glam::Vec3;
use std::{
    path::{Path, PathBuf},
    sync::Arc,
};

/// Name of the scene file in the output folder.
const SCENE_FILE: &str = "scene.toml";

/// Arguments of `iprt capture`.
#[derive(Clone, Debug, clap::Args)]
pub struct Args {
    /// The room: a .glb or .gltf file, or a built-in room's name
    pub room: String,
    /// Folder for color.exr, depth.exr, scene.toml and a built-in room's room.glb; it is made if it does not
    /// exist
    #[arg(short, long, value_name = "DIR")]
    pub output: PathBuf,
    /// Samples a texel
    #[arg(long, value_name = "N", default_value_t = 64, value_parser = clap::value_parser!(u32).range(1..=1 << 24))]
    pub spp: u32,
    /// The capture point in world metres [default: a built-in room's own, otherwise the middle of the room's
    /// bounds]
    #[arg(long, value_name = "X,Y,Z", allow_hyphen_values = true)]
    pub position: Option<String>,
    /// Size of both images
    #[arg(long, value_name = "WxH", default_value = "2048x1024")]
    pub size: String,
    /// Frames 0..B of a video of an animated room, both included; the files are numbered
    #[arg(long, value_name = "0..B")]
    pub frames: Option<String>,
    /// Frames a second
    #[arg(long, default_value_t = 30.0)]
    pub fps: f64,
    /// Capture a scan as it is: its base colours are the light that it sends out. A room without lamps whose
    /// vertices have colours is captured so, too
    #[arg(long)]
    pub unlit: bool,
    /// Filter the noise of the light; this is slightly biased where the light changes fast
    #[arg(long)]
    pub denoise: bool,
    /// Seed of all random numbers
    #[arg(long, default_value_t = 0)]
    pub seed: u32,
    #[command(flatten)]
    pub device: DeviceArgs,
    /// Print less
    #[arg(short, long)]
    pub quiet: bool,
}

/// Captures and writes the panorama, and then the scene file.
pub fn run(args: &Args) -> Result<()> {
    let size = parse_size(&args.size)?;
    if size[0] != size[1].saturating_mul(2) || size[1] == 0 || size[0] > 16384 {
        let remedy = "a full panorama is twice as wide as high, at most 16384x8192";
        return Err(Error::input("--size", format!("{}x{}", size[0], size[1]), remedy));
    }
    if !(args.fps.is_finite() && args.fps > 0.0) {
        return Err(Error::input("--fps", args.fps, "give a positive number"));
    }
    let frames = match args.frames.as_deref().map(parse_frames).transpose()? {
        Some([first, _]) if first > 0 => {
            let remedy = "start at 0, where the room's animation does";
            return Err(Error::input("--frames", format!("start at {first}"), remedy));
        }
        frames => frames.map(|[_, last]| last + 1),
    };
    let position = args.position.as_deref().map(parse_position).transpose()?;
    let (mut room, source, usual) = open(args)?;
    room.fps = args.fps;
    warnings::tell(&room.warnings);
    let position = position.unwrap_or(usual);
    make_folder(&args.output)?;
    let scene = args.output.join(SCENE_FILE);
    require_folder(&scene)?;
    let file = match source {
        RoomSource::File(path) => path,
        RoomSource::BuiltIn(model) => {
            let path = args.output.join(ROOM_FILE);
            write_bytes(&path, &gltf::export::to_glb(&model)?)?;
            path
        }
    };
    let text = scene_file(&args.output, Some(&file), position, frames, args.fps)?;

    let gpu = args.device.open()?;
    let settings = CaptureSettings { size, samples: args.spp, seed: args.seed, denoise: args.denoise, progress: false };
    let bar = progress(args.quiet, u64::from(frames.unwrap_or(1)) * u64::from(args.spp), "capturing");
    let black = capture_sequence(&gpu, &room, position, frames, &settings, &args.output, || bar.inc(1))?;
    bar.finish_and_clear();
    warnings::tell(room.black_warning(black, &args.room).as_slice());
    write_bytes(&scene, text.as_bytes())?;
    if !args.quiet {
        super::print(&scene.display().to_string());
    }
    args.device.close(gpu)
}

/// Where a room comes from. A built-in room is written beside its panorama.
enum RoomSource {
    File(PathBuf),
    BuiltIn(Arc<Model>),
}

/// The room, and the point that it is usually captured from.
fn open(args: &Args) -> Result<(CompleteScene, RoomSource, Vec3)> {
    if let Some(room) = rooms::by_name(&args.room) {
        let scene = CompleteScene::assemble(room.name, room.model.clone(), room.camera, Vec::new())?;
        return Ok((scene, RoomSource::BuiltIn(room.model), room.capture_position));
    }
    let path = Path::new(&args.room);
    let (mut model, mut warnings) = gltf::load(path)?;
    let lamps = !model.lights.is_empty() || model.materials.iter().any(|m| m.emissive.max_element() > 0.0);
    let coloured = model.meshes.iter().any(|mesh| !mesh.colors.is_empty());
    if args.unlit || (!lamps && coloured) {
        model.materials = model.materials.into_iter().map(|m| if m.unlit { m } else { m.unlit() }).collect();
        if !args.unlit {
            warnings.push(format!("{}: nothing in it shines: its vertex colours are captured as they are", args.room));
        }
    }
    let name = model.name.clone();
    let mut scene = CompleteScene::assemble(&name, Arc::new(model), CameraTrack::at_point(Vec3::ZERO), Vec::new())?;
    warnings.append(&mut scene.warnings);
    scene.warnings = warnings;
    let bounds = scene.bounds(0.0);
    if bounds.is_empty() {
        return Err(Error::input(path.display(), "holds no triangles", "give the model of a room"));
    }
    let middle = bounds.center();
    Ok((scene, RoomSource::File(path.to_owned()), middle))
}

fn parse_position(text: &str) -> Result<Vec3> {
    let numbers: Option<Vec<f32>> =
        text.split(',').map(|part| part.trim().parse().ok().filter(|x: &f32| x.is_finite())).collect();
    match numbers.as_deref() {
        Some([x, y, z]) => Ok(Vec3::new(*x, *y, *z)),
        _ => {
            Err(Error::input("--position", format!("\"{text}\" is not X,Y,Z"), "write for example --position 0,1.3,0"))
        }
    }
}
