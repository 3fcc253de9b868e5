//! Writes a built-in room as files: .glb for the room and its objects, EXR for the panorama, and a scene file
//! that names them.

use super::{
    Object,
    animation::{Lerp, Placement, Track, Turn},
    camera::{Aim, CameraTrack},
    gltf::export::to_glb,
    model::Model,
    rooms::Room,
};
use crate::{
    Error, Result,
    image_file::{
        exr_file::ExrLayer,
        write::{write_bytes, write_exr},
    },
    panorama::source::PanoramaFrame,
};
use glam::{Quat, Vec3};
use std::{
    borrow::Borrow,
    fs,
    path::{Path, PathBuf},
    sync::Arc,
};
use toml::{Table, Value};

/// The name of the scene file in an exported folder.
pub const SCENE_FILE: &str = "scene.toml";
/// The name of the real room's file.
pub const ROOM_FILE: &str = "room.glb";

/// The files of an export, before anything is captured or written.
#[derive(Clone, Debug)]
pub struct Export {
    /// The text of the scene file.
    pub scene: String,
    /// File names and models: the room first, then objects. Objects that share a model share its file.
    pub models: Vec<(String, Arc<Model>)>,
    /// Colour and depth file of each frame of the panorama.
    pub panorama: Vec<[String; 2]>,
}

impl Export {
    /// Plans the files of a room.
    pub fn of(room: &Room) -> Self {
        let mut models = vec![(ROOM_FILE.to_owned(), room.model.clone())];
        let mut objects = Vec::new();
        for object in &room.objects {
            let known = models[1..].iter().find(|(_, model)| Arc::ptr_eq(model, &object.model));
            let file = known.map_or_else(|| format!("{}.glb", object.name), |(file, _)| file.clone());
            objects.push(Value::Table(object_table(object, &file)));
            if !models.iter().any(|(name, _)| *name == file) {
                models.push((file, object.model.clone()));
            }
        }
        let frames = room.video.map_or(1, |video| video.frames);
        let panorama: Vec<_> = match room.video {
            None => vec![["color.exr".to_owned(), "depth.exr".to_owned()]],
            Some(_) => (0..frames).map(|i| ["color", "depth"].map(|name| format!("{name}_{i:04}.exr"))).collect(),
        };
        let mut table = Table::new();
        let mut source = Table::new();
        let pattern = if room.video.is_some() { "_%04d" } else { "" };
        source.insert("color".into(), format!("color{pattern}.exr").into());
        source.insert("depth".into(), format!("depth{pattern}.exr").into());
        if let Some(video) = room.video {
            source.insert("frames".into(), vec![0, i64::from(frames) - 1].into());
            source.insert("fps".into(), video.fps.into());
        }
        source.insert("position".into(), vector(room.capture_position));
        table.insert("panorama".into(), source.into());
        table.insert("camera".into(), camera_table(&room.camera).into());
        table.insert("room".into(), Table::from_iter([("gltf".to_owned(), Value::from(ROOM_FILE))]).into());
        table.insert("object".into(), objects.into());
        let head = format!("# The built-in room \"{}\", written by `iprt scene export`.\n", room.name);
        Self { scene: format!("{head}{table}"), models, panorama }
    }

    /// Makes the folder if it does not exist. Only an earlier export of the same scene may be in it.
    ///
    /// # Errors
    /// Fails if the folder cannot be made or read, or if it holds anything else.
    pub fn prepare(&self, folder: &Path) -> Result<()> {
        let subject = folder.display();
        let fail = |error: std::io::Error| {
            Error::input(subject.to_string(), error.kind().to_string(), "give a folder that can be written")
        };
        fs::create_dir_all(folder).map_err(fail)?;
        for entry in fs::read_dir(folder).map_err(fail)? {
            let name = entry.map_err(fail)?.file_name().to_string_lossy().into_owned();
            let same = match name.as_str() {
                SCENE_FILE => fs::read(folder.join(SCENE_FILE)).is_ok_and(|text| text == self.scene.as_bytes()),
                name => self.files().any(|file| file == name),
            };
            if !same {
                let problem = if name == SCENE_FILE { "already holds another scene" } else { "is not empty" };
                return Err(Error::input(subject, format!("{problem} ({name})"), "give an empty or a new folder"));
            }
        }
        Ok(())
    }

    fn files(&self) -> impl Iterator<Item = &str> {
        let models = self.models.iter().map(|(file, _)| file.as_str());
        models.chain(self.panorama.iter().flatten().map(String::as_str))
    }

