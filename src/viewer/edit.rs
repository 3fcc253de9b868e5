//! Edits the scene by hand: add, remove, place, give other materials, undo and redo.

use crate::{
    Error, Result,
    scene::{
        Object, Scene,
        animation::{Placement, Transform},
        bounds::Bounds,
        file::read_scene_file,
        gltf,
        material::Material,
        material_override::{Copies, MaterialOverride},
        model::Model,
        rooms::Room,
        shapes::Shape,
    },
};
use glam::Vec3;
use std::{
    path::{Path, PathBuf},
    sync::Arc,
    time::{Duration, Instant},
};

/// Where a scene comes from. It decides how the scene is saved.
#[derive(Clone, Debug)]
pub enum Origin {
    /// A scene file.
    File(PathBuf),
    /// A built-in room.
    Room(Box<Room>),
}

/// Where an object comes from.
#[derive(Clone, Debug, PartialEq)]
pub enum Made {
    /// The scene, with the object's place among the objects there.
    Kept(usize),
    /// A glTF file.
    Gltf(PathBuf),
    /// A shape with its full extents, metres.
    Shape(Shape, Vec3),
}

/// What was set of an object's materials by hand.
#[derive(Clone, Default)]
pub struct Painted {
    pub by: MaterialOverride,
    /// What the scene file sets.
    pub of_file: MaterialOverride,
    /// The model as it was before anything was set by hand.
    before: Option<Arc<Model>>,
}

impl Painted {
    /// Whether anything was ever set by hand, even if it was taken back.
    pub fn is_touched(&self) -> bool {
        self.before.is_some()
    }
}

/// One state of the scene.
#[derive(Clone)]
struct State {
    /// The step that led to it, in words.
    step: String,
    scene: Arc<Scene>,
    made: Vec<Made>,
    painted: Vec<Painted>,
    selected: Option<usize>,
}

/// The edited scene and its history of steps.
pub struct Editor {
    now: State,
    before: Vec<State>,
    after: Vec<State>,
    /// Whether the next placement begins a step of its own.
    fresh_step: bool,
    /// Where the scene comes from.
    pub origin: Origin,
    /// The scene as it was opened or last saved.
    saved: Arc<Scene>,
    /// When the wheel was last turned, and in which frame, if nothing else was done since.
    wheel: Option<(Instant, u64)>,
}

/// Turns of the wheel that follow each other faster are one gesture.
const GESTURE: Duration = Duration::from_millis(600);

/// The most steps that can be undone.
const STEPS: usize = 200;

impl Editor {
    /// Makes an editor of a scene that was not changed yet.
    pub fn new(scene: Scene, origin: Origin) -> Self {
        let made = (0..scene.objects().count()).map(Made::Kept).collect();
        let scene = Arc::new(scene);
        let mut painted = vec![Painted::default(); scene.objects().count()];
        if let Origin::File(path) = &origin {
            let specs = read_scene_file(path).map_or_else(|_| Vec::new(), |file| file.objects);
            for (painted, spec) in painted.iter_mut().zip(specs) {
                painted.of_file = spec.material.unwrap_or_default();
            }
        }
        let now = State { step: "as opened".into(), scene: Arc::clone(&scene), made, painted, selected: None };
        Self { now, before: Vec::new(), after: Vec::new(), fresh_step: true, origin, saved: scene, wheel: None }
    }

    /// The scene as it is now.
    pub fn scene(&self) -> &Arc<Scene> {
        &self.now.scene
    }

    /// Where each object comes from.
    pub fn made(&self) -> &[Made] {
        &self.now.made
    }

    /// The selected object, which keys and panels act on.
    pub fn selected(&self) -> Option<usize> {
        self.now.selected
    }

    /// Selects an object, or none.
    pub fn select(&mut self, index: Option<usize>) {
        self.now.selected = index.filter(|index| *index < self.now.made.len());
    }

    /// The names of all objects.
    pub fn names(&self) -> Vec<String> {
        self.now.scene.objects().map(|object| object.name.clone()).collect()
    }

    /// Where an object is at a time.
    pub fn transform(&self, index: usize, time: f64) -> Transform {
        self.now.scene.objects().nth(index).map_or(Transform::IDENTITY, |object| object.placement.at(time))
    }

    /// An object's box in the world at a time, metres.
    pub fn bounds(&self, index: usize, time: f64) -> Bounds {
        self.now.scene.object_bounds(index, time)
    }

