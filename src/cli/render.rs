//! `iprt render` renders pictures to files.

use super::{
    common::{PictureArgs, parse_frames},
    progress::progress,
    signals,
    target::TargetArgs,
};
use crate::{
    Error, Result,
    measure::bench,
    output::{FileKind, write},
    panorama::pattern::Pattern,
    plan::Plan,
    renderer::{Renderer, Wishes},
    scene::Scene,
    settings::Method,
    temporary::Temporary,
};
use std::path::{Path, PathBuf};

/// Arguments of `iprt render`.
#[derive(Clone, Debug, clap::Args)]
pub struct Args {
    #[command(flatten)]
    pub picture: PictureArgs,
    #[command(flatten)]
    pub target: TargetArgs,
    /// A .png (as displayed) or .exr (linear, with --aov layers); a %04d pattern for a sequence
    #[arg(short, long, value_name = "FILE")]
    pub output: PathBuf,
    /// Frames A..B, both included [default: the whole video with a pattern, otherwise frame 0]
    #[arg(long, value_name = "A..B")]
    pub frames: Option<String>,
    /// Number of frames that are run before frame A, held at A [default: 15; 0 with --spp or --method
    /// reference]
    #[arg(long)]
    pub warmup: Option<u32>,
    /// Converge the method's own model instead, with N paths a pixel, no filter and no history [default with
    /// --method reference: 64]
    #[arg(long, value_name = "N", conflicts_with_all = ["target_ms", "target_flip"])]
    pub spp: Option<u32>,
    /// Factor on radiance before display [default: the scene's]
    #[arg(long)]
    pub exposure: Option<f32>,
    /// Images to add to an EXR: names, or all
    #[arg(long, value_delimiter = ',', value_name = "LIST")]
    pub aov: Vec<String>,
    /// Make warnings of the scene and its files errors
    #[arg(long)]
    pub strict: bool,
    /// Print the GPU time of each pass, measured over N more frames
    #[arg(long, value_name = "N", num_args = 0..=1, default_missing_value = "16")]
    pub timings: Option<u32>,
}

/// Renders and writes.
pub fn run(args: &Args) -> Result<()> {
    let kind = FileKind::of(&args.output)?;
    require_folder(&args.output)?;
    args.target.target()?;
    let gpu = args.picture.device.open()?;
    let scene = args.picture.scene(&gpu)?;
    let mut options = args.picture.options(&scene, args.spp.is_some())?;
    let exposure = args.exposure.unwrap_or(scene.render.exposure);
    if !(exposure.is_finite() && exposure > 0.0) {
        return Err(Error::input("--exposure", format!("{exposure}"), "give a positive number"));
    }
    let pattern = Pattern::parse(&args.output)?;
    let sequence = pattern.is_sequence();
    let last = u32::try_from(scene.panorama.frame_count().max(1) - 1).unwrap_or(u32::MAX);
    let [first, last] = match &args.frames {
        Some(text) => parse_frames(text)?,
        None if sequence => [0, last],
        None => [0, 0],
    };
    if first != last && !sequence {
        let problem = "one file for several frames".to_owned();
        return Err(Error::input(args.output.display(), problem, "use a pattern, for example out_%04d.png"));
    }
    if kind == FileKind::Png && !args.aov.is_empty() {
        return Err(Error::input("--aov", "a PNG holds the picture alone", "write an .exr"));
    }

    if args.strict {
        // Only what is loaded can be warned of.
        scene.panorama.load(first as usize)?;
        super::forbid_warnings(true, &scene.name)?;
    }
    let chosen = args.target.apply(&gpu, &scene, &args.picture, &mut options, exposure, first != last)?;
    chosen.iter().for_each(|chosen| chosen.say(args.picture.quiet));
    let converge = args.spp.is_some() || options.method == Method::Reference;
    let warmup = args.warmup.unwrap_or(if converge { 0 } else { 15 });
    let spp = if converge { args.spp.unwrap_or(64).max(1) } else { 1 };
    let timed = args.timings.map_or(0, |frames| frames.saturating_add(1));
    let frames = (last - first + 1).saturating_mul(spp).saturating_add(warmup).saturating_add(timed);
    let plan = Plan::of(&scene, &options, Some(frames))?;
    let mut renderer = Renderer::with_plan(&gpu, &scene, options, plan)?;
    check_aovs(&renderer, &args.aov)?;
    if !args.picture.quiet {
        super::say(&renderer.plan().summary());
    }
    let bar =
        progress(args.picture.quiet, u64::from(warmup) + u64::from(last - first + 1) * u64::from(spp), "rendering");
    let render = |renderer: &mut Renderer, frame: u32, count: u32| {
        let times = std::iter::repeat_n(scene.panorama.frame_time(frame as usize), count as usize);
        renderer.render_all(&scene, times, &Wishes::default(), |_| {
            bar.inc(1);
            if signals::stopped() { Err(interrupted(args, [first, frame, last])) } else { Ok(()) }
        })
    };
    if sequence {
        signals::interrupted(); // each picture is kept
    }
    render(&mut renderer, first, warmup)?;
    for frame in first..=last {
        if converge {
            renderer.reset_history("a picture of its own");
        }
        render(&mut renderer, frame, spp)?;
        let path = pattern.file(frame);
        write(&renderer, &scene, &path, kind, exposure, &args.aov)?;
        if !args.picture.quiet {
            bar.suspend(|| super::print(&path.display().to_string()));
        }
    }
    bar.finish_and_clear();
    if let Some(frames) = args.timings {
        let report = time(&mut renderer, &scene, last, frames)?;
        super::print_lines(report.table().trim_end());
    }
    drop(renderer);
    args.picture.device.close(gpu)?;
    super::forbid_warnings(args.strict, &scene.name)
}

/// Says which frames are there, and how to go on.
fn interrupted(args: &Args, [first, frame, last]: [u32; 3]) -> Error {
    Error::Interrupted {
        subject: args.output.display().to_string(),
        at: format!("after {} of {} pictures", frame - first, last - first + 1),
        remedy: format!("they are kept; give --frames {frame}..{last} to go on"),
    }
}

fn time(renderer: &mut Renderer, scene: &Scene, first: u32, frames: u32) -> Result<bench::BenchReport> {
    bench::run(renderer, scene, first, frames, 1, &Wishes::default(), || {})
}

/// Fails if an image does not exist. It is called before rendering, which may take hours.
pub fn check_aovs(renderer: &Renderer, aovs: &[String]) -> Result<()> {
    aovs.iter().filter(|name| *name != "all").try_for_each(|name| renderer.require_aov(name))
}

/// Fails if the folder of an output does not exist or cannot be written. It is called before rendering, too.
pub fn require_folder(path: &Path) -> Result<()> {
    let folder = path.parent().filter(|folder| !folder.as_os_str().is_empty()).unwrap_or(Path::new("."));
    Temporary::new(folder).map(drop).map_err(|e| {
        Error::input(
            path.display(),
            format!("cannot be written: {}", e.kind()),
            "give a folder that exists and is writable",
        )
    })
}
