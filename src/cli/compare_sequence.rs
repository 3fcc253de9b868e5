//! `iprt compare --sequence` measures how far successive frames are from the truth, each frame for itself and
//! all of them over time.

use super::compare::{Args, color, region, table, write_diff};
use crate::{
    Error, Result,
    image_file::{ExrLayer, FileImage, read::read},
    measure::{
        metrics::{Metrics, Picture, compare},
        motion::{Seen, motion},
        sequence::{Lag, Sequence, TemporalMetrics, compare_sequence},
    },
    panorama::pattern::Pattern,
};
use serde::Serialize;
use std::path::Path;

/// The content that `--json` prints.
#[derive(Serialize)]
struct SequenceReport {
    temporal: TemporalMetrics,
    /// Whether the test's files say where pixels come from.
    motion: bool,
    mean: Metrics,
    /// The frame with the largest FLIP.
    worst: FrameMetrics,
    frames: Vec<FrameMetrics>,
}

#[derive(Clone, Serialize)]
struct FrameMetrics {
    frame: u32,
    #[serde(flatten)]
    metrics: Metrics,
}

/// Compares and prints.
pub fn run(args: &Args) -> Result<()> {
    let [test_files, truth_files] = [Pattern::parse(&args.test)?, Pattern::parse(&args.truth)?];
    let mask_files = args.mask.as_deref().map(Pattern::parse).transpose()?;
    let diff_files = args.diff.as_deref().map(Pattern::parse).transpose()?;
    if diff_files.as_ref().is_some_and(|diff| !diff.is_sequence()) {
        return Err(Error::input("--diff", "is one file for several frames", "use a pattern, as diff_%04d.png"));
    }
    let numbers = numbers(&args.test, &test_files, &args.truth, &truth_files)?;

    let (mut test, mut truth, mut ways) = (Vec::new(), Vec::new(), Some(Vec::new()));
    let (mut size, mut mask, mut frames) = ([0, 0], None, Vec::new());
    let mut former: Option<Layers> = None;
    for &frame in &numbers {
        let [test_file, truth_file] = [test_files.file(frame), truth_files.file(frame)];
        let (image, layers) = read_frame(&test_file)?;
        let wanted = color(&truth_file)?;
        size = image.size;
        let names = [&test_file, &truth_file].map(|file| file.display().to_string());
        let shown = Picture { subject: &names[0], size, texels: &image.texels };
        let should = Picture { subject: &names[1], size: wanted.size, texels: &wanted.texels };
        let inside = mask_files.as_ref().map(|files| region(&files.file(frame), wanted.size)).transpose()?;
        frames.push(FrameMetrics { frame, metrics: compare(shown, should, inside.as_deref(), args.exposure)? });
        if let Some(files) = &diff_files {
            write_diff(&files.file(frame), shown, should, args.exposure)?;
        }
        // The metrics over time count the pixels that the mask of any frame holds.
        mask = match (mask.take(), inside) {
            (Some(all), Some(inside)) => Some(union(all, &inside)),
            (_, inside) => inside,
        };
        ways = ways.zip(layers.as_ref()).map(|(mut ways, now)| {
            ways.push(former.as_ref().map_or_else(Vec::new, |former| motion(size, now.seen(), former.seen())));
            ways
        });
        former = layers;
        test.push(image.texels);
        truth.push(wanted.texels);
    }

    let subjects = [&args.test, &args.truth].map(|path| path.display().to_string());
    let temporal = compare_sequence(
        Sequence { subject: &subjects[0], size, frames: &test },
        Sequence { subject: &subjects[1], size, frames: &truth },
        ways.as_deref(),
        mask.as_deref(),
        args.exposure,
    )?;
    let metrics: Vec<Metrics> = frames.iter().map(|frame| frame.metrics).collect();
    let worst = frames.iter().max_by(|a, b| a.metrics.flip.total_cmp(&b.metrics.flip)).cloned();
    let (Some(mean), Some(worst)) = (Metrics::mean(&metrics), worst) else {
        return Err(Error::Internal("a sequence without frames".into()));
    };
    let report = SequenceReport { temporal, motion: ways.is_some(), mean, worst, frames };
    if !args.json.is_printed() {
        super::print_lines(&text(&report));
    }
    args.json.write(&report)
}

