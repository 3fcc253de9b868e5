//! Writes the picture of a renderer, or of one for each eye, as a file.

use crate::{
    Error, Result,
    image_file::{
        ExrLayer,
        tonemap::Tonemap,
        write::{Shown, display_code, write_exr_of, write_png_of},
    },
    renderer::{Renderer, mattes::MATTES},
    scene::{Scene, viewpoint::Projection},
    warnings,
};
use glam::Vec3;
use std::path::Path;

/// The kind of file that an output's name asks for.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum FileKind {
    /// 8-bit sRGB.
    Png,
    /// Linear float.
    Exr,
}

impl FileKind {
    /// Finds the kind by the file's extension.
    pub fn of(path: &Path) -> Result<Self> {
        match path.extension().and_then(|e| e.to_str()).map(str::to_lowercase).as_deref() {
            Some("png") => Ok(Self::Png),
            Some("exr") => Ok(Self::Exr),
            _ => Err(Error::input(path.display(), "is neither .png nor .exr", "give one of these extensions")),
        }
    }
}

/// The size of a picture: that of one renderer, or of two eyes, one above the other.
pub fn size(eyes: &[Renderer]) -> [u32; 2] {
    let [width, height] = eyes.first().map_or([0; 2], |eye| eye.options().size);
    [width, height * eyes.len() as u32]
}

/// Says whether every eye sees all around.
pub fn shows_all(eyes: &[Renderer]) -> bool {
    eyes.iter().all(|eye| eye.options().projection == Projection::Equirect)
}

/// What viewers may take the picture for. None knows two eyes in an image.
fn shown(eyes: &[Renderer]) -> Shown {
    if shows_all(eyes) && eyes.len() == 1 { Shown::Around } else { Shown::Part }
}

/// An image of one renderer, or of two eyes, the first on top.
pub fn stacked(eyes: &[Renderer], image: impl Fn(&Renderer) -> Result<Vec<[f32; 4]>>) -> Result<Vec<[f32; 4]>> {
    Ok(eyes.iter().map(image).collect::<Result<Vec<_>>>()?.concat())
}

/// Writes the last picture of a renderer, or of two eyes. Exposure and tone mapping are those of a PNG.
pub fn write(
    eyes: &[Renderer],
    scene: &Scene,
    path: &Path,
    kind: FileKind,
    (exposure, tonemap): (f32, Tonemap),
    aovs: &[String],
) -> Result<()> {
    let size = size(eyes);
    let picture = stacked(eyes, Renderer::picture)?;
    let broken = picture.iter().filter(|texel| !texel.iter().all(|value| value.is_finite())).count();
    if broken > 0 {
        let (subject, all) = (path.display(), picture.len());
        warnings::tell(&[format!("{subject}: {broken} of {all} pixels are no finite numbers; report the scene")]);
    }
    if kind == FileKind::Png {
        // Saturated texels that were raised on loading come down again.
        let codes = picture.iter().flat_map(|texel| {
            let color = scene.panorama.for_display(Vec3::new(texel[0], texel[1], texel[2]));
            tonemap.map(exposure * color).to_array().map(display_code)
        });
        return write_png_of(path, size, &codes.collect::<Vec<_>>(), 3, shown(eyes));
    }
    let mut layers = vec![ExrLayer::rgb("", size, &picture)];
    let every = || {
        let of_eye = eyes.first().map(Renderer::aov_names).unwrap_or_default();
        of_eye.into_iter().chain(MATTES.map(str::to_owned)).collect()
    };
    let names = if aovs == ["all"] { every() } else { aovs.to_vec() };
    for name in names.iter().filter(|name| *name != "radiance") {
        let texels = stacked(eyes, |eye| eye.aov(name))?;
        let channel = |i: usize| texels.iter().map(|t| t[i]).collect::<Vec<f32>>();
        let channels = ["R", "G", "B", "A"].iter().enumerate().map(|(i, c)| ((*c).to_owned(), channel(i))).collect();
        layers.push(ExrLayer { name: name.clone(), size, channels });
    }
    write_exr_of(path, &layers, shown(eyes))
}

/// Writes the virtual surfaces of the last picture as a PNG with alpha, which is not premultiplied.
///
/// # Errors
/// Fails if the file cannot be written.
pub fn write_alpha(eyes: &[Renderer], scene: &Scene, path: &Path, (exposure, tonemap): (f32, Tonemap)) -> Result<()> {
    let codes: Vec<u8> = stacked(eyes, |eye| eye.aov("alpha"))?
        .into_iter()
        .flat_map(|[r, g, b, alpha]| {
            let color = if alpha > 0.0 { Vec3::new(r, g, b) / alpha } else { Vec3::ZERO };
            let shown = tonemap.map(exposure * scene.panorama.for_display(color));
            let [r, g, b] = shown.to_array().map(display_code);
            [r, g, b, (alpha.clamp(0.0, 1.0) * 255.0).round() as u8]
        })
        .collect();
    write_png_of(path, size(eyes), &codes, 4, shown(eyes))
}
