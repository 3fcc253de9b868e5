//! Loads glTF 2.0 files as [`Model`]s. `docs/scene.md` says what is read. A warning names whatever else a
//! file uses, and it is left out. An unknown extension that a file *requires* is an error. Nothing a file
//! says is trusted unchecked.

mod accessor;
mod animation;
pub mod export;
mod light;
mod material;
mod mesh;
mod resource;
mod tangent;

use super::{
    animation::Transform,
    model::{Local, Model, Node, Rig},
};
use crate::{Error, Result, image_file::read};
use ::gltf::json::{
    self,
    validation::{Checked, Validate as _},
};
use glam::{Affine3A, Mat4, Quat, Vec3};
use std::{collections::BTreeSet, path::Path};

const SUPPORTED: [&str; 5] = [
    "KHR_lights_punctual",
    "KHR_materials_emissive_strength",
    "KHR_materials_specular",
    "KHR_materials_ior",
    "KHR_texture_transform",
];

/// Loads a `.gltf` or `.glb` file. The warnings name what was left out.
///
/// # Errors
/// Fails if the file, or one that it names, cannot be read or is broken.
pub fn load(path: &Path) -> Result<(Model, Vec<String>)> {
    let subject = path.display().to_string();
    let bytes = read::read_bytes(path)?;
    let document = parse(&bytes, &subject)?;
    let folder = path.parent().unwrap_or(Path::new(""));
    let mut file = File::new(subject, folder, &document)?;
    let mut model = file.model()?;
    model.name = path.file_stem().map_or_else(|| "model".into(), |stem| stem.to_string_lossy().into_owned());
    Ok((model, file.warnings.into_iter().collect()))
}

fn parse(bytes: &[u8], subject: &str) -> Result<::gltf::Gltf> {
    let broken = |problem: &str| Error::input(subject, problem, "export the glTF file again");
    if bytes.is_empty() {
        return Err(broken("the file is empty"));
    }
    // The parser subtracts the header's size from the length that the file states.
    if bytes.starts_with(b"glTF") {
        let stated = bytes.get(8..12).map_or(0, |b| u32::from_le_bytes([b[0], b[1], b[2], b[3]]));
        if bytes.len() < 20 || stated < 20 || stated as usize > bytes.len() {
            return Err(broken("the GLB header states a length that does not fit the file"));
        }
    }
    let gltf = ::gltf::Gltf::from_slice_without_validation(bytes).map_err(|error| match error {
        ::gltf::Error::Deserialize(error) => broken(&format!("is not glTF: {}", read::one_line(&error))),
        other => broken(&format!("is not glTF: {}", read::one_line(&other))),
    })?;
    validate(gltf.document.as_json(), &broken)?;
    Ok(gltf)
}

/// Runs the glTF crate's validation, and passes over what is allowed here, or is missing and not needed.
fn validate(root: &json::Root, broken: &dyn Fn(&str) -> Error) -> Result<()> {
    // The crate's check of positions indexes the accessors before it has checked the index.
    let position = Checked::Valid(::gltf::Semantic::Positions);
    for (index, mesh) in root.meshes.iter().enumerate() {
        let mut positions = mesh.primitives.iter().filter_map(|primitive| primitive.attributes.get(&position));
        if positions.any(|accessor| accessor.value() >= root.accessors.len()) {
            return Err(broken(&format!("mesh {index}: its POSITION accessor does not exist")));
        }
    }
    let mut problems = Vec::new();
    root.validate(root, json::Path::new, &mut |path, error| {
        let path = path();
        let needless = error == json::validation::Error::Missing
            && [".bufferView", ".POSITION", ".min", ".max"].iter().any(|end| path.as_str().ends_with(end));
        if !needless {
            problems.push(format!("{}: {}", read::one_line(&path), error.to_string().to_lowercase()));
        }
    });
    match problems.as_slice() {
        [] => Ok(()),
        [only] => Err(broken(only)),
        [first, rest @ ..] => Err(broken(&format!("{first} (and {} more)", rest.len()))),
    }
}

struct File<'a> {
    subject: String,
    folder: &'a Path,
    document: &'a ::gltf::Document,
    root: &'a json::Root,
    buffers: Vec<Vec<u8>>,
    /// Distinct warnings, in alphabetical order.
    warnings: BTreeSet<String>,
    /// Vertices and triangle corners read so far.
    corners: usize,
}

const MAX_CORNERS: usize = 1 << 25;

impl<'a> File<'a> {
    fn new(subject: String, folder: &'a Path, gltf: &'a ::gltf::Gltf) -> Result<Self> {
        let root = gltf.document.as_json();
        let mut file = Self {
            subject,
            folder,
            document: &gltf.document,
            root,
            buffers: Vec::new(),
            warnings: BTreeSet::new(),
            corners: 0,
        };
        let versions = [Some(&root.asset.version), root.asset.min_version.as_ref()];
        if let Some(version) = versions.into_iter().flatten().find(|version| !version.starts_with("2.")) {
            return Err(file.broken(format!("asks for version {}, not 2.0", read::one_line(version))));
        }
        for extension in root.extensions_used.iter().filter(|name| !SUPPORTED.contains(&name.as_str())) {
            file.warn(&format!("the extension {}", read::one_line(extension)), "ignored");
        }
        file.buffers = resource::buffers(&file, gltf.blob.as_deref())?;
        Ok(file)
    }

