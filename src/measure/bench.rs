//! `bench`: per-pass GPU times from timestamp queries.

use crate::{
    Result,
    gpu::Timings,
    renderer::{Renderer, cost::PassPlan},
    scene::Scene,
};
use serde::Serialize;
use std::{collections::BTreeMap, fmt::Write, time::Instant};

/// Pass names in frame order.
pub const PASSES: [&str; 12] = [
    "radiance_pyramid",
    "normals",
    "depth_pyramid",
    "light_table",
    "relight",
    "gbuffer",
    "sampling_mask",
    "irradiance",
    "interpolate",
    "temporal",
    "atrous",
    "composite",
];

/// One pass over the measured frames that dispatched it, its dispatches summed.
#[derive(Clone, Debug, Serialize)]
pub struct PassTime {
    /// The pass.
    pub name: String,
    /// Milliseconds.
    pub median_ms: f64,
    /// Milliseconds; 95 % of frames are at most this.
    pub p95_ms: f64,
    /// Milliseconds.
    pub min_ms: f64,
    /// Milliseconds.
    pub max_ms: f64,
    /// Why it was not dispatched, where it was not.
    pub off: Option<String>,
}

/// Whole frames.
#[derive(Clone, Debug, Serialize)]
pub struct FrameTime {
    /// First timestamp to last, milliseconds.
    pub gpu_median_ms: f64,
    /// The same, 95th percentile.
    pub gpu_p95_ms: f64,
    /// With recording, uploads and waiting, milliseconds.
    pub wall_median_ms: f64,
    /// The same, 95th percentile.
    pub wall_p95_ms: f64,
    /// Median over frames of the passes' share in the GPU's frame time.
    pub coverage: f64,
}

/// Device memory.
#[derive(Clone, Debug, Serialize)]
pub struct Memory {
    /// Bytes allocated while measuring.
    pub device_bytes: u64,
}

/// What `bench --json` writes.
#[derive(Clone, Debug, Serialize)]
pub struct Report {
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
    /// Frames measured.
    pub frames: u32,
    /// Frames run before.
    pub warmup: u32,
    /// All settings, as the plan left them.
    pub settings: BTreeMap<String, String>,
    /// In frame order.
    pub passes: Vec<PassTime>,
    /// Whole frames.
    pub frame: FrameTime,
    /// Device memory.
    pub memory: Memory,
    /// The plan in a line.
    #[serde(skip)]
    pub plan: String,
    #[serde(skip)]
    samples: Vec<Sample>,
}

/// One frame: its timings and its wall time, with when it began.
#[derive(Clone, Debug)]
struct Sample {
    timings: Timings,
    began_ms: f64,
    wall_ms: f64,
}

/// Renders `warmup` frames at the first frame's time, then `frames` more from there, and measures those. `progress` is called
/// after each.
pub fn run(
    renderer: &mut Renderer,
    scene: &Scene,
    first: u32,
    frames: u32,
    warmup: u32,
    mut progress: impl FnMut(),
) -> Result<Report> {
    for _ in 0..warmup {
        renderer.render(scene, scene.panorama.frame_time(first as usize))?;
        progress();
    }
    let start = Instant::now();
    let mut samples = Vec::new();
    for n in 0..frames {
        let began = start.elapsed();
        let timings = renderer.render(scene, scene.panorama.frame_time((first + n) as usize))?;
        let wall = start.elapsed() - began;
        samples.push(Sample { timings, began_ms: began.as_secs_f64() * 1e3, wall_ms: wall.as_secs_f64() * 1e3 });
        progress();
    }
    let gpu = renderer.gpu();
    let options = renderer.options();
    let plan = renderer.plan().passes();
    let passes = PASSES.iter().map(|name| pass_time(name, &samples, &plan, renderer)).collect();
    let mut gpu_ms: Vec<f64> = samples.iter().map(|s| s.timings.gpu_ms).collect();
    let mut wall_ms: Vec<f64> = samples.iter().map(|s| s.wall_ms).collect();
    let share = |s: &Sample| s.timings.entries.iter().map(|(_, ms)| ms).sum::<f64>() / s.timings.gpu_ms.max(1e-9);
    let mut coverage: Vec<f64> = samples.iter().map(share).collect();
    Ok(Report {
        device: gpu.device_name().to_owned(),
        driver: gpu.driver().to_owned(),
        scene: scene.name.clone(),
        method: options.method.name(),
        size: options.size,
        frames,
        warmup,
        settings: renderer.plan().settings.values().into_iter().map(|(name, value)| (name.to_owned(), value)).collect(),
        passes,
        frame: FrameTime {
            gpu_median_ms: quantile(&mut gpu_ms, 0.5),
            gpu_p95_ms: quantile(&mut gpu_ms, 0.95),
            wall_median_ms: quantile(&mut wall_ms, 0.5),
            wall_p95_ms: quantile(&mut wall_ms, 0.95),
            coverage: quantile(&mut coverage, 0.5),
        },
        memory: Memory { device_bytes: gpu.device_bytes() },
        plan: renderer.plan().summary(),
        samples,
    })
}

