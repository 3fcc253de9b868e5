//! Makes a frame of what was read: mends colour and depth, and warns of what is unusual about them.

use super::{
    codes::Codes,
    cube,
    depth::{Quantisation, Rule, box_depth, length_words, unit_warning},
    level::Levelling,
    packing::{halves, unpack},
    pattern::Pattern,
    reduce::{self, Means},
    source::{DepthSource, Packing, PanoramaFrame, PanoramaSpec},
    texels::{self, Texels},
    tone,
};
use crate::{
    Error, Result, budget,
    image_file::{CodeImage, ColorImage, layers::Taken, read, rows::Rows, srgb::srgb_to_linear},
    media::{VideoInfo, planes::Part},
};
use glam::Vec3;
use rayon::prelude::*;
use std::{path::PathBuf, sync::Arc};

/// A picture of colour, of depth or of both, as it was read.
pub(super) enum Picture {
    File { subject: String, path: PathBuf },
    Video { subject: String, info: Arc<VideoInfo>, codes: Arc<Vec<u8>> },
}

impl Picture {
    fn subject(&self) -> &str {
        match self {
            Self::File { subject, .. } | Self::Video { subject, .. } => subject,
        }
    }

    /// Returns the colour, and the depth codes if it holds both.
    fn color(self, spec: &PanoramaSpec) -> Result<(Read, Option<CodeImage>)> {
        let (color, packed) = match self {
            Self::File { subject, path } if spec.packing == Packing::Separate => {
                if !spec.cubes[0] && !cube::has_faces(&path) {
                    return Ok((Read::Colors(Colors::Rows(Rows::open(&path, spec.color_layer.as_deref())?)), None));
                }
                (cube::read(&path)?.color_of(spec.color_layer.as_deref(), &subject)?, None)
            }
            Self::File { subject, path } => {
                let (color, codes) = unpack(cube::read(&path)?, spec.packing, &subject)?;
                (color, Some(codes))
            }
            Self::Video { subject, info, codes } => {
                no_layer(spec.color_layer.as_deref(), &subject)?;
                let planes = info.planes(&codes);
                let (part, packed) = if spec.packing == Packing::Separate {
                    (Part::whole(info.size), None)
                } else {
                    let [color, depth] = halves(info.size, spec.packing, &subject)?;
                    (color, Some(planes.codes(depth, &subject)?))
                };
                if Codes::serve(&info, spec) {
                    return Ok((Read::Codes(Codes::new(Arc::clone(&info), Arc::clone(&codes), part, spec)), packed));
                }
                (planes.color(part), packed)
            }
        };
        Ok((Read::Colors(Colors::Image(color)), packed))
    }