    fn broken(&self, problem: impl ToString) -> Error {
        Error::input(&self.subject, problem, "repair the glTF file or export it again")
    }

    fn warn(&mut self, feature: &str, consequence: &str) {
        let subject = &self.subject;
        self.warnings.insert(format!("{subject}: {feature} is not supported: {consequence}"));
    }

    /// Refuses a file that would fill the memory.
    fn count_corners(&mut self, corners: usize) -> Result<()> {
        self.corners = self.corners.saturating_add(corners);
        if self.corners > MAX_CORNERS {
            return Err(self.broken(format!("holds more than {MAX_CORNERS} vertices")));
        }
        Ok(())
    }

    fn model(&mut self) -> Result<Model> {
        let mut model = Model::default();
        let order = self.node_order()?;
        let mut place = vec![None; self.root.nodes.len()];
        let mut mesh_place = vec![None; self.root.meshes.len()];
        let mut materials = material::Materials::new(self.root.materials.len());
        for (source, parent) in order {
            let node = &self.root.nodes[source];
            place[source] = Some(model.rig.nodes.len());
            let mesh = match node.mesh.map(|mesh| mesh.value()) {
                None => None,
                Some(mesh) => {
                    if mesh_place[mesh].is_none() {
                        let loaded = mesh::load(self, mesh, &mut materials, &mut model)?;
                        mesh_place[mesh] = Some(model.meshes.len());
                        model.meshes.push(loaded);
                    }
                    mesh_place[mesh]
                }
            };
            if node.skin.is_some() {
                self.warn("a skin", "drawn in its rest pose");
            }
            let name = node.name.clone().unwrap_or_else(|| format!("node {source}"));
            let parent = parent.and_then(|parent: usize| place[parent]);
            model.rig.nodes.push(Node { name, parent, local: self.local(source, node)?, mesh });
        }
        let clips = animation::load(self, &place)?;
        model.rig = Rig { clips, ..model.rig };
        model.lights = light::load(self, &place)?;
        Ok(model)
    }

    /// Returns the nodes of the default scene (else the first, else all), each with its parent, parents
    /// first.
    fn node_order(&self) -> Result<Vec<(usize, Option<usize>)>> {
        let nodes = &self.root.nodes;
        let scene = self.root.scene.map_or(0, |scene| scene.value());
        let roots: Vec<usize> = match self.root.scenes.get(scene) {
            Some(scene) => scene.nodes.iter().map(|node| node.value()).collect(),
            None => {
                let children: BTreeSet<usize> =
                    nodes.iter().flat_map(|node| node.children.iter().flatten()).map(|child| child.value()).collect();
                (0..nodes.len()).filter(|node| !children.contains(node)).collect()
            }
        };
        let mut seen = vec![false; nodes.len()];
        let mut order = Vec::new();
        let mut stack: Vec<(usize, Option<usize>)> = roots.into_iter().rev().map(|root| (root, None)).collect();
        while let Some((node, parent)) = stack.pop() {
            match seen.get_mut(node) {
                None => return Err(self.broken(format!("node {node} does not exist"))),
                Some(true) => return Err(self.broken(format!("node {node} has two parents or is its own ancestor"))),
                Some(seen) => *seen = true,
            }
            order.push((node, parent));
            let children = nodes[node].children.iter().flatten().rev();
            stack.extend(children.map(|child| (child.value(), Some(node))));
        }
        Ok(order)
    }

    fn local(&self, index: usize, node: &json::Node) -> Result<Local> {
        let bad = |what: &str| self.broken(format!("node {index} has a {what} that is not finite or has no meaning"));
        if let Some(matrix) = node.matrix {
            if !matrix.iter().all(|value| value.is_finite()) {
                return Err(bad("matrix"));
            }
            return Ok(Local::Matrix(Affine3A::from_mat4(Mat4::from_cols_array(&matrix))));
        }
        let rotation = Quat::from_array(node.rotation.map_or([0.0, 0.0, 0.0, 1.0], |rotation| rotation.0));
        let translation = Vec3::from_array(node.translation.unwrap_or([0.0; 3]));
        let scale = Vec3::from_array(node.scale.unwrap_or([1.0; 3]));
        if !rotation.is_finite() || rotation.length() < 1e-6 {
            return Err(bad("rotation"));
        }
        if !translation.is_finite() || !scale.is_finite() {
            return Err(bad("translation or scale"));
        }
        Ok(Local::Transform(Transform { translation, rotation: rotation.normalize(), scale }))
    }
}
