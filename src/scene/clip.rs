//! glTF animation clips.

use super::{animation::Transform, model::Local};
use glam::{Quat, Vec4};
use std::sync::Arc;

/// How the keys of a channel are joined.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Join {
    Linear,
    Step,
    /// Each key is (in-tangent, value, out-tangent).
    CubicSpline,
}

impl Join {
    /// How many values a key has.
    pub fn per_key(self) -> usize {
        if self == Self::CubicSpline { 3 } else { 1 }
    }
}

/// The property that a channel moves.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Property {
    Translation,
    Rotation,
    Scale,
}

/// One moved property of one node.
#[derive(Clone, Debug, PartialEq)]
pub struct Channel {
    /// The index into the model's nodes.
    pub node: usize,
    pub property: Property,
    pub join: Join,
    /// Seconds, increasing, at least one.
    pub times: Vec<f32>,
    /// One value per time, or three for [`Join::CubicSpline`]. Only rotations use `w`.
    pub values: Vec<Vec4>,
}

/// The moved weights of one node's morph targets.
#[derive(Clone, Debug, PartialEq)]
pub struct Weights {
    /// The index into the model's nodes.
    pub node: usize,
    pub join: Join,
    /// As in [`Channel`].
    pub times: Vec<f32>,
    /// The weights of each time, one list after another; three lists for [`Join::CubicSpline`].
    pub values: Vec<f32>,
}

/// A named set of channels.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Clip {
    pub name: String,
    pub channels: Arc<[Channel]>,
    pub weights: Arc<[Weights]>,
    /// Whether it ends with its last key, and does not repeat.
    pub hold: bool,
    /// The place in the clip at which it stands at time 0, seconds.
    pub offset: f64,
}

impl Clip {
    /// Returns the seconds from 0 to the last key.
    pub fn duration(&self) -> f32 {
        let ends = self.channels.iter().map(|channel| &channel.times).chain(self.weights.iter().map(|w| &w.times));
        ends.filter_map(|times| times.last()).fold(0.0, |a, b| a.max(*b))
    }

    /// Returns the place in the clip at a time, both in seconds.
    fn place(&self, time: f64) -> f32 {
        let (time, duration) = (time + self.offset, f64::from(self.duration()));
        if duration <= 0.0 {
            return 0.0;
        }
        (if self.hold { time.clamp(0.0, duration) } else { time.rem_euclid(duration) }) as f32
    }

    /// Returns the weights that the clip gives a node's morph targets, if it moves them.
    pub fn weights_at(&self, node: usize, time: f64) -> Option<Vec<f32>> {
        let place = self.place(time);
        self.weights.iter().find(|weights| weights.node == node).map(|weights| weights.at(place))
    }

    /// Sets the locals that the clip moves.
    pub fn apply(&self, time: f64, locals: &mut [Local]) {
        let time = self.place(time);
        for channel in self.channels.iter() {
            // An animated node has no matrix (glTF forbids it). One that does is moved from the origin.
            let mut transform = match locals[channel.node] {
                Local::Transform(transform) => transform,
                Local::Matrix(_) => Transform::IDENTITY,
            };
            let value = channel.at(time);
            match channel.property {
                Property::Translation => transform.translation = value.truncate(),
                Property::Rotation => transform.rotation = unit(value),
                Property::Scale => transform.scale = value.truncate(),
            }
            locals[channel.node] = Local::Transform(transform);
        }
    }
}

impl Weights {
    fn at(&self, time: f32) -> Vec<f32> {
        let per_key = self.join.per_key();
        let count = self.values.len() / (self.times.len() * per_key).max(1);
        let of = |target: usize| {
            let channel = Channel {
                node: self.node,
                property: Property::Translation,
                join: self.join,
                times: self.times.clone(),
                values: self.values.iter().skip(target).step_by(count).map(|value| Vec4::splat(*value)).collect(),
            };
            channel.at(time).x
        };
        (0..count).map(of).collect()
    }
}

