//! `iprt reference`: the converged picture of the method's own model.

use super::{
    common::{PictureArgs, parse_frames, progress},
    render::{Kind, check_aovs, require_folder, write},
};
use crate::{Error, Result, renderer::Renderer, settings::Method};
use std::path::PathBuf;

/// Arguments of `iprt reference`.
#[derive(Clone, Debug, clap::Args)]
pub struct Args {
    #[command(flatten)]
    pub picture: PictureArgs,
    /// An .exr (linear) or .png
    #[arg(short, long, value_name = "FILE")]
    pub output: PathBuf,
    /// panorama: the method's own model, converged
    #[arg(long, default_value = "panorama")]
    pub model: String,
    /// Paths a pixel
    #[arg(long, default_value_t = 1024)]
    pub spp: u32,
    /// Which frame
    #[arg(long, default_value = "0")]
    pub frame: String,
    /// Images to add to an EXR: names, or all
    #[arg(long, value_delimiter = ',', value_name = "LIST")]
    pub aov: Vec<String>,
}

/// Accumulates and writes.
pub fn run(args: &Args) -> Result<()> {
    if args.model != "panorama" {
        return Err(Error::input("--model", format!("\"{}\" is not available", args.model), "use panorama"));
    }
    let kind = Kind::of(&args.output)?;
    require_folder(&args.output)?;
    let gpu = args.picture.device.open()?;
    let scene = args.picture.scene(&gpu)?;
    let mut picture = args.picture.clone();
    picture.method = Some(Method::Reference.name());
    let options = picture.options(&scene, true)?;
    let [frame, _] = parse_frames(&args.frame)?;
    let mut renderer = Renderer::new(&gpu, &scene, options)?;
    check_aovs(&renderer, &args.aov)?;
    let bar = progress(args.picture.quiet, u64::from(args.spp.max(1)), "converging");
    for _ in 0..args.spp.max(1) {
        renderer.render(&scene, scene.panorama.frame_time(frame as usize))?;
        bar.inc(1);
    }
    bar.finish_and_clear();
    write(&renderer, &scene, &args.output, kind, scene.render.exposure, &args.aov)?;
    if !args.picture.quiet {
        println!(
            "{}: {} paths a pixel, standard error {:.2} % of the mean",
            args.output.display(),
            args.spp.max(1),
            100.0 * renderer.standard_error()?
        );
    }
    drop(renderer);
    args.picture.device.close(gpu)
}
