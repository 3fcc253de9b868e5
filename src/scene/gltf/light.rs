//! Reads lights without a surface (KHR_lights_punctual). One that cannot be read is left out.

use super::File;
use crate::scene::punctual::{PunctualKind, PunctualLight};
use glam::Vec3;
use std::f32::consts::{FRAC_PI_2, FRAC_PI_4};

/// Reads the lights of the nodes that the scene holds. `place` maps nodes of the file to nodes of the model.
pub(super) fn load(file: &File, place: &[Option<usize>]) -> Vec<PunctualLight> {
    const EXTENSION: &str = "KHR_lights_punctual";
    let mut lights = Vec::new();
    for (source, node) in file.root.list("nodes").enumerate() {
        let Some((node, index)) = place[source].zip(node.extension(EXTENSION).index("light")) else { continue };
        let light = file.root.extension(EXTENSION).entry("lights", index);
        let user = format!("light {index}");
        let kind = match light.text("type") {
            Some("point") => PunctualKind::Point,
            Some("directional") => PunctualKind::Directional,
            Some("spot") => {
                let spot = light.get("spot");
                PunctualKind::Spot {
                    inner: spot.number("innerConeAngle").unwrap_or(0.0),
                    outer: spot.number("outerConeAngle").unwrap_or(FRAC_PI_4),
                }
            }
            _ => {
                file.warn(&user, "does not exist or is of no known type: left out");
                continue;
            }
        };
        let cone_fits = match kind {
            PunctualKind::Spot { inner, outer } => inner >= 0.0 && inner < outer && outer <= FRAC_PI_2 + 1e-3,
            _ => true,
        };
        let color = Vec3::from(light.numbers("color").unwrap_or([1.0; 3]));
        let intensity = color * light.number("intensity").unwrap_or(1.0);
        let range = light.number("range").unwrap_or(f32::INFINITY);
        if cone_fits && intensity.is_finite() && intensity.min_element() >= 0.0 && range > 0.0 {
            lights.push(PunctualLight { node, intensity, kind, range });
        } else {
            file.warn(&user, "has a value out of range: left out");
        }
    }
    lights
}
