//! Loads glTF 2.0 files as [`Model`]s. `docs/scene.md` says what is read.
//!
//! The file is read leniently: by its JSON, asked for one member at a time, and not by types that a whole
//! file must fit. What is odd, optional or unused is left out, and a warning names it. Only a shape that
//! cannot be known refuses the file. Nothing a file says is trusted unchecked.

mod accessor;
mod animation;
pub mod export;
mod extension;
mod gloss;
mod json;
mod light;
mod material;
mod mesh;
mod meshopt;
mod node;
mod resource;
mod skin;
mod tangent;
mod texture;

use super::{
    fields::nearest,
    model::{Model, Rig},
};
use crate::{Error, Result, image_file::read};
use json::Json;
use serde_json::Value;
use std::{
    cell::{Cell, OnceCell, RefCell},
    collections::BTreeMap,
    path::Path,
    sync::Arc,
};

/// Loads a `.gltf` or `.glb` file. The warnings name what was left out.
///
/// # Errors
/// Fails if the file cannot be read, is no glTF 2.0, or has geometry that cannot be read.
pub fn load(path: &Path) -> Result<(Model, Vec<String>)> {
    load_variant(path, None)
}

/// Loads a file with its materials as the named variant has them (KHR_materials_variants).
///
/// # Errors
/// Fails as [`load`] does, or if the file has no variant of this name.
pub fn load_variant(path: &Path, variant: Option<&str>) -> Result<(Model, Vec<String>)> {
    let subject = path.display().to_string();
    let bytes = read::read_bytes(path)?;
    let refuse = |Fault { problem, remedy }: Fault| Error::input(&subject, problem, remedy);
    let (root, blob) = parse(&bytes).map_err(refuse)?;
    let file = File::new(&subject, path.parent().unwrap_or(Path::new("")), Json::new(&root), blob).map_err(refuse)?;
    let file = file.with_variant(variant).map_err(refuse)?;
    let mut model = file.model().map_err(refuse)?;
    model.name = path.file_stem().map_or_else(|| "model".into(), |stem| stem.to_string_lossy().into_owned());
    Ok((model, file.into_warnings()))
}

/// Why something cannot be read.
#[derive(Clone)]
struct Fault {
    problem: String,
    remedy: String,
}

type Read<T> = std::result::Result<T, Fault>;

/// The remedy where nothing better is known.
const REPAIR: &str = "repair the glTF file or export it again";

fn fault(problem: impl ToString) -> Fault {
    Fault { problem: problem.to_string(), remedy: REPAIR.into() }
}

/// Splits a file into its JSON and the binary chunk of a `.glb`.
fn parse(bytes: &[u8]) -> Read<(Value, Option<&[u8]>)> {
    if bytes.is_empty() {
        return Err(fault("the file is empty"));
    }
    let (mut text, mut blob) = (bytes, None);
    if bytes.starts_with(b"glTF") {
        let word = |at: usize| bytes.get(at..at + 4).map(|b| u32::from_le_bytes([b[0], b[1], b[2], b[3]]) as usize);
        let truncated = || fault("the GLB header states a length that does not fit the file");
        if word(4) == Some(1) {
            return Err(other_version("1"));
        }
        let end = 20 + word(12).ok_or_else(truncated)?;
        text = bytes.get(20..end).ok_or_else(truncated)?;
        // Chunks that are not known are passed over.
        let mut at = end.next_multiple_of(4);
        while let (Some(length), Some(kind), None) = (word(at), word(at + 4), blob) {
            let chunk = &bytes[at + 8..bytes.len().min(at + 8 + length)];
            blob = (kind == 0x004E_4942).then_some(chunk);
            at = (at + 8 + length).next_multiple_of(4);
        }
    }
    let text = String::from_utf8_lossy(text);
    let text = text.trim_start_matches('\u{feff}').trim_end_matches('\0');
    let parsed = serde_json::from_str(text).or_else(|error| {
        // Some exporters write numbers that JSON does not have.
        serde_json::from_str(&json::without_nan(text)).map_err(|_| error)
    });
    let root: Value = parsed.map_err(|error| fault(format!("is not glTF: {}", read::one_line(&error))))?;
    if !root.is_object() {
        return Err(fault("is not glTF: it holds no JSON object"));
    }
    Ok((root, blob))
}

