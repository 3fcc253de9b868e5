//! What a plan must know about a scene.

use super::{Part, convex};
use crate::{
    Result,
    gpu::Constant,
    options::RenderOptions,
    panorama::{
        codes::{Codes, Coding},
        lamps,
        light::{light_share, mean_luminance},
        mapping::texel_direction,
        source::PanoramaFrame,
    },
    scene::{
        Scene,
        bounds::Bounds,
        material::Slot,
        packed,
        viewpoint::{Projection, Viewpoint},
    },
};
use glam::{Quat, Vec3};

/// Where the camera's key frames are. Values are the largest distance from the capture point, metres.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum CameraPlace {
    /// Always at the capture point.
    Centre,
    /// Never at the capture point.
    Away(f32),
    /// At the capture point at some time, or perhaps so.
    Both(f32),
    /// A user moves the camera by hand.
    Anywhere,
}

/// The least share of light above the mean for which lights are drawn, less a margin for rounding.
pub const EVEN: f64 = 0.05 - 1e-4;

/// What is known about a scene. What is uncertain counts as needed.
#[derive(Clone, Debug, PartialEq)]
pub struct Facts {
    /// The projection of the picture.
    pub projection: Projection,
    /// Whether the picture is that of one eye of two.
    pub of_eye: bool,
    /// The mean luminance of the panorama's first frame.
    pub luminance: f32,
    /// The brightest radiance that a material emits, without its texture, and the greatest irradiance ten centimetres
    /// from a light without a surface.
    pub brightest: f32,
    /// Width and height of the panorama's radiance, texels.
    pub color_size: [u32; 2],
    /// Width and height of the panorama's depth, texels.
    pub depth_size: [u32; 2],
    /// The number of frames of the panorama.
    pub video_frames: usize,
    /// How many frames will be rendered from one history, if that is known.
    pub frames: Option<u32>,
    /// Whether any texel has a depth.
    pub has_depth: bool,
    /// The share of the panorama's light that is above its mean. `None` if the panorama changes.
    pub light_share: Option<f64>,
    /// How many small lamps hang free in the panorama. `None` if the panorama changes.
    pub free_lamps: Option<usize>,
    /// How the panorama's frames are coded, if they are kept as codes.
    pub codes: Option<Coding>,
    /// How many rows of the panorama a pixel spans at the camera's widest angle.
    pub footprint: f32,
    /// Where the camera is over the whole time.
    pub camera: CameraPlace,
    /// Whether the camera moves.
    pub camera_moves: bool,
    /// The number of placed meshes.
    pub instances: usize,
    /// The number of lights without a surface.
    pub lights: usize,
    /// Says what moves, if anything does.
    pub moving: Option<String>,
    /// Says what changes its shape, if anything does.
    pub deforming: Option<String>,
    /// Whether an object can be in the picture.
    pub in_view: bool,
    /// Says which materials emit light, if any do.
    pub emissive: Option<String>,
    /// A bit for each [`Slot`] that any material has a texture in, and the highest
    /// bit if any of them lies on other coordinates than the first as they are.
    pub texture_slots: u32,
    /// Says which materials reflect a picture, if any do.
    pub smooth: Option<String>,
    /// Says which materials need each part of [`Part::MATERIAL`], if any do.
    pub materials: [Option<String>; Part::MATERIAL.len()],
    /// `Ok` if a ray that has left a virtual surface can meet none again, else the reason why it may.
    pub alone: std::result::Result<(), String>,
}

