//! Objects that can hardly be meant as they are.

use super::bounds::Bounds;
use crate::panorama::depth::length_words;
use glam::Vec3;

/// Returns a factor that would make a size in wrong units fit, if there is one.
pub fn unit_factor(largest: f32) -> Option<f32> {
    // Things are some decimetres large, and people draw more in centimetres than things of some centimetres.
    let ranges = [(0.01, 0.1..3.0), (0.001, 0.02..8.0), (0.01, 0.02..8.0)];
    let fits = ranges.into_iter().find(|(factor, range)| range.contains(&(largest * factor)));
    fits.map(|(factor, _)| factor).filter(|_| largest > 8.0)
}

/// Warns of an object so large that it holds the capture point: nothing of the room would be seen.
pub fn swallowing(name: &str, bounds: Bounds, position: Vec3) -> Option<String> {
    let size = bounds.max - bounds.min;
    let holds = bounds.min.cmplt(position).all() && bounds.max.cmpgt(position).all();
    (holds && size.max_element() > 8.0).then(|| {
        let shown = size.to_array().map(length_words).join(" × ");
        let remedy = match unit_factor(size.max_element()) {
            Some(factor) => {
                let unit = if factor == 0.001 { "millimetres" } else { "centimetres" };
                format!("if it is in {unit}, write scale = {factor}")
            }
            None => "check its scale and translation".to_owned(),
        };
        format!("object {name}: is {shown} large and holds the capture point, so that it hides the room; {remedy}")
    })
}
