//! Reads lights without a surface (KHR_lights_punctual).

use super::File;
use crate::{
    Result,
    scene::punctual::{PunctualKind, PunctualLight},
};
use ::gltf::json::{extensions::scene::khr_lights_punctual::Type, validation::Checked};
use glam::Vec3;
use std::f32::consts::FRAC_PI_2;

/// Reads the lights of the nodes that the scene holds. `place` maps nodes of the file to nodes of the model.
pub(super) fn load(file: &File, place: &[Option<usize>]) -> Result<Vec<PunctualLight>> {
    let known = file.root.extensions.as_ref().and_then(|extensions| extensions.khr_lights_punctual.as_ref());
    let mut lights = Vec::new();
    for (source, node) in file.root.nodes.iter().enumerate() {
        let index = node.extensions.as_ref().and_then(|extensions| extensions.khr_lights_punctual.as_ref());
        let (Some(node), Some(index)) = (place[source], index) else { continue };
        let index = index.light.value();
        let Some(light) = known.and_then(|known| known.lights.get(index)) else {
            return Err(file.broken(format!("node {source}: its light {index} does not exist")));
        };
        let kind = match (light.type_, &light.spot) {
            (Checked::Valid(Type::Point), _) => PunctualKind::Point,
            (Checked::Valid(Type::Directional), _) => PunctualKind::Directional,
            (Checked::Valid(Type::Spot), Some(spot)) => {
                PunctualKind::Spot { inner: spot.inner_cone_angle, outer: spot.outer_cone_angle }
            }
            _ => return Err(file.broken(format!("light {index} is of no known type, or a spot without its cone"))),
        };
        let cone_fits = match kind {
            PunctualKind::Spot { inner, outer } => inner >= 0.0 && inner < outer && outer <= FRAC_PI_2 + 1e-3,
            _ => true,
        };
        let intensity = Vec3::from(light.color) * light.intensity;
        let range = light.range.unwrap_or(f32::INFINITY);
        if !(cone_fits && intensity.is_finite() && intensity.min_element() >= 0.0 && range > 0.0) {
            return Err(file.broken(format!("light {index} has a value out of range")));
        }
        lights.push(PunctualLight { node, intensity, kind, range });
    }
    Ok(lights)
}
