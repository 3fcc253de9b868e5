//! Guesses what stored depth means, for files that come without a word about it.

use super::{
    cloud::Cloud,
    depth::{DepthEncoding, Rule, unit},
    preset::Preset,
    room::{BENT, Reading, bending, level, reading},
};
use crate::image_file::CodeImage;

/// A rule, and in words what was assumed.
#[derive(Clone, Debug, PartialEq)]
pub struct Guess {
    pub rule: Rule,
    pub because: String,
}

fn cloud(codes: &CodeImage, rule: &Rule) -> Cloud {
    Cloud::of_depth(&rule.metres(codes.codes.clone(), codes.size), codes.size, 0.0)
}

/// Guesses the rule of an image of depth. `height` is that of the camera over the floor in metres, which gives
/// relative depth its scale.
pub fn rule(codes: &CodeImage, height: f64) -> Guess {
    let radial = Rule::default();
    let seen = cloud(codes, &radial);
    if reading(&seen) == Reading::Swapped {
        return disparity(codes, radial, height);
    }
    if is_stretched(codes) {
        return stretched(codes, radial, height);
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

/// Guesses the rule anew of depth that was read by another one. It is for the same codes.
pub(super) fn reread(cloud: &Cloud, read: &Rule, height: f64) -> Rule {
    let axis = |i: usize| f64::from(cloud.directions[i].abs().max_element());
    // The codes with the offset, by which all that follows is found.
    let stored = |i: usize| match (f64::from(cloud.depth[i]), read.encoding) {
        (metres, _) if metres <= 0.0 => 0.0,
        (metres, DepthEncoding::Radial) => metres / read.scale,
        (metres, DepthEncoding::Planar) => metres * axis(i) / read.scale,
        (metres, DepthEncoding::Disparity) => read.scale / metres,
    };
    let codes = (0..cloud.depth.len()).map(|i| stored(i) as f32).collect();
    let size = cloud.size.map(|side| side as u32);
    let meant = rule(&CodeImage { size, codes, integer: false, taken: None, notes: Vec::new() }, height).rule;
    Rule { offset: rounded(meant.offset + read.offset), invalid: read.invalid.clone(), ..meant }
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

/// What a room looks like by a rule whose offset is tried.
struct Tried {
    rule: Rule,
    /// How far windows of it are from planes.
    bent: f32,
    /// The share of the sphere that the floor covers, less if it is tilted.
    floor: f32,
}

impl Tried {
    fn of(codes: &CodeImage, rule: Rule) -> Self {
        let seen = cloud(codes, &rule);
        let bent = bending(&seen, |i| 1.0 / seen.depth[i].max(1e-6));
        let floor = level(&seen, true).map_or(0.0, |floor| floor.share * (-(floor.tilt / 6.0).powi(2)).exp());
        Self { rule, bent: if bent.is_finite() { bent } else { 1.0 }, floor }
    }
}

/// Says which of the rules shows a room: at the right one the floor is large and level, and walls are flat. The
/// first one stays where no other is clearly better.
fn best(tried: &[Tried]) -> &Tried {
    let floor = tried.iter().map(|tried| tried.floor).fold(0.0, f32::max);
    let fits = tried.iter().filter(|tried| tried.floor >= 0.85 * floor);
    let best = fits.min_by(|a, b| a.bent.total_cmp(&b.bent)).unwrap_or(&tried[0]);
    let is_better = tried[0].floor < 0.85 * floor || best.bent < 0.8 * tried[0].bent;
    if is_better { best } else { &tried[0] }
}

/// Returns the offset near that of a rule by which walls are flattest. It is no farther than `step` away.
fn refined(codes: &CodeImage, tried: &Tried, step: f64) -> Rule {
    let (mut rule, mut bent) = (tried.rule.clone(), tried.bent);
    for step in [0.5, 0.25, 0.125].map(|part| part * step) {
        let sides = [-step, step].map(|by| Tried::of(codes, Rule { offset: rule.offset + by, ..rule.clone() }));
        if let Some(better) = sides.into_iter().filter(|side| side.bent < bent).min_by(|a, b| a.bent.total_cmp(&b.bent))
        {
            (rule, bent) = (better.rule, better.bent);
        }
    }
    rule
}

/// Scales a rule so that the camera stands `height` over the floor, and says so.
fn scaled(codes: &CodeImage, rule: &Rule, height: f64) -> (Rule, String) {
    let seen = cloud(codes, rule);
    let (factor, because) = match level(&seen, true) {
        Some(floor) => (height / f64::from(floor.distance), format!("the camera stands {height} m over the floor")),
        None => {
            let middle = seen.percentile(0.5).map_or(1.0, f64::from);
            (2.5 / middle, "half of all is within 2.5 m, as no floor was found".to_owned())
        }
    };
    (Rule { scale: rounded(rule.scale * factor), offset: rounded(rule.offset), ..rule.clone() }, because)
}

/// The codes that are known, in order. Some hundred thousand tell.
fn ordered(codes: &CodeImage) -> Vec<f32> {
    let known = |code: &f32| code.is_finite() && *code > 0.0;
    let mut known: Vec<f32> = codes.codes.iter().copied().filter(known).step_by(7).collect();
    known.sort_by(f32::total_cmp);
    known
}

/// Where in the order of the codes a percentile is.
fn percentile(ordered: &[f32], share: usize) -> f64 {
    ordered.get(ordered.len() * share / 100).copied().map_or(1.0, f64::from)
}

/// Says whether codes fill the range of their numbers, as a picture of depth does whose nearest was made black
/// and whose farthest white, or the other way round. Depth in metres or parts of them does so by chance only.
fn is_stretched(codes: &CodeImage) -> bool {
    let most = codes.codes.iter().copied().filter(|code| code.is_finite()).fold(0.0, f32::max);
    let at_most = || codes.codes.iter().filter(|code| **code == most).count();
    match (codes.integer, most) {
        (true, most) if most <= 255.0 => true,
        // Many of them are a word for "unknown".
        (true, most) => most == 65535.0 && at_most() * 200 < codes.codes.len(),
        (false, most) => most == 1.0 && codes.codes.contains(&0.0),
    }
}

/// Guesses at distances that were stretched over the range of their numbers.
fn stretched(codes: &CodeImage, radial: Rule, height: f64) -> Guess {
    let known = ordered(codes);
    let span = percentile(&known, 98) - percentile(&known, 2);
    let parts = (0..=20).map(|k| 0.05 * f64::from(k)).chain([1.25, 1.5, 2.0]);
    let tried = |part: f64| Tried::of(codes, Rule { offset: part * span, ..radial.clone() });
    let tried: Vec<Tried> = parts.map(tried).collect();
    let best = best(&tried);
    let best = if best.rule.offset == 0.0 { best.rule.clone() } else { refined(codes, best, 0.05 * span) };
    let (rule, because) = scaled(codes, &best, height);
    Guess { rule, because: format!("the depth is relative, bright is far: scaled so that {because}") }
}

fn disparity(codes: &CodeImage, radial: Rule, height: f64) -> Guess {
    let known = ordered(codes);
    let (low, span) = (percentile(&known, 2), percentile(&known, 98) - percentile(&known, 2));
    // Estimators leave the offset open.
    let offsets = [0.0, 0.03, 0.08, 0.2, 0.5].map(|part| part * span).into_iter();
    let offsets = offsets.chain([-0.95, -0.9, -0.8, -0.7, -0.55, -0.4, -0.25, -0.1].map(|part| part * low));
    let rule = |encoding, scale, offset| Rule { encoding, scale, offset, ..radial.clone() };
    let disparities: Vec<Tried> =
        offsets.map(|offset| Tried::of(codes, rule(DepthEncoding::Disparity, span.max(1e-6), offset))).collect();
    let best_disparity = best(&disparities);
    // Distances that were turned round, near white and far black, are no disparities, but that is rare.
    let most = known.last().copied().map_or(1.0, f64::from);
    let distances: Vec<Tried> = [0.05, 0.1, 0.15, 0.2, 0.25, 0.3, 0.35, 0.4, 0.45, 0.5, 0.6, 0.7, 0.85, 1.0]
        .map(|part| Tried::of(codes, rule(DepthEncoding::Radial, -1.0, -(most + part * span))))
        .into();
    let turned = distances.iter().filter(|tried| tried.floor >= 0.85 * best_disparity.floor);
    let turned = turned.min_by(|a, b| a.bent.total_cmp(&b.bent)).filter(|tried| tried.bent < 0.6 * best_disparity.bent);
    let what = match turned {
        Some(_) => "bright is near, and walls are flat if it is a distance that was turned round",
        None => "bright is near, so it is a disparity",
    };
    let best = turned.map_or(best_disparity.rule.clone(), |turned| refined(codes, turned, 0.05 * span));
    let (rule, because) = scaled(codes, &best, height);
    Guess { rule, because: format!("{what}: scaled so that {because}") }
}

fn factor_of_ten(value: f64) -> f64 {
    10_f64.powi(value.log10().round() as i32)
}

/// Three significant digits.
fn rounded(value: f64) -> f64 {
    format!("{value:.2e}").parse().unwrap_or(value)
}
