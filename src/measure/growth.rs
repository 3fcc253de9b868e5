//! `bench --growth` measures how a frame's cost grows with pixels, triangles, texels and objects, one at a time.

use super::{bench, rays};
use crate::{
    Result,
    gpu::Gpu,
    options::RenderOptions,
    panorama::{
        reduce,
        source::{PanoramaFrame, PanoramaSource},
    },
    passes::{Every, PASSES},
    renderer::{Renderer, UPLOAD, Wishes},
    scene::{
        Object, Scene,
        animation::{Placement, Track, Transform},
        material::Material,
        model::Model,
        shapes,
    },
};
use glam::Vec3;
use serde::Serialize;
use std::{fmt::Write, sync::Arc, time::Instant};

/// What is varied, and its values: the picture's columns (16:9), the rings of a ball, the panorama's columns, and
/// the balls along a side of their square.
const AXES: [(&str, &[u32]); 4] = [
    ("pixels", &[320, 640, 1280, 1920, 3840]),
    ("triangles", &[16, 50, 158, 500]),
    ("texels", &[512, 1024, 2048, 4096, 8192]),
    ("objects", &[1, 2, 5, 10]),
];

/// The values of what is not varied, in the order of [`AXES`].
const BASE: [u32; 4] = [640, 50, 1024, 1];

const WARM_UP: u32 = 3;
const FRAMES: u32 = 5;

/// One measurement.
#[derive(Clone, Debug, Serialize)]
pub struct Step {
    /// How many pixels, triangles, texels or objects there are.
    pub count: u64,
    /// GPU milliseconds of a frame in which everything moves, median.
    pub frame_ms: f64,
    /// GPU milliseconds of what is done once for a video frame, uploads included.
    pub once_ms: f64,
    /// Wall seconds in which the scene is packed and the renderer made.
    pub setup_s: f64,
    /// Bytes of device memory.
    pub device_bytes: u64,
}

/// The measurements of one axis.
#[derive(Clone, Debug, Serialize)]
pub struct Axis {
    /// `pixels`, `triangles`, `texels` or `objects`.
    pub name: &'static str,
    /// From the smallest to the largest.
    pub steps: Vec<Step>,
}

/// The content of the file that `bench --growth --json` writes.
#[derive(Clone, Debug, Serialize)]
pub struct GrowthReport {
    /// Vulkan device name.
    pub device: String,
    /// Driver name and version.
    pub driver: String,
    /// Scene name.
    pub scene: String,
    /// Method name.
    pub method: String,
    /// What is varied.
    pub axes: Vec<Axis>,
}

/// Measures balls in the panorama of the scene's first video frame, seen by its camera at time 0. Together they
/// cover the same part of the picture, however many they are, and all of them move. The method and its settings
/// are those of `options`. `progress` is called once for each of [`steps`].
///
/// # Errors
/// Fails if the device cannot hold a scene or is lost.
pub fn run(gpu: &Gpu, scene: &Scene, options: &RenderOptions, mut progress: impl FnMut()) -> Result<GrowthReport> {
    let frame = scene.panorama.load(0)?;
    let mut axes = Vec::new();
    for (axis, (name, values)) in AXES.into_iter().enumerate() {
        let mut steps = Vec::new();
        for &value in values {
            let mut at = BASE;
            at[axis] = value;
            steps.push(step(gpu, scene, &frame, options, at, axis)?);
            progress();
        }
        axes.push(Axis { name, steps });
    }
    Ok(GrowthReport {
        device: gpu.device_name().to_owned(),
        driver: gpu.driver().to_owned(),
        scene: scene.name.clone(),
        method: options.method.name().to_owned(),
        axes,
    })
}

/// The number of measurements.
pub fn steps() -> usize {
    AXES.iter().map(|(.., values)| values.len()).sum()
}

