//! Flags that several subcommands share, and what is made of them.

use crate::{
    Error, Result,
    gpu::{Gpu, GpuOptions},
    options::RenderOptions,
    reference::capture::{CaptureSettings, built_in_scene, cache_folder},
    scene::{CompleteScene, Scene, fields::nearest, rooms, viewpoint::Projection},
    settings::{Method, Settings},
    warnings,
};
use std::path::Path;

/// The flags of the device.
#[derive(Clone, Debug, clap::Args)]
pub struct DeviceArgs {
    /// The Vulkan device, by its number or a part of its name (see `iprt devices`)
    #[arg(long, env = "IPRT_DEVICE", value_name = "N|NAME")]
    pub device: Option<String>,
    /// Run under Vulkan validation, with synchronization; any message is an error
    #[arg(long, env = "IPRT_VALIDATION", value_parser = clap::builder::FalseyValueParser::new())]
    pub validation: bool,
}

impl DeviceArgs {
    /// Opens the device.
    pub fn open(&self) -> Result<Gpu> {
        Gpu::new(&self.gpu_options())
    }

    /// What the device is opened by. Pipelines are kept in the user's cache folder.
    pub fn gpu_options(&self) -> GpuOptions {
        let pipeline_cache = cache_folder().map(|folder| folder.join("pipelines"));
        GpuOptions { device: self.device.clone(), validation: self.validation, pipeline_cache }
    }

    /// Closes the device. Under validation every message is shown, and is an error.
    pub fn close(&self, gpu: Gpu) -> Result<()> {
        if !self.validation {
            return Ok(());
        }
        let messages = gpu.destroy()?;
        for message in &messages {
            super::say(&format!("validation: {message}"));
        }
        match messages.len() {
            0 => Ok(()),
            n => Err(Error::Internal(format!("{n} validation messages"))),
        }
    }
}

/// The flags of the picture.
#[derive(Clone, Debug, clap::Args)]
pub struct PictureArgs {
    /// A scene file or a built-in room [default: apartment]
    pub scene: Option<String>,
    /// Picture size [default: the scene's, and half as high as wide for equirect]
    #[arg(long, value_name = "WxH")]
    pub size: Option<String>,
    /// The method: iprt, paper, ibl or reference [default: the scene's]
    #[arg(long)]
    pub method: Option<String>,
    /// A setting of the method, as key=value; may be repeated (see docs/methods.md)
    #[arg(long, value_name = "KEY=VALUE")]
    pub set: Vec<String>,
    /// perspective or equirect
    #[arg(long, default_value = "perspective")]
    pub projection: String,
    /// Leave out the virtual objects
    #[arg(long)]
    pub without_objects: bool,
    /// Seed of all random numbers
    #[arg(long, default_value_t = 0)]
    pub seed: u32,
    #[command(flatten)]
    pub device: DeviceArgs,
    /// Print less
    #[arg(short, long)]
    pub quiet: bool,
}

impl PictureArgs {
    /// Reads the scene and tells its warnings. A built-in room is captured on `gpu` when it is used for the
    /// first time.
    pub fn scene(&self, gpu: &Gpu) -> Result<Scene> {
        open_scene(gpu, self.scene.as_deref(), self.quiet)
    }

    /// What to render: the scene file's options, and over them the flags. `converged` asks for a picture that
    /// accumulates, whatever the method.
    pub fn options(&self, scene: &Scene, converged: bool) -> Result<RenderOptions> {
        let method = match &self.method {
            Some(name) => Method::parse(name, "--method")?,
            None => Method::parse(&scene.render.method, &format!("{}: render.method", scene.name))?,
        };
        let mut settings = Settings::of(method);
        if converged {
            settings.converge();
        }
        for (key, text) in scene.render.set_text() {
            settings.set(&key, &text, &format!("{}: render.set", scene.name))?;
        }
        for pair in &self.set {
            let (key, value) = key_value(pair)?;
            settings.set(key, value, "--set")?;
        }
        let projection = self.projection()?;
        let size = self.size(scene.camera.size)?;
        let (seed, without_objects) = (self.seed, self.without_objects);
        Ok(RenderOptions { size, method, settings, projection, seed, without_objects, eye: 0.0 })
    }
}

impl PictureArgs {
    /// The projection that `--projection` names.
    pub fn projection(&self) -> Result<Projection> {
        parse_projection(&self.projection)
    }

    /// The size that `--size` gives, or else the scene's own. All directions take half as many rows as columns.
    pub fn size(&self, of_scene: [u32; 2]) -> Result<[u32; 2]> {
        match &self.size {
            Some(text) => parse_size(text),
            None if self.projection()? == Projection::Equirect => Ok([of_scene[0], of_scene[0].div_ceil(2)]),
            None => Ok(of_scene),
        }
    }

