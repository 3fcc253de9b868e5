//! `iprt plan` tells which parts of the model a scene needs, and why.

use super::{
    common::PictureArgs,
    json::{JsonArgs, JsonFileArgs},
    target::TargetArgs,
};
use crate::{
    Error, Result,
    plan::{Part, Plan},
};

/// Arguments of `iprt plan`.
#[derive(Clone, Debug, clap::Args)]
#[command(after_long_help = Part::help())]
pub struct Args {
    #[command(flatten)]
    pub picture: PictureArgs,
    #[command(flatten)]
    pub target: TargetArgs,
    #[command(flatten)]
    pub json: JsonFileArgs,
}

/// Makes the plan, prints its table, and writes the file.
pub fn run(args: &Args) -> Result<()> {
    let output = JsonArgs::from(args.json.clone());
    output.require()?;
    args.target.target()?;
    // The device is needed to capture a built-in room.
    let gpu = args.picture.device.open()?;
    let scene = args.picture.scene(&gpu)?;
    let mut options = args.picture.options(&scene, false)?;
    let chosen = args.target.apply(&gpu, &scene, &args.picture, &mut options, scene.render.exposure, true)?;
    let plan = Plan::of(&scene, &options, None)?;
    if !output.is_printed() {
        let [width, height] = plan.size;
        super::print(&format!("{} at {width}×{height}, method {}", scene.name, options.method.name()));
        super::print_lines(plan.table()?.trim_end());
        if let Some(chosen) = &chosen {
            super::print(&chosen.text());
        }
    }
    if output.json.is_some() {
        let mut json = plan.json()?;
        if let (Some(chosen), Some(json)) = (&chosen, json.as_object_mut()) {
            let chosen = serde_json::to_value(chosen).map_err(|e| Error::Internal(e.to_string()))?;
            json.insert("choice".to_owned(), chosen);
        }
        output.write(&json)?;
    }
    args.picture.device.close(gpu)
}
