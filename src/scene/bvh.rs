//! Bounding volume hierarchies: bottom levels over triangles (built once), the top level over instances
//! (every frame).
//!
//! Shaders walk both without a stack: see [`BvhNode`].

use super::{
    bounds::Bounds,
    packed::{BvhNode, NONE, PackedInstances, PackedScene},
};
use crate::{Error, Result};
use obvhs::{bvh2::leaf_collapser::collapse, bvh2::reinsertion::ReinsertionOptimizer, ploc::PlocBuilder};

/// The most triangles of a leaf.
pub const MAX_LEAF: u32 = 4;
/// No tree that the surface-area heuristic makes is deeper.
const MAX_DEPTH: u32 = 40;

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

/// Builds a tree over triangle boxes for tracing, with leaves of at most [`MAX_LEAF`]: obvhs' (PLOC with
/// reinsertion), or for a few boxes one by the surface-area heuristic.
pub fn build_bottom(boxes: &[Bounds]) -> Tree {
    build(boxes, MAX_LEAF)
}

/// Builds a tree for tracing over the boxes of leaves, each of which stays one.
pub fn build_over(leaves: &[Bounds]) -> Tree {
    build(leaves, 1)
}

fn build(boxes: &[Bounds], max_leaf: u32) -> Tree {
    let large = boxes.len() > MAX_LEAF as usize;
    large.then(|| build_obvhs(boxes, max_leaf)).flatten().unwrap_or_else(|| build_sweep(boxes, max_leaf))
}

/// Builds a tree over instance boxes, with leaves of one.
pub fn build_top(boxes: &[Bounds]) -> Tree {
    build_sweep(boxes, 1)
}

