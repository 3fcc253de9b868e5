//! `iprt bench` measures the GPU time of every pass.

use super::{
    common::{PictureArgs, parse_frames, parse_size},
    json::{JsonArgs, JsonFileArgs},
    progress::progress,
    target::TargetArgs,
};
use crate::{
    Result,
    image_file::write::write_bytes,
    measure::{bench, growth, rays},
    passes,
    renderer::{Renderer, Wishes},
};
use std::path::PathBuf;

/// Arguments of `iprt bench`.
#[derive(Clone, Debug, clap::Args)]
#[command(after_long_help = passes::help())]
pub struct Args {
    #[command(flatten)]
    pub picture: PictureArgs,
    #[command(flatten)]
    pub target: TargetArgs,
    /// Frames A..B to measure, both included
    #[arg(long, value_name = "A..B", default_value = "0..29")]
    pub frames: String,
    /// Number of frames that are run before frame A, held at A
    #[arg(long, default_value_t = 16)]
    pub warmup: u32,
    /// Measure the panorama's tracer instead, in million rays a second, by kind of ray and by size of the
    /// depth map
    #[arg(long, conflicts_with_all = ["frames", "warmup", "csv", "trace", "target_ms", "target_flip"])]
    pub rays: bool,
    /// Sizes to which --rays resamples the depth map
    #[arg(
        long,
        value_name = "WxH,…",
        value_delimiter = ',',
        requires = "rays",
        default_value = "512x256,1024x512,4096x2048"
    )]
    pub depth_sizes: Vec<String>,
    /// How often --rays traces each kind of ray at each size
    #[arg(long, value_name = "N", requires = "rays", default_value_t = 9, value_parser = clap::value_parser!(u32).range(1..))]
    pub repetitions: u32,
    /// Measure instead how a frame's cost grows with pixels, triangles, texels and objects: balls in the scene's
    /// panorama, which all move
    #[arg(long, conflicts_with_all = ["rays", "frames", "warmup", "csv", "trace", "target_ms", "target_flip"])]
    pub growth: bool,
    #[command(flatten)]
    pub json: JsonFileArgs,
    /// Write the passes as CSV
    #[arg(long, value_name = "FILE")]
    pub csv: Option<PathBuf>,
    /// Write a Chrome or Perfetto trace
    #[arg(long, value_name = "FILE")]
    pub trace: Option<PathBuf>,
}

/// Measures, prints the table, and writes the files.
pub fn run(args: &Args) -> Result<()> {
    if args.rays {
        return run_rays(args);
    }
    if args.growth {
        return run_growth(args);
    }
    let [first, last] = parse_frames(&args.frames)?;
    args.target.target()?;
    let json = JsonArgs::from(args.json.clone());
    json.require()?;
    for path in [&args.csv, &args.trace].into_iter().flatten() {
        super::render::require_folder(path)?;
    }
    let gpu = args.picture.device.open()?;
    let scene = args.picture.scene(&gpu)?;
    let mut options = args.picture.options(&scene, false)?;
    let exposure = scene.render.exposure;
    let chosen = args.target.apply(&gpu, &scene, &args.picture, &mut options, exposure, first != last)?;
    chosen.iter().for_each(|chosen| chosen.say(args.picture.quiet));
    let mut renderer = Renderer::new(&gpu, &scene, options)?;
    let count = last - first + 1;
    let bar = progress(args.picture.quiet, u64::from(args.warmup) + u64::from(count), "measuring");
    let report = bench::run(&mut renderer, &scene, first, count, args.warmup, &Wishes::default(), || bar.inc(1))?;
    bar.finish_and_clear();
    if !json.is_printed() {
        super::print_lines(report.table().trim_end());
    }
    json.write(&report)?;
    if let Some(path) = &args.csv {
        write_bytes(path, report.csv().as_bytes())?;
    }
    if let Some(path) = &args.trace {
        write_bytes(path, report.trace().to_string().as_bytes())?;
    }
    drop(renderer);
    args.picture.device.close(gpu)
}

fn run_rays(args: &Args) -> Result<()> {
    let json = JsonArgs::from(args.json.clone());
    json.require()?;
    let sizes = args.depth_sizes.iter().map(|text| parse_size(text)).collect::<Result<Vec<_>>>()?;
    let gpu = args.picture.device.open()?;
    let scene = args.picture.scene(&gpu)?;
    let settings = args.picture.options(&scene, false)?.settings;
    let bar = progress(args.picture.quiet, sizes.len() as u64 * u64::from(args.repetitions), "measuring");
    let report = rays::run(&gpu, &scene, &settings, &sizes, args.repetitions, || bar.inc(1))?;
    bar.finish_and_clear();
    if !json.is_printed() {
        super::print_lines(report.table().trim_end());
    }
    json.write(&report)?;
    args.picture.device.close(gpu)
}

fn run_growth(args: &Args) -> Result<()> {
    let json = JsonArgs::from(args.json.clone());
    json.require()?;
    let gpu = args.picture.device.open()?;
    let scene = args.picture.scene(&gpu)?;
    let options = args.picture.options(&scene, false)?;
    let bar = progress(args.picture.quiet, growth::steps() as u64, "measuring");
    let report = growth::run(&gpu, &scene, &options, || bar.inc(1))?;
    bar.finish_and_clear();
    if !json.is_printed() {
        super::print_lines(report.table().trim_end());
    }
    json.write(&report)?;
    args.picture.device.close(gpu)
}
