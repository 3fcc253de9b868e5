//! Reads buffers and images that a glTF file names: inside it, in data URIs, or in files beside it.

use super::File;
use crate::{Error, Result, image_file::read};
use image::{ImageFormat, ImageReader, Limits};
use std::{io::Cursor, path::PathBuf};

/// Reads all buffers. Each is at least as long as it says.
pub(super) fn buffers(file: &File, blob: Option<&[u8]>) -> Result<Vec<Vec<u8>>> {
    let mut buffers = Vec::new();
    for (index, buffer) in file.root.buffers.iter().enumerate() {
        let name = format!("buffer {index}");
        let bytes = match (&buffer.uri, blob) {
            (Some(uri), _) => fetch(file, uri, &name)?,
            (None, Some(blob)) if index == 0 => blob.to_vec(),
            (None, _) => return Err(file.broken(format!("{name} has neither URI nor binary chunk"))),
        };
        if (bytes.len() as u64) < buffer.byte_length.0 {
            let problem = format!("{name} says it has {} bytes, but there are {}", buffer.byte_length.0, bytes.len());
            return Err(file.broken(problem));
        }
        buffers.push(bytes);
    }
    Ok(buffers)
}

fn fetch(file: &File, uri: &str, name: &str) -> Result<Vec<u8>> {
    let shown = || read::one_line(&uri.chars().take(60).collect::<String>());
    if let Some(data) = uri.strip_prefix("data:") {
        let Some((_, encoded)) = data.split_once(";base64,") else {
            return Err(file.broken(format!("{name}: a data URI that is not base64")));
        };
        return base64::decode(encoded).map_err(|error| file.broken(format!("{name}: {error}")));
    }
    let decoded =
        urlencoding::decode(uri).map_err(|_| file.broken(format!("{name}: the URI {} is not text", shown())))?;
    let scheme = decoded.split_once(':').map(|(scheme, _)| scheme.to_owned());
    if scheme.is_some_and(|s| s.len() > 1 && s.chars().all(|c| c.is_ascii_alphanumeric() || "+-.".contains(c))) {
        let problem = format!("{name}: {} is not a file beside the glTF file", shown());
        return Err(Error::input(&file.subject, problem, "download it and name it by a relative path"));
    }
    let path = PathBuf::from(decoded.as_ref());
    if path.is_absolute() || decoded.is_empty() || decoded.contains('\0') {
        let problem = format!("{name}: \"{}\" is no relative path", shown());
        return Err(Error::input(&file.subject, problem, "name files by paths relative to the glTF file"));
    }
    read::read_bytes(&file.folder.join(path)).map_err(|error| match error {
        Error::Input { subject, problem, remedy } => {
            Error::input(&file.subject, format!("{name}: {}: {problem}", read::one_line(&subject)), remedy)
        }
        other => other,
    })
}

pub(super) fn image(file: &File, index: usize) -> Result<([u32; 2], Vec<[u8; 4]>)> {
    let name = format!("image {index}");
    let Some(image) = file.root.images.get(index) else {
        return Err(file.broken(format!("{name} does not exist")));
    };
    let bytes = match (&image.uri, image.buffer_view) {
        (Some(uri), _) => fetch(file, uri, &name)?,
        (None, Some(view)) => super::accessor::view(file, view.value(), &name)?.0.to_vec(),
        (None, None) => return Err(file.broken(format!("{name} has neither URI nor buffer view"))),
    };
    let damaged = |problem: String| file.broken(format!("{name} cannot be decoded: {problem}"));
    let format = match ::image::guess_format(&bytes) {
        Ok(format @ (ImageFormat::Png | ImageFormat::Jpeg)) => format,
        _ => return Err(damaged("it is neither PNG nor JPEG".into())),
    };
    let mut limits = Limits::default();
    limits.max_image_width = Some(16384);
    limits.max_image_height = Some(16384);
    limits.max_alloc = Some(1 << 31);
    let mut reader = ImageReader::with_format(Cursor::new(&bytes), format);
    reader.limits(limits);
    let decoded = reader.decode().map_err(|error| damaged(read::one_line(&error)))?.into_rgba8();
    let size = [decoded.width(), decoded.height()];
    if size.contains(&0) {
        return Err(damaged("it has no pixels".into()));
    }
    Ok((size, decoded.pixels().map(|pixel| pixel.0).collect()))
}
