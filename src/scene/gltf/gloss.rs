//! KHR_materials_pbrSpecularGlossiness as a dielectric whose F0 is what the file says, texel by texel. F0 and glossiness
//! are kept as they are; only the diffuse colour becomes another one.

use super::File;
use crate::{
    image_file::srgb::{linear_to_srgb, srgb_to_linear},
    scene::{
        material::{Material, Slot, TexelEncoding, Texture, TextureUse, Wrap},
        model::Model,
    },
};
use glam::{Vec3, Vec4};
use rayon::prelude::*;
use std::sync::Arc;

/// The factors of the extension.
pub(super) struct Gloss {
    pub diffuse: Vec3,
    pub f0: Vec3,
    pub glossiness: f32,
}

impl Gloss {
    /// Of the light that a surface does not reflect, glTF's dielectric with its F0 of 0.04 scatters `base_color`.
    fn base_color(&self, diffuse: Vec3, specular: Vec3) -> Vec3 {
        let reflected = (self.f0 * specular).max_element();
        (self.diffuse * diffuse * ((1.0 - reflected) / 0.96)).min(Vec3::ONE)
    }

    /// Gives a material these factors, and converts its textures: it has the diffuse one as its base colour, and the
    /// specular and glossy one both as its specular colour and as its roughness. `user` names it in warnings.
    pub(super) fn give(&self, file: &File, user: &str, material: &mut Material, model: &mut Model) {
        material.base_color = self.base_color(Vec3::ONE, Vec3::ONE);
        material.specular_color = self.f0 / 0.04;
        material.metallic = 0.0;
        material.roughness = 1.0 - self.glossiness;
        if let Some(used) = &mut material.textures[Slot::MetallicRoughness as usize] {
            let rough = self.rough(&model.textures[used.texture]);
            used.texture = place(model, rough);
            material.roughness = 1.0;
        }
        let Some(specular) = material.texture(Slot::SpecularColor) else { return };
        let diffuse = material.texture(Slot::BaseColor);
        let lies = |used: TextureUse| (used.set, used.transform);
        if diffuse.is_some_and(|diffuse| lies(diffuse) != lies(specular)) {
            // No texel of one lies on one of the other.
            let all = Decoded::new(&model.textures[specular.texture], [1, 1]);
            material.base_color = self.base_color(Vec3::ONE, all.mean().truncate());
            file.warn(user, "its diffuse and specular textures lie differently: the mean specular darkens the diffuse");
            return;
        }
        let (factor, colors) = self.colors(model, diffuse.map(|used| used.texture), specular.texture);
        material.base_color = factor;
        let texture = place(model, colors);
        material.textures[Slot::BaseColor as usize] = Some(TextureUse { texture, ..specular });
    }

    /// The texture's alpha is glossiness. What is read is roughness in G and metallic in B.
    fn rough(&self, glossy: &Texture) -> Texture {
        let rough = |texel: &[u8; 4]| {
            let roughness = 1.0 - self.glossiness * f32::from(texel[3]) / 255.0;
            [255, (roughness * 255.0 + 0.5) as u8, 0, 255]
        };
        Texture { texels: glossy.texels.iter().map(rough).collect(), ..glossy.clone() }
    }

    /// Returns the base colour as a factor and a texture, which is as large as the larger of the two.
    fn colors(&self, model: &Model, diffuse: Option<usize>, specular: usize) -> (Vec3, Texture) {
        let specular = &model.textures[specular];
        let diffuse = diffuse.map(|diffuse| &model.textures[diffuse]);
        let whole = diffuse.filter(|diffuse| diffuse.texels.len() >= specular.texels.len()).unwrap_or(specular);
        let specular = Decoded::new(specular, whole.size);
        let diffuse = diffuse.map(|diffuse| Decoded::new(diffuse, whole.size));
        let color = |texel: usize| {
            let diffuse = diffuse.as_ref().map_or(Vec4::ONE, |diffuse| diffuse.at(texel));
            (self.base_color(diffuse.truncate(), specular.at(texel).truncate()), diffuse.w)
        };
        let texels = || (0..whole.texels.len()).into_par_iter();
        // The factor is the greatest colour, so that the eight bits of a texel reach far.
        let factor = texels().map(|texel| color(texel).0).reduce(|| Vec3::ZERO, Vec3::max);
        let code = |texel: usize| {
            let (color, alpha) = color(texel);
            let share = (color / factor.max(Vec3::splat(1e-9))).map(linear_to_srgb);
            share.extend(alpha).to_array().map(|part| (part * 255.0).round() as u8)
        };
        let named = diffuse.as_ref().map_or(specular.texture, |diffuse| diffuse.texture);
        let texture = Texture {
            name: named.name.clone(),
            size: whole.size,
            texels: texels().map(code).collect(),
            encoding: TexelEncoding::Srgb,
            wrap: named.wrap,
            nearest: named.nearest,
        };
        (factor, texture)
    }
}

/// Adds a texture to the model, unless it has the same.
fn place(model: &mut Model, texture: Texture) -> usize {
    model.textures.iter().position(|known| **known == texture).unwrap_or_else(|| {
        model.textures.push(Arc::new(texture));
        model.textures.len() - 1
    })
}

/// A texture of sRGB colours, to be read at the texels of one of another size.
struct Decoded<'a> {
    texture: &'a Texture,
    size: [u32; 2],
    linear: Vec<f32>,
}

impl<'a> Decoded<'a> {
    fn new(texture: &'a Texture, size: [u32; 2]) -> Self {
        let linear = (0..256).map(|code| srgb_to_linear(code as f32 / 255.0)).collect();
        Self { texture, size, linear }
    }

    fn decoded(&self, [r, g, b, a]: [u8; 4]) -> Vec4 {
        let linear = |code: u8| self.linear[usize::from(code)];
        Vec4::new(linear(r), linear(g), linear(b), f32::from(a) / 255.0)
    }

    fn mean(&self) -> Vec4 {
        let sum = self.texture.texels.iter().map(|texel| self.decoded(*texel).as_dvec4()).sum::<glam::DVec4>();
        (sum / self.texture.texels.len() as f64).as_vec4()
    }

    /// Returns what lies where texel `index` of a texture of the other size does.
    fn at(&self, index: usize) -> Vec4 {
        if self.texture.size == self.size {
            return self.decoded(self.texture.texels[index]);
        }
        let width = self.size[0] as usize;
        let [columns, rows] = [index % width, index / width].map(|at| at as f32);
        let [columns, rows] = [self.around(0, columns), self.around(1, rows)];
        let mut sum = Vec4::ZERO;
        for (row, row_share) in rows {
            for (column, share) in columns {
                sum += self.decoded(self.texture.texels[row * self.texture.size[0] as usize + column])
                    * (row_share * share);
            }
        }
        sum
    }

    /// Returns the two texels along an axis around one of the other size, with their shares.
    fn around(&self, axis: usize, at: f32) -> [(usize, f32); 2] {
        let own = self.texture.size[axis] as f32;
        let place = (at + 0.5) / self.size[axis] as f32 * own - 0.5;
        let place = if self.texture.nearest { place.round() } else { place };
        let inside = |texel: f32| match self.texture.wrap[axis] {
            Wrap::Repeat => texel.rem_euclid(own) as usize,
            Wrap::MirroredRepeat | Wrap::ClampToEdge => texel.clamp(0.0, own - 1.0) as usize,
        };
        let share = place - place.floor();
        [(inside(place.floor()), 1.0 - share), (inside(place.floor() + 1.0), share)]
    }
}
