//! Reads materials of a glTF file. A factor out of range is brought into it, with a warning.

use super::{
    File,
    json::Json,
    texture::{Slot, Textures, UvSource},
};
use crate::scene::{
    material::{Material, TexelEncoding},
    model::Model,
};
use glam::Vec3;

/// The materials used so far.
pub(super) struct Materials {
    /// The last entry is the default material.
    known: Vec<Option<Used>>,
    textures: Textures,
}

/// A material in the model.
#[derive(Clone, Copy)]
pub(super) struct Used {
    pub place: u32,
    pub uv: UvSource,
    pub normal_mapped: bool,
}

impl Materials {
    pub(super) fn new(count: usize) -> Self {
        Self { known: vec![None; count + 1], textures: Textures::default() }
    }

    /// Returns material `index` (`None`: glTF's default), which is read and added to the model on first use.
    pub(super) fn get(&mut self, file: &File, index: Option<usize>, model: &mut Model) -> Used {
        let last = self.known.len() - 1;
        let exists = |index: &usize| {
            let exists = *index < last;
            if !exists {
                file.warn(&format!("material {index}"), "does not exist: the default material is taken");
            }
            exists
        };
        let index = index.filter(exists);
        let entry = index.unwrap_or(last);
        if let Some(known) = self.known[entry] {
            return known;
        }
        let (material, uv) = match index {
            Some(index) => self.load(file, index, model),
            None => (Material::default(), UvSource::PLAIN),
        };
        let used = Used { place: model.materials.len() as u32, uv, normal_mapped: material.normal_texture.is_some() };
        model.materials.push(material);
        self.known[entry] = Some(used);
        used
    }

    fn load(&mut self, file: &File, index: usize, model: &mut Model) -> (Material, UvSource) {
        let source = file.root.entry("materials", index);
        let user = format!("material {index}");
        match source.text("alphaMode") {
            None | Some("OPAQUE") => {}
            Some(mode @ ("MASK" | "BLEND")) => file.unsupported(&user, &format!("alpha mode {mode}"), "drawn opaque"),
            Some(_) => file.warn(&user, "has an alpha mode that is not known: drawn opaque"),
        }
        if source.extension("KHR_materials_transmission").number("transmissionFactor").is_some_and(|x| x > 0.0) {
            file.unsupported(&user, "KHR_materials_transmission", "drawn opaque");
        }
        let factors = Factors { file, user: &user };
        let pbr = source.get("pbrMetallicRoughness");
        let specular = source.extension("KHR_materials_specular");
        let glossy = source.extension("KHR_materials_pbrSpecularGlossiness");
        let base = if glossy.exists() { glossy.get("diffuseTexture") } else { pbr.get("baseColorTexture") };
        let specular_color = if glossy.exists() {
            glossy.get("specularGlossinessTexture")
        } else {
            specular.get("specularColorTexture")
        };
        let roughness = if glossy.exists() { specular_color } else { pbr.get("metallicRoughnessTexture") };

        let normal = source.get("normalTexture");
        let slots = [
            (base, TexelEncoding::Srgb),
            (roughness, TexelEncoding::Linear),
            (normal, TexelEncoding::Normal),
            (source.get("emissiveTexture"), TexelEncoding::Srgb),
            (specular.get("specularTexture"), TexelEncoding::Linear),
            (specular_color, TexelEncoding::Srgb),
        ];
        let mut uv: Option<UvSource> = None;
        let textures = slots.map(|(info, encoding)| {
            let slot = Slot::of(info)?;
            let texture = self.textures.get(file, slot.texture, encoding, model)?;
            if *uv.get_or_insert(slot.uv) != slot.uv {
                let what = "a material whose textures have different coordinates";
                file.unsupported(&user, what, "all use those of the first");
            }
            Some(texture)
        });
        let [base_color_texture, metallic_roughness_texture, normal_texture, emissive_texture, s, sc] = textures;
        let strength = source.extension("KHR_materials_emissive_strength").number("emissiveStrength").unwrap_or(1.0);
        let mut material = Material {
            name: source.text("name").map_or_else(|| user.clone(), str::to_owned),
            base_color: factors.color(pbr, "baseColorFactor", 1.0, Vec3::ONE),
            metallic: factors.part(pbr, "metallicFactor", 1.0),
            roughness: factors.part(pbr, "roughnessFactor", 1.0),
            emissive: factors.color(source, "emissiveFactor", f32::MAX, Vec3::ZERO) * strength.max(0.0),
            specular: factors.part(specular, "specularFactor", 1.0),
            specular_color: factors.color(specular, "specularColorFactor", f32::MAX, Vec3::ONE),
            ior: factors.ior(source.extension("KHR_materials_ior")),
            normal_scale: normal.number("scale").unwrap_or(1.0),
            double_sided: source.flag("doubleSided"),
            base_color_texture,
            metallic_roughness_texture,
            normal_texture,
            emissive_texture,
            specular_texture: s,
            specular_color_texture: sc,
            unlit: false,
        };
        material.emissive = material.emissive.min(Vec3::splat(f32::MAX));
        if glossy.exists() {
            self.specular_glossiness(&factors, glossy, &mut material, model);
        }
        if source.extension("KHR_materials_unlit").exists() {
            material = material.unlit();
        }
        (material, uv.unwrap_or(UvSource::PLAIN))
    }

