//! Writes a renderer's picture as a file.

use crate::{
    Error, Result,
    image_file::{
        ExrLayer,
        tonemap::Tonemap,
        write::{display_code, write_display, write_exr, write_png},
    },
    renderer::{Renderer, mattes::MATTES},
    scene::Scene,
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

/// Writes the renderer's last picture. Exposure and tone mapping are those of a PNG.
pub fn write(
    renderer: &Renderer,
    scene: &Scene,
    path: &Path,
    kind: FileKind,
    (exposure, tonemap): (f32, Tonemap),
    aovs: &[String],
) -> Result<()> {
    let size = renderer.options().size;
    let mut picture = renderer.picture()?;
    let broken = picture.iter().filter(|texel| !texel.iter().all(|value| value.is_finite())).count();
    if broken > 0 {
        let (subject, all) = (path.display(), picture.len());
        warnings::tell(&[format!("{subject}: {broken} of {all} pixels are no finite numbers; report the scene")]);
    }
    if kind == FileKind::Png {
        // Saturated texels that were raised on loading come down again.
        for texel in &mut picture {
            let color = scene.panorama.for_display(Vec3::new(texel[0], texel[1], texel[2]));
            texel[..3].copy_from_slice(&tonemap.map(exposure * color).to_array());
        }
        return write_display(path, size, &picture, 1.0);
    }
    let mut layers = vec![ExrLayer::rgb("", size, &picture)];
    let every = || renderer.aov_names().into_iter().chain(MATTES.map(str::to_owned)).collect();
    let names = if aovs == ["all"] { every() } else { aovs.to_vec() };
    for name in names.iter().filter(|name| *name != "radiance") {
        let texels = renderer.aov(name)?;
        let channel = |i: usize| texels.iter().map(|t| t[i]).collect::<Vec<f32>>();
        let channels = ["R", "G", "B", "A"].iter().enumerate().map(|(i, c)| ((*c).to_owned(), channel(i))).collect();
        layers.push(ExrLayer { name: name.clone(), size, channels });
    }
    write_exr(path, &layers)
}

/// Writes the virtual surfaces of the renderer's last picture as a PNG with alpha, which is not premultiplied.
///
/// # Errors
/// Fails if the file cannot be written.
pub fn write_alpha(renderer: &Renderer, scene: &Scene, path: &Path, (exposure, tonemap): (f32, Tonemap)) -> Result<()> {
    let codes: Vec<u8> = renderer
        .aov("alpha")?
        .into_iter()
        .flat_map(|[r, g, b, alpha]| {
            let color = if alpha > 0.0 { Vec3::new(r, g, b) / alpha } else { Vec3::ZERO };
            let shown = tonemap.map(exposure * scene.panorama.for_display(color));
            let [r, g, b] = shown.to_array().map(display_code);
            [r, g, b, (alpha.clamp(0.0, 1.0) * 255.0).round() as u8]
        })
        .collect();
    write_png(path, renderer.options().size, &codes, 4)
}
