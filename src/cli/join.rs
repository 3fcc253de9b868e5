//! `iprt join` checks that all frames of a render are there and of one kind, and encodes them.

use super::{
    common::{open_scene, parse_frames, stamp},
    progress::progress,
    signals,
    sink::{Timing, VideoArgs, look_of, sound},
};
use crate::{
    Error, Result,
    gpu::{Gpu, GpuOptions},
    image_file::{read, tonemap::Tonemap},
    media::{
        encode::{Container, Encoding, Wanted},
        film::{Extras, Film, Look, Shot},
        spherical::Views,
    },
    panorama::pattern::Pattern,
    scene::Scene,
};
use image::{ImageDecoder as _, ImageReader};
use std::{
    collections::BTreeMap,
    path::{Path, PathBuf},
    sync::Arc,
};

/// Arguments of `iprt join`.
#[derive(Clone, Debug, clap::Args)]
pub struct Args {
    /// A folder of numbered .png or .exr frames, or a pattern of them
    pub frames_in: PathBuf,
    /// The video to write: .mp4, .mov, .webm or .mkv
    #[arg(short, long, value_name = "FILE")]
    pub output: PathBuf,
    /// The scene that was rendered: its rate, sound, colours and exposure are taken
    #[arg(long, value_name = "SCENE")]
    pub scene: Option<String>,
    /// Frames a second without a scene
    #[arg(long, default_value_t = 30.0, conflicts_with = "scene")]
    pub fps: f64,
    /// Demand exactly the frames A..B, both included [default: from the first to the last that is there]
    #[arg(long, value_name = "A..B")]
    pub frames: Option<String>,
    /// Factor on the radiance of .exr frames [default: the scene's, or 1]
    #[arg(long)]
    pub exposure: Option<f32>,
    /// How light beyond white is shown, of .exr frames [default: the scene's, or clip]
    #[arg(long, value_enum)]
    pub tonemap: Option<Tonemap>,
    /// Say in the file that it is 360°, for frames of --projection equirect
    #[arg(long)]
    pub spherical: bool,
    /// Say in the file that the frames hold two eyes, the left on top, as render --stereo writes them
    #[arg(long, requires = "spherical")]
    pub stereo: bool,
    #[command(flatten)]
    pub video: VideoArgs,
    /// Print less
    #[arg(short, long)]
    pub quiet: bool,
}

/// Checks and encodes.
pub fn run(args: &Args) -> Result<()> {
    if Container::of(&args.output).is_none() {
        let remedy = "write .mp4, .mov, .webm or .mkv";
        return Err(Error::input(args.output.display(), "is no video's name", remedy));
    }
    super::render::require_folder(&args.output)?;
    let (pattern, numbers) = find(&args.frames_in)?;
    let range = args.frames.as_deref().map(parse_frames).transpose()?;
    let [first, last] = complete(&args.frames_in, &numbers, range)?;
    let size = one_kind(&pattern, first..=last)?;
    if !(args.fps.is_finite() && args.fps > 0.0) {
        return Err(Error::input("--fps", args.fps, "give a positive number"));
    }
    let scene = args.scene.as_deref().map(|name| scene(name, args.quiet)).transpose()?;
    let is_linear = pattern.file(first).extension().is_some_and(|e| e.eq_ignore_ascii_case("exr"));
    let exposure = args.exposure.or_else(|| scene.as_ref().map(|scene| scene.render.exposure)).unwrap_or(1.0);
    if !(exposure.is_finite() && exposure > 0.0) {
        return Err(Error::input("--exposure", exposure, "give a positive number"));
    }
    let timing = Timing::of(scene.as_ref(), args.fps, [first, last]);
    let look = match &scene {
        Some(scene) if is_linear => look_of(scene, exposure, args.tonemap.unwrap_or(scene.render.tonemap)),
        // A PNG holds what is seen.
        _ if !is_linear => Look { exposure: 1.0, tonemap: Tonemap::Clip, for_display: Arc::new(|light| light) },
        _ => Look { exposure, tonemap: args.tonemap.unwrap_or_default(), for_display: Arc::new(|light| light) },
    };
    let source = scene.as_ref().and_then(|scene| scene.panorama.video());
    let wanted = Wanted { codec: args.video.codec, crf: args.video.crf, pix_fmt: args.video.pix_fmt.clone() };
    let encoding = Encoding::of(&wanted, &args.output, size, timing.rate, source)?;
    let stamps: Vec<String> = (first..=last).map(|number| stamp(&pattern.file(number))).collect();
    let job = format!("join {exposure} {:?} {stamps:?}", look.tonemap);
    let mut film = Film::begin(&args.output, encoding, look, &job, [first, last])?;
    let begin = film.next();
    let bar = progress(args.quiet, u64::from(last + 1 - begin), "encoding");
    signals::interrupted();
    for number in begin..=last {
        if signals::stopped() {
            film.stop()?;
            let (at, remedy) = (format!("before frame {number}"), "run the same command to go on".to_owned());
            return Err(Error::Interrupted { subject: args.output.display().to_string(), at, remedy });
        }
        let path = pattern.file(number);
        let color = read::read(&path)?.into_color(&path.display().to_string())?;
        film.write(Shot { texels: color.texels, source: None, times: timing.times(number) })?;
        bar.inc(1);
    }
    let audio = scene.as_ref().filter(|_| !args.video.no_audio).and_then(|scene| sound(scene, first));
    let views = if args.stereo { Views::TopBottom } else { Views::One };
    film.finish(&Extras { audio, spherical: args.spherical.then_some(views) })?;
    bar.finish_and_clear();
    if !args.quiet {
        super::print(&args.output.display().to_string());
    }
    Ok(())
}

