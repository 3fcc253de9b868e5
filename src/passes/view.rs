//! One picture in the making: its images, its history, and the data that every pass reads.

mod history;

use super::resources::{Resource, Resources};
use crate::{
    Error, Result,
    gpu::{Buffer, Constant, Format, Gpu, Image, Threads},
    gpu_struct,
    plan::{Part, Plan},
    scene::viewpoint::{Projection, Viewpoint},
};
use glam::{Mat3, Vec2, Vec3};
use history::Kept;
pub use history::Shown;

gpu_struct! {
    /// `View` in `common.glsl`. Positions are metres relative to the panorama's centre.
    pub struct ViewData {
        pub position: Vec3,
        pub right: Vec3,
        pub up: Vec3,
        pub forward: Vec3,
        pub tan_half: Vec2,
        pub eye: f32,
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
        pub skirt_luminance: f32,
        pub edge_depth: u32,
        pub pyramid_levels: u32,
        pub pyramid_size: [u32; 2],
        pub pyramid_area: u32,
        pub pyramid_nodes: u32,
        pub instance_count: u32,
        pub light_count: u32,
        pub mover_count: u32,
        pub touching_count: u32,
        pub new_video: u32,
        pub bounces: u32,
        pub coverage_samples: u32,
        pub rays_per_16: u32,
        pub history_limit: u32,
        pub history_limit_real: u32,
        pub relit: u32,
        pub relight_size: [u32; 2],
        pub light_units: Vec2,
        pub light_now: [u32; 2],
        pub light_before: [u32; 2],
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
        self.eye = from.eye;
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
    /// Arguments of indirect dispatches over the lists of pixels, of real and of virtual surfaces.
    pub arguments: Buffer,
    /// The same for the lists of tiles in which a layer holds surfaces.
    pub held_arguments: Buffer,
    /// The same for the tiles among these that are visited this frame.
    pub tile_arguments: Buffer,
    /// The pixels that the pass aim leaves of the list of real surfaces.
    pub aimed: Buffer,
    /// The arguments of a dispatch over these.
    pub aimed_arguments: Buffer,
    /// Why the history must not be used, if it must not. The next frame logs and clears this.
    pub history_reset: Option<&'static str>,
    /// The viewpoint of the previous frame.
    pub previous: Option<Viewpoint>,
    /// What is kept of each layer, real and virtual surfaces.
    kept: [Kept; 2],
    /// Whether images with a history hold two frames.
    history: bool,
    /// Whether `accumulated` and `filtered` change places from frame to frame ([`View::light`]).
    swaps: bool,
    /// Whether `irradiance` serves as `scratch`, too.
    lends: bool,
    /// The names of these images.
    histories: Vec<&'static str>,
}

/// What stands still in a layer since the last frame. The number is the shaders' constant `STANDS`.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Stands {
    /// Anything may have moved.
    Nothing = 0,
    /// Camera and objects, so that each pixel is its own history. The video does not.
    Steady = 1,
    /// All of it.
    Still = 2,
}

impl Stands {
    /// What can stand still in a plan's frames.
    pub fn possible(plan: &Plan) -> impl Iterator<Item = Self> {
        let steady = plan.on(Part::Video).then_some(Self::Steady);
        [Self::Nothing, Self::Still].into_iter().chain(steady)
    }
}

/// What a view is for, which decides what it holds.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Role {
    /// The picture that is shown.
    Picture,
    /// The relit panorama's map, which shows no objects and holds no radiance.
    Relight,
}

impl Role {
    /// The specialization constant of the projection, which is one in all views of this role.
    pub fn projection(self, plan: &Plan) -> Constant {
        let number = match (self, plan.facts.projection) {
            (Self::Picture, Projection::Perspective) => 0,
            (Self::Picture, Projection::Equirect) if plan.facts.of_eye => 3,
            _ => 1,
        };
        ("PROJECTION", number)
    }

