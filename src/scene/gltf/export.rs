//! Writes [`Model`]s as binary glTF 2.0 such that [`load`](super::load) gives the same model again: nodes,
//! meshes (one primitive a material), materials with the extensions that are read, textures as PNG inside the
//! file, clips.

use super::SUPPORTED;
use crate::{
    Error, Result,
    scene::{
        clip::{Join, Property},
        material::{Material, Texture, Wrap},
        model::{Local, Mesh, Model},
    },
};
use ::gltf::{
    Semantic,
    binary::{Glb, Header},
    json::{
        self, Accessor, Index, Root,
        accessor::{ComponentType, GenericComponentType, Type},
        animation::{Animation, Channel, Interpolation, Property as Path, Sampler, Target},
        buffer::{Target as BufferTarget, View},
        extensions::material as extension,
        material::{EmissiveFactor, NormalTexture, PbrBaseColorFactor, PbrMetallicRoughness, StrengthFactor},
        mesh::{Mode, Primitive},
        scene::UnitQuaternion,
        texture,
        validation::{Checked::Valid, USize64},
    },
};
use glam::{Mat4, Vec3};
use image::{ExtendedColorType, ImageEncoder, codecs::png::PngEncoder};
use std::{borrow::Cow, collections::BTreeMap};

/// Returns the bytes of a `.glb` file.
///
/// # Errors
/// Fails if a texture or the file is too large to be written.
pub fn to_glb(model: &Model) -> Result<Vec<u8>> {
    let mut file = Writer::default();
    for texture in &model.textures {
        file.texture(texture)?;
    }
    for material in &model.materials {
        let material = file.material(material);
        file.root.materials.push(material);
    }
    for mesh in &model.meshes {
        let primitives = file.primitives(mesh, model.materials.len());
        let name = Some(mesh.name.clone());
        file.root.meshes.push(json::Mesh {
            extensions: None,
            extras: Default::default(),
            name,
            primitives,
            weights: None,
        });
    }
    file.nodes(model);
    file.animations(model);
    file.finish()
}

#[derive(Default)]
struct Writer {
    root: Root,
    bytes: Vec<u8>,
}

fn too_large(error: impl ToString) -> Error {
    Error::Internal(format!("writing glTF: {}", error.to_string()))
}

impl Writer {
    fn view(&mut self, bytes: &[u8], target: Option<BufferTarget>) -> Index<View> {
        self.bytes.resize(self.bytes.len().next_multiple_of(4), 0);
        let start = self.bytes.len();
        self.bytes.extend_from_slice(bytes);
        self.root.push(View {
            buffer: Index::new(0),
            byte_length: USize64::from(bytes.len()),
            byte_offset: Some(USize64::from(start)),
            byte_stride: None,
            name: None,
            target: target.map(Valid),
            extensions: None,
            extras: Default::default(),
        })
    }

    fn accessor(
        &mut self,
        bytes: &[u8],
        count: usize,
        (component, kind): (ComponentType, Type),
        target: Option<BufferTarget>,
        bounds: Option<[serde_json::Value; 2]>,
    ) -> Index<Accessor> {
        let view = self.view(bytes, target);
        let [min, max] = bounds.map_or([None, None], |bounds| bounds.map(Some));
        self.root.push(Accessor {
            buffer_view: Some(view),
            byte_offset: Some(USize64(0)),
            count: USize64::from(count),
            component_type: Valid(GenericComponentType(component)),
            extensions: None,
            extras: Default::default(),
            type_: Valid(kind),
            min,
            max,
            name: None,
            normalized: false,
            sparse: None,
        })
    }

    /// Texture `i` of the model becomes texture, sampler and image `i` of the file.
    fn texture(&mut self, source: &Texture) -> Result<()> {
        let mut png = Vec::new();
        let opaque = source.texels.iter().all(|texel| texel[3] == 255);
        let channels = if opaque { 3 } else { 4 };
        let codes: Vec<u8> = source.texels.iter().flat_map(|texel| &texel[..channels]).copied().collect();
        let color = if opaque { ExtendedColorType::Rgb8 } else { ExtendedColorType::Rgba8 };
        let [width, height] = source.size;
        PngEncoder::new(&mut png).write_image(&codes, width, height, color).map_err(too_large)?;
        let view = self.view(&png, None);
        let image = self.root.push(json::Image {
            buffer_view: Some(view),
            mime_type: Some(json::image::MimeType("image/png".into())),
            name: Some(source.name.clone()),
            uri: None,
            extensions: None,
            extras: Default::default(),
        });
        let wrap = |mode| match mode {
            Wrap::Repeat => texture::WrappingMode::Repeat,
            Wrap::MirroredRepeat => texture::WrappingMode::MirroredRepeat,
            Wrap::ClampToEdge => texture::WrappingMode::ClampToEdge,
        };
        let magnify = if source.nearest { texture::MagFilter::Nearest } else { texture::MagFilter::Linear };
        let sampler = self.root.push(texture::Sampler {
            mag_filter: Some(Valid(magnify)),
            min_filter: Some(Valid(texture::MinFilter::LinearMipmapLinear)),
            wrap_s: Valid(wrap(source.wrap[0])),
            wrap_t: Valid(wrap(source.wrap[1])),
            ..Default::default()
        });
        self.root.push(json::Texture {
            name: None,
            sampler: Some(sampler),
            source: image,
            extensions: None,
            extras: Default::default(),
        });
        Ok(())
    }

