//! Makes a frame of what was read: mends colour and depth, and warns of what is unusual about them.

use super::{
    cube,
    depth::{Quantisation, Rule, box_depth, length_words, unit_warning},
    level::Levelling,
    packing::{halves, unpack},
    pattern::Pattern,
    reduce,
    source::{DepthSource, Packing, PanoramaFrame, PanoramaSpec},
    tone,
};
use crate::{
    Error, Result,
    image_file::{CodeImage, ColorImage, FileImage, layers::Taken, srgb::srgb_to_linear},
    media::{VideoInfo, planes::Part},
};
use glam::Vec3;
use rayon::prelude::*;
use std::sync::Arc;

/// A picture of colour, of depth or of both, as it was read.
pub(super) enum Picture {
    File { subject: String, image: FileImage },
    Video { subject: String, info: Arc<VideoInfo>, codes: Arc<Vec<u8>> },
}

impl Picture {
    fn subject(&self) -> &str {
        match self {
            Self::File { subject, .. } | Self::Video { subject, .. } => subject,
        }
    }

    /// Returns the colour, and the depth codes if it holds both.
    fn color(self, spec: &PanoramaSpec) -> Result<(ColorImage, Option<CodeImage>)> {
        match self {
            Self::File { subject, image } if spec.packing == Packing::Separate => {
                Ok((image.color_of(spec.color_layer.as_deref(), &subject)?, None))
            }
            Self::File { subject, image } => {
                let (color, codes) = unpack(image, spec.packing, &subject)?;
                Ok((color, Some(codes)))
            }
            Self::Video { subject, info, codes } => {
                no_layer(spec.color_layer.as_deref(), &subject)?;
                let planes = info.planes(&codes);
                if spec.packing == Packing::Separate {
                    return Ok((planes.color(Part::whole(info.size)), None));
                }
                let [color, depth] = halves(info.size, spec.packing, &subject)?;
                Ok((planes.color(color), Some(planes.codes(depth, &subject)?)))
            }
        }
    }

    fn codes(self, layer: Option<&str>) -> Result<CodeImage> {
        match self {
            Self::File { subject, image } => image.codes_of(layer, &subject),
            Self::Video { subject, info, codes } => {
                no_layer(layer, &subject)?;
                info.planes(&codes).codes(Part::whole(info.size), &subject)
            }
        }
    }
}

fn no_layer(layer: Option<&str>, subject: &str) -> Result<()> {
    match layer {
        Some(_) => Err(Error::input(subject, "a video has no layers", "leave layer out")),
        None => Ok(()),
    }
}

