//! The virtual objects on the device.

use super::{
    brdf::brdf_table,
    resources::{Resource, Resources},
};
use crate::{
    Result,
    gpu::{Buffer, Frame, Gpu},
    scene::packed::{BvhNode, Instance, PackedInstances, PackedScene},
};
use glam::Vec3;

pub struct SceneBuffers {
    /// What shaders read, by name.
    pub resources: Resources,
    instances: Buffer,
    top_nodes: Buffer,
}

impl SceneBuffers {
    /// Uploads what does not change. `instances` is the largest number of instances in any frame.
    pub fn new(gpu: &Gpu, scene: &PackedScene, instances: usize) -> Result<Self> {
        let mut resources = Resources::default();
        let mut add = |name: &'static str, buffer: Buffer| resources.add(name, Resource::Buffer(buffer));
        add("triangles", gpu.buffer_with("triangles", &scene.triangles)?);
        add("shading", gpu.buffer_with("triangle shading", &scene.shading)?);
        add("vertices", gpu.buffer_with("vertices", &scene.vertices)?);
        add("nodes", gpu.buffer_with("bvh nodes", &scene.nodes)?);
        add("materials", gpu.buffer_with("materials", &scene.materials)?);
        add("textures", gpu.buffer_with("textures", &scene.textures)?);
        add("texels", gpu.buffer_with("texels", &scene.texels)?);
        add("energy", gpu.buffer_with("brdf energy", &brdf_table())?);
        let top = gpu.buffer("instances", (instances * size_of::<Instance>()) as u64)?;
        let top_nodes = gpu.buffer("top bvh nodes", (2 * instances * size_of::<BvhNode>()) as u64)?;
        add("instances", top.clone());
        add("top_nodes", top_nodes.clone());
        Ok(Self { resources, instances: top, top_nodes })
    }

    /// Records the upload of a frame's instances, which are relative to the panorama's centre.
    pub fn upload(&self, frame: &mut Frame, state: &PackedInstances) -> Result<()> {
        frame.write_buffer(&self.instances, 0, &state.instances)?;
        frame.write_buffer(&self.top_nodes, 0, &state.nodes)
    }
}

/// Moves instances to coordinates relative to `centre` (world, metres).
pub fn relative_to(centre: Vec3, mut state: PackedInstances) -> PackedInstances {
    for instance in &mut state.instances {
        recentre(instance, centre);
    }
    for node in &mut state.nodes {
        for corner in [&mut node.min0, &mut node.max0, &mut node.min1, &mut node.max1] {
            *corner -= centre;
        }
    }
    state
}

fn recentre(instance: &mut Instance, centre: Vec3) {
    for (axis, offset) in centre.to_array().into_iter().enumerate() {
        instance.object_to_world[axis][3] -= offset;
        instance.previous_object_to_world[axis][3] -= offset;
    }
    for row in &mut instance.world_to_object {
        row[3] += row[0] * centre.x + row[1] * centre.y + row[2] * centre.z;
    }
}
