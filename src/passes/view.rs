//! One picture in the making: its images, its history, and the data that every pass reads.

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
    /// Sets the current and the previous viewpoint.
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
    /// What the view is for.
    pub role: Role,
    /// Width and height, pixels.
    pub size: [u32; 2],
    /// Buffers and images by name.
    pub resources: Resources,
    /// The buffer of [`ViewData`].
    pub data: Buffer,
    /// Arguments of indirect dispatches: real list, virtual list, tiles.
    pub arguments: Buffer,
    /// Why the history must not be used, if it must not. The next frame logs and clears this.
    pub history_reset: Option<&'static str>,
    /// The viewpoint of the previous frame.
    pub previous: Option<Viewpoint>,
}

/// What a view is for, which decides what it holds.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Role {
    /// The picture that is shown.
    Picture,
    /// The relit panorama's map, which shows no objects and holds no radiance.
    Relight,
}

/// The layer of real surfaces.
pub const REAL: u32 = 0;
/// The layer of virtual surfaces.
pub const VIRTUAL: u32 = 1;

/// The surfaces of a pixel for which an image holds values.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Holds {
    /// One value for the pixel itself.
    Pixel,
    /// One value for each surface: [`REAL`], and [`VIRTUAL`] if virtual surfaces are seen.
    Surfaces,
    /// As `Surfaces`, but with [`VIRTUAL`] only if virtual surfaces have a GGX lobe.
    Lobes,
}

/// An image of a view. `bind/images.glsl` says what it holds.
struct Declared {
    name: &'static str,
    format: Format,
    holds: Holds,
    /// Whether the previous frame's image is kept.
    history: bool,
    /// The image is left out if any of these parts is off.
    parts: &'static [Part],
    /// The image is left out if there are fewer levels of atrous.
    levels: u32,
    /// Whether the image is left out of the relit map.
    of_picture: bool,
}

impl Declared {
    const fn new(name: &'static str, format: Format, holds: Holds, parts: &'static [Part]) -> Self {
        Self { name, format, holds, history: false, parts, levels: 0, of_picture: false }
    }

    const fn with_history(self) -> Self {
        Self { history: true, ..self }
    }

    const fn at_levels(self, levels: u32) -> Self {
        Self { levels, ..self }
    }

    const fn of_picture(self) -> Self {
        Self { of_picture: true, ..self }
    }

    /// The part that the image needs and the plan leaves out.
    fn absent(&self, plan: &Plan, role: Role) -> Option<Part> {
        let missing = self.parts.iter().copied().find(|part| !plan.on(*part));
        let filter = (plan.settings.atrous_levels < self.levels).then_some(Part::Atrous);
        let picture = (self.of_picture && role != Role::Picture).then_some(Part::VirtualSurfaces);
        missing.or(filter).or(picture)
    }

    fn layers(&self, plan: &Plan, role: Role) -> u32 {
        let both = role == Role::Picture
            && match self.holds {
                Holds::Pixel => false,
                Holds::Surfaces => plan.on(Part::VirtualSurfaces),
                Holds::Lobes => plan.on(Part::VirtualSurfaces) && plan.on(Part::Specular),
            };
        1 + u32::from(both)
    }
}

