//! The virtual objects on the device.

use super::{
    acceleration::AccelerationBuild,
    bsdf::{ggx_table, sheen_table},
    deform::Deform,
    resources::{Resource, Resources},
};
use crate::{
    Result,
    gpu::{Buffer, Format, Frame, Gpu, Image},
    scene::{
        lights::Shining,
        packed::{
            BvhNode, EmitterHeader, Instance, Light, Mover, PackedInstances, PackedScene, Punctual, TriangleGeometry,
        },
    },
};
use glam::Vec3;

pub struct SceneBuffers {
    /// What shaders read, by name.
    pub resources: Resources,
    instances: Buffer,
    movers: Buffer,
    places: Table,
    top_nodes: Table,
    /// Present if meshes change their shape.
    deform: Option<Deform>,
    /// Present if rays meet objects by ray queries.
    acceleration: Option<AccelerationBuild>,
    shining: Shining,
    emitters: Buffer,
    punctual: Buffer,
}

impl SceneBuffers {
    /// Uploads what does not change. `instances` is the largest number of instances in any frame, `lights` that of
    /// lights without a surface.
    pub fn new(gpu: &Gpu, scene: &PackedScene, instances: usize, lights: usize) -> Result<Self> {
        let mut resources = Resources::default();
        let mut add = |name: &'static str, buffer: Buffer| resources.add(name, Resource::Buffer(buffer));
        add("shading", gpu.buffer_with("triangle shading", &scene.shading)?);
        add("vertices", gpu.buffer_with("vertices", &scene.vertices)?);
        add("materials", gpu.buffer_with("materials", &scene.materials)?);
        add("textures", gpu.buffer_with("textures", &scene.textures)?);
        add("texels", gpu.buffer_with("texels", &scene.texels)?);
        add("energy", gpu.buffer_with("energy of lobes", &[ggx_table(), sheen_table()].concat())?);
        let top = gpu.buffer("instances", (instances * size_of::<Instance>()) as u64)?;
        add("instances", top.clone());
        // what was there and what is there
        let movers = gpu.buffer("movers", (4 * (instances + lights) * size_of::<Mover>()) as u64)?;
        add("movers", movers.clone());
        let shining = Shining::of(scene);
        let bytes = size_of::<EmitterHeader>() + shining.most(scene).max(1) * size_of::<Light>();
        let emitters = gpu.buffer("emitters", bytes as u64)?;
        resources.add("emitters", Resource::Buffer(emitters.clone()));
        let punctual = gpu.buffer("punctual lights", (size_of::<u32>() + lights * size_of::<Punctual>()) as u64)?;
        resources.add("punctual", Resource::Buffer(punctual.clone()));
        let triangles = Table::with(gpu, "triangles", &triangle_items(&scene.triangles, &scene.one_sided))?;
        let nodes = Table::with(gpu, "bvh nodes", bytemuck::cast_slice(&scene.nodes))?;
        let deforming = scene.triangles.len().saturating_sub(scene.first_deformed as usize);
        let previous = Table::new(gpu, "previous triangles", deforming * TRIANGLE_TEXELS)?;
        let places = Table::new(gpu, "places", instances * PLACE_TEXELS)?;
        let top_nodes = Table::new(gpu, "top bvh nodes", 2 * instances * size_of::<BvhNode>() / TEXEL)?;
        for (name, table) in [
            ("triangles", &triangles),
            ("nodes", &nodes),
            ("places", &places),
            ("top_nodes", &top_nodes),
            ("previous_triangles", &previous),
        ] {
            resources.add(name, Resource::Image(table.0.clone()));
        }
        let (deform, acceleration) = (None, None);
        Ok(Self {
            resources,
            instances: top,
            movers,
            places,
            top_nodes,
            deform,
            acceleration,
            shining,
            emitters,
            punctual,
        })
    }

    /// Adds the pass that poses the scene's deforming meshes, if it has any. `ray_queries` says whether
    /// [`SceneBuffers::add_acceleration`] follows.
    ///
    /// # Errors
    /// Fails as [`Deform::new`] does.
    pub fn add_deform(&mut self, gpu: &Gpu, scene: &PackedScene, ray_queries: bool) -> Result<()> {
        self.deform = Deform::new(gpu, scene, ray_queries)?;
        Ok(())
    }

    /// The pass that poses meshes, if the scene needs it.
    pub fn deform(&self) -> Option<&Deform> {
        self.deform.as_ref()
    }

    /// Adds what ray queries search.
    ///
    /// # Errors
    /// Fails as [`AccelerationBuild::new`] does.
    pub fn add_acceleration(&mut self, gpu: &Gpu, scene: &PackedScene, instances: usize) -> Result<()> {
        let corners = self.deform.as_ref().and_then(Deform::corners);
        let acceleration = AccelerationBuild::new(gpu, scene, instances, corners)?;
        self.resources.add("acceleration", Resource::Acceleration(acceleration.top.clone()));
        self.acceleration = Some(acceleration);
        Ok(())
    }

