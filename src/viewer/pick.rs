//! Finds what lies under the pointer, on the CPU. Objects are found by their triangles, real surfaces by
//! their depth.

use super::camera::Lens;
use crate::{
    panorama::{mapping, source::PanoramaFrame},
    scene::{Scene, bounds::Bounds},
};
use glam::{Vec2, Vec3};

/// Number of steps along a ray that does not start at the capture point.
const STEPS: u32 = 512;
/// The depths of neighbours whose ratio is larger belong to two surfaces.
const ONE_SURFACE: f32 = 1.3;
/// Nothing is looked for at a greater distance, metres.
const FARTHEST: f32 = 100.0;

/// The real surface of a video frame.
#[derive(Clone, Copy)]
pub struct RealSurface<'a> {
    /// The frame with its depth.
    pub frame: &'a PanoramaFrame,
    /// The capture point in the world, metres.
    pub centre: Vec3,
    /// Turn about +Y, degrees.
    pub yaw_degrees: f32,
}

impl RealSurface<'_> {
    /// Depth from the capture point in a direction of the world, metres. It is `None` where nothing was seen.
    /// Between texels of one surface the inverse of depth is interpolated, since it is nearly linear on a
    /// plane.
    fn depth(&self, direction: Vec3) -> Option<f32> {
        let [width, height] = self.frame.depth_size.map(f64::from);
        let local = mapping::world_to_panorama(direction.as_dvec3(), f64::from(self.yaw_degrees));
        let place = mapping::coordinates(local) * glam::dvec2(width, height) - 0.5;
        let corner = place.floor();
        let weight = (place - corner).as_vec2();
        let texel = |dx: i64, dy: i64| {
            let (x, y) = mapping::wrap(corner.x as i64 + dx, corner.y as i64 + dy, self.frame.depth_size);
            self.frame.depth[(y * self.frame.depth_size[0] + x) as usize]
        };
        let around = [texel(0, 0), texel(1, 0), texel(0, 1), texel(1, 1)];
        let (near, far) = around.iter().fold((f32::INFINITY, 0.0_f32), |(near, far), d| (near.min(*d), far.max(*d)));
        if near > 0.0 && far <= ONE_SURFACE * near {
            let [a, b, c, d] = around.map(f32::recip);
            let (upper, lower) = (a + (b - a) * weight.x, c + (d - c) * weight.x);
            return Some((upper + (lower - upper) * weight.y).recip());
        }
        Some(texel(weight.x.round() as i64, weight.y.round() as i64)).filter(|depth| *depth > 0.0)
    }

    /// Where a ray with a unit direction meets the surface, and the surface's normal there. The place is in
    /// the world, in metres.
    pub fn hit(&self, origin: Vec3, direction: Vec3) -> Option<(Vec3, Vec3)> {
        let from = origin - self.centre;
        let point = if from.length() < 1e-4 {
            self.centre + self.depth(direction)? * direction
        } else {
            let behind = |t: f32| {
                let p = from + t * direction;
                self.depth(p).is_some_and(|depth| depth <= p.length())
            };
            // The steps grow with the distance.
            let place = |k: u32| 0.02 * ((FARTHEST / 0.02).powf(k as f32 / STEPS as f32));
            let first = (1..=STEPS).find(|k| behind(place(*k)) && !behind(place(*k - 1)))?;
            let (mut near, mut far) = (place(first - 1), place(first));
            for _ in 0..16 {
                let middle = 0.5 * (near + far);
                if behind(middle) { far = middle } else { near = middle }
            }
            origin + far * direction
        };
        Some((point, self.normal(point - self.centre)))
    }

    /// The normal from a few texels around the place. It points towards the capture point.
    fn normal(&self, local: Vec3) -> Vec3 {
        let d = local.normalize();
        let (right, up) = d.any_orthonormal_pair();
        let step = 6.0 * std::f32::consts::PI / self.frame.depth_size[1] as f32;
        let at = |offset: Vec3| {
            let way = (d + step * offset).normalize();
            self.depth(way).map(|depth| depth * way)
        };
        let (Some(a), Some(b), Some(c), Some(e)) = (at(right), at(-right), at(up), at(-up)) else { return -d };
        let normal = (a - b).cross(c - e).normalize_or(-d);
        if normal.dot(d) > 0.0 { -normal } else { normal }
    }
}

