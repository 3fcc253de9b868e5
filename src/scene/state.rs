//! A scene in memory, and what of it changes over time.

use super::{
    animation::{Placement, made_invertible},
    bounds::Bounds,
    bvh,
    camera::{Camera, CameraTrack},
    deform::{self, Pose},
    file::RenderSettings,
    model::Model,
    pack::{PackedMesh, pack},
    packed::{BvhNode, Instance, NONE, PackedInstances, PackedScene},
};
use crate::{Result, panorama::source::PanoramaSource};
use glam::{Affine3A, Mat4, Vec4};
use std::{collections::HashMap, path::PathBuf, sync::Arc};

/// A model placed in the world.
#[derive(Clone, Debug)]
pub struct Object {
    pub name: String,
    /// The model. Objects that share the same `Arc` share its packed triangles.
    pub model: Arc<Model>,
    pub placement: Placement,
    /// The index of the clip that is played in a loop.
    pub clip: Option<usize>,
    /// A factor on the clip's time.
    pub speed: f64,
}

/// All that is rendered. [`Scene::load`] makes it from files, [`Scene::assemble`] from memory.
#[derive(Clone, Debug)]
pub struct Scene {
    pub name: String,
    pub panorama: PanoramaSource,
    pub camera: CameraTrack,
    /// Triangles, materials and textures of all objects. Clones share them.
    pub packed: Arc<PackedScene>,
    pub render: RenderSettings,
    /// The glTF file of the true real scene, if it is known.
    pub room: Option<PathBuf>,
    /// What is understood but not done, or was mended; one line each.
    pub warnings: Vec<String>,
    pub(super) placed: Vec<Placed>,
}

#[derive(Clone, Debug)]
pub(super) struct Placed {
    pub object: Object,
    pub first_material: u32,
    /// Node, its mesh, and the instance's id.
    pub instances: Vec<(usize, PackedMesh, u32)>,
    /// Which of the instances deform.
    pub deforming: Vec<(usize, Arc<deform::Placed>)>,
}

/// A scene at one time.
#[derive(Clone, Debug)]
pub struct SceneState {
    pub camera: Camera,
    pub instances: PackedInstances,
}

impl Scene {
    /// Packs objects into a scene.
    ///
    /// # Errors
    /// Fails if the arrays of a model do not fit each other, or if there are too many triangles.
    pub fn assemble(
        name: &str,
        panorama: PanoramaSource,
        camera: CameraTrack,
        objects: Vec<Object>,
        render: RenderSettings,
    ) -> Result<Self> {
        let (packed, placed, warnings) = place(&objects)?;
        let packed = Arc::new(packed);
        Ok(Self { name: name.to_owned(), panorama, camera, packed, render, room: None, warnings, placed })
    }

    /// Returns camera, instances and top level at `time_seconds`. `previous_time` is that of the frame
    /// before, for motion vectors (the same time if there is none). An instance that is
    /// flattened to a line or point now is left out.
    pub fn at(&self, time_seconds: f64, previous_time: f64) -> SceneState {
        SceneState {
            camera: self.camera.at(time_seconds),
            instances: instances_at(&self.placed, time_seconds, previous_time),
        }
    }

    /// Returns the name of the first object that changes its shape.
    pub fn deforming_object(&self) -> Option<&str> {
        let deforms = |placed: &&Placed| !placed.deforming.is_empty();
        self.placed.iter().find(deforms).map(|placed| placed.object.name.as_str())
    }

    /// Returns the largest number of instances. Ids are 1 to this number.
    pub fn instance_count(&self) -> usize {
        self.placed.iter().map(|placed| placed.instances.len()).sum()
    }

    /// Returns the number of lights without a surface.
    pub fn light_count(&self) -> usize {
        self.placed.iter().map(|placed| placed.object.model.lights.len()).sum()
    }

    /// Returns the number of objects.
    pub fn object_count(&self) -> usize {
        self.placed.len()
    }

    /// Returns the name of the first object that ever moves.
    pub fn moving_object(&self) -> Option<&str> {
        let moves = |placed: &&Placed| {
            let shows = !placed.instances.is_empty() || !placed.object.model.lights.is_empty();
            shows && (placed.object.clip.is_some() || !placed.object.placement.is_constant())
        };
        self.placed.iter().find(moves).map(|placed| placed.object.name.as_str())
    }

    /// Returns the name of the object that instance `id` belongs to.
    pub fn object_name(&self, id: u32) -> Option<&str> {
        let has = |placed: &&Placed| placed.instances.iter().any(|(_, _, instance)| *instance == id);
        self.placed.iter().find(has).map(|placed| placed.object.name.as_str())
    }

