//! Reads meshes. All primitives of one mesh become one triangle list with a material for each triangle.

use super::{
    Fault, File, Read, accessor,
    extension::DRACO,
    fault,
    json::Json,
    material::{Materials, Used},
    skin, tangent,
};
use crate::scene::{
    deform::{Deform, Influences, Skin, Target},
    material::TextureUse,
    model::{Mesh, Model},
};
use glam::{Vec2, Vec3, Vec4};
use std::sync::Arc;

/// One primitive. Every array of vertices is empty or has an entry for each position.
#[derive(Default)]
struct Part {
    positions: Vec<Vec3>,
    normals: Vec<Vec3>,
    uvs: Vec<Vec2>,
    uvs2: Vec<Vec2>,
    tangents: Vec<[f32; 4]>,
    /// Linear.
    colors: Vec<Vec4>,
    triangles: Vec<[u32; 3]>,
    /// The texture along whose coordinates tangents are made.
    along: Option<TextureUse>,
    /// What moves the vertices, if anything does.
    deform: Option<Deform>,
}

/// What moves a mesh: its skin, and the node that has the weights of its morph targets.
pub(super) struct Motion {
    pub skin: Option<Skin>,
    pub weights_of: usize,
}

/// Reads mesh `index`, and adds its materials and textures to `model`. Its vertices stand where `motion` puts them
/// at rest. A primitive that cannot be read is left out, and so is a skin that does not fit the mesh.
///
/// # Errors
/// Fails if the file holds too much.
pub(super) fn load(
    file: &File,
    index: usize,
    mut motion: Motion,
    materials: &mut Materials,
    model: &mut Model,
) -> Read<Mesh> {
    let source = file.root.entry("meshes", index);
    let mut mesh = Mesh { name: source.name_or(index), ..Mesh::default() };
    let user = |number: usize| format!("mesh {index}, primitive {number}");
    let mut influences = influences(file, source, &mut motion, &user).into_iter();
    let mut parts = Vec::new();
    for (number, primitive) in source.list("primitives").enumerate() {
        let user = user(number);
        let mappings = primitive.extension("KHR_materials_variants").list("mappings");
        let varied = file.variant.and_then(|variant| {
            mappings.clone().find(|mapping| mapping.indices("variants").contains(&variant))?.index("material")
        });
        let material = materials.get(file, varied.or(primitive.index("material")), model);
        let moved = Deform {
            weights_of: motion.weights_of,
            skin: motion.skin.clone(),
            influences: influences.next().unwrap_or_default(),
            ..Deform::default()
        };
        match load_part(file, primitive, &user, material, moved, model) {
            Ok(Some(part)) => parts.push((part, material)),
            Ok(None) => {}
            Err(fault) if file.is_full() => return Err(fault),
            Err(fault) => file.lose(fault),
        }
    }
    mesh.deform = joined(&parts, &motion).map(Arc::new);
    for (part, material) in parts {
        let (first, vertices) = (mesh.positions.len(), part.positions.len());
        mesh.positions.extend(part.positions);
        mesh.normals.extend(part.normals);
        mesh.uvs.extend(part.uvs);
        mesh.uvs2.extend(part.uvs2);
        mesh.tangents.extend(part.tangents);
        if !part.colors.is_empty() || !mesh.colors.is_empty() {
            mesh.colors.resize(first, Vec4::ONE);
            mesh.colors.extend(part.colors);
            mesh.colors.resize(first + vertices, Vec4::ONE);
        }
        mesh.materials.extend(std::iter::repeat_n(material.place, part.triangles.len()));
        mesh.triangles.extend(part.triangles.iter().map(|triangle| triangle.map(|vertex| first as u32 + vertex)));
    }
    Ok(mesh)
}

/// Returns the influences of the joints on each primitive. Where they cannot be read, the primitive keeps to the first
/// joint as one without influences does; if no primitive's can, the mesh loses its skin.
fn influences(file: &File, source: Json, motion: &mut Motion, user: &dyn Fn(usize) -> String) -> Vec<Vec<Influences>> {
    let Some(skin) = &motion.skin else { return Vec::new() };
    let of = |(number, primitive): (usize, Json)| {
        let attributes = primitive.get("attributes");
        let positions = file.root.entry("accessors", attributes.index("POSITION").unwrap_or(usize::MAX));
        let vertices = positions.index("count").unwrap_or(0);
        skin::influences(file, attributes, vertices, skin.joints.len(), &user(number))
    };
    let read: Vec<Read<Vec<Influences>>> = source.list("primitives").enumerate().map(of).collect();
    let none = read.iter().all(Result::is_err);
    let measure = if none { "left out, and its skin with it" } else { "taken to move with the first joint" };
    let influences =
        read.into_iter().map(|read| read.map_err(|fault| file.instead(measure, fault)).unwrap_or_default());
    let influences = influences.collect();
    if none {
        motion.skin = None;
    }
    influences
}

