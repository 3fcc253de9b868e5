//! Packs models into the arrays that the shaders read: triangles in leaf order, bottom-level trees,
//! materials, texels.

use super::{
    bounds::Bounds,
    bvh, deform,
    material::{Alpha, Material, Slot, TexelEncoding, Texture, TextureUse},
    mips::{level_count, level_size, with_mips},
    model::{Mesh, Model},
    packed::{self, PackedScene, TriangleGeometry, TriangleShading, Vertex},
};
use crate::{Error, Result};
use glam::{Vec3, Vec4};
use std::{
    collections::{HashMap, hash_map::Entry},
    sync::Arc,
};

/// The most texels of all textures: 128 MiB, the largest storage buffer that every Vulkan device allows.
/// Beyond it the largest textures lose their finest levels.
pub const MAX_TEXELS: usize = 1 << 25;
/// The most triangles of all models, and the most vertices (48 bytes each, again 128 MiB).
pub const MAX_ELEMENTS: usize = (1 << 27) / 48;

/// Where a packed mesh is found.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PackedMesh {
    /// The root node of its bottom level.
    pub root: u32,
    /// The box in object space, metres.
    pub bounds: Bounds,
}

/// All models, packed.
#[derive(Debug, Default)]
pub struct Packed {
    pub scene: PackedScene,
    /// An entry for each mesh of each model, `None` for a mesh without triangles.
    pub meshes: Vec<Vec<Option<PackedMesh>>>,
    /// The first material of each model.
    pub first_materials: Vec<u32>,
    pub warnings: Vec<String>,
}

/// Packs models. Meshes that deform are packed in their rest pose if that is `wanted` of their model.
///
/// # Errors
/// Fails if a model does not fit, or if its numbers cannot be used.
pub fn pack(models: &[(&Model, bool)]) -> Result<Packed> {
    let mut packed = Packed::default();
    let sets: Vec<Vec<TexelSet>> = models.iter().map(|(model, _)| texel_sets(model)).collect();
    let mut texels = Texels::fit(sets.iter().flatten(), &mut packed.warnings);
    let mut known_meshes = HashMap::new();
    for ((model, wanted), sets) in models.iter().zip(sets) {
        let scene = &mut packed.scene;
        let first_material = scene.materials.len() as u32;
        let textures: Vec<packed::PackedTexture> = sets.iter().map(|set| texels.pack(&mut scene.texels, set)).collect();
        // A texture that lies on surfaces in several ways has an entry for each.
        let mut known: Vec<(TextureUse, usize, u32)> = Vec::new();
        for material in &model.materials {
            let entries = Slot::ALL.map(|slot| {
                let place = material.texture(slot).and_then(|used| {
                    let wanted = alpha_wanted(material, slot);
                    Some((used, sets.iter().position(|set| set.serves(used.texture, wanted))?))
                });
                let Some((used, place)) = place else { return packed::NONE };
                if let Some((.., entry)) = known.iter().find(|(other, set, _)| (other, set) == (&used, &place)) {
                    return *entry;
                }
                let [x, y, z] = [used.transform.x_axis, used.transform.y_axis, used.transform.translation];
                let transform = [[x.x, y.x, z.x], [x.y, y.y, z.y]];
                known.push((used, place, scene.textures.len() as u32));
                scene.textures.push(packed::PackedTexture { set: used.set as u32, transform, ..textures[place] });
                scene.textures.len() as u32 - 1
            });
            scene.materials.push(material.pack(entries));
        }
        let mut meshes = Vec::new();
        packed.first_materials.push(first_material);
        for mesh in &model.meshes {
            check_mesh(mesh, model)?;
            if mesh.deform.is_some() && !wanted {
                meshes.push(None);
                continue;
            }
            let one_sided = model.materials.iter().map(|material| material.one_sided).collect::<Vec<_>>();
            let known = known_meshes.entry((Arc::as_ptr(mesh), one_sided));
            if let Entry::Occupied(known) = known {
                meshes.push(*known.get());
                continue;
            }
            let (mesh, _, dropped) = pack_mesh(scene, mesh, &model.materials);
            meshes.push(*known.or_insert(mesh));
            if dropped > 0 {
                packed.warnings.push(format!("{}: {dropped} triangles without area were left out", model.name));
            }
        }
        packed.meshes.push(meshes);
        packed.check_room(model)?;
    }
    packed.scene.first_deformed = packed.scene.triangles.len() as u32;
    bvh::check(&packed.scene)?;
    Ok(packed)
}

impl Packed {
    fn check_room(&self, model: &Model) -> Result<()> {
        if self.scene.triangles.len().max(self.scene.vertices.len()) > MAX_ELEMENTS {
            let problem = format!("more than {MAX_ELEMENTS} triangles or vertices in the scene");
            return Err(Error::input(&model.name, problem, "simplify the model or leave objects out"));
        }
        Ok(())
    }

