//! Boxes around a deforming mesh wherever it is posed, found without posing its vertices.
//!
//! A vertex is a mean of where its joints would put it, so that it lies in the box around all of these places. A box of
//! the vertices that a joint moves, moved by the joint's matrix, holds the joint's share of them. A morph target moves
//! no vertex further than by its weight times its largest offset.

use super::{Deform, Stance};
use crate::scene::{
    bounds::Bounds,
    bvh,
    packed::{BvhNode, NONE},
};
use glam::{Mat4, Vec3, Vec4Swizzles};
use std::collections::BTreeMap;

/// The most groups of triangles of which boxes are known.
const MOST_GROUPS: usize = 64;

/// Where a group of vertices can be.
#[derive(Clone, Debug, Default)]
struct Reach {
    /// The joints that move them, each with the box of its vertices before it moves them.
    joints: Vec<(usize, Bounds)>,
    /// What each morph target adds to them at weight 1.
    targets: Vec<Bounds>,
}

/// The upper part of a mesh's tree, which ends in groups of triangles.
#[derive(Clone, Debug, Default)]
pub struct Outline(Vec<Part>);

#[derive(Clone, Debug)]
enum Part {
    /// Two parts that come later in the list.
    Both([usize; 2]),
    Group(Reach),
}

impl Reach {
    fn of(deform: &Deform, vertices: &[u32]) -> Self {
        let mut joints: BTreeMap<usize, Bounds> = BTreeMap::new();
        let mut targets = vec![Bounds::EMPTY; deform.targets.len()];
        for vertex in vertices.iter().map(|vertex| *vertex as usize) {
            let place = Bounds::of([deform.positions[vertex]]);
            let own = deform.influences.get(vertex).filter(|own| deform.skin.is_some() && !own.is_empty());
            // What no joint moves stays, as by a joint that the skin does not have.
            let own = own.map_or(vec![usize::MAX], |own| own.iter().map(|(joint, _)| usize::from(*joint)).collect());
            for joint in own {
                let around = joints.entry(joint).or_insert(Bounds::EMPTY);
                *around = around.union(place);
            }
            for (around, target) in targets.iter_mut().zip(&deform.targets) {
                *around = around.union(Bounds::of([target.positions.get(vertex).copied().unwrap_or_default()]));
            }
        }
        Self { joints: joints.into_iter().collect(), targets }
    }

    /// Returns the box of what the targets add with these weights.
    fn added(&self, weights: impl Iterator<Item = f32>) -> Bounds {
        let zero = Bounds { min: Vec3::ZERO, max: Vec3::ZERO };
        self.targets.iter().zip(weights).fold(zero, |sum, (target, weight)| {
            let [a, b] = [weight * target.min, weight * target.max];
            Bounds { min: sum.min + a.min(b), max: sum.max + a.max(b) }
        })
    }

    fn bounds(&self, stance: &Stance) -> Bounds {
        let added = self.added(stance.weights.iter().copied());
        let moved = |(joint, around): &(usize, Bounds)| {
            let matrix = stance.joint(*joint);
            let (middle, half) = (0.5 * (around.min + around.max + added.min + added.max), half_size(around, &added));
            let [x, y, z] = [matrix.x_axis, matrix.y_axis, matrix.z_axis].map(|axis| axis.xyz().abs());
            let far = middle.abs() + half;
            // More than single precision loses in the sums of a vertex.
            let lost = x * far.x + y * far.y + z * far.z + matrix.w_axis.xyz().abs();
            let reach = x * half.x + y * half.y + z * half.z + LOST * lost;
            let middle = matrix.transform_point3(middle);
            Bounds { min: middle - reach, max: middle + reach }
        };
        self.joints.iter().map(moved).fold(Bounds::EMPTY, Bounds::union)
    }

    /// How far a vertex goes at most from one stance to another.
    fn step(&self, now: &Stance, before: &Stance) -> f32 {
        let weight = |stance: &Stance, target: usize| stance.weights.get(target).copied().unwrap_or(0.0);
        let targets = 0..self.targets.len();
        let was = self.added(targets.clone().map(|target| weight(before, target)));
        let change = self.added(targets.map(|target| weight(now, target) - weight(before, target)));
        let longest = change.min.abs().max(change.max.abs()).length();
        let way = |(joint, around): &(usize, Bounds)| {
            let [to, from] = [now, before].map(|stance| stance.joint(*joint));
            let all = Bounds { min: around.min + was.min, max: around.max + was.max };
            // The way is an affine function of the place, so that it is longest at a corner.
            let way = |corner: Vec3| (to.transform_point3(corner) - from.transform_point3(corner)).length();
            let moved = if to == from { 0.0 } else { all.corners().into_iter().map(way).fold(0.0, f32::max) };
            moved + stretch(&to) * longest
        };
        self.joints.iter().map(way).fold(0.0, f32::max)
    }
}

