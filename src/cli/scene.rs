//! `iprt scene`: built-in rooms as files.

use super::common::DeviceArgs;
use crate::{
    Error, Result,
    reference::capture::{CaptureSettings, cache_folder, room_frames},
    scene::{export::Export, rooms},
};
use std::path::PathBuf;

/// What `iprt scene` does.
#[derive(Clone, Debug, clap::Subcommand)]
pub enum Command {
    /// Write a built-in room as .glb files, a panorama and a scene file
    Export(ExportArgs),
}

/// Arguments of `iprt scene export`.
#[derive(Clone, Debug, clap::Args)]
pub struct ExportArgs {
    /// apartment, bedroom or gallery
    pub name: String,
    /// The folder, which is made where it does not exist
    #[arg(short, long, value_name = "DIR")]
    pub output: PathBuf,
    #[command(flatten)]
    pub device: DeviceArgs,
    /// Say less
    #[arg(short, long)]
    pub quiet: bool,
}

/// Runs it.
pub fn run(command: &Command) -> Result<()> {
    let Command::Export(args) = command;
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
        super::print(&path.display().to_string())?;
    }
    args.device.close(gpu)
}
