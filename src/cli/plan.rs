//! `iprt plan` tells which parts of the model a scene needs, and why.

use super::{common::PictureArgs, target::TargetArgs};
use crate::{
    Error, Result,
    image_file::write::write_bytes,
    plan::{Part, Plan},
};
use std::path::PathBuf;

/// Arguments of `iprt plan`.
#[derive(Clone, Debug, clap::Args)]
#[command(after_long_help = Part::help())]
pub struct Args {
    #[command(flatten)]
    pub picture: PictureArgs,
    #[command(flatten)]
    pub target: TargetArgs,
    /// Write the plan as JSON
    #[arg(long, value_name = "FILE")]
    pub json: Option<PathBuf>,
}

/// Makes the plan, prints its table, and writes the file.
pub fn run(args: &Args) -> Result<()> {
    if let Some(path) = &args.json {
        super::render::require_folder(path)?;
    }
    args.target.target()?;
    // The device is needed to capture a built-in room.
    let gpu = args.picture.device.open()?;
    let scene = args.picture.scene(&gpu)?;
    let mut options = args.picture.options(&scene, false)?;
    let chosen = args.target.apply(&gpu, &scene, &args.picture, &mut options, scene.render.exposure, true)?;
    let plan = Plan::of(&scene, &options, None)?;
    let [width, height] = plan.size;
    super::print(&format!("{} at {width}×{height}, method {}", scene.name, options.method.name()))?;
    super::print(plan.table()?.trim_end())?;
    if let Some(chosen) = &chosen {
        super::print(&chosen.text())?;
    }
    if let Some(path) = &args.json {
        let mut json = plan.json()?;
        if let (Some(chosen), Some(json)) = (&chosen, json.as_object_mut()) {
            let chosen = serde_json::to_value(chosen).map_err(|e| Error::Internal(e.to_string()))?;
            json.insert("choice".to_owned(), chosen);
        }
        let bytes = serde_json::to_vec_pretty(&json).map_err(|e| Error::Internal(e.to_string()))?;
        write_bytes(path, &bytes)?;
    }
    args.picture.device.close(gpu)
}
