//! `iprt chart` charts speed against accuracy.

use super::{
    common::{DeviceArgs, complete, open_scene, parse_projection, parse_size},
    signals::interrupted,
};
use crate::{
    Error, Result,
    image_file::write::{make_folder, write_bytes},
    measure::{
        self,
        chart::{
            ChartInput, ChartOptions, Sweep, markdown,
            pictures::{PICTURES, file_name},
        },
    },
    reference::{cache::Keep, capture::cache_folder},
    scene::rooms,
};
use indicatif::{HumanDuration, ProgressBar, ProgressStyle};
use std::{
    io::IsTerminal,
    path::{Path, PathBuf},
};

/// The folder of stored truths, unless another is given.
const TRUTHS: &str = "truth";

/// Arguments of `iprt chart`.
#[derive(Clone, Debug, clap::Args)]
pub struct Args {
    /// Scene files or built-in rooms; all built-in rooms by default
    pub scenes: Vec<String>,
    /// Folder of the chart; it is made if it does not exist, and a chart in it is continued
    #[arg(short, long, value_name = "DIR")]
    pub output: PathBuf,
    /// Which points to measure: methods (the methods alone), small (the main settings too) or full (every
    /// setting too)
    #[arg(long, default_value = "full")]
    pub sweep: String,
    /// Picture size [default: 320x180; 160x90 for small]
    #[arg(long, value_name = "WxH")]
    pub size: Option<String>,
    /// perspective or equirect
    #[arg(long, default_value = "perspective")]
    pub projection: String,
    /// The video frame that the pictures show
    #[arg(long, default_value_t = 0)]
    pub frame: u32,
    /// Numbers of frames after which a still picture is scored [default: 1,16,64; 1,16 for small]
    #[arg(long, value_name = "N,…", value_delimiter = ',', value_parser = clap::value_parser!(u32).range(1..))]
    pub looks: Vec<u32>,
    /// Number of frames of the moving scene before its picture is scored; with 0 nothing moves
    #[arg(long, value_name = "N", default_value_t = 16)]
    pub moving: u32,
    /// How often each point is timed, with all points in turn [default: 3; 2 for small]
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u32).range(1..))]
    pub rounds: Option<u32>,
    /// Samples a pixel of each truth: the model's, and the true scene's with objects and without [default:
    /// 256; 128 for small]
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u32).range(2..=1 << 20))]
    pub truth_spp: Option<u32>,
    /// Folder of stored scene truths, which are taken where they fit the scene [default: truth, where there is
    /// one]
    #[arg(long, value_name = "DIR")]
    pub truths: Option<PathBuf>,
    /// Put the tables into a Markdown document, between its marks for the sweep
    #[arg(long, value_name = "FILE")]
    pub markdown: Option<PathBuf>,
    /// Seed of all random numbers
    #[arg(long, default_value_t = 0)]
    pub seed: u32,
    #[command(flatten)]
    pub device: DeviceArgs,
    /// Print less
    #[arg(short, long)]
    pub quiet: bool,
}

