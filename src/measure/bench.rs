//! `bench` measures GPU times by pass, from timestamp queries.

use super::clock::{self, Sample, median, quantile};
use crate::{
    Result,
    gpu::{Entry, Node},
    renderer::{Renderer, UPLOAD, Wishes, cost::PassPlan},
    scene::Scene,
};
use serde::Serialize;
use std::{collections::BTreeMap, fmt::Write};

/// The times of one pass over the measured frames that dispatched it. The dispatches of a frame are summed.
#[derive(Clone, Debug, Serialize)]
pub struct PassTime {
    /// Name of the pass.
    pub name: String,
    /// Median, milliseconds.
    pub median_ms: f64,
    /// 95 % of the frames take at most this long, milliseconds.
    pub p95_ms: f64,
    /// Shortest time, milliseconds.
    pub min_ms: f64,
    /// Longest time, milliseconds.
    pub max_ms: f64,
    /// Why the pass was not dispatched, or `None` if it was.
    pub off: Option<String>,
}

/// A scope, a dispatch or a transfer: what a pass is made of.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct TimeTree {
    /// Its name.
    pub name: String,
    /// Median over the measured frames that ran it, milliseconds.
    pub median_ms: f64,
    /// Its parts.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub parts: Vec<TimeTree>,
}

/// The times of whole frames.
#[derive(Clone, Debug, Serialize)]
pub struct FrameTime {
    /// Median time from the first timestamp to the last, milliseconds.
    pub gpu_median_ms: f64,
    /// 95th percentile of the same time.
    pub gpu_p95_ms: f64,
    /// Median wall time between the ends of successive frames, milliseconds. Two frames are in flight.
    pub wall_median_ms: f64,
    /// 95th percentile of the same time.
    pub wall_p95_ms: f64,
    /// The share of all frames' wall time in which the GPU did nothing for them.
    pub beyond_gpu: f64,
    /// The share of the GPU's frame time that passes and uploads take. It is the median over the frames.
    pub coverage: f64,
}

/// Use of device memory.
#[derive(Clone, Debug, Serialize)]
pub struct Memory {
    /// Bytes that were allocated while measuring.
    pub device_bytes: u64,
}

/// The content of the file that `bench --json` writes.
#[derive(Clone, Debug, Serialize)]
pub struct BenchReport {
    /// Vulkan device name.
    pub device: String,
    /// Driver name and version.
    pub driver: String,
    /// Scene name.
    pub scene: String,
    /// Method name.
    pub method: String,
    /// Width and height, pixels.
    pub size: [u32; 2],
    /// Number of measured frames.
    pub frames: u32,
    /// Number of frames that were run before them.
    pub warmup: u32,
    /// All settings, as the plan changed them.
    pub settings: BTreeMap<String, String>,
    /// All passes in frame order.
    pub passes: Vec<PassTime>,
    /// What the passes are made of, and the uploads, in the order of the frame.
    pub tree: Vec<TimeTree>,
    /// The whole frames.
    pub frame: FrameTime,
    /// Device memory.
    pub memory: Memory,
    /// The plan in one line.
    #[serde(skip)]
    pub plan: String,
    #[serde(skip)]
    samples: Vec<Sample>,
}

