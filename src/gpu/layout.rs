//! Structs shared with GLSL under scalar block layout: declared once in Rust, checked against the SPIR-V when a
//! pipeline is made.

/// A struct whose bytes a shader reads: its size and the byte offset of each field, by name.
pub trait GpuStruct: bytemuck::Pod {
    /// Field names (as in GLSL) and their byte offsets.
    const FIELDS: &'static [(&'static str, usize)];
}

/// Declares a `#[repr(C)]` plain-data struct together with its [`GpuStruct`] field table.
#[macro_export]
macro_rules! gpu_struct {
    ($(#[$meta:meta])* $vis:vis struct $name:ident { $($(#[$fmeta:meta])* pub $field:ident : $ty:ty),* $(,)? }) => {
        $(#[$meta])*
        #[repr(C)]
        #[derive(Clone, Copy, Debug, Default, PartialEq, bytemuck::Pod, bytemuck::Zeroable)]
        $vis struct $name { $($(#[$fmeta])* pub $field: $ty),* }
        impl $crate::gpu::layout::GpuStruct for $name {
            const FIELDS: &'static [(&'static str, usize)] = &[$((stringify!($field), std::mem::offset_of!($name, $field))),*];
        }
    };
}