    /// The layers whose surfaces are lit.
    pub fn layers(self, plan: &Plan) -> &'static [u32] {
        if self == Self::Picture && plan.on(Part::VirtualSurfaces) { &[REAL, VIRTUAL] } else { &[REAL] }
    }
}

/// Why there is a barrier between the dispatches of a pass, which write different layers of the same images.
pub const LAYERS_FOLLOW: &str = "virtual surfaces come after real ones";

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
    /// Whether the previous frame's values are kept, in layers of their own.
    history: bool,
    /// Whether the image is left out where light is accumulated in brief.
    unless_brief: bool,
    /// Whether the image is left out where another can be used in its place ([`Plan::lends_irradiance`]).
    borrowed: bool,
    /// The image is left out if any of these parts is off.
    parts: &'static [Part],
    /// The image is left out if there are fewer levels of atrous.
    levels: u32,
    /// Whether the image is left out of the relit map.
    of_picture: bool,
    /// Whether it holds a and b, as `light_code.glsl` packs them.
    packed: bool,
}

impl Declared {
    const fn new(name: &'static str, format: Format, holds: Holds, parts: &'static [Part]) -> Self {
        Self {
            name,
            format,
            holds,
            history: false,
            unless_brief: false,
            borrowed: false,
            parts,
            levels: 0,
            of_picture: false,
            packed: false,
        }
    }

    const fn with_history(self) -> Self {
        Self { history: true, ..self }
    }

    const fn unless_brief(self) -> Self {
        Self { unless_brief: true, ..self }
    }

    const fn borrowed(self) -> Self {
        Self { borrowed: true, ..self }
    }

    fn keeps_history(&self, plan: &Plan) -> bool {
        plan.on(Part::Temporal) && self.history
    }

    const fn at_levels(self, levels: u32) -> Self {
        Self { levels, ..self }
    }

    const fn packed(self) -> Self {
        Self { packed: true, ..self }
    }

    const fn of_picture(self) -> Self {
        Self { of_picture: true, ..self }
    }

    /// The part that the image needs and the plan leaves out.
    fn absent(&self, plan: &Plan, role: Role) -> Option<Part> {
        let missing = self.parts.iter().copied().find(|part| !plan.on(*part));
        let filter = (plan.settings.atrous_levels < self.levels).then_some(Part::Atrous);
        let picture = (self.of_picture && role != Role::Picture).then_some(Part::VirtualSurfaces);
        let brief = (self.unless_brief && plan.history_in_brief()).then_some(Part::Temporal);
        let lent = (self.borrowed && plan.lends_irradiance()).then_some(Part::Temporal);
        missing.or(filter).or(picture).or(brief).or(lent)
    }

    fn layers(&self, plan: &Plan, role: Role) -> u32 {
        let both = role == Role::Picture
            && match self.holds {
                Holds::Pixel => false,
                Holds::Surfaces => plan.on(Part::VirtualSurfaces),
                Holds::Lobes => plan.on(Part::VirtualSurfaces) && plan.on(Part::Specular),
            };
        (1 + u32::from(both)) * if self.keeps_history(plan) { 2 } else { 1 }
    }
}

