//! `deform`: poses the meshes that change their shape, on the device, in each frame in which one does.
//!
//! Rest vertices, influences and morph targets are there from the start. A frame brings matrices and weights. What the
//! triangles were is kept as the frame before, so that each pose is made once.

mod rest;
mod trees;

use super::resources::{Kernel, Resource, Resources};
use crate::{
    Error, Result,
    gpu::{Buffer, Frame, Gpu, Threads},
    gpu_struct,
    scene::{
        deform::{Pose, Stance},
        packed::PackedScene,
    },
    shaders,
};
use glam::Mat4;
pub use rest::{Delta, Influence, RestVertex};
use trees::Trees;
pub use trees::{Link, RISE};

gpu_struct! {
    /// Push constants of `deform*.comp`.
    pub struct DeformPush {
        pub first: u32, pub count: u32,
        pub first_triangle: u32, pub first_vertex: u32, pub first_node: u32,
    }
}

/// The pass, and what it keeps on the device.
pub struct Deform {
    vertices: Kernel,
    triangles: Kernel,
    search: Search,
    resources: Resources,
    joints: Buffer,
    weights: Buffer,
    /// Morph targets of each mesh.
    targets: Vec<usize>,
    /// What all dispatches are told.
    push: DeformPush,
    vertex_count: u32,
    triangle_count: u32,
    /// What the device holds, if that is known.
    held: Option<Held>,
    /// What it holds once the frame that is being recorded has run.
    holding: Option<Held>,
}

/// What rays search, besides triangles.
enum Search {
    /// Boxes, fitted around what is posed.
    Boxes(Kernel, Trees),
    /// What hardware builds of corners.
    Corners(Kernel, Buffer),
}

/// What the meshes are posed by.
type Stances = Vec<Stance>;

/// The poses of the triangles on the device: now, and a frame ago.
#[derive(PartialEq)]
struct Held {
    now: Stances,
    before: Stances,
}

impl Deform {
    /// Uploads what does not change of the scene's deforming meshes. `ray_queries` says whether rays meet them by ray
    /// queries. `None` if the scene has no such meshes.
    ///
    /// # Errors
    /// Fails if something does not fit the device.
    pub fn new(gpu: &Gpu, scene: &PackedScene, ray_queries: bool) -> Result<Option<Self>> {
        let Some(first) = scene.deforming.first() else { return Ok(None) };
        let all = &scene.deforming;
        let rest = rest::Arrays::of(all);
        let (vertex_count, triangle_count) =
            (rest.vertices.len() as u32 - 1, scene.triangles.len() as u32 - scene.first_deformed);
        let joints: usize = all.iter().map(|placed| placed.rest.joints.len()).sum();
        let targets: Vec<usize> = all.iter().map(|placed| placed.deform.targets.len()).collect();
        let joints = gpu.buffer("joints", ((1 + joints) * 3 * size_of::<[f32; 4]>()) as u64)?;
        let weights = gpu.buffer("weights", (targets.iter().sum::<usize>() * size_of::<f32>()) as u64)?;
        let mut resources = Resources::default();
        let mut add = |name, buffer: &Buffer| resources.add(name, Resource::Buffer(buffer.clone()));
        add("rest_vertices", &gpu.buffer_with("rest vertices", &rest.vertices)?);
        add("influences", &gpu.buffer_with("influences", &rest.influences)?);
        add("deltas", &gpu.buffer_with("deltas", &rest.deltas)?);
        add("joints", &joints);
        add("weights", &weights);
        add("posed", &gpu.buffer("posed", u64::from(vertex_count) * 12)?);
        let kernel = |name, spirv| Kernel::new::<DeformPush>(gpu, name, spirv, &[]);
        let search = if ray_queries {
            let corners = gpu.build_input("corners", u64::from(triangle_count) * 36)?;
            add("corners", &corners);
            Search::Corners(kernel("deform_corners", shaders::DEFORM_CORNERS)?, corners)
        } else {
            let trees = Trees::new(gpu, all)?;
            add("links", &trees.links);
            add("order", &trees.order);
            Search::Boxes(kernel("deform_boxes", shaders::DEFORM_BOXES)?, trees)
        };
        let push = DeformPush {
            first_triangle: scene.first_deformed,
            first_vertex: first.first_vertex,
            first_node: first.root,
            ..Default::default()
        };
        Ok(Some(Self {
            vertices: kernel("deform", shaders::DEFORM)?,
            triangles: kernel("deform_triangles", shaders::DEFORM_TRIANGLES)?,
            search,
            resources,
            joints,
            weights,
            targets,
            push,
            vertex_count,
            triangle_count,
            held: None,
            holding: None,
        }))
    }

