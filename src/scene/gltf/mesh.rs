//! Reads meshes. All primitives of one mesh become one triangle list with a material for each triangle.

use super::{File, accessor, material::Materials, material::UvSource, tangent};
use crate::{
    Result,
    scene::model::{Mesh, Model},
};
use ::gltf::{
    Semantic,
    json::{mesh::Mode, mesh::Primitive, validation::Checked},
};
use glam::{Vec2, Vec3};

struct DecodedPrimitive {
    positions: Vec<Vec3>,
    normals: Vec<Vec3>,
    uvs: Vec<Vec2>,
    tangents: Vec<[f32; 4]>,
    triangles: Vec<[u32; 3]>,
}

/// Reads mesh `index`, and adds its materials and textures to `model`.
pub(super) fn load(file: &mut File, index: usize, materials: &mut Materials, model: &mut Model) -> Result<Mesh> {
    let root = file.root;
    let source = &root.meshes[index];
    let mut mesh = Mesh { name: source.name.clone().unwrap_or_else(|| format!("{index}")), ..Mesh::default() };
    if source.weights.is_some() || source.primitives.iter().any(|primitive| primitive.targets.is_some()) {
        file.warn("a morph target", "drawn without it");
    }
    for (number, primitive) in source.primitives.iter().enumerate() {
        let user = format!("mesh {index}, primitive {number}");
        let (material, uv_source, normal_mapped) =
            materials.get(file, primitive.material.map(|material| material.value()), model)?;
        let Some(part) = load_part(file, primitive, &user, uv_source, normal_mapped)? else { continue };
        let first = mesh.positions.len() as u32;
        mesh.positions.extend(part.positions);
        mesh.normals.extend(part.normals);
        mesh.uvs.extend(part.uvs);
        mesh.tangents.extend(part.tangents);
        mesh.materials.extend(std::iter::repeat_n(material, part.triangles.len()));
        mesh.triangles.extend(part.triangles.iter().map(|triangle| triangle.map(|vertex| first + vertex)));
    }
    Ok(mesh)
}

fn load_part(
    file: &mut File,
    primitive: &Primitive,
    user: &str,
    uv_source: UvSource,
    normal_mapped: bool,
) -> Result<Option<DecodedPrimitive>> {
    let attribute =
        |semantic: Semantic| primitive.attributes.get(&Checked::Valid(semantic)).map(|accessor| accessor.value());
    if attribute(Semantic::Colors(0)).is_some() {
        file.warn("a vertex colour", "drawn without it");
    }
    let Checked::Valid(mode) = primitive.mode else {
        return Err(file.broken(format!("{user}: has no valid mode")));
    };
    if !matches!(mode, Mode::Triangles | Mode::TriangleStrip | Mode::TriangleFan) {
        file.warn("a point or line", "left out");
        return Ok(None);
    }
    let Some(positions) = attribute(Semantic::Positions) else {
        file.warn("a primitive without positions", "left out");
        return Ok(None);
    };
    let elements = accessor::elements(file, positions, user)?;
    let vertices = elements.count;
    file.count_corners(vertices)?;
    let positions: Vec<Vec3> =
        elements.vectors(file, &format!("{user}: POSITION"))?.into_iter().map(Vec3::from_array).collect();
    if positions.iter().any(|position| position.abs().max_element() >= 1e9) {
        return Err(file.broken(format!("{user}: a position lies beyond 1e9")));
    }
    let optional = |file: &File, semantic: Semantic, name: &str| -> Result<Option<accessor::Elements>> {
        let Some(index) = attribute(semantic) else { return Ok(None) };
        let elements = accessor::elements(file, index, user)?;
        if elements.count != vertices {
            let problem = format!("{user}: {name} has {} elements for {vertices} vertices", elements.count);
            return Err(file.broken(problem));
        }
        Ok(Some(elements))
    };
    let normals = match optional(file, Semantic::Normals, "NORMAL")? {
        Some(elements) => Some(elements.vectors(file, &format!("{user}: NORMAL"))?),
        None => None,
    };
    let uvs = match optional(file, Semantic::TexCoords(uv_source.set), "TEXCOORD")? {
        Some(elements) => {
            elements.vectors(file, &format!("{user}: TEXCOORD"))?.into_iter().map(Vec2::from_array).collect()
        }
        None => vec![Vec2::ZERO; vertices],
    };
    let tangents = match optional(file, Semantic::Tangents, "TANGENT")? {
        Some(elements) if normal_mapped && normals.is_some() => {
            Some(elements.vectors(file, &format!("{user}: TANGENT"))?)
        }
        _ => None,
    };
    let corners = match primitive.indices {
        Some(index) => {
            let elements = accessor::elements(file, index.value(), user)?;
            file.count_corners(elements.count)?;
            elements.indices(file, &format!("{user}: its indices"))?
        }
        None => (0..vertices as u32).collect(),
    };
    if let Some(corner) = corners.iter().find(|corner| **corner as usize >= vertices) {
        return Err(file.broken(format!("{user}: index {corner} is beyond its {vertices} vertices")));
    }
    let triangles = triangles(mode, &corners);

    let mut part = DecodedPrimitive {
        positions,
        normals: normals.iter().flatten().map(|normal| Vec3::from_array(*normal)).collect(),
        uvs: uvs.into_iter().map(|uv| uv_source.apply(uv)).collect(),
        tangents: tangents.unwrap_or_default(),
        triangles,
    };
    if normals.is_none() {
        file.count_corners(part.triangles.len() * 3)?;
        part.unweld();
    }
    part.mend_normals();
    if !normal_mapped {
        part.tangents = vec![[0.0; 4]; part.positions.len()];
    } else if part.tangents.is_empty() {
        file.count_corners(part.triangles.len() * 3)?;
        part = tangent::generate(part);
    }
    Ok(Some(part))
}

