//! What objects measure, and how they stand in the room.

use crate::{
    panorama::{cloud::Cloud, depth::length_words as metres, room::Level},
    scene::{
        Scene,
        bounds::Bounds,
        plausible::{swallowing, unit_factor},
    },
};
use glam::Vec3;
use serde::Serialize;

/// An object at the start.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct ObjectFacts {
    pub name: String,
    /// Full extents of its world box, metres.
    pub size: [f32; 3],
    /// The middle of its world box, metres.
    pub center: [f32; 3],
    /// The height of its lowest point over the real surface below it, metres; negative if it is sunk.
    pub gap: Option<f32>,
    /// How far beyond the real surface in its direction its nearest point is, metres; positive is outside.
    pub beyond: Option<f32>,
    /// Whether it ever moves.
    pub moves: bool,
}

impl ObjectFacts {
    /// Measures object `index` against the real surfaces. `position` is the capture point.
    pub fn of(scene: &Scene, index: usize, cloud: &Cloud, floor: Option<Level>, position: Vec3) -> Option<Self> {
        let object = scene.objects().nth(index)?;
        let bounds = scene.object_bounds(index, 0.0);
        if bounds.is_empty() {
            return None;
        }
        let size = bounds.max - bounds.min;
        let center = bounds.center();
        let below = surface_below(cloud, bounds, position).or_else(|| floor_below(floor, center, position));
        Some(Self {
            name: object.name.clone(),
            size: size.to_array(),
            center: center.to_array(),
            gap: below.map(|height| bounds.min.y - height),
            beyond: beyond(cloud, bounds, position),
            moves: object.clip.is_some() || !object.placement.is_constant(),
        })
    }

    /// Warns of what looks wrong, with the line to write.
    pub fn warnings(&self, scene: &Scene, index: usize, room: &Room) -> Vec<String> {
        let mut warnings = Vec::new();
        let bounds = scene.object_bounds(index, 0.0);
        let largest = Vec3::from(self.size).max_element();
        if let Some(warning) = swallowing(&self.name, bounds, scene.panorama.position) {
            return vec![warning];
        }
        let mut warn = |text: String| warnings.push(format!("object {}: {text}", self.name));
        if let Some(axis) = room.exceeded(bounds) {
            let remedy = unit_factor(largest).map_or(String::new(), |factor| format!("; write scale = {factor}"));
            let ([own, room], along) = ([self.size[axis], room.size(axis)].map(metres), ["x", "y", "z"][axis]);
            warn(format!("is {own} large along {along}, larger than the room with its {room}{remedy}"));
            return warnings;
        }
        if largest < 0.002 {
            warn(format!("is only {} large; check its scale", metres(largest)));
        }
        let margin = 0.05 * largest + 0.05;
        if let Some((by, side)) = room.left(bounds).filter(|(by, _)| *by > margin) {
            warn(format!("is outside: {} {side}; check its translation", metres(by)));
            return warnings;
        }
        // What stands behind furniture stands on something that was not seen.
        let is_hidden = self.beyond.is_some_and(|beyond| beyond > margin);
        let gap = self.gap.filter(|_| !self.moves && !is_hidden && !room.carries(bounds));
        let Some(gap) = gap else { return warnings };
        let translation = scene.objects().nth(index).map(|object| object.placement.at(0.0).translation);
        let line = translation.map_or(String::new(), |at| {
            format!("; to stand on it, write translation = [{:.3}, {:.3}, {:.3}]", at.x, at.y - gap, at.z)
        });
        let within = 0.02 + 0.05 * largest;
        if gap > within && !stands_on_another(scene, index, within) {
            warn(format!("hangs {} over the surface below it{line}", metres(gap)));
        } else if gap < -(0.02 + 0.05 * largest) {
            warn(format!("is sunk by {} into the surface below it{line}", metres(-gap)));
        }
        warnings
    }
}

/// What was measured of the room.
pub struct Room {
    /// The box around what is seen in the world, metres. It has no end below or above where no floor or ceiling was
    /// found.
    bounds: Bounds,
    /// The floor, and the capture point that it is relative to.
    floor: Option<Level>,
    position: Vec3,
    /// Whether anything can stand on what is seen: a sphere is no room.
    has_surfaces: bool,
}

/// The share of what is seen that may be seen through doors and windows, or be noise, at each end of each axis.
const STRAY: f32 = 0.002;

impl Room {
    /// Measures the room around `position`. `levels` are its floor and ceiling.
    pub fn of(cloud: &Cloud, levels: [Option<Level>; 2], position: Vec3, has_surfaces: bool) -> Self {
        let points: Vec<Vec3> = (0..cloud.depth.len()).filter_map(|i| cloud.point(i)).collect();
        let ends = |axis: usize| {
            let mut along: Vec<f32> = points.iter().map(|point| point[axis] + position[axis]).collect();
            along.sort_by(f32::total_cmp);
            let stray = (along.len() as f32 * STRAY) as usize;
            match along.as_slice() {
                [] => [f32::NEG_INFINITY, f32::INFINITY],
                along => [along[stray], along[along.len() - 1 - stray]],
            }
        };
        let ([x, mut y, z], [floor, ceiling]) = ([0, 1, 2].map(ends), levels);
        y = [floor.map_or(f32::NEG_INFINITY, |_| y[0]), ceiling.map_or(f32::INFINITY, |_| y[1])];
        let bounds = Bounds { min: Vec3::new(x[0], y[0], z[0]), max: Vec3::new(x[1], y[1], z[1]) };
        Self { bounds, floor, position, has_surfaces }
    }

