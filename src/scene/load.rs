//! Loads a scene from a scene file.

use super::{
    CompleteScene,
    fields::nearest,
    file::{self, ObjectSource, ObjectSpec, SceneFile},
    gltf,
    material::Material,
    material_override::Copies,
    model::{Mesh, Model},
    placing,
    plausible::swallowing,
    state::{Object, Scene},
};
use crate::{
    Error, Result,
    panorama::source::{PanoramaFrame, PanoramaSource},
};
use glam::Vec3;
use std::{
    collections::HashMap,
    path::{Path, PathBuf},
    sync::Arc,
};

impl Scene {
    /// Loads a scene file and the objects it names. Panorama frames are found but not read.
    ///
    /// # Errors
    /// Fails with the first problem. [`Scene::problems`] finds all.
    pub fn load(path: &Path) -> Result<Self> {
        let file = file::read_scene_file(path).map_err(first)?;
        let mut loader = Loader::new(path);
        let objects = file.objects.iter().map(|object| loader.object(object)).collect::<Result<Vec<_>>>()?;
        if let Some(room) = &file.room
            && !room.is_file()
        {
            return Err(missing(path, "room.gltf", room));
        }
        let panorama = PanoramaSource::open(file.panorama.clone())?;
        let objects = put_in_place(path, &file.objects, objects, &panorama)?;
        assemble(file, panorama, objects, loader.warnings)
    }

    /// Reads everything that a scene file names, and returns every problem and every warning.
    pub fn problems(path: &Path) -> (Vec<Error>, Vec<String>) {
        let examined = Self::examine(path);
        (examined.problems, examined.warnings)
    }

    /// Reads everything that a scene file names. Also returns the scene and its first frame, as far as they
    /// can be used.
    pub fn examine(path: &Path) -> Examined {
        let file = match file::read_scene_file(path) {
            Ok(file) => file,
            Err(problems) => return Examined { problems, ..Examined::default() },
        };
        let (mut whole, mut first) = (None, None);
        let (mut problems, mut warnings) = (Vec::new(), Vec::new());
        let mut loader = Loader::new(path);
        let mut objects = Vec::new();
        for object in &file.objects {
            match loader.object(object) {
                Ok(object) => objects.push(object),
                Err(problem) => problems.push(problem),
            }
        }
        if let Some(room) = &file.room {
            let loaded = if room.is_file() { gltf::load(room) } else { Err(missing(path, "room.gltf", room)) };
            match loaded {
                Ok((_, room_warnings)) => warnings.extend(room_warnings),
                Err(problem) => problems.push(problem),
            }
        }
        match PanoramaSource::open(file.panorama.clone()) {
            Ok(panorama) => {
                for video in [panorama.video(), panorama.depth_video()].into_iter().flatten() {
                    match video.verify() {
                        Ok(warning) => warnings.extend(warning),
                        Err(problem) => problems.push(problem),
                    }
                }
                // Of a video that can be decoded to its end, a few frames show the rest.
                let count = panorama.frame_count();
                let some =
                    if panorama.video().is_some() { vec![0, count / 2, count - 1] } else { (0..count).collect() };
                for index in some {
                    match panorama.load(index) {
                        Ok(frame) => {
                            warnings.extend(frame.warnings.iter().cloned());
                            first.get_or_insert(frame);
                        }
                        Err(problem) => problems.push(problem),
                    }
                }
                // Without some of the objects it is not known on what the others stand.
                let whole_list = objects.len() == file.objects.len();
                let placed =
                    if whole_list { put_in_place(path, &file.objects, objects, &panorama) } else { Ok(objects) };
                match placed.and_then(|objects| assemble(file, panorama, objects, loader.warnings)) {
                    Ok(scene) => {
                        warnings.extend(scene.warnings.iter().cloned());
                        whole = Some(scene);
                    }
                    Err(problem) => problems.push(problem),
                }
            }
            Err(problem) => {
                problems.push(problem);
                warnings.extend(loader.warnings);
            }
        }
        let mut seen = std::collections::HashSet::new();
        problems.retain(|problem| seen.insert(problem.to_string()));
        warnings.retain(|warning| seen.insert(warning.clone()));
        Examined { problems, warnings, scene: whole, first }
    }
}

