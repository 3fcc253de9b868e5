//! Reads meshes. All primitives of one mesh become one triangle list with a material for each triangle.

use super::{
    CONVERTERS, Fault, File, Read, accessor, fault,
    json::Json,
    material::{Materials, Used},
    skin::{self, Influence},
    tangent,
};
use crate::scene::{
    material::TextureUse,
    model::{Mesh, Model},
};
use glam::{Mat4, Vec2, Vec3, Vec4};

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
}

/// Reads mesh `index`, and adds its materials and textures to `model`. With `joints` its vertices stand where
/// these put them.
pub(super) fn load(
    file: &File,
    index: usize,
    joints: Option<&[Mat4]>,
    materials: &mut Materials,
    model: &mut Model,
) -> Read<Mesh> {
    let source = file.root.entry("meshes", index);
    let mut mesh = Mesh { name: source.name_or(index), ..Mesh::default() };
    if source.list("primitives").any(|primitive| primitive.list("targets").len() > 0) {
        file.unsupported(&format!("mesh {index}"), "a morph target", "drawn without it");
    }
    for (number, primitive) in source.list("primitives").enumerate() {
        let user = format!("mesh {index}, primitive {number}");
        let mappings = primitive.extension("KHR_materials_variants").list("mappings");
        let varied = file.variant.and_then(|variant| {
            mappings.clone().find(|mapping| mapping.indices("variants").contains(&variant))?.index("material")
        });
        let material = materials.get(file, varied.or(primitive.index("material")), model);
        let Some(part) = load_part(file, primitive, &user, material, joints)? else { continue };
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

fn load_part(file: &File, primitive: Json, user: &str, material: Used, joints: Option<&[Mat4]>) -> Read<Option<Part>> {
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
    if let Some((extension, command)) = CONVERTERS.iter().find(|(extension, _)| primitive.extension(extension).exists())
        && !file.root.entry("accessors", positions).get("bufferView").exists()
    {
        return Err(Fault::compressed(user, extension, command));
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
    };
    if let Some(joints) = joints {
        let influences = skin::influences(file, attributes, vertices, user)?;
        part.pose(joints, &influences);
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

    fn pose(&mut self, joints: &[Mat4], influences: &[Influence]) {
        skin::pose(joints, influences, &mut self.positions, &mut self.normals, &mut self.tangents);
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
