//! Materials and textures as they are loaded or made, before they are packed for the GPU.

use super::packed;
use glam::{Affine2, Vec2, Vec3};

/// Declares the textures that a material can have.
macro_rules! slots {
    ($( $(#[$doc:meta])* $slot:ident = $name:literal, $encoding:ident; )*) => {
        /// A texture of a material. Importer, packed scene and shaders call it by one name: `SLOT_` and its name
        /// in capitals is its number in `bind/scene.glsl`.
        #[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
        pub enum Slot { $( $(#[$doc])* $slot, )* }

        impl Slot {
            /// All slots, in the order of their numbers.
            pub const ALL: [Self; SLOTS] = [ $( Self::$slot, )* ];

            /// Returns its name.
            pub const fn name(self) -> &'static str {
                match self { $( Self::$slot => $name, )* }
            }

            /// Returns what its texels mean.
            pub const fn encoding(self) -> TexelEncoding {
                match self { $( Self::$slot => TexelEncoding::$encoding, )* }
            }
        }
    };
}

/// The number of textures that a material can have.
pub const SLOTS: usize = 15;

slots! {
    /// RGB colour, A alpha.
    BaseColor = "base_color", Srgb;
    /// G roughness, B metallic.
    MetallicRoughness = "metallic_roughness", Linear;
    Normal = "normal", Normal;
    Emissive = "emissive", Srgb;
    /// A.
    Specular = "specular", Linear;
    SpecularColor = "specular_color", Srgb;
    /// R.
    Transmission = "transmission", Linear;
    /// R.
    Clearcoat = "clearcoat", Linear;
    /// G.
    ClearcoatRoughness = "clearcoat_roughness", Linear;
    ClearcoatNormal = "clearcoat_normal", Normal;
    SheenColor = "sheen_color", Srgb;
    /// A.
    SheenRoughness = "sheen_roughness", Linear;
    /// RG direction, B strength.
    Anisotropy = "anisotropy", Linear;
    /// R.
    Iridescence = "iridescence", Linear;
    /// G.
    IridescenceThickness = "iridescence_thickness", Linear;
}

/// A texture as one material uses it.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct TextureUse {
    /// The index into the model's textures.
    pub texture: usize,
    /// Which of the vertices' two coordinate sets it is read by.
    pub set: usize,
    /// How it lies on them (KHR_texture_transform).
    pub transform: Affine2,
}

impl TextureUse {
    /// A texture that lies on the first coordinates as they are.
    pub const fn plain(texture: usize) -> Self {
        Self { texture, set: 0, transform: Affine2::IDENTITY }
    }
}

/// How opaque a surface is (glTF's `alphaMode`).
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Alpha {
    /// Everywhere.
    Opaque,
    /// Only where alpha is at least this.
    Mask(f32),
    /// By the share that alpha gives.
    Blend,
}

/// Declares the material, so that the fields that differ from the default are known.
macro_rules! material {
    ($( $(#[$doc:meta])* $field:ident: $ty:ty = $default:expr, )*) => {
        /// A glTF 2.0 metallic–roughness material with the extensions that add lobes. Factors are linear.
        #[derive(Clone, Debug, PartialEq)]
        pub struct Material {
            pub name: String,
            /// Whether rays from the camera pass its back. glTF files say so of what is not `doubleSided`. Other rays
            /// meet both sides.
            pub one_sided: bool,
            $( $(#[$doc])* pub $field: $ty, )*
        }

        impl Default for Material {
            /// Returns glTF's default: white, metallic 1, roughness 1.
            fn default() -> Self {
                Self { name: String::new(), one_sided: false, $( $field: $default, )* }
            }
        }

        impl Material {
            /// Describes what differs from the default, the name and the sides aside. So what is added to materials
            /// later does not change the description of those that lack it.
            pub fn description(&self) -> String {
                let default = Self::default();
                let mut text = String::new();
                $( if self.$field != default.$field {
                    text += &format!("{}: {:?}; ", stringify!($field), self.$field);
                } )*
                text
            }
        }
    };
}

material! {
    /// 0..1, Rec. 709.
    base_color: Vec3 = Vec3::ONE,
    /// 0..1.
    metallic: f32 = 1.0,
    /// 0..1, perceptual: α = roughness².
    roughness: f32 = 1.0,
    /// Emitted radiance.
    emissive: Vec3 = Vec3::ZERO,
    /// KHR_materials_specular: 0 is pure Lambert.
    specular: f32 = 1.0,
    /// KHR_materials_specular: tint of the dielectric F0.
    specular_color: Vec3 = Vec3::ONE,
    /// Index of refraction of the dielectric; 1.5 is F0 = 0.04.
    ior: f32 = 1.5,
    /// A factor on x and y of the normal map.
    normal_scale: f32 = 1.0,
    /// How opaque it is.
    alpha_mode: Alpha = Alpha::Opaque,
    /// A factor on alpha.
    alpha: f32 = 1.0,
    /// KHR_materials_transmission: the share of what the GGX lobe leaves that passes instead of being scattered.
    transmission: f32 = 0.0,
    /// KHR_materials_volume: above 0 it bounds a solid, which refracts and absorbs. Else it is a thin sheet.
    thickness: f32 = 0.0,
    /// KHR_materials_volume: what is left of light after `attenuation_distance`.
    attenuation_color: Vec3 = Vec3::ONE,
    /// Metres.
    attenuation_distance: f32 = f32::INFINITY,
    /// KHR_materials_dispersion: how far a solid's index of refraction spreads over the colours, 20 / Abbe number.
    dispersion: f32 = 0.0,
    /// KHR_materials_clearcoat: how much of a clear coat of F0 = 0.04 covers it, 0..1.
    clearcoat: f32 = 0.0,
    /// 0..1, perceptual.
    clearcoat_roughness: f32 = 0.0,
    /// A factor on x and y of the coat's normal map.
    clearcoat_normal_scale: f32 = 1.0,
    /// KHR_materials_sheen: the albedo of fibres over it, 0..1.
    sheen_color: Vec3 = Vec3::ZERO,
    /// 0..1, perceptual.
    sheen_roughness: f32 = 0.0,
    /// KHR_materials_anisotropy: how much rougher it is along the tangent, 0..1.
    anisotropy: f32 = 0.0,
    /// Radians from the tangent to the bitangent.
    anisotropy_rotation: f32 = 0.0,
    /// KHR_materials_iridescence: how much of a thin film covers it, 0..1.
    iridescence: f32 = 0.0,
    /// The film's index of refraction.
    iridescence_ior: f32 = 1.3,
    /// The film's thickness where its texture is 0 and where it is 1, nanometres. Without a texture it is the second.
    iridescence_thickness: Vec2 = Vec2::new(100.0, 400.0),
    /// Whether vertices' colours tint what is emitted, and not what is reflected.
    unlit: bool = false,
    /// By [`Slot`].
    textures: [Option<TextureUse>; SLOTS] = [None; SLOTS],
}

impl Material {
    /// Returns the material that shows its colour whatever the light is (KHR_materials_unlit): it emits the
    /// colour, and reflects nothing.
    pub fn unlit(self) -> Self {
        let mut textures = [None; SLOTS];
        textures[Slot::Emissive as usize] = self.texture(Slot::BaseColor);
        // Its alpha stays.
        textures[Slot::BaseColor as usize] = match self.alpha_mode {
            Alpha::Opaque => None,
            _ => self.texture(Slot::BaseColor),
        };
        Self {
            name: self.name,
            base_color: Vec3::ZERO,
            metallic: 0.0,
            emissive: self.base_color,
            specular: 0.0,
            one_sided: self.one_sided,
            alpha_mode: self.alpha_mode,
            alpha: self.alpha,
            unlit: true,
            textures,
            ..Self::default()
        }
    }

    /// Makes a dielectric of one colour.
    pub fn plain(name: &str, base_color: Vec3, roughness: f32) -> Self {
        Self { name: name.to_owned(), base_color, metallic: 0.0, roughness, ..Self::default() }
    }

    /// Returns the texture in a slot.
    pub fn texture(&self, slot: Slot) -> Option<TextureUse> {
        self.textures[slot as usize]
    }

    /// Returns the same material with a texture that lies on the first coordinates.
    pub fn with_texture(mut self, slot: Slot, texture: usize) -> Self {
        self.textures[slot as usize] = Some(TextureUse::plain(texture));
        self
    }

    /// Returns the same material with `first` added to the number of each texture.
    pub fn with_textures_from(mut self, first: usize) -> Self {
        self.textures.iter_mut().flatten().for_each(|texture| texture.texture += first);
        self
    }

    /// Packs it as the shaders read it. `textures` are the indices of its textures in the scene, by slot.
    pub fn pack(&self, textures: [u32; SLOTS]) -> packed::PackedMaterial {
        let (alpha_flag, alpha_cutoff) = match self.alpha_mode {
            Alpha::Opaque => (0, 0.0),
            Alpha::Mask(cutoff) => (packed::MASKED, cutoff),
            Alpha::Blend => (packed::BLENDED, 0.0),
        };
        let flags =
            [(self.one_sided, packed::ONE_SIDED), (self.unlit, packed::UNLIT), (self.thickness > 0.0, packed::SOLID)];
        let extinction = |color: f32| -(color.max(1e-6).ln()) / self.attenuation_distance;
        packed::PackedMaterial {
            base_color: self.base_color,
            metallic: self.metallic,
            emissive: self.emissive,
            roughness: self.roughness,
            specular_color: self.specular_color,
            specular: self.specular,
            ior: self.ior,
            normal_scale: self.normal_scale,
            flags: flags.iter().filter(|(is, _)| *is).fold(alpha_flag, |all, (_, flag)| all | flag),
            alpha: self.alpha,
            alpha_cutoff,
            transmission: self.transmission,
            extinction: self.attenuation_color.map(extinction),
            dispersion: self.dispersion,
            clearcoat: self.clearcoat,
            clearcoat_roughness: self.clearcoat_roughness,
            clearcoat_normal_scale: self.clearcoat_normal_scale,
            sheen_color: self.sheen_color,
            sheen_roughness: self.sheen_roughness,
            anisotropy: self.anisotropy,
            anisotropy_direction: Vec2::from_angle(self.anisotropy_rotation),
            iridescence: self.iridescence,
            iridescence_ior: self.iridescence_ior,
            iridescence_thickness: self.iridescence_thickness,
            textures,
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
    pub(super) fn with_channel_at_one(&self, channel: usize) -> Self {
        let mut copy = self.clone();
        for texel in &mut copy.texels {
            texel[channel] = 255;
        }
        copy
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn shaders_number_the_slots_alike() {
        let text = include_str!("../../shaders/glsl/bind/scene.glsl");
        for slot in Slot::ALL {
            let line = format!("const uint SLOT_{} = {}u;", slot.name().to_uppercase(), slot as u32);
            assert!(text.contains(&line), "{line}");
        }
        assert_eq!(text.matches("const uint SLOT_").count(), SLOTS);
    }

    #[test]
    fn descriptions_name_what_is_not_the_default() {
        assert_eq!(Material { name: "any".into(), ..Material::default() }.description(), "");
        let described = Material::plain("any", Vec3::ONE, 0.5).with_texture(Slot::Normal, 3).description();
        assert!(described.starts_with("metallic: 0.0; roughness: 0.5; textures: [None, None, Some("), "{described}");
    }
}
