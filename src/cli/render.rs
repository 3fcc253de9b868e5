//! `iprt render` renders pictures to files.

use super::{
    common::{MOST_FRAMES, PictureArgs, parse_frames, stamp},
    progress::progress,
    signals,
    sink::{Asked, Sink, Target, VideoArgs},
    target::TargetArgs,
};
use crate::{
    Error, Result,
    image_file::{tonemap::Tonemap, write::folder_of},
    measure::bench,
    options::RenderOptions,
    output::FileKind,
    panorama::pattern::Pattern,
    plan::Plan,
    renderer::{Renderer, Wishes},
    scene::Scene,
    settings::{Method, Settings, VirtualTracer},
    temporary::Temporary,
};
use indicatif::ProgressStyle;
use std::path::{Path, PathBuf};

/// Arguments of `iprt render`.
#[derive(Clone, Debug, clap::Args)]
pub struct Args {
    #[command(flatten)]
    pub picture: PictureArgs,
    #[command(flatten)]
    pub target: TargetArgs,
    /// A .png (as displayed) or .exr (linear, with --aov layers); a %04d pattern for a sequence; a video: .mp4, .mov, .webm or
    /// .mkv; or - for a stream on standard output
    #[arg(short, long, value_name = "FILE")]
    pub output: PathBuf,
    #[command(flatten)]
    pub video: VideoArgs,
    /// Frames A..B, both included [default: the whole video with a pattern or a video, otherwise frame 0]
    #[arg(long, value_name = "A..B")]
    pub frames: Option<String>,
    /// Number of frames that are run before frame A: those before it, and frame 0 held where there are none
    /// [default: 15; 0 with --spp or --method reference]. auto: as many as make frame A what it is in a run from frame 0
    #[arg(long, value_name = "N|auto", value_parser = Warmup::parse)]
    pub warmup: Option<Warmup>,
    /// Converge the method's own model instead, with N paths a pixel, no filter and no history [default with
    /// --method reference: 64]
    #[arg(long, value_name = "N", conflicts_with_all = ["target_ms", "target_flip"])]
    pub spp: Option<u32>,
    /// Factor on radiance before display [default: the scene's]
    #[arg(long)]
    pub exposure: Option<f32>,
    /// How light beyond white is shown in all but EXR and HDR: neutral is Khronos PBR Neutral [default: the scene's, or clip]
    #[arg(long, value_enum)]
    pub tonemap: Option<Tonemap>,
    /// Images to add to an EXR: names, or all
    #[arg(long, value_delimiter = ',', value_name = "LIST")]
    pub aov: Vec<String>,
    /// Write only the virtual objects, with alpha, as a .png
    #[arg(long)]
    pub alpha: bool,
    /// Render both eyes, so far apart (65mm, 0.065), the left above the right. With --projection equirect each eye sees all
    /// around with the other beside it (omnidirectional stereo), and a video says so to players
    #[arg(long, value_name = "DISTANCE", value_parser = parse_distance, conflicts_with = "timings")]
    pub stereo: Option<f32>,
    /// Make warnings of the scene and its files errors
    #[arg(long)]
    pub strict: bool,
    /// Print the GPU time of each pass, measured over N more frames
    #[arg(long, value_name = "N", num_args = 0..=1, default_missing_value = "16")]
    pub timings: Option<u32>,
}

