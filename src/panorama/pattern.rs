//! Names of image sequences, as `%d` or `%04d`.

use crate::{Error, Result};
use std::path::{Path, PathBuf};

/// A file name that holds a frame number, or the name of a single file.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Pattern {
    before: String,
    after: String,
    /// The zero-padded width; `None` if there is no number.
    width: Option<usize>,
}

impl Pattern {
    /// Reads a path. The file's name may hold one `%d` or `%0Nd`, and `%%` for a percent sign.
    ///
    /// # Errors
    /// Fails if there is another `%` or a second number.
    pub fn parse(path: &Path) -> Result<Self> {
        let text = path.to_string_lossy();
        let bad = |problem: &str| {
            Error::input(path.display(), problem, "write one frame number as %d or %04d, and a percent sign as %%")
        };
        let mut pattern = Self { before: String::new(), after: String::new(), width: None };
        let mut rest = text.as_ref();
        while let Some(at) = rest.find('%') {
            let (plain, tail) = (&rest[..at], &rest[at + 1..]);
            pattern.push(plain);
            let end = tail.find(|c: char| !c.is_ascii_digit()).unwrap_or(tail.len());
            rest = match (tail[end..].chars().next(), end) {
                (Some('%'), 0) => {
                    pattern.push("%");
                    &tail[1..]
                }
                (Some('d'), _) if pattern.width.is_some() => return Err(bad("two frame numbers in one pattern")),
                (Some('d'), _) => {
                    let width = if end == 0 { Ok(0) } else { tail[..end].parse() };
                    pattern.width = Some(width.ok().filter(|w| *w <= 20).ok_or_else(|| bad("the number is too wide"))?);
                    &tail[end + 1..]
                }
                _ => return Err(bad("a % that is no frame number")),
            };
        }
        pattern.push(rest);
        Ok(pattern)
    }

    fn push(&mut self, text: &str) {
        (if self.width.is_some() { &mut self.after } else { &mut self.before }).push_str(text);
    }

    /// Says whether the name holds a number.
    pub fn is_sequence(&self) -> bool {
        self.width.is_some()
    }

    /// Returns the file of frame `number`.
    pub fn file(&self, number: u32) -> PathBuf {
        match self.width {
            Some(width) => PathBuf::from(format!("{}{number:0width$}{}", self.before, self.after)),
            None => PathBuf::from(&self.before),
        }
    }

    /// Returns the numbers of the files that exist, in order.
    ///
    /// # Errors
    /// Fails if the folder cannot be read.
    pub fn existing(&self) -> Result<Vec<u32>> {
        let path = PathBuf::from(format!("{}%{}", self.before, self.after));
        let folder = path.parent().filter(|folder| !folder.as_os_str().is_empty()).unwrap_or(Path::new("."));
        let prefix = self.before.rsplit(['/', std::path::MAIN_SEPARATOR]).next().unwrap_or_default();
        let entries = std::fs::read_dir(folder)
            .map_err(|error| Error::input(folder.display(), error, "check the folder's name and permissions"))?;
        let mut numbers: Vec<u32> = entries
            .filter_map(|entry| {
                let name = entry.ok()?.file_name();
                let digits = name.to_str()?.strip_prefix(prefix)?.strip_suffix(self.after.as_str())?;
                let number: u32 = digits.parse().ok()?;
                let width = self.width?;
                (format!("{number:0width$}") == digits).then_some(number)
            })
            .collect();
        numbers.sort_unstable();
        Ok(numbers)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn numbers_are_filled_in() {
        let pattern = |text: &str| Pattern::parse(Path::new(text));
        assert_eq!(pattern("a/%04d_rgb.jpg").expect("valid").file(60), Path::new("a/0060_rgb.jpg"));
        assert_eq!(pattern("a/f%d.png").expect("valid").file(60), Path::new("a/f60.png"));
        assert_eq!(pattern("a/%3d%%.png").expect("valid").file(7), Path::new("a/007%.png"));
        assert!(!pattern("a/b.png").expect("valid").is_sequence());
        for bad in ["%d_%d.png", "%s.png", "50%.png", "%"] {
            assert!(pattern(bad).is_err(), "{bad}");
        }
    }

    #[test]
    fn existing_files_are_found_in_order() {
        let folder = tempfile::tempdir().expect("a folder");
        for name in ["f010.png", "f002.png", "f1.png", "f003.jpg", "g004.png"] {
            std::fs::write(folder.path().join(name), "").expect("written");
        }
        let pattern = Pattern::parse(&folder.path().join("f%03d.png")).expect("valid");
        assert_eq!(pattern.existing().expect("a folder"), [2, 10]);
    }
}