    /// Returns the world box of all instances of object `index` at `time_seconds`, metres.
    pub fn object_bounds(&self, index: usize, time_seconds: f64) -> Bounds {
        self.placed.get(index).map_or(Bounds::EMPTY, |placed| placed.bounds(time_seconds))
    }
}

/// Packs objects, and returns one line for each thing that is unusual about them.
pub(super) fn place(objects: &[Object]) -> Result<(PackedScene, Vec<Placed>, Vec<String>)> {
    // Each model, and whether it is ever seen at rest.
    let mut models: Vec<(&Model, bool)> = Vec::new();
    let mut numbers = HashMap::new();
    let model_of: Vec<usize> = objects
        .iter()
        .map(|object| {
            let number = *numbers.entry(Arc::as_ptr(&object.model)).or_insert(models.len());
            if number == models.len() {
                models.push((&object.model, false));
            }
            models[number].1 |= !plays(object);
            number
        })
        .collect();
    let mut packed = pack(&models)?;
    let mut next_id = 1;
    let mut placed = Vec::new();
    let mut posed = HashMap::new();
    for (object, model) in objects.iter().zip(model_of) {
        let (mut instances, mut deforming) = (Vec::new(), Vec::new());
        for (node, mesh) in object.model.rig.nodes.iter().enumerate().filter_map(|(i, n)| Some((i, n.mesh?))) {
            let deforms = plays(object) && object.model.meshes.get(mesh).is_some_and(|mesh| mesh.deform.is_some());
            // Objects that play the same clip in step are posed once.
            let key = (Arc::as_ptr(&object.model), mesh, node, object.clip, object.speed.to_bits());
            let own = match posed.get(&key) {
                Some(own) => Option::clone(own),
                None if deforms => posed.entry(key).or_insert(packed.deforming(&object.model, mesh)?).clone(),
                None => None,
            };
            let shared = packed.meshes[model].get(mesh).copied().flatten().filter(|_| !deforms);
            if let Some((_, deform)) = &own {
                deforming.push((instances.len(), deform.clone()));
            }
            if let Some(mesh) = own.map(|(mesh, _)| mesh).or(shared) {
                instances.push((node, mesh, next_id));
                *packed.scene.uses.entry((mesh.root, packed.first_materials[model])).or_default() += 1;
                next_id += 1;
            }
        }
        let clip = object.clip.filter(|_| plays(object));
        let first_material = packed.first_materials[model];
        placed.push(Placed { object: Object { clip, ..object.clone() }, first_material, instances, deforming });
    }
    bvh::check(&packed.scene)?;
    let mut warnings = packed.warnings;
    for placed in &placed {
        let matrices = placed.matrices(0.0);
        let flat = placed.instances.iter().filter(|(node, ..)| made_invertible(&matrices[*node]).is_none()).count();
        if flat > 0 {
            let problem = "are flattened to a line or point at the start and are not drawn";
            warnings.push(format!("{}: {flat} of its instances {problem}", placed.object.name));
        } else if placed.instances.is_empty() && placed.object.model.lights.is_empty() {
            warnings.push(format!("{}: holds no triangles", placed.object.name));
        }
    }
    Ok((packed.scene, placed, warnings))
}

/// Whether an object plays a clip that it has.
fn plays(object: &Object) -> bool {
    object.clip.is_some_and(|clip| clip < object.model.rig.clips.len())
}

