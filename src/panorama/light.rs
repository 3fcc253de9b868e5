//! How much of a panorama's light comes from lamps: the cells by which directions to light are drawn.

use super::source::PanoramaFrame;
use std::f64::consts::{PI, TAU};

/// Columns and rows of cells, as `LIGHT_CELLS` in `light.glsl`.
pub const CELLS: [u32; 2] = [256, 128];

/// As `light_cells.comp` and `light_table.comp` reckon it: the share of all light that is above the mean.
pub fn light_share(frame: &PanoramaFrame) -> f64 {
    let [width, height] = frame.color_size;
    let luminance = |t: &[f32; 4]| 0.2126 * f64::from(t[0]) + 0.7152 * f64::from(t[1]) + 0.0722 * f64::from(t[2]);
    let range = |cell: u32, size: u32, cells: u32| {
        let (from, to) = (cell * size / cells, (cell + 1) * size / cells);
        from..to.max(from + 1)
    };
    let mut cells = Vec::with_capacity((CELLS[0] * CELLS[1]) as usize);
    for row in 0..CELLS[1] {
        let edge = |row: u32| (PI * f64::from(row) / f64::from(CELLS[1])).cos();
        let solid_angle = (edge(row) - edge(row + 1)) * TAU / f64::from(CELLS[0]);
        for column in 0..CELLS[0] {
            let (mut sum, mut count) = (0.0, 0.0);
            for y in range(row, height, CELLS[1]) {
                for x in range(column, width, CELLS[0]) {
                    sum += luminance(&frame.radiance[(y * width + x) as usize]);
                    count += 1.0;
                }
            }
            cells.push((solid_angle, sum / count));
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

    fn panorama(radiance: impl Fn(u32) -> f32) -> PanoramaFrame {
        let size = [64, 32];
        let texels = (0..size[0] * size[1]).map(|i| [radiance(i), radiance(i), radiance(i), 1.0]).collect();
        PanoramaFrame { color_size: size, radiance: texels, ..Default::default() }
    }

    #[test]
    fn even_panoramas_have_no_lights() {
        assert_eq!(light_share(&panorama(|_| 0.0)), 0.0);
        assert!(light_share(&panorama(|_| 3.0)) < 1e-9);
        // half of the sphere twice as bright: a sixth of all light is above the mean, 1.5
        let share = light_share(&panorama(|i| if i < 32 * 32 { 2.0 } else { 1.0 }));
        assert!((share - 1.0 / 6.0).abs() < 1e-6, "{share}");
    }
}
