//! Reads nodes: which are drawn, and how each stands in its parent.

use super::{File, Read, accessor, fault, json::Json};
use crate::scene::{
    animation::Transform,
    model::{Local, Model, Node, Rig},
};
use glam::{Affine3A, Mat4, Quat, Vec3};

/// A node that is drawn.
#[derive(Clone, Copy)]
pub(super) struct Drawn {
    /// Its number in the file.
    pub source: usize,
    /// Its place in the model.
    pub place: usize,
    /// The number of its mesh in the file.
    pub mesh: Option<usize>,
    pub skin: Option<usize>,
}

/// Adds the nodes of the scene to the model, as yet without meshes.
pub(super) fn load(file: &File, parents: &[Option<usize>], model: &mut Model) -> Vec<Drawn> {
    let mut drawn: Vec<Drawn> = Vec::new();
    let mut place = vec![None; file.root.list("nodes").len()];
    for (source, parent) in order(file, parents) {
        let node = file.root.entry("nodes", source);
        let mesh = node.index("mesh").filter(|mesh| {
            let exists = file.root.entry("meshes", *mesh).exists();
            if !exists {
                file.warn(&format!("node {source}"), "its mesh does not exist: left out");
            }
            exists
        });
        place[source] = Some(model.rig.nodes.len());
        drawn.push(Drawn { source, place: model.rig.nodes.len(), mesh, skin: node.index("skin") });
        let parent = parent.and_then(|parent: usize| place[parent]);
        let weights = mesh.map_or_else(Vec::new, |mesh| weights(file, node, mesh));
        model.rig.nodes.push(Node { weights, ..plain(file, source, parent) });
    }
    drawn
}

/// Returns a node of the file without what it draws.
fn plain(file: &File, source: usize, parent: Option<usize>) -> Node {
    let node = file.root.entry("nodes", source);
    let name = node.name_or(format!("node {source}"));
    Node { name, parent, local: local(file, source, node), mesh: None, weights: Vec::new() }
}

/// Returns the parent of each node of the file: the first that names it.
pub(super) fn parents(file: &File) -> Vec<Option<usize>> {
    let mut parents = vec![None; file.root.list("nodes").len()];
    for (parent, node) in file.root.list("nodes").enumerate() {
        for child in node.indices("children") {
            parents.get_mut(child).into_iter().for_each(|entry| *entry = entry.or(Some(parent)));
        }
    }
    parents
}

/// Adds the joints of a skin that are not in the scene, with all that they stand in, and notes their places.
pub(super) fn add_joints(
    file: &File,
    skin: usize,
    parents: &[Option<usize>],
    place: &mut [Option<usize>],
    rig: &mut Rig,
) {
    for joint in file.root.entry("skins", skin).indices("joints") {
        let mut missing = Vec::new();
        let mut at = Some(joint).filter(|joint| *joint < parents.len());
        while let Some(node) = at.filter(|node| place[*node].is_none()) {
            // A mark ends the walk where nodes stand in a circle.
            place[node] = Some(usize::MAX);
            missing.push(node);
            at = parents[node];
        }
        if !missing.is_empty() {
            file.warn(&format!("skin {skin}"), "has a joint that is not in the scene: it stands in its own parents");
        }
        for node in missing.into_iter().rev() {
            let parent = parents[node].and_then(|parent| place[parent]).filter(|parent| *parent != usize::MAX);
            place[node] = Some(rig.nodes.len());
            rig.nodes.push(plain(file, node, parent));
        }
    }
}

/// Returns where each node of the file is in the model.
pub(super) fn places(file: &File, drawn: &[Drawn]) -> Vec<Option<usize>> {
    let mut places = vec![None; file.root.list("nodes").len()];
    drawn.iter().for_each(|node| places[node.source] = Some(node.place));
    places
}

/// Places a mesh of the model, of which is known whether it is skinned. A skinned one gets a node of its own, because
/// its node's transform counts for nothing; one with EXT_mesh_gpu_instancing gets a node for each instance.
pub(super) fn give_mesh(file: &File, rig: &mut Rig, drawn: Drawn, (mesh, skinned): (usize, bool)) {
    let node = file.root.entry("nodes", drawn.source);
    let name = rig.nodes[drawn.place].name.clone();
    if skinned {
        let local = Local::Transform(Transform::IDENTITY);
        rig.nodes.push(Node { name, parent: None, local, mesh: Some(mesh), weights: Vec::new() });
        return;
    }
    let instancing = node.extension("EXT_mesh_gpu_instancing").get("attributes");
    if instancing.exists() {
        match instances(file, instancing, &format!("node {}", drawn.source)) {
            Ok(locals) => {
                let node = |local| Node {
                    name: name.clone(),
                    parent: Some(drawn.place),
                    local,
                    mesh: Some(mesh),
                    weights: Vec::new(),
                };
                rig.nodes.extend(locals.into_iter().map(node));
                return;
            }
            Err(fault) => file.left_out(fault),
        }
    }
    rig.nodes[drawn.place].mesh = Some(mesh);
}

