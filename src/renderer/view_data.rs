//! What every pass on a view is told: size, viewpoint, settings, and what has changed since the last frame.

use super::{
    Renderer,
    state::{FrameState, relight_viewpoint},
};
use crate::{
    Result,
    gpu::Frame,
    passes::{
        fault::planted,
        view::{View, ViewData},
    },
    plan::Facts,
    scene::viewpoint::Viewpoint,
    settings::{FOREVER, INFINITE},
};
use std::sync::atomic::{AtomicU32, Ordering};

impl Renderer {
    pub(super) fn upload_views(&self, frame: &mut Frame, state: &FrameState) -> Result<()> {
        let relight = relight_viewpoint(self.panorama.yaw_degrees);
        for (level, view) in (0..).zip(&self.relight) {
            let data = self.view_data(view, relight, level > 0, level + 1, state);
            frame.write_buffer(&view.data, 0, &[data])?;
        }
        let data = self.view_data(&self.picture, state.viewpoint, !self.relight.is_empty(), 0, state);
        frame.write_buffer(&self.picture.data, 0, &[data])
    }

    /// The data that every pass on a view reads. `relit` says whether its rays see a relit map,
    /// and `stream` chooses its random numbers.
    fn view_data(&self, view: &View, viewpoint: Viewpoint, relit: bool, stream: u32, state: &FrameState) -> ViewData {
        let settings = &self.plan.settings;
        let limit = |shortened: bool| match shortened {
            _ if planted!(self, HistoryKept) => FOREVER,
            true => settings.history_moving,
            false => settings.history,
        };
        let mut data = ViewData {
            size: view.size,
            frame: self.frame,
            seed: self.seed().wrapping_add(stream.wrapping_mul(0x9e37_79b9)),
            edge_ratio: settings.edge_ratio,
            thickness: settings.thickness,
            edge_depth: u32::from(settings.edge_depth),
            skirt_luminance: settings.skirt_luminance * self.plan.facts.luminance,
            instance_count: state.instances.instances.len() as u32,
            light_count: state.instances.lights.len() as u32,
            mover_count: state.movers.len() as u32,
            touching_count: state.touching.as_ref().map_or(0, Vec::len) as u32,
            new_video: u32::from(state.new_light && !planted!(self, HistoryKept)),
            bounces: settings.bounces,
            coverage_samples: settings.coverage_samples,
            rays_per_16: ((settings.rays_per_pixel * 16.0).round() as u32).clamp(1, 16),
            history_limit: limit(self.shortens(state)),
            history_limit_real: limit(state.new_light && self.shortens(state)),
            relit: u32::from(relit),
            relight_size: self.relight.first().map_or([1, 1], |map| map.size),
            light_units: self.light_units().into(),
            ..ViewData::default()
        };
        self.panorama.describe(&mut data);
        data.look(&viewpoint, &view.previous.unwrap_or(viewpoint));
        view.describe(&mut data, &state.shown_in(view));
        data
    }

    /// Whether all histories are shortened in a frame, and not only those whose light changes.
    pub(super) fn shortens(&self, state: &FrameState) -> bool {
        (state.new_light || !state.movers.is_empty()) && self.plan.settings.history_change >= INFINITE
    }

    /// The factors on light in images, where halves hold it: on E_R, and on
    /// what objects change or send. Objects may shine so brightly that halves would not hold that.
    pub(super) fn light_units(&self) -> [f32; 2] {
        const MOST: f32 = 1e6; // times the unit and π it is still a half
        let Facts { luminance, brightest, .. } = self.plan.facts;
        [unit(luminance), unit(luminance.max(brightest / MOST))]
    }

    fn seed(&self) -> u32 {
        static FRAMES: AtomicU32 = AtomicU32::new(0);
        if planted!(self, UnsteadySeed) { FRAMES.fetch_add(1, Ordering::Relaxed) } else { self.options.seed }
    }
}

/// The power of two that makes a number one between 1/64 and 1/32: halves are exact to a thousandth down to a
/// 250th of it, and reach four million times as far up, where single paths may be. Of 0 it is 1.
fn unit(number: f32) -> f32 {
    if number > 0.0 { (number.log2().floor().clamp(-60.0, 60.0) + 6.0).exp2().recip() } else { 1.0 }
}
