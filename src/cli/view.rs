//! `iprt view` opens the window.

use super::common::{DeviceArgs, open_scene, parse_size};
use crate::{
    Error, Result,
    image_file::write::write_bytes,
    scene::rooms,
    settings::Method,
    viewer::{
        self, Open, Opened,
        edit::Origin,
        script::{LINES, Script},
        state::Side,
    },
};
use std::path::PathBuf;

/// Arguments of `iprt view`.
#[derive(Clone, Debug, clap::Args)]
#[command(after_help = "Keys: F1 in the window.", after_long_help = LINES)]
pub struct Args {
    /// A scene file or a built-in room [default: apartment]
    pub scene: Option<String>,
    /// Size of the window
    #[arg(long, value_name = "WxH", default_value = "1280x720")]
    pub size: String,
    /// The method: iprt, paper, ibl or reference [default: the scene's]
    #[arg(long)]
    pub method: Option<String>,
    /// A setting of the method, as key=value; may be repeated (see docs/methods.md)
    #[arg(long, value_name = "KEY=VALUE")]
    pub set: Vec<String>,
    /// Milliseconds that a frame may take while something moves; the picture is made smaller until it does
    #[arg(long, value_name = "MS", default_value_t = 66.0)]
    pub target_ms: f64,
    /// Play key, pointer and resize events from a file, then close the window and print a report as JSON
    #[arg(long, value_name = "FILE")]
    pub script: Option<PathBuf>,
    /// Write the report to this file instead of standard output
    #[arg(long, value_name = "FILE", requires = "script")]
    pub report: Option<PathBuf>,
    #[command(flatten)]
    pub device: DeviceArgs,
    /// Print less
    #[arg(short, long)]
    pub quiet: bool,
}

/// Opens the window, and returns when it is closed.
pub fn run(args: Args) -> Result<()> {
    let size = parse_size(&args.size)?;
    if size.iter().any(|side| !(1..=16384).contains(side)) {
        let problem = format!("{}×{} pixels", size[0], size[1]);
        return Err(Error::input("--size", problem, "both must be from 1 to 16384"));
    }
    if !(args.target_ms.is_finite() && args.target_ms > 0.0) {
        return Err(Error::input("--target-ms", args.target_ms, "give a positive number of milliseconds"));
    }
    let script = args.script.as_deref().map(Script::read).transpose()?;
    let scripted = script.is_some();
    if let Some(path) = &args.report {
        super::render::require_folder(path)?;
    }
    let options = viewer::Options { gpu: args.device.gpu_options(), size, target_ms: args.target_ms, script };
    let (validation, report) = (args.device.validation, args.report.clone());
    let open: Open = Box::new(move |gpu| open(&args, gpu));
    let result = viewer::run(options, open)?;
    if scripted {
        let json = serde_json::to_string_pretty(&result).map_err(|error| Error::Internal(error.to_string()))?;
        match &report {
            Some(path) => write_bytes(path, json.as_bytes())?,
            None => super::print_lines(&json),
        }
    }
    if validation && !result.messages.is_empty() {
        result.messages.iter().for_each(|message| super::say(&format!("validation: {message}")));
        return Err(Error::Internal(format!("{} validation messages", result.messages.len())));
    }
    Ok(())
}

/// Reads the scene. The window is open already.
fn open(args: &Args, gpu: &crate::gpu::Gpu) -> Result<Opened> {
    let scene = open_scene(gpu, args.scene.as_deref(), args.quiet)?;
    let name = args.scene.as_deref().unwrap_or(rooms::NAMES[0]);
    let origin = match rooms::by_name(name) {
        Some(room) => Origin::Room(Box::new(room)),
        None => Origin::File(PathBuf::from(name)),
    };
    let method = match &args.method {
        Some(name) => Method::parse(name, "--method")?,
        None => Method::parse(&scene.render.method, &format!("{}: render.method", scene.name))?,
    };
    let Side { mut settings, .. } = Side::of(method);
    for (key, value) in &scene.render.set {
        let text = value.as_str().map_or_else(|| value.to_string(), str::to_owned);
        settings.set(key, &text, &format!("{}: render.set", scene.name))?;
    }
    for pair in &args.set {
        let (key, value) = pair.split_once('=').ok_or_else(|| {
            Error::input("--set", format!("\"{pair}\" is not key=value"), "write for example --set atrous_levels=3")
        })?;
        settings.set(key.trim(), value.trim(), "--set")?;
    }
    let exposure = scene.render.exposure;
    Ok(Opened { scene, origin, side: Side { method, settings }, exposure })
}