    /// Packs a mesh that deforms, for one placement alone.
    ///
    /// # Errors
    /// Fails if it does not fit.
    pub fn deforming(&mut self, model: &Model, mesh: usize) -> Result<Option<(PackedMesh, Arc<deform::Placed>)>> {
        let scene = &mut self.scene;
        let first = [scene.triangles.len() as u32, scene.vertices.len() as u32];
        let (packed, corners, _) = pack_mesh(scene, &model.meshes[mesh], &model.materials);
        let Some(packed) = packed else { return Ok(None) };
        let from = (mesh, &*model.meshes[mesh], &model.rig);
        let placed = deform::Placed::new(&self.scene, from, [first[0], first[1], packed.root], corners).map(Arc::new);
        self.scene.deforming.extend(placed.clone());
        self.check_room(model)?;
        Ok(placed.map(|placed| (packed, placed)))
    }
}

/// A texture as it is packed: what alpha is in its coarser mip levels differs.
#[derive(Clone, Copy)]
struct TexelSet<'a> {
    texture: &'a Arc<Texture>,
    /// Its place in the model.
    place: usize,
    /// The value at which alpha is cut, if it is a mask.
    mask: Option<f32>,
}

impl TexelSet<'_> {
    fn serves(&self, place: usize, wanted: Option<Option<f32>>) -> bool {
        self.place == place && wanted.is_none_or(|mask| mask == self.mask)
    }
}

/// Returns where a material cuts the alpha of a texture, if it cuts it. `None` if it reads no alpha there.
fn alpha_wanted(material: &Material, slot: Slot) -> Option<Option<f32>> {
    match (slot, material.alpha_mode) {
        (Slot::BaseColor, Alpha::Opaque) => None,
        (Slot::BaseColor, Alpha::Mask(cutoff)) => Some(Some(cutoff / material.alpha.max(1e-6))),
        (Slot::BaseColor, Alpha::Blend) | (Slot::Specular | Slot::SheenRoughness, _) => Some(None),
        _ => None,
    }
}

/// Returns what is packed of the textures of a model. One that is cut at several values is packed for each.
fn texel_sets(model: &Model) -> Vec<TexelSet<'_>> {
    let mut sets = Vec::new();
    for (place, texture) in model.textures.iter().enumerate() {
        let uses = |material| {
            Slot::ALL.into_iter().filter(move |slot| {
                let used: Option<TextureUse> = Material::texture(material, *slot);
                used.is_some_and(|used| used.texture == place)
            })
        };
        let wanted = model.materials.iter().flat_map(|m| uses(m).filter_map(|slot| alpha_wanted(m, slot)));
        let mut masks: Vec<Option<f32>> = Vec::new();
        for mask in wanted {
            if !masks.contains(&mask) {
                masks.push(mask);
            }
        }
        if masks.is_empty() {
            masks.push(None);
        }
        sets.extend(masks.into_iter().map(|mask| TexelSet { texture, place, mask }));
    }
    sets
}

/// The texels of all models: what is alike is there once.
struct Texels {
    sets: HashMap<(*const Texture, Option<u32>), TexelsOf>,
}

/// The first mip level that is kept of a set, and where it is once it is packed.
#[derive(Clone, Copy, Default)]
struct TexelsOf {
    first_level: u32,
    packed: Option<packed::PackedTexture>,
}

impl Texels {
    fn key(set: &TexelSet) -> (*const Texture, Option<u32>) {
        (Arc::as_ptr(set.texture), set.mask.map(f32::to_bits))
    }

    /// Chooses the first mip level of each texture that is kept.
    fn fit<'a>(all: impl Iterator<Item = &'a TexelSet<'a>>, warnings: &mut Vec<String>) -> Self {
        let mut sets = HashMap::new();
        let distinct = all.filter(|set| sets.insert(Self::key(set), TexelsOf::default()).is_none());
        let distinct: Vec<&TexelSet> = distinct.collect();
        let cost = |size: [u32; 2], first: u32| -> usize {
            let levels = (first..level_count(size)).map(|level| level_size(size, level));
            levels.map(|size| size[0] as usize * size[1] as usize).sum()
        };
        let mut levels = vec![0; distinct.len()];
        let mut costs: Vec<usize> = distinct.iter().map(|set| cost(set.texture.size, 0)).collect();
        while costs.iter().sum::<usize>() > MAX_TEXELS {
            let Some(largest) = (0..costs.len()).max_by_key(|i| costs[*i]) else { break };
            levels[largest] += 1;
            costs[largest] = cost(distinct[largest].texture.size, levels[largest]);
        }
        for (set, level) in distinct.iter().zip(levels).filter(|(_, level)| *level > 0) {
            let [w, h] = level_size(set.texture.size, level);
            let name = &set.texture.name;
            warnings.push(format!("{name}: reduced to {w}x{h}, as all textures together exceed 128 MiB"));
            sets.insert(Self::key(set), TexelsOf { first_level: level, packed: None });
        }
        Self { sets }
    }

    /// Says where the texels of a set are, and adds them if they are not there yet.
    fn pack(&mut self, texels: &mut Vec<u32>, set: &TexelSet) -> packed::PackedTexture {
        let known = self.sets.entry(Self::key(set)).or_default();
        *known.packed.get_or_insert_with(|| pack_texture(texels, set, known.first_level))
    }
}