/// Renders `warmup` frames at the time of the first frame, and then measures `frames` frames from there on.
/// `progress` is called after each frame.
///
/// # Errors
/// Fails as [`clock::frames`] does.
pub fn run(
    renderer: &mut Renderer,
    scene: &Scene,
    first: u32,
    frames: u32,
    warmup: u32,
    wishes: &Wishes,
    mut progress: impl FnMut(),
) -> Result<BenchReport> {
    let numbers = std::iter::repeat_n(first, warmup as usize).chain((0..frames).map(|n| first + n));
    let times = numbers.map(|frame| scene.panorama.frame_time(frame as usize));
    let mut samples = clock::frames(renderer, scene, times, wishes, || {
        progress();
        Ok(())
    })?;
    samples.drain(..warmup as usize);
    let gpu = renderer.gpu();
    let options = renderer.options();
    let passes = renderer.plan().passes().iter().map(|pass| pass_time(pass, &samples, renderer)).collect();
    let mut gpu_ms: Vec<f64> = samples.iter().map(|s| s.timings.gpu_ms).collect();
    let mut wall_ms: Vec<f64> = samples.iter().map(|s| s.wall_ms).collect();
    let beyond_gpu = 1.0 - gpu_ms.iter().sum::<f64>() / wall_ms.iter().sum::<f64>().max(1e-9);
    let share = |s: &Sample| s.timings.sum() / s.timings.gpu_ms.max(1e-9);
    Ok(BenchReport {
        device: gpu.device_name().to_owned(),
        driver: gpu.driver().to_owned(),
        scene: scene.name.clone(),
        method: options.method.name(),
        size: options.size,
        frames,
        warmup,
        settings: renderer.plan().settings.values().into_iter().map(|(name, value)| (name.to_owned(), value)).collect(),
        passes,
        tree: tree(samples.iter().map(|sample| sample.timings.tree()).collect()),
        frame: FrameTime {
            gpu_median_ms: quantile(&mut gpu_ms, 0.5),
            gpu_p95_ms: quantile(&mut gpu_ms, 0.95),
            wall_median_ms: quantile(&mut wall_ms, 0.5),
            wall_p95_ms: quantile(&mut wall_ms, 0.95),
            beyond_gpu,
            coverage: median(samples.iter().map(share)),
        },
        memory: Memory { device_bytes: gpu.device_bytes() },
        plan: renderer.plan().summary(),
        samples,
    })
}

/// The medians of trees, by name. What a frame does not run does not count in it.
fn tree(frames: Vec<Vec<Node>>) -> Vec<TimeTree> {
    let mut merged: Vec<(String, Vec<f64>, Vec<Vec<Node>>)> = Vec::new();
    for node in frames.into_iter().flatten() {
        match merged.iter_mut().find(|(name, ..)| *name == node.name) {
            Some((_, times, parts)) => {
                times.push(node.ms);
                parts.push(node.children);
            }
            None => merged.push((node.name, vec![node.ms], vec![node.children])),
        }
    }
    let median = |(name, mut times, parts): (_, Vec<f64>, _)| TimeTree {
        name,
        median_ms: quantile(&mut times, 0.5),
        parts: tree(parts),
    };
    merged.into_iter().map(median).collect()
}

fn pass_time(pass: &PassPlan, samples: &[Sample], renderer: &Renderer) -> PassTime {
    let name = pass.name;
    let mut times: Vec<f64> = samples.iter().filter_map(|s| s.timings.pass(name)).collect();
    if times.is_empty() {
        let off = match renderer.prepared().pass(name) {
            Some(ms) => format!("nothing that it depends on has changed; done once before, {ms:.1} ms"),
            None => pass.off.clone().unwrap_or_else(|| "not dispatched in the frames measured".to_owned()),
        };
        return PassTime {
            name: name.to_owned(),
            median_ms: 0.0,
            p95_ms: 0.0,
            min_ms: 0.0,
            max_ms: 0.0,
            off: Some(off),
        };
    }
    let (median_ms, p95_ms) = (quantile(&mut times, 0.5), quantile(&mut times, 0.95));
    PassTime { name: name.to_owned(), median_ms, p95_ms, min_ms: times[0], max_ms: times[times.len() - 1], off: None }
}