fn other_version(version: &str) -> Fault {
    let problem = format!("asks for version {}, not 2.0", read::one_line(&version));
    Fault { problem, remedy: "export it as glTF 2.0".into() }
}

struct File<'a> {
    subject: &'a str,
    folder: &'a Path,
    root: Json<'a>,
    blob: Option<&'a [u8]>,
    buffers: Vec<OnceCell<Read<Vec<u8>>>>,
    /// Buffer views that were compressed.
    views: Vec<OnceCell<Read<Vec<u8>>>>,
    /// What is to be told, with the first place where it was met and how often.
    warnings: RefCell<BTreeMap<String, (String, usize)>>,
    /// Vertices and triangle corners read so far.
    corners: Cell<usize>,
    /// What was found to be too much.
    full: RefCell<Option<Fault>>,
    /// The number of the variant whose materials are taken.
    variant: Option<usize>,
    /// Elements of accessors without a buffer so far: of those that are all zero, and of sparse ones.
    zeros: Cell<usize>,
    sparse: Cell<usize>,
    /// Bytes of all numbers read so far: each shape of a mesh that several nodes pose reads its own.
    read: Cell<u64>,
    /// The first fault for which a shape was left out.
    lost: RefCell<Option<Fault>>,
}

const MAX_CORNERS: usize = 1 << 25;
const MAX_WARNINGS: usize = 100;

impl<'a> File<'a> {
    fn new(subject: &'a str, folder: &'a Path, root: Json<'a>, blob: Option<&'a [u8]>) -> Read<Self> {
        let asset = root.get("asset");
        let version = asset.text("minVersion").or(asset.text("version"));
        if let Some(version) = version.filter(|version| *version != "2" && !version.starts_with("2.")) {
            return Err(other_version(version));
        }
        let file = Self {
            subject,
            folder,
            root,
            blob,
            buffers: root.list("buffers").map(|_| OnceCell::new()).collect(),
            views: root.list("bufferViews").map(|_| OnceCell::new()).collect(),
            warnings: RefCell::default(),
            corners: Cell::new(0),
            full: RefCell::default(),
            variant: None,
            zeros: Cell::new(0),
            sparse: Cell::new(0),
            read: Cell::new(0),
            lost: RefCell::default(),
        };
        if version.is_none() {
            file.warn("asset", "has no version: 2.0 is taken");
        }
        extension::check(&file)?;
        Ok(file)
    }

    fn with_variant(self, name: Option<&str>) -> Read<Self> {
        let Some(name) = name else { return Ok(self) };
        let variants = self.root.extension("KHR_materials_variants").list("variants");
        let names: Vec<&str> = variants.map(|variant| variant.text("name").unwrap_or_default()).collect();
        match names.iter().position(|known| *known == name) {
            Some(index) => Ok(Self { variant: Some(index), ..self }),
            None => Err(Fault {
                problem: format!("has no variant \"{}\"", read::one_line(&name)),
                remedy: match names.is_empty() {
                    true => "leave variant out: the file has none".into(),
                    false => nearest(name, &names),
                },
            }),
        }
    }

    /// Adds a warning about `place`. The same about other places is counted.
    fn warn(&self, place: &str, message: &str) {
        let mut warnings = self.warnings.borrow_mut();
        let is_new = !warnings.contains_key(message);
        let message =
            if is_new && warnings.len() >= MAX_WARNINGS { "has more warnings, which are not listed" } else { message };
        warnings.entry(message.to_owned()).or_insert_with(|| (place.to_owned(), 0)).1 += 1;
    }

    fn unsupported(&self, place: &str, feature: &str, consequence: &str) {
        self.warn(place, &format!("{feature} is not supported: {consequence}"));
    }

    /// Warns of what could not be read and is not needed.
    fn left_out(&self, fault: Fault) {
        self.instead("left out", fault);
    }