/// Adds the texels of a texture, and says where they are.
fn pack_texture(texels: &mut Vec<u32>, set: &TexelSet, first_level: u32) -> packed::PackedTexture {
    let texture = set.texture;
    let size = level_size(texture.size, first_level);
    let offset = texels.len() as u32;
    texels.extend(with_mips(texture, first_level, set.mask));
    packed::PackedTexture {
        offset,
        width: size[0],
        height: size[1],
        levels: level_count(size),
        wrap_u: texture.wrap[0] as u32,
        wrap_v: texture.wrap[1] as u32,
        srgb: u32::from(texture.encoding == TexelEncoding::Srgb),
        nearest: u32::from(texture.nearest),
        ..Default::default()
    }
}

/// Callers may pass models from memory, so the arrays are checked here, too.
fn check_mesh(mesh: &Mesh, model: &Model) -> Result<()> {
    let subject = || format!("{}: mesh {}", model.name, mesh.name);
    let vertices = mesh.positions.len();
    let lengths_fit = mesh.normals.len() == vertices
        && [mesh.uvs.len(), mesh.uvs2.len(), mesh.tangents.len(), mesh.colors.len()]
            .iter()
            .all(|n| *n == 0 || *n == vertices)
        && mesh.materials.len() == mesh.triangles.len();
    let indices_fit = mesh.triangles.iter().flatten().all(|index| (*index as usize) < vertices)
        && mesh.materials.iter().all(|material| (*material as usize) < model.materials.len());
    if !lengths_fit || !indices_fit {
        return Err(Error::input(subject(), "its arrays do not fit each other", "repair the mesh"));
    }
    if !mesh.positions.iter().all(|p| p.is_finite() && p.abs().max_element() < 1e9) {
        return Err(Error::input(subject(), "a position is not finite or beyond 1e9 m", "repair the mesh"));
    }
    Ok(())
}

fn pack_color(linear: Vec4) -> u32 {
    let code = |value: f32| (value.clamp(0.0, 1.0) * 255.0 + 0.5) as u8;
    let root = |value: f32| code(value.max(0.0).sqrt());
    u32::from_le_bytes([root(linear.x), root(linear.y), root(linear.z), code(linear.w)])
}

/// Returns where a mesh has been packed, the corners of its packed triangles, and how many were left out.
fn pack_mesh(
    scene: &mut PackedScene,
    mesh: &Mesh,
    materials: &[Material],
) -> (Option<PackedMesh>, Vec<[u32; 3]>, usize) {
    let corners = |triangle: &[u32; 3]| triangle.map(|index| mesh.positions[index as usize]);
    let kept: Vec<usize> = (0..mesh.triangles.len())
        .filter(|index| {
            let [a, b, c] = corners(&mesh.triangles[*index]);
            (b - a).as_dvec3().cross((c - a).as_dvec3()).length_squared() > 0.0
        })
        .collect();
    let dropped = mesh.triangles.len() - kept.len();
    if kept.is_empty() {
        return (None, Vec::new(), dropped);
    }
    let geometry = |triangle: &[u32; 3]| {
        let [v0, v1, v2] = corners(triangle);
        TriangleGeometry { v0, e1: v1 - v0, e2: v2 - v0 }
    };
    let boxes: Vec<Bounds> = kept
        .iter()
        .map(|index| {
            let g = geometry(&mesh.triangles[*index]);
            Bounds::of([g.v0, g.v0 + g.e1, g.v0 + g.e2])
        })
        .collect();
    let tree = bvh::build_bottom(&boxes);

    let (first_vertex, first_triangle) = (scene.vertices.len() as u32, scene.triangles.len() as u32);
    for (index, normal) in mesh.normals.iter().enumerate() {
        scene.vertices.push(Vertex {
            normal: normal.try_normalize().unwrap_or(Vec3::Y),
            uv: mesh.uvs.get(index).copied().unwrap_or_default(),
            tangent: mesh.tangents.get(index).copied().unwrap_or_default(),
            color: mesh.colors.get(index).map_or(u32::MAX, |color| pack_color(*color)),
            uv2: mesh.uvs2.get(index).copied().unwrap_or_default(),
        });
    }
    for item in &tree.order {
        let index = kept[*item as usize];
        let triangle = &mesh.triangles[index];
        let [v0, v1, v2] = triangle.map(|vertex| first_vertex + vertex);
        scene.triangles.push(geometry(triangle));
        let material = mesh.materials[index];
        scene.shading.push(TriangleShading { v0, v1, v2, material });
        scene.one_sided.push(materials[material as usize].one_sided);
    }
    let root = scene.nodes.len() as u32;
    scene.nodes.extend(tree.pack(root, |first| first_triangle + first));
    let corners = tree.order.iter().map(|item| mesh.triangles[kept[*item as usize]]).collect();
    (Some(PackedMesh { root, bounds: tree.bounds() }), corners, dropped)
}
