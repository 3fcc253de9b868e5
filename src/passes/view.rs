//! One picture being made: its images, its history, and the data that every pass reads.

use super::resources::{Resource, Resources};
use crate::{
    Error, Result,
    gpu::{Buffer, Format, Gpu, Image},
    gpu_struct,
    plan::{Part, Plan},
    scene::viewpoint::{Projection, Viewpoint},
};
use glam::{Mat3, Vec2, Vec3};

gpu_struct! {
    /// `View` in `common.glsl`. Positions are metres relative to the panorama's centre.
    pub struct ViewData {
        pub position: Vec3,
        pub right: Vec3,
        pub up: Vec3,
        pub forward: Vec3,
        pub tan_half: Vec2,
        pub previous_position: Vec3,
        pub previous_right: Vec3,
        pub previous_up: Vec3,
        pub previous_forward: Vec3,
        pub previous_tan_half: Vec2,
        pub size: [u32; 2],
        pub projection: u32,
        pub frame: u32,
        pub seed: u32,
        pub color_size: [u32; 2],
        pub color_levels: u32,
        pub depth_size: [u32; 2],
        pub yaw: f32,
        pub edge_ratio: f32,
        pub thickness: f32,
        pub pyramid_levels: u32,
        pub pyramid_size: [u32; 2],
        pub pyramid_area: u32,
        pub pyramid_nodes: u32,
        pub instance_count: u32,
        pub bounces: u32,
        pub coverage_samples: u32,
        pub rays_per_16: u32,
        pub history_limit: u32,
        pub relit: u32,
        pub relight_size: [u32; 2],
    }
}

impl ViewData {
    /// Sets this and the previous viewpoint.
    pub fn look(&mut self, from: &Viewpoint, previous: &Viewpoint) {
        let axes = |v: &Viewpoint| {
            let m = Mat3::from_quat(v.rotation);
            (m.x_axis, m.y_axis, -m.z_axis)
        };
        (self.right, self.up, self.forward) = axes(from);
        (self.previous_right, self.previous_up, self.previous_forward) = axes(previous);
        (self.position, self.previous_position) = (from.position, previous.position);
        (self.tan_half, self.previous_tan_half) = (from.tan_half, previous.tan_half);
        self.projection = u32::from(from.projection == Projection::Equirect);
    }
}

/// Images, lists and history of one picture.
pub struct View {
    /// Width and height, pixels.
    pub size: [u32; 2],
    /// Everything by name.
    pub resources: Resources,
    /// Where [`ViewData`] goes.
    pub data: Buffer,
    /// Indirect arguments: real list, virtual list, tiles.
    pub arguments: Buffer,
    /// Why the history is not to be used, if so: logged, and cleared by the next frame.
    pub history_reset: Option<&'static str>,
    /// The viewpoint of the previous frame.
    pub previous: Option<Viewpoint>,
}

/// What a view is for, which decides on what it holds.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Role {
    /// What is shown.
    Picture,
    /// The relit panorama's map: no objects in view, no radiance.
    Relight,
}

/// An image of a view.
struct Declared {
    name: &'static str,
    format: Format,
    /// The real and the virtual surface, or one.
    layers: u32,
    /// Whether the previous frame's is kept.
    history: bool,
    /// The part without which it is not there.
    absent: Option<Part>,
}

/// Images that hold a value for each of a pixel's surfaces, a layer each; [`REAL`] alone where no virtual one is seen.
pub const SURFACE_IMAGES: [&str; 13] = [
    "position",
    "normal",
    "motion",
    "mask",
    "irradiance_a",
    "irradiance_b",
    "filtered_a",
    "filtered_b",
    "scratch_a",
    "scratch_b",
    "a",
    "b",
    "moments",
];

/// The layer of real surfaces.
pub const REAL: u32 = 0;
/// The layer of virtual ones.
pub const VIRTUAL: u32 = 1;