const DECLARED: &[Declared] = {
    use Format::{R8Snorm, R16f, R32u, Rg16f, Rg32u, Rgba16f, Rgba32f, Rgba32u};
    use Holds::{Lobes, Pixel, Surfaces};
    use Part::{Emission, Objects, Temporal, VirtualSurfaces};
    &[
        Declared::new("motion", Rgba16f, Pixel, &[Objects, VirtualSurfaces]).of_picture(),
        Declared::new("guide", Rgba32u, Surfaces, &[Objects]),
        Declared::new("past", Rg32u, Surfaces, &[Objects, Temporal]),
        Declared::new("camera_radiance", Rgba32f, Pixel, &[]).of_picture(),
        Declared::new("albedo_virtual", R32u, Pixel, &[Objects, VirtualSurfaces]).of_picture(),
        Declared::new("emission", R32u, Pixel, &[Objects, VirtualSurfaces, Emission]).of_picture(),
        Declared::new("hit", Rgba32u, Pixel, &[Objects, VirtualSurfaces]).of_picture(),
        Declared::new("real_coverage", R16f, Pixel, &[Objects, VirtualSurfaces]).of_picture(),
        Declared::new("reflected", Rgba16f, Pixel, &[Part::Reflections]).of_picture(),
        Declared::new("radiance", Rgba32f, Pixel, &[]).of_picture(),
        Declared::new("mask", R8Snorm, Surfaces, &[Objects]),
        Declared::new("irradiance", Rgba32u, Surfaces, &[Objects]).packed(),
        Declared::new("a", Rgba32f, Surfaces, &[Objects, Temporal]).with_history().unless_brief(),
        Declared::new("b", Rgba32f, Lobes, &[Objects, Temporal]).with_history().unless_brief(),
        Declared::new("frames", Rg16f, Surfaces, &[Objects, Temporal]).with_history(),
        Declared::new("accumulated", Rgba32u, Surfaces, &[Objects, Temporal]).packed(),
        Declared::new("filtered", Rgba32u, Surfaces, &[Objects]).packed().at_levels(1),
        Declared::new("scratch", Rgba32u, Surfaces, &[Objects]).packed().at_levels(2).borrowed(),
    ]
};

/// Whether an image holds a value for each of a pixel's surfaces, in a layer each.
pub fn of_surfaces(image: &str) -> bool {
    DECLARED.iter().any(|declared| declared.name == image && declared.holds != Holds::Pixel)
}

/// Whether an image holds a and b, as `light_code.glsl` packs them, in full or in brief.
pub fn is_packed(image: &str) -> bool {
    DECLARED.iter().any(|declared| declared.name == image && declared.packed)
}

/// Whether an image holds a colour in a word, as `color_code.glsl` packs it.
pub fn is_color(image: &str) -> bool {
    DECLARED.iter().any(|declared| declared.name == image && declared.format == Format::R32u)
}

/// Bytes of the arguments of an indirect dispatch, as in `list.glsl`.
const ARGUMENTS: u64 = 16;

/// Bytes of the list of pixels, of a list of tiles, and of the list that aim leaves.
fn list_bytes(plan: &Plan, role: Role, size: [u32; 2]) -> [u64; 3] {
    if !plan.on(Part::Objects) {
        return [0; 3];
    }
    let layers = role.layers(plan).len() as u64;
    let bytes = |[width, height]: [u32; 2]| u64::from(width) * u64::from(height) * 4;
    let (pixels, tiles) = (bytes(size), bytes(size.map(|side| side.div_ceil(8))));
    [pixels * layers, tiles * 2, if plan.roulette() { pixels } else { 0 }]
}

/// Bytes of each of a view's images and lists, by name. `tiles` stands for all lists of tiles, and for what is kept of
/// each.
pub fn memory(plan: &Plan, role: Role, size: [u32; 2]) -> Vec<(&'static str, u64)> {
    let of = |image: &Declared| {
        let absent = image.absent(plan, role).is_some();
        let texels = if absent { 1 } else { u64::from(size[0]) * u64::from(size[1]) };
        (image.name, texels * u64::from(image.layers(plan, role)) * image.format.bytes())
    };
    let [list, tiles, aimed] = list_bytes(plan, role, size);
    let lists = [("list", list), ("aimed", aimed), ("tiles", 9 * tiles)];
    DECLARED.iter().map(of).chain(lists).collect()
}

/// Bytes of a view's images and lists.
pub fn bytes(plan: &Plan, role: Role, size: [u32; 2]) -> u64 {
    memory(plan, role, size).into_iter().map(|(_, bytes)| bytes).sum()
}