    /// The complete true scene of a built-in room, or of a scene file that names its room.
    pub fn complete_scene(&self) -> Result<CompleteScene> {
        complete(self.scene.as_deref().unwrap_or(rooms::NAMES[0]), self.without_objects)
    }

    /// Whether the complete true scene is known.
    pub fn room_known(&self, scene: &Scene) -> bool {
        scene.room.is_some() || self.scene.as_deref().is_none_or(|name| rooms::by_name(name).is_some())
    }
}

/// Opens a scene file or a built-in room by name. Without a name it opens the default room.
pub fn open_scene(gpu: &Gpu, name: Option<&str>, quiet: bool) -> Result<Scene> {
    let name = name.unwrap_or(rooms::NAMES[0]);
    if let Some(room) = rooms::by_name(name) {
        return built_in_scene(gpu, &room, &CaptureSettings { progress: !quiet, ..CaptureSettings::default() });
    }
    let scene = Scene::load(scene_path(name)?)?;
    warnings::tell(&scene.warnings);
    Ok(scene)
}

/// Returns the path of a scene file. A word that is no file is taken for a misspelt room.
///
/// # Errors
/// Fails if it is no file, and has no extension as a file has.
pub fn scene_path(name: &str) -> Result<&Path> {
    let path = Path::new(name);
    if path.extension().is_none() && path.components().count() == 1 && !path.exists() {
        let problem = "there is no scene file and no built-in room of that name";
        return Err(Error::input(name, problem, nearest(name, &rooms::NAMES)));
    }
    Ok(path)
}

/// The complete true scene of a built-in room or of a scene file.
///
/// # Errors
/// Fails if the scene file does not name its room.
pub fn complete(name: &str, without_objects: bool) -> Result<CompleteScene> {
    match rooms::by_name(name) {
        Some(room) => {
            let objects = if without_objects { Vec::new() } else { room.objects };
            CompleteScene::assemble(room.name, room.model, room.camera, objects)
        }
        None => {
            let scene = CompleteScene::load(scene_path(name)?, without_objects)?;
            warnings::tell(&scene.warnings);
            Ok(scene)
        }
    }
}

/// Reads `perspective` or `equirect`.
pub fn parse_projection(name: &str) -> Result<Projection> {
    match name {
        "perspective" => Ok(Projection::Perspective),
        "equirect" => Ok(Projection::Equirect),
        other => Err(Error::input("--projection", format!("unknown \"{other}\""), "use perspective or equirect")),
    }
}

/// Reads a size like `WxH`.
pub fn parse_size(text: &str) -> Result<[u32; 2]> {
    let parse = || {
        let (width, height) = text.split_once(['x', 'X', '×'])?;
        Some([width.trim().parse().ok()?, height.trim().parse().ok()?])
    };
    parse()
        .filter(|size: &[u32; 2]| !size.contains(&0))
        .ok_or_else(|| Error::input("--size", format!("\"{text}\" is no size"), "write for example --size 1280x720"))
}

/// Reads `key=value` of `--set`.
pub fn key_value(pair: &str) -> Result<(&str, &str)> {
    let (key, value) = pair.split_once('=').ok_or_else(|| {
        Error::input("--set", format!("\"{pair}\" is not key=value"), "write for example --set atrous_levels=3")
    })?;
    Ok((key.trim(), value.trim()))
}

/// Tells whether a file is the one that it was: how long it is, and when it was written.
pub fn stamp(path: &Path) -> String {
    let known = std::fs::metadata(path).ok();
    format!("{:?} {:?}", known.as_ref().map(std::fs::Metadata::len), known.and_then(|m| m.modified().ok()))
}

/// The longest run: a day and more.
pub const MOST_FRAMES: u32 = 10_000_000;

/// Reads `A..B`, both included, or one number.
pub fn parse_frames(text: &str) -> Result<[u32; 2]> {
    let parse = || match text.split_once("..") {
        Some((a, b)) => Some([a.trim().parse().ok()?, b.trim().trim_start_matches('=').parse().ok()?]),
        None => text.trim().parse().ok().map(|n| [n, n]),
    };
    match parse() {
        Some([a, b]) if a <= b && b - a >= MOST_FRAMES => {
            Err(Error::input("--frames", format!("has more than {MOST_FRAMES} frames"), "give a shorter range"))
        }
        Some([a, b]) if a <= b => Ok([a, b]),
        _ => Err(Error::input(
            "--frames",
            format!("\"{text}\" is not a range"),
            "write for example --frames 0..11, both included",
        )),
    }
}
