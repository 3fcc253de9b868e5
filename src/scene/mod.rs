//! What is shown: scene file, objects, materials, BVH, camera, animation.
pub mod animation;
pub mod bounds;
pub mod bvh;
pub mod camera;
pub mod clip;
pub mod complete;
pub mod edit;
pub mod export;
pub mod fields;
pub mod file;
mod file_panorama;
pub mod gltf;
pub mod load;
pub mod material;
pub mod mips;
pub mod model;
pub mod movers;
pub mod pack;
pub mod packed;
pub mod punctual;
pub mod rooms;
pub mod shapes;
pub mod state;
pub mod viewpoint;

pub use complete::CompleteScene;
pub use state::{Object, Scene, SceneState};
