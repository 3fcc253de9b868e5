//! Reads materials and textures of a glTF file.

use super::{File, resource};
use crate::{
    Result,
    scene::{
        material::{Material, TexelEncoding, Texture, Wrap},
        model::Model,
    },
};
use ::gltf::{
    material::AlphaMode,
    texture::{Info, MagFilter, WrappingMode},
};
use glam::{Mat2, Vec2, Vec3};
use std::collections::{HashMap, hash_map::Entry};

/// Which texture coordinates a material uses, and how KHR_texture_transform moves them. It is baked into the
/// vertices.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct UvSource {
    pub set: u32,
    offset: Vec2,
    linear: Mat2,
}

impl UvSource {
    const PLAIN: Self = Self { set: 0, offset: Vec2::ZERO, linear: Mat2::IDENTITY };

    fn new(set: u32, offset: [f32; 2], rotation: f32, scale: [f32; 2]) -> Self {
        // The rotation is counter-clockwise as seen, with v growing downwards.
        let (sin, cos) = rotation.sin_cos();
        let rotate = Mat2::from_cols(Vec2::new(cos, -sin), Vec2::new(sin, cos));
        Self { set, offset: Vec2::from(offset), linear: rotate * Mat2::from_diagonal(Vec2::from(scale)) }
    }

    /// Returns the coordinates at which the textures are read.
    pub(super) fn apply(&self, uv: Vec2) -> Vec2 {
        self.offset + self.linear * uv
    }
}

struct TextureUse {
    texture: usize,
    uv: UvSource,
}

/// The materials used so far. Only these are decoded.
pub(super) struct Materials {
    /// Model material, texture coordinates, and whether it has a normal map. The last entry is the default
    /// material.
    known: Vec<Option<(u32, UvSource, bool)>>,
    textures: HashMap<(usize, TexelEncoding), usize>,
    images: HashMap<usize, ([u32; 2], Vec<[u8; 4]>)>,
}

impl Materials {
    pub(super) fn new(count: usize) -> Self {
        Self { known: vec![None; count + 1], textures: HashMap::new(), images: HashMap::new() }
    }

    /// Returns the place of material `index` in the model (`None`: glTF's default), its texture coordinates,
    /// and whether it has a normal map.
    pub(super) fn get(
        &mut self,
        file: &mut File,
        index: Option<usize>,
        model: &mut Model,
    ) -> Result<(u32, UvSource, bool)> {
        let place = index.unwrap_or(self.known.len() - 1);
        if let Some(Some(known)) = self.known.get(place) {
            return Ok(*known);
        }
        let mut material = Material::default();
        let mut uv = UvSource::PLAIN;
        if let Some(index) = index {
            let Some(source) = file.document.materials().nth(index) else {
                return Err(file.broken(format!("material {index} does not exist")));
            };
            (material, uv) = self.load(file, &source, index, model)?;
        }
        let entry = (model.materials.len() as u32, uv, material.normal_texture.is_some());
        model.materials.push(material);
        self.known[place] = Some(entry);
        Ok(entry)
    }

    fn load(
        &mut self,
        file: &mut File,
        source: &::gltf::Material,
        index: usize,
        model: &mut Model,
    ) -> Result<(Material, UvSource)> {
        let name = source.name().map_or_else(|| format!("material {index}"), str::to_owned);
        match source.alpha_mode() {
            AlphaMode::Opaque => {}
            AlphaMode::Mask => file.warn("alpha mode MASK", "drawn opaque"),
            AlphaMode::Blend => file.warn("alpha mode BLEND", "drawn opaque"),
        }
        if source.transmission().is_some_and(|transmission| transmission.transmission_factor() > 0.0) {
            file.warn("KHR_materials_transmission", "drawn opaque");
        }
        let pbr = source.pbr_metallic_roughness();
        let specular = source.specular();
        let normal = source.normal_texture();
        let slot = |info: Option<Info>| info.map(|info| slot(&info));
        let normal_slot = normal.as_ref().map(|normal| {
            let others =
                file.root.materials[index].normal_texture.as_ref().and_then(|normal| normal.extensions.as_ref());
            let transform = others.and_then(|extensions| extensions.others.get("KHR_texture_transform"));
            TextureUse { texture: normal.texture().index(), uv: uv_from_json(normal.tex_coord(), transform) }
        });
        let slots = [
            (slot(pbr.base_color_texture()), TexelEncoding::Srgb),
            (slot(pbr.metallic_roughness_texture()), TexelEncoding::Linear),
            (normal_slot, TexelEncoding::Normal),
            (slot(source.emissive_texture()), TexelEncoding::Srgb),
            (slot(specular.as_ref().and_then(|specular| specular.specular_texture())), TexelEncoding::Linear),
            (slot(specular.as_ref().and_then(|specular| specular.specular_color_texture())), TexelEncoding::Srgb),
        ];
        let mut uv: Option<UvSource> = None;
        let mut textures = [None; 6];
        for ((slot, encoding), texture) in slots.into_iter().zip(&mut textures) {
            let Some(slot) = slot else { continue };
            if *uv.get_or_insert(slot.uv) != slot.uv {
                file.warn("a material whose textures have different coordinates", "all use those of the first");
            }
            *texture = Some(self.texture(file, slot.texture, encoding, model)?);
        }
        let [base_color_texture, metallic_roughness_texture, normal_texture, emissive_texture, s, sc] = textures;
        let [r, g, b, _] = pbr.base_color_factor();
        let specular_color = specular.as_ref().map_or([1.0; 3], |specular| specular.specular_color_factor());
        let material = Material {
            name,
            base_color: Vec3::new(r, g, b),
            metallic: pbr.metallic_factor(),
            roughness: pbr.roughness_factor(),
            emissive: Vec3::from(source.emissive_factor()) * source.emissive_strength().unwrap_or(1.0),
            specular: specular.as_ref().map_or(1.0, |specular| specular.specular_factor()),
            specular_color: Vec3::from(specular_color),
            ior: source.ior().unwrap_or(1.5),
            normal_scale: normal.as_ref().map_or(1.0, |normal| normal.scale()),
            double_sided: source.double_sided(),
            base_color_texture,
            metallic_roughness_texture,
            normal_texture,
            emissive_texture,
            specular_texture: s,
            specular_color_texture: sc,
        };
        check(file, &material, index)?;
        Ok((material, uv.unwrap_or(UvSource::PLAIN)))
    }

