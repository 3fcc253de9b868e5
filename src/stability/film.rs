//! A short sequence of worlds, and how a method renders it.

use super::world::{Form, World, WorldTruth};
use crate::{
    Result,
    panorama::source::{PanoramaFrame, PanoramaSource},
    scene::{
        Object, Scene,
        animation::{Placement, Track, Transform},
        camera::{Aim, CameraTrack},
        file::RenderSettings,
        material::{Material, Slot},
        model::{Mesh, Model},
        shapes::Shape,
    },
};
use glam::Vec3;
use std::{f32::consts::PI, sync::Arc};

/// Frames a second.
pub const FPS: f64 = 30.0;

/// A change of a frame's capture.
pub type Spoil = Box<dyn Fn(usize, &mut PanoramaFrame) + Sync>;

/// A sequence of frames. Frame n is shown at n/30 s.
pub struct Film {
    /// The number of frames. The case decides which of them are measured.
    pub frames: usize,
    /// How many frames show the first moment before them.
    pub warmup: usize,
    /// Width and height of the picture, pixels.
    pub size: [u32; 2],
    /// Width and height of the panorama, texels.
    pub panorama: [u32; 2],
    /// The turn of the panorama in degrees. The world stays as it is.
    pub yaw: f32,
    /// Whether the real world changes. Then each frame has its own panorama.
    pub video: bool,
    /// Settings that differ from the method's.
    pub set: Vec<(&'static str, &'static str)>,
    /// The world of each frame. The number, form and look of things do not change.
    pub world: Box<dyn Fn(usize) -> World + Sync>,
    /// What is wrong with the capture of each frame.
    pub spoil: Option<Spoil>,
}

impl Film {
    /// Makes a film in which nothing moves.
    pub fn still(size: [u32; 2], frames: usize, world: impl Fn() -> World + Sync + 'static) -> Self {
        Self { warmup: frames - 1, ..Self::moving(size, 1, move |_| world()) }
    }

    /// Makes a film in which things and camera may move. The real world stands still.
    pub fn moving(size: [u32; 2], frames: usize, world: impl Fn(usize) -> World + Sync + 'static) -> Self {
        Self {
            frames,
            warmup: 0,
            size,
            panorama: [256, 128],
            yaw: 0.0,
            video: false,
            // The truth takes real surfaces as captured.
            set: vec![("relight_levels", "0")],
            world: Box::new(world),
            spoil: None,
        }
    }

    /// Adds a setting.
    pub fn with(mut self, name: &'static str, value: &'static str) -> Self {
        self.set.push((name, value));
        self
    }

    /// Returns the time in seconds at which a frame is shown.
    pub fn time(&self, frame: usize) -> f64 {
        frame as f64 / FPS
    }

    fn capture(&self, frame: usize) -> PanoramaFrame {
        (self.world)(if self.video { frame } else { 0 }).capture(self.panorama, self.yaw)
    }

    /// Returns what a frame's picture should be.
    pub fn truth(&self, frame: usize) -> WorldTruth {
        (self.world)(frame).truth(self.size, &self.capture(frame), self.yaw)
    }

    /// Makes the scene that is rendered.
    ///
    /// # Errors
    /// Fails if the panorama's arrays do not fit, which does not happen for the films of the suite.
    pub fn scene(&self) -> Result<Scene> {
        let worlds: Vec<World> = (0..self.frames).map(|n| (self.world)(n)).collect();
        let videos = if self.video { self.frames } else { 1 };
        let captured = |n: usize| {
            let mut frame = self.capture(n);
            if let Some(spoil) = &self.spoil {
                spoil(n, &mut frame);
            }
            frame
        };
        let panorama = PanoramaSource::from_frames((0..videos).map(captured).collect(), FPS, Vec3::ZERO, self.yaw)?;
        let track = |value: &dyn Fn(&World) -> Vec3| {
            let keys = worlds.iter().enumerate().map(|(n, world)| (self.time(n), value(world))).collect();
            Track::from_keys(keys, Vec3::ZERO)
        };
        let camera = CameraTrack {
            position: track(&|world| world.eye.at),
            aim: Aim::LookAt(track(&|world| world.eye.target)),
            fov_y_degrees: Track::constant(worlds[0].eye.fov_y),
            size: self.size,
        };
        let things = worlds[0].things.iter().enumerate().map(|(i, thing)| {
            let placement =
                Placement { translation: track(&|world| world.things[i].at), ..Placement::fixed(Transform::IDENTITY) };
            let mesh = match thing.form {
                Form::Ball(radius) => ball(radius),
                Form::Box(size) => Shape::Box.mesh(size),
            };
            let material = if thing.mirror {
                Material { metallic: 1.0, ..Material::plain("mirror", Vec3::ONE, 0.0) }
            } else {
                Material { specular: 0.0, emissive: thing.emission, ..Material::plain("matt", thing.albedo, 1.0) }
            };
            let mut model = Model::from_mesh(mesh, material);
            if let Some(texture) = thing.pattern.texture() {
                model.textures.push(Arc::new(texture));
                for material in &mut model.materials {
                    *material = material.clone().with_texture(Slot::BaseColor, 0);
                }
            }
            let model = Arc::new(model);
            Object { name: format!("thing {i}"), model, placement, clip: None, speed: 1.0 }
        });
        Scene::assemble("stability", panorama, camera, things.collect(), RenderSettings::default())
    }
}

/// Makes a ball so fine that no picture of the suite shows its facets.
fn ball(radius: f32) -> Mesh {
    const RINGS: u32 = 96;
    let mut mesh = Mesh { name: "ball".into(), ..Default::default() };
    for ring in 0..=RINGS {
        for sector in 0..2 * RINGS {
            let (sin, cos) = (PI * ring as f32 / RINGS as f32).sin_cos();
            let (x, z) = (PI * sector as f32 / RINGS as f32).sin_cos();
            mesh.normals.push(Vec3::new(sin * x, cos, sin * z).normalize());
        }
    }
    mesh.positions = mesh.normals.iter().map(|n| radius * n).collect();
    let columns = 2 * RINGS;
    for ring in 0..RINGS {
        for sector in 0..columns {
            let (a, b) = (ring * columns + sector, ring * columns + (sector + 1) % columns);
            if ring > 0 {
                mesh.triangles.push([a, a + columns, b]);
            }
            if ring + 1 < RINGS {
                mesh.triangles.push([b, a + columns, b + columns]);
            }
        }
    }
    mesh.materials = vec![0; mesh.triangles.len()];
    mesh
}
