//! How much of a panorama's light comes from lamps, measured in the cells by which light directions are
//! drawn.

use super::source::PanoramaFrame;
use rayon::prelude::*;
use std::f64::consts::{PI, TAU};

/// Columns and rows of cells. They must equal `LIGHT_CELLS` in `light.glsl`.
pub const CELLS: [u32; 2] = [256, 128];

/// Returns the mean luminance over all directions.
pub fn mean_luminance(frame: &PanoramaFrame) -> f32 {
    mean_luminance_by(frame, 1)
}

/// Returns the same of every so manyth column of every so manyth row, of which there must be one.
pub fn mean_luminance_by(frame: &PanoramaFrame, step: usize) -> f32 {
    let [width, height] = frame.color_size.map(|side| side as usize);
    let rows = (step / 2..height).into_par_iter().step_by(step).map(|y| {
        let weight = (PI * (y as f64 + 0.5) / height as f64).sin();
        let row = (y * width..(y + 1) * width).skip(step / 2).step_by(step);
        let sum = row.map(|at| luminance(&frame.radiance.at(at))).sum::<f64>();
        [weight, weight * sum / (width - step / 2).div_ceil(step) as f64]
    });
    let rows: Vec<[f64; 2]> = rows.collect(); // summed in order, so that the sum is always the same
    let [weight, sum] = rows.iter().fold([0.0; 2], |sum, row| [sum[0] + row[0], sum[1] + row[1]]);
    (sum / weight.max(1e-9)) as f32
}

fn luminance(t: &[f32; 4]) -> f64 {
    f64::from(t[3]) * (0.2126 * f64::from(t[0]) + 0.7152 * f64::from(t[1]) + 0.0722 * f64::from(t[2]))
}

/// Returns the share of all light that is above the mean. `light_cells.comp` and `light_table.comp` compute
/// it in the same way, from the interpolated radiance that rays see.
pub fn light_share(frame: &PanoramaFrame) -> f64 {
    let [width, height] = frame.color_size;
    // The weight of each texel, relative to the first row or column, in the mean over a cell: the integral of
    // its bilinear weight.
    let hats = |cell: u32, size: u32, cells: u32| {
        let [from, to] = [cell, cell + 1].map(|edge| f64::from(edge) * f64::from(size) / f64::from(cells));
        let integral = |t: f64| {
            let t = t.clamp(-1.0, 1.0);
            t - 0.5 * t * t.abs()
        };
        let texels = (from - 0.5).floor() as i64..=(to + 0.5).floor() as i64;
        let weight = move |texel: i64| {
            let centre = texel as f64 + 0.5;
            (texel, (integral(to - centre) - integral(from - centre)) / (to - from))
        };
        texels.map(weight).filter(|(_, weight)| *weight > 0.0).collect::<Vec<_>>()
    };
    let (columns, rows) = (i64::from(width), i64::from(height));
    let texel = |x: i64, y: i64| {
        // Beyond a pole lies the opposite meridian.
        let (x, y) = if (0..rows).contains(&y) { (x, y) } else { (x + columns / 2, (2 * rows - 1 - y) % (2 * rows)) };
        luminance(&frame.radiance.at((y * columns + x.rem_euclid(columns)) as usize))
    };
    let mut cells = Vec::with_capacity((CELLS[0] * CELLS[1]) as usize);
    for row in 0..CELLS[1] {
        let edge = |row: u32| (PI * f64::from(row) / f64::from(CELLS[1])).cos();
        let solid_angle = (edge(row) - edge(row + 1)) * TAU / f64::from(CELLS[0]);
        let across = hats(row, height, CELLS[1]);
        for column in 0..CELLS[0] {
            let along = hats(column, width, CELLS[0]);
            let line = |y: i64| along.iter().map(|(x, weight)| weight * texel(*x, y)).sum::<f64>();
            cells.push((solid_angle, across.iter().map(|(y, weight)| weight * line(*y)).sum::<f64>()));
        }
    }
    let total: f64 = cells.iter().map(|(solid_angle, l)| solid_angle * l).sum();
    let mean = total / (4.0 * PI);
    let above: f64 = cells.iter().map(|(solid_angle, l)| solid_angle * (l - mean).max(0.0)).sum();
    if total > 0.0 { above / total } else { 0.0 }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::panorama::texels::Texels;

    fn panorama(radiance: impl Fn(u32) -> f32) -> PanoramaFrame {
        let size = [64, 32];
        let texels = (0..size[0] * size[1]).map(|i| [radiance(i), radiance(i), radiance(i), 1.0]).collect();
        PanoramaFrame { color_size: size, radiance: texels, ..Default::default() }
    }

    #[test]
    fn even_panoramas_have_no_lights() {
        assert_eq!(light_share(&panorama(|_| 0.0)), 0.0);
        assert!(light_share(&panorama(|_| 3.0)) < 1e-9);
        // Half of the sphere is twice as bright. The mean is 1.5, and a sixth of all light is above it.
        let share = light_share(&panorama(|i| if i < 32 * 32 { 2.0 } else { 1.0 }));
        assert!((share - 1.0 / 6.0).abs() < 0.01, "{share}"); // The tolerance covers the ramp between the halves.
    }

    #[test]
    fn a_bright_texel_shines_into_its_neighbours() {
        // The lamp is as large as a cell, at the equator. It reaches nine cells, and its own has (3/4)² of
        // the light.
        let mut panorama = panorama(|_| 0.0);
        panorama.color_size = CELLS;
        panorama.radiance = Texels::blank((CELLS[0] * CELLS[1]) as usize);
        panorama.radiance.set((64 * CELLS[0]) as usize, [1.0; 4]);
        let sphere = 4.0 * PI;
        let cell = TAU / f64::from(CELLS[0]) * (PI / f64::from(CELLS[1])).sin();
        let mean = cell / sphere;
        // Each cell loses the mean, and nothing else is lit.
        let share = light_share(&panorama);
        assert!((share - (1.0 - 9.0 * cell * mean / cell)).abs() < 1e-3, "{share} {mean}");
    }
}