/// Makes a frame from what was read. `number` is that of a file or of a video's frame, and
/// `is_first` says that it is the first one of the panorama. Returns also the picture's size in the file.
pub(super) fn make_frame(
    spec: &PanoramaSpec,
    number: u32,
    is_first: bool,
    color: Picture,
    depth: Option<Picture>,
) -> Result<(PanoramaFrame, [u32; 2])> {
    let subject = color.subject().to_owned();
    let of_video = matches!(color, Picture::Video { .. });
    let mut warnings = Vec::new();
    let (mut color, mut packed) = color.color(spec)?;
    if spec.cubes[0] {
        color = cube::color(color, &subject)?;
    }
    if spec.cubes[1] {
        packed = packed.map(|codes| cube::codes(codes, &subject)).transpose()?;
    }
    let mut taken = [color.taken.as_ref().map(|taken| taken.note("color")), None];
    let color = finish_color(color, spec, &subject, &mut warnings)?;
    let picture_size = color.size;
    let mut color = reduce::color(color);

    let rule = &spec.rule;
    let from_codes = |codes: CodeImage| {
        let codes = reduce::codes(codes);
        let quantisation = if codes.integer { rule.quantisation() } else { Quantisation::None };
        (codes.size, rule.metres(&codes.codes, codes.size), quantisation)
    };
    if let Some(mask) = &spec.mask {
        let mask = Pattern::parse(mask)?.file(number);
        let subject = mask.display().to_string();
        let mut mask = cube::read(&mask)?.into_color(&subject)?;
        if spec.cubes[0] && cube::is_cube(mask.size) {
            mask = cube::color(mask, &subject)?;
        }
        forget_masked(&mut color, &mask);
    }
    let level = Levelling::of(spec);
    if let Some(level) = &level {
        color.texels = level.radiance(color.size, &color.texels);
    }
    let size = color.size;
    let mut depth_subject = subject.clone();
    let (depth_size, mut depth, quantisation) = match (&spec.depth, depth, packed) {
        (DepthSource::Sphere(radius), ..) => (size, vec![*radius; color.texels.len()], Quantisation::None),
        (DepthSource::Box { size: extent, center }, ..) => {
            let depth = box_depth(size, *extent, *center - spec.position, f64::from(spec.yaw_degrees));
            (size, depth, Quantisation::None)
        }
        (DepthSource::Files(_), Some(picture), _) => {
            depth_subject = picture.subject().to_owned();
            let mut codes = picture.codes(spec.depth_layer.as_deref())?;
            if spec.cubes[1] {
                codes = cube::codes(codes, &depth_subject)?;
            }
            taken[1] = codes.taken.as_ref().map(|taken| taken.note("depth"));
            tell(&codes.notes, codes.taken.as_ref(), "depth", &depth_subject, &mut warnings);
            check_aspect(codes.size, &depth_subject, &mut warnings);
            warnings.extend(coarse(&codes, rule).map(|warning| format!("{depth_subject}: {warning}")));
            from_codes(codes)
        }
        (_, _, Some(codes)) => from_codes(codes),
        _ => return Err(Error::Internal("a panorama without a depth source".into())),
    };
    if let (Some(level), DepthSource::Files(_) | DepthSource::Packed) = (&level, &spec.depth) {
        depth = level.depth(depth_size, &depth);
    }
    // All frames of a video are of one kind, so the first one tells.
    let tells = is_first || !of_video;
    let unknown = forget_unknown(&mut color, depth_size, &mut depth);
    if unknown > 0 {
        let share = 100.0 * unknown as f64 / color.texels.len() as f64;
        let problem = format!("nothing is known of {share:.1} % of its texels: black, and holes in the depth");
        warnings.push(format!("{subject}: {problem}"));
    }
    if depth.iter().all(|metres| *metres == 0.0) {
        let problem = "every depth is a hole; the panorama is treated as infinitely far";
        warnings.push(format!("{depth_subject}: {problem} (check encoding, scale, offset and invalid)"));
    }
    if tells && matches!(spec.depth, DepthSource::Files(_) | DepthSource::Packed) {
        warnings.extend(unit_warning(&depth, rule).map(|warning| format!("{depth_subject}: {warning}")));
    }
    let white = color.ldr.then(|| tone::expand(Vec3::ONE, spec.inverse_tonemap).x * spec.exposure);
    let frame = PanoramaFrame {
        color_size: size,
        radiance: color.texels,
        white,
        depth_size,
        depth,
        quantisation,
        warnings,
        taken,
    };
    Ok((frame, picture_size))
}

/// Passes on what is unusual about a file, and which channels were taken if that is in doubt.
fn tell(notes: &[String], taken: Option<&Taken>, key: &str, subject: &str, warnings: &mut Vec<String>) {
    let doubt = taken.filter(|taken| taken.unsure).map(|taken| taken.note(key));
    warnings.extend(notes.iter().chain(&doubt).map(|note| format!("{subject}: {note}")));
}

/// Warns of depth in 8 bits, which is usually a preview.
fn coarse(codes: &CodeImage, rule: &Rule) -> Option<String> {
    let bits8 = codes.integer && codes.codes.iter().all(|code| code.is_nan() || *code <= 255.0);
    let Quantisation::Radial { step } = rule.quantisation() else { return None };
    (bits8 && step > 0.01).then(|| {
        let step = length_words(step);
        format!("has 8 bits, so that depth comes in steps of {step}; give the 16-bit or float output of what made it")
    })
}

