//! Materials and textures as they are loaded or made, before they are packed for the GPU.

use super::packed;
use glam::Vec3;

/// A glTF 2.0 metallic–roughness material. Factors are linear. Texture fields are indices into the model's
/// textures.
#[derive(Clone, Debug, PartialEq)]
pub struct Material {
    pub name: String,
    /// 0..1, Rec. 709.
    pub base_color: Vec3,
    /// 0..1.
    pub metallic: f32,
    /// 0..1, perceptual: α = roughness².
    pub roughness: f32,
    /// Emitted radiance.
    pub emissive: Vec3,
    /// KHR_materials_specular: 0 is pure Lambert.
    pub specular: f32,
    /// KHR_materials_specular: tint of the dielectric F0.
    pub specular_color: Vec3,
    /// Index of refraction of the dielectric; 1.5 is F0 = 0.04.
    pub ior: f32,
    /// A factor on x and y of the normal map.
    pub normal_scale: f32,
    /// Whether it is seen from both sides.
    pub double_sided: bool,
    /// RGB, sRGB-encoded.
    pub base_color_texture: Option<usize>,
    /// G roughness, B metallic, linear.
    pub metallic_roughness_texture: Option<usize>,
    pub normal_texture: Option<usize>,
    /// RGB, sRGB-encoded.
    pub emissive_texture: Option<usize>,
    /// A, linear.
    pub specular_texture: Option<usize>,
    /// RGB, sRGB-encoded.
    pub specular_color_texture: Option<usize>,
    /// Whether the colours of vertices tint what is emitted, and not what is reflected.
    pub unlit: bool,
}

impl Default for Material {
    /// Returns glTF's default: white, metallic 1, roughness 1.
    fn default() -> Self {
        Self {
            name: String::new(),
            base_color: Vec3::ONE,
            metallic: 1.0,
            roughness: 1.0,
            emissive: Vec3::ZERO,
            specular: 1.0,
            specular_color: Vec3::ONE,
            ior: 1.5,
            normal_scale: 1.0,
            double_sided: false,
            base_color_texture: None,
            metallic_roughness_texture: None,
            normal_texture: None,
            emissive_texture: None,
            specular_texture: None,
            specular_color_texture: None,
            unlit: false,
        }
    }
}

impl Material {
    /// Returns the material that shows its colour whatever the light is (KHR_materials_unlit): it emits the
    /// colour, and reflects nothing.
    pub fn unlit(self) -> Self {
        Self {
            name: self.name,
            base_color: Vec3::ZERO,
            metallic: 0.0,
            emissive: self.base_color,
            specular: 0.0,
            double_sided: self.double_sided,
            emissive_texture: self.base_color_texture,
            unlit: true,
            ..Self::default()
        }
    }

    /// Makes a dielectric of one colour.
    pub fn plain(name: &str, base_color: Vec3, roughness: f32) -> Self {
        Self { name: name.to_owned(), base_color, metallic: 0.0, roughness, ..Self::default() }
    }

    /// Returns the same material with `first` added to the number of each texture.
    pub fn with_textures_from(mut self, first: usize) -> Self {
        for texture in [
            &mut self.base_color_texture,
            &mut self.metallic_roughness_texture,
            &mut self.normal_texture,
            &mut self.emissive_texture,
            &mut self.specular_texture,
            &mut self.specular_color_texture,
        ] {
            *texture = texture.map(|index| index + first);
        }
        self
    }

    /// Packs it as the shaders read it. Texture `i` of the model is texture `first_texture + i` of the scene.
    pub fn pack(&self, first_texture: u32) -> packed::PackedMaterial {
        let texture = |index: Option<usize>| index.map_or(packed::NONE, |index| first_texture + index as u32);
        packed::PackedMaterial {
            base_color: self.base_color,
            metallic: self.metallic,
            emissive: self.emissive,
            roughness: self.roughness,
            specular_color: self.specular_color,
            specular: self.specular,
            ior: self.ior,
            normal_scale: self.normal_scale,
            flags: u32::from(self.double_sided) | (u32::from(self.unlit) << 1),
            base_color_texture: texture(self.base_color_texture),
            metallic_roughness_texture: texture(self.metallic_roughness_texture),
            normal_texture: texture(self.normal_texture),
            emissive_texture: texture(self.emissive_texture),
            specular_texture: texture(self.specular_texture),
            specular_color_texture: texture(self.specular_color_texture),
        }
    }
}

/// What a scene file may set on top of an object's own materials. Each value replaces the factor and the
/// texture.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct MaterialOverride {
    pub base_color: Option<Vec3>,
    pub metallic: Option<f32>,
    pub roughness: Option<f32>,
    pub specular: Option<f32>,
    pub ior: Option<f32>,
    pub emissive: Option<Vec3>,
}

impl MaterialOverride {
    /// Changes every material of a model.
    pub fn apply(&self, materials: &mut [Material], textures: &mut Vec<Texture>) {
        for material in materials {
            if let Some(color) = self.base_color {
                material.base_color = color;
                material.base_color_texture = None;
            }
            if self.metallic.is_some() && self.roughness.is_some() {
                material.metallic_roughness_texture = None;
            } else if let Some(texture) = material.metallic_roughness_texture {
                // The other channel must stay, so a copy of the texture is made in which this one is 1.
                for (given, channel) in [(self.roughness, 1), (self.metallic, 2)] {
                    if given.is_some() {
                        let copy = textures[texture].with_channel_at_one(channel);
                        textures.push(copy);
                        material.metallic_roughness_texture = Some(textures.len() - 1);
                    }
                }
            }
            material.metallic = self.metallic.unwrap_or(material.metallic);
            material.roughness = self.roughness.unwrap_or(material.roughness);
            if let Some(specular) = self.specular {
                material.specular = specular;
                material.specular_texture = None;
            }
            material.ior = self.ior.unwrap_or(material.ior);
            if let Some(emissive) = self.emissive {
                material.emissive = emissive;
                material.emissive_texture = None;
            }
        }
    }
}

/// What a texture's texels mean. It decides how they are averaged.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum TexelEncoding {
    /// sRGB-encoded colour.
    Srgb,
    /// Plain numbers.
    Linear,
    /// Tangent-space unit vectors, v = 2c − 1.
    Normal,
}

/// How coordinates outside 0..1 are read.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum Wrap {
    Repeat,
    MirroredRepeat,
    ClampToEdge,
}

/// An RGBA8 image. Row 0 is on top (v = 0).
#[derive(Clone, Debug, PartialEq)]
pub struct Texture {
    pub name: String,
    /// Width and height in texels, both ≥ 1.
    pub size: [u32; 2],
    /// `size[0] · size[1]` texels, row by row.
    pub texels: Vec<[u8; 4]>,
    pub encoding: TexelEncoding,
    pub wrap: [Wrap; 2],
    /// Whether the nearest texel is taken in magnification.
    pub nearest: bool,
}

impl Texture {
    fn with_channel_at_one(&self, channel: usize) -> Self {
        let mut copy = self.clone();
        for texel in &mut copy.texels {
            texel[channel] = 255;
        }
        copy
    }
}