fn pass_time(name: &str, samples: &[Sample], plan: &[PassPlan], renderer: &Renderer) -> PassTime {
    let total = |timings: &Timings| -> Option<f64> {
        let mut times = timings.entries.iter().filter(|(n, _)| n == name).map(|(_, ms)| *ms).peekable();
        times.peek()?;
        Some(times.sum())
    };
    let mut times: Vec<f64> = samples.iter().filter_map(|s| total(&s.timings)).collect();
    if times.is_empty() {
        let off = match total(renderer.prepared()) {
            Some(ms) => format!("the video frame did not change; done once before, {ms:.1} ms"),
            None => {
                let pass = plan.iter().find(|pass| pass.name == name);
                pass.and_then(|pass| pass.off.clone())
                    .unwrap_or_else(|| "not dispatched in the frames measured".to_owned())
            }
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

/// Sorts, and interpolates between the two nearest ranks; 0 for nothing.
pub(crate) fn quantile(values: &mut [f64], q: f64) -> f64 {
    values.sort_by(f64::total_cmp);
    let Some(last) = values.len().checked_sub(1) else { return 0.0 };
    let place = q * last as f64;
    let (low, high) = (place.floor() as usize, place.ceil() as usize);
    values[low] + (values[high] - values[low]) * (place - place.floor())
}

impl Report {
    /// For people.
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
        let f = &self.frame;
        let _ = writeln!(
            out,
            "{:<18}{:>10.2}{:>10.2}   passes cover {:.1} % of it",
            "frame, GPU",
            f.gpu_median_ms,
            f.gpu_p95_ms,
            100.0 * f.coverage
        );
        let _ = writeln!(out, "{:<18}{:>10.2}{:>10.2}", "frame, wall", f.wall_median_ms, f.wall_p95_ms);
        let _ = writeln!(out, "device memory {:.0} MiB", self.memory.device_bytes as f64 / f64::from(1 << 20));
        out
    }

    /// One line a pass: name, median, p95, min, max (ms), and why it is off.
    pub fn csv(&self) -> String {
        let mut out = "pass,median_ms,p95_ms,min_ms,max_ms,off\n".to_owned();
        for p in &self.passes {
            let off = p.off.as_deref().unwrap_or("").replace('"', "'");
            let _ = writeln!(
                out,
                "{},{:.4},{:.4},{:.4},{:.4},\"{off}\"",
                p.name, p.median_ms, p.p95_ms, p.min_ms, p.max_ms
            );
        }
        let _ = writeln!(out, "frame,{:.4},{:.4},,,\"\"", self.frame.gpu_median_ms, self.frame.gpu_p95_ms);
        out
    }

    /// Chrome's and Perfetto's trace JSON: the GPU's passes and the frames' wall time, one track each.
    pub fn trace(&self) -> serde_json::Value {
        let mut events = Vec::new();
        let mut event = |name: &str, track: u32, start_ms: f64, ms: f64| {
            events.push(serde_json::json!({ "name": name, "ph": "X", "pid": 1, "tid": track, "ts": start_ms * 1e3, "dur": ms * 1e3 }));
        };
        for (n, sample) in self.samples.iter().enumerate() {
            event(&format!("frame {n}"), 1, sample.began_ms, sample.wall_ms);
            // the queue's clock has another zero: a frame's passes are laid where its GPU work must have been, at its end
            let offset = sample.began_ms + (sample.wall_ms - sample.timings.gpu_ms).max(0.0);
            for ((name, ms), start) in sample.timings.entries.iter().zip(&sample.timings.starts_ms) {
                event(name, 2, offset + start, *ms);
            }
        }
        serde_json::json!({ "traceEvents": events, "displayTimeUnit": "ms" })
    }
}

#[cfg(test)]
mod tests {
    use super::quantile;

    #[test]
    fn quantiles_of_known_values() {
        assert_eq!(quantile(&mut [3.0, 1.0, 2.0], 0.5), 2.0);
        assert_eq!(quantile(&mut [4.0, 1.0, 2.0, 3.0], 0.5), 2.5);
        assert_eq!(quantile(&mut [], 0.5), 0.0);
    }
}
