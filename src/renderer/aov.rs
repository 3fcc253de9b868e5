//! Reads back the picture, its error, and any other image of a frame by name.

use super::{Renderer, filtered, mattes::MATTES};
use crate::{
    Error, Result,
    passes::{
        display::{Source, Values},
        resources::Resource,
        unknown::Unknown,
        view::{REAL, VIRTUAL, is_packed, of_surfaces},
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
        let resources = &self.picture.resources;
        let Some(lengths) = resources.image("frames") else { return Ok(0.0) };
        for (channel, name) in ["a", "b"].iter().enumerate() {
            let Some(image) = resources.image(name) else { continue };
            for layer in [REAL, VIRTUAL].map(|layer| self.picture.layer(name, layer)) {
                if layer >= image.layers() {
                    continue;
                }
                let lengths = self.gpu.read_image(lengths, layer)?;
                for ([r, g, b, moment], frames) in self.gpu.read_image(image, layer)?.into_iter().zip(lengths) {
                    let luminance = f64::from(0.2126 * r + 0.7152 * g + 0.0722 * b);
                    let frames = f64::from(frames[channel]);
                    if frames > 0.0 {
                        variance += (f64::from(moment) - luminance * luminance).max(0.0) / frames.max(1.0);
                        mean += luminance.abs();
                    }
                }
            }
        }
        let pixels = f64::from(self.options.size[0]) * f64::from(self.options.size[1]);
        Ok(if mean > 0.0 { (variance / pixels).sqrt() / (mean / pixels) } else { 0.0 })
    }

    /// The names of all images that [`Renderer::aov`] returns.
    pub fn aov_names(&self) -> Vec<String> {
        let derived = DERIVED.iter().map(|(name, _)| (*name).to_owned());
        let held = derived.chain(self.stored().map(|(name, _)| name)).filter(|name| self.source(name).is_ok());
        held.chain(self.knows_unknown_light().then(|| UNKNOWN_LIGHT.to_owned())).collect()
    }

    /// The names of what the images of the view hold: an image, one of its layers, or one of the two lights
    /// that are packed in it.
    fn stored(&self) -> impl Iterator<Item = (String, (&'static str, u32, Values))> {
        let images = self.picture.resources.0.iter().filter(|(_, resource)| !matches!(resource, Resource::Buffer(_)));
        // `position` and `normal` say what `guide` packs
        images.filter(|(name, _)| *name != "guide").flat_map(|&(name, _)| {
            let lights: &[_] =
                if is_packed(name) { &[("_a", Values::A), ("_b", Values::B)] } else { &[("", Values::Floats)] };
            let layers: &[_] = if of_surfaces(name) { &[("_real", REAL), ("_virtual", VIRTUAL)] } else { &[("", 0)] };
            let named = |(light, values): (&str, Values), (suffix, layer): (&str, u32)| {
                (format!("{name}{light}{suffix}"), (name, layer, values))
            };
            lights.iter().flat_map(|light| layers.iter().map(|layer| named(*light, *layer))).collect::<Vec<_>>()
        })
    }

    /// The share of each pixel's light that comes out of space that the capture never saw, from the images of the
    /// last frame.
    fn unknown_light(&self) -> Result<Vec<[f32; 4]>> {
        let Some(frame) = self.video_frame else { return Err(Error::Internal("nothing was rendered yet".into())) };
        if !self.knows_unknown_light() {
            let problem = format!("\"{UNKNOWN_LIGHT}\" is not known: no rays meet real surfaces");
            return Err(Error::input("--aov", problem, "leave it out, or use a method whose rays do, and objects"));
        }
        let mut unknown = Unknown::new(&self.gpu, &self.panorama, &self.plan)?;
        let image = unknown.light(&self.gpu, &self.picture.resources, self.options.size, frame)?;
        Ok(self
            .gpu
            .read_image(&image, 0)?
            .into_iter()
            .map(|[share, ..]: [f32; 4]| [share, share, share, 1.0])
            .collect())
    }

    fn knows_unknown_light(&self) -> bool {
        self.plan.on(Part::Objects) && self.plan.boxes()
    }

    /// Checks that [`Renderer::aov`] returns an image of this name.
    ///
    /// # Errors
    /// Fails if nothing has that name, or if the plan leaves the image out. The error says why.
    pub fn require_aov(&self, name: &str) -> Result<()> {
        if MATTES.contains(&name) || (name == UNKNOWN_LIGHT && self.knows_unknown_light()) {
            return Ok(());
        }
        self.source(name).map(|_| ())
    }

    /// An image of the last frame by name, as RGBA. Besides the images of a view there are `irradiance_real`
    /// (E_R), `irradiance_mixed` (E_RV), `irradiance_virtual` (E of the Lambert lobe), `radiance_specular`,
    /// `object_id`, `motion` and `position` of the surface that covers more of the pixel, [`MATTES`] and
    /// [`UNKNOWN_LIGHT`].
    pub fn aov(&self, name: &str) -> Result<Vec<[f32; 4]>> {
        if name == UNKNOWN_LIGHT {
            return self.unknown_light();
        }
        if MATTES.contains(&name) {
            return self.matte(name);
        }
        let source = self.source(name)?;
        let mut texels = self.texels(&source)?;
        match name {
            "object_id" => texels.iter_mut().for_each(|t| *t = [t[3], t[3], t[3], 1.0]),
            "motion" | "position" if source.image.layers() > 1 => {
                let objects = self.gpu.read_image(source.image, VIRTUAL)?;
                let coverage: Vec<[f32; 4]> = self.gpu.read_image(self.picture.image("real_coverage")?, 0)?;
                for ((seen, object), [real, ..]) in texels.iter_mut().zip(objects).zip(coverage) {
                    if real < 0.5 {
                        *seen = object;
                    }
                }
            }
            _ => {}
        }
        Ok(texels)
    }

    pub(super) fn texels(&self, source: &Source) -> Result<Vec<[f32; 4]>> {
        let Source { image, layer, values, scales: [a, b], .. } = *source;
        let light = |texel: [f32; 8]| {
            let rgb: [f32; 3] = std::array::from_fn(|i| match values {
                Values::A => a * texel[i],
                Values::B => b * texel[3 + i],
                _ => a * texel[i] + b * texel[3 + i],
            });
            [rgb[0], rgb[1], rgb[2], 1.0]
        };
        if values == Values::Floats {
            let mut texels = self.gpu.read_image(image, layer)?;
            let is = |name| self.picture.resources.image(name).is_some_and(|named| named.same(image));
            if let Some(scale) = is("a").then_some(a).or_else(|| is("b").then_some(b)) {
                texels.iter_mut().for_each(|t| *t = [t[0] * scale, t[1] * scale, t[2] * scale, 1.0]);
            }
            return Ok(texels);
        }
        Ok(self.gpu.read_halves(image, layer)?.into_iter().map(light).collect())
    }

    /// The factors that turn a and b of a layer, as images hold them, into W/m² up to the capture's scale.
    fn light_scales(&self, layer: u32) -> [f32; 2] {
        let [real, change] = self.light_units().map(f32::recip);
        [if layer == REAL { real } else { change }, change]
    }

    /// Where the values of this name are.
    pub(super) fn source(&self, name: &str) -> Result<Source<'_>> {
        let resources = &self.picture.resources;
        let left_out = |part: Part| {
            let problem = format!("\"{name}\" is left out: {}", self.plan.reason(part));
            let set = part.forced(true, self.options.method);
            let set: Vec<_> = set.iter().map(|(setting, value)| format!("--set {setting}={value}")).collect();
            Error::input("--aov", problem, format!("leave it out, or add {}", set.join(" ")))
        };
        let derived = DERIVED.iter().find(|(derived, _)| *derived == name).map(|(_, from)| match *from {
            Derived::Light(layer, values) => (filtered(&self.plan.settings), layer, values),
            Derived::Id => ("motion", VIRTUAL, Values::Floats),
            Derived::Seen(image) => (image, REAL, Values::Floats),
        });
        let stored = || self.stored().find(|(stored, _)| stored == name).map(|(_, from)| from);
        let Some((image, layer, values)) = derived.or_else(stored) else {
            return Err(Error::input(
                "--aov",
                format!("there is no image \"{name}\""),
                format!("choose from all, {}, {}", MATTES.join(", "), self.aov_names().join(", ")),
            ));
        };
        if derived.is_some() && !self.plan.on(Part::Objects) {
            return Err(left_out(Part::Objects));
        }
        if layer == VIRTUAL && !self.plan.on(Part::VirtualSurfaces) {
            return Err(left_out(Part::VirtualSurfaces));
        }
        let lobe = layer == VIRTUAL && (values == Values::B || image == "b");
        if lobe && !self.plan.on(Part::Specular) {
            return Err(left_out(Part::Specular));
        }
        match resources.image(image) {
            Some(found) => Ok(Source {
                image: found,
                layer: self.picture.layer(image, layer),
                values,
                scales: self.light_scales(layer),
                channel: (name == "object_id").then_some(3),
            }),
            None => Err(left_out(resources.absent(image).unwrap_or(Part::Objects))),
        }
    }
}

/// The image that is made when it is read.
pub const UNKNOWN_LIGHT: &str = "unknown_light";

/// The source of a derived image: filtered light of a layer, the ids, or the surface that covers more of a
/// pixel.
enum Derived {
    Light(u32, Values),
    Id,
    Seen(&'static str),
}

/// Images that are computed when they are read.
const DERIVED: [(&str, Derived); 7] = [
    ("irradiance_real", Derived::Light(REAL, Values::A)),
    ("irradiance_mixed", Derived::Light(REAL, Values::Sum)),
    ("irradiance_virtual", Derived::Light(VIRTUAL, Values::A)),
    ("radiance_specular", Derived::Light(VIRTUAL, Values::B)),
    ("object_id", Derived::Id),
    ("motion", Derived::Seen("motion")),
    ("position", Derived::Seen("position")),
];
