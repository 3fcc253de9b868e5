//! Decodes buffer views that are compressed by EXT_meshopt_compression, or by KHR_meshopt_compression, which is the
//! same with a newer bitstream and a filter for colours. What is decoded may be garbage if the file is, and is
//! checked by whoever reads it, as what stands in a buffer plainly is.

use super::{Fault, File, Read, accessor, fault, json::Json};
use crate::budget;
use meshopt::ffi;
use std::ffi::c_void;

/// The names of the extension.
pub(super) const EXTENSIONS: [&str; 2] = ["EXT_meshopt_compression", "KHR_meshopt_compression"];

/// Returns how a buffer view is compressed, if it is.
pub(super) fn of(view: Json) -> Option<Json> {
    EXTENSIONS.iter().map(|name| view.extension(name)).find(|extension| extension.exists())
}

/// Decodes the buffer view `index`, whose extension says `how`.
pub(super) fn decode(file: &File, index: usize, how: Json) -> Read<Vec<u8>> {
    let user = format!("buffer view {index}");
    let (encoded, _) = accessor::part(file, how, &user)?;
    let (Some(count), Some(stride)) = (how.index("count"), how.index("byteStride")) else {
        return Err(fault(format!("{user}: its meshopt compression has no count or stride")));
    };
    let mode = how.text("mode").unwrap_or_default();
    let filter = how.text("filter").unwrap_or("NONE");
    let fits = match mode {
        "ATTRIBUTES" => stride.is_multiple_of(4) && (4..=256).contains(&stride),
        "TRIANGLES" => count.is_multiple_of(3) && [2, 4].contains(&stride),
        "INDICES" => [2, 4].contains(&stride),
        _ => false,
    };
    let filter_fits = match filter {
        "NONE" => true,
        "OCTAHEDRAL" | "COLOR" => mode == "ATTRIBUTES" && [4, 8].contains(&stride),
        "QUATERNION" => mode == "ATTRIBUTES" && stride == 8,
        "EXPONENTIAL" => mode == "ATTRIBUTES",
        _ => false,
    };
    if !fits || !filter_fits {
        return Err(fault(format!("{user}: its meshopt mode, filter, count and stride do not fit each other")));
    }
    // As they come out, and as numbers.
    if let Some(problem) = budget::refusal((count as u64).saturating_mul(2 * stride as u64)) {
        return Err(Fault { problem: format!("{user}: {problem}"), remedy: budget::REMEDY.into() });
    }
    let mut bytes = vec![0_u8; count * stride];
    let (to, from, length) = (bytes.as_mut_ptr().cast::<c_void>(), encoded.as_ptr(), encoded.len());
    // SAFETY: `to` holds `count` elements of `stride` bytes, `from` holds `length` bytes, counts and strides are those
    // that the functions ask for, and they check what they read.
    let status = unsafe {
        match mode {
            "ATTRIBUTES" => ffi::meshopt_decodeVertexBuffer(to, count, stride, from, length),
            "TRIANGLES" => ffi::meshopt_decodeIndexBuffer(to, count, stride, from, length),
            _ => ffi::meshopt_decodeIndexSequence(to, count, stride, from, length),
        }
    };
    if status != 0 {
        return Err(fault(format!("{user}: its meshopt data is damaged")));
    }
    // SAFETY: as above. Filters change elements in place.
    unsafe {
        match filter {
            "OCTAHEDRAL" => ffi::meshopt_decodeFilterOct(to, count, stride),
            "COLOR" => ffi::meshopt_decodeFilterColor(to, count, stride),
            "QUATERNION" => ffi::meshopt_decodeFilterQuat(to, count, stride),
            "EXPONENTIAL" => ffi::meshopt_decodeFilterExp(to, count, stride),
            _ => {}
        }
    }
    Ok(bytes)
}