/// Joins what moves the parts of a mesh, if anything does.
fn joined(parts: &[(Part, Used)], motion: &Motion) -> Option<Deform> {
    let all = || parts.iter().map(|(part, _)| part);
    let targets = all().filter_map(|part| part.deform.as_ref()).map(|deform| deform.targets.len()).max()?;
    // Where one part has flat normals, all are made anew from the triangles, which have vertices of their own there.
    let normals = all().all(|part| part.deform.as_ref().is_some_and(|deform| !deform.normals.is_empty()));
    let mut whole = Deform {
        weights_of: motion.weights_of,
        skin: motion.skin.clone(),
        targets: vec![Target::default(); targets],
        ..Deform::default()
    };
    for part in all() {
        let count = part.positions.len();
        let own = part.deform.clone().unwrap_or_default();
        whole.positions.extend(if own.positions.is_empty() { part.positions.clone() } else { own.positions });
        if normals {
            whole.normals.extend(own.normals);
        }
        let still = skin::STILL.to_vec();
        whole.influences.extend(if own.influences.is_empty() { vec![still; count] } else { own.influences });
        for (index, target) in whole.targets.iter_mut().enumerate() {
            let own = own.targets.get(index).cloned().unwrap_or_default();
            let filled = |mut values: Vec<Vec3>| {
                values.resize(count, Vec3::ZERO);
                values
            };
            target.positions.extend(filled(own.positions));
            target.normals.extend(filled(own.normals));
        }
    }
    Some(whole)
}

fn load_part(
    file: &File,
    primitive: Json,
    user: &str,
    material: Used,
    moved: Deform,
    model: &Model,
) -> Read<Option<Part>> {
    let mode = match primitive.get("mode").exists() {
        true => primitive.index("mode"),
        false => Some(TRIANGLES),
    };
    if !mode.is_some_and(|mode| (TRIANGLES..=FAN).contains(&mode)) {
        file.unsupported(user, "a point or line", "left out");
        return Ok(None);
    }
    let attributes = primitive.get("attributes");
    let Some(positions) = attributes.index("POSITION") else {
        file.warn(user, "has no POSITION: left out");
        return Ok(None);
    };
    let (draco, converter) = DRACO;
    if primitive.extension(draco).exists() && !file.root.entry("accessors", positions).get("bufferView").exists() {
        let problem = format!("{user}: its geometry is compressed by {draco}, which is not read");
        return Err(Fault { problem, remedy: format!("write it without, as by: {converter}") });
    }
    let elements = accessor::elements(file, positions, user)?;
    let vertices = elements.count;
    file.count_corners(vertices)?;
    let positions = elements.vectors(&format!("{user}: POSITION"))?.into_iter().map(Vec3::from_array).collect();

    // What is not needed to know the shape is left out if it cannot be read.
    let normals = optional(file, attributes, "NORMAL", vertices, user);
    let [uvs, uvs2] = material.sets.map(|set| {
        let uvs = optional(file, attributes, &format!("TEXCOORD_{set}"), vertices, user);
        uvs.map_or_else(|| vec![Vec2::ZERO; vertices], |uvs| uvs.into_iter().map(Vec2::from_array).collect())
    });
    let colors = colors(file, attributes, vertices, user);
    let tangents = if material.tangents.is_some() && normals.is_some() {
        optional(file, attributes, "TANGENT", vertices, user).unwrap_or_default()
    } else {
        Vec::new()
    };
    let corners = match primitive.index("indices") {
        Some(index) => {
            let elements = accessor::elements(file, index, user)?;
            file.count_corners(elements.count)?;
            elements.indices(&format!("{user}: its indices"))?
        }
        None => (0..vertices as u32).collect(),
    };
    let mut part = Part {
        positions,
        normals: normals.into_iter().flatten().map(Vec3::from_array).collect(),
        uvs,
        uvs2,
        tangents,
        colors,
        triangles: triangles(mode.unwrap_or(TRIANGLES), &corners),
        along: material.tangents,
        deform: None,
    };
    let targets = targets(file, primitive, vertices, user);
    if moved.skin.is_some() || !targets.is_empty() {
        let (positions, normals) = (part.positions.clone(), part.normals.clone());
        let mut deform = Deform { positions, normals, targets, ..moved };
        if deform.skin.is_some() && deform.influences.is_empty() {
            deform.influences = vec![skin::STILL.to_vec(); vertices];
        }
        part.rest(deform, model);
    }
    part.leave_out_bad_vertices(file, user);
    if part.normals.is_empty() {
        file.count_corners(part.triangles.len() * 3)?;
        part.unweld();
    }
    part.mend_normals();
    if material.tangents.is_none() {
        part.tangents = vec![[0.0; 4]; part.positions.len()];
    } else if part.tangents.is_empty() {
        file.count_corners(part.triangles.len() * 3)?;
        part = tangent::generate(part);
    }
    Ok(Some(part))
}