/// Renders and writes.
pub fn run(args: &Args) -> Result<()> {
    let target = Target::of(&args.output, &args.video)?;
    args.target.target()?;
    let gpu = args.picture.device.open()?;
    let scene = args.picture.scene(&gpu)?;
    let mut options = args.picture.options(&scene, args.spp.is_some())?;
    let exposure = args.exposure.unwrap_or(scene.render.exposure);
    if !(exposure.is_finite() && exposure > 0.0) {
        return Err(Error::input("--exposure", format!("{exposure}"), "give a positive number"));
    }
    let tonemap = args.tonemap.unwrap_or(scene.render.tonemap);
    let sequence = match target {
        Target::Files(_) => Pattern::parse(&args.output)?.is_sequence(),
        Target::Video | Target::Stream => true,
    };
    let count = match target {
        Target::Files(_) => scene.panorama.frame_count(),
        // A video is as long as what moves in it.
        _ => scene.panorama.frame_count().max((scene.duration() * scene.panorama.fps - 0.5).max(0.0) as usize),
    };
    let last = u32::try_from(count.max(1) - 1).unwrap_or(MOST_FRAMES).min(MOST_FRAMES - 1);
    let [first, last] = match &args.frames {
        Some(text) => parse_frames(text)?,
        None if sequence => [0, last],
        None => [0, 0],
    };
    if first != last && !sequence {
        let problem = "one file for several frames".to_owned();
        return Err(Error::input(args.output.display(), problem, "use a pattern, for example out_%04d.png"));
    }
    if args.alpha && target != Target::Files(FileKind::Png) {
        return Err(Error::input("--alpha", "is for a PNG", "write a .png, or an .exr with --aov alpha,ratio"));
    }
    if target != Target::Files(FileKind::Exr) && !args.aov.is_empty() {
        let holder = if target == Target::Files(FileKind::Png) { "a PNG" } else { "a video" };
        return Err(Error::input("--aov", format!("{holder} holds the picture alone"), "write an .exr"));
    }

    if args.strict {
        // Only what is loaded can be warned of.
        scene.panorama.load(first as usize)?;
        super::forbid_warnings(true, &scene.name)?;
    }
    let chosen = args.target.apply(&gpu, &scene, &args.picture, &mut options, exposure, first != last)?;
    chosen.iter().for_each(|chosen| chosen.say(args.picture.quiet));
    let converge = args.spp.is_some() || options.method == Method::Reference;
    let warmup = match args.warmup {
        Some(Warmup::Frames(count)) => count,
        None | Some(Warmup::Auto) if converge => 0,
        None => STANDARD_WARMUP,
        Some(Warmup::Auto) => chunk_warmup(&options.settings).min(STANDARD_WARMUP + first),
    };
    let spp = if converge { args.spp.unwrap_or(64).max(1) } else { 1 };
    let timed = args.timings.map_or(0, |frames| frames.saturating_add(1));
    let frames = (last - first + 1).saturating_mul(spp).saturating_add(warmup).saturating_add(timed);
    if args.stereo.is_some() && options.settings.virtual_tracer == VirtualTracer::Screen {
        let problem = "needs rays that do not walk the picture (virtual_tracer = screen)";
        return Err(Error::input("--stereo", problem, "use --method iprt, or --set virtual_tracer=bvh"));
    }
    let eyes = args.stereo.map_or(vec![0.0], |apart| vec![-0.5 * apart, 0.5 * apart]);
    let of_eye = |eye| {
        let options = RenderOptions { eye, ..options.clone() };
        let plan = Plan::of(&scene, &options, Some(frames))?;
        Renderer::with_plan(&gpu, &scene, options, plan)
    };
    let mut eyes: Vec<Renderer> = eyes.into_iter().map(of_eye).collect::<Result<_>>()?;
    eyes.iter().try_for_each(|eye| check_aovs(eye, &args.aov))?;
    let job = if target == Target::Video { job(&scene, &eyes, exposure, spp, warmup, last)? } else { String::new() };
    let job = format!("{job} {}", tonemap.name());
    let frames = [first, last];
    let asked = Asked { video: &args.video, frames, exposure, tonemap, aovs: &args.aov, alpha: args.alpha, job };
    let mut sink = Sink::open(target, &args.output, &asked, &scene, &eyes)?;
    if !args.picture.quiet {
        eyes.iter().take(1).for_each(|eye| super::say(&eye.plan().summary()));
    }
    let begin = sink.next(first);
    if begin > first && !args.picture.quiet {
        super::say(&format!("{}: goes on at frame {begin}", args.output.display()));
    }
    // A run that goes on sees what the one before saw.
    let goes_on = begin > first && begin <= last && !converge;
    let warmup = if goes_on { warmup.max(AGAIN).min(STANDARD_WARMUP + begin) } else { warmup };
    let count = u64::from(warmup) + u64::from((last + 1).saturating_sub(begin)) * u64::from(spp);
    let bar = progress(args.picture.quiet, count, "rendering");
    if let (Target::Video, Ok(style)) =
        (target, ProgressStyle::with_template("{msg} {wide_bar} {pos}/{len} {per_sec} {eta}"))
    {
        bar.set_style(style);
    }
    if sequence && target != Target::Stream {
        signals::interrupted(); // what is written is kept
    }
    let start = |frame: u32| scene.panorama.frame_time(frame as usize);
    let render = |eyes: &mut [Renderer], times: &mut dyn Iterator<Item = f64>| {
        render_all(eyes, &scene, times, || {
            bar.inc(1);
            if signals::stopped() { Err(interrupted(args, [first, begin, last])) } else { Ok(()) }
        })
    };
    if begin > 0 && !converge {
        eyes.iter_mut().for_each(|eye| eye.count_from((STANDARD_WARMUP + begin).wrapping_sub(warmup)));
    }
    // The frames before, and frame 0 held where there are none.
    let before = |count: u32| (1..=count).rev().map(|before| start(begin.saturating_sub(before)));
    let mut rendered = if begin > last { Ok(()) } else { render(&mut eyes, &mut before(warmup)) };
    for frame in begin..=last {
        if converge {
            eyes.iter_mut().for_each(|eye| eye.reset_history("a picture of its own"));
        }
        rendered = rendered.and_then(|()| render(&mut eyes, &mut std::iter::repeat_n(start(frame), spp as usize)));
        if let Err(error) = rendered {
            bar.finish_and_clear();
            return Err(match (error, target) {
                (Error::Interrupted { .. }, Target::Files(_)) => interrupted(args, [first, frame, last]),
                (Error::Interrupted { .. }, _) => sink.interrupt(frame),
                (error, _) => error,
            });
        }
        match sink.write(&eyes, &scene, frame)? {
            Some(line) if !args.picture.quiet && !line.is_empty() => bar.suspend(|| super::print(&line)),
            Some(_) => {}
            None => break,
        }
    }
    let line = sink.finish()?;
    bar.finish_and_clear();
    if let Some(line) = line.filter(|_| !args.picture.quiet) {
        super::print(&line);
    }
    if let (Some(frames), [renderer]) = (args.timings, &mut eyes[..]) {
        let report = time(renderer, &scene, last, frames)?;
        super::print_lines(report.table().trim_end());
    }
    drop(eyes);
    args.picture.device.close(gpu)?;
    super::forbid_warnings(args.strict, &scene.name)
}

