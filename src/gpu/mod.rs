//! Vulkan: device, memory, passes, timing. Knows nothing of panoramas.
//!
//! * [`Gpu`]: one device and one queue; hands out everything below and outlives it.
//! * [`Buffer`], [`Image`]: memory on the device; images stay in the `GENERAL` layout.
//! * [`Pass`]: one compute shader; its [`PassDeclaration`] is checked against the SPIR-V when it is made.
//! * [`Frame`]: records dispatches, transfers and explicit barriers, finds missing barriers, submits, and measures.

pub mod adapter;
mod device;
mod encode;
mod frame;
pub mod hazard;
pub mod layout;
mod memory;
mod pass;
mod reflect;
mod slot;
mod timing;
mod transfer;
pub mod validation;

pub use device::{Gpu, GpuOptions};
pub use frame::{Bind, Frame, Threads};
pub use layout::{GpuStruct, PushLayout, StructLayout, struct_layout};
pub use memory::{Buffer, Format, Image};
pub use pass::{Access, Pass, PassDeclaration};
pub use timing::Timings;
