//! Reads buffers and images that a glTF file names: inside it, in data URIs, or in files beside it.

use super::{Fault, File, Read, accessor, fault};
use crate::{Error, budget, image_file::read};
use base64::engine::{DecodePaddingMode, Engine as _, GeneralPurpose, GeneralPurposeConfig};
use image::{DynamicImage, GenericImageView as _, ImageDecoder as _, ImageError, ImageFormat, ImageReader, Limits};
use rayon::prelude::*;
use std::{io::Cursor, path::PathBuf};

/// Reads a buffer, which need not be as long as it says.
pub(super) fn buffer(file: &File, index: usize) -> Read<Vec<u8>> {
    let name = format!("buffer {index}");
    let buffer = file.root.entry("buffers", index);
    let bytes = match (buffer.text("uri"), file.blob) {
        (Some(uri), _) => fetch(file, uri, &name)?,
        (None, Some(blob)) if index == 0 => blob.to_vec(),
        (None, _) if !buffer.exists() => return Err(fault(format!("{name} does not exist"))),
        (None, _) => return Err(fault(format!("{name} has neither URI nor binary chunk"))),
    };
    let stated = buffer.index("byteLength").unwrap_or(0);
    if bytes.len() < stated {
        file.warn(&name, &format!("says it has {stated} bytes, but there are {}: these are read", bytes.len()));
    }
    Ok(bytes)
}

/// Returns what follows the scheme of a data URI.
fn data_of(uri: &str) -> Option<&str> {
    let (scheme, data) = uri.trim_start().split_once(':')?;
    scheme.eq_ignore_ascii_case("data").then_some(data)
}

fn fetch(file: &File, uri: &str, name: &str) -> Read<Vec<u8>> {
    let shown = || read::one_line(&uri.chars().take(60).collect::<String>());
    if let Some(data) = data_of(uri) {
        let (kind, text) = data.split_once(',').unwrap_or((data, ""));
        if !kind.trim_end().to_ascii_lowercase().ends_with(";base64") {
            return Ok(urlencoding::decode_binary(text.as_bytes()).into_owned());
        }
        // Exporters break lines, escape the letters that mean something in URIs, or take others for them, and some leave
        // the padding out.
        let text = urlencoding::decode_binary(text.as_bytes());
        let letter = |byte: &u8| match *byte {
            b'-' => b'+',
            b'_' => b'/',
            other => other,
        };
        let text: Vec<u8> = text.iter().filter(|byte| !byte.is_ascii_whitespace()).map(letter).collect();
        let config = GeneralPurposeConfig::new()
            .with_decode_allow_trailing_bits(true)
            .with_decode_padding_mode(DecodePaddingMode::Indifferent);
        return GeneralPurpose::new(&base64::alphabet::STANDARD, config)
            .decode(text)
            .map_err(|error| fault(format!("{name}: its data URI is not base64: {error}")));
    }
    let not_beside = |problem: String| Fault { problem, remedy: "name it by a path relative to the glTF file".into() };
    let Ok(decoded) = urlencoding::decode(uri) else {
        return Err(not_beside(format!("{name}: the URI {} is not text", shown())));
    };
    // A backslash separates folders on Windows, and nothing else is called so in a URI.
    let decoded = decoded.replace('\\', "/");
    let scheme = decoded.split_once(':').map(|(scheme, _)| scheme.to_owned());
    if scheme.is_some_and(|s| s.chars().all(|c| c.is_ascii_alphanumeric() || "+-.".contains(c))) {
        return Err(not_beside(format!("{name}: {} is not a file beside the glTF file", shown())));
    }
    let path = PathBuf::from(&decoded);
    if path.is_absolute() || decoded.is_empty() || decoded.contains('\0') {
        return Err(not_beside(format!("{name}: \"{}\" is no relative path", shown())));
    }
    // A name may hold a percent sign that was not escaped. Some have a query for the server that once gave them.
    let named = urlencoding::decode(uri.split(['?', '#']).next().unwrap_or_default()).unwrap_or_default();
    let names = [decoded.clone(), uri.to_owned(), named.replace('\\', "/")];
    let existing = names.iter().map(|name| file.folder.join(name)).find(|path| path.is_file());
    let path = existing.unwrap_or_else(|| file.folder.join(&decoded));
    read::read_bytes(&path).map_err(|error| match error {
        Error::Input { subject, problem, remedy } => {
            Fault { problem: format!("{name}: {}: {problem}", read::one_line(&subject)), remedy }
        }
        other => fault(format!("{name}: {}", read::one_line(&other))),
    })
}