impl BenchReport {
    /// The report as a table for people.
    pub fn table(&self) -> String {
        let mut out = String::new();
        let _ = writeln!(
            out,
            "{} ({}), {} at {}×{}, method {}",
            self.device, self.driver, self.scene, self.size[0], self.size[1], self.method
        );
        let _ = writeln!(out, "{}", self.plan);
        let _ = writeln!(out, "{} frames after {} of warm-up; milliseconds of GPU time", self.frames, self.warmup);
        let _ = writeln!(out, "{:<18}{:>10}{:>10}{:>10}{:>10}", "pass", "median", "p95", "min", "max");
        for pass in &self.passes {
            let _ = match &pass.off {
                Some(reason) => writeln!(out, "{:<18}{:>10}  ({reason})", pass.name, "–"),
                None => writeln!(
                    out,
                    "{:<18}{:>10.2}{:>10.2}{:>10.2}{:>10.2}",
                    pass.name, pass.median_ms, pass.p95_ms, pass.min_ms, pass.max_ms
                ),
            };
        }
        if let Some(upload) = self.tree.iter().find(|node| node.name == UPLOAD) {
            let _ = writeln!(out, "{UPLOAD:<18}{:>10.2}", upload.median_ms);
        }
        let f = &self.frame;
        let _ = writeln!(
            out,
            "{:<18}{:>10.2}{:>10.2}   passes and uploads cover {:.1} % of it",
            "frame, GPU",
            f.gpu_median_ms,
            f.gpu_p95_ms,
            100.0 * f.coverage
        );
        let beyond = 100.0 * f.beyond_gpu;
        let _ = writeln!(
            out,
            "{:<18}{:>10.2}{:>10.2}   {beyond:.1} % beyond the GPU's time, two frames in flight",
            "frame, wall", f.wall_median_ms, f.wall_p95_ms
        );
        let _ = writeln!(out, "device memory {:.0} MiB", self.memory.device_bytes as f64 / f64::from(1 << 20));
        out
    }

    /// The report with one line a pass: name, median, p95, min and max in milliseconds, and why the pass is
    /// off.
    pub fn csv(&self) -> String {
        let mut out = "pass,median_ms,p95_ms,min_ms,max_ms,off\n".to_owned();
        for p in &self.passes {
            let off = p.off.as_deref().unwrap_or("").replace('"', "'");
            if p.off.is_some() {
                let _ = writeln!(out, "{},,,,,\"{off}\"", p.name);
                continue;
            }
            let _ = writeln!(
                out,
                "{},{:.4},{:.4},{:.4},{:.4},\"{off}\"",
                p.name, p.median_ms, p.p95_ms, p.min_ms, p.max_ms
            );
        }
        let _ = writeln!(out, "frame,{:.4},{:.4},,,\"\"", self.frame.gpu_median_ms, self.frame.gpu_p95_ms);
        out
    }

    /// The trace JSON of Chrome and Perfetto. One track has the GPU's passes, another the wall times of the
    /// frames.
    pub fn trace(&self) -> serde_json::Value {
        let mut events = Vec::new();
        let mut event = |name: &str, track: u32, start_ms: f64, ms: f64| {
            events.push(serde_json::json!({ "name": name, "ph": "X", "pid": 1, "tid": track, "ts": start_ms * 1e3, "dur": ms * 1e3 }));
        };
        for (n, sample) in self.samples.iter().enumerate() {
            event(&format!("frame {n}"), 1, sample.began_ms, sample.wall_ms);
            // The queue's clock has another zero. A frame's passes are put where its GPU work must have been:
            // at its end.
            let offset = sample.began_ms + sample.wall_ms - sample.timings.gpu_ms;
            // A scope is one event from its first entry to its last, and a viewer shows its entries below.
            let mut scopes: Vec<(&str, f64, f64)> = Vec::new();
            for Entry { path, start_ms, ms } in &sample.timings.entries {
                let same = scopes.iter().zip(path.iter()).take_while(|((name, ..), other)| name == other).count();
                let same = same.min(path.len() - 1);
                scopes.drain(same..).for_each(|(name, start, end)| event(name, 2, offset + start, end - start));
                scopes.extend(path[same..path.len() - 1].iter().map(|name| (name.as_str(), *start_ms, *start_ms)));
                scopes.iter_mut().for_each(|(.., end)| *end = start_ms + ms);
                event(&path[path.len() - 1], 2, offset + start_ms, *ms);
            }
            scopes.drain(..).for_each(|(name, start, end)| event(name, 2, offset + start, end - start));
        }
        serde_json::json!({ "traceEvents": events, "displayTimeUnit": "ms" })
    }
}