fn build_obvhs(boxes: &[Bounds], max_leaf: u32) -> Option<Tree> {
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
    if max_leaf > 1 {
        collapse(&mut bvh, max_leaf, params.collapse_traversal_cost);
    }
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
        if index as usize > 2 * boxes.len() || node.prim_count > max_leaf {
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
fn build_sweep(boxes: &[Bounds], max_leaf: u32) -> Tree {
    let mut tree = Tree { nodes: Vec::new(), order: (0..boxes.len() as u32).collect() };
    if boxes.is_empty() {
        return tree;
    }
    let mut order = std::mem::take(&mut tree.order);
    split(&mut tree, boxes, &mut order, 0, max_leaf, MAX_DEPTH);
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

    /// Returns the nodes for the GPU, the root first; nothing if the tree is empty. They begin at the index
    /// `first_node`. Leaves hold `leaf(first of the run in order)`.
    pub fn pack(&self, first_node: u32, leaf: impl Fn(u32) -> u32) -> Vec<BvhNode> {
        let mut next = vec![NONE; self.nodes.len()];
        let pack = |(index, node): (usize, &TreeNode)| {
            if node.count == 0 {
                next[node.first as usize] = first_node + node.second;
                next[node.second as usize] = next[index];
            }
            let Bounds { min, max } = node.bounds.padded();
            let leaf = if node.count > 0 { leaf(node.first) << 3 | node.count } else { 0 };
            BvhNode { min, leaf, max, next: next[index] }
        };
        self.nodes.iter().enumerate().map(pack).collect()
    }
}

/// The run of triangles, or the instance, that a leaf holds. Empty in an inner node.
pub fn leaf(node: &BvhNode) -> std::ops::Range<u32> {
    node.leaf >> 3..(node.leaf >> 3) + (node.leaf & 7)
}

/// The children of inner node `index` of a tree whose first node has the number `root`.
pub fn children(nodes: &[BvhNode], index: usize, root: u32) -> [usize; 2] {
    let left = index + 1;
    [left, (nodes[left].next - root) as usize]
}

/// Checks the tree from `root` on. All boxes are inside those above them. Returns its leaves, and the index
/// behind its last node.
fn check_tree(nodes: &[BvhNode], root: u32) -> Result<(Vec<BvhNode>, u32)> {
    let broken = |what: String| Err(Error::Internal(format!("broken BVH: {what}")));
    let (mut index, mut leaves) = (root, Vec::new());
    // What is open: the box, and the node behind all that is within.
    let mut around: Vec<(Bounds, u32)> = Vec::new();
    loop {
        let Some(node) = nodes.get(index as usize) else {
            return broken(format!("node {index} is not there"));
        };
        while around.last().is_some_and(|(_, next)| *next == index) {
            around.pop();
        }
        let bounds = Bounds { min: node.min, max: node.max };
        if let Some((outer, next)) = around.last() {
            if !outer.contains(&bounds) {
                return broken(format!("node {index} is outside the box around it"));
            }
            if node.next > *next {
                return broken(format!("node {index} goes on to node {}, past the one around it", node.next));
            }
        }
        if node.next != NONE && node.next as usize >= nodes.len() {
            return broken(format!("node {index} goes on to node {}, which is not there", node.next));
        }
        if node.next != NONE && node.next <= index {
            return broken(format!("node {index} goes back to node {}", node.next));
        }
        if node.leaf == 0 {
            around.push((bounds, node.next));
        } else {
            leaves.push(*node);
            if node.next == NONE {
                return Ok((leaves, index + 1));
            }
            if node.next != index + 1 {
                return broken(format!("leaf {index} goes on to node {}", node.next));
            }
        }
        index += 1;
    }
}

/// Checks the bottom levels. Every triangle is in exactly one leaf and inside its box, and every box inside
/// those above it.
///
/// # Errors
/// Fails with [`Error::Internal`] if something is broken, and says what.
pub fn check(scene: &PackedScene) -> Result<()> {
    let broken = |what: String| Err(Error::Internal(format!("broken BVH: {what}")));
    let mut seen = vec![0_u32; scene.triangles.len()];
    let mut root = 0;
    while (root as usize) < scene.nodes.len() {
        let (leaves, end) = check_tree(&scene.nodes, root)?;
        for node in leaves {
            if leaf(&node).len() as u32 > MAX_LEAF {
                return broken(format!("a leaf of {}", leaf(&node).len()));
            }
            for triangle in leaf(&node) {
                let Some(geometry) = scene.triangles.get(triangle as usize) else {
                    return broken(format!("triangle {triangle} is not there"));
                };
                seen[triangle as usize] += 1;
                let corners = [geometry.v0, geometry.v0 + geometry.e1, geometry.v0 + geometry.e2];
                if !(Bounds { min: node.min, max: node.max }).contains(&Bounds::of(corners)) {
                    return broken(format!("triangle {triangle} is outside the box of its leaf"));
                }
            }
        }
        root = end;
    }
    match seen.iter().position(|count| *count != 1) {
        Some(triangle) => broken(format!("triangle {triangle} is in {} leaves", seen[triangle])),
        None => Ok(()),
    }
}

/// Checks the top level. Every instance is in exactly one leaf, and its bottom level exists.
///
/// # Errors
/// Fails with [`Error::Internal`] if something is broken, and says what.
pub fn check_top(scene: &PackedScene, frame: &PackedInstances) -> Result<()> {
    let broken = |what: String| Err(Error::Internal(format!("broken top-level BVH: {what}")));
    let mut seen = vec![0_u32; frame.instances.len()];
    if !frame.nodes.is_empty() {
        let (leaves, end) = check_tree(&frame.nodes, 0)?;
        for node in leaves {
            match seen.get_mut((node.leaf >> 3) as usize) {
                Some(count) if node.leaf & 7 == 1 => *count += 1,
                _ => return broken(format!("a leaf of {:?}", leaf(&node))),
            }
        }
        if end as usize != frame.nodes.len() {
            return broken(format!("{} nodes, but {end} in the tree", frame.nodes.len()));
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
