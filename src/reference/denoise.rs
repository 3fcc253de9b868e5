//! An edge-avoiding filter for captured panoramas: à-trous wavelets (Dammertz et al. 2010) over irradiance, guided by
//! geometry and by the variance of the samples, as SVGF does (Schied et al. 2017).
//!
//! What a path tracer leaves at a few dozen samples is noise in the light, not in the picture: reflected radiance is
//! divided by the albedo, filtered, and multiplied again, so that textures keep every texel. Emission seen directly,
//! and in a texel on a silhouette what the surface behind sends, are left as they are. The result is slightly biased where
//! light changes faster than its variance shows.

use super::path_trace::Sums;
use crate::panorama::mapping::texel_direction;
use glam::Vec3;
use rayon::prelude::*;

/// Levels of the filter; the last spans 65×65 texels.
const LEVELS: u32 = 5;
/// Luminance differences of so many standard errors are taken for light, not noise.
const SIGMA: f32 = 1.5;
/// Changes when the filter does: part of what names a cached panorama.
pub const VERSION: u32 = 1;

#[derive(Clone, Copy, Default)]
struct Texel {
    /// Radiance over albedo.
    light: Vec3,
    /// Variance of the mean's luminance.
    variance: f32,
}

#[derive(Clone, Copy, Default)]
struct Guide {
    position: Vec3,
    normal: Vec3,
    distance: f32,
    /// Share of the samples that met the surface at the centre; 0: nothing to filter.
    purity: f32,
}

/// Filtered radiance of an equirectangular picture, alpha 1.
pub fn denoise(sums: &Sums) -> Vec<[f32; 4]> {
    let [width, height] = sums.size;
    let n = sums.samples.max(1) as f32;
    let mut texels = vec![Texel::default(); sums.reflected.len()];
    let mut guides = vec![Guide::default(); texels.len()];
    for (i, (texel, guide)) in texels.iter_mut().zip(&mut guides).enumerate() {
        let ([r, g, b, count], albedo, centre) = (sums.reflected[i], sums.albedo[i], sums.centre[i]);
        let albedo_sum = Vec3::from_slice(&albedo);
        if count == 0.0 || albedo_sum.min_element() <= 1e-4 * count {
            continue;
        }
        let mean = luminance(Vec3::new(r, g, b) / count);
        let variance = (sums.other[i][3] / count - mean * mean).max(0.0) / (count - 1.0).max(1.0);
        *texel = Texel {
            light: Vec3::new(r, g, b) / albedo_sum,
            variance: variance / luminance(albedo_sum / count).powi(2),
        };
        let direction = texel_direction(i as u32 % width, i as u32 / width, sums.size).as_vec3();
        *guide = Guide {
            position: direction * centre[3],
            normal: Vec3::from_slice(&centre),
            distance: centre[3],
            purity: count / n,
        };
    }
    for level in 0..LEVELS {
        texels = filter(&texels, &guides, [width, height], 1 << level);
    }
    let finish = |i: usize| {
        let filtered = if guides[i].purity > 0.0 {
            texels[i].light * Vec3::from_slice(&sums.albedo[i])
        } else {
            Vec3::from_slice(&sums.reflected[i])
        };
        let [r, g, b] = ((filtered + Vec3::from_slice(&sums.other[i])) / n).to_array();
        [r, g, b, 1.0]
    };
    (0..texels.len()).map(finish).collect()
}

fn luminance(color: Vec3) -> f32 {
    color.dot(Vec3::new(0.2126, 0.7152, 0.0722))
}

fn filter(texels: &[Texel], guides: &[Guide], size: [u32; 2], step: i64) -> Vec<Texel> {
    const KERNEL: [f32; 3] = [0.375, 0.25, 0.0625];
    let [width, height] = size.map(i64::from);
    let at = |x: i64, y: i64| (y * width + x.rem_euclid(width)) as usize;
    let one = |index: usize| -> Texel {
        let (x, y) = (index as i64 % width, index as i64 / width);
        let (p, g) = (texels[index], guides[index]);
        if g.purity == 0.0 {
            return p;
        }
        // Columns crowd towards the poles: step over as many as span the same angle.
        let sine = (std::f32::consts::PI * (y as f32 + 0.5) / height as f32).sin();
        let stride = ((step as f32 / sine).round() as i64).min(width / 5).max(1);
        let (mut variance, mut total) = (0.0, 0.0);
        for dy in -1..=1_i64 {
            for dx in -1..=1_i64 {
                let row = y + dy;
                if (0..height).contains(&row) && guides[at(x + dx, row)].purity > 0.0 {
                    let weight = [1.0, 0.5][dx.unsigned_abs() as usize] * [1.0, 0.5][dy.unsigned_abs() as usize];
                    variance += weight * texels[at(x + dx, row)].variance;
                    total += weight;
                }
            }
        }
        let sigma = SIGMA * (variance / total).sqrt() + 1e-4;
        let own = luminance(p.light);
        let (mut light, mut variance, mut total) = (Vec3::ZERO, 0.0, 0.0);
        for dy in -2..=2_i64 {
            let row = y + dy * step;
            if !(0..height).contains(&row) {
                continue;
            }
            for dx in -2..=2_i64 {
                let other = at(x + dx * stride, row);
                let (q, h) = (texels[other], guides[other]);
                if h.purity == 0.0 {
                    continue;
                }
                let apart = h.position - g.position;
                let plane = g.normal.dot(apart).abs() / (0.01 * g.distance + 0.02 * apart.length());
                let bend = g.normal.dot(h.normal).max(0.0).powi(48);
                let step_in_light = (luminance(q.light) - own).abs() / sigma;
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
