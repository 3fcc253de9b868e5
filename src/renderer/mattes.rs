//! Mattes for compositors: the picture taken apart so that plate · ratio + virtual puts it together again. The plate is
//! the picture without objects.

use super::Renderer;
use crate::{Result, plan::Part, settings::Relighting};
use glam::Vec3;

/// The names by which [`Renderer::aov`] returns them.
pub const MATTES: [&str; 2] = ["alpha", "ratio"];

impl Renderer {
    /// Returns the real share M of each pixel of the picture. It is 1 where no object is in view.
    ///
    /// # Errors
    /// Fails if the device is lost.
    pub fn real_coverage(&self) -> Result<Vec<f32>> {
        if !self.plan.on(Part::VirtualSurfaces) {
            let [width, height] = self.options.size;
            return Ok(vec![1.0; width as usize * height as usize]);
        }
        Ok(self.aov("real_coverage")?.iter().map(|texel| texel[0]).collect())
    }

    /// Returns a matte: `alpha` is the radiance of virtual surfaces, premultiplied by how much of a pixel they cover, with
    /// that as alpha. `ratio` is what is left of the plate: M·E_RV/E_R as the picture has it, 1 where nothing changes.
    ///
    /// # Errors
    /// Fails if the device is lost.
    pub(super) fn matte(&self, name: &str) -> Result<Vec<[f32; 4]>> {
        let picture = self.texels(&self.source("radiance")?)?;
        let plate = self.texels(&self.source("camera_radiance")?)?;
        let covered = self.plan.on(Part::VirtualSurfaces).then(|| self.aov("real_coverage")).transpose()?;
        let light = |name| self.plan.on(Part::Objects).then(|| self.aov(name)).transpose();
        let (before, after) = (light("irradiance_real")?, light("irradiance_mixed")?);
        let mattes = (0..picture.len()).map(|index| {
            let rgb = |texel: [f32; 4]| Vec3::new(texel[0], texel[1], texel[2]);
            let (picture, plate) = (rgb(picture[index]), rgb(plate[index]));
            let real = covered.as_ref().map_or(1.0, |covered| covered[index][0]);
            let part = |whole: Vec3| Vec3::select(plate.cmpne(Vec3::ZERO), whole / plate, Vec3::splat(real));
            let ratio = match (real, &before, &after) {
                (1.0.., ..) => part(picture),
                (..=0.0, ..) => Vec3::ZERO,
                (_, Some(before), Some(after)) => part(real * self.relit(plate, rgb(before[index]), rgb(after[index]))),
                _ => Vec3::splat(real),
            };
            match name {
                "ratio" => ratio.extend(1.0).to_array(),
                _ if real >= 1.0 => [0.0; 4],
                _ => (picture - plate * ratio).max(Vec3::ZERO).extend(1.0 - real).to_array(),
            }
        });
        Ok(mattes.collect())
    }

    /// What `relit.glsl` makes of a real surface.
    fn relit(&self, radiance: Vec3, before: Vec3, after: Vec3) -> Vec3 {
        let reflected = match self.plan.settings.relighting {
            Relighting::Ratio => radiance / before.max(Vec3::splat(1e-6)),
            _ => (radiance / before.max(Vec3::splat(1e-20))).min(Vec3::splat(std::f32::consts::FRAC_1_PI)),
        };
        (radiance + (after - before) * reflected).max(radiance.min(Vec3::ZERO))
    }
}
