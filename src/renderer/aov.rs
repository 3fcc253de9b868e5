//! Reads back the picture, its error, and any other image of a frame by name.

use super::{Renderer, filtered, mattes::MATTES};
use crate::{
    Error, Result,
    gpu::Image,
    passes::{
        atrous::Atrous,
        display::{Source, Values},
        geometry,
        resources::Resource,
        unknown::Unknown,
        view::{REAL, VIRTUAL, is_color, is_packed, of_surfaces},
    },
    plan::Part,
};
use half::{bf16, f16};

/// What the two lights are that an image packs, by surface: E_R and ΔE of real ones, the Lambert lobe and all others of
/// virtual ones.
const LIGHTS: [(&str, u32, Values); 4] = [
    ("without_objects_real", REAL, Values::A),
    ("change_real", REAL, Values::B),
    ("diffuse_virtual", VIRTUAL, Values::A),
    ("rest_virtual", VIRTUAL, Values::B),
];

impl Renderer {
    /// The picture as linear radiance, RGBA, row 0 at the top.
    pub fn picture(&self) -> Result<Vec<[f32; 4]>> {
        self.aov("radiance")
    }

    /// The standard error of the accumulated irradiance: √(mean variance of a pixel's mean) / (mean
    /// luminance), over all real and virtual surfaces. 0 if nothing is accumulated.
    pub fn standard_error(&self) -> Result<f64> {
        let (mut variance, mut mean) = (0.0, 0.0);
        let image = |name| self.picture.resources.image(name);
        let Some(frames) = image("frames") else { return Ok(0.0) };
        for &layer in self.picture.role.layers(&self.plan) {
            let scales = self.light_scales(layer).map(f64::from);
            let brief = Atrous::in_brief(&self.plan, "accumulated");
            let texels = self.read_light(self.picture.light("accumulated", layer)?, layer, brief)?;
            let frames = self.gpu.read_image(frames, self.picture.layer("frames", layer))?;
            for (texel, frames) in texels.into_iter().zip(frames) {
                for lobe in 0..2 {
                    let (deviation, frames) = (f64::from(texel[6 + lobe]), f64::from(frames[lobe]));
                    if deviation < 0.0 || frames <= 0.0 {
                        continue;
                    }
                    let [r, g, b] = std::array::from_fn(|i| f64::from(texel[3 * lobe + i]));
                    // The filter takes a sequence for better than chance (`of_mean` in temporal.comp).
                    variance += (deviation * scales[lobe]).powi(2) * frames.max(1.0).powf(0.25);
                    mean += (0.2126 * r + 0.7152 * g + 0.0722 * b).abs() * scales[lobe];
                }
            }
        }
        let pixels = f64::from(self.options.size[0]) * f64::from(self.options.size[1]);
        Ok(if mean > 0.0 { (variance / pixels).sqrt() / (mean / pixels) } else { 0.0 })
    }

    /// The names of all images that [`Renderer::aov`] returns.
    pub fn aov_names(&self) -> Vec<String> {
        let derived = DERIVED.iter().map(|(name, _)| (*name).to_owned());
        let held = derived.chain(self.stored().map(|(name, _)| name)).filter(|name| self.place(name).is_ok());
        held.chain(self.knows_unknown_light().then(|| UNKNOWN_LIGHT.to_owned())).collect()
    }