/// Fills an image with `LIGHT_UNKNOWN` of `light_code.glsl`.
fn unknown(gpu: &Gpu, image: &Image, [width, height]: [u32; 2], layers: u32) -> Result<()> {
    let texels = vec![[0_u32, 0, 0, 0xbc00]; width as usize * height as usize];
    (0..layers).try_for_each(|layer| gpu.write_image(image, layer, 0, &texels))
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
                None => resources.add(name, Resource::Image(image()?)),
            }
            // A pixel may be read before it is written: its tile rests when the video shows a surface there.
            if declared.packed
                && let Some(image) = resources.image(name)
            {
                unknown(gpu, image, size, layers)?;
            }
        }
        let [list, tiles, aimed] = list_bytes(plan, role, size);
        let mut buffer = |name, words: &str, bytes| -> Result<Buffer> {
            let buffer = gpu.buffer(&format!("{label} {words}"), bytes)?;
            resources.add(name, Resource::Buffer(buffer.clone()));
            Ok(buffer)
        };
        buffer("list", "list", list)?;
        buffer("held_tiles", "held tiles", tiles)?;
        buffer("tile_holds", "tile holds", tiles)?;
        buffer("changes", "changes", 4 * tiles)?;
        buffer("followed", "followed", 2 * tiles)?;
        buffer("tiles", "tiles", tiles)?;
        let aimed = buffer("aimed", "aimed", aimed)?;
        let aimed_arguments = buffer("aimed_arguments", "aimed arguments", 2 * ARGUMENTS)?;
        let held_arguments = buffer("held_arguments", "held tile arguments", 2 * ARGUMENTS)?;
        let arguments = buffer("arguments", "arguments", 2 * ARGUMENTS)?;
        let tile_arguments = buffer("tile_arguments", "tile arguments", 2 * ARGUMENTS)?;
        let data = buffer("view", "view", size_of::<ViewData>() as u64)?;
        // A tile that was never visited does not rest, and its pixels are as if nothing changed them.
        let tile_light = buffer("tile_light", "tile light", tiles)?;
        gpu.write_buffer(&tile_light, 0, &vec![f32::MAX; tiles as usize / 4])?;
        Ok(Self {
            role,
            size,
            resources,
            data,
            arguments,
            held_arguments,
            tile_arguments,
            aimed,
            aimed_arguments,
            history_reset: Some("first frame"),
            previous: None,
            kept: Default::default(),
            history: plan.on(Part::Temporal),
            swaps: plan.history_in_brief(),
            lends: plan.lends_irradiance(),
            histories: DECLARED.iter().filter(|image| image.keeps_history(plan)).map(|image| image.name).collect(),
        })
    }

    /// The threads of a dispatch over the list of a layer's pixels.
    pub fn listed(&self, layer: u32) -> Threads<'_> {
        Threads::Indirect(&self.arguments, u64::from(layer) * ARGUMENTS)
    }

    /// The threads of a dispatch over the tiles in which a layer holds surfaces.
    pub fn tiles(&self, layer: u32) -> Threads<'_> {
        Threads::Indirect(&self.tile_arguments, u64::from(layer) * ARGUMENTS)
    }

    /// An image by name, as the current frame writes it.
    pub fn image(&self, name: &str) -> Result<&Image> {
        self.resources.image(name).ok_or_else(|| Error::Internal(format!("no image {name}")))
    }

    /// The image that holds light of a layer: `irradiance`, `accumulated`, `filtered` or `scratch`.
    ///
    /// Where light is accumulated in brief, two images change places when the layer moves: what is accumulated anew goes
    /// where the last frame's filtered light was, and what was accumulated before, which nothing else needs, is where the
    /// filter then writes.
    pub fn light(&self, name: &str, layer: u32) -> Result<&Image> {
        let swapped = self.swaps && self.light_turn(layer) == 1;
        self.image(match name {
            "accumulated" if swapped => "filtered",
            "filtered" if swapped => "accumulated",
            "scratch" if self.lends => "irradiance",
            name => name,
        })
    }
}