const DECLARED: &[Declared] = {
    use Format::{R32f, Rgba16f, Rgba32f, Rgba32u};
    use Holds::{Lobes, Pixel, Surfaces};
    use Part::{Emission, Objects, Temporal, VirtualSurfaces};
    &[
        Declared::new("position", Rgba32f, Surfaces, &[Objects]).with_history(),
        Declared::new("normal", Rgba16f, Surfaces, &[Objects]).with_history(),
        Declared::new("motion", Rgba32f, Surfaces, &[Objects]).with_history(),
        Declared::new("camera_radiance", Rgba32f, Pixel, &[]).of_picture(),
        Declared::new("albedo_virtual", Rgba16f, Pixel, &[Objects, VirtualSurfaces]).of_picture(),
        Declared::new("emission", Rgba16f, Pixel, &[Objects, VirtualSurfaces, Emission]).of_picture(),
        Declared::new("hit", Rgba32u, Pixel, &[Objects, VirtualSurfaces]).of_picture(),
        Declared::new("real_coverage", R32f, Pixel, &[Objects, VirtualSurfaces]).of_picture(),
        Declared::new("radiance", Rgba32f, Pixel, &[]).of_picture(),
        Declared::new("mask", R32f, Surfaces, &[Objects]),
        Declared::new("irradiance_a", Rgba32f, Surfaces, &[Objects]),
        Declared::new("irradiance_b", Rgba32f, Lobes, &[Objects]),
        Declared::new("filtered_a", Rgba32f, Surfaces, &[Objects]).at_levels(1),
        Declared::new("filtered_b", Rgba32f, Lobes, &[Objects]).at_levels(1),
        Declared::new("scratch_a", Rgba32f, Surfaces, &[Objects]).at_levels(2),
        Declared::new("scratch_b", Rgba32f, Lobes, &[Objects]).at_levels(2),
        Declared::new("a", Rgba32f, Surfaces, &[Objects, Temporal]).with_history(),
        Declared::new("b", Rgba32f, Lobes, &[Objects, Temporal]).with_history(),
        Declared::new("moments", Rgba32f, Surfaces, &[Objects, Temporal]).with_history(),
    ]
};

/// Whether an image holds a value for each of a pixel's surfaces, in a layer each.
pub fn of_surfaces(image: &str) -> bool {
    DECLARED.iter().any(|declared| declared.name == image && declared.holds != Holds::Pixel)
}

/// Bytes of the lists of pixels and of tiles.
fn list_bytes(plan: &Plan, role: Role, size: [u32; 2]) -> [u64; 2] {
    if !plan.on(Part::Objects) {
        return [0; 2];
    }
    let layers = if role == Role::Picture && plan.on(Part::VirtualSurfaces) { 2 } else { 1 };
    let product = |[width, height]: [u32; 2]| u64::from(width) * u64::from(height);
    [product(size), product(size.map(|side| side.div_ceil(8)))].map(|items| items * layers * 4)
}

/// Bytes of a view's images and lists.
pub fn bytes(plan: &Plan, role: Role, size: [u32; 2]) -> u64 {
    let of = |image: &Declared| {
        let absent = image.absent(plan, role).is_some();
        let texels = if absent { 1 } else { u64::from(size[0]) * u64::from(size[1]) };
        let frames = if image.history && plan.on(Part::Temporal) { 2 } else { 1 };
        texels * u64::from(image.layers(plan, role)) * image.format.bytes() * frames
    };
    DECLARED.iter().map(of).sum::<u64>() + list_bytes(plan, role, size).iter().sum::<u64>()
}

impl View {
    /// Allocates what the plan needs. `label` prefixes resource names in messages.
    pub fn new(gpu: &Gpu, label: &str, size: [u32; 2], plan: &Plan, role: Role) -> Result<Self> {
        let mut resources = Resources::default();
        for declared in DECLARED {
            let Declared { name, format, .. } = *declared;
            let layers = declared.layers(plan, role);
            let image = || gpu.image(&format!("{label} {name}"), size, layers, 1, format);
            match declared.absent(plan, role) {
                Some(part) => resources.leave_out(gpu, name, format, part)?,
                None if declared.history && plan.on(Part::Temporal) => {
                    resources.add(name, Resource::History([image()?, image()?]));
                }
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
        Ok(Self { role, size, resources, data, arguments, history_reset: Some("first frame"), previous: None })
    }

    /// An image by name, as the current frame writes it.
    pub fn image(&self, name: &str) -> Result<&Image> {
        self.resources.image(name).ok_or_else(|| Error::Internal(format!("no image {name}")))
    }
}
