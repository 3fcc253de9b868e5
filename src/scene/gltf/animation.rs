//! Reads animations of rigid nodes.

use super::{File, accessor};
use crate::{
    Result,
    scene::clip::{Channel, Clip, Join, Property},
};
use ::gltf::json::{
    animation::{Interpolation, Property as Path},
    validation::Checked,
};
use glam::Vec4;

/// Reads all clips. `place` maps nodes of the file to nodes of the model.
pub(super) fn load(file: &mut File, place: &[Option<usize>]) -> Result<Vec<Clip>> {
    let root = file.root;
    let mut clips = Vec::new();
    for (index, animation) in root.animations.iter().enumerate() {
        let mut clip =
            Clip { name: animation.name.clone().unwrap_or_else(|| format!("{index}")), channels: Vec::new() };
        for (number, channel) in animation.channels.iter().enumerate() {
            let user = format!("animation {index}, channel {number}");
            let Some(place) = place.get(channel.target.node.value()) else {
                return Err(file.broken(format!("{user}: its node does not exist")));
            };
            let property = match channel.target.path {
                Checked::Valid(Path::Translation) => Property::Translation,
                Checked::Valid(Path::Rotation) => Property::Rotation,
                Checked::Valid(Path::Scale) => Property::Scale,
                Checked::Valid(Path::MorphTargetWeights) => {
                    file.warn("a morph target", "drawn without it");
                    continue;
                }
                Checked::Invalid => return Err(file.broken(format!("{user}: moves an unknown property"))),
            };
            let Some(sampler) = animation.samplers.get(channel.sampler.value()) else {
                return Err(file.broken(format!("{user}: its sampler does not exist")));
            };
            let join = match sampler.interpolation {
                Checked::Valid(Interpolation::Linear) => Join::Linear,
                Checked::Valid(Interpolation::Step) => Join::Step,
                Checked::Valid(Interpolation::CubicSpline) => Join::CubicSpline,
                Checked::Invalid => return Err(file.broken(format!("{user}: has an unknown interpolation"))),
            };
            let times = accessor::elements(file, sampler.input.value(), &user)?;
            let outputs = accessor::elements(file, sampler.output.value(), &user)?;
            file.count_corners(times.count.saturating_add(outputs.count))?;
            let times: Vec<f32> = times.vectors(file, &user)?.into_iter().map(|[time]| time).collect();
            let values: Vec<Vec4> = match property {
                Property::Rotation => outputs.vectors(file, &user)?.into_iter().map(Vec4::from_array).collect(),
                _ => outputs.vectors(file, &user)?.into_iter().map(|[x, y, z]| Vec4::new(x, y, z, 0.0)).collect(),
            };
            let per_key = if join == Join::CubicSpline { 3 } else { 1 };
            if times.is_empty() || times.len() * per_key != values.len() {
                let problem = format!("{user}: has {} times and {} values", times.len(), values.len());
                return Err(file.broken(problem));
            }
            if times[0] < 0.0 || times.windows(2).any(|pair| pair[0] >= pair[1]) {
                return Err(file.broken(format!("{user}: its times do not increase from 0 on")));
            }
            if let Some(node) = *place {
                clip.channels.push(Channel { node, property, join, times, values });
            }
        }
        clips.push(clip);
    }
    Ok(clips)
}
