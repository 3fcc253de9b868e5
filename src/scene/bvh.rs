//! Bounding volume hierarchies: bottom levels over triangles (built once), the top level over instances
//! (every frame).
//!
//! The shader walks both with one stack of [`STACK`] entries and pushes at most one entry a node. The depths
//! of both (inner nodes on the longest path) together therefore never exceed it.

use super::{
    bounds::Bounds,
    packed::{BvhNode, NONE, PackedInstances, PackedScene},
};
use crate::{Error, Result};
use glam::Vec3;
use obvhs::{bvh2::leaf_collapser::collapse, bvh2::reinsertion::ReinsertionOptimizer, ploc::PlocBuilder};

/// Entries of the traversal stack in `shaders/glsl`.
pub const STACK: u32 = 48;
/// No bottom level is deeper, even with few instances.
pub const MAX_BOTTOM_DEPTH: u32 = 40;
/// The most triangles of a leaf.
pub const MAX_LEAF: u32 = 4;

/// Returns the greatest depth of a top level over this many instances.
pub fn top_depth(instances: usize) -> u32 {
    instances.next_power_of_two().trailing_zeros().max(1)
}

/// Returns how deep a bottom level may be under a top level over this many instances.
pub fn bottom_depth_limit(instances: usize) -> u32 {
    MAX_BOTTOM_DEPTH.min(STACK.saturating_sub(top_depth(instances)))
}

/// A binary tree over boxes. Node 0 is its root, and children come after their parent.
#[derive(Clone, Debug)]
pub struct Tree {
    nodes: Vec<TreeNode>,
    /// Box indices. Each leaf is a run of these.
    pub order: Vec<u32>,
}

#[derive(Clone, Copy, Debug)]
struct TreeNode {
    bounds: Bounds,
    /// In a leaf (`count > 0`) the run in `order`. In an inner node `first` is the left child.
    first: u32,
    second: u32,
    count: u32,
}

/// Builds a tree over triangle boxes for tracing, with leaves of at most [`MAX_LEAF`] and no deeper than
/// `max_depth`.
///
/// The tree is obvhs' (PLOC with reinsertion) unless that is too deep. Then the surface-area heuristic runs
/// under a depth limit.
pub fn build_bottom(boxes: &[Bounds], max_depth: u32) -> Tree {
    if boxes.len() > MAX_LEAF as usize
        && let Some(tree) = build_obvhs(boxes)
        && tree.depth() <= max_depth
    {
        return tree;
    }
    build_sweep(boxes, MAX_LEAF, max_depth)
}

/// Builds a tree over instance boxes, with leaves of one and no deeper than [`top_depth`] of their number.
pub fn build_top(boxes: &[Bounds]) -> Tree {
    build_sweep(boxes, 1, top_depth(boxes.len()))
}

fn build_obvhs(boxes: &[Bounds]) -> Option<Tree> {
    let aabbs: Vec<_> = boxes
        .iter()
        .map(|b| obvhs::aabb::Aabb { min: b.min.to_array().into(), max: b.max.to_array().into() })
        .collect();
    // The best preset except for pre-splitting, which would put a triangle into several leaves.
    let params = obvhs::BvhBuildParams::very_slow_build();
    let indices = (0..boxes.len() as u32).collect();
    let mut bvh = PlocBuilder::with_capacity(boxes.len()).build(
        params.ploc_search_distance,
        &aabbs,
        indices,
        params.sort_precision,
        params.search_depth_threshold,
    );
    // In a large mesh reinsertion takes most of the time.
    let effort = params.reinsertion_batch_ratio.min(100_000.0 / boxes.len() as f32);
    let mut optimizer = ReinsertionOptimizer::default();
    optimizer.run(&mut bvh, effort, None);
    collapse(&mut bvh, MAX_LEAF, params.collapse_traversal_cost);
    optimizer.run(&mut bvh, effort * params.post_collapse_reinsertion_batch_ratio_multiplier, None);

    let mut tree = Tree { nodes: Vec::new(), order: Vec::with_capacity(boxes.len()) };
    let mut stack = vec![(0_u32, None)];
    while let Some((source, slot)) = stack.pop() {
        let node = bvh.nodes.get(source as usize)?;
        let index = tree.nodes.len() as u32;
        if let Some((parent, second)) = slot {
            let parent: &mut TreeNode = &mut tree.nodes[parent as usize];
            *(if second { &mut parent.second } else { &mut parent.first }) = index;
        }
        if index as usize > 2 * boxes.len() || node.prim_count > MAX_LEAF {
            return None;
        }
        let first = tree.order.len() as u32;
        let run = node.first_index as usize..(node.first_index + node.prim_count) as usize;
        if node.prim_count > 0 {
            tree.order.extend_from_slice(bvh.primitive_indices.get(run)?);
        } else {
            stack.push((node.first_index + 1, Some((index, true))));
            stack.push((node.first_index, Some((index, false))));
        }
        tree.nodes.push(TreeNode { bounds: Bounds::EMPTY, first, second: NONE, count: node.prim_count });
    }
    tree.refit(boxes);
    Some(tree)
}