fn scene(name: &str, quiet: bool) -> Result<Scene> {
    if crate::scene::rooms::by_name(name).is_none() {
        return Scene::load(super::common::scene_path(name)?);
    }
    open_scene(&Gpu::new(&GpuOptions::default())?, Some(name), quiet)
}

/// Finds the numbered frames of a folder or of a pattern.
fn find(path: &Path) -> Result<(Pattern, Vec<u32>)> {
    if !path.is_dir() {
        let pattern = Pattern::parse(path)?;
        if !pattern.is_sequence() {
            return Err(Error::input(
                path.display(),
                "is neither a folder nor a pattern",
                "give one, for example frames/f_%04d.png",
            ));
        }
        let numbers = pattern.existing()?;
        return Ok((pattern, numbers));
    }
    let unreadable = |error: std::io::Error| Error::input(path.display(), error.kind(), "check its permissions");
    let mut kinds: BTreeMap<String, usize> = BTreeMap::new();
    for entry in std::fs::read_dir(path).map_err(unreadable)? {
        let name = entry.map_err(unreadable)?.file_name().to_string_lossy().into_owned();
        if name.starts_with('.') {
            continue;
        }
        let Some((stem, extension)) = name.rsplit_once('.') else { continue };
        let before = stem.trim_end_matches(|c: char| c.is_ascii_digit());
        let digits = stem.len() - before.len();
        if digits > 0 && ["png", "exr"].contains(&extension.to_lowercase().as_str()) {
            let before = before.replace('%', "%%");
            *kinds.entry(format!("{before}%0{digits}d.{extension}")).or_default() += 1;
        }
    }
    let known = kinds.iter().map(|(name, count)| format!("{name} ({count})")).collect::<Vec<_>>().join(", ");
    match kinds.len() {
        0 => Err(Error::input(path.display(), "holds no numbered .png or .exr frames", "give the folder of a render")),
        1 => {
            let name = kinds.into_keys().next().unwrap_or_default();
            let pattern = Pattern::parse(&path.join(name))?;
            let numbers = pattern.existing()?;
            Ok((pattern, numbers))
        }
        _ => Err(Error::input(
            path.display(),
            format!("holds frames of several kinds: {known}"),
            "give one of these patterns",
        )),
    }
}

/// Demands that no frame is missing.
fn complete(path: &Path, numbers: &[u32], range: Option<[u32; 2]>) -> Result<[u32; 2]> {
    let (Some(least), Some(most)) = (numbers.first(), numbers.last()) else {
        return Err(Error::input(path.display(), "no frame is there", "render them first"));
    };
    let [first, last] = range.unwrap_or([*least, *most]);
    let missing = gaps(numbers, [first, last]);
    let Some([begin, end]) = missing.first() else { return Ok([first, last]) };
    let count: u64 = missing.iter().map(|[a, b]| u64::from(b - a) + 1).sum();
    let problem = format!("{count} of {} frames are missing: {}", u64::from(last - first) + 1, words(&missing));
    let remedy = format!("render them, for example with --frames {begin}..{end} --warmup auto");
    Err(Error::input(path.display(), problem, remedy))
}