    fn size(&self, axis: usize) -> f32 {
        self.bounds.max[axis] - self.bounds.min[axis]
    }

    /// The axis along which an object is larger than the room.
    fn exceeded(&self, object: Bounds) -> Option<usize> {
        (0..3).find(|axis| object.max[*axis] - object.min[*axis] > 1.05 * self.size(*axis) + 0.05)
    }

    /// By how much an object lies beyond a wall, the floor or the ceiling, metres, and beyond which; `None` if it
    /// reaches into the room.
    fn left(&self, object: Bounds) -> Option<(f32, &'static str)> {
        let walls = ["beyond the room's wall"; 2];
        let sides = [walls, ["below the floor", "above the ceiling"], walls];
        let by = |axis: usize| {
            let below = self.bounds.min[axis] - object.max[axis];
            let above = object.min[axis] - self.bounds.max[axis];
            [(below, sides[axis][0]), (above, sides[axis][1])]
        };
        let farthest = (0..3).flat_map(by).max_by(|a, b| a.0.total_cmp(&b.0))?;
        (farthest.0 > 0.0).then_some(farthest)
    }

    /// Says whether an object stands on the floor that was found, as `place` puts it, or whether there is nothing
    /// to stand on.
    fn carries(&self, object: Bounds) -> bool {
        let floor = floor_below(self.floor, object.center(), self.position);
        !self.has_surfaces || floor.is_some_and(|height| (object.min.y - height).abs() < 0.002)
    }
}

/// Says whether an object stands on another one: on its box, to `within` metres.
fn stands_on_another(scene: &Scene, index: usize, within: f32) -> bool {
    let bounds = scene.object_bounds(index, 0.0);
    let carries = |other: Bounds| {
        !other.is_empty()
            && (other.max.y - bounds.min.y).abs() < within
            && other.min.x < bounds.max.x
            && other.max.x > bounds.min.x
            && other.min.z < bounds.max.z
            && other.max.z > bounds.min.z
    };
    (0..scene.object_count()).any(|other| other != index && carries(scene.object_bounds(other, 0.0)))
}

/// The height of the real surface under a box, metres: of points within its footprint that face upwards and
/// lie below its middle, the highest.
fn surface_below(cloud: &Cloud, bounds: Bounds, position: Vec3) -> Option<f32> {
    let margin = 0.15 * (bounds.max - bounds.min).max_element().clamp(0.05, 2.0);
    let inside = |p: Vec3| {
        p.x > bounds.min.x - margin
            && p.x < bounds.max.x + margin
            && p.z > bounds.min.z - margin
            && p.z < bounds.max.z + margin
    };
    let mut heights: Vec<f32> = (0..cloud.depth.len())
        .filter(|i| cloud.normals[*i].y > 0.8)
        .filter_map(|i| cloud.point(i).map(|p| p + position))
        .filter(|p| inside(*p) && p.y < bounds.center().y.max(bounds.min.y + 0.02))
        .map(|p| p.y)
        .collect();
    heights.sort_by(f32::total_cmp);
    // The upper part, but not the odd point.
    (heights.len() >= 3).then(|| heights[(heights.len() * 3 / 4).min(heights.len() - 1)])
}

fn floor_below(floor: Option<Level>, center: Vec3, position: Vec3) -> Option<f32> {
    let at = center - position;
    floor?.height(at.x, at.z).map(|height| height + position.y)
}

/// How far the box lies behind the real surfaces in its directions, metres: the least over its corners and
/// middle.
fn beyond(cloud: &Cloud, bounds: Bounds, position: Vec3) -> Option<f32> {
    let points = bounds.corners().into_iter().chain([bounds.center()]);
    points
        .map(|point| {
            let to = point - position;
            let cell = cloud.cell(to);
            // In a hole, what is seen beside it.
            let near = || cloud.window(cell, 2).filter(|i| cloud.depth[*i] > 0.0);
            let along = |i: &usize| cloud.directions[*i].dot(to);
            let beside = || near().max_by(|a, b| along(a).total_cmp(&along(b)));
            let nearest = if cloud.depth[cell] > 0.0 { Some(cell) } else { beside() }?;
            let seen = cloud.directions[nearest].dot(to.normalize_or_zero()) > 0.999;
            seen.then(|| to.length() - cloud.depth[nearest])
        })
        .collect::<Option<Vec<f32>>>()
        .map(|all| all.into_iter().fold(f32::MAX, f32::min))
}