/// Splits by the surface-area heuristic, sorted along each axis. A split is never so uneven that the rest
/// would not fit into the depth that is left.
fn build_sweep(boxes: &[Bounds], max_leaf: u32, max_depth: u32) -> Tree {
    let mut tree = Tree { nodes: Vec::new(), order: (0..boxes.len() as u32).collect() };
    if boxes.is_empty() {
        return tree;
    }
    let mut order = std::mem::take(&mut tree.order);
    split(&mut tree, boxes, &mut order, 0, max_leaf, max_depth);
    tree.order = order;
    tree.refit(boxes);
    tree
}

fn split(tree: &mut Tree, boxes: &[Bounds], items: &mut [u32], first: u32, max_leaf: u32, depth_left: u32) -> u32 {
    let index = tree.nodes.len() as u32;
    let count = items.len() as u32;
    tree.nodes.push(TreeNode { bounds: Bounds::EMPTY, first, second: NONE, count });
    if count <= max_leaf {
        return index;
    }
    let room = u64::from(max_leaf) << (depth_left.saturating_sub(1)).min(40);
    let room = usize::try_from(room).unwrap_or(usize::MAX);
    let center = |item: &u32, axis: usize| boxes[*item as usize].center()[axis];
    let sort = |items: &mut [u32], axis: usize| {
        items.sort_by(|a, b| center(a, axis).total_cmp(&center(b, axis)).then(a.cmp(b)));
    };
    let mut best = (f32::INFINITY, 0, items.len() / 2);
    for axis in 0..3 {
        sort(items, axis);
        let mut right_areas = vec![0.0; items.len()];
        let mut right = Bounds::EMPTY;
        for (i, item) in items.iter().enumerate().rev() {
            right = right.union(boxes[*item as usize]);
            right_areas[i] = right.half_area();
        }
        let mut left = Bounds::EMPTY;
        for i in 1..items.len() {
            left = left.union(boxes[items[i - 1] as usize]);
            let cost = left.half_area() * i as f32 + right_areas[i] * (items.len() - i) as f32;
            if i <= room && items.len() - i <= room && cost < best.0 {
                best = (cost, axis, i);
            }
        }
    }
    let (_, axis, at) = best;
    sort(items, axis);
    let (left, right) = items.split_at_mut(at);
    let left_child = split(tree, boxes, left, first, max_leaf, depth_left.saturating_sub(1));
    let right_child = split(tree, boxes, right, first + at as u32, max_leaf, depth_left.saturating_sub(1));
    tree.nodes[index as usize] = TreeNode { bounds: Bounds::EMPTY, first: left_child, second: right_child, count: 0 };
    index
}

impl Tree {
    fn refit(&mut self, boxes: &[Bounds]) {
        for index in (0..self.nodes.len()).rev() {
            let node = self.nodes[index];
            self.nodes[index].bounds = if node.count > 0 {
                let run = &self.order[node.first as usize..(node.first + node.count) as usize];
                run.iter().fold(Bounds::EMPTY, |b, item| b.union(boxes[*item as usize]))
            } else {
                self.nodes[node.first as usize].bounds.union(self.nodes[node.second as usize].bounds)
            };
        }
    }

    /// Returns the box around everything.
    pub fn bounds(&self) -> Bounds {
        self.nodes.first().map_or(Bounds::EMPTY, |root| root.bounds)
    }

    /// Returns the number of inner nodes on the longest path. A lone leaf counts 1, because it is packed into
    /// a node.
    pub fn depth(&self) -> u32 {
        let mut depths = vec![0; self.nodes.len()];
        for (index, node) in self.nodes.iter().enumerate().filter(|(_, node)| node.count == 0) {
            let below = depths[index] + 1;
            depths[node.first as usize] = below;
            depths[node.second as usize] = below;
        }
        depths.into_iter().max().unwrap_or(0).max(1)
    }

    /// Returns the nodes for the GPU, the root first; nothing if the tree is empty. Inner children become
    /// `first_node` plus their place in the result. Leaves hold `leaf(first of the run in order)`.
    pub fn pack(&self, first_node: u32, leaf: impl Fn(u32) -> u32) -> Vec<BvhNode> {
        let mut packed_index = vec![NONE; self.nodes.len()];
        let inner = (0..self.nodes.len()).filter(|index| self.nodes[*index].count == 0);
        for (index, packed) in inner.zip(first_node..) {
            packed_index[index] = packed;
        }
        let side = |index: u32| {
            let node = &self.nodes[index as usize];
            let child = if node.count > 0 { leaf(node.first) } else { packed_index[index as usize] };
            (node.bounds.padded(), child, node.count)
        };
        let node = |(b0, child0, count0): (Bounds, u32, u32), (b1, child1, count1): (Bounds, u32, u32)| BvhNode {
            min0: b0.min,
            child0,
            max0: b0.max,
            count0,
            min1: b1.min,
            child1,
            max1: b1.max,
            count1,
        };
        match self.nodes.first() {
            None => Vec::new(),
            Some(root) if root.count > 0 => vec![node(side(0), (Bounds::EMPTY, NONE, 0))],
            Some(_) => {
                let inner = self.nodes.iter().filter(|node| node.count == 0);
                inner.map(|inner| node(side(inner.first), side(inner.second))).collect()
            }
        }
    }
}

