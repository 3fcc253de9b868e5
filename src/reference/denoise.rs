//! An edge-avoiding filter for captured panoramas: à-trous wavelets (Dammertz et al. 2010) over irradiance.
//! Geometry and the variance of the samples guide it, as in SVGF (Schied et al. 2017).
//!
//! Noise is in the light, not in the textures. Reflected radiance is therefore divided by the albedo,
//! filtered, and multiplied again. Emission seen directly, and in a texel on a silhouette the other surface's
//! light, are left as they are, except that outliers are cut. The result is slightly biased where light
//! changes faster than its variance shows.

use super::path_trace::Sums;
use crate::scene::viewpoint::{Projection, Viewpoint};
use glam::{Quat, Vec3};
use rayon::prelude::*;

/// Levels of the filter. The last one spans 129×129 texels.
const LEVELS: u32 = 6;
/// Levels for what mirrors show. No geometry guides there, and wider levels would blur it away.
const MIRROR_LEVELS: u32 = 2;
/// Luminance differences of this many standard errors are taken for light, not for noise.
const SIGMA: f32 = 3.0;
/// The same on the first level, which has to swallow single outliers.
const FIRST_SIGMA: f32 = 12.0;
/// Changes when the filter does. It is part of what names a cached panorama.
pub const VERSION: u32 = 4;

#[derive(Clone, Copy, Default)]
struct Texel {
    /// Radiance over albedo.
    light: Vec3,
    variance: f32,
}

#[derive(Clone, Copy, Default)]
struct Guide {
    position: Vec3,
    normal: Vec3,
    distance: f32,
    /// Share of the samples that met the surface at the centre. At 0 there is nothing to filter.
    purity: f32,
    /// The surface has no diffuse albedo, but reflects. What it shows is filtered as it is, and with nothing
    /// else.
    mirror: bool,
}

/// Returns the filtered radiance of an equirectangular picture, with alpha 1.
pub fn denoise(sums: &Sums) -> Vec<[f32; 4]> {
    denoise_view(sums, &Viewpoint::equirect(Vec3::ZERO, Quat::IDENTITY))
}

/// Returns the filtered radiance of a picture from `viewpoint`, with alpha 1.
pub fn denoise_view(sums: &Sums, viewpoint: &Viewpoint) -> Vec<[f32; 4]> {
    let (width, panorama) = (sums.size[0], viewpoint.projection == Projection::Equirect);
    let n = sums.samples.max(1) as f32;
    let mut texels = vec![Texel::default(); sums.reflected.len()];
    let mut guides = vec![Guide::default(); texels.len()];
    for (i, (texel, guide)) in texels.iter_mut().zip(&mut guides).enumerate() {
        let ([r, g, b, count], albedo, centre) = (sums.reflected[i], sums.albedo[i], sums.centre[i]);
        let mirror = is_mirror(sums, i);
        let albedo_sum = if mirror { Vec3::splat(count) } else { Vec3::from_slice(&albedo) };
        if count == 0.0 || albedo_sum.min_element() <= 1e-4 * count {
            continue;
        }
        let mean = luminance(Vec3::new(r, g, b) / count);
        let variance = (sums.other[i][3] / count - mean * mean).max(0.0) / (count - 1.0).max(1.0);
        *texel = Texel {
            light: Vec3::new(r, g, b) / albedo_sum,
            variance: variance / luminance(albedo_sum / count).powi(2),
        };
        let direction = viewpoint.direction([i as u32 % width, i as u32 / width], sums.size);
        *guide = Guide {
            position: direction * centre[3],
            normal: Vec3::from_slice(&centre),
            distance: centre[3],
            purity: count / n,
            mirror,
        };
    }
    let raw = texels.clone();
    for level in 0..LEVELS {
        texels = filter(&texels, &guides, sums.size, panorama, level, true);
    }
    // Outliers are bright and find few neighbours like them, so their light would be lost. What the filter
    // took is spread over the surface instead.
    let taken = |(raw, kept): (&Texel, &Texel)| Texel { light: raw.light - kept.light, ..Default::default() };
    let mut residual: Vec<Texel> = raw.iter().zip(&texels).map(taken).collect();
    for level in 0..LEVELS {
        residual = filter(&residual, &guides, sums.size, panorama, level, false);
    }
    for (texel, residual) in texels.iter_mut().zip(&residual) {
        texel.light = (texel.light + residual.light).max(Vec3::ZERO);
    }
    let finish = |i: usize| {
        let filtered = if guides[i].purity > 0.0 {
            let count = sums.reflected[i][3];
            texels[i].light * if guides[i].mirror { Vec3::splat(count) } else { Vec3::from_slice(&sums.albedo[i]) }
        } else {
            Vec3::from_slice(&sums.reflected[i])
        };
        (filtered + Vec3::from_slice(&sums.other[i])) / n
    };
    let radiance: Vec<Vec3> = (0..texels.len()).map(finish).collect();
    let pure = |i: usize| sums.reflected[i][3] > 0.9 * n;
    let bounded = |i: usize| {
        let [r, g, b] =
            if pure(i) { radiance[i] } else { at_most_neighbours(i, &radiance, pure, sums.size, panorama) }.to_array();
        [r, g, b, 1.0]
    };
    (0..texels.len()).map(bounded).collect()
}

