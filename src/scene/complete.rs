//! The complete true scene, from which scene truth is made: the real room and the virtual objects, all of it
//! geometry.

use super::{
    Object, SceneState,
    animation::{Placement, Transform},
    bounds::Bounds,
    camera::CameraTrack,
    model::Model,
    packed::PackedScene,
    state::{self, Placed},
};
use crate::Result;
use std::sync::Arc;

/// A room with objects in it. [`CompleteScene::load`] makes it from a scene file, [`CompleteScene::assemble`]
/// from memory.
#[derive(Clone, Debug)]
pub struct CompleteScene {
    pub name: String,
    pub camera: CameraTrack,
    /// Triangles, materials and textures of the room and of all objects.
    pub packed: PackedScene,
    /// Frames a second.
    pub fps: f64,
    /// A factor on radiance for display.
    pub exposure: f32,
    /// What is understood but not done, or was mended; one line each.
    pub warnings: Vec<String>,
    /// A hash of all that the true scene consists of: geometry, materials, motion, camera. It depends on nothing
    /// that this program makes of them.
    pub content: String,
    placed: Vec<Placed>,
}

const NOTHING_SHINES: &str = "nothing in it shines";

impl CompleteScene {
    /// Packs objects and a room, whose first clip is played in a loop. Like all that is real, the room is seen from
    /// both sides.
    ///
    /// # Errors
    /// Fails if the arrays of a model do not fit each other, or if there are too many triangles.
    pub fn assemble(name: &str, room: Arc<Model>, camera: CameraTrack, objects: Vec<Object>) -> Result<Self> {
        let clip = (!room.rig.clips.is_empty()).then_some(0);
        let placement = Placement::fixed(Transform::IDENTITY);
        let room = two_sided(room);
        let room = Object { name: room.name.clone(), model: room, placement, clip, speed: 1.0 };
        let all: Vec<Object> = std::iter::once(room).chain(objects).collect();
        let (packed, placed, mut warnings) = state::place(&all)?;
        let shines = packed.materials.iter().any(|material| material.emissive.max_element() > 0.0)
            || all.iter().any(|object| !object.model.lights.is_empty());
        if !shines {
            let remedy =
                "give the room a lamp (an emissive material or KHR_lights_punctual), or capture it with --unlit";
            warnings.push(format!("{name}: {NOTHING_SHINES}, so that all of it is black; {remedy}"));
        }
        let content = content(&camera, &all);
        Ok(Self { name: name.to_owned(), camera, packed, fps: 30.0, exposure: 1.0, warnings, content, placed })
    }

    /// Warns of a picture of it that is black all over, if that was not known before. `subject` names the picture.
    pub fn black_warning(&self, is_black: bool, subject: &str) -> Option<String> {
        let is_known = self.warnings.iter().any(|warning| warning.contains(NOTHING_SHINES));
        (is_black && !is_known).then(|| {
            let remedy = "check where the point of view is, that lamps face the room, and that nothing encloses them";
            format!("{subject}: all of it is black: no light of the scene's lamps gets there; {remedy}")
        })
    }

    /// Returns the world box of everything at `time_seconds`, metres.
    pub fn bounds(&self, time_seconds: f64) -> Bounds {
        self.placed.iter().map(|placed| placed.bounds(time_seconds)).fold(Bounds::EMPTY, Bounds::union)
    }

    /// Returns the time in seconds at which frame `index` of the video starts.
    pub fn frame_time(&self, index: u32) -> f64 {
        f64::from(index) / self.fps
    }

    /// Says whether the scene looks the same at two times, in seconds.
    pub fn is_the_same_at(&self, a: f64, b: f64) -> bool {
        let [a, b] = [a, b].map(|time| {
            let state = self.at(time);
            let places: Vec<_> = state.instances.instances.iter().map(|instance| instance.object_to_world).collect();
            let shapes: Vec<_> = state.instances.poses.into_iter().map(|pose| pose.now).collect();
            (places, shapes, state.camera)
        });
        a == b
    }

    /// Returns camera, instances, top level and lights at `time_seconds`.
    pub fn at(&self, time_seconds: f64) -> SceneState {
        let instances = state::instances_at(&self.placed, time_seconds, time_seconds);
        SceneState { camera: self.camera.at(time_seconds), instances }
    }
}

fn two_sided(mut room: Arc<Model>) -> Arc<Model> {
    if room.materials.iter().any(|material| material.one_sided) {
        Arc::make_mut(&mut room).materials.iter_mut().for_each(|material| material.one_sided = false);
    }
    room
}

fn content(camera: &CameraTrack, objects: &[Object]) -> String {
    let mut hasher = blake3::Hasher::new();
    let mut part = |bytes: &[u8]| {
        hasher.update(&(bytes.len() as u64).to_le_bytes()).update(bytes);
    };
    part(format!("{:?} {:?} {:?}", camera.position, camera.aim, camera.fov_y_degrees).as_bytes());
    for Object { name: _, model, placement, clip, speed } in objects {
        for mesh in &model.meshes {
            part(bytemuck::cast_slice(&mesh.positions));
            part(bytemuck::cast_slice(&mesh.normals));
            part(bytemuck::cast_slice(&mesh.uvs));
            part(bytemuck::cast_slice(&mesh.tangents));
            part(bytemuck::cast_slice(&mesh.triangles));
            part(bytemuck::cast_slice(&mesh.materials));
        }
        for texture in &model.textures {
            part(
                format!("{:?} {:?} {:?} {}", texture.size, texture.encoding, texture.wrap, texture.nearest).as_bytes(),
            );
            part(bytemuck::cast_slice(&texture.texels));
        }
        for mesh in &model.meshes {
            part(bytemuck::cast_slice(&mesh.colors));
            part(bytemuck::cast_slice(&mesh.uvs2));
        }
        for material in &model.materials {
            part(material.description().as_bytes());
        }
        let rest = (&model.rig, &model.lights, placement, clip, speed);
        part(format!("{rest:?}").as_bytes());
    }
    hasher.finalize().to_hex()[..32].to_owned()
}