    /// KHR_materials_pbrSpecularGlossiness as a dielectric whose F0 is what the file says. Of the light that
    /// a surface does not reflect, glTF's dielectric with its F0 of 0.04 scatters `base_color`.
    fn specular_glossiness(&mut self, factors: &Factors, glossy: Json, material: &mut Material, model: &mut Model) {
        let diffuse = factors.color(glossy, "diffuseFactor", 1.0, Vec3::ONE);
        let f0 = factors.color(glossy, "specularFactor", 1.0, Vec3::ONE);
        let glossiness = factors.part(glossy, "glossinessFactor", 1.0);
        material.base_color = (diffuse * ((1.0 - f0.max_element()) / 0.96)).min(Vec3::ONE);
        material.specular_color = f0 / 0.04;
        material.metallic = 0.0;
        material.roughness = 1.0 - glossiness;
        // The texture's alpha is glossiness. What is read is roughness in G and metallic in B.
        if let Some(texture) = material.metallic_roughness_texture {
            let mut rough = model.textures[texture].clone();
            for texel in &mut rough.texels {
                let roughness = 1.0 - glossiness * f32::from(texel[3]) / 255.0;
                *texel = [255, (roughness * 255.0 + 0.5) as u8, 0, 255];
            }
            model.textures.push(rough);
            material.metallic_roughness_texture = Some(model.textures.len() - 1);
            material.roughness = 1.0;
        }
    }
}

/// Reads factors of a material.
struct Factors<'a> {
    file: &'a File<'a>,
    user: &'a str,
}

impl Factors<'_> {
    fn clamped(&self, values: Vec3, most: f32, key: &str) -> Vec3 {
        let inside = values.clamp(Vec3::ZERO, Vec3::splat(most));
        if inside != values {
            self.file.warn(self.user, &format!("its {key} is out of range: the nearest value in it is taken"));
        }
        inside
    }

    fn part(&self, from: Json, key: &str, default: f32) -> f32 {
        from.number(key).map_or(default, |value| self.clamped(Vec3::splat(value), 1.0, key).x)
    }

    /// Reads the first three numbers of a colour, which may be three or four.
    fn color(&self, from: Json, key: &str, most: f32, default: Vec3) -> Vec3 {
        let four = from.numbers::<4>(key).map(|[r, g, b, _]| [r, g, b]);
        let color = four.or_else(|| from.numbers::<3>(key)).map(Vec3::from);
        color.map_or(default, |color| self.clamped(color, most, key))
    }

    fn ior(&self, from: Json) -> f32 {
        let ior = from.number("ior").unwrap_or(1.5);
        if ior == 0.0 || (1.0..=100.0).contains(&ior) {
            return ior;
        }
        self.file.warn(self.user, "its ior is out of range: 1.5 is taken");
        1.5
    }
}