    /// Writes everything, the scene file last, and returns its path. There must be as many `frames` as
    /// planned.
    ///
    /// # Errors
    /// Fails if a file cannot be written.
    pub fn write(&self, folder: &Path, frames: &[impl Borrow<PanoramaFrame>]) -> Result<PathBuf> {
        if frames.len() != self.panorama.len() {
            return Err(Error::Internal(format!("{} frames for {} files", frames.len(), self.panorama.len())));
        }
        for (file, model) in &self.models {
            write_bytes(&folder.join(file), &to_glb(model)?)?;
        }
        for (frame, [color, depth]) in frames.iter().map(Borrow::borrow).zip(&self.panorama) {
            write_exr(&folder.join(color), &[ExrLayer::rgb("", frame.color_size, &frame.radiance.to_vec())])?;
            let channels = vec![("Y".to_owned(), frame.depth.clone())];
            write_exr(&folder.join(depth), &[ExrLayer { name: String::new(), size: frame.depth_size, channels }])?;
        }
        let path = folder.join(SCENE_FILE);
        write_bytes(&path, self.scene.as_bytes())?;
        Ok(path)
    }
}

fn numbers(values: &[f32]) -> Value {
    values.iter().map(|value| number(*value)).collect::<Vec<_>>().into()
}

/// Returns the shortest decimal that reads back as the same single-precision number.
fn number(value: f32) -> Value {
    Value::Float(value.to_string().parse().unwrap_or_else(|_| f64::from(value)))
}

fn vector(value: Vec3) -> Value {
    numbers(&value.to_array())
}

fn rotation(value: Turn) -> Value {
    if value.by == Quat::IDENTITY && value.degrees != Vec3::ZERO {
        return numbers(&value.degrees.to_array());
    }
    numbers(&value.quat().to_array())
}

/// Writes `name` as a constant, or merges its key frames by time into `keys`, one table a key frame.
fn track<T: Lerp>(
    table: &mut Table,
    keys: &mut Vec<(f64, Table)>,
    name: &str,
    track: &Track<T>,
    write: fn(T) -> Value,
) {
    if track.is_constant() {
        table.insert(name.into(), write(track.at(0.0)));
        return;
    }
    // Two keys at one time are a jump. They stay apart, in their order.
    let mut from = 0;
    for (time, value) in track.keys() {
        let entry = match keys.iter().skip(from).position(|(known, _)| *known == time) {
            Some(index) => from + index,
            None => {
                keys.push((time, Table::from_iter([("time".to_owned(), Value::Float(time))])));
                keys.len() - 1
            }
        };
        keys[entry].1.insert(name.into(), write(value));
        from = entry + 1;
    }
}

fn with_keys(mut table: Table, mut keys: Vec<(f64, Table)>) -> Table {
    if !keys.is_empty() {
        keys.sort_by(|a, b| a.0.total_cmp(&b.0));
        table.insert("key".into(), keys.into_iter().map(|(_, key)| Value::Table(key)).collect::<Vec<_>>().into());
    }
    table
}

/// Says in a scene file's words where an object stands.
pub fn placement_table(placement: &Placement) -> Table {
    let (mut table, mut keys) = (Table::new(), Vec::new());
    track(&mut table, &mut keys, "translation", &placement.translation, vector);
    track(&mut table, &mut keys, "rotation", &placement.rotation, rotation);
    track(&mut table, &mut keys, "scale", &placement.scale, vector);
    with_keys(table, keys)
}

fn object_table(object: &Object, file: &str) -> Table {
    let mut table = placement_table(&object.placement);
    table.insert("name".into(), object.name.clone().into());
    table.insert("gltf".into(), file.into());
    match object.clip.and_then(|clip| object.model.rig.clips.get(clip)) {
        Some(clip) => {
            table.insert("clip".into(), clip.name.clone().into());
            table.insert("speed".into(), object.speed.into());
        }
        None if !object.model.rig.clips.is_empty() => {
            table.insert("clip".into(), "none".into());
        }
        None => {}
    }
    table
}

/// Describes a camera in a scene file's words.
pub fn camera_table(camera: &CameraTrack) -> Table {
    let mut table = Table::new();
    let mut keys = Vec::new();
    track(&mut table, &mut keys, "position", &camera.position, vector);
    match &camera.aim {
        Aim::LookAt(target) => track(&mut table, &mut keys, "look_at", target, vector),
        Aim::Angles { yaw, pitch } => {
            track(&mut table, &mut keys, "yaw", yaw, number);
            track(&mut table, &mut keys, "pitch", pitch, number);
        }
    }
    track(&mut table, &mut keys, "fov_y", &camera.fov_y_degrees, number);
    table
        .insert("size".into(), camera.size.iter().map(|side| Value::from(i64::from(*side))).collect::<Vec<_>>().into());
    with_keys(table, keys)
}
