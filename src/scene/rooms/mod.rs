//! The built-in rooms, made by code: a closed, purely diffuse real scene that `capture` turns into a panorama, and the
//! virtual objects that stand in it.

mod apartment;
mod furniture;
pub mod kit;
mod objects;
mod textures;

use glam::{Quat, Vec2, Vec3};

pub use apartment::apartment;

/// Triangles with their materials.
#[derive(Clone, Debug, Default)]
pub struct Mesh {
    pub positions: Vec<Vec3>,
    pub normals: Vec<Vec3>,
    pub uvs: Vec<Vec2>,
    /// Empty: no normal mapping.
    pub tangents: Vec<[f32; 4]>,
    pub triangles: Vec<[u32; 3]>,
    /// One a triangle.
    pub triangle_materials: Vec<u32>,
}

/// glTF metallic–roughness; factors linear.
#[derive(Clone, Debug)]
pub struct Material {
    pub name: String,
    pub base_color: Vec3,
    pub metallic: f32,
    pub roughness: f32,
    /// Emitted radiance.
    pub emissive: Vec3,
    /// 0: pure Lambert.
    pub specular: f32,
    pub ior: f32,
    pub base_color_texture: Option<usize>,
}

impl Material {
    /// A purely diffuse material.
    pub fn lambert(name: &str, base_color: Vec3) -> Self {
        Self {
            name: name.into(),
            base_color,
            metallic: 0.0,
            roughness: 1.0,
            emissive: Vec3::ZERO,
            specular: 0.0,
            ior: 1.5,
            base_color_texture: None,
        }
    }
}

/// RGBA8 texels, row by row from the top.
#[derive(Clone, Debug)]
pub struct Texture {
    pub size: [u32; 2],
    pub texels: Vec<[u8; 4]>,
    pub srgb: bool,
}

impl Texture {
    /// Colour texels; the texture repeats.
    pub fn srgb(size: [u32; 2], texels: Vec<[u8; 4]>) -> Self {
        Self { size, texels, srgb: true }
    }
}

/// A place in time: seconds, metres.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Key {
    pub time: f32,
    pub translation: Vec3,
    pub rotation: Quat,
}

/// A virtual object: its own mesh, about its own origin, and where it stands or moves.
#[derive(Clone, Debug)]
pub struct Object {
    pub name: &'static str,
    pub mesh: Mesh,
    pub materials: Vec<Material>,
    pub textures: Vec<Texture>,
    pub translation: Vec3,
    pub rotation: Quat,
    /// Empty: it stands still. Otherwise the first and last key agree, so that the motion repeats.
    pub keys: Vec<Key>,
}

/// The camera of a built-in scene; vertical field of view in degrees.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct View {
    pub position: Vec3,
    pub look_at: Vec3,
    pub fov_y: f32,
    pub size: [u32; 2],
}

/// A built-in room: what is real, where it is captured from, and what is inserted.
#[derive(Clone, Debug)]
pub struct Room {
    pub name: &'static str,
    pub mesh: Mesh,
    pub materials: Vec<Material>,
    pub textures: Vec<Texture>,
    /// Metres.
    pub capture_position: Vec3,
    pub objects: Vec<Object>,
    pub view: View,
}

#[cfg(test)]
mod tests;
