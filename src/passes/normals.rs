//! `normals`, once per video frame: plane fits through the depth that respect holes and edges. Depth that
//! came as integer codes moves onto its plane, within one step of the codes.

use super::{
    panorama::Panorama,
    resources::{Kernel, Resources},
};
use crate::{
    Result,
    gpu::{Bind, Frame, Gpu, Threads},
    gpu_struct,
    panorama::depth::Quantisation,
    shaders,
};

/// Wide fits overlap, so planes are fitted at most this many texels apart.
const MOST_SPACING: u32 = 3;

gpu_struct! {
    /// Push constants of `plane_fit.comp` and `normals.comp`.
    pub struct NormalsPush {
        pub radius: i32,
        pub stride: i32,
        pub spacing: i32,
        pub step_disparity: f32,
        pub step_radial: f32,
        pub relative: f32,
        pub first_turn: [f32; 2],
        pub turn: [f32; 2],
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

    /// Records both dispatches. A `radius` of 0 chooses by the depth's quality: noisy codes need wide fits.
    pub fn record(
        &self,
        frame: &mut Frame,
        panorama: &Panorama,
        view: &Resources,
        quantisation: Quantisation,
        radius: u32,
    ) -> Result<()> {
        let [width, height] = panorama.depth_size;
        let (step_disparity, step_radial) = match quantisation {
            Quantisation::None => (0.0, 0.0),
            Quantisation::Disparity { step } => (step, 0.0),
            Quantisation::Radial { step } => (0.0, step),
        };
        let automatic = if quantisation == Quantisation::None { 1 } else { (width / 128).clamp(2, 24) };
        let radius = if radius == 0 { automatic } else { radius };
        let stride = radius.div_ceil(3); // at most 7×7 taps
        let turn = |texels: i32| {
            let (sin, cos) = (std::f64::consts::TAU * f64::from(texels) / f64::from(width)).sin_cos();
            [sin as f32, cos as f32]
        };
        let spacing = (radius / 3).clamp(1, MOST_SPACING);
        let push = NormalsPush {
            radius: radius as i32,
            stride: stride as i32,
            spacing: spacing as i32,
            step_disparity,
            step_radial,
            relative: 0.005,
            first_turn: turn(-(radius as i32)),
            turn: turn(stride as i32),
        };
        let special = [("in_depth", Bind::from(panorama.raw_depth()?))];
        let fits = Threads::Size([width.div_ceil(spacing), height.div_ceil(spacing), 1]);
        let pools = [&panorama.resources, view];
        frame.scope("normals", |frame| {
            self.plane_fit.dispatch(frame, &special, &pools, &push, fits)?;
            frame.barrier("normals chooses among the planes fitted");
            self.select.dispatch(frame, &special, &pools, &push, Threads::Size([width, height, 1]))
        })
    }
}
