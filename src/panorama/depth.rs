//! Turns stored depth codes into radial metres.

use super::{
    cloud::Cloud,
    guess,
    mapping::texel_direction,
    room::{Reading, reading},
};
use glam::{DVec3, Vec3};
use rayon::prelude::*;

/// What stored codes mean in metres.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum DepthEncoding {
    /// Radial distance: scale·(v + offset).
    Radial,
    /// Radial distance: scale/(v + offset).
    Disparity,
    /// Distance along the axis of the cube face that the direction meets: scale·(v + offset).
    Planar,
}

impl DepthEncoding {
    /// All of them.
    pub const ALL: [Self; 3] = [Self::Radial, Self::Disparity, Self::Planar];

    /// Returns the word of a scene file.
    pub fn word(self) -> &'static str {
        match self {
            Self::Radial => "radial",
            Self::Disparity => "disparity",
            Self::Planar => "planar",
        }
    }
}

/// The spacing of integer codes. It limits how well a surface is known.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub enum Quantisation {
    /// Floating-point or analytic depth.
    #[default]
    None,
    /// Codes are equally spaced in 1/metres.
    Disparity { step: f32 },
    /// Codes are equally spaced in metres.
    Radial { step: f32 },
}

impl Quantisation {
    /// Returns the steps of 1/metres and of metres; of one of them there are none.
    pub fn steps(self) -> [f32; 2] {
        match self {
            Self::None => [0.0, 0.0],
            Self::Disparity { step } => [step, 0.0],
            Self::Radial { step } => [0.0, step],
        }
    }
}

/// How well depth knows a surface.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Quality {
    pub quantisation: Quantisation,
    /// By how much depth differs from texel to texel without a cause: the standard deviation as a share of the distance. 0
    /// if it is too little to matter.
    pub noise: f32,
}

/// Noise that is not told from the surfaces' own shape.
const LEAST_NOISE: f64 = 0.003;

/// Of fewer places a median says nothing.
const LEAST_PLACES: usize = 200;

impl Quality {
    /// Measures the noise of depth by the third differences of 1/depth along meridians, of which surfaces have next to
    /// none. The median leaves edges out.
    pub fn of(depth: &[f32], [width, height]: [u32; 2], quantisation: Quantisation) -> Self {
        let (columns, rows) = (width as usize, height as usize);
        let [disparity, radial] = quantisation.steps().map(f64::from);
        // Some thousand places on every third row, not near the poles.
        let every = (depth.len() / 3 / 20_000).max(1);
        let places = (rows / 8..rows - rows / 8).step_by(3).flat_map(|row| (0..columns).map(move |c| (row, c)));
        let mut off: Vec<f64> = places
            .step_by(every)
            .filter(|(row, _)| row + 3 < rows)
            .filter_map(|(row, column)| {
                let at = |row: usize| {
                    Some(f64::from(depth[row * columns + column])).filter(|depth| *depth > 0.0).map(f64::recip)
                };
                let [a, b, c, d] = [at(row)?, at(row + 1)?, at(row + 2)?, at(row + 3)?];
                let step = disparity.max(radial * b * b);
                // The squares of 1, 3, 3 and 1 add to 20.
                Some((((a - 3.0 * b + 3.0 * c - d).abs() / 20f64.sqrt() - step) / b).max(0.0))
            })
            .collect();
        let middle = off.len() / 2;
        if off.len() < LEAST_PLACES {
            return Self { quantisation, noise: 0.0 };
        }
        // 1.4826 median deviations are a standard deviation.
        let noise = *off.select_nth_unstable_by(middle, f64::total_cmp).1 * 1.4826;
        Self { quantisation, noise: if noise < LEAST_NOISE { 0.0 } else { noise as f32 } }
    }
}

/// The rule that turns codes into metres.
#[derive(Clone, Debug, PartialEq)]
pub struct Rule {
    pub encoding: DepthEncoding,
    pub scale: f64,
    pub offset: f64,
    /// Codes that are holes.
    pub invalid: Vec<f64>,
}

