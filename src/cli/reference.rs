//! `iprt reference` renders converged pictures of the method's own model or of the complete true scene.

use super::{
    common::{PictureArgs, parse_frames},
    progress::{Progress, progress},
    render::{check_aovs, require_folder},
    signals::interrupted,
};
use crate::{
    Error, Result,
    image_file::{
        ExrLayer,
        write::{write_display, write_exr},
    },
    output::{FileKind, write},
    reference::{
        capture::is_black,
        truth::{self, End, Goal, NOISE_EVERY},
    },
    renderer::Renderer,
    settings::Method,
    warnings,
};
use indicatif::ProgressStyle;
use std::{path::PathBuf, sync::atomic::Ordering};

/// Arguments of `iprt reference`.
#[derive(Clone, Debug, clap::Args)]
pub struct Args {
    #[command(flatten)]
    pub picture: PictureArgs,
    /// An .exr (linear) or .png
    #[arg(short, long, value_name = "FILE")]
    pub output: PathBuf,
    /// Which truth to render: panorama (the method's own model, converged) or scene (the complete true scene,
    /// path-traced; this needs the scene file's room.gltf)
    #[arg(long, default_value = "panorama")]
    pub model: String,
    /// The most paths a pixel [default: 1024; 65536 with --until-noise]
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u32).range(1..=1 << 24))]
    pub spp: Option<u32>,
    /// Stop at this standard error, relative to the mean; 0.01 is 1 %
    #[arg(long, value_name = "X")]
    pub until_noise: Option<f64>,
    /// Continue where an earlier run stopped, and keep the state beside the output (with --model scene)
    #[arg(long)]
    pub resume: bool,
    /// The number of the frame
    #[arg(long, default_value = "0")]
    pub frame: String,
    /// Images to add to an EXR: names, or all
    #[arg(long, value_delimiter = ',', value_name = "LIST")]
    pub aov: Vec<String>,
}

/// Accumulates and writes.
pub fn run(args: &Args) -> Result<()> {
    let kind = FileKind::of(&args.output)?;
    let goal = goal(args)?;
    let [frame, _] = parse_frames(&args.frame)?;
    match args.model.as_str() {
        "panorama" if args.resume => {
            Err(Error::input("--resume", "is not known to --model panorama", "leave it out, or use --model scene"))
        }
        "panorama" => panorama(args, kind, goal, frame),
        "scene" => scene(args, kind, goal, frame),
        other => Err(Error::input("--model", format!("unknown \"{other}\""), "use panorama or scene")),
    }
}

fn goal(args: &Args) -> Result<Goal> {
    if let Some(noise) = args.until_noise
        && !(noise > 0.0 && noise < 1.0)
    {
        return Err(Error::input("--until-noise", noise, "give a share of the mean between 0 and 1, as 0.01"));
    }
    let samples = args.spp.unwrap_or(if args.until_noise.is_some() { 1 << 16 } else { 1024 });
    Ok(Goal { samples, noise: args.until_noise })
}

fn panorama(args: &Args, kind: FileKind, goal: Goal, frame: u32) -> Result<()> {
    require_folder(&args.output)?;
    let gpu = args.picture.device.open()?;
    let scene = args.picture.scene(&gpu)?;
    let mut picture = args.picture.clone();
    picture.method = Some(Method::Reference.name());
    let options = picture.options(&scene, true)?;
    let mut renderer = Renderer::new(&gpu, &scene, options)?;
    check_aovs(&renderer, &args.aov)?;
    let bar = Bar::new(args.picture.quiet, goal);
    let (mut paths, stop) = (0, interrupted());
    while paths < goal.samples && !stop.load(Ordering::Relaxed) {
        renderer.render(&scene, scene.panorama.frame_time(frame as usize))?;
        paths += 1;
        let noise = paths.is_multiple_of(NOISE_EVERY).then(|| renderer.standard_error()).transpose()?;
        bar.show(paths, noise);
        if goal.noise.zip(noise).is_some_and(|(most, noise)| noise <= most) {
            break;
        }
    }
    bar.0.finish_and_clear();
    if paths > 0 {
        write(
            std::slice::from_ref(&renderer),
            &scene,
            &args.output,
            kind,
            (scene.render.exposure, scene.render.tonemap),
            &args.aov,
        )?;
    }
    let so_far = so_far("paths", paths, renderer.standard_error()?);
    if stop.load(Ordering::Relaxed) {
        let kept = if paths > 0 { "the picture so far is there" } else { "nothing is kept" };
        return Err(Error::Interrupted {
            subject: args.output.display().to_string(),
            at: format!("at {so_far}"),
            remedy: format!("{kept}; run it again for all"),
        });
    }
    if !args.picture.quiet {
        super::print(&format!("{}: {so_far}", args.output.display()));
    }
    drop(renderer);
    args.picture.device.close(gpu)
}

