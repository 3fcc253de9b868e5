//! `iprt masks`: the regions that errors are told apart by.

use super::common::{PictureArgs, parse_frames, progress};
use crate::{
    Error, Result, image_file::write::write_png, measure::regions::regions, renderer::Renderer, settings::Method,
};
use std::{fs, path::PathBuf};

/// Arguments of `iprt masks`.
#[derive(Clone, Debug, clap::Args)]
pub struct Args {
    #[command(flatten)]
    pub picture: PictureArgs,
    /// The folder for virtual.png and influenced.png, which is made where it does not exist
    #[arg(short, long, value_name = "DIR")]
    pub output: PathBuf,
    /// Paths a pixel of the truth, which is the converged model of `iprt`
    #[arg(long, default_value_t = 256)]
    pub spp: u32,
    /// Which frame
    #[arg(long, default_value = "0")]
    pub frame: String,
}

/// Converges the truth with the objects and without, and writes.
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
    fs::create_dir_all(&args.output).map_err(|error| {
        Error::input(args.output.display(), format!("cannot be made: {}", error.kind()), "give a writable folder")
    })?;
    let (size, spp, time) = (options.size, args.spp.max(1), scene.panorama.frame_time(frame as usize));

    // Nothing in the picture without objects is random.
    let bar = progress(args.picture.quiet, u64::from(spp) + 1, "converging");
    let mut empty = options.clone();
    empty.without_objects = true;
    let mut renderer = Renderer::new(&gpu, &scene, empty)?;
    renderer.render(&scene, time)?;
    bar.inc(1);
    let without = renderer.picture()?;
    drop(renderer);
    let mut renderer = Renderer::new(&gpu, &scene, options)?;
    for _ in 0..spp {
        renderer.render(&scene, time)?;
        bar.inc(1);
    }
    bar.finish_and_clear();
    let with = renderer.picture()?;
    let coverage: Vec<f32> = renderer.aov("real_coverage")?.iter().map(|texel| texel[0]).collect();
    drop(renderer);

    let found = regions(size, &with, &without, &coverage);
    for (name, mask) in [("virtual.png", &found.virtual_), ("influenced.png", &found.influenced)] {
        let path = args.output.join(name);
        write_png(&path, size, &mask.iter().map(|inside| u8::from(*inside) * 255).collect::<Vec<_>>(), 1)?;
        if !args.picture.quiet {
            let share = 100.0 * mask.iter().filter(|inside| **inside).count() as f64 / mask.len() as f64;
            super::print(&format!("{}: {share:.1} % of the picture", path.display()))?;
        }
    }
    args.picture.device.close(gpu)
}