/// Renders a frame for each of these times by a renderer, or by those of two eyes, and calls `each` after every one.
fn render_all(
    eyes: &mut [Renderer],
    scene: &Scene,
    times: &mut dyn Iterator<Item = f64>,
    mut each: impl FnMut() -> Result<()>,
) -> Result<()> {
    let wishes = Wishes::default();
    if let [renderer] = eyes {
        return renderer.render_all(scene, times, &wishes, |_| each());
    }
    for time in times {
        let begun = eyes.iter_mut().map(|eye| eye.begin(scene, time, &wishes)).collect::<Result<Vec<_>>>()?;
        for (eye, begun) in eyes.iter_mut().zip(begun) {
            eye.collect(begun)?;
        }
        each()?;
    }
    Ok(())
}

/// Reads a distance: `65mm`, `6.5cm`, `0.065m` or `0.065`.
fn parse_distance(text: &str) -> std::result::Result<f32, String> {
    let (number, unit) = match text.trim().strip_suffix('m') {
        None => (text.trim(), 1.0),
        Some(rest) => match (rest.strip_suffix('m'), rest.strip_suffix('c')) {
            (Some(number), _) => (number, 1e-3),
            (_, Some(number)) => (number, 1e-2),
            _ => (rest, 1.0),
        },
    };
    let metres = number.trim().parse::<f32>().ok().map(|number| number * unit);
    metres.filter(|metres| (1e-3..=1.0).contains(metres)).ok_or_else(|| "give 1mm to 1m, for example 65mm".to_owned())
}

/// Says which frames are there, and how to go on.
fn interrupted(args: &Args, [first, frame, last]: [u32; 3]) -> Error {
    Error::Interrupted {
        subject: args.output.display().to_string(),
        at: format!("after {} of {} pictures", frame - first, last - first + 1),
        remedy: format!("they are kept; give --frames {frame}..{last} to go on"),
    }
}

/// Frames that are run before the first one, unless the user says how many.
const STANDARD_WARMUP: u32 = 15;

/// Frames that are run again where a video is begun in its middle by another machine. A mean of so many paths, of which each
/// frame adds a share, forgets all but a seventh of what was before in twice as many frames.
fn chunk_warmup(settings: &Settings) -> u32 {
    let share = if settings.sampling_mask { settings.rays_per_pixel } else { 1.0 };
    ((2.0 * settings.history as f32 / share) as u32).max(AGAIN)
}

/// Frames that are run again where a run goes on that was stopped. More would be seen even less, but waited for.
const AGAIN: u32 = 48;

/// What `--warmup` says.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Warmup {
    Frames(u32),
    Auto,
}

impl Warmup {
    fn parse(text: &str) -> std::result::Result<Self, String> {
        match text {
            "auto" => Ok(Self::Auto),
            number => number.parse().map(Self::Frames).map_err(|_| "give a number of frames, or auto".to_owned()),
        }
    }
}

/// Stands for all that the pictures depend on.
fn job(scene: &Scene, eyes: &[Renderer], exposure: f32, spp: u32, warmup: u32, last: u32) -> Result<String> {
    let start = scene.panorama.frame_time(0);
    let rendered = crate::reference::cache::hash_rendered(scene, start)?.finalize().to_hex().to_string();
    let options = || eyes.iter().map(Renderer::options);
    let described: String = options().map(crate::reference::cache::describe).collect();
    let methods: Vec<Method> = options().map(|options| options.method).collect();
    // Camera and objects are looked at in some of the frames.
    let step = (last as usize / 16).max(1);
    let moves: Vec<String> = (0..=last as usize)
        .step_by(step)
        .map(|frame| {
            let state = scene.at(scene.panorama.frame_time(frame), scene.panorama.frame_time(frame));
            let places: Vec<_> = state.instances.instances.iter().map(|instance| instance.object_to_world).collect();
            format!("{:?} {places:?}", state.camera)
        })
        .collect();
    let panorama = scene.panorama.spec();
    let files: Vec<String> = panorama.map_or(Vec::new(), |spec| spec.files()).iter().map(|file| stamp(file)).collect();
    Ok(format!("{rendered} {:?} {described} {exposure} {spp} {warmup} {moves:?} {panorama:?} {files:?}", methods))
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
    let folder = folder_of(path);
    Temporary::new(folder).map(drop).map_err(|e| {
        Error::input(
            path.display(),
            format!("cannot be written: {}", e.kind()),
            "give a folder that exists and is writable",
        )
    })
}