/// The numbers of the test's frames. The truth must have them too.
fn numbers(test: &Path, test_files: &Pattern, truth: &Path, truth_files: &Pattern) -> Result<Vec<u32>> {
    if !test_files.is_sequence() {
        return Err(Error::input(test.display(), "is one picture", "give a pattern, as frame_%04d.exr, to --sequence"));
    }
    let numbers = test_files.existing()?;
    let (&[first, .., last], count) = (numbers.as_slice(), numbers.len()) else {
        let problem = format!("{} frames are there", numbers.len());
        return Err(Error::input(test.display(), problem, "a sequence has two at least; check the pattern"));
    };
    if last - first >= count as u32 {
        let missing = (first..last).find(|n| !numbers.contains(n)).unwrap_or(first);
        return Err(Error::input(test_files.file(missing).display(), "is missing", "render every frame"));
    }
    if truth_files.is_sequence() {
        let others = truth_files.existing()?;
        if numbers != others {
            let range = |numbers: &[u32]| match numbers {
                [] => "no frames".to_owned(),
                [first, .., last] => format!("{} frames from {first} to {last}", numbers.len()),
                [one] => format!("frame {one} alone"),
            };
            let problem = format!("has {}, {} has {}", range(&numbers), truth.display(), range(&others));
            return Err(Error::input(test.display(), problem, "compare frames of the same numbers"));
        }
    }
    Ok(numbers)
}

/// What an EXR may hold besides the picture.
struct Layers {
    motion: Vec<[f32; 4]>,
    position: Option<Vec<[f32; 4]>>,
}

impl Layers {
    fn seen(&self) -> Seen<'_> {
        Seen { motion: &self.motion, position: self.position.as_deref() }
    }
}

fn read_frame(path: &Path) -> Result<(crate::image_file::ColorImage, Option<Layers>)> {
    let image = read(path)?;
    let layers = match &image {
        FileImage::Exr(exr) => {
            let named = |name: &str| exr.layers.iter().find(|layer| layer.name == name).and_then(texels);
            named("motion").map(|motion| Layers { motion, position: named("position") })
        }
        FileImage::Raster(_) => None,
    };
    Ok((image.into_color(&path.display().to_string())?, layers))
}

/// The channels R, G, B and A of a layer.
fn texels(layer: &ExrLayer) -> Option<Vec<[f32; 4]>> {
    let [r, g, b, a] = ["R", "G", "B", "A"].map(|name| layer.channel(name));
    let (r, g, b, a) = (r?, g?, b?, a?);
    Some((0..r.len()).map(|i| [r[i], g[i], b[i], a[i]]).collect())
}

fn union(mut all: Vec<bool>, more: &[bool]) -> Vec<bool> {
    all.iter_mut().zip(more).for_each(|(all, more)| *all |= more);
    all
}

fn text(report: &SequenceReport) -> String {
    let t = &report.temporal;
    let lag = match t.lag {
        Lag::Frames(frames) => format!("{frames} frames"),
        Lag::Never => "90 % never reached".to_owned(),
        Lag::NoChange => "– (the truth does not change)".to_owned(),
    };
    format!(
        "flicker {:.5} (truth {:.5})  lag {lag}  ghost energy {:.4}  warped difference {:.5} beyond the truth's ({})\n\
         mean of {} frames  {}\nworst: frame {}  {}",
        t.flicker,
        t.flicker_truth,
        t.ghost_energy,
        t.warped_difference,
        if report.motion { "by the test's motion vectors" } else { "nothing taken to move" },
        report.frames.len(),
        table(&report.mean),
        report.worst.frame,
        table(&report.worst.metrics),
    )
}
