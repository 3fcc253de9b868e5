//! `iprt bench`: GPU time of every pass.

use super::common::{PictureArgs, parse_frames, progress};
use crate::{Error, Result, image_file::write::write_bytes, measure::bench, renderer::Renderer};
use std::path::PathBuf;

/// Arguments of `iprt bench`.
#[derive(Clone, Debug, clap::Args)]
pub struct Args {
    #[command(flatten)]
    pub picture: PictureArgs,
    /// Frames A..B to measure, both included
    #[arg(long, value_name = "A..B", default_value = "0..29")]
    pub frames: String,
    /// Frames run before A, A held still
    #[arg(long, default_value_t = 5)]
    pub warmup: u32,
    /// Write the numbers as JSON
    #[arg(long, value_name = "FILE")]
    pub json: Option<PathBuf>,
    /// Write the passes as CSV
    #[arg(long, value_name = "FILE")]
    pub csv: Option<PathBuf>,
    /// Write a Chrome or Perfetto trace
    #[arg(long, value_name = "FILE")]
    pub trace: Option<PathBuf>,
}

/// Measures, prints the table, writes the files.
pub fn run(args: &Args) -> Result<()> {
    let [first, last] = parse_frames(&args.frames)?;
    for path in [&args.json, &args.csv, &args.trace].into_iter().flatten() {
        super::render::require_folder(path)?;
    }
    let gpu = args.picture.device.open()?;
    let scene = args.picture.scene(&gpu)?;
    let options = args.picture.options(&scene, false)?;
    let mut renderer = Renderer::new(&gpu, &scene, options)?;
    let count = last - first + 1;
    let bar = progress(args.picture.quiet, u64::from(args.warmup) + u64::from(count), "measuring");
    let report = bench::run(&mut renderer, &scene, first, count, args.warmup, || bar.inc(1))?;
    bar.finish_and_clear();
    super::print(report.table().trim_end())?;
    let json = |value: serde_json::Result<Vec<u8>>| value.map_err(|e| Error::Internal(e.to_string()));
    if let Some(path) = &args.json {
        write_bytes(path, &json(serde_json::to_vec_pretty(&report))?)?;
    }
    if let Some(path) = &args.csv {
        write_bytes(path, report.csv().as_bytes())?;
    }
    if let Some(path) = &args.trace {
        write_bytes(path, &json(serde_json::to_vec(&report.trace()))?)?;
    }
    drop(renderer);
    args.picture.device.close(gpu)
}
