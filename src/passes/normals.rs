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

gpu_struct! {
    /// Push constants of `plane_fit.comp` and `normals.comp`.
    pub struct NormalsPush {
        pub radius: i32,
        pub stride: i32,
        pub step_disparity: f32,
        pub step_radial: f32,
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
        let push = NormalsPush {
            radius: radius as i32,
            stride: radius.div_ceil(3) as i32, // at most 7×7 taps
            step_disparity,
            step_radial,
            relative: 0.005,
        };
        let special = [("in_depth", Bind::from(panorama.raw_depth()?))];
        let threads = || Threads::Size([width, height, 1]);
        let pools = [&panorama.resources, view];
        frame.scope("normals", |frame| {
            self.plane_fit.dispatch(frame, &special, &pools, &push, threads())?;
            frame.barrier("normals chooses among the planes fitted");
            self.select.dispatch(frame, &special, &pools, &push, threads())
        })
    }
}
