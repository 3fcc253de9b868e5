//! `normals`, once per video frame: plane fits through the depth that respect holes and edges. Depth that is noisy or
//! came as integer codes moves onto its plane, within one step of the codes or of the noise.

use super::{
    panorama::Panorama,
    resources::{Kernel, Resources},
};
use crate::{
    Result,
    gpu::{Bind, Frame, Gpu, Image, Threads},
    gpu_struct,
    panorama::depth::{Quality, Quantisation},
    shaders,
};

/// Wide fits overlap, so planes are fitted at most this many texels apart.
const MOST_SPACING: u32 = 3;

/// The radius of the fits of noisy depth, over its noise and its width. A normal is then off by some 3°.
const WINDOW: f32 = 0.76;

/// The step of noisy depth, standard deviations.
const DEVIATIONS: f32 = 3.0;

/// The share of noise that the first fits leave.
const LEFT: f32 = 0.3;

gpu_struct! {
    /// Push constants of `plane_fit.comp` and `normals.comp`.
    pub struct NormalsPush {
        pub radius: i32,
        pub stride: i32,
        pub spacing: i32,
        pub step_disparity: f32,
        pub step_radial: f32,
        pub noise: f32,
        pub relative: f32,
    }
}

pub struct Normals {
    plane_fit: Kernel,
    select: Kernel,
}

impl Normals {
    pub fn new(gpu: &Gpu) -> Result<Self> {
        Ok(Self {
            plane_fit: Kernel::new::<NormalsPush>(gpu, "plane_fit", shaders::PLANE_FIT, &[])?,
            select: Kernel::new::<NormalsPush>(gpu, "normals", shaders::NORMALS, &[])?,
        })
    }

    /// Records both dispatches. A `radius` of 0 chooses by the depth's quality: noise and codes need wide fits. Noisy
    /// depth is smoothed first, and fitted again.
    pub fn record(
        &self,
        frame: &mut Frame,
        panorama: &Panorama,
        view: &Resources,
        quality: Quality,
        radius: u32,
    ) -> Result<()> {
        let [given, depth] = [panorama.raw_depth()?, panorama.depth()?];
        let push = push(quality, panorama.depth_size[0], radius);
        frame.scope("normals", |frame| {
            if quality.noise > 0.0 {
                self.fit(frame, [depth, given], panorama, view, &push)?;
                frame.barrier("normals fits the smoothed depth");
            }
            let push = NormalsPush { noise: LEFT * push.noise, ..push };
            self.fit(frame, [given, depth], panorama, view, &push)
        })
    }

    /// Fits planes to the first image of depth, and writes normals and the second image.
    fn fit(
        &self,
        frame: &mut Frame,
        [given, depth]: [&Image; 2],
        panorama: &Panorama,
        view: &Resources,
        push: &NormalsPush,
    ) -> Result<()> {
        let [width, height] = panorama.depth_size;
        let special = [("in_depth", Bind::from(given)), ("out_depth", Bind::from(depth))];
        let fits = Threads::Size([width, height, 1].map(|side| side.div_ceil(push.spacing as u32)));
        let pools = [&panorama.resources, view];
        self.plane_fit.dispatch(frame, &special, &pools, push, fits)?;
        frame.barrier("normals chooses among the planes fitted");
        self.select.dispatch(frame, &special, &pools, push, Threads::Size([width, height, 1]))
    }
}

fn push(Quality { quantisation, noise }: Quality, width: u32, radius: u32) -> NormalsPush {
    let [step_disparity, step_radial] = quantisation.steps();
    let automatic = match quantisation {
        _ if noise > 0.0 => ((WINDOW * noise * width as f32) as u32).clamp(2, (width / 32).max(2)),
        Quantisation::None => 1,
        Quantisation::Disparity { .. } | Quantisation::Radial { .. } => (width / 128).clamp(2, 24),
    };
    let radius = if radius == 0 { automatic } else { radius };
    let stride = radius.div_ceil(3); // at most 7×7 taps
    NormalsPush {
        radius: radius as i32,
        stride: stride as i32,
        spacing: (radius / 3).clamp(1, MOST_SPACING) as i32,
        step_disparity,
        step_radial,
        noise: DEVIATIONS * noise,
        relative: 0.005,
    }
}
