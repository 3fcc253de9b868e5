//! The bottom levels of meshes that change their shape.
//!
//! Which node is in which stays from frame to frame, and their boxes are fitted anew. Where a mesh has bent so far that
//! this costs, its tree is built anew over the same leaves, so that no triangle and no node changes its place.

use crate::{
    Result,
    gpu::{Buffer, Frame, Gpu},
    gpu_struct,
    scene::{
        bvh,
        deform::{Outline, Placed, Pose, Stance},
        packed::BvhNode,
    },
};
use std::{ops::Range, sync::Arc};

gpu_struct! {
    /// What does not change in a node: its leaf, and the node behind all that is within.
    pub struct Link { pub leaf: u32, pub next: u32 }
}

/// A tree is built anew where rays meet this many times as many of its boxes as when it was built.
pub const RISE: f32 = 4.0 / 3.0;

pub(super) struct Trees {
    trees: Vec<Tree>,
    /// The nodes by their height above leaves, as indices from the first tree's root.
    sorted: Vec<u32>,
    /// The nodes of each height, in that order.
    pub levels: Vec<Range<u32>>,
    pub links: Buffer,
    pub order: Buffer,
    /// How often a tree was built anew.
    pub rebuilds: u32,
}

struct Tree {
    placed: Arc<Placed>,
    nodes: Vec<BvhNode>,
    outline: Outline,
    /// What it cost when it was built.
    cost: f32,
}

impl Trees {
    pub fn new(gpu: &Gpu, all: &[Arc<Placed>]) -> Result<Self> {
        let tree = |placed: &Arc<Placed>| Tree {
            placed: placed.clone(),
            nodes: placed.nodes.clone(),
            outline: placed.outline.clone(),
            cost: placed.outline.cost(&placed.rest),
        };
        let nodes: usize = all.iter().map(|placed| placed.nodes.len()).sum();
        let mut trees = Self {
            trees: all.iter().map(tree).collect(),
            sorted: Vec::new(),
            levels: Vec::new(),
            links: gpu.buffer("links of nodes", (nodes * size_of::<Link>()) as u64)?,
            order: gpu.buffer("order of nodes", (nodes * size_of::<u32>()) as u64)?,
            rebuilds: 0,
        };
        trees.sort();
        Ok(trees)
    }

    /// Builds those trees anew that have become costly. Says whether any has.
    pub fn renew(&mut self, poses: &[Pose]) -> bool {
        let costly = |tree: &Tree, stance: &Stance| tree.outline.cost(stance) > RISE * tree.cost;
        let mut any = false;
        for (tree, pose) in self.trees.iter_mut().zip(poses).filter(|(tree, pose)| costly(tree, &pose.now)) {
            tree.build(&pose.now);
            self.rebuilds += 1;
            any = true;
        }
        if any {
            self.sort();
        }
        any
    }

    /// Records the upload of what the boxes are fitted by.
    pub fn upload(&self, frame: &mut Frame) -> Result<()> {
        let nodes = self.trees.iter().flat_map(|tree| &tree.nodes);
        let links: Vec<_> = nodes.map(|node| Link { leaf: node.leaf, next: node.next }).collect();
        frame.write_buffer(&self.links, 0, &links)?;
        frame.write_buffer(&self.order, 0, &self.sorted)
    }

    /// Sorts nodes by height.
    fn sort(&mut self) {
        let mut levels: Vec<Vec<u32>> = Vec::new();
        let mut first = 0;
        for Tree { placed, nodes, .. } in &self.trees {
            let mut heights = vec![0; nodes.len()];
            // Children come after their parent.
            for index in (0..nodes.len()).rev() {
                if nodes[index].leaf == 0 {
                    heights[index] = 1 + bvh::children(nodes, index, placed.root)
                        .map(|at| heights[at])
                        .into_iter()
                        .fold(0, usize::max);
                }
                if levels.len() <= heights[index] {
                    levels.resize_with(heights[index] + 1, Vec::new);
                }
                levels[heights[index]].push(first + index as u32);
            }
            first += nodes.len() as u32;
        }
        let mut end = 0;
        let range = |level: &Vec<u32>| {
            end += level.len() as u32;
            end - level.len() as u32..end
        };
        self.levels = levels.iter().map(range).collect();
        self.sorted = levels.concat();
    }
}

impl Tree {
    /// Builds it anew over its leaves, for a mesh that stands like this.
    fn build(&mut self, stance: &Stance) {
        let placed = &self.placed;
        let triangles = placed.triangles(&placed.deform.pose(stance).positions);
        let leaves: Vec<BvhNode> = self.nodes.iter().filter(|node| node.leaf != 0).copied().collect();
        let boxes: Vec<_> = leaves.iter().map(|leaf| placed.around(leaf, &triangles)).collect();
        let tree = bvh::build_over(&boxes);
        let mut nodes = tree.pack(placed.root, |first| tree.order[first as usize]);
        for node in nodes.iter_mut().filter(|node| node.leaf != 0) {
            node.leaf = leaves[(node.leaf >> 3) as usize].leaf;
        }
        if nodes.len() == self.nodes.len() {
            self.outline = placed.outline_of(&nodes);
            self.nodes = nodes;
        }
        self.cost = self.outline.cost(stance);
        tracing::debug!("the tree of {} triangles was built anew", triangles.len());
    }
}