    /// The corners of which hardware builds what ray queries search, three of each triangle.
    pub fn corners(&self) -> Option<&Buffer> {
        match &self.search {
            Search::Boxes(..) => None,
            Search::Corners(_, corners) => Some(corners),
        }
    }

    /// How often a tree was built anew, because its boxes had grown too large.
    pub fn rebuilds(&self) -> u32 {
        match &self.search {
            Search::Boxes(_, trees) => trees.rebuilds,
            Search::Corners(..) => 0,
        }
    }

    /// Records what brings the triangles to a frame's poses, where they differ from what the device holds. `scene` has
    /// the tables that tracers read.
    ///
    /// # Errors
    /// Fails with [`Error::Internal`] if the poses are of other meshes.
    pub fn record(&mut self, frame: &mut Frame, scene: &Resources, poses: &[Pose]) -> Result<()> {
        if poses.len() != self.targets.len() {
            let problem = format!("{} poses of {} deforming meshes", poses.len(), self.targets.len());
            return Err(Error::Internal(problem));
        }
        let stances = |of: fn(&Pose) -> &Stance| poses.iter().map(|pose| of(pose).clone()).collect::<Vec<_>>();
        let wanted = Held { now: stances(|pose| &pose.now), before: stances(|pose| &pose.before) };
        let held = self.held.take();
        if held.as_ref() == Some(&wanted) {
            self.holding = held;
            return Ok(());
        }
        frame.scope("deform", |frame| {
            if let Search::Boxes(_, trees) = &mut self.search
                && (trees.renew(poses) || held.is_none())
            {
                trees.upload(frame)?;
            }
            if held.is_none_or(|held| held.now != wanted.before) {
                self.pose(frame, scene, &wanted.before)?;
                frame.barrier("the next pose takes this one's place");
            }
            self.pose(frame, scene, &wanted.now)?;
            self.fit(frame, scene)
        })?;
        self.holding = Some(wanted);
        Ok(())
    }

    /// Notes that the frame recorded last was submitted.
    pub fn submitted(&mut self) {
        self.held = self.holding.take();
    }

    /// Poses vertices and triangles. What the triangles were becomes the frame before.
    fn pose(&self, frame: &mut Frame, scene: &Resources, stances: &[Stance]) -> Result<()> {
        let rows = |matrix: &Mat4| [0, 1, 2].map(|row| matrix.row(row).to_array());
        let joints = stances.iter().flat_map(|stance| &stance.joints);
        let joints: Vec<_> = std::iter::once(&Mat4::IDENTITY).chain(joints).map(rows).collect();
        frame.write_buffer(&self.joints, 0, joints.as_flattened())?;
        let own = |(stance, targets): (&Stance, &usize)| {
            let mut weights = stance.weights.clone();
            weights.resize(*targets, 0.0);
            weights
        };
        let weights: Vec<f32> = stances.iter().zip(&self.targets).flat_map(own).collect();
        if !weights.is_empty() {
            frame.write_buffer(&self.weights, 0, &weights)?;
        }
        frame.barrier("deform reads matrices and weights that were uploaded");
        self.dispatch(frame, &self.vertices, scene, [0, self.vertex_count])?;
        frame.barrier("triangles are made of posed vertices");
        self.dispatch(frame, &self.triangles, scene, [0, self.triangle_count])
    }

    /// Makes what rays search of the posed triangles.
    fn fit(&self, frame: &mut Frame, scene: &Resources) -> Result<()> {
        match &self.search {
            Search::Boxes(kernel, trees) => trees.levels.iter().try_for_each(|level| {
                frame.barrier("boxes are fitted around those within, or around triangles");
                self.dispatch(frame, kernel, scene, [level.start, level.len() as u32])
            }),
            Search::Corners(kernel, _) => self.dispatch(frame, kernel, scene, [0, self.triangle_count]),
        }
    }

    fn dispatch(&self, frame: &mut Frame, kernel: &Kernel, scene: &Resources, [first, count]: [u32; 2]) -> Result<()> {
        // as in `bind/deform.glsl`
        const ROW: u32 = 65536;
        let threads = Threads::Size([count.min(ROW), count.div_ceil(ROW), 1]);
        let push = DeformPush { first, count, ..self.push };
        kernel.dispatch(frame, &[], &[&self.resources, scene], &push, threads)
    }
}