impl Facts {
    /// Examines a scene. Loads the panorama's first frame.
    ///
    /// # Errors
    /// Fails if the panorama cannot be read.
    pub fn of(scene: &Scene, options: &RenderOptions, frames: Option<u32>) -> Result<Self> {
        let first = scene.panorama.load(0)?;
        let still = scene.panorama.frame_count() == 1;
        let instances = if options.without_objects { 0 } else { scene.instance_count() };
        let lights = if options.without_objects { 0 } else { scene.light_count() };
        let fov = scene.camera.fov_y_degrees.keys().map(|(_, fov)| fov).fold(0.0, f32::max);
        let widest = match options.projection {
            Projection::Perspective => Viewpoint::perspective(Vec3::ZERO, Quat::IDENTITY, fov, options.size),
            Projection::Equirect => Viewpoint::equirect(Vec3::ZERO, Quat::IDENTITY),
        };
        let moving = scene.moving_object().filter(|_| instances + lights > 0).map(|name| format!("{name} moves"));
        let materials = |has: &dyn Fn(&packed::PackedMaterial) -> bool| {
            let all = &scene.packed.materials;
            let some = all.iter().filter(|material| has(material)).count();
            (some > 0 && instances > 0).then(|| format!("{some} of {} materials", all.len()))
        };
        Ok(Self {
            projection: options.projection,
            of_eye: options.eye != 0.0,
            luminance: mean_luminance(&first),
            brightest: brightest(scene),
            color_size: first.color_size,
            depth_size: first.depth_size,
            video_frames: scene.panorama.frame_count(),
            frames,
            has_depth: !still || first.depth.iter().any(|depth| *depth > 0.0),
            light_share: still.then(|| light_share(&first)),
            free_lamps: still.then(|| lamps::find(&first).lamps.len()),
            codes: first.radiance.codes().map(Codes::coding),
            footprint: widest.pixel_angle(options.size[1]) * first.color_size[1] as f32 / std::f32::consts::PI,
            camera: camera_place(scene, options.eye),
            camera_moves: !scene.camera.is_constant(),
            instances,
            lights,
            deforming: scene
                .deforming_object()
                .filter(|_| instances > 0)
                .map(|name| format!("{name} changes its shape")),
            in_view: instances > 0 && in_view(scene, options, moving.is_some()),
            emissive: materials(&|m| m.emissive != Vec3::ZERO),
            texture_slots: texture_slots(&scene.packed),
            smooth: materials(&smooth),
            materials: Part::MATERIAL.map(|part| materials(&|m| part.is_in(m))),
            alone: if instances == 0 { Ok(()) } else { alone(scene, &first, still && moving.is_none()) },
            moving,
        })
    }

    /// The facts of the same scene in a window. The user can move camera and objects by hand, so their places
    /// are unknown. Pictures may be up to `shrink` times smaller each way than the facts were found for.
    pub(super) fn interactive(self, shrink: f32) -> Self {
        let by_hand = || "objects can be moved by hand".to_owned();
        Self {
            camera: CameraPlace::Anywhere,
            camera_moves: true,
            moving: Some(by_hand()),
            alone: Err(by_hand()),
            in_view: true,
            footprint: self.footprint * shrink,
            ..self
        }
    }
}

fn brightest(scene: &Scene) -> f32 {
    let surfaces = scene.packed.materials.iter().map(|material| material.emissive);
    let lights = scene.at(0.0, 0.0).instances.lights.into_iter();
    let lights = lights.map(|light| if light.directional != 0 { light.intensity } else { 100.0 * light.intensity });
    surfaces.chain(lights).map(|light| light.max_element()).fold(0.0, f32::max)
}

/// The specialization constants with which a shader serves the materials of a scene, and no others.
pub fn material_constants(scene: &packed::PackedScene) -> Vec<Constant> {
    let needed = |part: &Part| scene.materials.iter().any(|material| part.is_in(material));
    let value = |part: &Part| match part {
        Part::Textures => texture_slots(scene),
        part => u32::from(needed(part)),
    };
    Part::MATERIAL.iter().map(|part| part.constant(value(part))).collect()
}

/// Whether a material has a lobe that reflects a picture, at least in places: textures make it smoother.
fn smooth(m: &packed::PackedMaterial) -> bool {
    const SMOOTH: f32 = 0.3; // as in reflection.glsl
    let textured = |slot: Slot| m.textures[slot as usize] != packed::NONE;
    let glossy = m.specular != 0.0 || m.metallic != 0.0;
    glossy && (m.roughness < SMOOTH || textured(Slot::MetallicRoughness))
        || m.clearcoat > 0.0 && (m.clearcoat_roughness < SMOOTH || textured(Slot::ClearcoatRoughness))
}

fn texture_slots(scene: &packed::PackedScene) -> u32 {
    let plain = packed::PackedTexture { transform: [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0]], ..Default::default() };
    let mut slots = 0;
    for material in &scene.materials {
        for (slot, texture) in material.textures.iter().enumerate() {
            if let Some(texture) = scene.textures.get(*texture as usize) {
                let moved = (texture.set, texture.transform) != (plain.set, plain.transform);
                slots |= 1 << slot | u32::from(moved) << 31;
            }
        }
    }
    slots
}

fn camera_place(scene: &Scene, eye: f32) -> CameraPlace {
    let place = |position| Viewpoint::equirect(position - scene.panorama.position, Quat::IDENTITY);
    let places: Vec<_> = scene.camera.position.keys().map(|(_, position)| place(position)).collect();
    let most = places.iter().map(|place| place.position.length()).fold(0.0, f32::max);
    if eye != 0.0 {
        return CameraPlace::Away(most + eye.abs());
    }
    match (places.iter().all(Viewpoint::centred), places.len()) {
        (true, _) => CameraPlace::Centre,
        (false, 1) => CameraPlace::Away(most),
        (false, _) => CameraPlace::Both(most), // its path may pass the capture point
    }
}

