//! Vulkan: device, memory, passes, timing. Knows nothing of panoramas.
//!
//! * [`Gpu`]: one device and one queue; hands out everything below and outlives it.
//! * [`Buffer`], [`Image`]: memory on the device; images stay in the `GENERAL` layout.
//! * [`Pass`]: one compute shader; its [`PassDeclaration`] is checked against the SPIR-V when it is made.
//! * [`Frame`]: records dispatches, transfers and explicit barriers, finds those that are missing or needless, and submits.
//! * [`Ticket`]: a frame that was submitted; waiting for it gives its [`Timings`].
//! * `Screen`, with the feature `viewer`: a window that shows finished pictures, with panels over them.

pub mod adapter;
mod device;
mod encode;
mod frame;
pub mod hazard;
pub mod layout;
mod memory;
#[cfg(feature = "viewer")]
mod overlay;
mod pass;
mod pipeline_cache;
mod reflect;
#[cfg(feature = "viewer")]
mod screen;
mod slot;
#[cfg(feature = "viewer")]
mod swapchain;
mod ticket;
mod timing;
mod transfer;
pub mod validation;

pub use device::{Gpu, GpuOptions};
pub use frame::{Bind, Frame, FrameOptions, Pieces, Threads};
pub use layout::{GpuStruct, PushLayout, StructLayout, struct_layout};
pub use memory::{Buffer, Format, Image};
#[cfg(feature = "viewer")]
pub use overlay::Paint;
pub use pass::{Access, Constant, Pass, PassDeclaration};
pub use reflect::{Binding, Kind, bindings};
#[cfg(feature = "viewer")]
pub use screen::{Blit, Screen, Shown};
#[cfg(feature = "viewer")]
pub use swapchain::{PresentMode, WindowHandles};
pub use ticket::Ticket;
pub use timing::{Entry, Node, Timings};