fn is_mirror(sums: &Sums, index: usize) -> bool {
    let ([r, g, b, count], [dr, dg, db, _]) = (sums.reflected[index], sums.albedo[index]);
    r.max(g).max(b) > 0.0 && dr.max(dg).max(db) <= 1e-4 * count
}

/// Cuts the light on a silhouette, where two surfaces share a texel and the light of one is not filtered. It
/// becomes no brighter than in the texels around that show one surface each.
fn at_most_neighbours(
    index: usize,
    values: &[Vec3],
    pure: impl Fn(usize) -> bool,
    size: [u32; 2],
    panorama: bool,
) -> Vec3 {
    let [width, height] = size.map(i64::from);
    let (x, y) = (index as i64 % width, index as i64 / width);
    let mut most = Vec3::ZERO;
    for row in (y - 2).max(0)..=(y + 2).min(height - 1) {
        for column in (x - 2..=x + 2).filter(|x| panorama || (0..width).contains(x)) {
            let other = (row * width + column.rem_euclid(width)) as usize;
            if pure(other) {
                most = most.max(values[other]);
            }
        }
    }
    if most == Vec3::ZERO { values[index] } else { values[index].min(most) }
}

fn luminance(color: Vec3) -> f32 {
    color.dot(Vec3::new(0.2126, 0.7152, 0.0722))
}

