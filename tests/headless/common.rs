//! What the tests of the renderer share: the device under validation, small scenes in memory, frames of them.

use glam::{Vec3, vec3};
use iprt::{
    gpu::{Gpu, GpuOptions},
    options::RenderOptions,
    panorama::{
        depth::box_depth,
        mapping::texel_direction,
        source::{PanoramaFrame, PanoramaSource},
    },
    reference::path_trace::{PathTracer, Sums},
    renderer::Renderer,
    scene::{
        Object, Scene,
        animation::{Placement, Track, Transform},
        camera::{Aim, CameraTrack},
        clip::{Clip, Join, Weights},
        deform::{Deform, Target},
        file::RenderSettings,
        material::Material,
        model::{Local, Mesh, Model, Node, Rig},
        punctual::{PunctualKind, PunctualLight},
        shapes::Shape,
        viewpoint::Projection,
    },
    settings::{Method, Settings},
};
use std::sync::Arc;

pub type Texels = Vec<[f32; 4]>;

/// A device with core and synchronization validation.
pub fn open() -> Gpu {
    let device = std::env::var("IPRT_DEVICE").ok();
    Gpu::new(&GpuOptions { device, validation: true, ..Default::default() })
        .expect("tests need a Vulkan device and the validation layer")
}

/// Destroys the device and demands that validation had nothing to say.
pub fn close(gpu: Gpu) {
    let messages = gpu.destroy().expect("nothing holds the device");
    assert!(messages.is_empty(), "{}", messages.join("\n"));
}

/// Runs a test between [`open`] and [`close`]. A pass that it makes twice is made once.
pub fn validated(test: impl FnOnce(&Gpu)) {
    let gpu = open();
    test(&gpu.keeping_passes());
    close(gpu);
}

/// The light that this many samples of a path tracer bring.
pub fn sampled(mut tracer: PathTracer, samples: u32) -> Sums {
    for _ in 0..samples {
        tracer.sample().expect("runs");
    }
    tracer.read().expect("reads")
}

/// The mean of the green channel.
pub fn mean(sums: &Sums) -> f32 {
    let radiance = sums.radiance();
    assert!(radiance.iter().flatten().all(|x| x.is_finite() && *x >= 0.0));
    radiance.iter().map(|c| c[1]).sum::<f32>() / radiance.len() as f32
}

/// A panorama of any radiance in a box room: full extents, and its centre relative to the capture point.
pub fn room(size: [u32; 2], extent: Vec3, center: Vec3, radiance: impl Fn(Vec3) -> Vec3) -> PanoramaFrame {
    let directions = (0..size[0] * size[1]).map(|i| texel_direction(i % size[0], i / size[0], size).as_vec3());
    PanoramaFrame {
        color_size: size,
        radiance: directions.map(|d| radiance(d).extend(1.0).to_array()).collect(),
        depth_size: size,
        depth: box_depth(size, extent, center, 0.0),
        ..Default::default()
    }
}

/// A panorama of real surfaces at any distances, 0 for holes, and of any radiance by direction.
pub fn surroundings(size: [u32; 2], distance: impl Fn(Vec3) -> f32, radiance: impl Fn(Vec3) -> Vec3) -> PanoramaFrame {
    let directions: Vec<Vec3> =
        (0..size[0] * size[1]).map(|i| texel_direction(i % size[0], i / size[0], size).as_vec3()).collect();
    PanoramaFrame {
        color_size: size,
        radiance: directions.iter().map(|d| radiance(*d).extend(1.0).to_array()).collect(),
        depth_size: size,
        depth: directions.iter().map(|d| distance(*d)).collect(),
        ..Default::default()
    }
}

/// Where a ray from the capture point leaves a box that holds it.
pub fn leaves(d: Vec3, low: Vec3, high: Vec3) -> f32 {
    (Vec3::select(d.cmpgt(Vec3::ZERO), high, low) / d).abs().min_element()
}

/// Where a ray from the capture point enters a box, if it does.
pub fn enters(d: Vec3, low: Vec3, high: Vec3) -> Option<f32> {
    let (a, b) = (low / d, high / d);
    let (enter, leave) = (a.min(b).max_element(), a.max(b).min_element());
    (enter < leave && enter > 0.0).then_some(enter)
}

/// Radiance 1 everywhere and a floor at y = −1.5, walls far away.
pub fn floor() -> PanoramaFrame {
    room([128, 64], vec3(16.0, 9.5, 16.0), vec3(0.0, 3.25, 0.0), |_| Vec3::ONE)
}

/// Every texel another colour.
pub fn colourful(d: Vec3) -> Vec3 {
    Vec3::splat(0.6) + 0.3 * d + 0.2 * vec3((9.0 * d.x).sin(), (11.0 * d.y).cos(), (13.0 * d.z).sin())
}

pub fn lambert(albedo: f32) -> Material {
    Material { specular: 0.0, ..Material::plain("lambert", Vec3::splat(albedo), 1.0) }
}