/// The object that is seen at a place in the picture.
pub fn object_at(scene: &Scene, surface: Option<RealSurface>, lens: &Lens, place: Vec2, time: f64) -> Option<usize> {
    let (origin, direction) = (lens.camera.position, lens.direction(place));
    let (index, distance) = scene.first_object(origin, direction, time)?;
    let hidden = surface.and_then(|surface| surface.hit(origin, direction));
    // The depth map is no finer than its texels, hence the margin.
    let hidden = hidden.is_some_and(|(point, _)| point.distance(origin) < 0.97 * distance - 0.02);
    (!hidden).then_some(index)
}

/// How far a box must move to stand on a surface, with its middle over the point.
pub fn onto(bounds: &Bounds, point: Vec3, normal: Vec3) -> Vec3 {
    let half = 0.5 * (bounds.max - bounds.min);
    point + normal * half.dot(normal.abs()) - bounds.center()
}

/// The point of a line, through `from` along a unit axis, that is nearest to a ray. A ray along the line has none.
pub fn along_axis(from: Vec3, axis: Vec3, origin: Vec3, direction: Vec3) -> Option<Vec3> {
    let (between, cosine) = (origin - from, axis.dot(direction));
    let sine2 = 1.0 - cosine * cosine;
    (sine2 > 1e-3).then(|| from + (axis.dot(between) - cosine * direction.dot(between)) / sine2 * axis)
}

/// Where a box touches what is under it.
pub fn foot(bounds: &Bounds) -> Vec3 {
    bounds.center().with_y(bounds.min.y)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::panorama::depth::box_depth;
    use glam::vec3;

    #[test]
    fn rays_meet_the_walls_of_a_box() {
        let size = [512, 256];
        let (extent, middle, centre) = (vec3(4.0, 3.0, 6.0), vec3(0.0, 0.2, 0.0), vec3(0.3, 1.3, -0.2));
        for yaw_degrees in [0.0, 40.0] {
            let depth = box_depth(size, extent, middle, f64::from(yaw_degrees));
            let frame = PanoramaFrame { depth_size: size, depth, ..Default::default() };
            let surface = RealSurface { frame: &frame, centre, yaw_degrees };
            for origin in [centre, centre + vec3(0.7, -0.4, 1.1)] {
                for (direction, normal) in [
                    (vec3(0.2, -1.0, 0.1), Vec3::Y),
                    (vec3(1.0, 0.1, 0.3), Vec3::NEG_X),
                    (vec3(0.1, 0.2, -1.0), Vec3::Z),
                ] {
                    let direction = direction.normalize();
                    let (point, found) = surface.hit(origin, direction).expect("a closed box");
                    let wall = centre + middle - 0.5 * extent * normal;
                    assert!((point - wall).dot(normal).abs() < 0.04, "{origin} {direction}: {point}");
                    assert!(found.dot(normal) > 0.99, "{origin} {direction}: {found}");
                }
            }
        }
    }

    #[test]
    fn an_axis_is_followed_to_where_the_pointer_is() {
        let (foot, origin) = (vec3(0.5, 0.2, -2.0), vec3(0.0, 1.5, 0.3));
        for axis in [Vec3::X, Vec3::Y, Vec3::Z] {
            let there = foot + 0.7 * axis;
            let found = along_axis(foot, axis, origin, (there - origin).normalize()).expect("it is seen from the side");
            assert!(found.abs_diff_eq(there, 1e-4), "{axis}: {found}");
        }
        assert_eq!(along_axis(foot, Vec3::Y, origin, Vec3::Y), None);
    }

    #[test]
    fn boxes_stand_on_what_they_are_put_on() {
        let bounds = Bounds { min: vec3(-0.1, 2.0, -0.3), max: vec3(0.1, 2.5, 0.3) };
        let up = onto(&bounds, vec3(1.0, 0.0, 1.0), Vec3::Y);
        assert!((bounds.min + up).abs_diff_eq(vec3(0.9, 0.0, 0.7), 1e-6));
        let wall = onto(&bounds, vec3(2.0, 1.0, 0.0), Vec3::NEG_X);
        assert!((bounds.max + wall).x - 2.0 < 1e-6 && (bounds.center() + wall).y == 1.0);
        assert_eq!(foot(&bounds), vec3(0.0, 2.0, 0.0));
    }
}