/// Runs one level. With `panorama` columns wrap and crowd at the poles. With `by_light` the filter stops at
/// steps in the light, not only at those of the geometry.
fn filter(
    texels: &[Texel],
    guides: &[Guide],
    size: [u32; 2],
    panorama: bool,
    level: u32,
    by_light: bool,
) -> Vec<Texel> {
    let step = 1_i64 << level;
    const KERNEL: [f32; 3] = [0.375, 0.25, 0.0625];
    let [width, height] = size.map(i64::from);
    let at = |x: i64, y: i64| (y * width + x.rem_euclid(width)) as usize;
    let outside = |x: i64, y: i64| !(0..height).contains(&y) || !(panorama || (0..width).contains(&x));
    let one = |index: usize| -> Texel {
        let (x, y) = (index as i64 % width, index as i64 / width);
        let (p, g) = (texels[index], guides[index]);
        if g.purity == 0.0 || (g.mirror && level >= MIRROR_LEVELS) {
            return p;
        }
        // Columns crowd towards the poles. Step over as many as span the same angle, once those between are
        // mixed in.
        let sine = if panorama { (std::f32::consts::PI * (y as f32 + 0.5) / height as f32).sin() } else { 1.0 };
        let stride = ((step as f32 / sine).round() as i64).min(3_i64.pow(level)).min(width / 5).max(1);
        let (mut variance, mut total) = (0.0, 0.0);
        // A few samples say little about their own variance, so the first level asks the neighbourhood.
        let reach = if level == 0 { 3 } else { 1 };
        for dy in -reach..=reach {
            for dx in -reach..=reach {
                let row = y + dy;
                if outside(x + dx, row) {
                    continue;
                }
                let h = guides[at(x + dx, row)];
                let weight = h.purity * g.normal.dot(h.normal).max(0.0).powi(8) / (1 + dx * dx + dy * dy) as f32;
                variance += weight * texels[at(x + dx, row)].variance;
                total += weight;
            }
        }
        let sigma = if level == 0 { FIRST_SIGMA } else { SIGMA } * (variance / total).sqrt() + 1e-4;
        let own = luminance(p.light);
        let (mut light, mut variance, mut total) = (Vec3::ZERO, 0.0, 0.0);
        for dy in -2..=2_i64 {
            let row = y + dy * step;
            for dx in -2..=2_i64 {
                if outside(x + dx * stride, row) {
                    continue;
                }
                let other = at(x + dx * stride, row);
                let (q, h) = (texels[other], guides[other]);
                if h.purity == 0.0 || h.mirror != g.mirror {
                    continue;
                }
                let apart = h.position - g.position;
                let plane = g.normal.dot(apart).abs() / (0.01 * g.distance + 0.02 * apart.length());
                let bend = g.normal.dot(h.normal).max(0.0).powi(48);
                let step_in_light = if by_light { (luminance(q.light) - own).abs() / sigma } else { 0.0 };
                let kernel = KERNEL[dx.unsigned_abs() as usize] * KERNEL[dy.unsigned_abs() as usize];
                let weight = kernel * h.purity * bend * (-plane * plane - step_in_light).exp();
                light += weight * q.light;
                variance += weight * weight * q.variance;
                total += weight;
            }
        }
        if total <= 0.0 { p } else { Texel { light: light / total, variance: variance / (total * total) } }
    };
    (0..texels.len()).into_par_iter().map(one).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{panorama::mapping::texel_direction, scene::rooms::kit::hash};

    const SIZE: [u32; 2] = [128, 64];
    const SAMPLES: u32 = 16;

    /// Makes the inside of a unit sphere under light of 1 (on its right half 3), with a chequered albedo.
    /// Every sample is 0 or twice the light.
    fn sums() -> (Sums, Vec<f32>) {
        let mut sums = Sums { size: SIZE, samples: SAMPLES, ..Default::default() };
        let mut truth = Vec::new();
        for i in 0..SIZE[0] * SIZE[1] {
            let [x, y] = [i % SIZE[0], i / SIZE[0]];
            let light = if x < SIZE[0] / 2 { 1.0 } else { 3.0 };
            let albedo = if (x / 3 + y / 3) % 2 == 0 { 0.8 } else { 0.1 };
            let n = SAMPLES as f32;
            let hits = (0..SAMPLES).filter(|k| hash(i as i32, *k as i32, 5) < 0.5).count() as f32;
            let sample = 2.0 * light * albedo;
            let normal = -texel_direction(x, y, SIZE).as_vec3();
            sums.reflected.push([sample * hits, sample * hits, sample * hits, n]);
            sums.other.push([0.0, 0.0, 0.0, sample * sample * hits]);
            sums.albedo.push([albedo * n, albedo * n, albedo * n, sample * sample * hits]);
            sums.centre.push([normal.x, normal.y, normal.z, 1.0]);
            truth.push(light * albedo);
        }
        (sums, truth)
    }

    #[test]
    fn noise_goes_and_texture_and_light_stay() {
        let (sums, truth) = sums();
        let error = |picture: &[[f32; 4]]| {
            let square = |(c, t): (&[f32; 4], &f32)| f64::from((c[1] / t - 1.0).powi(2));
            (picture.iter().zip(&truth).map(square).sum::<f64>() / truth.len() as f64).sqrt()
        };
        let (raw, filtered) = (sums.radiance(), denoise(&sums));
        // Measured: 0.250 to 0.078, most of it at the step in the light.
        assert!(error(&raw) > 0.2 && error(&filtered) < 0.1, "{} to {}", error(&raw), error(&filtered));
        let mean = |picture: &[[f32; 4]]| picture.iter().map(|c| f64::from(c[1])).sum::<f64>();
        assert!((mean(&filtered) / mean(&raw) - 1.0).abs() < 0.01);
    }

    #[test]
    fn what_a_mirror_shows_is_filtered_but_kept_apart() {
        let (mut sums, truth) = sums();
        // The lower half is a mirror that shows light of 1, in samples of 0 or 2.
        let n = SAMPLES as f32;
        let lower = (SIZE[0] * SIZE[1] / 2) as usize..truth.len();
        for i in lower.clone() {
            let hits = (0..SAMPLES).filter(|k| hash(i as i32, *k as i32, 6) < 0.5).count() as f32;
            sums.reflected[i] = [2.0 * hits, 2.0 * hits, 2.0 * hits, n];
            sums.albedo[i] = [0.0, 0.0, 0.0, 4.0 * hits];
            sums.other[i][3] = 4.0 * hits;
        }
        let filtered = denoise(&sums);
        let error = |range: std::ops::Range<usize>, truth: &dyn Fn(usize) -> f32| {
            let length = range.len() as f64;
            (range.map(|i| f64::from(filtered[i][1] / truth(i) - 1.0).powi(2)).sum::<f64>() / length).sqrt()
        };
        let (mirror, wall) = (error(lower.clone(), &|_| 1.0), error(0..lower.start, &|i| truth[i]));
        // Measured: 0.250 to 0.060, and 0.077.
        assert!(mirror < 0.07 && wall < 0.1, "mirror {mirror}, wall {wall}");
    }

    #[test]
    fn what_has_no_noise_is_not_changed() {
        let (mut sums, truth) = sums();
        for (i, truth) in truth.iter().enumerate() {
            let n = SAMPLES as f32;
            sums.reflected[i] = [truth * n, truth * n, truth * n, n];
            sums.other[i] = [0.25 * n, 0.0, 0.0, truth * truth * n];
        }
        for (c, t) in denoise(&sums).iter().zip(&truth) {
            assert!((c[1] / t - 1.0).abs() < 1e-3 && (c[0] - c[1] - 0.25).abs() < 1e-3, "{c:?} {t}");
        }
    }
}