/// Reads morph targets. What cannot be read moves nothing.
fn targets(file: &File, primitive: Json, vertices: usize, user: &str) -> Vec<Target> {
    let of = |(number, target): (usize, Json)| {
        let user = format!("{user}, target {number}");
        let read = |name: &str| {
            let accessor = file.root.entry("accessors", target.index(name).unwrap_or(usize::MAX));
            if accessor::is_zero(accessor) {
                return Vec::new();
            }
            let values = optional(file, target, name, vertices, &user).unwrap_or_default();
            values.into_iter().map(Vec3::from_array).collect::<Vec<Vec3>>()
        };
        Target { positions: read("POSITION"), normals: read("NORMAL") }
    };
    let all = primitive.list("targets");
    if !file.has_room(all.len().saturating_mul(vertices)) {
        file.warn(user, "has more morph targets than fit: left out");
        return Vec::new();
    }
    all.enumerate().map(of).collect()
}

/// Reads the colours of vertices, of three or four parts.
fn colors(file: &File, attributes: Json, vertices: usize, user: &str) -> Vec<Vec4> {
    let accessor = attributes.index("COLOR_0").unwrap_or(usize::MAX);
    let four = file.root.entry("accessors", accessor).text("type") == Some("VEC4");
    let colors: Option<Vec<Vec4>> = if four {
        optional(file, attributes, "COLOR_0", vertices, user).map(|c| c.into_iter().map(Vec4::from_array).collect())
    } else {
        let opaque = |color: [f32; 3]| Vec3::from_array(color).extend(1.0);
        optional(file, attributes, "COLOR_0", vertices, user).map(|c| c.into_iter().map(opaque).collect())
    };
    colors.unwrap_or_default().into_iter().map(|color| color.clamp(Vec4::ZERO, Vec4::ONE)).collect()
}

/// Reads an attribute that the shape does not depend on. Numbers that are not finite become 0.
fn optional<const N: usize>(
    file: &File,
    attributes: Json,
    name: &str,
    vertices: usize,
    user: &str,
) -> Option<Vec<[f32; N]>> {
    let index = attributes.index(name)?;
    let read = || {
        let elements = accessor::elements(file, index, user)?;
        if elements.count != vertices {
            return Err(fault(format!("{user}: {name} has {} elements for {vertices} vertices", elements.count)));
        }
        elements.vectors(&format!("{user}: {name}"))
    };
    let finite =
        |values: Vec<[f32; N]>| values.into_iter().map(|v| v.map(|x| if x.is_finite() { x } else { 0.0 })).collect();
    read().map(finite).map_err(|fault| file.left_out(fault)).ok()
}

const TRIANGLES: usize = 4;
const STRIP: usize = 5;
const FAN: usize = 6;

fn triangles(mode: usize, corners: &[u32]) -> Vec<[u32; 3]> {
    match mode {
        STRIP => (0..corners.len().saturating_sub(2))
            .map(|i| if i % 2 == 0 { [i, i + 1, i + 2] } else { [i + 1, i, i + 2] }.map(|i| corners[i]))
            .collect(),
        FAN => corners.windows(2).skip(1).map(|pair| [corners[0], pair[0], pair[1]]).collect(),
        _ => corners.as_chunks().0.to_vec(),
    }
}

impl Part {
    fn face_normal(&self, triangle: &[u32; 3]) -> Vec3 {
        let [a, b, c] = triangle.map(|vertex| self.positions[vertex as usize].as_dvec3());
        (b - a).cross(c - a).normalize_or_zero().as_vec3()
    }

    /// Puts the vertices where they are at rest.
    fn rest(&mut self, deform: Deform, model: &Model) {
        let posed = deform.pose(&deform.stance(&model.rig, None));
        (self.positions, self.normals) = (posed.positions, posed.normals);
        for (tangent, turn) in self.tangents.iter_mut().zip(&posed.turns) {
            let [x, y, z, sign] = *tangent;
            *tangent = (*turn * Vec3::new(x, y, z)).normalize_or_zero().extend(sign).to_array();
        }
        self.deform = Some(deform);
    }