    /// Begins a step. All that follows until the next call is undone as one.
    pub fn begin_step(&mut self) {
        (self.fresh_step, self.wheel) = (true, None);
    }

    /// Begins a step with a turn of the wheel in this frame, unless it goes on with the last one.
    pub fn begin_wheel(&mut self, now: Instant, frame: u64) {
        let follows = |(last, number): (Instant, u64)| now.duration_since(last) < GESTURE || frame <= number + 1;
        self.fresh_step |= !self.wheel.is_some_and(follows);
        self.wheel = Some((now, frame));
    }

    /// Says whether there is anything to save.
    pub fn changed(&self) -> bool {
        !Arc::ptr_eq(&self.now.scene, &self.saved)
    }

    /// Takes the scene as it is for saved.
    pub fn mark_saved(&mut self) {
        self.saved = Arc::clone(&self.now.scene);
    }

    /// The steps in words, the first of which is the scene as it was opened, and the number of the last that was done.
    pub fn steps(&self) -> (Vec<String>, usize) {
        let all = self.before.iter().chain(std::iter::once(&self.now)).chain(self.after.iter().rev());
        (all.map(|state| state.step.clone()).collect(), self.before.len())
    }

    /// Undoes or repeats steps until this one is the last that was done.
    pub fn go_to(&mut self, step: usize) {
        while self.before.len() > step && self.undo() {}
        while self.before.len() < step && self.redo() {}
    }

    /// Keeps the state as it is, before a step.
    fn remember(&mut self, step: String) {
        self.before.push(self.now.clone());
        self.now.step = step;
        if self.before.len() > STEPS {
            self.before.remove(0);
        }
        self.after.clear();
    }

    /// Puts an object where `to` says. Its motion goes along.
    pub fn place(&mut self, index: usize, to: Transform, time: f64) {
        let Some(object) = self.now.scene.objects().nth(index) else { return };
        if object.placement.at(time) == to || to.scale.abs().min_element() < 1e-6 || !to.translation.is_finite() {
            return;
        }
        let was = object.placement.at(time);
        let way = match () {
            () if was.rotation != to.rotation => "turn",
            () if was.scale != to.scale => "scale",
            () => "move",
        };
        let (placement, step) = (object.placement.moved(time, to), format!("{way} {}", object.name));
        if std::mem::take(&mut self.fresh_step) {
            self.remember(step);
        }
        let mut scene = Scene::clone(&self.now.scene);
        scene.place(index, placement);
        self.now.scene = Arc::new(scene);
    }

    /// Adds an object, selects it, and returns its place among the others. Placing it is part of the same
    /// step until the next [`Editor::begin_step`].
    ///
    /// # Errors
    /// Fails if the scene cannot be packed.
    pub fn add(&mut self, mut object: Object, made: Made) -> Result<usize> {
        let names = self.names();
        let stem = object.name.clone();
        let mut number = 2;
        while names.contains(&object.name) {
            object.name = format!("{stem}-{number}");
            number += 1;
        }
        let step = format!("add {}", object.name);
        let mut objects: Vec<Object> = self.now.scene.objects().cloned().collect();
        objects.push(object);
        let scene = self.now.scene.with_objects(&objects)?;
        self.remember(step);
        self.now.scene = Arc::new(scene);
        self.now.made.push(made);
        self.now.painted.push(Painted::default());
        self.now.selected = Some(objects.len() - 1);
        self.fresh_step = false; // putting it somewhere is part of adding it
        Ok(objects.len() - 1)
    }

    /// Adds a copy of the selected object beside it, in this direction, and selects it.
    ///
    /// # Errors
    /// Fails if the scene cannot be packed.
    pub fn duplicate(&mut self, time: f64, aside: Vec3) -> Result<()> {
        let Some((index, object)) = self.now.selected.and_then(|i| Some((i, self.now.scene.objects().nth(i)?.clone())))
        else {
            return Ok(());
        };
        let bounds = self.bounds(index, time);
        let mut to = object.placement.at(time);
        to.translation += 1.1 * (bounds.max - bounds.min).dot(aside.abs()) * aside;
        let painted = self.now.painted[index].clone();
        let copy = self.add(object, self.now.made[index].clone())?;
        self.now.painted[copy] = painted;
        self.place(copy, to, time);
        Ok(())
    }

