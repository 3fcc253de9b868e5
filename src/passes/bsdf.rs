//! The tables of the GGX and sheen lobes' directional albedo, which `bsdf.glsl` reads.

use rayon::prelude::*;

/// Width and height of each table. `bsdf.glsl` has the same constant.
pub const ENERGY_SIZE: usize = 32;

/// Directional albedo ρ = F0·x + F90·y of the GGX lobe (height-correlated Smith, Schlick), as (x, y) over cos
/// θ_o (columns) and roughness (rows). Both run from 0 to 1 with the ends included. x + y is the albedo of a
/// perfect reflector. Integrated over visible-normal samples, with the Fresnel term split as in Karis 2013.
pub fn ggx_table() -> Vec<[f32; 2]> {
    const SAMPLES: usize = 32;
    let mut table = Vec::with_capacity(ENERGY_SIZE * ENERGY_SIZE);
    for row in 0..ENERGY_SIZE {
        let roughness = row as f64 / (ENERGY_SIZE - 1) as f64;
        let alpha = roughness * roughness;
        for column in 0..ENERGY_SIZE {
            let cosine = (column as f64 / (ENERGY_SIZE - 1) as f64).max(1e-3);
            let o = glam::DVec3::new((1.0 - cosine * cosine).sqrt(), 0.0, cosine);
            let (mut a, mut b) = (0.0, 0.0);
            for i in 0..SAMPLES * SAMPLES {
                let u = ((i % SAMPLES) as f64 + 0.5) / SAMPLES as f64;
                let v = ((i / SAMPLES) as f64 + 0.5) / SAMPLES as f64;
                let h = visible_normal(o, alpha, u, v);
                let light = 2.0 * o.dot(h) * h - o;
                if light.z <= 0.0 {
                    continue;
                }
                let (lambda_o, lambda_i) = (smith_lambda(o.z, alpha), smith_lambda(light.z, alpha));
                let weight = (1.0 + lambda_o) / (1.0 + lambda_o + lambda_i);
                let fresnel = (1.0 - o.dot(h)).clamp(0.0, 1.0).powi(5);
                a += weight * (1.0 - fresnel);
                b += weight * fresnel;
            }
            let n = (SAMPLES * SAMPLES) as f64;
            table.push([(a / n) as f32, (b / n) as f32]);
        }
    }
    table
}

/// Directional albedo of the sheen lobe of colour 1 (Charlie's distribution, Estevez and Kulla 2017; visibility by
/// Neubelt and Pettineo 2013), in x, over the same axes. Integrated over cosine-weighted directions.
pub fn sheen_table() -> Vec<[f32; 2]> {
    const SAMPLES: usize = 64;
    let entry = |index: usize| {
        let (row, column) = (index / ENERGY_SIZE, index % ENERGY_SIZE);
        let roughness = (row as f64 / (ENERGY_SIZE - 1) as f64).max(LEAST_SHEEN);
        let inverse = 1.0 / (roughness * roughness);
        let cosine = (column as f64 / (ENERGY_SIZE - 1) as f64).max(1e-3);
        let o = glam::DVec3::new((1.0 - cosine * cosine).sqrt(), 0.0, cosine);
        let mut sum = 0.0;
        for i in 0..SAMPLES * SAMPLES {
            let (u, v) = (((i % SAMPLES) as f64 + 0.5) / SAMPLES as f64, ((i / SAMPLES) as f64 + 0.5) / SAMPLES as f64);
            let (sin, cos) = (std::f64::consts::TAU * u).sin_cos();
            let light = glam::DVec3::new(v.sqrt() * cos, v.sqrt() * sin, (1.0 - v).sqrt());
            let h = (o + light).normalize();
            let sine = (1.0 - h.z * h.z).max(1e-12).sqrt();
            let distribution = (2.0 + inverse) * sine.powf(inverse) / std::f64::consts::TAU;
            // f·cos over the density cos/π
            sum += std::f64::consts::PI * distribution / (4.0 * (o.z + light.z - o.z * light.z).max(1e-4));
        }
        [(sum / (SAMPLES * SAMPLES) as f64) as f32, 0.0]
    };
    (0..ENERGY_SIZE * ENERGY_SIZE).into_par_iter().map(entry).collect()
}

/// The least roughness of sheen. `bsdf.glsl` has the same constant.
const LEAST_SHEEN: f64 = 0.2;

fn smith_lambda(cosine: f64, alpha: f64) -> f64 {
    let c2 = cosine * cosine;
    0.5 * ((1.0 + alpha * alpha * (1.0 - c2) / c2).sqrt() - 1.0)
}

/// Draws a half vector by the density of normals that `o` sees (Dupuy and Benyoub 2023).
fn visible_normal(o: glam::DVec3, alpha: f64, u: f64, v: f64) -> glam::DVec3 {
    let stretched = glam::DVec3::new(o.x * alpha, o.y * alpha, o.z).normalize();
    let (sin, cos) = (std::f64::consts::TAU * u).sin_cos();
    let z = (1.0 - v) * (1.0 + stretched.z) - stretched.z;
    let r = (1.0 - z * z).clamp(0.0, 1.0).sqrt();
    let h = glam::DVec3::new(r * cos, r * sin, z) + stretched;
    glam::DVec3::new(h.x * alpha, h.y * alpha, h.z.max(1e-9)).normalize()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_smooth_reflector_loses_nothing_and_a_rough_one_does() {
        let table = ggx_table();
        let energy =
            |row: usize, column: usize| table[row * ENERGY_SIZE + column][0] + table[row * ENERGY_SIZE + column][1];
        assert!((energy(0, 16) - 1.0).abs() < 1e-3);
        // α = 1, normal incidence: ∫ c/(1 + c) dc over 0..1
        let rough = energy(31, 31);
        assert!((f64::from(rough) - (1.0 - std::f64::consts::LN_2)).abs() < 1e-3, "{rough}");
    }
}