/// The share of the terms of a sum that may be lost in it.
const LOST: f32 = 32.0 * f32::EPSILON;

fn half_size(a: &Bounds, b: &Bounds) -> Vec3 {
    0.5 * (a.max - a.min + b.max - b.min)
}

/// By how much a matrix makes vectors longer, at most.
fn stretch(matrix: &Mat4) -> f32 {
    let squares = [matrix.x_axis, matrix.y_axis, matrix.z_axis].map(|axis| axis.xyz().length_squared());
    squares.iter().sum::<f32>().sqrt()
}

impl Outline {
    /// Takes the upper part of a tree, whose first node has the number `root`. `corners` are those of each triangle in
    /// the mesh.
    pub fn of(deform: &Deform, nodes: &[BvhNode], root: u32, corners: impl Fn(u32) -> [u32; 3]) -> Self {
        let end = |index: usize| match nodes[index].next {
            NONE => nodes.len(),
            next => (next - root) as usize,
        };
        // The largest is divided until there are enough.
        let (mut tree, mut open) = (vec![None], vec![(0, 0)]); // a part, and its node
        while open.len() < MOST_GROUPS.min(nodes.len().div_ceil(2)) {
            let large = (0..open.len()).max_by_key(|at| end(open[*at].1) - open[*at].1);
            let Some(large) = large.filter(|at| nodes[open[*at].1].leaf == 0) else { break };
            let (part, index) = open.swap_remove(large);
            let children = [tree.len(), tree.len() + 1];
            tree[part] = Some(children);
            tree.extend([None, None]);
            open.extend(children.into_iter().zip(bvh::children(nodes, index, root)));
        }
        let reach = |index: usize| {
            let leaves = nodes[index..end(index)].iter().filter(|node| node.leaf != 0);
            let mut vertices: Vec<u32> = leaves.flat_map(bvh::leaf).flat_map(&corners).collect();
            vertices.sort_unstable();
            vertices.dedup();
            Reach::of(deform, &vertices)
        };
        let node_of = |part: usize| open.iter().find(|(other, _)| *other == part).map_or(0, |(_, index)| *index);
        let part = |(at, children): (usize, Option<[usize; 2]>)| match children {
            Some(children) => Part::Both(children),
            None => Part::Group(reach(node_of(at))),
        };
        Self(tree.into_iter().enumerate().map(part).collect())
    }

    /// Returns a box around the mesh. No vertex is outside.
    pub fn bounds(&self, stance: &Stance) -> Bounds {
        self.boxes(stance).first().copied().unwrap_or(Bounds::EMPTY)
    }

    /// Returns how far a vertex has gone from one stance to another. None has gone further.
    pub fn step(&self, now: &Stance, before: &Stance) -> f32 {
        if now == before {
            return 0.0;
        }
        let groups = self.0.iter().map(|part| match part {
            Part::Both(_) => 0.0,
            Part::Group(reach) => reach.step(now, before),
        });
        groups.fold(0.0, f32::max)
    }

    /// Returns the sum of the boxes' surfaces as a multiple of the whole's: how many of them a ray meets that meets
    /// the whole, as the surface-area heuristic has it.
    pub fn cost(&self, stance: &Stance) -> f32 {
        let boxes = self.boxes(stance);
        let whole = boxes.first().map_or(0.0, Bounds::half_area);
        if whole > 0.0 { boxes.iter().map(Bounds::half_area).sum::<f32>() / whole } else { 1.0 }
    }

    fn boxes(&self, stance: &Stance) -> Vec<Bounds> {
        let mut boxes = vec![Bounds::EMPTY; self.0.len()];
        for (at, part) in self.0.iter().enumerate().rev() {
            boxes[at] = match part {
                Part::Both([left, right]) => boxes[*left].union(boxes[*right]),
                Part::Group(reach) => reach.bounds(stance),
            };
        }
        boxes
    }
}
