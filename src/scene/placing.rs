//! Objects that are placed by what is in the room: on its floor, at a pixel of its picture, or on another
//! object. They stand by their bounds.

use super::{
    animation::{Placement, Track},
    bounds::Bounds,
    fields::{FieldTable, nearest},
    state::Object,
};
use crate::{
    Error, Result,
    panorama::{
        cloud::Cloud,
        mapping::{panorama_to_world, texel_direction},
        room::{Level, level},
        source::{PanoramaFrame, PanoramaSource},
    },
};
use glam::{Affine3A, Quat, Vec3};
use std::sync::Arc;

/// The key `place` of an object.
#[derive(Clone, Debug, PartialEq)]
pub struct Place {
    pub spot: Spot,
    pub facing: Facing,
}

/// Where an object stands.
#[derive(Clone, Debug, PartialEq)]
pub enum Spot {
    /// On the floor, at these world coordinates x and z, metres.
    Floor([f32; 2]),
    /// On what is seen at this column and row of the panorama's picture.
    Pixel([f32; 2]),
    /// On top of the object of this name, in its middle.
    On(String),
}

/// What an object turns its +Z to, which is a glTF model's front.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Facing {
    /// Degrees about +Y; 0 leaves it as it is.
    Degrees(f32),
    /// The capture point.
    Camera,
}

/// Between two objects, metres: what is flat below would share the plane of what it stands on, and a ray would meet
/// either at random.
const GAP: f32 = 5e-4;

pub(super) const KEYS: &[&str] = &["floor", "pixel", "on", "facing"];

/// Reads the table `place` of an object. Problems are reported through `fields`.
pub(super) fn read_place(fields: &FieldTable) -> Option<Place> {
    let table = fields.table("place", KEYS)?;
    for key in ["translation", "key"].into_iter().filter(|key| fields.has(key)) {
        fields.complain(key, "stands beside place", "give one of the two");
    }
    if ["floor", "pixel", "on"].iter().filter(|key| table.has(key)).count() != 1 {
        let remedy = "write place = { floor = [x, z] }, { pixel = [column, row] } or { on = \"name\" }";
        fields.complain("place", "needs one of floor, pixel and on", remedy);
        return None;
    }
    let pair = |[a, b]: [f64; 2]| [a as f32, b as f32];
    let spot = if table.has("floor") {
        Spot::Floor(table.vector("floor").map(pair)?)
    } else if table.has("pixel") {
        Spot::Pixel(table.vector("pixel").map(pair)?)
    } else {
        Spot::On(table.string("on")?.to_owned())
    };
    let facing = match table.value("facing") {
        None => Facing::Degrees(0.0),
        Some(toml::Value::String(word)) if word == "camera" => Facing::Camera,
        Some(toml::Value::String(word)) => {
            table.complain("facing", format!("\"{word}\" is no direction"), "give degrees about +Y, or \"camera\"");
            return None;
        }
        Some(_) => Facing::Degrees(table.number("facing")? as f32),
    };
    Some(Place { spot, facing })
}

/// Returns the box of an object's model at the start, under a matrix.
pub fn model_bounds(object: &Object, matrix: &Affine3A) -> Bounds {
    let rig = &object.model.rig;
    let matrices = rig.node_matrices(object.clip.map(|clip| (clip, 0.0)));
    let meshes = rig.nodes.iter().zip(matrices).filter_map(|(node, own)| Some((*matrix * own, node.mesh?)));
    meshes.fold(Bounds::EMPTY, |bounds, (matrix, mesh)| {
        let used = object.model.meshes.get(mesh);
        let corners = used.iter().flat_map(|mesh| mesh.triangles.iter().flatten().map(|v| mesh.positions[*v as usize]));
        bounds.union(Bounds::of(corners.map(|p| matrix.transform_point3(p))))
    })
}

/// Gives an object a scale with which its largest side is `side` metres.
pub(super) fn fit(object: &mut Object, side: f32) {
    let bounds = model_bounds(object, &Affine3A::IDENTITY);
    let largest = (bounds.max - bounds.min).max_element();
    if largest > 0.0 && largest.is_finite() {
        object.placement.scale = Track::constant(object.placement.scale.at(0.0) * (side / largest));
    }
}