    /// Leaves out triangles with a vertex that does not exist, is not finite or lies beyond 1e9.
    fn leave_out_bad_vertices(&mut self, file: &File, user: &str) {
        let good: Vec<bool> = self.positions.iter().map(|p| p.is_finite() && p.abs().max_element() < 1e9).collect();
        let before = self.triangles.len();
        self.triangles.retain(|corners| corners.iter().all(|corner| good.get(*corner as usize) == Some(&true)));
        let left_out = before - self.triangles.len();
        if left_out > 0 {
            let what = "triangles have a vertex that does not exist, is not finite or lies beyond 1e9";
            file.warn(user, &format!("{left_out} {what}: left out"));
        }
        for (position, _) in self.positions.iter_mut().zip(good).filter(|(_, good)| !good) {
            *position = Vec3::ZERO;
        }
        if let Some(deform) = &mut self.deform {
            let numbers = |v: &mut Vec3| *v = if v.is_finite() { *v } else { Vec3::ZERO };
            deform.positions.iter_mut().for_each(numbers);
        }
    }

    /// Makes vertex `i` what vertex `old[i]` was. Tangents are dropped.
    fn take_vertices(&mut self, old: &[usize]) {
        fn take<T: Copy>(values: &mut Vec<T>, old: &[usize]) {
            if !values.is_empty() {
                *values = old.iter().map(|vertex| values[*vertex]).collect();
            }
        }
        take(&mut self.positions, old);
        take(&mut self.normals, old);
        take(&mut self.uvs, old);
        take(&mut self.uvs2, old);
        take(&mut self.colors, old);
        if let Some(deform) = &mut self.deform {
            take(&mut deform.positions, old);
            take(&mut deform.normals, old);
            if !deform.influences.is_empty() {
                deform.influences = old.iter().map(|vertex| deform.influences[*vertex].clone()).collect();
            }
            for target in &mut deform.targets {
                take(&mut target.positions, old);
                take(&mut target.normals, old);
            }
        }
        self.tangents.clear();
    }

    /// Gives every triangle its own vertices and flat normals. glTF asks for this where there are no normals.
    fn unweld(&mut self) {
        let corners: Vec<usize> = self.triangles.iter().flatten().map(|vertex| *vertex as usize).collect();
        let normals = self.triangles.iter().flat_map(|triangle| [self.face_normal(triangle); 3]).collect();
        self.take_vertices(&corners);
        self.normals = normals;
        self.triangles = (0..corners.len() as u32 / 3).map(|i| [3 * i, 3 * i + 1, 3 * i + 2]).collect();
    }

    /// Makes normals unit. One without length becomes the mean of its triangles'.
    fn mend_normals(&mut self) {
        let lacking: Vec<bool> = self.normals.iter().map(|normal| normal.try_normalize().is_none()).collect();
        if lacking.contains(&true) {
            let mut sums = vec![Vec3::ZERO; self.normals.len()];
            for triangle in &self.triangles {
                let normal = self.face_normal(triangle);
                for vertex in triangle {
                    sums[*vertex as usize] += normal;
                }
            }
            for (vertex, sum) in sums.into_iter().enumerate().filter(|(vertex, _)| lacking[*vertex]) {
                self.normals[vertex] = sum;
            }
        }
        for normal in &mut self.normals {
            *normal = normal.try_normalize().unwrap_or(Vec3::Y);
        }
    }
}

impl tangent::Corners for Part {
    fn counts(&self) -> (usize, usize) {
        (self.positions.len(), self.triangles.len())
    }

    fn vertex(&self, triangle: usize, corner: usize) -> u32 {
        self.triangles[triangle][corner]
    }

    fn position_normal_uv(&self, vertex: u32) -> ([f32; 3], [f32; 3], [f32; 2]) {
        let vertex = vertex as usize;
        let along = self.along.unwrap_or(TextureUse::plain(0));
        let uv = if along.set == 0 { self.uvs[vertex] } else { self.uvs2[vertex] };
        let uv = along.transform.transform_point2(uv);
        (self.positions[vertex].to_array(), self.normals[vertex].to_array(), uv.to_array())
    }

    fn rebuild(mut self, vertices: &[(u32, [f32; 4])], triangles: Vec<[u32; 3]>) -> Self {
        let old: Vec<usize> = vertices.iter().map(|(old, _)| *old as usize).collect();
        self.take_vertices(&old);
        self.tangents = vertices.iter().map(|vertex| vertex.1).collect();
        self.triangles = triangles;
        self
    }
}