/// The runs of numbers of a range that are not among these, which are in order.
fn gaps(numbers: &[u32], [first, last]: [u32; 2]) -> Vec<[u32; 2]> {
    let mut gaps = Vec::new();
    let mut next = Some(first);
    for number in numbers.iter().filter(|number| (first..=last).contains(number)) {
        if let Some(next) = next.filter(|next| next < number) {
            gaps.push([next, number - 1]);
        }
        next = number.checked_add(1);
    }
    gaps.extend(next.filter(|next| *next <= last).map(|next| [next, last]));
    gaps
}

/// Runs of numbers as words: `3, 7..12`. The first eight of them.
fn words(runs: &[[u32; 2]]) -> String {
    let words = |[a, b]: &[u32; 2]| if a == b { a.to_string() } else { format!("{a}..{b}") };
    let shown = runs.iter().take(8).map(words).collect::<Vec<_>>().join(", ");
    if runs.len() > 8 { format!("{shown}, …") } else { shown }
}

/// Demands that all frames are whole and of one size and one kind, and returns the size.
fn one_kind(pattern: &Pattern, numbers: std::ops::RangeInclusive<u32>) -> Result<[u32; 2]> {
    let mut known: Option<([u32; 2], String)> = None;
    for number in numbers {
        let path = pattern.file(number);
        let (size, kind) = kind_of(&path)?;
        let Some((first, of)) = &known else {
            known = Some((size, kind));
            continue;
        };
        let differs = if *first != size {
            Some((format!("{}x{}", size[0], size[1]), format!("{}x{}", first[0], first[1])))
        } else {
            (kind != *of).then(|| (kind.clone(), of.clone()))
        };
        if let Some((is, should)) = differs {
            let problem = format!("is {is}, but the first frame is {should}");
            return Err(Error::input(path.display(), problem, "render it again by the command of the others"));
        }
    }
    known.map(|(size, _)| size).ok_or_else(|| Error::Internal("no frames".into()))
}

/// What is said of frames of a panorama.
const AROUND: &str = ", all around";

/// The size of a frame, and in words how it is stored and what it shows.
fn kind_of(path: &Path) -> Result<([u32; 2], String)> {
    let broken =
        |problem: String| Error::input(path.display(), format!("cannot be read: {problem}"), "render it again");
    if path.extension().is_some_and(|e| e.eq_ignore_ascii_case("exr")) {
        let meta = exr::meta::MetaData::read_from_file(path, false).map_err(|error| broken(read::one_line(&error)))?;
        let header = meta.headers.first().ok_or_else(|| broken("it has no layer".into()))?;
        // Frames of which some have more images are of one kind.
        let shown = |name: &exr::meta::attribute::Text| ["R", "G", "B", "Y"].iter().any(|channel| name.eq(channel));
        let channels = header.channels.list.iter().filter(|channel| shown(&channel.name));
        let stored: Vec<String> =
            channels.map(|channel| format!("{} {:?}", channel.name, channel.sample_type)).collect();
        let around = if header.own_attributes.environment_map.is_some() { AROUND } else { "" };
        let size = [header.layer_size.0 as u32, header.layer_size.1 as u32];
        return Ok((size, format!("an EXR of {}{around}", stored.join(", "))));
    }
    let open = || {
        let reader = ImageReader::open(path)?.with_guessed_format()?;
        let format = reader.format();
        Ok((format, reader.into_decoder()?))
    };
    let (format, mut decoder) = open().map_err(|error: image::ImageError| broken(read::one_line(&error)))?;
    let format = format.map_or_else(String::new, |format| format!("{format:?}").to_uppercase());
    let xmp = decoder.xmp_metadata().ok().flatten().unwrap_or_default();
    let around = if xmp.windows(15).any(|word| word == b"equirectangular") { AROUND } else { "" };
    let (width, height) = decoder.dimensions();
    Ok(([width, height], format!("a {format} of {:?}{around}", decoder.original_color_type())))
}

#[cfg(test)]
mod tests {
    #[test]
    fn missing_frames_are_named_by_ranges() {
        let gaps = super::gaps(&[0, 1, 2, 4, 5, 6, 10, 11], [0, 12]);
        assert_eq!(gaps, [[3, 3], [7, 9], [12, 12]]);
        assert_eq!(super::words(&gaps), "3, 7..9, 12");
        assert_eq!(super::gaps(&[4, 5, 9], [5, 7]), [[6, 7]]);
        assert_eq!(super::gaps(&[0, 1, u32::MAX], [0, u32::MAX]), [[2, u32::MAX - 1]]);
        assert!(super::gaps(&[3, 4], [3, 4]).is_empty());
    }
}