    /// Removes the selected object.
    ///
    /// # Errors
    /// Fails if the scene cannot be packed.
    pub fn remove(&mut self) -> Result<()> {
        let Some(index) = self.now.selected else { return Ok(()) };
        let mut objects: Vec<Object> = self.now.scene.objects().cloned().collect();
        let removed = objects.remove(index);
        let scene = self.now.scene.with_objects(&objects)?;
        self.remember(format!("remove {}", removed.name));
        self.now.scene = Arc::new(scene);
        self.now.made.remove(index);
        self.now.painted.remove(index);
        self.now.selected = None;
        Ok(())
    }

    /// What was set of an object's materials by hand.
    pub fn painted(&self, index: usize) -> Option<&Painted> {
        self.now.painted.get(index)
    }

    /// An object's first material, as it is now.
    pub fn material(&self, index: usize) -> Option<&Material> {
        self.now.scene.objects().nth(index)?.model.materials.first()
    }

    /// Sets values of all materials of an object, and takes back what was set before and is not given. Part of the same
    /// step until the next [`Editor::begin_step`].
    ///
    /// # Errors
    /// Fails if the scene cannot be packed.
    pub fn paint(&mut self, index: usize, by: MaterialOverride) -> Result<()> {
        // The panel asks in every frame of the window.
        let Some(painted) = self.now.painted.get(index).filter(|painted| painted.by != by) else { return Ok(()) };
        let mut objects: Vec<Object> = self.now.scene.objects().cloned().collect();
        let Some(object) = objects.get_mut(index) else { return Ok(()) };
        let before = painted.before.clone().unwrap_or_else(|| object.model.clone());
        let mut model = Model::clone(&before);
        by.apply(&mut model.materials, &mut model.textures, &mut Copies::default());
        object.model = if by == MaterialOverride::default() { before.clone() } else { Arc::new(model) };
        let step = format!("material of {}", object.name);
        let scene = self.now.scene.with_objects(&objects)?;
        if std::mem::take(&mut self.fresh_step) {
            self.remember(step);
        }
        self.now.scene = Arc::new(scene);
        let painted = &mut self.now.painted[index];
        (painted.by, painted.before) = (by, Some(before));
        Ok(())
    }

    /// Takes back the last step. Returns whether there was one.
    pub fn undo(&mut self) -> bool {
        let Some(state) = self.before.pop() else { return false };
        self.after.push(std::mem::replace(&mut self.now, state));
        self.begin_step();
        true
    }

    /// Repeats the step that was undone. Returns whether there was one.
    pub fn redo(&mut self) -> bool {
        let Some(state) = self.after.pop() else { return false };
        self.before.push(std::mem::replace(&mut self.now, state));
        self.begin_step();
        true
    }
}

/// Reads a glTF file as an object at the origin.
///
/// # Errors
/// Fails if the file cannot be read or used, or if it is another kind of file.
pub fn load_object(path: &Path) -> Result<(Object, Made)> {
    let kind = path.extension().and_then(|e| e.to_str()).map(str::to_lowercase);
    if !matches!(kind.as_deref(), Some("glb" | "gltf")) {
        return Err(Error::input(path.display(), "is neither .glb nor .gltf", "drop a glTF model"));
    }
    let (model, warnings) = gltf::load(path)?;
    crate::warnings::tell(&warnings);
    if model.meshes.is_empty() {
        return Err(Error::input(path.display(), "holds no triangles", "drop a glTF model that has some"));
    }
    let name = path.file_stem().map_or_else(|| "object".into(), |stem| stem.to_string_lossy().into_owned());
    let clip = (!model.rig.clips.is_empty()).then_some(0);
    let placement = Placement::fixed(Transform::IDENTITY);
    let path = std::path::absolute(path).unwrap_or_else(|_| path.to_owned());
    Ok((Object { name, model: Arc::new(model), placement, clip, speed: 1.0 }, Made::Gltf(path)))
}

/// Makes an object of a shape at the origin, as a scene file without a material does.
pub fn shape_object(shape: Shape, size: Vec3) -> (Object, Made) {
    let name = Shape::NAMES[shape as usize].to_owned();
    let material = Material::plain(&name, Vec3::splat(0.8), 0.5);
    let model = Arc::new(Model { name: name.clone(), ..Model::from_mesh(shape.mesh(size), material) });
    let placement = Placement::fixed(Transform::IDENTITY);
    (Object { name, model, placement, clip: None, speed: 1.0 }, Made::Shape(shape, size))
}
