//! Reads materials of a glTF file. A factor out of range is brought into it, with a warning.

use super::{
    File,
    gloss::Gloss,
    json::Json,
    texture::{Info, Textures},
};
use crate::scene::{
    material::{Alpha, Material, SLOTS, Slot, TextureUse},
    model::Model,
};
use glam::{Vec2, Vec3};

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
    /// The sets of coordinates in the file that become the vertices' first and second.
    pub sets: [usize; 2],
    /// The texture along whose coordinates tangents are made, if any are needed.
    pub tangents: Option<TextureUse>,
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
        let (material, sets) = match index {
            Some(index) => self.load(file, index, model),
            None => (Material { one_sided: true, ..Material::default() }, [0, 1]),
        };
        let mapped = [Slot::Normal, Slot::ClearcoatNormal, Slot::Anisotropy].map(|slot| material.texture(slot));
        let plain = (material.anisotropy > 0.0).then(|| TextureUse::plain(0));
        let tangents = mapped.into_iter().flatten().next().or(plain);
        let used = Used { place: model.materials.len() as u32, sets, tangents };
        model.materials.push(material);
        self.known[entry] = Some(used);
        used
    }

    fn load(&mut self, file: &File, index: usize, model: &mut Model) -> (Material, [usize; 2]) {
        let source = file.root.entry("materials", index);
        let user = format!("material {index}");
        let factors = Factors { file, user: &user };
        let pbr = source.get("pbrMetallicRoughness");
        let extension = |name: &str| source.extension(&format!("KHR_materials_{name}"));
        let glossy = extension("pbrSpecularGlossiness");
        let [specular, volume, coat] = ["specular", "volume", "clearcoat"].map(extension);
        let [sheen, anisotropy, film] = ["sheen", "anisotropy", "iridescence"].map(extension);
        let transmission = extension("transmission");
        let alpha_mode = match source.text("alphaMode") {
            None | Some("OPAQUE") => Alpha::Opaque,
            Some("MASK") => Alpha::Mask(source.number("alphaCutoff").unwrap_or(0.5).max(0.0)),
            Some("BLEND") => Alpha::Blend,
            Some(_) => {
                file.warn(&user, "has an alpha mode that is not known: drawn opaque");
                Alpha::Opaque
            }
        };
        let (sets, textures) = self.textures(file, source, &user, model);
        let strength = extension("emissive_strength").number("emissiveStrength").unwrap_or(1.0);
        let film_thickness = |end: &str, default| factors.length(film, &format!("iridescenceThickness{end}"), default);
        let base = if glossy.exists() { (glossy, "diffuseFactor") } else { (pbr, "baseColorFactor") };
        let mut material = Material {
            name: source.text("name").map_or_else(|| user.clone(), str::to_owned),
            one_sided: !source.flag("doubleSided"),
            base_color: factors.color(pbr, "baseColorFactor", 1.0, Vec3::ONE),
            metallic: factors.part(pbr, "metallicFactor", 1.0),
            roughness: factors.part(pbr, "roughnessFactor", 1.0),
            emissive: factors.color(source, "emissiveFactor", f32::MAX, Vec3::ZERO) * strength.max(0.0),
            specular: factors.part(specular, "specularFactor", 1.0),
            specular_color: factors.color(specular, "specularColorFactor", f32::MAX, Vec3::ONE),
            ior: factors.ior(extension("ior"), "ior", 1.5),
            normal_scale: source.get("normalTexture").number("scale").unwrap_or(1.0),
            alpha_mode,
            alpha: base.0.numbers::<4>(base.1).map_or(1.0, |color| color[3].clamp(0.0, 1.0)),
            transmission: factors.part(transmission, "transmissionFactor", 0.0),
            thickness: factors.length(volume, "thicknessFactor", 0.0),
            attenuation_color: factors.color(volume, "attenuationColor", 1.0, Vec3::ONE),
            attenuation_distance: match factors.length(volume, "attenuationDistance", f32::INFINITY) {
                0.0 => f32::INFINITY,
                distance => distance,
            },
            dispersion: factors.length(extension("dispersion"), "dispersion", 0.0),
            clearcoat: factors.part(coat, "clearcoatFactor", 0.0),
            clearcoat_roughness: factors.part(coat, "clearcoatRoughnessFactor", 0.0),
            clearcoat_normal_scale: coat.get("clearcoatNormalTexture").number("scale").unwrap_or(1.0),
            sheen_color: factors.color(sheen, "sheenColorFactor", 1.0, Vec3::ZERO),
            sheen_roughness: factors.part(sheen, "sheenRoughnessFactor", 0.0),
            anisotropy: factors.part(anisotropy, "anisotropyStrength", 0.0),
            anisotropy_rotation: anisotropy.number("anisotropyRotation").unwrap_or(0.0),
            iridescence: factors.part(film, "iridescenceFactor", 0.0),
            iridescence_ior: factors.ior(film, "iridescenceIor", 1.3),
            iridescence_thickness: Vec2::new(film_thickness("Minimum", 100.0), film_thickness("Maximum", 400.0)),
            unlit: false,
            textures,
        };
        material.emissive = material.emissive.min(Vec3::splat(f32::MAX));
        if glossy.exists() {
            let gloss = Gloss {
                diffuse: factors.color(glossy, "diffuseFactor", 1.0, Vec3::ONE),
                f0: factors.color(glossy, "specularFactor", 1.0, Vec3::ONE),
                glossiness: factors.part(glossy, "glossinessFactor", 1.0),
            };
            gloss.give(file, &user, &mut material, model);
        }
        if extension("unlit").exists() {
            material = material.unlit();
        }
        (material, sets)
    }

    /// Reads the textures of a material, and which sets of coordinates they use.
    fn textures(
        &mut self,
        file: &File,
        source: Json,
        user: &str,
        model: &mut Model,
    ) -> ([usize; 2], [Option<TextureUse>; SLOTS]) {
        let glossy = source.extension("KHR_materials_pbrSpecularGlossiness");
        let named = |slot: Slot| {
            let extension = |name: &str, texture: &str| {
                source.extension(&format!("KHR_materials_{name}")).get(&format!("{texture}Texture"))
            };
            match slot {
                Slot::BaseColor if glossy.exists() => glossy.get("diffuseTexture"),
                Slot::SpecularColor | Slot::MetallicRoughness if glossy.exists() => {
                    glossy.get("specularGlossinessTexture")
                }
                Slot::BaseColor => source.get("pbrMetallicRoughness").get("baseColorTexture"),
                Slot::MetallicRoughness => source.get("pbrMetallicRoughness").get("metallicRoughnessTexture"),
                Slot::Normal => source.get("normalTexture"),
                Slot::Emissive => source.get("emissiveTexture"),
                Slot::Specular => extension("specular", "specular"),
                Slot::SpecularColor => extension("specular", "specularColor"),
                Slot::Transmission => extension("transmission", "transmission"),
                Slot::Clearcoat => extension("clearcoat", "clearcoat"),
                Slot::ClearcoatRoughness => extension("clearcoat", "clearcoatRoughness"),
                Slot::ClearcoatNormal => extension("clearcoat", "clearcoatNormal"),
                Slot::SheenColor => extension("sheen", "sheenColor"),
                Slot::SheenRoughness => extension("sheen", "sheenRoughness"),
                Slot::Anisotropy => extension("anisotropy", "anisotropy"),
                Slot::Iridescence => extension("iridescence", "iridescence"),
                Slot::IridescenceThickness => extension("iridescence", "iridescenceThickness"),
            }
        };
        let mut sets: Vec<usize> = Vec::new();
        let mut textures = [None; SLOTS];
        for slot in Slot::ALL {
            let Some(info) = Info::of(named(slot)) else { continue };
            let Some(texture) = self.textures.get(file, info.texture, slot.encoding(), model) else { continue };
            let set = sets.iter().position(|set| *set == info.set).unwrap_or_else(|| {
                if sets.len() == 2 {
                    file.unsupported(user, "a third set of texture coordinates", "its first is taken");
                    return 0;
                }
                sets.push(info.set);
                sets.len() - 1
            });
            textures[slot as usize] = Some(TextureUse { texture, set, transform: info.transform });
        }
        let first = sets.first().copied().unwrap_or(0);
        ([first, sets.get(1).copied().unwrap_or(usize::from(first == 0))], textures)
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

    /// Reads a length, from 0 on.
    fn length(&self, from: Json, key: &str, default: f32) -> f32 {
        from.number(key).map_or(default, |value| self.clamped(Vec3::splat(value), f32::MAX, key).x)
    }

    fn ior(&self, from: Json, key: &str, default: f32) -> f32 {
        let ior = from.number(key).unwrap_or(default);
        if (ior == 0.0 && key == "ior") || (1.0..=100.0).contains(&ior) {
            return ior;
        }
        self.file.warn(self.user, &format!("its {key} is out of range: {default} is taken"));
        default
    }
}
