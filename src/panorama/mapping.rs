//! Maps equirectangular pixels to directions of the panorama's own frame, which its yaw turns in the world.
//! `phi = 2π(u − ½)`, `theta = πv`, and `d = (sin θ sin φ, cos θ, −sin θ cos φ)`. The image's centre looks
//! along −Z, `u` grows to the right, `v = 0` is +Y, and texel centres are at `((i + ½)/W, (j + ½)/H)`.

use super::source::PanoramaFrame;
use glam::{DVec2, DVec3, Vec3};
use std::f64::consts::{PI, TAU};

/// Turns texture coordinates (0..1) into a unit direction.
pub fn direction(uv: DVec2) -> DVec3 {
    let (sin_phi, cos_phi) = (TAU * (uv.x - 0.5)).sin_cos();
    let (sin_theta, cos_theta) = (PI * uv.y).sin_cos();
    DVec3::new(sin_theta * sin_phi, cos_theta, -sin_theta * cos_phi)
}

/// Turns a direction of any length into texture coordinates (0..1). Straight up and down have `u = ½`.
pub fn coordinates(direction: DVec3) -> DVec2 {
    let horizontal = direction.x.hypot(direction.z);
    let phi = if horizontal == 0.0 { 0.0 } else { direction.x.atan2(-direction.z) };
    // atan2 keeps its precision at the poles, where acos loses it.
    DVec2::new(phi / TAU + 0.5, horizontal.atan2(direction.y) / PI)
}

/// Returns the unit direction of the centre of texel (`column`, `row`) of an image of `size`.
pub fn texel_direction(column: u32, row: u32, size: [u32; 2]) -> DVec3 {
    direction(DVec2::new((f64::from(column) + 0.5) / f64::from(size[0]), (f64::from(row) + 0.5) / f64::from(size[1])))
}

/// Turns a direction of the world into one of the panorama.
pub fn world_to_panorama(direction: DVec3, yaw_degrees: f64) -> DVec3 {
    glam::DQuat::from_rotation_y(-yaw_degrees.to_radians()) * direction
}

/// Turns a direction of the panorama into one of the world.
pub fn panorama_to_world(direction: DVec3, yaw_degrees: f64) -> DVec3 {
    glam::DQuat::from_rotation_y(yaw_degrees.to_radians()) * direction
}

/// Finds the texel that a column and row outside the image stand for. Columns wrap. A row beyond a pole is
/// the mirrored row, half way round.
pub fn wrap(column: i64, row: i64, size: [u32; 2]) -> (u32, u32) {
    let [width, height] = size.map(i64::from);
    let row = row.rem_euclid(2 * height);
    let (row, column) = if row < height { (row, column) } else { (2 * height - 1 - row, column + width / 2) };
    (column.rem_euclid(width) as u32, row as u32)
}

/// Returns the eight texels around one, by their numbers.
pub fn neighbours(texel: u32, size: [u32; 2]) -> impl Iterator<Item = u32> {
    let (column, row) = (i64::from(texel % size[0]), i64::from(texel / size[0]));
    (0..9).filter(|k| *k != 4).map(move |k| {
        let (column, row) = wrap(column + k % 3 - 1, row + k / 3 - 1, size);
        row * size[0] + column
    })
}

/// Returns the radiance in a direction of the panorama's frame, bilinear between texel centres.
pub fn bilinear(frame: &PanoramaFrame, direction: Vec3) -> Vec3 {
    let uv = coordinates(direction.as_dvec3());
    let [width, height] = frame.color_size;
    let place = uv * DVec2::new(f64::from(width), f64::from(height)) - 0.5;
    let corner = place.floor();
    let weight = (place - corner).as_vec2();
    let texel = |dx: i64, dy: i64| {
        let (column, row) = wrap(corner.x as i64 + dx, corner.y as i64 + dy, frame.color_size);
        let [r, g, b, _] = frame.radiance.at(row as usize * width as usize + column as usize);
        Vec3::new(r, g, b)
    };
    let upper = texel(0, 0).lerp(texel(1, 0), weight.x);
    let lower = texel(0, 1).lerp(texel(1, 1), weight.x);
    upper.lerp(lower, weight.y)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::panorama::depth::Quantisation;

    #[test]
    fn landmarks() {
        for (uv, expected) in [
            ((0.5, 0.5), DVec3::NEG_Z),
            ((0.75, 0.5), DVec3::X),
            ((0.25, 0.5), DVec3::NEG_X),
            ((0.0, 0.5), DVec3::Z),
            ((0.3, 0.0), DVec3::Y),
            ((0.3, 1.0), DVec3::NEG_Y),
        ] {
            assert!(direction(DVec2::from(uv)).abs_diff_eq(expected, 1e-15), "{uv:?}");
        }
        assert!(panorama_to_world(DVec3::NEG_Z, 90.0).abs_diff_eq(DVec3::NEG_X, 1e-15));
    }

    #[test]
    fn directions_and_coordinates_are_inverse() {
        for row in 0..50 {
            for column in 0..100 {
                let uv = DVec2::new((f64::from(column) + 0.5) / 100.0, (f64::from(row) + 0.5) / 50.0);
                assert!(coordinates(direction(uv)).abs_diff_eq(uv, 1e-12));
                assert!((direction(uv).length() - 1.0).abs() < 1e-14);
            }
        }
    }

    #[test]
    fn rows_beyond_a_pole_are_half_way_round() {
        assert_eq!(wrap(1, -1, [8, 4]), (5, 0));
        assert_eq!(wrap(7, 4, [8, 4]), (3, 3));
        assert_eq!(wrap(-1, 2, [8, 4]), (7, 2));
        assert_eq!(wrap(0, -1, [1, 1]), (0, 0));
    }

    #[test]
    fn bilinear_reproduces_texels_and_is_continuous_over_seam_and_poles() {
        let size = [16, 8];
        let texels = (0..128).map(|i| {
            let d = texel_direction(i % 16, i / 16, size).as_vec3();
            [1.0 + d.x, 1.0 + d.y, 1.0 + d.z, 1.0]
        });
        let frame = PanoramaFrame {
            color_size: size,
            radiance: texels.collect(),
            white: None,
            depth_size: [1, 1],
            depth: vec![1.0],
            quantisation: Quantisation::None,
            warnings: vec![],
            taken: Default::default(),
        };
        for row in 0..8 {
            for column in 0..16 {
                let d = texel_direction(column, row, size).as_vec3();
                assert!(bilinear(&frame, d).abs_diff_eq(d + 1.0, 1e-5));
            }
        }
        for base in [Vec3::Y, Vec3::NEG_Y, Vec3::Z] {
            let near = |x: f32| bilinear(&frame, (base + Vec3::new(x, 0.0, 0.0)).normalize());
            assert!(near(1e-4).abs_diff_eq(near(-1e-4), 1e-3), "{base}");
        }
    }
}
