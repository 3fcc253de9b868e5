//! Vulkan: device, memory, passes, timing. Knows nothing of panoramas.
pub mod layout;