impl Channel {
    /// Returns the value at `time` seconds, held outside the keys.
    fn at(&self, time: f32) -> Vec4 {
        let after = self.times.partition_point(|key| *key <= time);
        let per_key = self.join.per_key();
        let value = |key: usize| self.values[key * per_key + per_key / 2];
        if after == 0 || after == self.times.len() {
            return value(after.saturating_sub(1));
        }
        let before = after - 1;
        let span = self.times[after] - self.times[before];
        let t = (time - self.times[before]) / span;
        match self.join {
            Join::Step => value(before),
            Join::Linear if self.property == Property::Rotation => {
                Vec4::from(unit(value(before)).slerp(unit(value(after)), t))
            }
            Join::Linear => value(before).lerp(value(after), t),
            Join::CubicSpline => {
                let (out_tangent, in_tangent) = (self.values[before * 3 + 2] * span, self.values[after * 3] * span);
                let (t2, t3) = (t * t, t * t * t);
                value(before) * (2.0 * t3 - 3.0 * t2 + 1.0)
                    + out_tangent * (t3 - 2.0 * t2 + t)
                    + value(after) * (3.0 * t2 - 2.0 * t3)
                    + in_tangent * (t3 - t2)
            }
        }
    }
}

fn unit(value: Vec4) -> Quat {
    let quat = Quat::from_vec4(value);
    if quat.length_squared() > 1e-12 { quat.normalize() } else { Quat::IDENTITY }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn channel(join: Join, property: Property, values: &[Vec4]) -> Channel {
        Channel { node: 0, property, join, times: vec![1.0, 3.0], values: values.to_vec() }
    }

    #[test]
    fn steps_and_lines() {
        let values = [Vec4::splat(1.0), Vec4::splat(5.0)];
        let step = channel(Join::Step, Property::Scale, &values);
        assert_eq!([step.at(0.0), step.at(2.9), step.at(3.0)].map(|v| v.x), [1.0, 1.0, 5.0]);
        let line = channel(Join::Linear, Property::Scale, &values);
        assert_eq!([line.at(0.0), line.at(2.0), line.at(9.0)].map(|v| v.x), [1.0, 3.0, 5.0]);
    }

    #[test]
    fn cubic_splines_have_their_tangents() {
        let zero = Vec4::ZERO;
        // This is a straight line of slope 2 from (1, 1) to (3, 5), written as a spline.
        let values = [zero, Vec4::splat(1.0), Vec4::splat(2.0), Vec4::splat(2.0), Vec4::splat(5.0), zero];
        let spline = channel(Join::CubicSpline, Property::Translation, &values);
        for (time, expected) in [(1.0, 1.0), (1.5, 2.0), (2.0, 3.0), (2.5, 4.0), (3.0, 5.0)] {
            assert!((spline.at(time).y - expected).abs() < 1e-5);
        }
    }

    #[test]
    fn clips_repeat_and_rotations_slerp() {
        let quarter = Vec4::from(Quat::from_rotation_y(1.0));
        let clip = Clip { name: "turn".into(), ..Clip::default() };
        let clip = Clip {
            channels: [Channel {
                node: 0,
                property: Property::Rotation,
                join: Join::Linear,
                times: vec![0.0, 2.0],
                values: vec![Vec4::W, quarter],
            }]
            .into(),
            ..clip
        };
        let mut locals = [Local::Transform(Transform::IDENTITY)];
        clip.apply(2.5, &mut locals);
        let Local::Transform(transform) = locals[0] else { panic!("a transform stays one") };
        assert!(transform.rotation.angle_between(Quat::from_rotation_y(0.25)) < 1e-3);
        assert_eq!(transform.translation, glam::Vec3::ZERO);
    }

    #[test]
    fn clips_can_begin_later_and_hold_and_move_weights() {
        let weights = Weights { node: 2, join: Join::Linear, times: vec![0.0, 2.0], values: vec![0.0, 1.0, 1.0, 0.5] };
        let clip = Clip { weights: [weights].into(), ..Clip::default() };
        assert_eq!(clip.weights_at(2, 1.0), Some(vec![0.5, 0.75]));
        assert_eq!(clip.weights_at(2, 2.5), Some(vec![0.25, 0.875]), "it repeats");
        assert_eq!(clip.weights_at(1, 0.0), None);
        let late = Clip { hold: true, offset: 0.5, ..clip };
        assert_eq!(late.weights_at(2, 0.5), Some(vec![0.5, 0.75]));
        assert_eq!(late.weights_at(2, 9.0), Some(vec![1.0, 0.5]), "it holds");
    }
}