/// All images, those included that the plan leaves out.
fn declared(plan: &Plan, role: Role) -> Vec<Declared> {
    use Part::{Emission, Objects, Specular, Temporal, VirtualSurfaces};
    let shown = role == Role::Picture;
    let levels = plan.settings.atrous_levels;
    let missing = |parts: &[Part]| parts.iter().copied().find(|part| !plan.on(*part));
    let layers = if shown && plan.on(VirtualSurfaces) { 2 } else { 1 };
    let layers_b = if plan.on(Specular) { layers } else { 1 };
    let filter = |level| missing(&[Objects]).or((levels < level).then_some(Part::Atrous));
    // what a map of irradiance has no use for
    let of_picture = |parts: &[Part]| missing(parts).or((!shown).then_some(VirtualSurfaces));
    let image = |name, format, layers, history, absent| Declared { name, format, layers, history, absent };
    let history = plan.on(Temporal);
    vec![
        image("position", Format::Rgba32f, layers, history, missing(&[Objects])),
        image("normal", Format::Rgba16f, layers, history, missing(&[Objects])),
        image("motion", Format::Rgba32f, layers, history, missing(&[Objects])),
        image("camera_radiance", Format::Rgba32f, 1, false, of_picture(&[])),
        image("albedo_virtual", Format::Rgba16f, 1, false, of_picture(&[Objects, VirtualSurfaces])),
        image("emission", Format::Rgba16f, 1, false, of_picture(&[Objects, VirtualSurfaces, Emission])),
        image("hit", Format::Rgba32u, 1, false, of_picture(&[Objects, VirtualSurfaces])),
        image("real_coverage", Format::R32f, 1, false, of_picture(&[Objects, VirtualSurfaces])),
        image("radiance", Format::Rgba32f, 1, false, of_picture(&[])),
        image("mask", Format::R32f, layers, false, missing(&[Objects])),
        image("irradiance_a", Format::Rgba32f, layers, false, missing(&[Objects])),
        image("irradiance_b", Format::Rgba32f, layers_b, false, missing(&[Objects])),
        image("filtered_a", Format::Rgba32f, layers, false, filter(1)),
        image("filtered_b", Format::Rgba32f, layers_b, false, filter(1)),
        image("scratch_a", Format::Rgba32f, layers, false, filter(2)),
        image("scratch_b", Format::Rgba32f, layers_b, false, filter(2)),
        image("a", Format::Rgba32f, layers, true, missing(&[Objects, Temporal])),
        image("b", Format::Rgba32f, layers_b, true, missing(&[Objects, Temporal])),
        image("moments", Format::Rgba32f, layers, true, missing(&[Objects, Temporal])),
    ]
}

/// Bytes of the list of pixels and the list of tiles.
fn list_bytes(plan: &Plan, role: Role, size: [u32; 2]) -> [u64; 2] {
    if !plan.on(Part::Objects) {
        return [0; 2];
    }
    let layers = if role == Role::Picture && plan.on(Part::VirtualSurfaces) { 2 } else { 1 };
    let product = |[width, height]: [u32; 2]| u64::from(width) * u64::from(height);
    [product(size), product(size.map(|side| side.div_ceil(8)))].map(|items| items * layers * 4)
}

/// What a view takes.
pub fn bytes(plan: &Plan, role: Role, size: [u32; 2]) -> u64 {
    let of = |image: &Declared| {
        let texels = if image.absent.is_some() { 1 } else { u64::from(size[0]) * u64::from(size[1]) };
        texels * u64::from(image.layers) * image.format.bytes() * if image.history { 2 } else { 1 }
    };
    declared(plan, role).iter().map(of).sum::<u64>() + list_bytes(plan, role, size).iter().sum::<u64>()
}

impl View {
    /// Allocates what the plan asks for. `label` prefixes resource names in messages.
    pub fn new(gpu: &Gpu, label: &str, size: [u32; 2], plan: &Plan, role: Role) -> Result<Self> {
        let mut resources = Resources::default();
        for Declared { name, format, layers, history, absent } in declared(plan, role) {
            let image = || gpu.image(&format!("{label} {name}"), size, layers, 1, format);
            match absent {
                Some(part) => resources.leave_out(gpu, name, format, part)?,
                None if history => resources.add(name, Resource::History([image()?, image()?])),
                None => resources.add(name, Resource::Image(image()?)),
            }
        }
        let [list, tiles] = list_bytes(plan, role, size);
        let arguments = gpu.buffer(&format!("{label} arguments"), 12 * 4)?;
        let data = gpu.buffer(&format!("{label} view"), size_of::<ViewData>() as u64)?;
        resources.add("list", Resource::Buffer(gpu.buffer(&format!("{label} list"), list)?));
        resources.add("tiles", Resource::Buffer(gpu.buffer(&format!("{label} tiles"), tiles)?));
        resources.add("arguments", Resource::Buffer(arguments.clone()));
        resources.add("view", Resource::Buffer(data.clone()));
        Ok(Self { size, resources, data, arguments, history_reset: Some("first frame"), previous: None })
    }

    /// An image by name, as the current frame writes it.
    pub fn image(&self, name: &str) -> Result<&Image> {
        self.resources.image(name).ok_or_else(|| Error::Internal(format!("no image {name}")))
    }
}
