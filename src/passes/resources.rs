//! Named buffers and images, from which a pass binds what its shader declares.

use crate::{
    Error, Result,
    gpu::{
        Acceleration, Bind, Buffer, Constant, Format, Frame, Gpu, GpuStruct, Image, Pass, PassDeclaration, PushLayout,
        StructLayout, Threads, struct_layout,
    },
    plan::Part,
    scene::packed,
};

use super::{trace_rays, view::ViewData};

/// What a name stands for.
#[derive(Clone)]
pub enum Resource {
    Buffer(Buffer),
    Image(Image),
    Acceleration(Acceleration),
    /// A stand-in of one texel for an image that is left out with this part.
    Absent(Image, Part),
}

/// Buffers and images by name. Shaders prefix `in_` or `out_` for the direction.
#[derive(Clone, Default)]
pub struct Resources(pub Vec<(&'static str, Resource)>);

impl Resources {
    pub fn add(&mut self, name: &'static str, resource: Resource) {
        self.0.push((name, resource));
    }

    /// Adds the stand-in for an image that the plan leaves out.
    pub fn leave_out(&mut self, gpu: &Gpu, name: &'static str, format: Format, part: Part) -> Result<()> {
        let image = gpu.image(&format!("no {name}"), [1, 1], 1, 1, format)?;
        self.add(name, Resource::Absent(image, part));
        Ok(())
    }

    /// The part that the image of this name needs and the plan leaves out.
    pub fn absent(&self, name: &str) -> Option<Part> {
        self.0.iter().find(|(n, _)| *n == name).and_then(|(_, resource)| match resource {
            Resource::Absent(_, part) => Some(*part),
            _ => None,
        })
    }

    /// The image of this name as the current frame writes it.
    pub fn image(&self, name: &str) -> Option<&Image> {
        self.0.iter().find(|(n, _)| *n == name).and_then(|(_, resource)| match resource {
            Resource::Image(image) => Some(image),
            Resource::Buffer(_) | Resource::Acceleration(_) | Resource::Absent(..) => None,
        })
    }

    /// What a binding of this name is given.
    pub fn find(&self, binding: &str) -> Option<Bind> {
        let name = binding.strip_prefix("in_").or(binding.strip_prefix("out_")).unwrap_or(binding);
        self.0.iter().find(|(n, _)| *n == name).map(|(_, resource)| match resource {
            Resource::Buffer(buffer) => Bind::from(buffer),
            Resource::Image(image) | Resource::Absent(image, _) => Bind::from(image),
            Resource::Acceleration(acceleration) => Bind::from(acceleration),
        })
    }
}

/// Every struct in a buffer of some shader, by GLSL name. Each pass checks the layout of those it uses.
pub const STRUCTS: &[StructLayout] = &[
    struct_layout::<ViewData>("View"),
    struct_layout::<packed::TriangleShading>("TriangleShading"),
    struct_layout::<packed::Vertex>("Vertex"),
    struct_layout::<packed::Instance>("Instance"),
    struct_layout::<packed::Mover>("Mover"),
    struct_layout::<packed::PackedMaterial>("Material"),
    struct_layout::<packed::Light>("Emitter"),
    struct_layout::<packed::PackedTexture>("Texture"),
    struct_layout::<packed::Light>("Light"),
    struct_layout::<packed::Punctual>("Punctual"),
    struct_layout::<trace_rays::TracedRay>("TracedRay"),
    struct_layout::<super::free_lamps::FreeLamp>("FreeLamp"),
    struct_layout::<super::ingest::Meaning>("Meaning"),
    struct_layout::<super::ingest::Raised>("Raised"),
    struct_layout::<super::deform::RestVertex>("RestVertex"),
    struct_layout::<super::deform::Influence>("Influence"),
    struct_layout::<super::deform::Delta>("Delta"),
    struct_layout::<super::deform::Link>("Link"),
    struct_layout::<trace_rays::RayAnswer>("RayAnswer"),
];

/// A pass that finds what it binds by name.
pub struct Kernel(Pass);

impl Kernel {
    /// Builds a pass with push constants `P`.
    pub fn new<P: GpuStruct>(
        gpu: &Gpu,
        name: &'static str,
        spirv: &'static [u32],
        constants: &[Constant],
    ) -> Result<Self> {
        let push = (size_of::<P>() > 0).then(PushLayout::of::<P>);
        let declaration = PassDeclaration { name, spirv, push, structs: STRUCTS };
        Ok(Self(gpu.pass(&declaration, constants)?))
    }

    /// Records one dispatch. Names are looked up in `special`, then in the pools in their order.
    pub fn dispatch<P: GpuStruct>(
        &self,
        frame: &mut Frame,
        special: &[(&'static str, Bind)],
        pools: &[&Resources],
        push: &P,
        threads: Threads,
    ) -> Result<()> {
        let find = |name: &str| {
            let bind = special.iter().find(|(n, _)| *n == name).map(|(_, bind)| bind.clone());
            bind.or_else(|| pools.iter().find_map(|pool| pool.find(name)))
                .ok_or_else(|| Error::Internal(format!("{}: nothing is called {name}", self.0.name())))
        };
        let bound = self.0.bindings().iter().map(|binding| Ok((binding.name.as_str(), find(&binding.name)?)));
        frame.dispatch(&self.0, &bound.collect::<Result<Vec<_>>>()?, push, threads)
    }
}
