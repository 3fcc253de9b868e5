//! `iprt scene` writes built-in rooms as files.

use super::common::DeviceArgs;
use crate::{
    Error, Result,
    reference::capture::{CaptureSettings, cache_folder, room_frames},
    scene::{export::Export, rooms},
};
use std::path::PathBuf;

/// The subcommands of `iprt scene`.
#[derive(Clone, Debug, clap::Subcommand)]
pub enum SceneCommand {
    /// Write a built-in room as .glb files, a panorama and a scene file
    Export(ExportArgs),
}

/// Arguments of `iprt scene export`.
#[derive(Clone, Debug, clap::Args)]
pub struct ExportArgs {
    /// The room: apartment, bedroom or gallery
    pub name: String,
    /// The folder; it is made if it does not exist
    #[arg(short, long, value_name = "DIR")]
    pub output: PathBuf,
    #[command(flatten)]
    pub device: DeviceArgs,
    /// Print less
    #[arg(short, long)]
    pub quiet: bool,
}

/// Runs the subcommand.
pub fn run(command: &SceneCommand) -> Result<()> {
    let SceneCommand::Export(args) = command;
    let Some(room) = rooms::by_name(&args.name) else {
        let remedy = format!("choose from {}", rooms::NAMES.join(", "));
        return Err(Error::input(&args.name, "there is no built-in room of that name", remedy));
    };
    let export = Export::of(&room);
    export.prepare(&args.output)?;
    let gpu = args.device.open()?;
    let settings = CaptureSettings { progress: !args.quiet, ..CaptureSettings::default() };
    let frames = room_frames(&gpu, &room, &settings, cache_folder().as_deref())?;
    let path = export.write(&args.output, &frames)?;
    if !args.quiet {
        super::print(&path.display().to_string());
    }
    args.device.close(gpu)
}
