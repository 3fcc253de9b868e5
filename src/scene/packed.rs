//! The scene as the shaders read it (scalar block layout): triangles in BVH leaf order, a two-level BVH,
//! materials, texels. `shaders/glsl/scene.glsl` declares the same structs.

use super::{
    bvh,
    deform::{self, Pose},
    material::SLOTS,
};
use crate::gpu_struct;
use glam::{Vec2, Vec3};
use std::{collections::BTreeMap, sync::Arc};

impl Instance {
    /// Its mesh and its materials, as in [`PackedScene::uses`].
    pub fn used(&self) -> (u32, u32) {
        (self.root, self.first_material)
    }
}

/// Stands for "none" in texture and node indices.
pub const NONE: u32 = u32::MAX;

/// Bits of [`PackedMaterial::flags`].
/// The camera sees its front alone.
pub const ONE_SIDED: u32 = 1;
/// Colours of vertices tint what is emitted.
pub const UNLIT: u32 = 2;
/// Alpha below the cutoff is not there.
pub const MASKED: u32 = 4;
/// Alpha is the share that is there.
pub const BLENDED: u32 = 8;
/// The surface bounds a solid.
pub const SOLID: u32 = 16;

gpu_struct! {
    /// A triangle for intersection: its first corner and the two edges from it, object space, metres.
    pub struct TriangleGeometry { pub v0: Vec3, pub e1: Vec3, pub e2: Vec3 }
}
gpu_struct! {
    /// What shading needs of the same triangle: absolute vertex indices, and its material
    /// among those of the instance's model.
    pub struct TriangleShading { pub v0: u32, pub v1: u32, pub v2: u32, pub material: u32 }
}
gpu_struct! {
    /// A vertex. `tangent.w` is the bitangent's sign, as in glTF. A zero tangent means that there is no
    /// normal mapping. `color` has the square roots of a linear colour and its alpha, 8 bits each, R in the low
    /// byte. `uv2` is the second set of coordinates.
    pub struct Vertex { pub normal: Vec3, pub uv: Vec2, pub tangent: [f32; 4], pub color: u32, pub uv2: Vec2 }
}
gpu_struct! {
    /// A node of a BVH, in depth-first order, so that a walk needs no stack: a ray that meets the box goes on
    /// to the node behind, and one that misses it to `next`, past all that is within.
    pub struct BvhNode {
        pub min: Vec3,
        /// Of a leaf, the first triangle (bottom level) or the instance (top level) times 8, plus how many
        /// there are; 0 in an inner node.
        pub leaf: u32,
        pub max: Vec3,
        /// The absolute index of the node behind all that is within, or [`NONE`] at the end of the tree.
        pub next: u32,
    }
}
gpu_struct! {
    /// One placed mesh. Matrices are three rows of an affine 3×4 matrix.
    pub struct Instance {
        pub object_to_world: [[f32; 4]; 3],
        pub world_to_object: [[f32; 4]; 3],
        /// The transform of the previous frame, for motion vectors.
        pub previous_object_to_world: [[f32; 4]; 3],
        /// The root of the bottom-level BVH.
        pub root: u32,
        /// Identifies the instance in the G-buffer: 1-based and stable over frames. 0 is the real scene.
        pub id: u32,
        /// [`PackedScene::first_deformed`] if its triangles change their shape, else [`NONE`].
        pub previous: u32,
        /// How far one of its vertices has gone by that since the last frame at most, object space.
        pub step: f32,
        /// The first material of its model.
        pub first_material: u32,
    }
}
gpu_struct! {
    /// An instance that has moved since the last frame, or a light without a surface: spheres around it now and then, metres.
    pub struct Mover {
        pub now: Vec3, pub radius: f32,
        pub before: Vec3,
        /// The longest way that a corner of its box has gone.
        pub step: f32,
        /// As [`Instance::id`]; [`NONE`] is a light.
        pub id: u32,
        /// The greatest radiance that it emits, relative to the panorama's mean.
        pub glow: f32,
    }
}
gpu_struct! {
    /// A [`Material`](super::material::Material); factors are linear.
    pub struct PackedMaterial {
        pub base_color: Vec3, pub metallic: f32,
        /// Emitted radiance.
        pub emissive: Vec3, pub roughness: f32,
        pub specular_color: Vec3, pub specular: f32,
        pub ior: f32, pub normal_scale: f32,
        /// [`ONE_SIDED`] and the other bits.
        pub flags: u32,
        pub alpha: f32, pub alpha_cutoff: f32,
        pub transmission: f32,
        /// What a solid takes of light on a metre: exp(−extinction).
        pub extinction: Vec3,
        pub dispersion: f32,
        pub clearcoat: f32, pub clearcoat_roughness: f32, pub clearcoat_normal_scale: f32,
        pub sheen_color: Vec3, pub sheen_roughness: f32,
        pub anisotropy: f32,
        /// The rougher direction: its share of tangent and bitangent.
        pub anisotropy_direction: Vec2,
        pub iridescence: f32, pub iridescence_ior: f32, pub iridescence_thickness: Vec2,
        /// Indices of [`PackedTexture`] or [`NONE`], by [`Slot`](super::material::Slot).
        pub textures: [u32; SLOTS],
    }
}
gpu_struct! {
    /// A texture as a material uses it: RGBA8 texels (R in the low byte) in the texel buffer. Its mip levels follow one another,
    /// each `max(1, size >> level)`.
    pub struct PackedTexture {
        /// The first texel of level 0.
        pub offset: u32, pub width: u32, pub height: u32, pub levels: u32,
        /// 0 repeat, 1 mirrored repeat, 2 clamp to edge.
        pub wrap_u: u32, pub wrap_v: u32,
        /// 1: texels are sRGB-encoded and are decoded before filtering. Mips were averaged in linear space.
        pub srgb: u32,
        /// 1: nearest magnification.
        pub nearest: u32,
        /// Which coordinates of the vertices it is read by, 0 or 1.
        pub set: u32,
        /// Rows of the matrix from them to its own.
        pub transform: [[f32; 3]; 2],
    }
}