    fn material(&self, source: &Material) -> json::Material {
        let info = |texture: Option<usize>| {
            texture.map(|texture| texture::Info {
                index: Index::new(texture as u32),
                tex_coord: 0,
                extensions: None,
                extras: Default::default(),
            })
        };
        // Factors end at 1. A power of two moves into the strength, which keeps every bit.
        let most = source.emissive.max_element();
        let strength = if most > 1.0 { most.log2().ceil().exp2() } else { 1.0 };
        let [r, g, b] = source.base_color.to_array();
        let specular = extension::Specular {
            specular_factor: extension::SpecularFactor(source.specular),
            specular_texture: info(source.specular_texture),
            specular_color_factor: extension::SpecularColorFactor(source.specular_color.to_array()),
            specular_color_texture: info(source.specular_color_texture),
            extras: Default::default(),
        };
        let ior = extension::Ior { ior: extension::IndexOfRefraction(source.ior), extras: Default::default() };
        let shines = extension::EmissiveStrength { emissive_strength: extension::EmissiveStrengthFactor(strength) };
        json::Material {
            name: Some(source.name.clone()),
            double_sided: source.double_sided,
            pbr_metallic_roughness: PbrMetallicRoughness {
                base_color_factor: PbrBaseColorFactor([r, g, b, 1.0]),
                base_color_texture: info(source.base_color_texture),
                metallic_factor: StrengthFactor(source.metallic),
                roughness_factor: StrengthFactor(source.roughness),
                metallic_roughness_texture: info(source.metallic_roughness_texture),
                ..Default::default()
            },
            normal_texture: source.normal_texture.map(|texture| NormalTexture {
                index: Index::new(texture as u32),
                scale: source.normal_scale,
                tex_coord: 0,
                extensions: None,
                extras: Default::default(),
            }),
            emissive_texture: info(source.emissive_texture),
            emissive_factor: EmissiveFactor((source.emissive / strength).to_array()),
            extensions: Some(extension::Material {
                specular: Some(specular),
                ior: (source.ior != 1.5).then_some(ior),
                emissive_strength: (strength > 1.0).then_some(shines),
                ..Default::default()
            }),
            ..Default::default()
        }
    }

    /// Makes one primitive a material, each with the vertices that it uses, in their order.
    fn primitives(&mut self, mesh: &Mesh, materials: usize) -> Vec<Primitive> {
        let mut primitives = Vec::new();
        for material in 0..materials as u32 {
            let triangles = mesh.triangles.iter().zip(&mesh.materials).filter(|(_, own)| **own == material);
            let mut place: BTreeMap<u32, u32> =
                triangles.clone().flat_map(|(corners, _)| *corners).map(|v| (v, 0)).collect();
            if place.is_empty() {
                continue;
            }
            place.values_mut().zip(0..).for_each(|(to, index)| *to = index);
            let used: Vec<usize> = place.keys().map(|vertex| *vertex as usize).collect();
            let indices: Vec<u32> = triangles.flat_map(|(corners, _)| corners.map(|v| place[&v])).collect();
            let positions: Vec<Vec3> = used.iter().map(|v| mesh.positions[*v]).collect();
            let fold = |f: fn(Vec3, Vec3) -> Vec3| positions.iter().copied().fold(positions[0], f).to_array();
            let bounds = Some([fold(Vec3::min), fold(Vec3::max)].map(|bound| serde_json::json!(bound)));
            let (count, vec3) = (used.len(), (ComponentType::F32, Type::Vec3));
            let vertices = Some(BufferTarget::ArrayBuffer);
            let mut attributes = BTreeMap::new();
            let index = self.accessor(bytemuck::cast_slice(&positions), count, vec3, vertices, bounds);
            attributes.insert(Valid(Semantic::Positions), index);
            let normals: Vec<Vec3> = used.iter().map(|v| mesh.normals[*v]).collect();
            let index = self.accessor(bytemuck::cast_slice(&normals), count, vec3, vertices, None);
            attributes.insert(Valid(Semantic::Normals), index);
            if !mesh.uvs.is_empty() {
                let uvs: Vec<glam::Vec2> = used.iter().map(|v| mesh.uvs[*v]).collect();
                let kind = (ComponentType::F32, Type::Vec2);
                let index = self.accessor(bytemuck::cast_slice(&uvs), count, kind, vertices, None);
                attributes.insert(Valid(Semantic::TexCoords(0)), index);
            }
            let tangents: Vec<[f32; 4]> = used.iter().filter_map(|v| mesh.tangents.get(*v).copied()).collect();
            if tangents.iter().any(|tangent| *tangent != [0.0; 4]) {
                let kind = (ComponentType::F32, Type::Vec4);
                let index = self.accessor(bytemuck::cast_slice(&tangents), count, kind, vertices, None);
                attributes.insert(Valid(Semantic::Tangents), index);
            }
            let (kind, target) = ((ComponentType::U32, Type::Scalar), Some(BufferTarget::ElementArrayBuffer));
            let indices = self.accessor(bytemuck::cast_slice(&indices), indices.len(), kind, target, None);
            primitives.push(Primitive {
                attributes,
                extensions: None,
                extras: Default::default(),
                indices: Some(indices),
                material: Some(Index::new(material)),
                mode: Valid(Mode::Triangles),
                targets: None,
            });
        }
        primitives
    }