fn scene(args: &Args, kind: FileKind, goal: Goal, frame: u32) -> Result<()> {
    for (flag, given) in [
        ("--method", args.picture.method.is_some()),
        ("--set", !args.picture.set.is_empty()),
        ("--aov", !args.aov.is_empty()),
    ] {
        if given {
            return Err(Error::input(
                flag,
                "has no meaning for --model scene",
                "leave it out, or use --model panorama",
            ));
        }
    }
    require_folder(&args.output)?;
    let state = truth::state_path(&args.output);
    if !args.resume {
        truth::require_none(&state)?;
    }
    let scene = args.picture.complete_scene()?;
    let size = args.picture.size(scene.camera.size)?;
    let gpu = args.picture.device.open()?;
    let mut tracer = truth::tracer(&gpu, &scene, args.picture.projection()?, size, args.picture.seed, frame)?;
    if args.resume {
        truth::resume(&mut tracer, &state)?;
    }
    let bar = Bar::new(args.picture.quiet, goal);
    let end =
        truth::converge(&mut tracer, goal, Some(&state), interrupted(), |samples, noise| bar.show(samples, noise))?;
    bar.0.finish_and_clear();

    let sums = tracer.read()?;
    let radiance = sums.radiance();
    match kind {
        FileKind::Png => write_display(&args.output, size, &radiance, scene.exposure)?,
        FileKind::Exr => write_exr(&args.output, &[ExrLayer::rgb("", size, &radiance)])?,
    }
    let black = is_black(radiance.iter().copied());
    warnings::tell(scene.black_warning(black, &args.output.display().to_string()).as_slice());
    let so_far = so_far("samples", sums.samples, sums.relative_noise());
    if end == End::Interrupted {
        return Err(Error::Interrupted {
            subject: args.output.display().to_string(),
            at: format!("at {so_far}"),
            remedy: "the picture so far is there; give --resume to go on".to_owned(),
        });
    }
    if args.resume {
        truth::save(&tracer, &state)?;
    } else {
        truth::remove(&state);
    }
    if !args.picture.quiet {
        super::print(&format!("{}: {so_far}", args.output.display()));
    }
    drop(tracer);
    args.picture.device.close(gpu)
}

fn so_far(what: &str, count: u32, noise: f64) -> String {
    format!("{count} {what} a pixel, standard error {:.2} % of the mean", 100.0 * noise)
}

/// A progress bar towards a goal, with the noise so far.
struct Bar(Progress, Goal);

impl Bar {
    fn new(quiet: bool, goal: Goal) -> Self {
        let bar = progress(quiet, goal.samples.into(), "converging");
        if let Ok(style) = ProgressStyle::with_template("{msg} {wide_bar} {pos}/{len} {eta}") {
            bar.set_style(style);
        }
        Self(bar, goal)
    }

    fn show(&self, samples: u32, noise: Option<f64>) {
        if let Some(noise) = noise {
            self.0.set_message(format!("noise {:.2} %", 100.0 * noise));
            if let Some(most) = self.1.noise {
                // Errors fall with the root of the number of samples.
                let needed = f64::from(samples) * (noise / most).powi(2);
                self.0.set_length(u64::from(self.1.samples).min(needed.ceil() as u64).max(samples.into()));
            }
        }
        self.0.set_position(samples.into());
    }
}
