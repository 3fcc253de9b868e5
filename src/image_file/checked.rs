//! Files of data that show when they are damaged. A first line names the kind of file. The content's hash and
//! the content follow.

use super::{read::read_bytes, write::write_bytes};
use crate::Result;
use std::path::Path;

/// Writes a file with this first line and content.
///
/// # Errors
/// Fails if the file cannot be written.
pub fn write_checked(path: &Path, first_line: &[u8], content: &[u8]) -> Result<()> {
    write_bytes(path, &[first_line, blake3::hash(content).as_bytes(), content].concat())
}

/// Reads the content of a file. The result is `None` if the file is damaged or has another first line.
///
/// # Errors
/// Fails if the file cannot be read.
pub fn read_checked(path: &Path, first_line: &[u8]) -> Result<Option<Vec<u8>>> {
    let bytes = read_bytes(path)?;
    let parts = bytes.strip_prefix(first_line).and_then(|rest| rest.split_first_chunk::<32>());
    Ok(parts.filter(|(hash, content)| blake3::hash(content) == **hash).map(|(_, content)| content.to_vec()))
}