    fn nodes(&mut self, model: &Model) {
        let nodes = &model.rig.nodes;
        for (index, node) in nodes.iter().enumerate() {
            let children = (0..nodes.len()).filter(|child| nodes[*child].parent == Some(index));
            let children: Vec<_> = children.map(|child| Index::new(child as u32)).collect();
            let mut out = json::Node {
                name: Some(node.name.clone()),
                mesh: node.mesh.map(|mesh| Index::new(mesh as u32)),
                children: (!children.is_empty()).then_some(children),
                ..Default::default()
            };
            match node.local {
                Local::Transform(transform) => {
                    out.translation = Some(transform.translation.to_array());
                    out.rotation = Some(UnitQuaternion(transform.rotation.to_array()));
                    out.scale = Some(transform.scale.to_array());
                }
                Local::Matrix(matrix) => out.matrix = Some(Mat4::from(matrix).to_cols_array()),
            }
            self.root.nodes.push(out);
        }
        let roots = (0..nodes.len()).filter(|node| nodes[*node].parent.is_none());
        let scene = json::Scene {
            extensions: None,
            extras: Default::default(),
            name: Some(model.name.clone()),
            nodes: roots.map(|node| Index::new(node as u32)).collect(),
        };
        self.root.scene = Some(self.root.push(scene));
    }

    fn animations(&mut self, model: &Model) {
        for clip in &model.rig.clips {
            let (mut channels, mut samplers) = (Vec::new(), Vec::new());
            for channel in &clip.channels {
                let times = &channel.times;
                let ends = [times.first(), times.last()].map(|time| serde_json::json!([time]));
                let kind = (ComponentType::F32, Type::Scalar);
                let input = self.accessor(bytemuck::cast_slice(times), times.len(), kind, None, Some(ends));
                let (path, kind, width) = match channel.property {
                    Property::Translation => (Path::Translation, Type::Vec3, 3),
                    Property::Rotation => (Path::Rotation, Type::Vec4, 4),
                    Property::Scale => (Path::Scale, Type::Vec3, 3),
                };
                let values: Vec<f32> =
                    channel.values.iter().flat_map(|value| value.to_array().into_iter().take(width)).collect();
                let kind = (ComponentType::F32, kind);
                let output = self.accessor(bytemuck::cast_slice(&values), channel.values.len(), kind, None, None);
                let interpolation = match channel.join {
                    Join::Linear => Interpolation::Linear,
                    Join::Step => Interpolation::Step,
                    Join::CubicSpline => Interpolation::CubicSpline,
                };
                channels.push(Channel {
                    sampler: Index::new(samplers.len() as u32),
                    target: Target {
                        extensions: None,
                        extras: Default::default(),
                        node: Index::new(channel.node as u32),
                        path: Valid(path),
                    },
                    extensions: None,
                    extras: Default::default(),
                });
                samplers.push(Sampler {
                    extensions: None,
                    extras: Default::default(),
                    input,
                    interpolation: Valid(interpolation),
                    output,
                });
            }
            let name = Some(clip.name.clone());
            let animation = Animation { extensions: None, extras: Default::default(), channels, name, samplers };
            self.root.animations.push(animation);
        }
    }

    fn finish(mut self) -> Result<Vec<u8>> {
        self.bytes.resize(self.bytes.len().next_multiple_of(4), 0);
        self.root.asset.generator = Some(concat!("iprt ", env!("CARGO_PKG_VERSION")).into());
        let used = |wanted: fn(&extension::Material) -> bool| {
            self.root.materials.iter().filter_map(|material| material.extensions.as_ref()).any(wanted)
        };
        let [_, strength, specular, ior, _] = SUPPORTED;
        let uses = [
            (strength, used(|material| material.emissive_strength.is_some())),
            (specular, used(|material| material.specular.is_some())),
            (ior, used(|material| material.ior.is_some())),
        ];
        self.root.extensions_used = uses.iter().filter(|(_, used)| *used).map(|(name, _)| (*name).into()).collect();
        if !self.bytes.is_empty() {
            self.root.buffers.push(json::Buffer {
                byte_length: USize64::from(self.bytes.len()),
                name: None,
                uri: None,
                extensions: None,
                extras: Default::default(),
            });
        }
        let json = self.root.to_vec().map_err(too_large)?;
        // The crate writes the true length itself.
        let header = Header { magic: *b"glTF", version: 2, length: 0 };
        Glb { header, json: Cow::Owned(json), bin: (!self.bytes.is_empty()).then_some(Cow::Owned(self.bytes)) }
            .to_vec()
            .map_err(too_large)
    }
}
