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

    /// Warns of what looks wrong, with the line to write. `room` is the room's diagonal, metres.
    pub fn warnings(&self, scene: &Scene, index: usize, room: Option<f32>) -> Vec<String> {
        let mut warnings = Vec::new();
        let bounds = scene.object_bounds(index, 0.0);
        let largest = Vec3::from(self.size).max_element();
        if let Some(warning) = swallowing(&self.name, bounds, scene.panorama.position) {
            return vec![warning];
        }
        let mut warn = |text: String| warnings.push(format!("object {}: {text}", self.name));
        if let Some(room) = room.filter(|room| largest > *room) {
            let remedy = unit_factor(largest).map_or(String::new(), |factor| format!("; write scale = {factor}"));
            warn(format!("is {} large, larger than the room with its {}{remedy}", metres(largest), metres(room)));
            return warnings;
        }
        if largest < 0.002 {
            warn(format!("is only {} large; check its scale", metres(largest)));
        }
        if let Some(beyond) = self.beyond.filter(|beyond| *beyond > 0.05 * largest + 0.05) {
            warn(format!(
                "is outside: {} behind the real surface that hides it; check its translation",
                metres(beyond)
            ));
            return warnings;
        }
        let Some(gap) = self.gap.filter(|_| !self.moves) else { return warnings };
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