    fn texture(&mut self, file: &File, index: usize, encoding: TexelEncoding, model: &mut Model) -> Result<usize> {
        if let Some(texture) = self.textures.get(&(index, encoding)) {
            return Ok(*texture);
        }
        let Some(source) = file.document.textures().nth(index) else {
            return Err(file.broken(format!("texture {index} does not exist")));
        };
        let image = source.source().index();
        let (size, texels) = match self.images.entry(image) {
            Entry::Occupied(known) => known.into_mut(),
            Entry::Vacant(new) => new.insert(resource::image(file, image)?),
        };
        let wrap = |mode: WrappingMode| match mode {
            WrappingMode::Repeat => Wrap::Repeat,
            WrappingMode::MirroredRepeat => Wrap::MirroredRepeat,
            WrappingMode::ClampToEdge => Wrap::ClampToEdge,
        };
        let sampler = source.sampler();
        model.textures.push(Texture {
            name: format!("{}: image {image}", file.subject),
            size: *size,
            texels: texels.clone(),
            encoding,
            wrap: [wrap(sampler.wrap_s()), wrap(sampler.wrap_t())],
            nearest: sampler.mag_filter() == Some(MagFilter::Nearest),
        });
        let texture = model.textures.len() - 1;
        self.textures.insert((index, encoding), texture);
        Ok(texture)
    }
}

fn slot(info: &Info) -> TextureUse {
    let uv = match info.texture_transform() {
        Some(transform) => UvSource::new(
            transform.tex_coord().unwrap_or_else(|| info.tex_coord()),
            transform.offset(),
            transform.rotation(),
            transform.scale(),
        ),
        None => UvSource { set: info.tex_coord(), ..UvSource::PLAIN },
    };
    TextureUse { texture: info.texture().index(), uv }
}

/// The glTF crate does not read the transform of normal textures.
fn uv_from_json(set: u32, transform: Option<&serde_json::Value>) -> UvSource {
    let Some(transform) = transform else { return UvSource { set, ..UvSource::PLAIN } };
    let number = |value: &serde_json::Value| value.as_f64().map(|value| value as f32);
    let pair = |key: &str| Some([number(transform.get(key)?.get(0)?)?, number(transform.get(key)?.get(1)?)?]);
    let own_set = transform.get("texCoord").and_then(|value| u32::try_from(value.as_u64()?).ok());
    let rotation = transform.get("rotation").and_then(number).unwrap_or(0.0);
    UvSource::new(
        own_set.unwrap_or(set),
        pair("offset").unwrap_or([0.0; 2]),
        rotation,
        pair("scale").unwrap_or([1.0; 2]),
    )
}

/// Refuses factors outside what glTF allows.
fn check(file: &File, material: &Material, index: usize) -> Result<()> {
    let parts = [material.metallic, material.roughness, material.specular];
    let colors = [material.base_color, material.specular_color, material.emissive];
    let fine = parts.iter().all(|value| (0.0..=1.0).contains(value))
        && material.base_color.max_element() <= 1.0
        && colors.iter().all(|color| color.is_finite() && color.min_element() >= 0.0)
        && (material.ior == 0.0 || (1.0..=100.0).contains(&material.ior))
        && material.normal_scale.is_finite();
    if fine { Ok(()) } else { Err(file.broken(format!("material {index} has a factor out of range"))) }
}