/// What is known of a scene file after all that it names was read.
#[derive(Debug, Default)]
pub struct Examined {
    pub problems: Vec<Error>,
    pub warnings: Vec<String>,
    pub scene: Option<Scene>,
    /// The first frame of its panorama that can be read.
    pub first: Option<Arc<PanoramaFrame>>,
}

impl CompleteScene {
    /// Loads the room and the objects that a scene file names, but not the panorama's files.
    /// `panorama.exposure` scales the room's light, as it scales the panorama.
    ///
    /// # Errors
    /// Fails with the first problem, or if the scene file names no room.
    pub fn load(path: &Path, without_objects: bool) -> Result<Self> {
        let file = file::read_scene_file(path).map_err(first)?;
        let Some(room) = &file.room else {
            let subject = format!("{}: room.gltf", path.display());
            let remedy = "add [room] with gltf = \"…\", the true room, or use --model panorama";
            return Err(Error::input(subject, "is missing, so that the true scene is not known", remedy));
        };
        let mut loader = Loader::new(path);
        if !room.is_file() {
            return Err(missing(path, "room.gltf", room));
        }
        let mut room = Model::clone(&*loader.gltf(room, None)?);
        for material in &mut room.materials {
            material.emissive *= file.panorama.exposure;
        }
        for light in &mut room.lights {
            light.intensity *= file.panorama.exposure;
        }
        let specs = if without_objects { &[][..] } else { &file.objects };
        let mut objects = specs.iter().map(|object| loader.object(object)).collect::<Result<Vec<_>>>()?;
        if specs.iter().any(|spec| spec.place.is_some()) {
            objects = put_in_place(path, specs, objects, &PanoramaSource::open(file.panorama.clone())?)?;
        }
        let mut scene = Self::assemble(&file.name, Arc::new(room), file.camera, objects)?;
        scene.fps = file.panorama.fps;
        scene.exposure = file.render.exposure;
        let mut warnings = file.warnings;
        warnings.extend(loader.warnings);
        warnings.append(&mut scene.warnings);
        scene.warnings = distinct(warnings);
        Ok(scene)
    }
}

/// Puts objects where their `place` says.
fn put_in_place(
    scene: &Path,
    specs: &[ObjectSpec],
    objects: Vec<Object>,
    panorama: &PanoramaSource,
) -> Result<Vec<Object>> {
    let mut room = placing::Room::new(panorama);
    let mut placed: Vec<Object> = Vec::with_capacity(objects.len());
    for (spec, mut object) in specs.iter().zip(objects) {
        if let Some(place) = &spec.place {
            let subject = format!("{}: object {}: place", scene.display(), spec.name);
            room.put(&mut object, place, &placed, &subject)?;
        }
        placed.push(object);
    }
    Ok(placed)
}

fn distinct(warnings: Vec<String>) -> Vec<String> {
    let mut seen = std::collections::HashSet::new();
    warnings.into_iter().filter(|warning| seen.insert(warning.clone())).collect()
}

fn first(problems: Vec<Error>) -> Error {
    problems.into_iter().next().unwrap_or_else(|| Error::Internal("a refused scene file without a problem".into()))
}

fn missing(scene: &Path, field: &str, file: &Path) -> Error {
    let problem = format!("{}: there is no such file", file.display());
    Error::input(format!("{}: {field}", scene.display()), problem, "check the name")
}

fn assemble(
    file: SceneFile,
    panorama: PanoramaSource,
    objects: Vec<Object>,
    loaded_warnings: Vec<String>,
) -> Result<Scene> {
    let mut scene = Scene::assemble(&file.name, panorama, file.camera, objects, file.render)?;
    let mut warnings = file.warnings;
    warnings.extend(scene.panorama.warnings.iter().cloned());
    warnings.extend(loaded_warnings);
    let (count, position) = (scene.object_count(), scene.panorama.position);
    let bounds = (0..count).map(|index| (index, scene.object_bounds(index, 0.0)));
    warnings.extend(bounds.filter_map(|(index, bounds)| {
        let object = scene.objects().nth(index)?;
        swallowing(&object.name, bounds, position)
    }));
    warnings.append(&mut scene.warnings);
    (scene.room, scene.warnings) = (file.room, distinct(warnings));
    Ok(scene)
}