    /// Warns of what could not be read, where `measure` was taken.
    fn instead(&self, measure: &str, Fault { problem, remedy }: Fault) {
        let remedy = if remedy == REPAIR { String::new() } else { format!("; {remedy}") };
        self.warn(measure, &format!("{problem}{remedy}"));
    }

    /// Warns of a shape that could not be read. The file is refused for it if no other can be.
    fn lose(&self, fault: Fault) {
        self.lost.borrow_mut().get_or_insert_with(|| fault.clone());
        self.left_out(fault);
    }

    fn into_warnings(self) -> Vec<String> {
        let line = |(message, (place, count)): (String, (String, usize))| match count {
            1 => format!("{}: {place}: {message}", self.subject),
            n => format!("{}: {place} and {} more: {message}", self.subject, n - 1),
        };
        self.warnings.into_inner().into_iter().map(line).collect()
    }

    /// Counts vertices or corners, unless they are too many.
    fn has_room(&self, corners: usize) -> bool {
        let sum = self.corners.get().saturating_add(corners);
        let fits = sum <= MAX_CORNERS;
        if fits {
            self.corners.set(sum);
        }
        fits
    }

    /// Refuses a file that would fill the memory, from then on.
    fn count_corners(&self, corners: usize) -> Read<()> {
        if self.has_room(corners) && !self.is_full() {
            return Ok(());
        }
        let remedy = "simplify the model".into();
        Err(self.fill(Fault { problem: format!("holds more than {MAX_CORNERS} vertices"), remedy }))
    }

    /// Notes that a file holds too much, and returns what was found first.
    fn fill(&self, fault: Fault) -> Fault {
        self.full.borrow_mut().get_or_insert(fault).clone()
    }

    /// Whether a file was found to hold too much.
    fn is_full(&self) -> bool {
        self.full.borrow().is_some()
    }

    /// Returns a buffer, which is read when it is first needed.
    fn buffer(&self, index: usize) -> Read<&[u8]> {
        let cell = self.buffers.get(index).ok_or_else(|| fault(format!("buffer {index} does not exist")))?;
        cell.get_or_init(|| resource::buffer(self, index)).as_deref().map_err(Fault::clone)
    }

    fn model(&self) -> Read<Model> {
        let mut model = Model::default();
        let parents = node::parents(self);
        let drawn = node::load(self, &parents, &mut model);
        let in_scene = node::places(self, &drawn);
        // Joints may stand elsewhere.
        let mut place = in_scene.clone();
        let mut materials = material::Materials::new(self.root.list("materials").len());
        // A mesh that a skin or weights move is another one at each node.
        let mut meshes: BTreeMap<(usize, Option<usize>, Option<usize>), usize> = BTreeMap::new();
        for node in drawn {
            let Some(mesh) = node.mesh else { continue };
            let morphs = !model.rig.nodes[node.place].weights.is_empty();
            let key = (mesh, node.skin, morphs.then_some(node.place));
            let known = match meshes.get(&key) {
                Some(known) => *known,
                None => {
                    let skin = node.skin.map(|skin| {
                        node::add_joints(self, skin, &parents, &mut place, &mut model.rig);
                        skin::load(self, skin, &place)
                    });
                    let skin = skin.and_then(|skin| skin.map_err(|fault| self.left_out(fault)).ok());
                    let motion = mesh::Motion { skin, weights_of: node.place };
                    let loaded = mesh::load(self, mesh, motion, &mut materials, &mut model)?;
                    model.meshes.push(Arc::new(loaded));
                    meshes.insert(key, model.meshes.len() - 1);
                    model.meshes.len() - 1
                }
            };
            let skinned = model.meshes[known].deform.as_ref().is_some_and(|deform| deform.skin.is_some());
            node::give_mesh(self, &mut model.rig, node, (known, skinned));
        }
        if let (Some(fault), true) = (self.lost.take(), model.meshes.iter().all(|mesh| mesh.triangles.is_empty())) {
            return Err(fault);
        }
        texture::keep_used(&mut model);
        let clips = animation::load(self, &place);
        model.rig = Rig { clips, ..model.rig };
        model.lights = light::load(self, &in_scene);
        Ok(model)
    }
}