fn step(
    gpu: &Gpu,
    scene: &Scene,
    frame: &PanoramaFrame,
    options: &RenderOptions,
    [columns, rings, texels, side]: [u32; 4],
    axis: usize,
) -> Result<Step> {
    let size = [columns, columns * 9 / 16];
    let color_size = [texels, texels / 2];
    let content = PanoramaFrame {
        color_size,
        radiance: reduce::means(&frame.radiance.to_vec(), frame.color_size, color_size),
        ..rays::resample(frame, color_size)?
    };
    let (position, yaw) = (scene.panorama.position, scene.panorama.yaw_degrees);
    let mesh = shapes::sphere(rings, Vec3::ONE);
    let counts = [columns * size[1], mesh.triangles.len() as u32, texels * color_size[1], side * side];
    let panorama = PanoramaSource::from_frames(vec![content], scene.panorama.fps, position, yaw)?;
    let model = Arc::new(Model::from_mesh(mesh, Material::plain("ball", Vec3::splat(0.6), 0.5)));

    let started = Instant::now();
    let balls = balls(scene, frame, &model, side);
    let grown = Scene::assemble(&scene.name, panorama, scene.camera.clone(), balls, scene.render.clone())?;
    let mut renderer = Renderer::new(gpu, &grown, RenderOptions { size, ..options.clone() })?;
    let setup_s = started.elapsed().as_secs_f64();
    let report = bench::run(&mut renderer, &grown, 0, FRAMES, WARM_UP, &Wishes::default(), || ())?;
    let once = PASSES.iter().filter(|pass| pass.every == Every::VideoFrame).map(|pass| pass.name).chain([UPLOAD]);
    Ok(Step {
        count: u64::from(counts[axis]),
        frame_ms: report.frame.gpu_median_ms,
        once_ms: once.filter_map(|name| renderer.prepared().pass(name)).sum(),
        setup_s,
        device_bytes: report.memory.device_bytes,
    })
}

/// A square of `side` × `side` balls in the middle of the picture, nearer than all that is real. Each moves to the
/// side.
fn balls(scene: &Scene, frame: &PanoramaFrame, model: &Arc<Model>, side: u32) -> Vec<Object> {
    let camera = scene.camera.at(0.0);
    let [right, up, ahead] = [Vec3::X, Vec3::Y, Vec3::NEG_Z].map(|axis| camera.rotation * axis);
    let near = frame.depth.iter().copied().filter(|depth| *depth > 0.0).fold(f32::INFINITY, f32::min);
    let distance = if near.is_finite() { 0.9 * near } else { 1.0 };
    let width = distance * (0.5 * camera.fov_y_degrees).to_radians().tan();
    let cell = width / side as f32;
    let place = |at: u32| (at as f32 + 0.5 - 0.5 * side as f32) * cell;
    let ball = |k: u32| {
        let from = camera.position + distance * ahead + place(k % side) * right + place(k / side) * up;
        let translation = Track::from_keys(vec![(0.0, from), (1.0, from + 0.5 * width * right)], from);
        let scale = Vec3::splat(0.8 * cell);
        Object {
            name: format!("ball {k}"),
            model: model.clone(),
            placement: Placement { translation, ..Placement::fixed(Transform { scale, ..Transform::IDENTITY }) },
            clip: None,
            speed: 1.0,
        }
    };
    (0..side * side).map(ball).collect()
}

impl GrowthReport {
    /// The report as tables for people, in Markdown.
    pub fn table(&self) -> String {
        let mut out = String::new();
        let _ = writeln!(
            out,
            "{} ({}), {}, method {}. Everything moves.",
            self.device, self.driver, self.scene, self.method
        );
        for Axis { name, steps } in &self.axes {
            let _ = writeln!(out, "\n| {name} | ms a frame | grows as | ms a video frame | set-up, s | MiB |");
            let _ = writeln!(out, "|---:|---:|---:|---:|---:|---:|");
            let mut before: Option<&Step> = None;
            for step in steps {
                let power = before.map(|before| {
                    (step.frame_ms / before.frame_ms).ln() / (step.count as f64 / before.count as f64).ln()
                });
                let power = power.map_or_else(String::new, |power| format!("{name}^{power:.2}"));
                let _ = writeln!(
                    out,
                    "| {} | {:.1} | {power} | {:.1} | {:.2} | {:.0} |",
                    step.count,
                    step.frame_ms,
                    step.once_ms,
                    step.setup_s,
                    step.device_bytes as f64 / f64::from(1 << 20)
                );
                before = Some(step);
            }
        }
        out
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_table_says_by_which_power_the_time_grows() {
        let step = |count, frame_ms| Step { count, frame_ms, once_ms: 0.0, setup_s: 0.0, device_bytes: 0 };
        let axes = vec![Axis { name: "pixels", steps: vec![step(100, 1.0), step(400, 4.0), step(1600, 8.0)] }];
        let report = GrowthReport {
            device: String::new(),
            driver: String::new(),
            scene: String::new(),
            method: String::new(),
            axes,
        };
        let table = report.table();
        assert!(table.contains("pixels^1.00") && table.contains("pixels^0.50"), "{table}");
    }
}