pub fn metal(roughness: f32) -> Material {
    Material { metallic: 1.0, ..Material::plain("metal", Vec3::ONE, roughness) }
}

pub fn object(mesh: Mesh, material: Material, at: Vec3) -> Object {
    Object {
        name: mesh.name.clone(),
        model: Arc::new(Model::from_mesh(mesh, material)),
        placement: Placement::fixed(Transform { translation: at, ..Transform::IDENTITY }),
        clip: None,
        speed: 1.0,
    }
}

pub fn ball(radius: f32, material: Material, at: Vec3) -> Object {
    object(Shape::Sphere.mesh(Vec3::splat(2.0 * radius)), material, at)
}

/// A ball of many more triangles than the built-in one: its silhouette is a circle's to 1e-4. Its tangents run along circles about Y.
pub fn fine_ball(radius: f32, material: Material, at: Vec3) -> Object {
    const RINGS: u32 = 96;
    let mut mesh = Mesh { name: "fine ball".into(), ..Default::default() };
    for ring in 0..=RINGS {
        for sector in 0..=2 * RINGS {
            let (sin, cos) = (std::f32::consts::PI * ring as f32 / RINGS as f32).sin_cos();
            let (x, z) = (std::f32::consts::PI * (sector % (2 * RINGS)) as f32 / RINGS as f32).sin_cos();
            mesh.normals.push(vec3(sin * x, cos, sin * z).normalize());
            mesh.tangents.push([z, 0.0, -x, 1.0]);
        }
    }
    mesh.positions = mesh.normals.iter().map(|n| radius * n).collect();
    let columns = 2 * RINGS + 1;
    for ring in 0..RINGS {
        for sector in 0..2 * RINGS {
            let a = ring * columns + sector;
            if ring > 0 {
                mesh.triangles.push([a, a + columns, a + 1]);
            }
            if ring + 1 < RINGS {
                mesh.triangles.push([a + 1, a + columns, a + columns + 1]);
            }
        }
    }
    mesh.materials = vec![0; mesh.triangles.len()];
    object(mesh, material, at)
}

/// A light without a surface that shines everywhere, alone.
pub fn light(intensity: Vec3, at: Vec3) -> Object {
    let lamp = PunctualLight { node: 0, intensity, kind: PunctualKind::Point, range: f32::INFINITY };
    let local = Local::Transform(Transform::IDENTITY);
    let node = Node { name: "light".into(), parent: None, local, mesh: None, weights: Vec::new() };
    let rig = Rig { nodes: vec![node], clips: Vec::new() };
    let model = Model { name: "light".into(), rig, lights: vec![lamp], ..Model::default() };
    Object { name: "light".into(), model: Arc::new(model), ..object(Mesh::default(), lambert(0.0), at) }
}

pub fn moving(object: Object, from: Vec3, to: Vec3) -> Object {
    let translation = Track::from_keys(vec![(0.0, from), (1.0, to)], from);
    Object { placement: Placement { translation, ..object.placement }, ..object }
}

/// A box that a morph target makes higher in a second.
pub fn growing(at: Vec3) -> Object {
    let mut still = object(Shape::Box.mesh(vec3(0.3, 0.1, 0.3)), lambert(0.6), at);
    let model = Arc::make_mut(&mut still.model);
    let mesh = Arc::make_mut(&mut model.meshes[0]);
    let up = mesh.positions.iter().map(|p| if p.y > 0.0 { 0.5 * Vec3::Y } else { Vec3::ZERO }).collect();
    let target = Target { positions: up, normals: vec![] };
    let (positions, normals) = (mesh.positions.clone(), mesh.normals.clone());
    mesh.deform = Some(Arc::new(Deform { positions, normals, targets: vec![target], ..Deform::default() }));
    model.rig.nodes[0].weights = vec![0.0];
    let weights = Weights { node: 0, join: Join::Linear, times: vec![0.0, 1.0], values: vec![0.0, 1.0] };
    model.rig.clips.push(Clip { weights: [weights].into(), hold: true, ..Clip::default() });
    Object { clip: Some(0), ..still }
}

/// A camera at a point that looks at another.
pub fn camera(position: Vec3, target: Vec3, fov_y: f32) -> CameraTrack {
    CameraTrack {
        aim: Aim::LookAt(Track::constant(target)),
        fov_y_degrees: Track::constant(fov_y),
        ..CameraTrack::at_point(position)
    }
}

/// A camera that has another view each second, given by position, target and full vertical angle: several pictures of one
/// renderer, for it is the renderer that takes time to make.
pub fn views(list: &[(Vec3, Vec3, f32)]) -> CameraTrack {
    let second = |k: usize| k as f64;
    let keys =
        |of: &dyn Fn(&(Vec3, Vec3, f32)) -> Vec3| list.iter().enumerate().map(|(k, v)| (second(k), of(v))).collect();
    CameraTrack {
        position: Track::from_keys(keys(&|v| v.0), Vec3::ZERO),
        aim: Aim::LookAt(Track::from_keys(keys(&|v| v.1), Vec3::ZERO)),
        fov_y_degrees: Track::from_keys(list.iter().enumerate().map(|(k, v)| (second(k), v.2)).collect(), 60.0),
        ..CameraTrack::at_point(Vec3::ZERO)
    }
}

