//! The cases, sorted by what they try.

mod casters;
mod depth;
mod extremes;
mod light;
mod motion;
mod panorama;
mod surfaces;

// Also what the cases share: each file takes it by `use super::*`.
use super::{
    Case, Outcome, Run,
    film::{FPS, Film},
    metric::{self, Texels},
    pattern::Pattern,
    world::{Block, Eye, Form, Lamp, Thing, World, WorldTruth},
};
use crate::{Result, settings::Method};
use glam::{Vec3, vec2, vec3};

/// Returns all cases, in the order of the report.
pub fn all() -> Vec<Case> {
    [panorama::CASES, casters::CASES, surfaces::CASES, light::CASES, depth::CASES, motion::CASES, extremes::CASES]
        .into_iter()
        .flatten()
        .copied()
        .collect()
}

/// A FLIP error that is seen at a glance: the best one-sample methods known are this far from their truth.
const SEEN: f64 = 0.05;
const SEEN_WHY: &str = "FLIP 0.05: a difference that is seen when the two pictures are flipped";

const CHANGE: &str = "share of the true change of light, over real pixels that it changes by more than 2 %, that is missing or too much, 16 frames";
const CHANGE_WHY: &str = "a shadow a tenth too light or dark passes for the right one; a missing one does not";

/// Makes the usual room: 6 × 2.8 × 5 m, with the camera 1.4 m above the floor.
const ROOM: Block = Block { low: Vec3::new(-3.0, -1.4, -2.5), high: Vec3::new(3.0, 1.4, 2.5) };
const FLOOR: f32 = -1.4;

/// Sends the same radiance everywhere, as a closed sky does.
fn even(_: Vec3, _: Vec3) -> Vec3 {
    Vec3::splat(0.6)
}

/// Paints walls of soft colours and a chequered floor.
fn colourful(p: Vec3, normal: Vec3) -> Vec3 {
    let squares = ((p.x * 2.0).floor() + (p.z * 2.0).floor()).rem_euclid(2.0);
    match normal {
        n if n.y > 0.5 => Vec3::splat(0.45 + 0.15 * squares),
        n if n.y < -0.5 => Vec3::splat(0.8),
        n if n.x.abs() > 0.5 => vec3(0.7, 0.5, 0.4) + 0.05 * (4.0 * p.y).sin(),
        _ => vec3(0.4, 0.55, 0.7) + 0.05 * (4.0 * p.x).sin(),
    }
}

/// Makes an empty room of a paint, seen from the capture point.
fn room(paint: fn(Vec3, Vec3) -> Vec3, target: Vec3, fov_y: f32) -> World {
    World {
        room: ROOM,
        furniture: Vec::new(),
        lamp: None,
        paint,
        things: Vec::new(),
        eye: Eye { at: Vec3::ZERO, target, fov_y },
        relit: false,
    }
}

/// Measures FLIP over what things make of the picture, in the worst of some frames.
fn worst_flip(run: &Run, film: &Film, frames: impl IntoIterator<Item = usize>) -> Result<Outcome> {
    run.worst(film, frames, |test, truth| metric::flip(truth.size, test, &truth.texels, &truth.concerned(), 1.0))
}