/// Returns instances, their top level and lights at a time. Motion is since `previous_time`. An instance
/// that is flattened to a line or point now is left out.
pub(super) fn instances_at(objects: &[Placed], time_seconds: f64, previous_time: f64) -> PackedInstances {
    let mut instances = Vec::new();
    let mut boxes = Vec::new();
    let mut lights = Vec::new();
    let mut poses: Vec<Pose> = Vec::new();
    let mut numbers = HashMap::new();
    for placed in objects {
        for (deform, pose) in placed.poses(time_seconds, previous_time, |deform| !numbers.contains_key(&deform)) {
            numbers.insert(deform, poses.len());
            poses.push(pose);
        }
        let first_deformed = objects.iter().find_map(|placed| placed.deforming.first()).map(|(_, d)| d.first_triangle);
        let now = placed.matrices(time_seconds);
        lights.extend(placed.object.model.lights.iter().map(|light| light.pack(&now[light.node])));
        let before = if previous_time == time_seconds { now.clone() } else { placed.matrices(previous_time) };
        for (index, &(node, mesh, id)) in placed.instances.iter().enumerate() {
            let own = placed.deforming.iter().find(|(instance, _)| *instance == index);
            let pose = own.and_then(|(_, deform)| poses.get(*numbers.get(&Arc::as_ptr(deform))?));
            let bounds = pose.map_or(mesh.bounds, |pose| pose.bounds);
            let Some(to_world) = made_invertible(&now[node]) else { continue };
            let previous = if before[node].is_finite() { before[node] } else { to_world };
            instances.push(Instance {
                object_to_world: rows(&to_world),
                world_to_object: rows(&to_world.inverse()),
                previous_object_to_world: rows(&previous),
                root: mesh.root,
                id,
                previous: pose.and(first_deformed).unwrap_or(NONE),
                step: pose.map_or(0.0, |pose| pose.step),
                first_material: placed.first_material,
            });
            boxes.push(bounds.transformed(&to_world).padded());
        }
    }
    PackedInstances { instances, nodes: top_level(&boxes), lights, poses }
}

fn top_level(boxes: &[Bounds]) -> Vec<BvhNode> {
    let tree = bvh::build_top(boxes);
    tree.pack(0, |first| tree.order[first as usize])
}

impl PackedInstances {
    /// Lets the meshes that change their shape stand in their rest pose.
    pub fn rest(&mut self, packed: &PackedScene) {
        if self.poses.is_empty() {
            return;
        }
        self.poses.clear();
        self.instances.iter_mut().for_each(|instance| (instance.previous, instance.step) = (NONE, 0.0));
        let at_rest = |instance: &Instance| {
            let root = &packed.nodes[instance.root as usize];
            let [x, y, z] = instance.object_to_world.map(Vec4::from);
            let rows = Mat4::from_cols(x, y, z, Vec4::W).transpose();
            Bounds { min: root.min, max: root.max }.transformed(&Affine3A::from_mat4(rows)).padded()
        };
        self.nodes = top_level(&self.instances.iter().map(at_rest).collect::<Vec<_>>());
    }
}

impl Placed {
    pub(super) fn matrices(&self, time: f64) -> Vec<Affine3A> {
        let object = &self.object;
        let world = object.placement.at(time).matrix();
        let nodes = object.model.rig.node_matrices(object.clip.map(|clip| (clip, time * object.speed)));
        nodes.into_iter().map(|node| world * node).collect()
    }

    /// Returns what poses those of its deforming meshes that are `wanted` at a time, and what posed them at another.
    fn poses(
        &self,
        time: f64,
        previous: f64,
        wanted: impl Fn(*const deform::Placed) -> bool,
    ) -> Vec<(*const deform::Placed, Pose)> {
        let wanted: Vec<_> =
            self.deforming.iter().map(|(_, deform)| deform).filter(|d| wanted(Arc::as_ptr(d))).collect();
        if wanted.is_empty() {
            return Vec::new();
        }
        let Object { model, clip, speed, .. } = &self.object;
        let times = [time, previous].map(|time| clip.map(|clip| (clip, time * speed)));
        let nodes = times.map(|clip| model.rig.node_matrices(clip));
        let pose = |placed: &Arc<deform::Placed>| {
            let [now, before] = [0, 1].map(|at| placed.deform.stance_among(&nodes[at], &model.rig, times[at]));
            (Arc::as_ptr(placed), Pose::new(placed, now, before))
        };
        wanted.into_iter().map(pose).collect()
    }

    /// Returns the world box of all its instances, metres.
    pub(super) fn bounds(&self, time: f64) -> Bounds {
        let (matrices, poses) = (self.matrices(time), self.poses(time, time, |_| true));
        let own = |index: usize| self.deforming.iter().position(|(instance, _)| *instance == index);
        let boxes = self.instances.iter().enumerate().map(|(index, (node, mesh, _))| {
            let pose = own(index).and_then(|own| poses.get(own));
            pose.map_or(mesh.bounds, |(_, pose)| pose.posed_bounds()).transformed(&matrices[*node])
        });
        boxes.fold(Bounds::EMPTY, Bounds::union)
    }
}

/// Returns the three rows of an affine matrix.
fn rows(matrix: &Affine3A) -> [[f32; 4]; 3] {
    let (linear, translation) = (matrix.matrix3, matrix.translation);
    [0, 1, 2].map(|row| [linear.x_axis[row], linear.y_axis[row], linear.z_axis[row], translation[row]])
}
