//! `iprt compare` measures how far a picture is from the truth.

use super::json::JsonArgs;
use crate::{
    Error, Result,
    image_file::{
        read::{ColorImage, FileImage, read},
        write::write_png,
    },
    measure::metrics::{Metrics, NoiseFree, Picture, compare, flip_map},
    reference::stored,
};
use std::path::{Path, PathBuf};

/// Arguments of `iprt compare`.
#[derive(Clone, Debug, clap::Args)]
pub struct Args {
    /// The picture (.exr, .png, .jpg, .hdr), or a %04d pattern with --sequence
    pub test: PathBuf,
    /// The picture that TEST should be, or a pattern with --sequence. With layers a and b, the independent
    /// halves of a stored truth, it is their mean, and RMSE and relMSE are also given free of its noise
    pub truth: PathBuf,
    /// Compare only where this picture is bright (at least ½); a pattern gives each frame its own mask
    #[arg(long, value_name = "PNG")]
    pub mask: Option<PathBuf>,
    /// Factor on radiance before display, for PSNR, SSIM and FLIP
    #[arg(long, default_value_t = 1.0)]
    pub exposure: f32,
    /// Write FLIP's error of each pixel, from black (none) to white (most); a pattern with --sequence
    #[arg(long, value_name = "PNG")]
    pub diff: Option<PathBuf>,
    /// Compare successive frames, with flicker, lag and ghosts; a TRUTH without a number is the truth of
    /// every frame
    #[arg(long)]
    pub sequence: bool,
    #[command(flatten)]
    pub json: JsonArgs,
}

/// Compares and prints.
pub fn run(args: &Args) -> Result<()> {
    if !(args.exposure.is_finite() && args.exposure > 0.0) {
        return Err(Error::input("--exposure", args.exposure, "give a positive number"));
    }
    args.json.require()?;
    if args.sequence {
        return super::compare_sequence::run(args);
    }
    let (test, (truth, halves)) = (color(&args.test)?, truth(&args.truth)?);
    let names = [&args.test, &args.truth].map(|path| path.display().to_string());
    let test = Picture { subject: &names[0], size: test.size, texels: &test.texels };
    let truth = Picture { subject: &names[1], size: truth.size, texels: &truth.texels };
    let mask = args.mask.as_deref().map(|path| region(path, truth.size)).transpose()?;
    let mut metrics = compare(test, truth, mask.as_deref(), args.exposure)?;
    if let Some([a, b]) = &halves {
        metrics.noise_free = NoiseFree::of(test.texels, [a, b], mask.as_deref());
    }
    if let Some(path) = &args.diff {
        write_diff(path, test, truth, args.exposure)?;
    }
    if !args.json.is_printed() {
        super::print_lines(&table(&metrics));
    }
    args.json.write(&metrics)
}

/// Writes FLIP's error of each pixel as a grey PNG.
pub(super) fn write_diff(path: &Path, test: Picture, truth: Picture, exposure: f32) -> Result<()> {
    let codes: Vec<u8> =
        flip_map(test, truth, exposure)?.iter().map(|e| (e.clamp(0.0, 1.0) * 255.0 + 0.5) as u8).collect();
    write_png(path, truth.size, &codes, 1)
}

pub(super) fn color(path: &Path) -> Result<ColorImage> {
    read(path)?.into_color(&path.display().to_string())
}

/// Reads the bright half of a mask.
pub(super) fn region(path: &Path, size: [u32; 2]) -> Result<Vec<bool>> {
    let image = read(path)?.into_color(&path.display().to_string())?;
    if image.size != size {
        let problem = format!("is {}×{}, the pictures are {}×{}", image.size[0], image.size[1], size[0], size[1]);
        return Err(Error::input(path.display(), problem, "give a mask of their size"));
    }
    // For an LDR mask it is half of the sRGB code, decoded.
    Ok(image.texels.iter().map(|t| (t[0] + t[1] + t[2]) / 3.0 >= if image.ldr { 0.214 } else { 0.5 }).collect())
}

/// Reads a truth, and its halves if it has two.
fn truth(path: &Path) -> Result<(ColorImage, Option<stored::Halves>)> {
    let image = read(path)?;
    if let FileImage::Exr(exr) = &image
        && let Some((size, halves)) = stored::halves(&exr.layers)
    {
        return Ok((
            ColorImage { size, texels: stored::mean(&halves), ldr: false, taken: None, notes: Vec::new() },
            Some(halves),
        ));
    }
    Ok((image.into_color(&path.display().to_string())?, None))
}

pub(super) fn table(m: &Metrics) -> String {
    let free = m.noise_free.map_or(String::new(), |free| {
        format!("  without the truth's noise: RMSE {:.5}  relMSE {:.5}", free.rmse, free.relmse)
    });
    format!(
        "FLIP {:.4}  PSNR {:.2} dB  SSIM {:.4}  RMSE {:.5}  relMSE {:.5}  largest {:.4}  mean ratio {:.4}  pixels {}{free}",
        m.flip, m.psnr, m.ssim, m.rmse, m.relmse, m.max_abs, m.mean_ratio, m.pixels
    )
}
