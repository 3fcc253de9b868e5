//! The extensions of glTF: which are read, and what those cost that are not.

use super::{Fault, File, Read};
use crate::image_file::read;
use std::collections::BTreeSet;

const SUPPORTED: [&str; 20] = [
    "KHR_lights_punctual",
    "KHR_materials_anisotropy",
    "KHR_materials_clearcoat",
    "KHR_materials_dispersion",
    "KHR_materials_iridescence",
    "KHR_materials_sheen",
    "KHR_materials_transmission",
    "KHR_materials_variants",
    "KHR_materials_volume",
    "KHR_materials_emissive_strength",
    "KHR_materials_specular",
    "KHR_materials_ior",
    "KHR_materials_unlit",
    "KHR_materials_pbrSpecularGlossiness",
    "KHR_meshopt_compression",
    "KHR_texture_transform",
    "KHR_mesh_quantization",
    "EXT_meshopt_compression",
    "EXT_texture_webp",
    "EXT_mesh_gpu_instancing",
];

/// The extension that compresses geometry and is not read, and the command that writes the file without.
pub(super) const DRACO: (&str, &str) = ("KHR_draco_mesh_compression", "gltf-transform copy IN.glb OUT.glb");

/// Extensions with images that are not read, and the command that writes the file with others.
pub(super) const IMAGES: [(&str, &str); 3] = [
    ("KHR_texture_basisu", "gltf-transform ktxdecompress IN.glb OUT.glb"),
    ("EXT_texture_avif", "gltf-transform png IN.glb OUT.glb"),
    ("MSFT_texture_dds", "gltf-transform png IN.glb OUT.glb"),
];

/// Extensions that do not change what is seen.
const SILENT: [&str; 3] = ["KHR_xmp", "KHR_xmp_json_ld", "EXT_mesh_manifold"];

/// Extensions that are not read, and without which all shapes are the same: they are about what is shown, heard, done or
/// known of them.
const BESIDE_GEOMETRY: [&str; 25] = [
    "KHR_interactivity",
    "KHR_node_hoverability",
    "KHR_node_selectability",
    "KHR_node_visibility",
    "KHR_techniques_webgl",
    "EXT_instance_features",
    "EXT_mesh_features",
    "EXT_structural_metadata",
    "AGI_articulations",
    "AGI_stk_metadata",
    "CESIUM_primitive_outline",
    "FB_geometry_metadata",
    "GODOT_single_root",
    "GRIFFEL_bim_data",
    "MPEG_media",
    "MPEG_scene_dynamic",
    "MPEG_viewport_recommended",
    "MSFT_lod",
    "MSFT_packing_normalRoughnessMetallic",
    "MSFT_packing_occlusionRoughnessMetallic",
    "OMI_collider",
    "VRM",
    "VRMC_node_constraint",
    "VRMC_springBone",
    "VRMC_vrm",
];

/// What an extension is about is the second word of its name. These are never about geometry.
const SUBJECTS: [&str; 6] = ["animation", "audio", "lights", "materials", "physics", "texture"];

fn is_beside_geometry(name: &str) -> bool {
    BESIDE_GEOMETRY.contains(&name) || name.split('_').nth(1).is_some_and(|subject| SUBJECTS.contains(&subject))
}

/// Warns of the extensions that are not read.
///
/// # Errors
/// Fails if one is required and may be needed to know the shapes.
pub(super) fn check(file: &File) -> Read<()> {
    let unknown = |name: &&str| {
        let converted = IMAGES.iter().chain([&DRACO]).any(|(known, _)| known == name);
        !SUPPORTED.contains(name) && !SILENT.contains(name) && !converted
    };
    let required: BTreeSet<&str> = file.root.texts("extensionsRequired").filter(unknown).collect();
    if let Some(name) = required.iter().find(|name| !is_beside_geometry(name)) {
        return Err(Fault {
            problem: format!("requires the extension {}, which is not read", read::one_line(name)),
            remedy: "if its shapes do not need it, take it out of extensionsRequired; gltf-pipeline -i IN.glb -o \
                     OUT.gltf writes a file as text"
                .into(),
        });
    }
    for name in &required {
        let message = format!("{} is required and unknown; what it says is left out", read::one_line(name));
        file.warn("extensionsRequired", &message);
    }
    for name in file.root.texts("extensionsUsed").filter(unknown).filter(|name| !required.contains(name)) {
        file.unsupported("extensionsUsed", &format!("the extension {}", read::one_line(&name)), "ignored");
    }
    Ok(())
}
