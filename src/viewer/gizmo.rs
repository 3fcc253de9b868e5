//! The three arrows at the selected object, by which it is moved along an axis of the world.

use super::camera::Lens;
use crate::scene::bounds::Bounds;
use egui::{Color32, Painter, Rect, Stroke};
use glam::{Vec2, Vec3, vec2};

const AXES: [Vec3; 3] = [Vec3::X, Vec3::Y, Vec3::Z];
const COLORS: [Color32; 3] =
    [Color32::from_rgb(235, 90, 80), Color32::from_rgb(110, 205, 90), Color32::from_rgb(90, 150, 245)];
/// How long an arrow is, as a share of its distance from the camera.
const LENGTH: f32 = 0.09;
/// How near the pointer must be to an arrow to grab it, as a share of the picture's height.
const NEAR: f32 = 0.012;
/// An arrow that points this much towards the camera, or away from it, cannot be grabbed.
const HEAD_ON: f32 = 0.97;

/// Where an arrow begins and ends in the picture: beside the object, along an axis. One that is seen from its tip has none.
fn arrow(lens: &Lens, bounds: &Bounds, axis: Vec3) -> Option<[Vec2; 2]> {
    let middle = 0.5 * (bounds.min + bounds.max);
    let way = middle - lens.camera.position;
    if bounds.is_empty() || way.normalize_or_zero().dot(axis).abs() > HEAD_ON {
        return None;
    }
    let begin = middle + axis * 0.5 * (bounds.max - bounds.min).dot(axis);
    Some([lens.project(begin)?, lens.project(begin + axis * LENGTH * way.length())?])
}

/// The axis whose arrow is at a place in the picture.
pub fn at(lens: &Lens, bounds: &Bounds, place: Vec2) -> Option<Vec3> {
    let square = vec2(lens.aspect, 1.0);
    let away = |axis: Vec3| {
        let [begin, end] = arrow(lens, bounds, axis)?.map(|at| at * square);
        let (along, to) = (end - begin, place * square - begin);
        let share = (to.dot(along) / along.length_squared().max(1e-12)).clamp(0.0, 1.0);
        Some((axis, to.distance(share * along))).filter(|(_, away)| *away < NEAR)
    };
    AXES.into_iter().filter_map(away).min_by(|a, b| a.1.total_cmp(&b.1)).map(|(axis, _)| axis)
}

/// Draws the arrows, `bold` that of this axis.
pub fn draw(painter: &Painter, rect: Rect, lens: &Lens, bounds: &Bounds, bold: Option<Vec3>) {
    for (axis, color) in AXES.into_iter().zip(COLORS) {
        let Some(ends) = arrow(lens, bounds, axis) else { continue };
        let [begin, end] = ends.map(|at| rect.min + egui::vec2(at.x * rect.width(), at.y * rect.height()));
        let width = if bold == Some(axis) { 4.0 } else { 2.0 };
        painter.arrow(begin, end - begin, Stroke::new(width, color));
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::viewer::camera::Free;

    #[test]
    fn an_arrow_is_grabbed_beside_the_object_and_not_on_it() {
        let free = Free { position: Vec3::new(0.0, 0.0, 3.0), yaw: 0.0, pitch: 0.0, fov_y: 60.0 };
        let lens = Lens { camera: free.track([16, 9]).at(0.0), aspect: 16.0 / 9.0 };
        let bounds = Bounds { min: Vec3::splat(-0.4), max: Vec3::splat(0.4) };
        let seen = |point: Vec3| lens.project(point).unwrap();
        for axis in [Vec3::X, Vec3::Y] {
            assert_eq!(at(&lens, &bounds, seen(0.5 * axis)), Some(axis));
            assert_eq!(at(&lens, &bounds, seen(0.9 * axis)), None, "beyond its tip");
        }
        assert_eq!(at(&lens, &bounds, seen(Vec3::ZERO)), None);
        assert_eq!(at(&lens, &bounds, seen(0.5 * Vec3::NEG_X)), None);
        assert!(arrow(&lens, &bounds, Vec3::Z).is_none(), "it points at the camera");
    }
}
