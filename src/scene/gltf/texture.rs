//! Reads textures of a glTF file, and where they lie on a surface.

use super::{File, Read, extension::IMAGES, json::Json, resource};
use crate::scene::{
    material::{TexelEncoding, Texture, TextureUse, Wrap},
    model::Model,
};
use glam::{Affine2, Mat2, Vec2};
use std::collections::{HashMap, hash_map::Entry};

/// A texture that a material names: its number, the set of coordinates in the file, and how it lies on them.
#[derive(Clone, Copy)]
pub(super) struct Info {
    pub texture: usize,
    pub set: usize,
    pub transform: Affine2,
}

impl Info {
    pub(super) fn of(info: Json) -> Option<Self> {
        let texture = info.index("index")?;
        let transform = info.extension("KHR_texture_transform");
        let set = transform.index("texCoord").or(info.index("texCoord")).unwrap_or(0);
        // The rotation is counter-clockwise as seen, with v growing downwards.
        let (sin, cos) = transform.number("rotation").unwrap_or(0.0).sin_cos();
        let rotate = Mat2::from_cols(Vec2::new(cos, -sin), Vec2::new(sin, cos));
        let scale = Vec2::from(transform.numbers("scale").unwrap_or([1.0; 2]));
        let offset = Vec2::from(transform.numbers("offset").unwrap_or([0.0; 2]));
        let matrix = rotate * Mat2::from_diagonal(scale);
        Some(Self { texture, set, transform: Affine2::from_mat2_translation(matrix, offset) })
    }
}

/// The textures used so far. Only these are decoded.
#[derive(Default)]
pub(super) struct Textures {
    known: HashMap<(usize, TexelEncoding), Option<usize>>,
    images: HashMap<usize, ([u32; 2], Vec<[u8; 4]>)>,
}

impl Textures {
    /// Returns the place of texture `index` in the model. A texture that cannot be read is left out.
    pub(super) fn get(
        &mut self,
        file: &File,
        index: usize,
        encoding: TexelEncoding,
        model: &mut Model,
    ) -> Option<usize> {
        if let Some(known) = self.known.get(&(index, encoding)) {
            return *known;
        }
        let loaded = self.load(file, index, encoding).unwrap_or_else(|fault| {
            file.left_out(fault);
            None
        });
        let place = loaded.map(|texture| {
            model.textures.push(texture);
            model.textures.len() - 1
        });
        self.known.insert((index, encoding), place);
        place
    }

    fn load(&mut self, file: &File, index: usize, encoding: TexelEncoding) -> Read<Option<Texture>> {
        let source = file.root.entry("textures", index);
        let webp = source.extension("EXT_texture_webp").index("source");
        let Some(image) = source.index("source").or(webp) else {
            let user = format!("texture {index}");
            let problem = match IMAGES.iter().find(|(extension, _)| source.extension(extension).exists()) {
                Some((extension, command)) => {
                    format!(
                        "has its image in {extension} alone, which is not read: left out; convert it, as by: {command}"
                    )
                }
                None if source.exists() => "has no source: left out".to_owned(),
                None => "does not exist: left out".to_owned(),
            };
            file.warn(&user, &problem);
            return Ok(None);
        };
        let (size, texels) = match self.images.entry(image) {
            Entry::Occupied(known) => known.into_mut(),
            Entry::Vacant(new) => new.insert(resource::image(file, image)?),
        };
        let sampler = file.root.entry("samplers", source.index("sampler").unwrap_or(usize::MAX));
        let wrap = |key: &str| match sampler.index(key) {
            Some(33071) => Wrap::ClampToEdge,
            Some(33648) => Wrap::MirroredRepeat,
            _ => Wrap::Repeat,
        };
        Ok(Some(Texture {
            name: format!("{}: image {image}", file.subject),
            size: *size,
            texels: texels.clone(),
            encoding,
            wrap: [wrap("wrapS"), wrap("wrapT")],
            nearest: sampler.index("magFilter") == Some(9728),
        }))
    }
}

/// Takes the textures out of a model that none of its materials uses. They were converted to others.
pub(super) fn keep_used(model: &mut Model) {
    let mut used = vec![false; model.textures.len()];
    let uses = model.materials.iter_mut().flat_map(|material| material.textures.iter_mut().flatten());
    let uses: Vec<&mut TextureUse> = uses.collect();
    uses.iter().for_each(|texture| used[texture.texture] = true);
    let before = |kept: &mut usize, used: &bool| Some(std::mem::replace(kept, *kept + usize::from(*used)));
    let places: Vec<usize> = used.iter().scan(0, before).collect();
    uses.into_iter().for_each(|texture| texture.texture = places[texture.texture]);
    let mut used = used.into_iter();
    model.textures.retain(|_| used.next() == Some(true));
}
