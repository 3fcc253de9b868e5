//! `acceleration`: builds what ray queries search (`virtual_tracer = ray_query`) on the device: a structure of
//! triangles for each mesh, once, or in each frame in which it has changed its shape, and one of all instances in each
//! frame in which one has moved.

use crate::{
    Error, Result,
    gpu::{Acceleration, Buffer, Frame, Gpu, Placed},
    scene::{
        bvh,
        deform::Stance,
        packed::{Instance, NONE, PackedInstances, PackedScene, TriangleGeometry},
    },
};
use glam::Vec3;
use std::ops::Range;

/// The structures, and what they are built of.
pub struct AccelerationBuild {
    meshes: Vec<Mesh>,
    /// Of all instances, in their order. An instance's own index is the first triangle of its mesh.
    pub top: Acceleration,
    placed: Buffer,
    /// The first triangle of the meshes that change their shape, and the corners of all from there on, if any do.
    first_deformed: u32,
    corners: Option<Buffer>,
    scratch: Buffer,
    /// What the structures hold, if that is known.
    built: Option<Input>,
    /// What the frame that is being recorded builds.
    building: Option<Input>,
}

/// A mesh: its bottom level in the BVH, and its structure.
struct Mesh {
    root: u32,
    triangles: Range<u32>,
    structure: Acceleration,
}

/// What the structures are built of, besides meshes that keep their shape.
#[derive(PartialEq)]
struct Input {
    placed: Vec<Placed>,
    stances: Vec<Stance>,
}

impl AccelerationBuild {
    /// Builds the structures of all meshes. `instances` is the largest number of instances in any frame. `corners` are
    /// those that the pass `deform` writes, if it runs.
    ///
    /// # Errors
    /// Fails if the device has no ray queries or lacks memory.
    pub fn new(gpu: &Gpu, scene: &PackedScene, instances: usize, corners: Option<&Buffer>) -> Result<Self> {
        let meshes = meshes(scene).into_iter().map(|(root, triangles)| {
            let structure = gpu.triangles(&format!("mesh at node {root}"), triangles.len() as u32)?;
            Ok(Mesh { root, triangles, structure })
        });
        let meshes = meshes.collect::<Result<Vec<_>>>()?;
        let structures = meshes.iter().map(|mesh| mesh.structure.clone()).collect();
        let top = gpu.instances("instances to trace", instances as u32, structures)?;
        let all = meshes.iter().map(|mesh| &mesh.structure).chain([&top]);
        let scratch = gpu.build_scratch(all.map(Acceleration::scratch_bytes).max().unwrap_or(0))?;

        let at_rest = at_rest(&scene.triangles);
        let rest = gpu.build_input("corners at rest", size_of_val(&at_rest[..]) as u64)?;
        let mut frame = gpu.frame()?;
        frame.write_buffer(&rest, 0, &at_rest)?;
        for mesh in &meshes {
            frame.barrier("meshes are built of their corners, one after the other in the same scratch memory");
            frame.build(&mesh.structure, &rest, [mesh.triangles.start, mesh.triangles.len() as u32], &scratch)?;
        }
        frame.run()?;
        Ok(Self {
            meshes,
            top,
            placed: gpu.build_input("placed meshes", (instances * size_of::<Placed>()) as u64)?,
            first_deformed: scene.first_deformed,
            corners: corners.cloned(),
            scratch,
            built: None,
            building: None,
        })
    }

    /// Records the builds for a frame's instances, where they differ from what was built last.
    ///
    /// # Errors
    /// Fails with [`Error::Internal`] if an instance is of no mesh.
    pub fn record(&mut self, frame: &mut Frame, state: &PackedInstances) -> Result<()> {
        let place = |instance: &Instance| {
            let mesh = self.meshes.binary_search_by_key(&instance.root, |mesh| mesh.root);
            let mesh = mesh.map_err(|_| Error::Internal(format!("instance id {} has no mesh", instance.id)))?;
            let Mesh { triangles, structure, .. } = &self.meshes[mesh];
            Ok(Placed::new(instance.object_to_world, triangles.start, structure))
        };
        let placed = state.instances.iter().map(place).collect::<Result<_>>()?;
        let input = Input { placed, stances: state.poses.iter().map(|pose| pose.now.clone()).collect() };
        let before = self.built.take();
        if before.as_ref() == Some(&input) {
            self.building = before;
            return Ok(());
        }
        frame.scope("acceleration", |frame| {
            frame.write_buffer(&self.placed, 0, &input.placed)?;
            let corners = self.corners.as_ref().filter(|_| !input.stances.is_empty());
            if let Some(corners) = corners.filter(|_| before.is_none_or(|before| before.stances != input.stances)) {
                let deformed = self.meshes.iter().filter(|mesh| mesh.triangles.start >= self.first_deformed);
                for Mesh { triangles, structure, .. } in deformed {
                    frame.barrier("meshes are built of their corners, one after the other in the same scratch memory");
                    let range = [triangles.start - self.first_deformed, triangles.len() as u32];
                    frame.build(structure, corners, range, &self.scratch)?;
                }
            }
            frame.barrier("the structure of instances is built of meshes and places");
            frame.build(&self.top, &self.placed, [0, input.placed.len() as u32], &self.scratch)
        })?;
        self.building = Some(input);
        Ok(())
    }

    /// Notes that the frame recorded last was submitted.
    pub fn submitted(&mut self) {
        self.built = self.building.take();
    }
}

fn at_rest(triangles: &[TriangleGeometry]) -> Vec<Vec3> {
    triangles.iter().flat_map(|t| [t.v0, t.v0 + t.e1, t.v0 + t.e2]).collect()
}

/// The bottom levels of the BVH: the root of each, in ascending order, and its triangles.
fn meshes(scene: &PackedScene) -> Vec<(u32, Range<u32>)> {
    let (mut meshes, mut root) = (Vec::new(), 0);
    let mut triangles: Option<Range<u32>> = None; // of the leaves so far
    for (node, index) in scene.nodes.iter().zip(0..) {
        if node.leaf == 0 {
            continue;
        }
        let run = bvh::leaf(node);
        let all = triangles.take().map_or(run.clone(), |t| t.start.min(run.start)..t.end.max(run.end));
        if node.next == NONE {
            meshes.push((root, all));
            root = index + 1;
        } else {
            triangles = Some(all);
        }
    }
    meshes
}