fn triangles(mode: Mode, corners: &[u32]) -> Vec<[u32; 3]> {
    match mode {
        Mode::TriangleStrip => (0..corners.len().saturating_sub(2))
            .map(|i| if i % 2 == 0 { [i, i + 1, i + 2] } else { [i + 1, i, i + 2] }.map(|i| corners[i]))
            .collect(),
        Mode::TriangleFan => corners.windows(2).skip(1).map(|pair| [corners[0], pair[0], pair[1]]).collect(),
        _ => corners.chunks_exact(3).map(|corner| [corner[0], corner[1], corner[2]]).collect(),
    }
}

impl DecodedPrimitive {
    fn face_normal(&self, triangle: &[u32; 3]) -> Vec3 {
        let [a, b, c] = triangle.map(|vertex| self.positions[vertex as usize].as_dvec3());
        (b - a).cross(c - a).normalize_or_zero().as_vec3()
    }

    /// Gives every triangle its own vertices and flat normals. glTF asks for this where there are no normals.
    fn unweld(&mut self) {
        let corners: Vec<usize> = self.triangles.iter().flatten().map(|vertex| *vertex as usize).collect();
        self.normals = self.triangles.iter().flat_map(|triangle| [self.face_normal(triangle); 3]).collect();
        self.positions = corners.iter().map(|corner| self.positions[*corner]).collect();
        self.uvs = corners.iter().map(|corner| self.uvs[*corner]).collect();
        self.tangents.clear();
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

impl tangent::Corners for DecodedPrimitive {
    fn counts(&self) -> (usize, usize) {
        (self.positions.len(), self.triangles.len())
    }

    fn vertex(&self, triangle: usize, corner: usize) -> u32 {
        self.triangles[triangle][corner]
    }

    fn position_normal_uv(&self, vertex: u32) -> ([f32; 3], [f32; 3], [f32; 2]) {
        let vertex = vertex as usize;
        (self.positions[vertex].to_array(), self.normals[vertex].to_array(), self.uvs[vertex].to_array())
    }

    fn rebuild(mut self, vertices: &[(u32, [f32; 4])], triangles: Vec<[u32; 3]>) -> Self {
        let old = |index: &(u32, [f32; 4])| index.0 as usize;
        self.positions = vertices.iter().map(|vertex| self.positions[old(vertex)]).collect();
        self.normals = vertices.iter().map(|vertex| self.normals[old(vertex)]).collect();
        self.uvs = vertices.iter().map(|vertex| self.uvs[old(vertex)]).collect();
        self.tangents = vertices.iter().map(|vertex| vertex.1).collect();
        self.triangles = triangles;
        self
    }
}
