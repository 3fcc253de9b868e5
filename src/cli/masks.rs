//! `iprt masks` writes the regions by which errors are reported.

use super::{
    common::{PictureArgs, parse_frames},
    progress::progress,
};
use crate::{
    Error, Result,
    image_file::write::{make_folder, write_png},
    measure::regions::{of_model, of_scene},
    settings::Method,
};
use std::path::PathBuf;

/// Arguments of `iprt masks`.
#[derive(Clone, Debug, clap::Args)]
pub struct Args {
    #[command(flatten)]
    pub picture: PictureArgs,
    /// Folder for virtual.png and influenced.png; it is made if it does not exist
    #[arg(short, long, value_name = "DIR")]
    pub output: PathBuf,
    /// Which truth to use: panorama (the converged model of iprt) or scene (the complete true scene)
    /// [default: scene if its room is known]
    #[arg(long)]
    pub model: Option<String>,
    /// Paths a pixel of the truth [default: 64 with --model scene, 256 with panorama]
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u32).range(1..=1 << 24))]
    pub spp: Option<u32>,
    /// The number of the frame
    #[arg(long, default_value = "0")]
    pub frame: String,
}

/// Computes the truth with the objects and without, and writes the masks.
pub fn run(args: &Args) -> Result<()> {
    if args.picture.without_objects {
        return Err(Error::input("--without-objects", "masks are about objects", "leave it out"));
    }
    let [frame, last] = parse_frames(&args.frame)?;
    if frame != last {
        return Err(Error::input("--frame", format!("\"{}\" is not one frame", args.frame), "give one number"));
    }
    let gpu = args.picture.device.open()?;
    let scene = args.picture.scene(&gpu)?;
    let mut picture = args.picture.clone();
    picture.method = Some(Method::Reference.name());
    let options = picture.options(&scene, true)?;
    make_folder(&args.output)?;
    let known = args.picture.room_known(&scene);
    let by_scene = match args.model.as_deref() {
        None => known,
        Some("panorama") => false,
        Some("scene") => true,
        Some(other) => {
            return Err(Error::input("--model", format!("unknown \"{other}\""), "use panorama or scene"));
        }
    };
    let found = if by_scene {
        let with = args.picture.complete_scene()?;
        let without = PictureArgs { without_objects: true, quiet: true, ..picture }.complete_scene()?;
        let samples = args.spp.unwrap_or(64);
        let bar = progress(args.picture.quiet, 2 * u64::from(samples), "converging");
        let found = of_scene(&gpu, &scene, &options, [&with, &without], frame, samples, || bar.inc(1))?;
        bar.finish_and_clear();
        found
    } else {
        let (samples, time) = (args.spp.unwrap_or(256), scene.panorama.frame_time(frame as usize));
        let bar = progress(args.picture.quiet, u64::from(samples) + 1, "converging");
        let found = of_model(&gpu, &scene, &options, time, samples, || bar.inc(1))?;
        bar.finish_and_clear();
        found
    };
    for (name, mask) in [("virtual.png", &found.virtual_), ("influenced.png", &found.influenced)] {
        let path = args.output.join(name);
        write_png(&path, options.size, &mask.iter().map(|inside| u8::from(*inside) * 255).collect::<Vec<_>>(), 1)?;
        if !args.picture.quiet {
            let share = 100.0 * mask.iter().filter(|inside| **inside).count() as f64 / mask.len() as f64;
            super::print(&format!("{}: {share:.1} % of the picture", path.display()));
        }
    }
    args.picture.device.close(gpu)
}