impl Default for Rule {
    /// Distance in metres; 0 is a hole.
    fn default() -> Self {
        Self { encoding: DepthEncoding::Radial, scale: 1.0, offset: 0.0, invalid: vec![0.0] }
    }
}

impl Rule {
    /// Returns the radial metres of each code of an image of `size`. 0 is a hole.
    pub fn metres(&self, mut codes: Vec<f32>, size: [u32; 2]) -> Vec<f32> {
        let metres = |index: usize, code: f32| {
            let code = f64::from(code);
            if self.invalid.contains(&code) {
                return 0.0;
            }
            let stored = code + self.offset;
            let metres = match self.encoding {
                DepthEncoding::Radial => self.scale * stored,
                DepthEncoding::Disparity => self.scale / stored,
                DepthEncoding::Planar => {
                    let (column, row) = (index as u32 % size[0], index as u32 / size[0]);
                    self.scale * stored / texel_direction(column, row, size).abs().max_element()
                }
            };
            let metres = metres as f32;
            if metres.is_finite() && metres > 0.0 { metres } else { 0.0 }
        };
        // Whole codes repeat. What they mean does not depend on the place, but for planar depth.
        let many = codes.len() > 1 << 18 && self.encoding != DepthEncoding::Planar;
        let known: Vec<f32> = (0..if many { 1 << 16 } else { 0 }).map(|code| metres(0, code as f32)).collect();
        codes.par_iter_mut().enumerate().for_each(|(index, code)| {
            let same = known.get(*code as usize).filter(|_| f32::from(*code as u16) == *code);
            *code = same.copied().unwrap_or_else(|| metres(index, *code));
        });
        codes
    }

    /// Returns the code spacing of integer images.
    pub fn quantisation(&self) -> Quantisation {
        match self.encoding {
            DepthEncoding::Disparity => Quantisation::Disparity { step: (1.0 / self.scale).abs() as f32 },
            DepthEncoding::Radial | DepthEncoding::Planar => Quantisation::Radial { step: self.scale.abs() as f32 },
        }
    }
}

/// Returns the factor that makes depth metres, and the unit it is in, if it seems to be in another.
/// `nearest` is the distance of the nearest surfaces, and `floor` that of the floor under the camera.
pub fn unit(nearest: f32, floor: Option<f32>) -> Option<(f64, &'static str)> {
    // A camera stands less than 25 m over its floor, and something is nearer than 40 m.
    let (metres, limit) = floor.map_or((nearest, 40.0), |floor| (floor, 25.0));
    match metres {
        d if d > 8.0 * limit => Some((0.001, "millimetres")),
        d if d > limit => Some((0.01, "centimetres")),
        _ => None,
    }
}

/// Warns of depth whose nearest surfaces are so far that it cannot be in metres, and of near and far that are swapped.
pub fn unit_warning(depth: &[f32], size: [u32; 2], rule: &Rule) -> Option<String> {
    // Some hundred thousand texels tell a percentile.
    let known = depth.iter().step_by(depth.len() / 100_000 + 1).copied().filter(|depth| *depth > 0.0);
    let mut known: Vec<f32> = known.collect();
    known.sort_by(f32::total_cmp);
    let (nearest, farthest) = (*known.get(known.len() / 100)?, *known.last()?);
    let other_unit = unit(nearest, None).filter(|_| rule.encoding != DepthEncoding::Disparity);
    // The shape of the room is looked at only where something is odd: that takes a while.
    if other_unit.is_some() || is_deep_below(depth, size) {
        let swapped = swap_warning(&Cloud::of_depth(depth, size, 0.0), rule);
        if swapped.is_some() {
            return swapped;
        }
    }
    let (factor, unit) = other_unit?;
    Some(unit_words(nearest, farthest, unit, rule.scale * factor))
}