/// The room, as far as placing needs it. It is measured when the first object asks.
pub(super) struct Room<'a> {
    panorama: &'a PanoramaSource,
    measured: Option<(Arc<PanoramaFrame>, Option<Level>)>,
}

impl<'a> Room<'a> {
    pub(super) fn new(panorama: &'a PanoramaSource) -> Self {
        Self { panorama, measured: None }
    }

    fn measured(&mut self) -> Result<&(Arc<PanoramaFrame>, Option<Level>)> {
        if self.measured.is_none() {
            let frame = self.panorama.load(0)?;
            let floor = level(&Cloud::of(&frame, self.panorama.yaw_degrees), true);
            self.measured = Some((frame, floor));
        }
        self.measured.as_ref().ok_or_else(|| Error::Internal("a room that was not measured".into()))
    }

    /// Puts an object where `place` says. `others` are the objects that stand already. `subject` names its
    /// key in errors.
    pub(super) fn put(&mut self, object: &mut Object, place: &Place, others: &[Object], subject: &str) -> Result<()> {
        let capture = self.panorama.position;
        let foot = match &place.spot {
            Spot::Floor(at) => self.floor(*at, subject)?,
            Spot::Pixel(at) => self.pixel(*at, subject)?,
            Spot::On(name) => {
                let Some(other) = others.iter().find(|other| other.name == *name) else {
                    let names: Vec<&str> = others.iter().map(|other| other.name.as_str()).collect();
                    let remedy =
                        if names.is_empty() { "name an object above it".into() } else { nearest(name, &names) };
                    return Err(Error::input(subject, format!("no object above it is called \"{name}\""), remedy));
                };
                let bounds = model_bounds(other, &other.placement.at(0.0).matrix());
                bounds.center().with_y(bounds.max.y + GAP)
            }
        };
        let to_camera = capture - foot;
        let turn = match place.facing {
            Facing::Degrees(degrees) => Quat::from_rotation_y(degrees.to_radians()),
            Facing::Camera => Quat::from_rotation_y(to_camera.x.atan2(to_camera.z)),
        };
        let mut transform = object.placement.at(0.0);
        transform.rotation = turn * transform.rotation;
        transform.translation = Vec3::ZERO;
        let bounds = model_bounds(object, &transform.matrix());
        if !bounds.is_empty() {
            transform.translation = foot - bounds.center().with_y(bounds.min.y);
        }
        object.placement = Placement::fixed(transform);
        Ok(())
    }

    fn floor(&mut self, [x, z]: [f32; 2], subject: &str) -> Result<Vec3> {
        let capture = self.panorama.position;
        let (_, floor) = self.measured()?;
        let height = floor.and_then(|floor| floor.height(x - capture.x, z - capture.z));
        let Some(height) = height else {
            let remedy = "give translation, or place = { pixel = [column, row] }";
            return Err(Error::input(subject, "no floor is found in the depth", remedy));
        };
        Ok(Vec3::new(x, height + capture.y, z))
    }

    fn pixel(&mut self, at: [f32; 2], subject: &str) -> Result<Vec3> {
        let (capture, yaw) = (self.panorama.position, f64::from(self.panorama.yaw_degrees));
        let panorama = self.panorama;
        let (frame, _) = self.measured()?;
        let size = panorama.picture_size().unwrap_or(frame.color_size);
        let [width, height] = size;
        if !(0.0..width as f32).contains(&at[0]) || !(0.0..height as f32).contains(&at[1]) {
            let problem = format!("the pixel lies outside the picture, which is {width}x{height}");
            return Err(Error::input(subject, problem, "give a column and a row of the panorama's picture"));
        }
        let pixel = [at[0] as u32, at[1] as u32];
        let scaled = |axis: usize| {
            (u64::from(2 * pixel[axis] + 1) * u64::from(frame.depth_size[axis]) / u64::from(2 * size[axis])) as usize
        };
        let metres = frame.depth[scaled(1) * frame.depth_size[0] as usize + scaled(0)];
        if metres <= 0.0 {
            let remedy = "choose another, whose depth is known";
            return Err(Error::input(subject, "the depth has a hole at that pixel", remedy));
        }
        let direction = panorama_to_world(texel_direction(pixel[0], pixel[1], size), yaw);
        Ok(capture + direction.as_vec3() * metres)
    }
}
