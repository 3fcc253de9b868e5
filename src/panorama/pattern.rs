//! Names of image sequences, as `%d`, `%04d` or `####`, and their numbers.

use crate::{Error, Result, image_file::write::folder_of};
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
    /// Reads a path. The file's name may hold one frame number as `%d`, `%0Nd` or `####`, and `%%` for a
    /// percent sign. A folder's name is taken as it is.
    ///
    /// # Errors
    /// Fails if there is another `%` or a second number.
    pub fn parse(path: &Path) -> Result<Self> {
        let bad = |problem: &str| {
            let remedy = "write one frame number as %04d or ####, and a percent sign as %%";
            Error::input(path.display(), problem, remedy)
        };
        let text = path.to_string_lossy();
        let (folder, mut rest) = text.split_at(text.rfind(std::path::is_separator).map_or(0, |at| at + 1));
        let mut pattern = Self { before: folder.to_owned(), after: String::new(), width: None };
        while let Some(at) = rest.find(['%', '#']) {
            pattern.push(&rest[..at]);
            let (sign, tail) = rest[at..].split_at(1);
            let hashes = 1 + tail.len() - tail.trim_start_matches('#').len();
            let digits = tail.find(|c: char| !c.is_ascii_digit()).unwrap_or(tail.len());
            let width = match (sign, tail[digits..].chars().next()) {
                ("#", _) if hashes == 1 => {
                    pattern.push("#");
                    rest = tail;
                    continue;
                }
                ("#", _) => {
                    rest = &tail[hashes - 1..];
                    Some(hashes)
                }
                (_, Some('%')) if digits == 0 => {
                    pattern.push("%");
                    rest = &tail[1..];
                    continue;
                }
                (_, Some('d')) => {
                    rest = &tail[digits + 1..];
                    if digits == 0 { Some(0) } else { tail[..digits].parse().ok() }
                }
                _ => return Err(bad("a % that is no frame number")),
            };
            if pattern.width.is_some() {
                return Err(bad("two frame numbers in one pattern"));
            }
            pattern.width = Some(width.filter(|width| *width <= 20).ok_or_else(|| bad("the number is too wide"))?);
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
        let folder = folder_of(&path);
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

/// A sequence with more missing frames than this for each that is there is numbered by something else.
const MAX_HELD: usize = 100;

/// Fills gaps between the numbers of a sequence, so that each frame keeps its time: in place of a frame that is
/// missing, the one before is held. Numbers that all lie equally far apart have no gaps.
pub(super) fn over_gaps(numbers: &[u32], pattern: &Pattern, warnings: &mut Vec<String>) -> Vec<u32> {
    let gcd = |mut a: u32, mut b: u32| {
        while b > 0 {
            (a, b) = (b, a % b);
        }
        a
    };
    let step = numbers.windows(2).fold(0, |step, pair| gcd(step, pair[1] - pair[0]));
    let (Some(first), Some(last)) = (numbers.first(), numbers.last()) else { return Vec::new() };
    let frames = (last - first).checked_div(step).map_or(1, |count| count as usize + 1);
    if frames == numbers.len() || frames > MAX_HELD * numbers.len() {
        return numbers.to_vec();
    }
    let mut held = Vec::with_capacity(frames);
    let mut missing = Vec::new();
    for number in (*first..=*last).step_by(step as usize) {
        let known = numbers.partition_point(|known| *known <= number);
        if numbers[known - 1] != number {
            missing.push(pattern.file(number).display().to_string());
        }
        held.push(numbers[known - 1]);
    }
    let (shown, more) =
        (missing.iter().take(8).cloned().collect::<Vec<_>>().join(", "), missing.len().saturating_sub(8));
    let more = if more > 0 { format!(" and {more} more") } else { String::new() };
    warnings.push(format!("{shown}{more}: missing in the sequence; the frame before is held, so that times are kept"));
    held
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
        assert_eq!(pattern("a/f.####.exr").expect("valid").file(60), Path::new("a/f.0060.exr"));
        assert_eq!(pattern("100% done/a#1/f%d.png").expect("valid").file(2), Path::new("100% done/a#1/f2.png"));
        for single in ["a/b.png", "50% %d/#%s/b#1.png"] {
            let parsed = pattern(single).expect("valid");
            assert!(!parsed.is_sequence() && parsed.file(3) == Path::new(single), "{single}");
        }
        for bad in ["%d_%d.png", "##_%d.png", "%s.png", "50%.png", "%", "%99999d.png"] {
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