/// Says whether what is straight down lies much farther than what lies ahead. So it does in a corridor, too.
fn is_deep_below(depth: &[f32], [width, height]: [u32; 2]) -> bool {
    let median = |from: f64, to: f64| {
        let row = |share: f64| (share * f64::from(height)) as usize * width as usize;
        let rows = &depth[row(from)..row(to)];
        let mut known: Vec<f32> = rows.iter().step_by(rows.len() / 20_000 + 1).copied().filter(|d| *d > 0.0).collect();
        known.sort_by(f32::total_cmp);
        (known.len() > 20).then(|| known[known.len() / 2])
    };
    // Directions within 37° of straight down, and within 11.5° of the horizon.
    matches!((median(0.795, 1.0), median(0.436, 0.564)), (Some(down), Some(ahead)) if down > 1.3 * ahead)
}

/// Warns of depth whose near and far are swapped, with the lines to write.
pub fn swap_warning(cloud: &Cloud, rule: &Rule) -> Option<String> {
    let reading = reading(cloud);
    if reading == Reading::Sound {
        return None;
    }
    let meant = guess::reread(cloud, rule, 1.6);
    let what = match (reading, meant.encoding) {
        (_, DepthEncoding::Radial) if meant.scale < 0.0 => "it seems to be a distance that was turned round",
        (_, DepthEncoding::Disparity) => "it seems to be a disparity",
        _ => "it seems to be a distance",
    };
    let offset = if meant.offset == 0.0 { String::new() } else { format!(" and offset = {}", meant.offset) };
    let scale =
        if offset.is_empty() { format!(" and scale = {}", meant.scale) } else { format!(", scale = {}", meant.scale) };
    let now = meant.encoding.word();
    Some(format!(
        "near and far seem to be swapped, as floor and walls are bent: {what}; write encoding = \"{now}\"{scale}{offset} \
         if the camera stands 1.6 m over the floor"
    ))
}

/// Says that depth is in another unit.
pub fn unit_words(nearest: f32, farthest: f32, unit: &str, scale: f64) -> String {
    let (near, far) = (length_words(nearest), length_words(farthest));
    format!("its depth is from {near} to {far}: it seems to be in {unit}; write scale = {scale}")
}

/// Returns a length in metres as people write it.
pub fn length_words(metres: f32) -> String {
    match metres {
        m if m >= 1000.0 => format!("{:.1} km", m / 1000.0),
        m if m >= 100.0 => format!("{m:.0} m"),
        m if m >= 10.0 => format!("{m:.1} m"),
        m if m >= 0.1 => format!("{m:.2} m"),
        m => format!("{:.1} mm", m * 1000.0),
    }
}

