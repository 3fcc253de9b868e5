//! The Vulkan layer: device, memory, passes and timing. It knows nothing of panoramas.
//!
//! * [`Gpu`] is one device with one queue. It makes everything below and outlives it.
//! * [`Buffer`] and [`Image`] are memory on the device. Images stay in the layout `GENERAL`.
//! * [`Acceleration`] is what ray queries search, on devices that have them.
//! * [`Pass`] is one compute shader. Its [`PassDeclaration`] is checked against the SPIR-V when it is made.
//! * [`Frame`] records dispatches, transfers and barriers, finds missing and needless barriers, and submits.
//! * [`Ticket`] is a frame that was submitted. Waiting for it gives its [`Timings`].
//! * `Screen` is a window that shows finished pictures with panels over them. It needs the feature `viewer`.

mod acceleration;
pub mod adapter;
mod bind;
mod command;
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
mod specialize;
#[cfg(feature = "viewer")]
mod swapchain;
mod ticket;
mod timing;
mod transfer;
pub mod validation;

pub use acceleration::{Acceleration, Placed};
pub use bind::Bind;
pub use device::{Gpu, GpuOptions, left_running};
pub use frame::{Frame, FrameOptions, Pieces, Threads};
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
