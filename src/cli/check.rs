//! `iprt check SCENE` reads everything that a scene names. It reports every problem at once, what was
//! measured, and what can hardly be right.

use super::{
    common::{DeviceArgs, open_scene, scene_path},
    json::JsonArgs,
};
use crate::{
    Error, Result,
    inspect::{self, Report, sheet, video::VideoReport},
    media,
    options::RenderOptions,
    panorama::cloud::Cloud,
    renderer::require_ray_queries,
    scene::{Scene, load::Examined, rooms},
    settings::VirtualTracer,
    warnings,
};
use std::path::{Path, PathBuf};

/// Arguments of `iprt check`.
#[derive(Clone, Debug, clap::Args)]
pub struct Args {
    /// A scene file, a built-in room, or a video file
    pub scene: String,
    /// Write a sheet of pictures: colour, depth, normals, and floor and objects from above
    #[arg(short, long, value_name = "PNG")]
    pub output: Option<PathBuf>,
    #[command(flatten)]
    pub json: JsonArgs,
    /// Make warnings errors
    #[arg(long)]
    pub strict: bool,
    /// Print no warnings
    #[arg(short, long)]
    pub quiet: bool,
    #[command(flatten)]
    pub device: DeviceArgs,
}

/// The most problems that are printed.
const MOST: usize = 100;

/// Prints what was measured, and each problem and each warning on a line of its own.
///
/// # Errors
/// Fails if the scene has problems. All but the last are printed here. The last one is the error, for the
/// caller to print.
pub fn run(args: &Args) -> Result<()> {
    args.json.require()?;
    args.output.iter().try_for_each(|path| super::render::require_folder(path))?;
    if media::is_video(Path::new(&args.scene)) {
        return check_video(args);
    }
    let mut examined = examine(args)?;
    examined.problems.extend(examined.scene.as_ref().and_then(|scene| lacks_ray_queries(args, scene).err()));
    let mut found = std::mem::take(&mut examined.warnings);
    if let (Some(scene), Some(frame)) = (&examined.scene, &examined.first) {
        let cloud = Cloud::of(frame, scene.panorama.yaw_degrees);
        let mut report = Report::of(scene, frame, &cloud);
        found.extend(report.warnings.iter().filter(|warning| !found.contains(warning)).cloned().collect::<Vec<_>>());
        report.warnings.clone_from(&found);
        if let Some(path) = &args.output {
            sheet::write(path, &report, scene, frame, &cloud)?;
        }
        if !args.json.is_printed() {
            super::print_lines(&crate::terminal::hidden(report.text().trim_end()));
        }
        args.json.write(&report)?;
    }
    warnings::tell(&found);
    let last = examined.problems.pop();
    // A file that is something else has one in each line.
    for problem in examined.problems.iter().take(MOST) {
        super::say(&format!("error: {problem}"));
    }
    if let Some(more @ 1..) = examined.problems.len().checked_sub(MOST) {
        super::say(&format!("error: {}: {more} more problems; mend these first", args.scene));
    }
    match last {
        Some(last) => Err(last),
        None => {
            if !args.json.is_printed() {
                super::print(&format!("{}: no problems, {} warnings", args.scene, found.len()));
            }
            super::forbid_warnings(args.strict && !found.is_empty(), &args.scene)
        }
    }
}

/// Prints what was understood of a video file.
fn check_video(args: &Args) -> Result<()> {
    let path = Path::new(&args.scene);
    if args.output.is_some() {
        let remedy = format!("write a scene first: iprt new {}", args.scene);
        return Err(Error::input("--output", "a video alone has no sheet of pictures", remedy));
    }
    let report = VideoReport::of(path)?;
    warnings::tell(&report.warnings);
    if !args.json.is_printed() {
        super::print_lines(&crate::terminal::hidden(&report.text()));
        super::print(&format!("{}: no problems, {} warnings", args.scene, report.warnings.len()));
    }
    args.json.write(&report)?;
    super::forbid_warnings(args.strict && !report.warnings.is_empty(), &args.scene)
}

/// Asks the device if the scene's settings ask for ray queries.
fn lacks_ray_queries(args: &Args, scene: &Scene) -> Result<()> {
    // what is wrong with the options themselves is found elsewhere
    let asked = RenderOptions::of(scene).is_ok_and(|o| o.settings.virtual_tracer == VirtualTracer::RayQuery);
    if !asked {
        return Ok(());
    }
    let gpu = args.device.open()?;
    require_ray_queries(&gpu)?;
    args.device.close(gpu)
}

fn examine(args: &Args) -> Result<Examined> {
    if rooms::by_name(&args.scene).is_none() {
        return Ok(inspect::examine(scene_path(&args.scene)?));
    }
    let gpu = args.device.open()?;
    let scene = open_scene(&gpu, Some(&args.scene), args.quiet)?;
    let first = scene.panorama.load(0)?;
    args.device.close(gpu)?;
    Ok(Examined { warnings: scene.warnings.clone(), scene: Some(scene), first: Some(first), ..Examined::default() })
}