/// Whether an object may be in the picture. It cannot be if neither camera nor objects move and each object's
/// box is outside one side of the view, which is taken to be a pixel wider than the picture.
fn in_view(scene: &Scene, options: &RenderOptions, objects_move: bool) -> bool {
    if options.projection == Projection::Equirect || objects_move || !scene.camera.is_constant() {
        return true;
    }
    let camera = scene.camera.at(0.0);
    let [width, height] = options.size.map(|n| n as f32);
    let tan_y = (0.5 * camera.fov_y_degrees.to_radians()).tan();
    let pixel = 2.0 * tan_y / height;
    let (x, y) = (tan_y * width / height + 2.0 * pixel, tan_y + 2.0 * pixel);
    // inward normals of the four sides, and the forward direction
    let sides = [
        Vec3::new(-1.0, 0.0, -x),
        Vec3::new(1.0, 0.0, -x),
        Vec3::new(0.0, -1.0, -y),
        Vec3::new(0.0, 1.0, -y),
        Vec3::NEG_Z,
    ];
    (0..scene.object_count()).any(|index| {
        let bounds = scene.object_bounds(index, 0.0);
        let corners = bounds.corners().map(|corner| camera.rotation.inverse() * (corner - camera.position));
        !bounds.is_empty() && sides.iter().all(|side| corners.iter().any(|corner| side.dot(*corner) > -1e-4))
    })
}

/// `Ok` if no ray that leaves an object meets one again: there is only one, it is convex, and nothing real and
/// no camera is in it. Otherwise says why not.
fn alone(scene: &Scene, first: &PanoramaFrame, still: bool) -> std::result::Result<(), String> {
    if scene.instance_count() != 1 {
        return Err("objects may see each other".to_owned());
    }
    if !still {
        return Err("the object may come to where something is inside it".to_owned());
    }
    let through =
        |m: &packed::PackedMaterial| m.transmission > 0.0 || m.flags & (packed::MASKED | packed::BLENDED) != 0;
    if scene.packed.materials.iter().any(through) {
        return Err("one sees through the object, so it may see itself".to_owned());
    }
    // the tolerance is half the offset of rays from virtual surfaces, in the object's own units
    let rows =
        scene.at(0.0, 0.0).instances.instances.first().map_or([[0.0; 4]; 3], |instance| instance.object_to_world);
    let scale = rows.iter().flat_map(|row| &row[..3]).map(|v| f64::from(v * v)).sum::<f64>().sqrt();
    let one_sided = scene.packed.materials.iter().any(|m| m.flags & packed::ONE_SIDED != 0);
    if !convex::is_convex(&scene.packed.triangles, 5e-5 / scale.max(1e-12), one_sided) {
        return Err("the object is not convex and closed, so it may see itself".to_owned());
    }
    let bounds = (0..scene.object_count()).map(|i| scene.object_bounds(i, 0.0)).fold(Bounds::EMPTY, Bounds::union);
    let path = Bounds::of(scene.camera.position.keys().map(|(_, position)| position));
    if bounds.overlaps(&path.grown(1e-3)) {
        return Err("the camera may be in the object".to_owned());
    }
    if touches_surface(scene, first, bounds) {
        return Err("something real may be in the object".to_owned());
    }
    Ok(())
}

/// Whether a quad of the real surface, or a ray's start on it, may be in a box. A pole's fan is one quad.
fn touches_surface(scene: &Scene, frame: &PanoramaFrame, bounds: Bounds) -> bool {
    let [width, height] = frame.depth_size;
    let turn = Quat::from_rotation_y(scene.panorama.yaw_degrees.to_radians());
    let point = |x: u32, y: u32| {
        let depth = frame.depth[(y * width + x % width) as usize];
        (depth > 0.0).then(|| turn * texel_direction(x % width, y, frame.depth_size).as_vec3() * depth)
    };
    let overlaps = |points: &[Vec3]| {
        let farthest = points.iter().map(|p| p.length()).fold(0.0, f32::max);
        // rays start 0.2 % of the distance off the surface, and depth moves by less, or by a step of its
        // codes
        let around = Bounds::of(points.iter().map(|p| *p + scene.panorama.position)).grown(0.01 * farthest + 1e-3);
        !points.is_empty() && around.overlaps(&bounds)
    };
    let quads = (0..height.saturating_sub(1)).any(|y| {
        (0..width).any(|x| {
            let corners = [point(x, y), point(x + 1, y), point(x, y + 1), point(x + 1, y + 1)];
            overlaps(&corners.into_iter().flatten().collect::<Vec<_>>())
        })
    });
    let poles =
        [0, height - 1].into_iter().any(|y| overlaps(&(0..width).filter_map(|x| point(x, y)).collect::<Vec<_>>()));
    quads || poles
}
