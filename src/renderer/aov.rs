//! Reads back the picture, its error, and any other image of a frame by name.

use super::{Renderer, filtered, filtered_names};
use crate::{
    Error, Result,
    gpu::Image,
    passes::{
        resources::Resource,
        view::{REAL, VIRTUAL, of_surfaces},
    },
    plan::Part,
};

impl Renderer {
    /// The picture as linear radiance, RGBA, row 0 at the top.
    pub fn picture(&self) -> Result<Vec<[f32; 4]>> {
        self.aov("radiance")
    }

    /// The standard error of the accumulated irradiance: √(mean variance of a pixel's mean) / (mean
    /// luminance), over all real and virtual surfaces. 0 if nothing is accumulated.
    pub fn standard_error(&self) -> Result<f64> {
        let (mut variance, mut mean) = (0.0, 0.0);
        for image in ["a", "b"].iter().filter_map(|name| self.picture.resources.image(name)) {
            for layer in 0..image.layers() {
                for [r, g, b, v] in self.gpu.read_image(image, layer)? {
                    variance += f64::from(v.max(0.0));
                    mean += f64::from(0.2126 * r + 0.7152 * g + 0.0722 * b).abs();
                }
            }
        }
        let pixels = f64::from(self.options.size[0]) * f64::from(self.options.size[1]);
        Ok(if mean > 0.0 { (variance / pixels).sqrt() / (mean / pixels) } else { 0.0 })
    }

    /// The names of all images that [`Renderer::aov`] returns.
    pub fn aov_names(&self) -> Vec<String> {
        let derived = DERIVED.iter().map(|(name, _)| (*name).to_owned());
        let images = self.picture.resources.0.iter().filter(|(_, resource)| !matches!(resource, Resource::Buffer(_)));
        let names = images.flat_map(|(name, _)| match of_surfaces(name) {
            true => LAYERS.map(|layer| format!("{name}_{layer}")).to_vec(),
            false => vec![(*name).to_owned()],
        });
        derived.chain(names).filter(|name| self.source(name).is_ok()).collect()
    }

    /// Checks that [`Renderer::aov`] returns an image of this name.
    ///
    /// # Errors
    /// Fails if nothing has that name, or if the plan leaves the image out. The error says why.
    pub fn require_aov(&self, name: &str) -> Result<()> {
        self.source(name).map(|_| ())
    }

    /// An image of the last frame by name, as RGBA. Besides the images of a view there are `irradiance_real`
    /// (E_R), `irradiance_mixed` (E_RV), `irradiance_virtual` (E of the Lambert lobe), `radiance_specular`,
    /// `object_id`, and `motion` and `position` of the surface that covers more of the pixel.
    pub fn aov(&self, name: &str) -> Result<Vec<[f32; 4]>> {
        let (image, layer) = self.source(name)?;
        let mut texels = self.gpu.read_image(image, layer)?;
        match name {
            "object_id" => texels.iter_mut().for_each(|t| *t = [t[3], t[3], t[3], 1.0]),
            "irradiance_mixed" => {
                let [_, change] = filtered(&self.picture, &self.plan.settings)?;
                for (t, c) in texels.iter_mut().zip(self.gpu.read_image(change, REAL)?) {
                    *t = [t[0] + c[0], t[1] + c[1], t[2] + c[2], 1.0];
                }
            }
            "motion" | "position" if image.layers() > 1 => {
                let objects = self.gpu.read_image(image, VIRTUAL)?;
                let coverage: Vec<[f32; 4]> = self.gpu.read_image(self.picture.image("real_coverage")?, 0)?;
                for ((seen, object), [real, ..]) in texels.iter_mut().zip(objects).zip(coverage) {
                    if real < 0.5 {
                        *seen = object;
                    }
                }
            }
            "motion" | "position" => {}
            _ if DERIVED.iter().any(|(derived, _)| *derived == name) => texels.iter_mut().for_each(|t| t[3] = 1.0),
            _ => {}
        }
        Ok(texels)
    }

    /// The image with the values of this name, and its layer.
    pub(super) fn source(&self, name: &str) -> Result<(&Image, u32)> {
        let resources = &self.picture.resources;
        let left_out = |part: Part| {
            let problem = format!("\"{name}\" is left out: {}", self.plan.reason(part));
            let set = part.forced(true, self.options.method);
            let set: Vec<_> = set.iter().map(|(setting, value)| format!("--set {setting}={value}")).collect();
            Error::input("--aov", problem, format!("leave it out, or add {}", set.join(" ")))
        };
        let layer = |image: &'static str, layer: u32| match resources.image(image) {
            Some(found) if layer < found.layers() => Ok((found, layer)),
            None => Err(left_out(resources.absent(image).unwrap_or(Part::Objects))),
            Some(_) if self.plan.on(Part::VirtualSurfaces) => Err(left_out(Part::Specular)),
            Some(_) => Err(left_out(Part::VirtualSurfaces)),
        };
        if let Some((_, from)) = DERIVED.iter().find(|(derived, _)| *derived == name) {
            let (at, b) = match from {
                Derived::A(at) => (*at, false),
                Derived::B(at) => (*at, true),
                Derived::Id => return layer("motion", VIRTUAL),
                Derived::Seen(image) => return layer(image, REAL),
            };
            if !self.plan.on(Part::Objects) {
                return Err(left_out(Part::Objects));
            }
            return layer(filtered_names(&self.plan.settings)[usize::from(b)], at);
        }
        for (known, _) in resources.0.iter().filter(|(_, resource)| !matches!(resource, Resource::Buffer(_))) {
            if !of_surfaces(known) {
                if *known == name {
                    return layer(known, 0);
                }
            } else if let Some(suffix) = name.strip_prefix(known).and_then(|rest| rest.strip_prefix('_'))
                && let Some(at) = LAYERS.iter().position(|layer| *layer == suffix)
            {
                return layer(known, at as u32);
            }
        }
        Err(Error::input(
            "--aov",
            format!("there is no image \"{name}\""),
            format!("choose from all, {}", self.aov_names().join(", ")),
        ))
    }
}

/// The source of a derived image: a layer of a or b, the ids, or the surface that covers more of a pixel.
enum Derived {
    A(u32),
    B(u32),
    Id,
    Seen(&'static str),
}

/// Images that are computed when they are read.
const DERIVED: [(&str, Derived); 7] = [
    ("irradiance_real", Derived::A(REAL)),
    ("irradiance_mixed", Derived::A(REAL)),
    ("irradiance_virtual", Derived::A(VIRTUAL)),
    ("radiance_specular", Derived::B(VIRTUAL)),
    ("object_id", Derived::Id),
    ("motion", Derived::Seen("motion")),
    ("position", Derived::Seen("position")),
];

/// The two layers of per-surface images.
const LAYERS: [&str; 2] = ["real", "virtual"];