/// Decodes an image to RGBA.
pub(super) fn image(file: &File, index: usize) -> Read<([u32; 2], Vec<[u8; 4]>)> {
    let name = format!("image {index}");
    let image = file.root.entry("images", index);
    let bytes = match (image.text("uri"), image.index("bufferView")) {
        (Some(uri), _) => fetch(file, uri, &name)?,
        (None, Some(view)) => accessor::view(file, view, &name)?.0.to_vec(),
        (None, None) => return Err(fault(format!("{name} does not exist, or has neither URI nor buffer view"))),
    };
    let damaged = |problem: String| fault(format!("{name} cannot be decoded: {problem}"));
    let format = match ::image::guess_format(&bytes) {
        Ok(format @ (ImageFormat::Png | ImageFormat::Jpeg | ImageFormat::WebP)) => format,
        _ => return Err(damaged("it is neither PNG, JPEG nor WebP".into())),
    };
    let mut limits = Limits::default();
    limits.max_image_width = Some(16384);
    limits.max_image_height = Some(16384);
    limits.max_alloc = Some(if format == ImageFormat::Png { read::MOST_OF_PROFILE } else { 1 << 31 });
    let mut reader = ImageReader::with_format(Cursor::new(&bytes), format);
    reader.limits(limits);
    let words = |error: ImageError| damaged(read::one_line(&error));
    let decoder = reader.into_decoder().map_err(words)?;
    let (width, height) = decoder.dimensions();
    let pixel = u64::from(decoder.color_type().bytes_per_pixel()) + 4;
    if let Some(problem) = budget::refusal(u64::from(width) * u64::from(height) * pixel) {
        return Err(Fault { problem: format!("{name}: {problem}"), remedy: budget::REMEDY.into() });
    }
    let decoded = DynamicImage::from_decoder(decoder).map_err(words)?;
    let mut shift = 0;
    while (width as usize >> shift) * (height as usize >> shift) > LARGEST {
        shift += 1;
    }
    if shift > 0 {
        let (size, texels) = reduced(&decoded, shift);
        file.warn(&name, &format!("{width}x{height} pixels are reduced to {}x{}", size[0], size[1]));
        return Ok((size, texels));
    }
    let decoded = decoded.into_rgba8();
    let size = [decoded.width(), decoded.height()];
    if size.contains(&0) {
        return Err(damaged("it has no pixels".into()));
    }
    Ok((size, decoded.into_raw().as_chunks::<4>().0.to_vec()))
}

/// The most texels of an image that is taken as it is. All textures together hold twice that.
const LARGEST: usize = 1 << 24;

/// Takes means over squares of `1 << shift` pixels, without holding the whole in another form.
fn reduced(image: &DynamicImage, shift: u32) -> ([u32; 2], Vec<[u8; 4]>) {
    let size = [(image.width() >> shift).max(1), (image.height() >> shift).max(1)];
    let texel = |index: u32| {
        let (x, y) = ((index % size[0]) << shift, (index / size[0]) << shift);
        let (right, below) = ((x + (1 << shift)).min(image.width()), (y + (1 << shift)).min(image.height()));
        let (mut sum, mut count) = ([0_u32; 4], 0);
        for (column, row) in (y..below).flat_map(|row| (x..right).map(move |column| (column, row))) {
            let pixel = image.get_pixel(column, row).0;
            sum = std::array::from_fn(|c| sum[c] + u32::from(pixel[c]));
            count += 1;
        }
        sum.map(|sum| ((sum + count / 2) / count.max(1)) as u8)
    };
    (size, (0..size[0] * size[1]).into_par_iter().map(texel).collect())
}
