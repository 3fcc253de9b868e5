//! What of an object's materials a scene file or a user may set, in one table.

use super::material::{Material, Slot, Texture};
use crate::{Error, Result};
use glam::{Vec3, vec3};
use std::{collections::HashMap, sync::Arc};

/// What was made of textures, by the source and the channel that is 1. Objects share it.
#[derive(Default)]
pub struct Copies(HashMap<(*const Texture, usize), Copied>);

struct Copied {
    /// Is kept, so that no other texture comes to its place in memory.
    _source: Arc<Texture>,
    copy: Arc<Texture>,
}

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
    dispersion: f32 = |m: &Material| m.dispersion, [0.0, ANY], "how far a solid parts the colours, 20 / Abbe number";
    clearcoat: f32 = |m: &Material| m.clearcoat, [0.0, 1.0], "how much clear coat is on it";
    clearcoat_roughness: f32 = |m: &Material| m.clearcoat_roughness, [0.0, 1.0], "of the clear coat";
    sheen_color: Vec3 = |m: &Material| m.sheen_color, [0.0, 1.0], "of fibres on it";
    sheen_roughness: f32 = |m: &Material| m.sheen_roughness, [0.0, 1.0], "of fibres on it";
    anisotropy: f32 = |m: &Material| m.anisotropy, [0.0, 1.0], "how much rougher it is along one direction";
    iridescence: f32 = |m: &Material| m.iridescence, [0.0, 1.0], "how much thin film is on it";
    iridescence_thickness: f32 = |m: &Material| m.iridescence_thickness.y, [0.0, ANY], "of the film, nanometres";
}

impl MaterialOverride {
    /// Sets a value from text: a number, or three with commas. No text takes it back.
    ///
    /// # Errors
    /// Fails if there is no such key, or if the text is no such value or out of range.
    pub fn set_text(&mut self, key: &str, text: &str, subject: &str) -> Result<()> {
        let subject = || format!("{subject} {key}={text}");
        let entry = Self::ENTRIES.iter().find(|entry| entry.key == key);
        let keys = || format!("use one of {}", Self::KEYS.join(", "));
        let entry = entry.ok_or_else(|| Error::input(subject(), "there is no such value", keys()))?;
        let parts = text.split(',').map(str::trim).filter(|part| !part.is_empty());
        let numbers: Option<Vec<f32>> = parts.map(|part| part.parse().ok()).collect();
        let value = match (numbers.as_deref(), (entry.of)(&Material::default())) {
            (Some([]), _) => None,
            (Some([number]), Value::Number(_)) => Some(Value::Number(*number)),
            (Some([r, g, b]), Value::Color(_)) => Some(Value::Color(vec3(*r, *g, *b))),
            (_, Value::Number(_)) => return Err(Error::input(subject(), "is no number", "write KEY=0.5")),
            (_, Value::Color(_)) => return Err(Error::input(subject(), "is no colour", "write KEY=1,0,0")),
        };
        let [least, most] = entry.range;
        if !numbers.unwrap_or_default().iter().all(|number| (least..=most).contains(number)) {
            return Err(Error::input(subject(), "is out of range", format!("give {least} to {most}")));
        }
        (entry.set)(self, value);
        Ok(())
    }

    /// Changes every material of a model. `copies` holds what was made of textures for others.
    pub fn apply(&self, materials: &mut [Material], textures: &mut Vec<Arc<Texture>>, copies: &mut Copies) {
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
                        let texture = &textures[used.texture];
                        let copied = copies.0.entry((Arc::as_ptr(texture), channel)).or_insert_with(|| Copied {
                            _source: texture.clone(),
                            copy: Arc::new(texture.with_channel_at_one(channel)),
                        });
                        let copy = copied.copy.clone();
                        textures.push(copy);
                        used.texture = textures.len() - 1;
                    }
                }
            }
            material.metallic = self.metallic.unwrap_or(material.metallic);
            material.roughness = self.roughness.unwrap_or(material.roughness);
            material.ior = self.ior.unwrap_or(material.ior);
            material.thickness = self.thickness.unwrap_or(material.thickness);
            material.dispersion = self.dispersion.unwrap_or(material.dispersion);
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

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn values_are_set_by_text_and_taken_back() {
        let mut by = MaterialOverride::default();
        let mut set = |key: &str, text: &str| by.set_text(key, text, "test").map(|()| by.clone());
        assert_eq!(set("roughness", "0.25").unwrap().roughness, Some(0.25));
        assert_eq!(set("emissive", "3, 0,1").unwrap().emissive, Some(vec3(3.0, 0.0, 1.0)));
        assert_eq!(
            set("roughness", "").unwrap(),
            MaterialOverride { emissive: Some(vec3(3.0, 0.0, 1.0)), ..Default::default() }
        );
        for (key, text, words) in [
            ("rough", "1", "use one of base_color"),
            ("roughness", "1,0,0", "is no number"),
            ("emissive", "1", "is no colour"),
            ("metallic", "2", "out of range"),
            ("metallic", "NaN", "out of range"),
        ] {
            let error = set(key, text).unwrap_err().to_string();
            assert!(error.contains(words) && error.starts_with(&format!("test {key}={text}")), "{error}");
        }
    }
}
