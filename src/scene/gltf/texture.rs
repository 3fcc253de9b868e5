//! Reads textures of a glTF file, and where they lie on a surface.

use super::{File, Read, extension::IMAGES, json::Json, resource};
use crate::scene::{
    material::{TexelEncoding, Texture, TextureUse, Wrap},
    mips::{level_size, with_mips},
    model::Model,
};
use glam::{Affine2, Mat2, Vec2};
use std::{collections::HashMap, sync::Arc};

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
    /// How often all were halved, so that they fit together.
    halved: u32,
}

/// The most texels of all textures of a file while it is read, 256 MiB. Those of a scene are bounded later.
const MOST: usize = 1 << 26;

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
        let place = self.load(file, index, encoding, model).unwrap_or_else(|fault| {
            file.left_out(fault);
            None
        });
        self.known.insert((index, encoding), place);
        place
    }

    fn load(&mut self, file: &File, index: usize, encoding: TexelEncoding, model: &mut Model) -> Read<Option<usize>> {
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
        let sampler = file.root.entry("samplers", source.index("sampler").unwrap_or(usize::MAX));
        let wrap = |key: &str| match sampler.index(key) {
            Some(33071) => Wrap::ClampToEdge,
            Some(33648) => Wrap::MirroredRepeat,
            _ => Wrap::Repeat,
        };
        let texture = Texture {
            name: format!("{}: image {image}", file.subject),
            size: [0, 0],
            texels: Vec::new(),
            encoding,
            wrap: [wrap("wrapS"), wrap("wrapT")],
            nearest: sampler.index("magFilter") == Some(9728),
        };
        let alike = |t: &Arc<Texture>| {
            (&t.name, t.encoding, t.wrap, t.nearest) == (&texture.name, texture.encoding, texture.wrap, texture.nearest)
        };
        if let Some(place) = model.textures.iter().position(alike) {
            return Ok(Some(place));
        }
        let (size, texels) = resource::image(file, image)?;
        self.add(file, Texture { size, texels, ..texture }, model);
        Ok(Some(model.textures.len() - 1))
    }

    /// Adds a texture to those of a model. If all together are too many texels, all are halved.
    fn add(&mut self, file: &File, texture: Texture, model: &mut Model) {
        model.textures.push(Arc::new(texture));
        (0..self.halved).for_each(|_| model.textures.last_mut().map_or((), halve));
        while model.textures.iter().map(|texture| texture.texels.len()).sum::<usize>() > MOST {
            if self.halved == 0 {
                file.warn("textures", "all together exceed 256 MiB: all are reduced");
            }
            self.halved += 1;
            model.textures.iter_mut().for_each(halve);
        }
    }
}

/// Takes the next coarser mip level of a texture instead of it.
fn halve(texture: &mut Arc<Texture>) {
    if texture.size == [1, 1] {
        return;
    }
    let texture = Arc::make_mut(texture);
    let texels = with_mips(texture, 1, None);
    texture.size = level_size(texture.size, 1);
    let count = texture.size[0] as usize * texture.size[1] as usize;
    texture.texels = texels[..count].iter().map(|texel| texel.to_le_bytes()).collect();
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