    /// Records the passes that bring what rays meet to a frame's instances: `deform`, if meshes change their shape, and
    /// `acceleration`, if rays meet objects by ray queries.
    ///
    /// # Errors
    /// Fails as [`Deform::record`] and [`AccelerationBuild::record`] do.
    pub fn follow(&mut self, frame: &mut Frame, state: &PackedInstances) -> Result<()> {
        if let Some(deform) = self.deform.as_mut().filter(|_| !state.poses.is_empty()) {
            deform.record(frame, &self.resources, &state.poses)?;
        }
        self.acceleration.as_mut().map_or(Ok(()), |acceleration| acceleration.record(frame, state))
    }

    /// Notes that the frame recorded last was submitted.
    pub fn submitted(&mut self) {
        self.deform.iter_mut().for_each(Deform::submitted);
        self.acceleration.iter_mut().for_each(AccelerationBuild::submitted);
    }

    /// Records the upload of a frame's instances, which are relative to the panorama's centre, and of those that
    /// have moved. `luminance` is the panorama's on average.
    pub fn upload(
        &self,
        frame: &mut Frame,
        scene: &PackedScene,
        state: &PackedInstances,
        movers: &[Mover],
        luminance: f32,
    ) -> Result<()> {
        frame.write_buffer(&self.movers, 0, movers)?;
        frame.write_buffer(&self.instances, 0, &state.instances)?;
        let table = self.shining.lights(scene, state);
        let inverse_power = if table.lights.is_empty() { 0.0 } else { (1.0 / table.power) as f32 };
        let header = EmitterHeader {
            count: table.lights.len() as u32,
            inverse_power,
            center: table.center,
            radius: table.radius.max(1e-3),
            surroundings: std::f32::consts::PI * luminance,
        };
        let bytes = [bytemuck::bytes_of(&header), bytemuck::cast_slice(&table.lights)].concat();
        frame.write_buffer(&self.emitters, 0, &bytes)?;
        let count = state.lights.len() as u32;
        frame.write_buffer(&self.punctual, 0, &[&count.to_le_bytes(), bytemuck::cast_slice(&state.lights)].concat())?;
        let place = |instance: &Instance| {
            let [x, y, z] = instance.world_to_object.map(|row| row.map(f32::to_bits));
            [x, y, z, [instance.root, 0, 0, 0]]
        };
        let places: Vec<_> = state.instances.iter().flat_map(place).collect();
        self.places.upload(frame, &places)?;
        self.top_nodes.upload(frame, bytemuck::cast_slice(&state.nodes))
    }
}

/// Texels of a triangle.
const TRIANGLE_TEXELS: usize = 3;

fn triangle_items(triangles: &[TriangleGeometry], one_sided: &[bool]) -> Vec<[u32; 4]> {
    let texel = |v: Vec3, w: bool| [v.x.to_bits(), v.y.to_bits(), v.z.to_bits(), u32::from(w)];
    let items = triangles.iter().zip(one_sided);
    items.flat_map(|(t, one_sided)| [texel(t.v0, *one_sided), texel(t.e1, false), texel(t.e2, false)]).collect()
}

/// Bytes of a texel of a [`Table`].
const TEXEL: usize = 16;
/// Texels of a place: the rows of an instance's `world_to_object`, and the root of its bottom level.
const PLACE_TEXELS: usize = 4;

/// An array of four words an item, as an image. CPU drivers read an image in which each lane has an index of
/// its own several times faster than a buffer; for GPUs it is the same.
struct Table(Image);

/// Texels of a row, a width that images of every device can have. `table_texel` in `common.glsl` knows it.
const TABLE_ROW: usize = 4096;

impl Table {
    fn new(gpu: &Gpu, name: &str, items: usize) -> Result<Self> {
        let (width, height) = (items.clamp(1, TABLE_ROW), items.div_ceil(TABLE_ROW).max(1));
        gpu.image(name, [width as u32, height as u32], 1, 1, Format::Rgba32u).map(Self)
    }

    fn with(gpu: &Gpu, name: &str, items: &[[u32; 4]]) -> Result<Self> {
        let table = Self::new(gpu, name, items.len())?;
        gpu.write_image(&table.0, 0, 0, &table.padded(items))?;
        Ok(table)
    }

    fn upload(&self, frame: &mut Frame, items: &[[u32; 4]]) -> Result<()> {
        frame.write_image(&self.0, 0, 0, &self.padded(items))
    }

    fn padded(&self, items: &[[u32; 4]]) -> Vec<[u32; 4]> {
        let [width, height] = self.0.size();
        let mut padded = items.to_vec();
        padded.resize(width as usize * height as usize, [0; 4]);
        padded
    }
}

/// Moves instances and lights to coordinates relative to `centre` (world, metres).
pub fn relative_to(centre: Vec3, mut state: PackedInstances) -> PackedInstances {
    for instance in &mut state.instances {
        recentre(instance, centre);
    }
    for light in &mut state.lights {
        light.position -= centre;
    }
    for node in &mut state.nodes {
        node.min -= centre;
        node.max -= centre;
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