/// Returns the two children of a node: box, child, count.
pub fn sides(node: &BvhNode) -> [(Bounds, u32, u32); 2] {
    [
        (Bounds { min: node.min0, max: node.max0 }, node.child0, node.count0),
        (Bounds { min: node.min1, max: node.max1 }, node.child1, node.count1),
    ]
}

/// Checks the bottom levels. Every node has at most one parent. Every triangle is in exactly one leaf and
/// inside all boxes above it. No path is longer than [`MAX_BOTTOM_DEPTH`]. All indices exist.
///
/// # Errors
/// Fails with [`Error::Internal`] if something is broken, and says what.
pub fn check(scene: &PackedScene) -> Result<()> {
    let broken = |what: String| Err(Error::Internal(format!("broken BVH: {what}")));
    let mut parents = vec![0_u32; scene.nodes.len()];
    for (index, node) in scene.nodes.iter().enumerate() {
        for (_, child, count) in sides(node) {
            if count == 0 && child != NONE {
                match parents.get_mut(child as usize) {
                    Some(parents) => *parents += 1,
                    None => return broken(format!("node {index} names node {child}, which is not there")),
                }
            }
        }
    }
    let mut seen = vec![0_u32; scene.triangles.len()];
    let mut visited = 0;
    for root in (0..scene.nodes.len()).filter(|node| parents[*node] == 0) {
        let everywhere = Bounds { min: Vec3::NEG_INFINITY, max: Vec3::INFINITY };
        let mut stack = vec![(root as u32, everywhere, 1)];
        while let Some((index, around, depth)) = stack.pop() {
            visited += 1;
            if depth > MAX_BOTTOM_DEPTH {
                return broken(format!("node {index} is {depth} deep"));
            }
            for (bounds, child, count) in sides(&scene.nodes[index as usize]) {
                if child == NONE && count == 0 {
                    continue;
                }
                if !around.contains(&bounds) {
                    return broken(format!("node {index} has a child outside its box"));
                }
                if count == 0 {
                    stack.push((child, bounds, depth + 1));
                    continue;
                }
                if count > MAX_LEAF {
                    return broken(format!("node {index} has a leaf of {count}"));
                }
                for triangle in child..child.saturating_add(count) {
                    let Some(geometry) = scene.triangles.get(triangle as usize) else {
                        return broken(format!("node {index} names triangle {triangle}, which is not there"));
                    };
                    seen[triangle as usize] += 1;
                    let corners = [geometry.v0, geometry.v0 + geometry.e1, geometry.v0 + geometry.e2];
                    if !bounds.contains(&Bounds::of(corners)) {
                        return broken(format!("triangle {triangle} is outside the box of its leaf"));
                    }
                }
            }
        }
    }
    // A cycle has no root, and a node with two parents is visited twice.
    if visited != scene.nodes.len() || parents.iter().any(|parents| *parents > 1) {
        return broken("its nodes are not trees".into());
    }
    match seen.iter().position(|count| *count != 1) {
        Some(triangle) => broken(format!("triangle {triangle} is in {} leaves", seen[triangle])),
        None => Ok(()),
    }
}

/// Checks the top level. Every instance is in exactly one leaf, and roots and child indices exist.
///
/// # Errors
/// Fails with [`Error::Internal`] if something is broken, and says what.
pub fn check_top(scene: &PackedScene, frame: &PackedInstances) -> Result<()> {
    let broken = |what: String| Err(Error::Internal(format!("broken top-level BVH: {what}")));
    let mut seen = vec![0_u32; frame.instances.len()];
    let mut stack: Vec<(u32, u32)> = if frame.nodes.is_empty() { vec![] } else { vec![(0, 1)] };
    while let Some((index, depth)) = stack.pop() {
        let Some(node) = frame.nodes.get(index as usize) else {
            return broken(format!("no node {index}"));
        };
        if depth > top_depth(frame.instances.len()) {
            return broken(format!("node {index} is {depth} deep"));
        }
        for (_, child, count) in sides(node) {
            match (child, count) {
                (NONE, 0) => {}
                (_, 0) => stack.push((child, depth + 1)),
                (_, 1) if (child as usize) < seen.len() => seen[child as usize] += 1,
                _ => return broken(format!("node {index} has a leaf of {count} from {child}")),
            }
        }
    }
    if let Some(index) = seen.iter().position(|count| *count != 1) {
        return broken(format!("instance {index} is in {} leaves", seen[index]));
    }
    match frame.instances.iter().find(|instance| instance.root as usize >= scene.nodes.len()) {
        Some(instance) => broken(format!("instance id {} has no bottom level", instance.id)),
        None => Ok(()),
    }
}
