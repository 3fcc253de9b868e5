//! What of an object's materials a scene file or a user may set, in one table.

use super::material::{Material, Slot, Texture};
use glam::Vec3;

/// A value of a material.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Value {
    Number(f32),
    Color(Vec3),
}

impl From<f32> for Value {
    fn from(number: f32) -> Self {
        Self::Number(number)
    }
}

impl From<Vec3> for Value {
    fn from(color: Vec3) -> Self {
        Self::Color(color)
    }
}

impl From<Value> for f32 {
    fn from(value: Value) -> Self {
        match value {
            Value::Number(number) => number,
            Value::Color(color) => color.x,
        }
    }
}

impl From<Value> for Vec3 {
    fn from(value: Value) -> Self {
        match value {
            Value::Number(number) => Self::splat(number),
            Value::Color(color) => color,
        }
    }
}

/// A row of the table.
pub struct Entry {
    /// The key in a scene file.
    pub key: &'static str,
    pub what: &'static str,
    /// The least and the greatest value.
    pub range: [f32; 2],
    /// What was set.
    pub get: fn(&MaterialOverride) -> Option<Value>,
    pub set: fn(&mut MaterialOverride, Option<Value>),
    /// What a material has.
    pub of: fn(&Material) -> Value,
}

/// As good as without end.
const ANY: f32 = 1e9;

macro_rules! entries {
    ($( $key:ident: $type:ty = $of:expr, $range:expr, $what:literal; )*) => {
        /// What is set on top of an object's own materials. Each value replaces the factor and the texture.
        #[derive(Clone, Debug, Default, PartialEq)]
        pub struct MaterialOverride {
            $( #[doc = $what] pub $key: Option<$type>, )*
        }

        impl MaterialOverride {
            /// The keys in a scene file.
            pub const KEYS: &[&str] = &[ $( stringify!($key), )* ];

            /// All values.
            pub const ENTRIES: &[Entry] = &[ $( Entry {
                key: stringify!($key),
                what: $what,
                range: $range,
                get: |by| by.$key.map(Value::from),
                set: |by, value| by.$key = value.map(<$type>::from),
                of: |material| Value::from(($of)(material)),
            }, )* ];
        }
    };
}

entries! {
    base_color: Vec3 = |m: &Material| m.base_color, [0.0, 1.0], "the colour of what is not metal, and of what metal reflects";
    metallic: f32 = |m: &Material| m.metallic, [0.0, 1.0], "1: metal";
    roughness: f32 = |m: &Material| m.roughness, [0.0, 1.0], "0: a mirror";
    specular: f32 = |m: &Material| m.specular, [0.0, 1.0], "how much of the highlight is there; 0: pure Lambert";
    ior: f32 = |m: &Material| m.ior, [1.0, 10.0], "index of refraction";
    emissive: Vec3 = |m: &Material| m.emissive, [0.0, ANY], "radiance that it emits";
    transmission: f32 = |m: &Material| m.transmission, [0.0, 1.0], "the share of light that passes";
    thickness: f32 = |m: &Material| m.thickness, [0.0, ANY], "0: a thin sheet, else a solid";
    attenuation_color: Vec3 = |m: &Material| m.attenuation_color, [0.0, 1.0], "what is left of white after the attenuation distance";
    attenuation_distance: f32 = |m: &Material| m.attenuation_distance, [0.0, ANY], "metres in a solid";
    clearcoat: f32 = |m: &Material| m.clearcoat, [0.0, 1.0], "how much clear coat is on it";
    clearcoat_roughness: f32 = |m: &Material| m.clearcoat_roughness, [0.0, 1.0], "of the clear coat";
    sheen_color: Vec3 = |m: &Material| m.sheen_color, [0.0, 1.0], "of fibres on it";
    sheen_roughness: f32 = |m: &Material| m.sheen_roughness, [0.0, 1.0], "of fibres on it";
    anisotropy: f32 = |m: &Material| m.anisotropy, [0.0, 1.0], "how much rougher it is along one direction";
    iridescence: f32 = |m: &Material| m.iridescence, [0.0, 1.0], "how much thin film is on it";
    iridescence_thickness: f32 = |m: &Material| m.iridescence_thickness.y, [0.0, ANY], "of the film, nanometres";
}

impl MaterialOverride {
    /// Changes every material of a model.
    pub fn apply(&self, materials: &mut [Material], textures: &mut Vec<Texture>) {
        for material in materials {
            if let Some(color) = self.base_color {
                material.base_color = color;
                material.textures[Slot::BaseColor as usize] = None;
            }
            if self.metallic.is_some() && self.roughness.is_some() {
                material.textures[Slot::MetallicRoughness as usize] = None;
            } else if let Some(used) = &mut material.textures[Slot::MetallicRoughness as usize] {
                // The other channel must stay, so a copy of the texture is made in which this one is 1.
                for (given, channel) in [(self.roughness, 1), (self.metallic, 2)] {
                    if given.is_some() {
                        let copy = textures[used.texture].with_channel_at_one(channel);
                        textures.push(copy);
                        used.texture = textures.len() - 1;
                    }
                }
            }
            material.metallic = self.metallic.unwrap_or(material.metallic);
            material.roughness = self.roughness.unwrap_or(material.roughness);
            material.ior = self.ior.unwrap_or(material.ior);
            material.thickness = self.thickness.unwrap_or(material.thickness);
            material.attenuation_color = self.attenuation_color.unwrap_or(material.attenuation_color);
            let distance = self.attenuation_distance.filter(|distance| *distance > 0.0);
            material.attenuation_distance = distance.unwrap_or(material.attenuation_distance);
            let texture = &mut material.textures;
            let mut numbers = [
                (self.specular, &mut material.specular, Slot::Specular),
                (self.transmission, &mut material.transmission, Slot::Transmission),
                (self.clearcoat, &mut material.clearcoat, Slot::Clearcoat),
                (self.clearcoat_roughness, &mut material.clearcoat_roughness, Slot::ClearcoatRoughness),
                (self.sheen_roughness, &mut material.sheen_roughness, Slot::SheenRoughness),
                (self.anisotropy, &mut material.anisotropy, Slot::Anisotropy),
                (self.iridescence, &mut material.iridescence, Slot::Iridescence),
                (self.iridescence_thickness, &mut material.iridescence_thickness.y, Slot::IridescenceThickness),
            ];
            for (given, value, slot) in &mut numbers {
                if let Some(given) = given {
                    **value = *given;
                    texture[*slot as usize] = None;
                }
            }
            for (given, value, slot) in [
                (self.emissive, &mut material.emissive, Slot::Emissive),
                (self.sheen_color, &mut material.sheen_color, Slot::SheenColor),
            ] {
                if let Some(given) = given {
                    *value = given;
                    texture[slot as usize] = None;
                }
            }
        }
    }
}
