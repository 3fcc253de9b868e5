//! Reads animations. A channel that cannot be read is left out.

use super::{File, Read, accessor, fault, json::Json};
use crate::scene::clip::{Channel, Clip, Join, Property, Weights};
use glam::Vec4;

/// Reads all clips. `place` maps nodes of the file to nodes of the model.
pub(super) fn load(file: &File, place: &[Option<usize>]) -> Vec<Clip> {
    let mut clips = Vec::new();
    for (index, animation) in file.root.list("animations").enumerate() {
        let (mut channels, mut moved_weights) = (Vec::new(), Vec::new());
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
                    match weights(file, animation, channel, node, &user) {
                        Ok(weights) => moved_weights.push(weights),
                        Err(fault) => file.left_out(fault),
                    }
                    continue;
                }
                _ => {
                    file.warn(&user, "moves a property that is not known: left out");
                    continue;
                }
            };
            match read(file, animation, channel, (node, property), &user) {
                Ok(channel) => channels.push(channel),
                Err(fault) => file.left_out(fault),
            }
        }
        let (channels, weights) = (channels.into(), moved_weights.into());
        clips.push(Clip { name: animation.name_or(index), channels, weights, ..Clip::default() });
    }
    clips
}

/// The keys of a channel: how they are joined, their times, and the accessor of their values.
struct Keys {
    join: Join,
    times: Vec<f32>,
    values: accessor::Elements,
}

impl Keys {
    fn read(file: &File, animation: Json, channel: Json, user: &str) -> Read<Self> {
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
        let (times, values) = (accessor::elements(file, input, user)?, accessor::elements(file, output, user)?);
        file.count_corners(times.count.saturating_add(values.count))?;
        let times: Vec<f32> = times.vectors(user)?.into_iter().map(|[time]| time).collect();
        let finite = times.iter().all(|time| time.is_finite());
        if !finite {
            return Err(fault(format!("{user}: holds a number that is not finite")));
        }
        if times.windows(2).any(|pair| pair[0] > pair[1]) {
            return Err(fault(format!("{user}: its times do not increase")));
        }
        Ok(Self { join, times, values })
    }

    /// Checks that there are this many values in all.
    fn check(&self, found: usize, a_key: usize, user: &str) -> Read<()> {
        let per_key = self.join.per_key();
        if self.times.is_empty() || self.times.len() * per_key * a_key != found || a_key == 0 {
            return Err(fault(format!("{user}: has {} times and {found} values", self.times.len())));
        }
        Ok(())
    }
}

fn weights(file: &File, animation: Json, channel: Json, node: usize, user: &str) -> Read<Weights> {
    let keys = Keys::read(file, animation, channel, user)?;
    let values: Vec<f32> = keys.values.vectors(user)?.into_iter().map(|[weight]| weight).collect();
    let per_key = keys.join.per_key();
    keys.check(values.len(), values.len() / (keys.times.len() * per_key).max(1), user)?;
    if !values.iter().all(|value| value.is_finite()) {
        return Err(fault(format!("{user}: holds a number that is not finite")));
    }
    Ok(Weights { node, join: keys.join, times: keys.times, values })
}

fn read(file: &File, animation: Json, channel: Json, of: (usize, Property), user: &str) -> Read<Channel> {
    let (node, property) = of;
    let keys = Keys::read(file, animation, channel, user)?;
    let values: Vec<Vec4> = match property {
        Property::Rotation => keys.values.vectors(user)?.into_iter().map(Vec4::from_array).collect(),
        _ => keys.values.vectors(user)?.into_iter().map(|[x, y, z]| Vec4::new(x, y, z, 0.0)).collect(),
    };
    keys.check(values.len(), 1, user)?;
    if !values.iter().all(|value| value.is_finite()) {
        return Err(fault(format!("{user}: holds a number that is not finite")));
    }
    Ok(Channel { node, property, join: keys.join, times: keys.times, values })
}
