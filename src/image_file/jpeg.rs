//! Whether a JPEG is whole. Its decoder paints grey what is missing.

use std::io::{BufRead, ErrorKind, Read, Result};

/// The most pixels that a byte stands for: a block of 8×8 takes at least a bit in its first scan.
const MOST: u64 = 8 * 64;

/// What a JPEG holds of its pixels.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Extent {
    Whole,
    /// It ends before its end is marked.
    Cut,
    /// It is too short for its pixels, whatever they are.
    Bare,
}

/// Looks how far a file of some size goes.
pub(super) fn extent(mut reader: impl BufRead, [width, height]: [u32; 2]) -> Extent {
    let mut counted = Counted { inner: &mut reader, bytes: 0 };
    match to_end(&mut counted) {
        Ok(()) => Extent::Whole,
        Err(_) if u64::from(width) * u64::from(height) > counted.bytes.max(1).saturating_mul(MOST) => Extent::Bare,
        Err(_) => Extent::Cut,
    }
}

struct Counted<'a, R> {
    inner: &'a mut R,
    bytes: u64,
}

impl<R: BufRead> Counted<'_, R> {
    fn byte(&mut self) -> Result<u8> {
        let mut byte = [0];
        self.inner.read_exact(&mut byte)?;
        self.bytes += 1;
        Ok(byte[0])
    }

    fn skip(&mut self, count: u64) -> Result<()> {
        let skipped = std::io::copy(&mut self.inner.by_ref().take(count), &mut std::io::sink())?;
        self.bytes += skipped;
        if skipped == count { Ok(()) } else { Err(ErrorKind::UnexpectedEof.into()) }
    }

    /// Goes on behind the next marker, and returns it.
    fn marker(&mut self, passed: &mut Vec<u8>) -> Result<u8> {
        loop {
            passed.clear();
            self.bytes += self.inner.read_until(0xff, passed)? as u64;
            if passed.last() != Some(&0xff) {
                return Err(ErrorKind::UnexpectedEof.into());
            }
            let mut code = self.byte()?;
            while code == 0xff {
                code = self.byte()?;
            }
            // Among data, FF is written as FF 00, and D0 to D7 only part it.
            if !matches!(code, 0 | 1 | 0xd0..=0xd8) {
                return Ok(code);
            }
        }
    }
}

/// Goes through all segments, up to the mark of the end.
fn to_end(file: &mut Counted<impl BufRead>) -> Result<()> {
    let mut passed = Vec::new();
    while file.marker(&mut passed)? != 0xd9 {
        let length = u16::from_be_bytes([file.byte()?, file.byte()?]);
        file.skip(u64::from(length).saturating_sub(2))?;
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_is_missing_is_noticed() {
        let mut jpeg = Vec::new();
        let picture = image::RgbImage::from_fn(64, 32, |x, y| image::Rgb([x as u8 * 3, y as u8 * 7, 255 - x as u8]));
        picture.write_to(&mut std::io::Cursor::new(&mut jpeg), image::ImageFormat::Jpeg).expect("is written");
        assert_eq!(extent(&jpeg[..], [64, 32]), Extent::Whole);
        assert_eq!(extent([&jpeg[..], b"trailer"].concat().as_slice(), [64, 32]), Extent::Whole);
        for length in 2..jpeg.len() - 1 {
            assert_eq!(extent(&jpeg[..length], [8, 8]), Extent::Cut, "{length}");
        }
        assert_eq!(extent(&jpeg[..700], [16384, 8192]), Extent::Bare);
    }
}