/// Returns the radial depth of a box seen from inside. Its extents are `extent`, and `center` is relative to
/// the panorama's point. The box is aligned with the world, and the panorama is turned by `yaw_degrees`.
pub fn box_depth(size: [u32; 2], extent: Vec3, center: Vec3, yaw_degrees: f64) -> Vec<f32> {
    let (low, high) = ((center - 0.5 * extent).as_dvec3(), (center + 0.5 * extent).as_dvec3());
    let exit = |direction: DVec3| {
        let wall = DVec3::select(direction.cmplt(DVec3::ZERO), low, high);
        let distance = DVec3::select(direction.cmpeq(DVec3::ZERO), DVec3::INFINITY, wall / direction);
        distance.min_element() as f32
    };
    (0..size[1])
        .flat_map(|row| (0..size[0]).map(move |column| texel_direction(column, row, size)))
        .map(|direction| exit(super::mapping::panorama_to_world(direction, yaw_degrees)))
        .collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn rule(encoding: DepthEncoding, scale: f64, offset: f64) -> Rule {
        Rule { encoding, scale, offset, invalid: vec![0.0] }
    }

    #[test]
    fn codes_become_metres_and_bad_ones_holes() {
        let codes = [0.0, 1.0, 4.0, -3.0, f32::NAN, f32::INFINITY];
        assert_eq!(
            rule(DepthEncoding::Radial, 0.5, 1.0).metres(codes.to_vec(), [6, 1]),
            [0.0, 1.0, 2.5, 0.0, 0.0, 0.0]
        );
        assert_eq!(
            rule(DepthEncoding::Disparity, 6.0, -1.0).metres(codes.to_vec(), [6, 1]),
            [0.0, 0.0, 2.0, 0.0, 0.0, 0.0]
        );
    }

    #[test]
    fn many_codes_mean_what_few_mean() {
        let codes: Vec<f32> =
            (0..600_000).map(|i| (i % 70_000) as f32 * if i % 3 == 0 { -0.25 } else { 1.0 }).collect();
        for encoding in [DepthEncoding::Radial, DepthEncoding::Disparity] {
            let rule = rule(encoding, 3.0, -7.5);
            let few: Vec<f32> = codes.chunks(600).flat_map(|codes| rule.metres(codes.to_vec(), [600, 1])).collect();
            assert_eq!(rule.metres(codes.clone(), [600, 1000]), few);
        }
    }

    #[test]
    fn noise_is_measured_and_surfaces_and_steps_are_none() {
        let size = [256, 128];
        let room = box_depth(size, Vec3::new(8.0, 2.6, 5.0), Vec3::new(0.5, 0.2, 0.3), 0.0);
        let of = |depth: &[f32], quantisation| Quality::of(depth, size, quantisation).noise;
        assert_eq!(of(&room, Quantisation::None), 0.0);
        assert_eq!(of(&vec![2.0; room.len()], Quantisation::None), 0.0);
        let steps: Vec<f32> = room.iter().map(|metres| 0.02 * (metres / 0.02).round()).collect();
        assert_eq!(of(&steps, Quantisation::Radial { step: 0.02 }), 0.0);
        let disparity: Vec<f32> = room.iter().map(|metres| 50.0 / (50.0 / metres).round()).collect();
        assert_eq!(of(&disparity, Quantisation::Disparity { step: 0.02 }), 0.0);
        let mut random = fastrand::Rng::with_seed(1);
        for noise in [0.005f32, 0.02, 0.1] {
            // Three uniform numbers together have a variance of a quarter.
            let mut off = || (0..3).map(|_| random.f32() - 0.5).sum::<f32>() / 0.5;
            let noisy: Vec<f32> = room.iter().map(|metres| metres * (1.0 + noise * off())).collect();
            let found = of(&noisy, Quantisation::None);
            assert!((found / noise - 1.0).abs() < 0.15, "{noise}: {found}");
            let holes: Vec<f32> = noisy.iter().map(|metres| if random.f32() < 0.1 { 0.0 } else { *metres }).collect();
            let found = of(&holes, Quantisation::Radial { step: 0.001 });
            assert!((found / noise - 1.0).abs() < 0.15, "{noise}, with holes: {found}");
        }
        assert_eq!(of(&vec![0.0; room.len()], Quantisation::None), 0.0);
    }

    /// Depth of a room that the camera sees from 1.6 m over its floor.
    fn room(extent: Vec3, off: Vec3) -> Vec<f32> {
        box_depth([128, 64], extent, off.with_y(0.5 * extent.y - 1.6), 0.0)
    }

    #[test]
    fn swapped_depth_is_told_before_its_unit() {
        let (size, radial) = ([128, 64], rule(DepthEncoding::Radial, 1.0, 0.0));
        let room = room(Vec3::new(8.0, 2.6, 8.0), Vec3::ZERO);
        let codes: Vec<f32> = room.iter().map(|metres| 40_000.0 / metres).collect();
        let warning = unit_warning(&codes, size, &radial).expect("a warning");
        assert!(warning.contains("swapped") && warning.contains("\"disparity\""), "{warning}");
        let scale: f64 = warning
            .split("scale = ")
            .nth(1)
            .and_then(|rest| rest.split([' ', ',']).next())
            .expect("a scale")
            .parse()
            .expect("a number");
        assert!((scale / 40_000.0 - 1.0).abs() < 0.05, "{warning}");
        let millimetres: Vec<f32> = room.iter().map(|metres| 1000.0 * metres).collect();
        assert!(unit_warning(&millimetres, size, &radial).is_some_and(|warning| warning.contains("scale = 0.001")));
        assert_eq!(unit_warning(&room, size, &radial), None);
    }

    #[test]
    fn corridors_and_near_walls_are_not_swapped() {
        let (size, radial) = ([128, 64], rule(DepthEncoding::Radial, 1.0, 0.0));
        for (extent, off) in [
            (Vec3::new(1.8, 2.6, 12.0), Vec3::ZERO),
            (Vec3::new(1.2, 2.6, 20.0), Vec3::new(0.2, 0.0, 3.0)),
            (Vec3::new(5.0, 2.6, 5.0), Vec3::new(2.1, 0.0, 0.0)),
        ] {
            let room = room(extent, off);
            assert_eq!(unit_warning(&room, size, &radial), None, "{extent}");
            let of = |code: &dyn Fn(f32) -> f32| room.iter().map(|metres| code(*metres)).collect::<Vec<_>>();
            let millimetres = unit_warning(&of(&|metres| 1000.0 * metres), size, &radial).expect("a warning");
            assert!(millimetres.contains("scale = 0.001") && !millimetres.contains("swapped"), "{millimetres}");
            // 8-bit disparity is not in centimetres.
            let nearest = room.iter().copied().fold(f32::MAX, f32::min);
            let disparity = of(&|metres| (255.0 * nearest / metres).round().max(1.0));
            if let Some(warning) = unit_warning(&disparity, size, &radial) {
                assert!(warning.contains("\"disparity\""), "{extent}: {warning}");
            }
            assert!(swap_warning(&Cloud::of_depth(&disparity, size, 0.0), &radial).is_some(), "{extent}");
        }
    }

    #[test]
    fn distances_that_were_turned_round_get_a_negative_scale() {
        let (size, radial) = ([128, 64], rule(DepthEncoding::Radial, 1.0, 0.0));
        let room = room(Vec3::new(4.0, 2.6, 4.4), Vec3::ZERO);
        let farthest = room.iter().copied().fold(0.0, f32::max);
        let turned: Vec<f32> = room.iter().map(|metres| 1.4 * farthest - metres).collect();
        let warning = swap_warning(&Cloud::of_depth(&turned, size, 0.0), &radial).expect("a warning");
        assert!(warning.contains("encoding = \"radial\", scale = -") && warning.contains("offset = -"), "{warning}");
    }

    #[test]
    fn planar_depth_of_a_cube_is_constant() {
        let size = [32, 16];
        let cube = box_depth(size, Vec3::splat(4.0), Vec3::ZERO, 0.0);
        let planar = rule(DepthEncoding::Planar, 2.0, 0.0).metres(vec![1.0; 512], size);
        assert!(cube.iter().zip(&planar).all(|(a, b)| (a - b).abs() < 1e-5));
    }

    #[test]
    fn box_depth_follows_the_yaw_and_the_centre() {
        let size = [256, 128];
        let (extent, center) = (Vec3::new(2.0, 20.0, 6.0), Vec3::new(0.5, 0.0, 0.0));
        for (yaw, expected) in [(0.0, 3.0), (90.0, 0.5), (180.0, 3.0), (270.0, 1.5)] {
            let depth = box_depth(size, extent, center, yaw);
            let (row, column) = (64, 128); // This texel looks forward.
            let d = super::super::mapping::panorama_to_world(texel_direction(column, row, size), yaw);
            let hit = d.as_vec3() * depth[(row * 256 + column) as usize] - center;
            assert!((hit.abs() / (0.5 * extent)).max_element() - 1.0 < 1e-5);
            let along = d.abs().max_element() as f32 * depth[(row * 256 + column) as usize];
            assert!((along - expected).abs() < 1e-4, "{yaw}: {along}");
        }
    }
}
