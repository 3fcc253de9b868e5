//! Writes [`Model`]s as binary glTF 2.0 such that [`load`](super::load) gives the same model again: nodes,
//! meshes (one primitive a material), materials with the extensions that are read, textures as PNG inside the
//! file, clips.

use crate::{
    Error, Result,
    scene::{
        clip::{Join, Property},
        material::{Alpha, Material, Slot, Texture, TextureUse, Wrap},
        model::{Local, Mesh, Model},
    },
};
use glam::{Affine2, Mat4, Vec2, Vec3};
use image::{ExtendedColorType, ImageEncoder, codecs::png::PngEncoder};
use serde_json::{Map, Value, json};
use std::collections::{BTreeMap, BTreeSet};

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
        file.push("materials", material);
    }
    for mesh in &model.meshes {
        let primitives = file.primitives(mesh, model.materials.len());
        file.push("meshes", json!({ "name": mesh.name, "primitives": primitives }));
    }
    file.nodes(model);
    file.animations(model);
    file.finish()
}

/// A file as far as it is written.
#[derive(Default)]
struct Writer {
    /// The arrays of the JSON.
    arrays: BTreeMap<&'static str, Vec<Value>>,
    extensions: BTreeSet<&'static str>,
    bytes: Vec<u8>,
}

/// The type of an accessor: its component and its kind.
type Kind = (u32, &'static str);
const F32: u32 = 5126;
const U32: u32 = 5125;
const VEC2: Kind = (F32, "VEC2");
const VEC3: Kind = (F32, "VEC3");
const VEC4: Kind = (F32, "VEC4");
const VERTICES: Option<u32> = Some(34962);
const INDICES: Option<u32> = Some(34963);

fn too_large(error: impl ToString) -> Error {
    Error::Internal(format!("writing glTF: {}", error.to_string()))
}

/// Makes an object of the members that are not null.
fn object(members: Value) -> Value {
    match members {
        Value::Object(members) => {
            members.into_iter().filter(|(_, value)| !value.is_null()).collect::<Map<_, _>>().into()
        }
        other => other,
    }
}

/// Writes how a material uses a texture. Texture `i` of the model is texture `i` of the file.
fn texture_info(used: TextureUse) -> Value {
    let mut info = json!({ "index": used.texture });
    if used.set != 0 {
        info["texCoord"] = json!(used.set);
    }
    if used.transform != Affine2::IDENTITY {
        // The matrix is a rotation after a scale, as it was read.
        let [x, y] = [used.transform.x_axis, used.transform.y_axis];
        let mirrored = if used.transform.matrix2.determinant() < 0.0 { -1.0 } else { 1.0 };
        info["extensions"] = json!({ "KHR_texture_transform": {
            "offset": used.transform.translation.to_array(),
            "rotation": (-x.y).atan2(x.x),
            "scale": [x.length(), y.length() * mirrored],
        } });
    }
    info
}

impl Writer {
    /// Adds an entry to an array, and returns its index.
    fn push(&mut self, array: &'static str, entry: Value) -> usize {
        let array = self.arrays.entry(array).or_default();
        array.push(object(entry));
        array.len() - 1
    }

    fn view(&mut self, bytes: &[u8], target: Option<u32>) -> usize {
        self.bytes.resize(self.bytes.len().next_multiple_of(4), 0);
        let start = self.bytes.len();
        self.bytes.extend_from_slice(bytes);
        let view = json!({ "buffer": 0, "byteLength": bytes.len(), "byteOffset": start, "target": target });
        self.push("bufferViews", view)
    }

    fn accessor(
        &mut self,
        bytes: &[u8],
        count: usize,
        (component, kind): Kind,
        target: Option<u32>,
        bounds: Option<[Value; 2]>,
    ) -> usize {
        let view = self.view(bytes, target);
        let [min, max] = bounds.map_or([Value::Null, Value::Null], |bounds| bounds);
        self.push(
            "accessors",
            json!({ "bufferView": view, "count": count, "componentType": component, "type": kind, "min": min, "max": max }),
        )
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
        let image = json!({ "bufferView": view, "mimeType": "image/png", "name": source.name });
        let image = self.push("images", image);
        let [s, t] = source.wrap.map(|mode| match mode {
            Wrap::Repeat => 10497,
            Wrap::MirroredRepeat => 33648,
            Wrap::ClampToEdge => 33071,
        });
        let magnify = if source.nearest { 9728 } else { 9729 };
        let sampler = json!({ "magFilter": magnify, "minFilter": 9987, "wrapS": s, "wrapT": t });
        let sampler = self.push("samplers", sampler);
        self.push("textures", json!({ "sampler": sampler, "source": image }));
        Ok(())
    }

    fn material(&mut self, source: &Material) -> Value {
        let mut used: Vec<&'static str> = Vec::new();
        if source.textures.iter().flatten().any(|texture| !texture.transform.abs_diff_eq(Affine2::IDENTITY, 0.0)) {
            used.push("KHR_texture_transform");
        }
        let info = |slot: Slot| source.texture(slot).map(texture_info);
        let scaled = |slot: Slot, scale: f32| {
            let mut info = texture_info(source.texture(slot)?);
            info["scale"] = json!(scale);
            Some(info)
        };
        let mut extensions = Map::new();
        let mut extension = |needed: bool, name: &'static str, content: Value| {
            if needed {
                used.push(name);
                extensions.insert(name.to_owned(), object(content));
            }
        };
        // What is unlit emits its colour, and is read so.
        let (color, color_texture) = match source.unlit {
            true => (source.emissive, info(Slot::Emissive)),
            false => (source.base_color, info(Slot::BaseColor)),
        };
        let pbr = object(json!({
            "baseColorFactor": color.extend(source.alpha).to_array(),
            "baseColorTexture": color_texture,
            "metallicFactor": source.metallic,
            "roughnessFactor": source.roughness,
            "metallicRoughnessTexture": info(Slot::MetallicRoughness),
        }));
        let (mode, cutoff) = match source.alpha_mode {
            Alpha::Opaque => (Value::Null, Value::Null),
            Alpha::Mask(cutoff) => (json!("MASK"), json!(cutoff)),
            Alpha::Blend => (json!("BLEND"), Value::Null),
        };
        let mut out = json!({
            "name": source.name,
            "doubleSided": !source.one_sided,
            "pbrMetallicRoughness": pbr,
            "alphaMode": mode,
            "alphaCutoff": cutoff,
        });
        extension(source.unlit, "KHR_materials_unlit", json!({}));
        if !source.unlit {
            // Factors end at 1. A power of two moves into the strength, which keeps every bit.
            let most = source.emissive.max_element();
            let strength = if most > 1.0 { most.log2().ceil().exp2() } else { 1.0 };
            out["normalTexture"] = json!(scaled(Slot::Normal, source.normal_scale));
            out["emissiveTexture"] = json!(info(Slot::Emissive));
            out["emissiveFactor"] = json!((source.emissive / strength).to_array());
            let content = json!({
                "specularFactor": source.specular,
                "specularTexture": info(Slot::Specular),
                "specularColorFactor": source.specular_color.to_array(),
                "specularColorTexture": info(Slot::SpecularColor),
            });
            extension(true, "KHR_materials_specular", content);
            extension(source.ior != 1.5, "KHR_materials_ior", json!({ "ior": source.ior }));
            let content = json!({ "emissiveStrength": strength });
            extension(strength > 1.0, "KHR_materials_emissive_strength", content);
            let content = json!({
                "transmissionFactor": source.transmission,
                "transmissionTexture": info(Slot::Transmission),
            });
            extension(source.transmission > 0.0, "KHR_materials_transmission", content);
            let distance = source.attenuation_distance;
            let content = json!({
                "thicknessFactor": source.thickness,
                "attenuationColor": source.attenuation_color.to_array(),
                "attenuationDistance": distance.is_finite().then_some(distance),
            });
            extension(source.thickness > 0.0, "KHR_materials_volume", content);
            let content = json!({ "dispersion": source.dispersion });
            extension(source.dispersion > 0.0, "KHR_materials_dispersion", content);
            let content = json!({
                "clearcoatFactor": source.clearcoat,
                "clearcoatTexture": info(Slot::Clearcoat),
                "clearcoatRoughnessFactor": source.clearcoat_roughness,
                "clearcoatRoughnessTexture": info(Slot::ClearcoatRoughness),
                "clearcoatNormalTexture": scaled(Slot::ClearcoatNormal, source.clearcoat_normal_scale),
            });
            extension(source.clearcoat > 0.0, "KHR_materials_clearcoat", content);
            let content = json!({
                "sheenColorFactor": source.sheen_color.to_array(),
                "sheenColorTexture": info(Slot::SheenColor),
                "sheenRoughnessFactor": source.sheen_roughness,
                "sheenRoughnessTexture": info(Slot::SheenRoughness),
            });
            extension(source.sheen_color != Vec3::ZERO, "KHR_materials_sheen", content);
            let content = json!({
                "anisotropyStrength": source.anisotropy,
                "anisotropyRotation": source.anisotropy_rotation,
                "anisotropyTexture": info(Slot::Anisotropy),
            });
            extension(source.anisotropy > 0.0, "KHR_materials_anisotropy", content);
            let content = json!({
                "iridescenceFactor": source.iridescence,
                "iridescenceTexture": info(Slot::Iridescence),
                "iridescenceIor": source.iridescence_ior,
                "iridescenceThicknessMinimum": source.iridescence_thickness.x,
                "iridescenceThicknessMaximum": source.iridescence_thickness.y,
                "iridescenceThicknessTexture": info(Slot::IridescenceThickness),
            });
            extension(source.iridescence > 0.0, "KHR_materials_iridescence", content);
        }
        out["extensions"] = extensions.into();
        self.extensions.extend(used);
        out
    }

    /// Makes one primitive a material, each with the vertices that it uses, in their order.
    fn primitives(&mut self, mesh: &Mesh, materials: usize) -> Vec<Value> {
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
            let bounds = Some([fold(Vec3::min), fold(Vec3::max)].map(|bound| json!(bound)));
            let count = used.len();
            let mut attributes = Map::new();
            let mut attribute = |name: &str, bytes: &[u8], kind, bounds| {
                let index = self.accessor(bytes, count, kind, VERTICES, bounds);
                attributes.insert(name.into(), index.into());
            };
            attribute("POSITION", bytemuck::cast_slice(&positions), VEC3, bounds);
            let normals: Vec<Vec3> = used.iter().map(|v| mesh.normals[*v]).collect();
            attribute("NORMAL", bytemuck::cast_slice(&normals), VEC3, None);
            if !mesh.uvs.is_empty() {
                let uvs: Vec<Vec2> = used.iter().map(|v| mesh.uvs[*v]).collect();
                attribute("TEXCOORD_0", bytemuck::cast_slice(&uvs), VEC2, None);
            }
            if mesh.uvs2.iter().any(|uv| *uv != Vec2::ZERO) {
                let uvs: Vec<Vec2> = used.iter().map(|v| mesh.uvs2[*v]).collect();
                attribute("TEXCOORD_1", bytemuck::cast_slice(&uvs), VEC2, None);
            }
            if !mesh.colors.is_empty() {
                let colors: Vec<[f32; 4]> = used.iter().map(|v| mesh.colors[*v].to_array()).collect();
                attribute("COLOR_0", bytemuck::cast_slice(&colors), VEC4, None);
            }
            let tangents: Vec<[f32; 4]> = used.iter().filter_map(|v| mesh.tangents.get(*v).copied()).collect();
            if tangents.iter().any(|tangent| *tangent != [0.0; 4]) {
                attribute("TANGENT", bytemuck::cast_slice(&tangents), VEC4, None);
            }
            let bytes = bytemuck::cast_slice(&indices);
            let indices = self.accessor(bytes, indices.len(), (U32, "SCALAR"), INDICES, None);
            primitives.push(json!({ "attributes": attributes, "indices": indices, "material": material }));
        }
        primitives
    }

    fn nodes(&mut self, model: &Model) {
        let nodes = &model.rig.nodes;
        for (index, node) in nodes.iter().enumerate() {
            let children: Vec<usize> = (0..nodes.len()).filter(|child| nodes[*child].parent == Some(index)).collect();
            let children = (!children.is_empty()).then_some(children);
            let mut out = json!({ "name": node.name, "mesh": node.mesh, "children": children });
            match node.local {
                Local::Transform(transform) => {
                    out["translation"] = json!(transform.translation.to_array());
                    out["rotation"] = json!(transform.rotation.to_array());
                    out["scale"] = json!(transform.scale.to_array());
                }
                Local::Matrix(matrix) => out["matrix"] = json!(Mat4::from(matrix).to_cols_array()),
            }
            self.push("nodes", out);
        }
        let roots: Vec<usize> = (0..nodes.len()).filter(|node| nodes[*node].parent.is_none()).collect();
        let roots = (!roots.is_empty()).then_some(roots);
        self.push("scenes", json!({ "name": model.name, "nodes": roots }));
    }

    fn animations(&mut self, model: &Model) {
        for clip in model.rig.clips.iter().filter(|clip| !clip.channels.is_empty()) {
            let (mut channels, mut samplers) = (Vec::new(), Vec::new());
            for channel in clip.channels.iter() {
                let times = &channel.times;
                let ends = [times.first(), times.last()].map(|time| json!([time]));
                let bytes = bytemuck::cast_slice(times);
                let input = self.accessor(bytes, times.len(), (F32, "SCALAR"), None, Some(ends));
                let (path, kind, width) = match channel.property {
                    Property::Translation => ("translation", VEC3, 3),
                    Property::Rotation => ("rotation", VEC4, 4),
                    Property::Scale => ("scale", VEC3, 3),
                };
                let values: Vec<f32> =
                    channel.values.iter().flat_map(|value| value.to_array().into_iter().take(width)).collect();
                let bytes = bytemuck::cast_slice(&values);
                let output = self.accessor(bytes, channel.values.len(), kind, None, None);
                let interpolation = match channel.join {
                    Join::Linear => "LINEAR",
                    Join::Step => "STEP",
                    Join::CubicSpline => "CUBICSPLINE",
                };
                let target = json!({ "node": channel.node, "path": path });
                channels.push(json!({ "sampler": samplers.len(), "target": target }));
                samplers.push(json!({ "input": input, "interpolation": interpolation, "output": output }));
            }
            self.push("animations", json!({ "name": clip.name, "channels": channels, "samplers": samplers }));
        }
    }

    fn finish(mut self) -> Result<Vec<u8>> {
        self.bytes.resize(self.bytes.len().next_multiple_of(4), 0);
        if !self.bytes.is_empty() {
            self.push("buffers", json!({ "byteLength": self.bytes.len() }));
        }
        let mut root = json!(self.arrays);
        root["asset"] = json!({ "version": "2.0", "generator": concat!("iprt ", env!("CARGO_PKG_VERSION")) });
        root["scene"] = json!(0);
        if !self.extensions.is_empty() {
            root["extensionsUsed"] = json!(self.extensions);
        }
        let mut text = serde_json::to_vec(&root).map_err(too_large)?;
        text.resize(text.len().next_multiple_of(4), b' ');
        let mut chunks = vec![(*b"JSON", text)];
        if !self.bytes.is_empty() {
            chunks.push((*b"BIN\0", self.bytes));
        }
        let length = 12 + chunks.iter().map(|(_, bytes)| 8 + bytes.len()).sum::<usize>();
        let mut out = Vec::with_capacity(length);
        let word = |length: usize| u32::try_from(length).map(u32::to_le_bytes).map_err(too_large);
        out.extend([*b"glTF", 2_u32.to_le_bytes(), word(length)?].concat());
        for (kind, bytes) in chunks {
            out.extend(word(bytes.len())?);
            out.extend(kind);
            out.extend(bytes);
        }
        Ok(out)
    }
}