/// Measures the chart and writes its files.
pub fn run(args: &Args) -> Result<()> {
    let sweep = Sweep::parse(&args.sweep, "--sweep")?;
    let options = options(args, sweep)?;
    if let Some(document) = &args.markdown {
        markdown::find(document, sweep.name())?;
    }
    make_folder(&args.output.join(PICTURES))?;
    let names = if args.scenes.is_empty() { rooms::NAMES.map(str::to_owned).to_vec() } else { args.scenes.clone() };
    let gpu = args.device.open()?;
    let inputs = names
        .iter()
        .map(|name| {
            let scene = open_scene(&gpu, Some(name), args.quiet)?;
            let known = scene.room.is_some() || rooms::by_name(name).is_some();
            let truth = known.then(|| Ok([complete(name, false)?, complete(name, true)?]));
            Ok(ChartInput { name: label(name), scene, complete: truth.transpose()? })
        })
        .collect::<Result<Vec<_>>>()?;
    if let Some(twice) = inputs
        .iter()
        .enumerate()
        .find(|(i, input)| inputs[..*i].iter().any(|c| file_name(&c.name) == file_name(&input.name)))
    {
        let problem = format!("two scenes are called \"{}\", or files of both would be", twice.1.name);
        return Err(Error::input("SCENE", problem, "rename a file or its folder"));
    }
    let mut progress = Progress::new(args.quiet, options.work(&inputs));
    let cache = cache_folder();
    let keep = Keep { folder: cache.as_deref(), stop: interrupted() };
    let chart = measure::chart::run(&gpu, &inputs, &options, &args.output, keep, &mut |work, what| {
        progress.show(work, what);
    })?;
    progress.bar.finish_and_clear();
    measure::chart::keep_sheets(&gpu, &inputs, &options, &chart, cache.as_deref())?;
    write_bytes(&args.output.join("chart.csv"), chart.csv().as_bytes())?;
    chart.write_figure(&args.output)?;
    chart.write_page(&args.output)?;
    if let Some(document) = &args.markdown {
        chart.write_markdown(&args.output, document, sweep.name())?;
    }
    if !args.quiet {
        super::print(&format!("{}: {} points", args.output.display(), chart.points.len()));
    }
    args.device.close(gpu)
}

fn options(args: &Args, sweep: Sweep) -> Result<ChartOptions> {
    let small = sweep == Sweep::Small;
    let mut frames = args.looks.clone();
    if frames.is_empty() {
        frames = if small { vec![1, 16] } else { vec![1, 16, 64] };
    }
    frames.sort_unstable();
    frames.dedup();
    let spp = args.truth_spp.unwrap_or(if small { 128 } else { 256 });
    Ok(ChartOptions {
        size: args.size.as_deref().map_or(Ok(if small { [160, 90] } else { [320, 180] }), parse_size)?,
        projection: parse_projection(&args.projection)?,
        seed: args.seed,
        frame: args.frame,
        frames,
        moving_frames: args.moving,
        rounds: args.rounds.unwrap_or(if small { 2 } else { 3 }),
        model_spp: spp,
        scene_spp: spp,
        truths: args.truths.clone().or_else(|| Path::new(TRUTHS).is_dir().then(|| TRUTHS.into())),
        points: sweep.points(),
    })
}

/// The stem of a scene file, or the name of its folder where that says more.
fn label(name: &str) -> String {
    let path = Path::new(name);
    let text = |part: Option<&std::ffi::OsStr>| part.map(|part| part.to_string_lossy().into_owned());
    match text(path.file_stem()) {
        Some(stem) if stem != "scene" => stem,
        _ => text(path.parent().and_then(Path::file_name)).unwrap_or_else(|| "scene".to_owned()),
    }
}

/// A progress bar with the time left. Where standard error is not a terminal, it prints a line whenever
/// something new is begun.
struct Progress {
    bar: ProgressBar,
    lines: bool,
    begun: String,
}

impl Progress {
    fn new(quiet: bool, work: u64) -> Self {
        let bar = if quiet { ProgressBar::hidden() } else { ProgressBar::new(work) };
        if let Ok(style) = ProgressStyle::with_template("{msg} {wide_bar} {percent} %, {eta} left") {
            bar.set_style(style);
        }
        Self { bar, lines: !quiet && !std::io::stderr().is_terminal(), begun: String::new() }
    }

    fn show(&mut self, work: u64, what: &str) {
        self.bar.inc(work);
        if self.begun == what {
            return;
        }
        what.clone_into(&mut self.begun);
        self.bar.set_message(what.to_owned());
        if self.lines {
            let (done, all) = (self.bar.position(), self.bar.length().unwrap_or(0).max(1));
            let percent = 100 * done / all;
            // By the speed on the whole: pieces of the work take very unlike times. An earlier estimate would be a guess from
            // very little.
            let left = self.bar.elapsed().mul_f64(all.saturating_sub(done) as f64 / done.max(1) as f64);
            let left = if percent < 2 { String::new() } else { format!(" ({} left)", HumanDuration(left)) };
            super::say(&format!("{percent} %: {what}{left}"));
        }
    }
}
