//! Takes pictures apart that hold colour and depth, beside or over each other.

use super::source::Packing;
use crate::{
    Error, Result,
    image_file::{CodeImage, ColorImage, FileImage, Raster, Samples},
    media::planes::Part,
};

/// Returns the depth codes of an image that holds colour and depth, beside or over each other.
///
/// # Errors
/// Fails if the image is too small, or if its depth has no codes.
pub fn packed_codes(image: FileImage, beside: bool, subject: &str) -> Result<CodeImage> {
    let packing = if beside { Packing::LeftRight } else { Packing::TopBottom };
    Ok(unpack(image, packing, subject)?.1)
}

/// Returns the colour and the depth codes of such an image.
pub(super) fn unpack(image: FileImage, packing: Packing, subject: &str) -> Result<(ColorImage, CodeImage)> {
    let crop_image = |image: &FileImage, which: usize| -> Result<FileImage> {
        Ok(match image {
            FileImage::Raster(raster) => {
                let part = halves(raster.size, packing, subject)?[which];
                let (width, channels) = (raster.size[0], raster.channels);
                let samples = match &raster.samples {
                    Samples::U8(values) => Samples::U8(cut(values, width, channels, part)),
                    Samples::U16(values) => Samples::U16(cut(values, width, channels, part)),
                    Samples::F32(values) => Samples::F32(cut(values, width, channels, part)),
                };
                // A packed PNG usually comes from a video, so slightly coloured greys are expected.
                let (color, notes) = (raster.color.clone(), Vec::new());
                FileImage::Raster(Raster { size: part.size, channels, samples, lossy: true, color, notes })
            }
            FileImage::Exr(exr) => {
                let mut exr = exr.clone();
                for layer in &mut exr.layers {
                    let part = halves(layer.size, packing, subject)?[which];
                    for (_, values) in &mut layer.channels {
                        *values = cut(values, layer.size[0], 1, part);
                    }
                    layer.size = part.size;
                }
                FileImage::Exr(exr)
            }
        })
    };
    Ok((crop_image(&image, 0)?.into_color(subject)?, crop_image(&image, 1)?.into_codes(subject)?))
}

/// Returns where colour and depth are in a picture that holds both.
pub(super) fn halves(size: [u32; 2], packing: Packing, subject: &str) -> Result<[Part; 2]> {
    let [width, height] = size;
    let (half, from) = match packing {
        Packing::LeftRight => ([width / 2, height], [width - width / 2, 0]),
        _ => ([width, height / 2], [0, height - height / 2]),
    };
    if half.contains(&0) {
        let problem = format!("is {width}x{height}, too small to hold colour and depth");
        return Err(Error::input(subject, problem, "check packing"));
    }
    Ok([[0, 0], from].map(|from| Part { from, size: half }))
}

/// Returns a part of an image of this width.
fn cut<T: Copy>(values: &[T], width: u32, channels: usize, part: Part) -> Vec<T> {
    let row = |y: u32| {
        let start = (y as usize * width as usize + part.from[0] as usize) * channels;
        &values[start..start + part.size[0] as usize * channels]
    };
    (part.from[1]..part.from[1] + part.size[1]).flat_map(row).copied().collect()
}