    fn codes(self, layer: Option<&str>) -> Result<CodeImage> {
        match self {
            Self::File { subject, path } if cube::has_faces(&path) => cube::read(&path)?.codes_of(layer, &subject),
            Self::File { path, .. } => read::codes(&path, layer),
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

/// The colours of a picture: of a file, of which only the header is read, or all.
enum Colors {
    Rows(Rows),
    Image(ColorImage),
}

/// The colours of a picture, or a video's codes, which stay what they are.
enum Read {
    Colors(Colors),
    Codes(Codes),
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
    ask_device(&color, depth.as_ref(), spec)?;
    let (color, mut packed) = color.color(spec)?;
    let color = match color {
        Read::Colors(Colors::Image(image)) if spec.cubes[0] => {
            Read::Colors(Colors::Image(cube::color(image, &subject)?))
        }
        other => other,
    };
    if spec.cubes[1] {
        packed = packed.map(|codes| cube::codes(codes, &subject)).transpose()?;
    }
    let mut color = match color {
        Read::Colors(colors) => mended(colors, spec, &subject, of_video, &mut warnings)?,
        Read::Codes(codes) => {
            let (size, ldr) = (codes.part().size, codes.is_ldr());
            check_aspect(size, &subject, &mut warnings);
            Mended { size, texels: codes.into(), ldr, taken: None, picture_size: size }
        }
    };
    let mut taken = [color.taken.take(), None];
    let picture_size = color.picture_size;

    let rule = &spec.rule;
    let from_codes = |codes: CodeImage| {
        let codes = reduce::codes(codes);
        let quantisation = if codes.integer { rule.quantisation() } else { Quantisation::None };
        (codes.size, rule.metres(codes.codes, codes.size), quantisation)
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
        (DepthSource::Sphere(radius), ..) => {
            let size = computed(size);
            (size, vec![*radius; size[0] as usize * size[1] as usize], Quantisation::None)
        }
        (DepthSource::Box { size: extent, center }, ..) => {
            let size = computed(size);
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
        warnings.extend(unit_warning(&depth, depth_size, rule).map(|warning| format!("{depth_subject}: {warning}")));
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
fn forget_masked(color: &mut Mended, mask: &ColorImage) {
    let [width, height] = color.size.map(|side| side as usize);
    let place = |at: usize, from: usize, to: u32| (2 * at + 1) * to as usize / (2 * from);
    color.texels.change(|first, texels| {
        for (index, texel) in texels.iter_mut().enumerate() {
            let at = first + index;
            let (x, y) = (place(at % width, width, mask.size[0]), place(at / width, height, mask.size[1]));
            let [r, g, b, known] = mask.texels[y * mask.size[0] as usize + x];
            if known == 0.0 || r + g + b < 1.5 * srgb_to_linear(0.5) {
                texel[3] = 0.0;
            }
        }
    });
}

/// Makes texels of which nothing is known black, and holes in the depth. Returns how many there are.
fn forget_unknown(color: &mut Mended, depth_size: [u32; 2], depth: &mut [f32]) -> usize {
    let [width, height] = color.size.map(|side| side as usize);
    // A video's codes are all known.
    let all_known = color.texels.codes().is_some();
    let count = if all_known { 0 } else { color.texels.par_iter().filter(|texel| texel[3] == 0.0).count() };
    if count > 0 {
        let columns = depth_size[0] as usize;
        for (index, metres) in depth.iter_mut().enumerate() {
            let column = (index % columns * 2 + 1) * width / (2 * columns);
            let row = (index / columns * 2 + 1) * height / (2 * depth_size[1] as usize);
            if color.texels.at(row * width + column)[3] == 0.0 {
                *metres = 0.0;
            }
        }
        color.texels.change(|_, texels| {
            texels.iter_mut().filter(|texel| texel[3] == 0.0).for_each(|texel| *texel = [0.0, 0.0, 0.0, 1.0]);
        });
    }
    count
}

fn check_aspect(size: [u32; 2], subject: &str, warnings: &mut Vec<String>) {
    let [width, height] = size.map(u64::from);
    if width != 2 * height {
        warnings.push(format!("{subject}: is {width}x{height}, but a full panorama is twice as wide as high"));
    }
}

/// The size of depth that is computed for a picture of this size. It is smooth, so it need not be as large.
fn computed([width, height]: [u32; 2]) -> [u32; 2] {
    let by = width.div_ceil(4096).max(1);
    [width.div_ceil(by), height.div_ceil(by)]
}

/// Refuses pictures that the device cannot hold, by what their headers say.
fn ask_device(color: &Picture, depth: Option<&Picture>, spec: &PanoramaSpec) -> Result<()> {
    let plain = spec.packing == Packing::Separate;
    let ask = |picture: &Picture, bytes: &dyn Fn(u64) -> [u64; 2]| match picture {
        Picture::File { subject, path } if plain && !cube::has_faces(path) => {
            let size = Rows::size(path)?.map(|size| reduce::reduced(size).unwrap_or(size));
            size.map_or(Ok(()), |size| budget::ask_device(subject, size, bytes))
        }
        _ => Ok(()),
    };
    // What passes/panorama.rs allocates: colour with mip levels, and depth, as it was and mended, with normals, planes and
    // boxes, of which planes are the largest.
    ask(color, &|texels| [texels::bytes(texels) * 4 / 3; 2])?;
    depth.map_or(Ok(()), |depth| ask(depth, &|texels| [16 * texels, 36 * texels]))
}

/// Bytes that reading a picture takes beside what is kept of it.
const READING: u64 = 64 << 20;

/// Colours without bad texels.
struct Mended {
    size: [u32; 2],
    texels: Texels,
    ldr: bool,
    /// Which channels of an EXR they are.
    taken: Option<String>,
    /// Width and height before they were reduced.
    picture_size: [u32; 2],
}

/// Reads colours, mends bad texels, raises saturated ones, applies the exposure, and makes the picture as small as is asked.
/// Negative channels are no faults if colours may be `wide`: those of a video that has more of them than Rec. 709.
fn mended(
    mut colors: Colors,
    spec: &PanoramaSpec,
    subject: &str,
    wide: bool,
    warnings: &mut Vec<String>,
) -> Result<Mended> {
    let (from, ldr, notes, taken) = match &mut colors {
        Colors::Rows(Rows { size, ldr, notes, taken, .. })
        | Colors::Image(ColorImage { size, ldr, notes, taken, .. }) => {
            (*size, *ldr, std::mem::take(notes), taken.take())
        }
    };
    check_aspect(from, subject, warnings);
    tell(&notes, taken.as_ref(), "color", subject, warnings);
    let size = reduce::reduced(from).unwrap_or(from);
    let least = if wide { f32::MIN } else { 0.0 };
    let mut mending = Mending { spec, ldr, least, half: texels::is_half(size), counts: [0; 4], brightest: 0.0 };
    let mut means = (size != from).then(|| Means::new(from, size));
    let texels = match (colors, &mut means) {
        (Colors::Rows(rows), means) => {
            let kept = texels::bytes(u64::from(size[0]) * u64::from(size[1]));
            budget::ask(subject, rows.held.max(kept) + READING)?;
            let mut texels = Texels::blank(if means.is_none() { size[0] as usize * size[1] as usize } else { 0 });
            rows.each(&mut |row, strip| {
                mending.mend(strip);
                match means {
                    Some(means) => means.add(row, strip),
                    None => texels.write(row as usize * size[0] as usize, strip),
                }
            })?;
            texels
        }
        (Colors::Image(mut image), None) => {
            mending.mend(&mut image.texels);
            image.texels.into()
        }
        (Colors::Image(mut image), Some(means)) => {
            mending.mend(&mut image.texels);
            means.add(0, &image.texels);
            Texels::default()
        }
    };
    let brightest = mending.end(subject, warnings)?;
    let texels = match (means, brightest) {
        (Some(means), brightest) => means.end(brightest.unwrap_or(0.0)),
        (None, None) => texels,
        (None, Some(brightest)) => {
            let mut texels = texels;
            let finite = |value: f32| if value.is_finite() { value } else { brightest };
            texels.change(|_, all| all.par_iter_mut().for_each(|texel| *texel = texel.map(finite)));
            texels
        }
    };
    Ok(Mended { size, texels, ldr, taken: taken.map(|taken| taken.note("color")), picture_size: from })
}

/// Mends texels, and counts what it met.
struct Mending<'a> {
    spec: &'a PanoramaSpec,
    ldr: bool,
    /// What is smaller is a fault.
    least: f32,
    /// Whether the texels are kept as 16-bit floats.
    half: bool,
    counts: Counts,
    /// The largest finite value of the file.
    brightest: f32,
}

/// How many texels are known, infinite and negative, and too bright to be kept as they are.
type Counts = [usize; 4];

impl Mending<'_> {
    /// Mends texels. Infinite values stay what they are.
    fn mend(&mut self, texels: &mut [[f32; 4]]) {
        let (spec, ldr, least) = (self.spec, self.ldr, self.least);
        let most = if self.half { texels::BRIGHTEST } else { f32::MAX };
        let mend = |texel: &mut [f32; 4]| -> (Counts, f32) {
            let rgb = [texel[0], texel[1], texel[2]];
            let brightest = rgb.into_iter().filter(|value| value.is_finite()).fold(0.0, f32::max);
            if texel[3] <= 0.0 {
                *texel = [0.0; 4];
                return ([0; 4], brightest);
            }
            let (infinite, negative) = (rgb.contains(&f32::INFINITY), rgb.iter().any(|value| *value < least));
            let mut radiance = Vec3::from(rgb.map(|value| value.max(least)));
            if ldr {
                radiance = tone::expand(radiance, spec.inverse_tonemap);
            }
            // The product must stay finite, too.
            let shown = (radiance * spec.exposure).min(Vec3::splat(f32::MAX)).to_array();
            let [r, g, b] = std::array::from_fn(|c| if rgb[c] == f32::INFINITY { rgb[c] } else { shown[c] });
            *texel = [r, g, b, 1.0];
            let dimmed = [r, g, b].iter().any(|value| value.is_finite() && *value > most);
            ([1, usize::from(infinite), usize::from(negative), usize::from(dimmed)], brightest)
        };
        let both = |a: (Counts, f32), b: (Counts, f32)| (std::array::from_fn(|i| a.0[i] + b.0[i]), a.1.max(b.1));
        let all = texels.par_iter_mut().map(mend).reduce(|| ([0; 4], 0.0), both);
        (self.counts, self.brightest) = both((self.counts, self.brightest), all);
    }

    /// Tells what was met. Returns what infinite values become, if there are any: half precision overflows to infinity, so
    /// that is what was brightest.
    fn end(&self, subject: &str, warnings: &mut Vec<String>) -> Result<Option<f32>> {
        let [known, infinite, negative, dimmed] = self.counts;
        if known == 0 {
            return Err(Error::input(subject, "holds no finite pixel", "write the image again"));
        }
        if negative > 0 {
            warnings.push(format!("{subject}: {negative} texels with negative radiance were set to 0 there"));
        }
        if dimmed > 0 {
            let problem = "are brighter than 4.29e9, the most that a panorama of more than 4096x2048 texels holds";
            warnings.push(format!("{subject}: {dimmed} texels {problem} (give --panorama-size 4096, or an exposure)"));
        }
        let brightest = self.brightest.max(half::f16::MAX.to_f32());
        if infinite > 0 {
            let problem = format!("{infinite} texels with infinite radiance were set to {brightest}");
            warnings.push(format!("{subject}: {problem}, the brightest finite value"));
        }
        Ok((infinite > 0).then(|| (brightest * self.spec.exposure).min(f32::MAX)))
    }
}