/// This many frames of the view of a second, from nothing.
pub fn accumulate(renderer: &mut Renderer, scene: &Scene, second: usize, frames: u32) {
    renderer.reset_history("another view");
    for _ in 0..frames {
        renderer.render(scene, second as f64).expect("renders");
    }
}

pub fn scene(panorama: PanoramaFrame, camera: CameraTrack, objects: Vec<Object>) -> Scene {
    let panorama = PanoramaSource::from_frames(vec![panorama], 30.0, Vec3::ZERO, 0.0).expect("a good panorama");
    Scene::assemble("test", panorama, camera, objects, RenderSettings::default()).expect("a good scene")
}

pub const SIZE: [u32; 2] = [64, 48];

/// A method's settings with some of them set, perspective, [`SIZE`].
pub fn options(method: Method, set: &[(&str, &str)]) -> RenderOptions {
    let mut settings = Settings::of(method);
    for (name, value) in set {
        settings.set(name, value, "test").expect("a good setting");
    }
    let projection = Projection::Perspective;
    RenderOptions { size: SIZE, method, settings, projection, seed: 1, without_objects: false, eye: 0.0 }
}

/// A method's own model, converged, with some settings after that.
pub fn converged(method: Method, set: &[(&str, &str)]) -> RenderOptions {
    let mut settings = Settings::of(method);
    settings.converge();
    for (name, value) in set {
        settings.set(name, value, "test").expect("a good setting");
    }
    RenderOptions { settings, ..options(method, &[]) }
}

/// A renderer after this many frames at time 0.
pub fn rendered(gpu: &Gpu, scene: &Scene, options: RenderOptions, frames: u32) -> Renderer {
    let mut renderer = Renderer::new(gpu, scene, options).expect("fits");
    for _ in 0..frames {
        renderer.render(scene, 0.0).expect("renders");
    }
    renderer
}

pub fn aov(renderer: &Renderer, name: &str) -> Texels {
    let texels = renderer.aov(name).expect("there is such an image");
    assert!(texels.iter().flatten().all(|x| x.is_finite()), "{name} is finite");
    texels
}

/// The unit direction through a point of a perspective picture, in pixels, of a camera that looks at `target` from `position`.
pub fn pixel_direction(track: &CameraTrack, time: f64, size: [u32; 2], pixel: glam::Vec2) -> Vec3 {
    let camera = track.at(time);
    let tan = (0.5 * camera.fov_y_degrees.to_radians()).tan();
    let ndc = pixel / glam::vec2(size[0] as f32, size[1] as f32) * 2.0 - 1.0;
    (camera.rotation * vec3(ndc.x * tan * size[0] as f32 / size[1] as f32, -ndc.y * tan, -1.0)).normalize()
}

/// Where a point is in such a picture, in pixels.
pub fn project(track: &CameraTrack, time: f64, size: [u32; 2], point: Vec3) -> glam::Vec2 {
    let camera = track.at(time);
    let tan = (0.5 * camera.fov_y_degrees.to_radians()).tan();
    let local = camera.rotation.inverse() * (point - camera.position);
    let ndc = glam::vec2(local.x * size[1] as f32 / size[0] as f32, -local.y) / (-local.z * tan);
    (ndc * 0.5 + 0.5) * glam::vec2(size[0] as f32, size[1] as f32)
}

/// Mean and largest of |E/expected − 1|, taken over means of 4×4 pixels in which `expected` is known everywhere.
pub fn irradiance_error(
    irradiance: &Texels,
    [width, height]: [u32; 2],
    expected: impl Fn(usize) -> Option<f32>,
) -> (f32, f32) {
    let (mut sum, mut largest, mut blocks) = (0.0f32, 0.0f32, 0);
    for pixels in (0..width * height / 16).map(|block| block_pixels(block, width)) {
        let error = |i: usize| expected(i).map(|e| irradiance[i][1] / e - 1.0);
        let Some(errors) = pixels.into_iter().map(error).collect::<Option<Vec<_>>>() else { continue };
        let error = (errors.iter().sum::<f32>() / 16.0).abs();
        (sum, largest, blocks) = (sum + error, largest.max(error), blocks + 1);
    }
    assert!(blocks > 10, "{blocks} blocks");
    (sum / blocks as f32, largest)
}

/// The pixels of a block of 4×4.
pub fn block_pixels(block: u32, width: u32) -> [usize; 16] {
    let (x, y) = (block % (width / 4), block / (width / 4));
    std::array::from_fn(|k| ((4 * y + k as u32 / 4) * width + 4 * x + k as u32 % 4) as usize)
}
