//! Reads animations of rigid nodes. A channel that cannot be read is left out.

use super::{File, Read, accessor, fault, json::Json};
use crate::scene::clip::{Channel, Clip, Join, Property};
use glam::Vec4;

/// Reads all clips. `place` maps nodes of the file to nodes of the model.
pub(super) fn load(file: &File, place: &[Option<usize>]) -> Vec<Clip> {
    let mut clips = Vec::new();
    for (index, animation) in file.root.list("animations").enumerate() {
        let mut clip = Clip { name: animation.name_or(index), channels: Vec::new() };
        for (number, channel) in animation.list("channels").enumerate() {
            let target = channel.get("target");
            // A channel without a node is for extensions, and one of a node that is not drawn moves nothing.
            let Some(node) = target.index("node").and_then(|node| *place.get(node)?) else { continue };
            let user = format!("animation {index}, channel {number}");
            let property = match target.text("path") {
                Some("translation") => Property::Translation,
                Some("rotation") => Property::Rotation,
                Some("scale") => Property::Scale,
                Some("weights") => {
                    file.unsupported(&user, "a morph target", "drawn without it");
                    continue;
                }
                _ => {
                    file.warn(&user, "moves a property that is not known: left out");
                    continue;
                }
            };
            match read(file, animation, channel, (node, property), &user) {
                Ok(channel) => clip.channels.push(channel),
                Err(fault) => file.left_out(fault),
            }
        }
        clips.push(clip);
    }
    clips
}

fn read(file: &File, animation: Json, channel: Json, of: (usize, Property), user: &str) -> Read<Channel> {
    let (node, property) = of;
    let sampler = animation.entry("samplers", channel.index("sampler").unwrap_or(usize::MAX));
    let (Some(input), Some(output)) = (sampler.index("input"), sampler.index("output")) else {
        return Err(fault(format!("{user}: has no sampler with input and output")));
    };
    let join = match sampler.text("interpolation") {
        None | Some("LINEAR") => Join::Linear,
        Some("STEP") => Join::Step,
        Some("CUBICSPLINE") => Join::CubicSpline,
        Some(_) => {
            file.warn(user, "has an interpolation that is not known: LINEAR is taken");
            Join::Linear
        }
    };
    let (times, outputs) = (accessor::elements(file, input, user)?, accessor::elements(file, output, user)?);
    file.count_corners(times.count.saturating_add(outputs.count))?;
    let times: Vec<f32> = times.vectors(user)?.into_iter().map(|[time]| time).collect();
    let values: Vec<Vec4> = match property {
        Property::Rotation => outputs.vectors(user)?.into_iter().map(Vec4::from_array).collect(),
        _ => outputs.vectors(user)?.into_iter().map(|[x, y, z]| Vec4::new(x, y, z, 0.0)).collect(),
    };
    let per_key = if join == Join::CubicSpline { 3 } else { 1 };
    if times.is_empty() || times.len() * per_key != values.len() {
        return Err(fault(format!("{user}: has {} times and {} values", times.len(), values.len())));
    }
    if !values.iter().all(|value| value.is_finite()) || !times.iter().all(|time| time.is_finite()) {
        return Err(fault(format!("{user}: holds a number that is not finite")));
    }
    if times.windows(2).any(|pair| pair[0] > pair[1]) {
        return Err(fault(format!("{user}: its times do not increase")));
    }
    Ok(Channel { node, property, join, times, values })
}
