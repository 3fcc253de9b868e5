//! Structs shared with GLSL under scalar block layout. Rust declares each once, and it is checked against the
//! SPIR-V when a pipeline is made.

/// The fields of a struct, by their GLSL names, with byte offsets.
pub type Fields = &'static [(&'static str, usize)];

/// A struct whose bytes a shader reads.
pub trait GpuStruct: bytemuck::Pod {
    /// The fields by their GLSL names, with byte offsets.
    const FIELDS: Fields;
}

impl GpuStruct for () {
    const FIELDS: Fields = &[];
}

/// Size and fields of a push constant block.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PushLayout {
    /// The block's size in bytes.
    pub size: usize,
    /// The block's members.
    pub fields: Fields,
}

impl PushLayout {
    /// The layout of `T`.
    pub const fn of<T: GpuStruct>() -> Self {
        Self { size: size_of::<T>(), fields: T::FIELDS }
    }
}

/// A struct used in buffers: its GLSL name, its size in bytes, and its fields.
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
