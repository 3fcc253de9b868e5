//! What is shown: scene file, objects, materials, BVH, camera, animation.
pub mod packed;
pub mod rooms;