/// Marks texels as unknown where a mask is dark.
fn forget_masked(color: &mut ColorImage, mask: &ColorImage) {
    let [width, height] = color.size.map(|side| side as usize);
    let place = |at: usize, from: usize, to: u32| (2 * at + 1) * to as usize / (2 * from);
    for (index, texel) in color.texels.iter_mut().enumerate() {
        let (x, y) = (place(index % width, width, mask.size[0]), place(index / width, height, mask.size[1]));
        let [r, g, b, known] = mask.texels[y * mask.size[0] as usize + x];
        if known == 0.0 || r + g + b < 1.5 * srgb_to_linear(0.5) {
            texel[3] = 0.0;
        }
    }
}

/// Makes texels of which nothing is known black, and holes in the depth. Returns how many there are.
fn forget_unknown(color: &mut ColorImage, depth_size: [u32; 2], depth: &mut [f32]) -> usize {
    let [width, height] = color.size.map(|side| side as usize);
    let unknown: Vec<bool> = color.texels.iter().map(|texel| texel[3] == 0.0).collect();
    let count = unknown.iter().filter(|unknown| **unknown).count();
    if count > 0 {
        let columns = depth_size[0] as usize;
        for (index, metres) in depth.iter_mut().enumerate() {
            let column = (index % columns * 2 + 1) * width / (2 * columns);
            let row = (index / columns * 2 + 1) * height / (2 * depth_size[1] as usize);
            if unknown[row * width + column] {
                *metres = 0.0;
            }
        }
        for texel in color.texels.iter_mut().filter(|texel| texel[3] == 0.0) {
            *texel = [0.0, 0.0, 0.0, 1.0];
        }
    }
    count
}

fn check_aspect(size: [u32; 2], subject: &str, warnings: &mut Vec<String>) {
    let [width, height] = size.map(u64::from);
    if width != 2 * height {
        warnings.push(format!("{subject}: is {width}x{height}, but a full panorama is twice as wide as high"));
    }
}

/// Mends bad texels, raises saturated ones, and applies the exposure.
fn finish_color(
    mut color: ColorImage,
    spec: &PanoramaSpec,
    subject: &str,
    warnings: &mut Vec<String>,
) -> Result<ColorImage> {
    check_aspect(color.size, subject, warnings);
    tell(&color.notes, color.taken.as_ref(), "color", subject, warnings);
    // Half precision overflows to infinity, so that is what was brightest.
    let finite = |texel: &[f32; 4]| texel[..3].iter().copied().filter(|value| value.is_finite()).fold(0.0, f32::max);
    let brightest = color.texels.par_iter().map(finite).reduce(|| f32::from(half::f16::MAX), f32::max);
    let (ldr, texels) = (color.ldr, &mut color.texels);
    let mended = |texel: &mut [f32; 4]| -> [usize; 3] {
        if texel[3] <= 0.0 {
            return [0; 3];
        }
        let rgb = [texel[0], texel[1], texel[2]];
        let (overflowed, negative) = (rgb.contains(&f32::INFINITY), rgb.iter().any(|value| *value < 0.0));
        let mut radiance = Vec3::from(rgb.map(|value| if value == f32::INFINITY { brightest } else { value.max(0.0) }));
        if ldr {
            radiance = tone::expand(radiance, spec.inverse_tonemap);
        }
        // The product must stay finite, too.
        let [r, g, b] = (radiance * spec.exposure).min(Vec3::splat(f32::MAX)).to_array();
        *texel = [r, g, b, 1.0];
        [1, usize::from(overflowed), usize::from(negative)]
    };
    let sum = |a: [usize; 3], b: [usize; 3]| std::array::from_fn(|i| a[i] + b[i]);
    let [known, overflowed, negative] = texels.par_iter_mut().map(mended).reduce(|| [0; 3], sum);
    if known == 0 {
        return Err(Error::input(subject, "holds no finite pixel", "write the image again"));
    }
    if negative > 0 {
        warnings.push(format!("{subject}: {negative} texels with negative radiance were set to 0 there"));
    }
    if overflowed > 0 {
        let problem = format!("{overflowed} texels with infinite radiance were set to {brightest}");
        warnings.push(format!("{subject}: {problem}, the brightest finite value"));
    }
    Ok(color)
}
