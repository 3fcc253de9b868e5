//! Guesses what stored depth means, for files that come without a word about it.

use super::{
    cloud::Cloud,
    depth::{DepthEncoding, Rule, unit},
    preset::Preset,
    room::{BENT, bending, is_inverted, level},
    source::PanoramaFrame,
};
use crate::image_file::CodeImage;

/// A rule, and in words what was assumed.
#[derive(Clone, Debug, PartialEq)]
pub struct Guess {
    pub rule: Rule,
    pub because: String,
}

fn cloud(codes: &CodeImage, rule: &Rule) -> Cloud {
    let depth = rule.metres(codes.codes.clone(), codes.size);
    let frame = PanoramaFrame { depth_size: codes.size, depth, ..PanoramaFrame::default() };
    Cloud::of(&frame, 0.0)
}

/// Guesses the rule of an image of depth. `height` is that of the camera over the floor in metres, which gives
/// relative depth its scale.
pub fn rule(codes: &CodeImage, height: f64) -> Guess {
    let radial = Rule::default();
    let seen = cloud(codes, &radial);
    if is_inverted(&seen) {
        return disparity(codes, radial, height);
    }
    let (nearest, middle) = (seen.percentile(0.01).unwrap_or(1.0), seen.percentile(0.5).unwrap_or(1.0));
    let floor = level(&seen, true).map(|floor| floor.distance);
    let (scale, because) = match (unit(nearest, floor), floor) {
        (Some((factor, unit)), _) => (factor, format!("the depth seems to be in {unit}")),
        (None, Some(floor)) if floor >= 0.3 => {
            (1.0, format!("the depth seems to be in metres: the floor is {floor:.2} m under the camera"))
        }
        (None, Some(floor)) => {
            let because = format!("the depth is relative: scaled so that the camera stands {height} m over the floor");
            (height / f64::from(floor), because)
        }
        (None, None) if middle < 0.5 => {
            let because = "the depth is relative and no floor was found: scaled so that half of all is within 2.5 m";
            (2.5 / f64::from(middle), because.to_owned())
        }
        (None, None) => (1.0, "the depth is taken for metres".to_owned()),
    };
    // Significant digits only: the guess is no better.
    let scale = if scale == factor_of_ten(scale) { scale } else { rounded(scale) };
    let axis = |i: usize| seen.directions[i].abs().max_element();
    let bent = bending(&seen, |i| 1.0 / seen.depth[i].max(1e-6));
    let flat = bending(&seen, |i| axis(i) / seen.depth[i].max(1e-6));
    let encoding = if bent > BENT && flat < 0.4 * bent { DepthEncoding::Planar } else { DepthEncoding::Radial };
    Guess { rule: Rule { encoding, scale, ..radial }, because }
}

/// Returns what a preset says, with a guess at the scale of relative depth.
pub fn by_preset(preset: &Preset, codes: &CodeImage, height: f64) -> Guess {
    let named = preset.rule();
    match (preset.scale, preset.encoding) {
        (Some(_), _) => Guess { rule: named, because: format!("what {} writes", preset.name) },
        (None, DepthEncoding::Disparity) => disparity(codes, named, height),
        (None, _) => {
            let guess = rule(codes, height);
            Guess { rule: Rule { scale: guess.rule.scale, ..named }, because: guess.because }
        }
    }
}

/// What a room looks like if its disparity has this offset.
struct Tried {
    offset: f64,
    /// How far windows of it are from planes.
    bent: f32,
    /// The share of the sphere that the floor covers, less if it is tilted.
    floor: f32,
}

impl Tried {
    fn of(codes: &CodeImage, radial: &Rule, span: f64, offset: f64) -> Self {
        let rule = Rule { encoding: DepthEncoding::Disparity, scale: span.max(1e-6), offset, ..radial.clone() };
        let seen = cloud(codes, &rule);
        let bent = bending(&seen, |i| 1.0 / seen.depth[i].max(1e-6));
        let floor = level(&seen, true).map_or(0.0, |floor| floor.share * (-(floor.tilt / 6.0).powi(2)).exp());
        Self { offset, bent: if bent.is_finite() { bent } else { 1.0 }, floor }
    }
}

fn disparity(codes: &CodeImage, radial: Rule, height: f64) -> Guess {
    let mut known: Vec<f32> = codes.codes.iter().copied().filter(|code| *code > 0.0).step_by(7).collect();
    known.sort_by(f32::total_cmp);
    let at = |share: usize| known.get(known.len() * share / 100).copied().map_or(1.0, f64::from);
    let (low, span) = (at(2), at(98) - at(2));
    // Estimators leave the offset open. At the right one the floor is large and level, and walls are flat.
    let offsets = [0.0, 0.03, 0.08, 0.2, 0.5].map(|part| part * span).into_iter();
    let offsets = offsets.chain([-0.95, -0.9, -0.8, -0.7, -0.55, -0.4, -0.25, -0.1].map(|part| part * low));
    let tried: Vec<Tried> = offsets.map(|offset| Tried::of(codes, &radial, span, offset)).collect();
    let floor = tried.iter().map(|tried| tried.floor).fold(0.0, f32::max);
    let fits = tried.iter().filter(|tried| tried.floor >= 0.85 * floor);
    let best = fits.min_by(|a, b| a.bent.total_cmp(&b.bent)).unwrap_or(&tried[0]);
    let plain = &tried[0];
    let is_better = plain.floor < 0.85 * floor || best.bent < 0.8 * plain.bent;
    let offset = if is_better { rounded(best.offset) } else { 0.0 };
    let rule = Rule { encoding: DepthEncoding::Disparity, scale: span.max(1e-6), offset, ..radial };
    let seen = cloud(codes, &rule);
    let (factor, because) = match level(&seen, true) {
        Some(floor) => (height / f64::from(floor.distance), format!("the camera stands {height} m over the floor")),
        None => {
            let middle = seen.percentile(0.5).map_or(1.0, f64::from);
            (2.5 / middle, "half of all is within 2.5 m, as no floor was found".to_owned())
        }
    };
    let scale = rounded(rule.scale * factor);
    Guess {
        rule: Rule { scale, ..rule },
        because: format!("bright is near, so it is a disparity: scaled so that {because}"),
    }
}

fn factor_of_ten(value: f64) -> f64 {
    10_f64.powi(value.log10().round() as i32)
}

/// Three significant digits.
fn rounded(value: f64) -> f64 {
    format!("{value:.2e}").parse().unwrap_or(value)
}