gpu_struct! {
    /// A light without a surface, in world space ([`PunctualLight`](super::punctual::PunctualLight)).
    pub struct Punctual {
        pub position: Vec3,
        /// 1: the light is parallel along `direction`, and `position` has no meaning.
        pub directional: u32,
        pub direction: Vec3, pub range: f32,
        pub intensity: Vec3,
        /// The falloff of a cone: intensity · clamp(cos · scale + offset, 0, 1)².
        pub cone_scale: f32, pub cone_offset: f32,
    }
}

gpu_struct! {
    /// A triangle that shines, in the path tracer's table. `below` is the probability of all lights before
    /// it.
    pub struct Light { pub instance: u32, pub triangle: u32, pub below: f32, pub padding: u32 }
}

gpu_struct! {
    /// What precedes the [`Light`]s that the renderer draws.
    pub struct EmitterHeader {
        pub count: u32,
        /// 1 / Σ area · luminance.
        pub inverse_power: f32,
        /// The centre of that power, and how far on average it is from there, metres.
        pub center: Vec3, pub radius: f32,
        /// The irradiance of the panorama on average.
        pub surroundings: f32,
    }
}

/// All that does not change from frame to frame, and the instances and top level that do.
#[derive(Clone, Debug, Default)]
pub struct PackedScene {
    pub triangles: Vec<TriangleGeometry>,
    pub shading: Vec<TriangleShading>,
    /// Of each triangle, whether the camera sees its front alone.
    pub one_sided: Vec<bool>,
    pub vertices: Vec<Vertex>,
    /// How often each mesh is placed with each model's materials, by its root and the first of these.
    pub uses: BTreeMap<(u32, u32), usize>,
    /// The bottom-level nodes of all meshes.
    pub nodes: Vec<BvhNode>,
    pub materials: Vec<PackedMaterial>,
    pub textures: Vec<PackedTexture>,
    pub texels: Vec<u32>,
    /// The first triangle of the meshes that change their shape. They come last, in all arrays.
    pub first_deformed: u32,
    /// These meshes, in their order.
    pub deforming: Vec<Arc<deform::Placed>>,
}

/// What changes from frame to frame: the instances and the top-level BVH over them, which is empty without
/// instances.
#[derive(Clone, Debug, Default)]
pub struct PackedInstances {
    pub instances: Vec<Instance>,
    pub nodes: Vec<BvhNode>,
    /// The lights without a surface of all objects.
    pub lights: Vec<Punctual>,
    /// What poses [`PackedScene::deforming`], in their order.
    pub poses: Vec<Pose>,
}

impl PackedScene {
    /// Returns the triangles of a mesh, given its root.
    pub fn triangles_of(&self, root: u32) -> impl Iterator<Item = u32> + '_ {
        let nodes = self.nodes.get(root as usize..).unwrap_or_default();
        let last = nodes.iter().position(|node| node.leaf != 0 && node.next == NONE);
        nodes[..last.map_or(nodes.len(), |last| last + 1)].iter().flat_map(bvh::leaf)
    }

    /// Returns what a triangle emits, without texture, with the materials that begin at `first_material`.
    pub fn emissive(&self, triangle: u32, first_material: u32) -> Vec3 {
        let material = self.shading.get(triangle as usize).map(|shading| first_material + shading.material);
        material.and_then(|material| self.materials.get(material as usize)).map_or(Vec3::ZERO, |m| m.emissive)
    }
}
