//! Structs shared with GLSL under scalar block layout: declared once in Rust, checked against the SPIR-V when a
//! pipeline is made.

/// Field names (as in GLSL) and their byte offsets.
pub type Fields = &'static [(&'static str, usize)];

/// A struct whose bytes a shader reads: its size and the byte offset of each field, by name.
pub trait GpuStruct: bytemuck::Pod {
    /// Field names (as in GLSL) and their byte offsets.
    const FIELDS: Fields;
}

/// No push constants.
impl GpuStruct for () {
    const FIELDS: Fields = &[];
}

/// Size and fields of a push constant block.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PushLayout {
    /// Bytes.
    pub size: usize,
    /// Its members.
    pub fields: Fields,
}

impl PushLayout {
    /// The layout of `T`.
    pub const fn of<T: GpuStruct>() -> Self {
        Self { size: size_of::<T>(), fields: T::FIELDS }
    }
}

/// A struct used in buffers: its name in GLSL, its size in bytes, its fields.
pub type StructLayout = (&'static str, usize, Fields);

/// The [`StructLayout`] of `T`, which GLSL calls `name`.
pub const fn struct_layout<T: GpuStruct>(name: &'static str) -> StructLayout {
    (name, size_of::<T>(), T::FIELDS)
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