/// Loads each glTF file once. Objects share meshes and textures that are the same.
struct Loader<'a> {
    scene: &'a Path,
    models: HashMap<(PathBuf, Option<String>), Arc<Model>>,
    /// By source and material.
    alike: HashMap<String, Arc<Model>>,
    shapes: HashMap<(usize, [u32; 3]), Arc<Mesh>>,
    copies: Copies,
    warnings: Vec<String>,
}

impl<'a> Loader<'a> {
    fn new(scene: &'a Path) -> Self {
        let (models, alike, shapes) = Default::default();
        Self { scene, models, alike, shapes, copies: Copies::default(), warnings: Vec::new() }
    }

    fn object(&mut self, spec: &ObjectSpec) -> Result<Object> {
        if let ObjectSource::Gltf(path) = &spec.source
            && !path.exists()
        {
            return Err(missing(self.scene, &format!("object {}: gltf", spec.name), path));
        }
        let mut model = self.model(spec)?;
        let clips = &model.rig.clips;
        let clip = match spec.clip.as_deref() {
            Some("none") => None,
            None => (!clips.is_empty()).then_some(0),
            Some(name) => Some(clips.iter().position(|clip| clip.name == name).ok_or_else(|| {
                let names: Vec<&str> = clips.iter().map(|clip| clip.name.as_str()).collect();
                let remedy =
                    if names.is_empty() { "leave clip out: the file has none".into() } else { nearest(name, &names) };
                let subject = format!("{}: object {}: clip", self.scene.display(), spec.name);
                Error::input(subject, format!("there is no clip \"{name}\""), remedy)
            })?),
        };
        if let Some(clip) = clip.filter(|_| spec.hold || spec.offset != 0.0) {
            let mut changed = (*model).clone();
            (changed.rig.clips[clip].hold, changed.rig.clips[clip].offset) = (spec.hold, spec.offset);
            model = Arc::new(changed);
        }
        if spec.light != 1.0 && model.lights.is_empty() {
            let subject = format!("{}: object {}: light", self.scene.display(), spec.name);
            let problem = "its file has no light (KHR_lights_punctual)";
            return Err(Error::input(subject, problem, "leave light out, or give material.emissive"));
        }
        if spec.light != 1.0 {
            let mut changed = (*model).clone();
            changed.lights.iter_mut().for_each(|light| light.intensity *= spec.light as f32);
            changed.lights.retain(|light| light.intensity != Vec3::ZERO);
            model = Arc::new(changed);
        }
        let (name, placement) = (spec.name.clone(), spec.placement.clone());
        let mut object = Object { name, model, placement, clip, speed: spec.speed };
        if let Some(side) = spec.side {
            placing::fit(&mut object, side);
        }
        Ok(object)
    }

    /// Returns the model of an object. Objects that look the same share it.
    fn model(&mut self, spec: &ObjectSpec) -> Result<Arc<Model>> {
        let key = format!("{:?} {:?} {:?}", spec.source, spec.variant, spec.material);
        if let Some(model) = self.alike.get(&key) {
            return Ok(model.clone());
        }
        let mut model = match &spec.source {
            ObjectSource::Gltf(path) => self.gltf(path, spec.variant.as_deref())?,
            ObjectSource::Shape(shape, size) => {
                // Grey plastic serves better here than glTF's default, a white metal.
                let material = Material::plain(&spec.name, Vec3::splat(0.8), 0.5);
                let key = (*shape as usize, size.to_array().map(f32::to_bits));
                let mesh = self.shapes.entry(key).or_insert_with(|| Arc::new(shape.mesh(*size)));
                Arc::new(Model { name: spec.name.clone(), ..Model::from_mesh(mesh.clone(), material) })
            }
        };
        if let Some(change) = &spec.material {
            let mut changed = (*model).clone();
            change.apply(&mut changed.materials, &mut changed.textures, &mut self.copies);
            model = Arc::new(changed);
        }
        self.alike.insert(key, model.clone());
        Ok(model)
    }

    fn gltf(&mut self, path: &Path, variant: Option<&str>) -> Result<Arc<Model>> {
        let key = (path.to_path_buf(), variant.map(str::to_owned));
        if let Some(model) = self.models.get(&key) {
            return Ok(model.clone());
        }
        let (model, warnings) = gltf::load_variant(path, variant)?;
        self.warnings.extend(warnings);
        let model = Arc::new(model);
        self.models.insert(key, model.clone());
        Ok(model)
    }
}