/// Returns the weights of a mesh's morph targets: the node's, else the mesh's, else 0.
fn weights(file: &File, node: Json, mesh: usize) -> Vec<f32> {
    let mesh = file.root.entry("meshes", mesh);
    let count = mesh.list("primitives").map(|primitive| primitive.list("targets").len()).max().unwrap_or(0);
    let mut weights = node.floats("weights");
    if weights.is_empty() {
        weights = mesh.floats("weights");
    }
    weights.resize(count, 0.0);
    weights
}

fn instances(file: &File, attributes: Json, user: &str) -> Read<Vec<Local>> {
    fn read<const N: usize>(file: &File, attributes: Json, name: &str, user: &str) -> Read<Option<Vec<[f32; N]>>> {
        let index = attributes.index(name);
        index.map(|index| accessor::elements(file, index, user)?.vectors(user)).transpose()
    }
    let translations = read::<3>(file, attributes, "TRANSLATION", user)?;
    let rotations = read::<4>(file, attributes, "ROTATION", user)?;
    let scales = read::<3>(file, attributes, "SCALE", user)?;
    let lengths =
        [translations.as_ref().map(Vec::len), rotations.as_ref().map(Vec::len), scales.as_ref().map(Vec::len)];
    let count = lengths.into_iter().flatten().next().unwrap_or(0);
    if count == 0 || count > 1 << 20 || lengths.into_iter().flatten().any(|length| length != count) {
        return Err(fault(format!("{user}: its instances are none, too many, or differ in number")));
    }
    file.count_corners(count)?;
    let local = |i: usize| {
        let vector = |values: &Option<Vec<[f32; 3]>>, default| values.as_ref().map_or(default, |v| Vec3::from(v[i]));
        Local::Transform(Transform {
            translation: vector(&translations, Vec3::ZERO),
            rotation: rotations.as_ref().map_or(Quat::IDENTITY, |r| unit(Quat::from_array(r[i]))),
            scale: vector(&scales, Vec3::ONE),
        })
    };
    Ok((0..count).map(local).collect())
}

fn unit(rotation: Quat) -> Quat {
    if rotation.is_finite() && rotation.length() > 1e-6 { rotation.normalize() } else { Quat::IDENTITY }
}

/// Returns the nodes of the default scene (else of the first that has any, else all), each with its parent,
/// parents first.
fn order(file: &File, parents: &[Option<usize>]) -> Vec<(usize, Option<usize>)> {
    let nodes = parents.len();
    let scenes: Vec<Vec<usize>> = file.root.list("scenes").map(|scene| scene.indices("nodes")).collect();
    let wanted = file.root.index("scene").unwrap_or(0);
    let filled = |roots: &&Vec<usize>| !roots.is_empty();
    let all = || (0..nodes).filter(|node| parents[*node].is_none()).collect();
    let roots = match (scenes.get(wanted).filter(filled), scenes.iter().find(filled)) {
        (Some(roots), _) => roots.clone(),
        (None, Some(roots)) => {
            file.warn(&format!("scene {wanted}"), "does not exist or has no nodes: the first that has some is taken");
            roots.clone()
        }
        (None, None) => {
            if !scenes.is_empty() && nodes > 0 {
                file.warn("scenes", "have no nodes: all nodes are taken");
            }
            all()
        }
    };
    let mut seen = vec![false; nodes];
    let mut order = Vec::new();
    let mut stack: Vec<(usize, Option<usize>)> = roots.into_iter().rev().map(|root| (root, None)).collect();
    while let Some((node, parent)) = stack.pop() {
        match seen.get_mut(node) {
            None => file.warn(&format!("node {node}"), "does not exist: left out"),
            Some(true) => file.warn(&format!("node {node}"), "has two parents or is its own ancestor: drawn once"),
            Some(seen) => {
                *seen = true;
                order.push((node, parent));
                let children = file.root.entry("nodes", node).indices("children");
                stack.extend(children.into_iter().rev().map(|child| (child, Some(node))));
            }
        }
    }
    order
}

fn local(file: &File, index: usize, node: Json) -> Local {
    let user = format!("node {index}");
    if let Some(matrix) = node.numbers::<16>("matrix") {
        return Local::Matrix(Affine3A::from_mat4(Mat4::from_cols_array(&matrix)));
    }
    for key in ["matrix", "translation", "scale"] {
        let fits = key != "matrix" && node.numbers::<3>(key).is_some();
        if node.get(key).exists() && !fits {
            file.warn(&user, &format!("its {key} is not of finite numbers: passed over"));
        }
    }
    let rotation = match node.numbers::<4>("rotation").map(Quat::from_array) {
        Some(rotation) if rotation.length() > 1e-6 => rotation.normalize(),
        _ => {
            if node.get("rotation").exists() {
                file.warn(&user, "its rotation is none: passed over");
            }
            Quat::IDENTITY
        }
    };
    Local::Transform(Transform {
        translation: Vec3::from(node.numbers("translation").unwrap_or([0.0; 3])),
        rotation,
        scale: Vec3::from(node.numbers("scale").unwrap_or([1.0; 3])),
    })
}