    /// The names of what the images of the view hold: an image, one of its layers, or one of the two lights
    /// that are packed in it.
    fn stored(&self) -> impl Iterator<Item = (String, (&'static str, u32, Values))> {
        let images = self.picture.resources.0.iter().filter(|(_, resource)| !matches!(resource, Resource::Buffer(_)));
        let geometry = GEOMETRY.iter().flat_map(|&(name, values)| {
            [("real", REAL), ("virtual", VIRTUAL)]
                .map(|(suffix, layer)| (format!("{name}_{suffix}"), ("guide", layer, values)))
        });
        // other images say what these hold, in other words
        let own = images.filter(|(name, _)| !["guide", "past", "motion", "a", "b"].contains(name));
        let own = own.flat_map(|&(name, _)| match () {
            () if is_packed(name) => LIGHTS
                .iter()
                .map(|&(light, layer, values)| (format!("{name}_{light}"), (name, layer, values)))
                .collect::<Vec<_>>(),
            () => {
                let values = if is_color(name) { Values::Color } else { Values::Floats };
                let layers: &[_] =
                    if of_surfaces(name) { &[("_real", REAL), ("_virtual", VIRTUAL)] } else { &[("", 0)] };
                layers.iter().map(|(suffix, layer)| (format!("{name}{suffix}"), (name, *layer, values))).collect()
            }
        });
        geometry.chain(own)
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
        self.place(name).map(|_| ())
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
        let mut texels = self.texels(&self.source(name)?)?;
        if ["motion", "position"].contains(&name) && self.plan.on(Part::VirtualSurfaces) {
            let objects = self.texels(&self.source(&format!("{name}_virtual"))?)?;
            let coverage: Vec<[f32; 4]> = self.gpu.read_image(self.picture.image("real_coverage")?, 0)?;
            for ((seen, object), [real, ..]) in texels.iter_mut().zip(objects).zip(coverage) {
                if real < 0.5 {
                    *seen = object;
                }
            }
        }
        Ok(texels)
    }

    pub(super) fn texels(&self, source: &Source) -> Result<Vec<[f32; 4]>> {
        let Source { ref image, layer, values, brief, scales: [a, b] } = *source;
        let light = |texel: [f32; 8]| {
            let rgb: [f32; 3] = std::array::from_fn(|i| match values {
                Values::A => a * texel[i],
                Values::B => b * texel[3 + i],
                _ => a * texel[i] + b * texel[3 + i],
            });
            [rgb[0], rgb[1], rgb[2], 1.0]
        };
        if values == Values::Floats {
            return self.gpu.read_image(image, layer);
        }
        if values == Values::Color {
            return Ok(self.gpu.read_words(image, layer)?.into_iter().map(unpack_color).collect());
        }
        Ok(self.read_light(image, layer, brief)?.into_iter().map(light).collect())
    }

    /// a, b and their deviations, as `light_code.glsl` packs them in full or in brief.
    fn read_light(&self, image: &Image, layer: u32, brief: bool) -> Result<Vec<[f32; 8]>> {
        let number = |code| if brief { bf16::from_bits(code).to_f32() } else { f16::from_bits(code).to_f32() };
        Ok(self.gpu.read_pairs(image, layer)?.into_iter().map(|texel| texel.map(number)).collect())
    }

    /// The factors that turn a and b of a layer, as images hold them, into W/m² up to the capture's scale.
    fn light_scales(&self, layer: u32) -> [f32; 2] {
        let [real, change] = self.light_units().map(f32::recip);
        [if layer == REAL { real } else { change }, change]
    }

    /// Where the values of this name are.
    pub(super) fn source(&self, name: &str) -> Result<Source> {
        let (image, layer, values, held) = self.place(name)?;
        let (view, scene) = (&self.picture, &self.scene.resources);
        let brief = Atrous::in_brief(&self.plan, image);
        let scales = self.light_scales(layer);
        Ok(if values.is_geometry() {
            let image = geometry::unpack(&self.gpu, &self.plan, view, scene, layer, values)?;
            Source { image, layer: 0, values: Values::Floats, brief, scales }
        } else {
            Source { image: held.clone(), layer: view.layer(image, layer), values, brief, scales }
        })
    }

    /// The name and the layer of the image that holds the values of this name, and how it does.
    fn place(&self, name: &str) -> Result<(&'static str, u32, Values, &Image)> {
        let resources = &self.picture.resources;
        let left_out = |part: Part| {
            let problem = format!("\"{name}\" is left out: {}", self.plan.reason(part));
            let set = part.forced(true, self.options.method);
            let set: Vec<_> = set.iter().map(|(setting, value)| format!("--set {setting}={value}")).collect();
            Error::input("--aov", problem, format!("leave it out, or add {}", set.join(" ")))
        };
        let derived = DERIVED.iter().find(|(derived, _)| *derived == name).map(|(_, from)| match *from {
            Derived::Light(layer, values) => (filtered(&self.plan.settings), layer, values),
            Derived::Seen(layer, values) => ("guide", layer, values),
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
        if image == "irradiance" && self.plan.lends_irradiance() && self.plan.settings.atrous_levels > 1 {
            let problem = format!("\"{name}\" is gone: atrous has used its memory");
            return Err(Error::input("--aov", problem, "leave it out, or add --set atrous_levels=1"));
        }
        let lobe = layer == VIRTUAL && values == Values::B;
        if lobe && !self.plan.on(Part::Specular) {
            return Err(left_out(Part::Specular));
        }
        let found = if is_packed(image) { self.picture.light(image, layer).ok() } else { resources.image(image) };
        match found {
            Some(found) => Ok((image, layer, values, found)),
            None => Err(left_out(resources.absent(image).unwrap_or(Part::Objects))),
        }
    }
}

/// Does what `color_unpack` in `color_code.glsl` does.
fn unpack_color(code: u32) -> [f32; 4] {
    let part = |shift: u32| ((code >> shift) & 511) as f32 * ((code >> 27) as f32 - 24.0).exp2();
    [part(0), part(9), part(18), 1.0]
}

/// The image that is made when it is read.
pub const UNKNOWN_LIGHT: &str = "unknown_light";

/// What `geometry` makes of each layer.
const GEOMETRY: [(&str, Values); 3] =
    [("position", Values::Position), ("normal", Values::Normal), ("motion", Values::Motion)];

/// The source of a derived image: filtered light of a layer, or its surfaces. Of `motion` and `position` it is the real
/// layer, into which the virtual surfaces are put that cover more of a pixel.
enum Derived {
    Light(u32, Values),
    Seen(u32, Values),
}

/// Images that are computed when they are read.
const DERIVED: [(&str, Derived); 7] = [
    ("irradiance_real", Derived::Light(REAL, Values::A)),
    ("irradiance_mixed", Derived::Light(REAL, Values::Sum)),
    ("irradiance_virtual", Derived::Light(VIRTUAL, Values::A)),
    ("radiance_specular", Derived::Light(VIRTUAL, Values::B)),
    ("object_id", Derived::Seen(VIRTUAL, Values::Object)),
    ("motion", Derived::Seen(REAL, Values::Motion)),
    ("position", Derived::Seen(REAL, Values::Position)),
];

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn colours_in_a_word_are_unpacked() {
        let code = |[r, g, b]: [u32; 3], exponent: u32| r | g << 9 | b << 18 | exponent << 27;
        assert_eq!(unpack_color(code([256, 128, 64], 16)), [1.0, 0.5, 0.25, 1.0]);
        assert_eq!(unpack_color(code([0, 511, 1], 31)), [0.0, 65408.0, 128.0, 1.0]);
        assert_eq!(unpack_color(0), [0.0, 0.0, 0.0, 1.0]);
    }
}
