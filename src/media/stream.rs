//! Frames for another program, on standard output: YUV4MPEG2, or the bare codes of a pixel format.

use super::{
    encode::{Codec, Container, Encoding, tags_for},
    film::{Look, Shot},
    format::{Format, Kind},
    pack::Packer,
    probe::VideoInfo,
};
use crate::{Error, Result};
use std::io::{self, ErrorKind, Write};

/// How codes are arranged.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Arrangement {
    /// YUV4MPEG2, whose header says what follows.
    Y4m,
    /// Plane after plane, nothing else.
    Planes,
    /// Red, green and blue of each pixel.
    Rgb,
}

/// A stream that was begun.
pub struct RawStream {
    encoding: Encoding,
    arrangement: Arrangement,
    begun: bool,
}

impl RawStream {
    /// Prepares a stream: YUV4MPEG2, or raw codes if a pixel format is named.
    ///
    /// # Errors
    /// Fails if the pixel format is not known.
    pub fn open(pix_fmt: Option<&str>, size: [u32; 2], rate: [u32; 2], source: Option<&VideoInfo>) -> Result<Self> {
        let (arrangement, name) = match pix_fmt {
            None => (Arrangement::Y4m, None),
            Some("rgb24") => (Arrangement::Rgb, Some("gbrp".to_owned())),
            Some("rgb48" | "rgb48le") => (Arrangement::Rgb, Some("gbrp16le".to_owned())),
            Some(name) => (Arrangement::Planes, Some(name.to_owned())),
        };
        let deep = source.is_some_and(|info| info.format.bits > 8);
        let usual = if deep { "yuv420p10le" } else { "yuv420p" };
        let format = Format::asked(name.as_deref().unwrap_or(usual))?;
        let tags = tags_for(format, source)?;
        // The codes are those of a lossless file; none is made.
        let encoding = Encoding {
            container: Container::Mkv,
            codec: Codec::Ffv1,
            crf: None,
            packer: Packer { size, format, tags },
            rate,
            mastering: None,
            content_light: None,
        };
        Ok(Self { encoding, arrangement, begun: false })
    }

    /// Writes a picture to standard output. Returns `false` if nobody reads any more.
    ///
    /// # Errors
    /// Fails if it cannot be written for another reason, as on a full disk.
    pub fn write(&mut self, shot: &Shot, look: &Look) -> Result<bool> {
        let bytes = self.encoding.frame(shot, look);
        let bytes = if self.arrangement == Arrangement::Rgb {
            interleaved(&bytes, self.encoding.packer.format.code_bytes())
        } else {
            bytes
        };
        let mut out = io::stdout().lock();
        let mut write = || -> io::Result<()> {
            if self.arrangement == Arrangement::Y4m && !self.begun {
                out.write_all(header(&self.encoding).as_bytes())?;
            }
            for _ in 0..shot.times {
                if self.arrangement == Arrangement::Y4m {
                    out.write_all(b"FRAME\n")?;
                }
                out.write_all(&bytes)?;
            }
            out.flush()
        };
        let written = write();
        self.begun = true;
        match written {
            Ok(()) => Ok(true),
            Err(error) if error.kind() == ErrorKind::BrokenPipe => Ok(false),
            Err(error) => Err(Error::input("standard output", error.kind(), "give it room, or another reader")),
        }
    }
}

/// Planes of green, blue and red as pixels of red, green and blue.
fn interleaved(planes: &[u8], code: usize) -> Vec<u8> {
    let count = planes.len() / (3 * code);
    let plane =
        |which: usize, index: usize| &planes[(which * count + index) * code..(which * count + index + 1) * code];
    (0..count).flat_map(|index| [2, 0, 1].into_iter().flat_map(move |which| plane(which, index)).copied()).collect()
}

fn header(encoding: &Encoding) -> String {
    let packer = &encoding.packer;
    let ([width, height], [rate, of]) = (packer.size, encoding.rate);
    let depth = if packer.format.bits > 8 { format!("p{}", packer.format.bits) } else { String::new() };
    let layout = match (packer.format.kind, packer.format.sub) {
        (Kind::Gray, _) => "mono",
        (_, [0, 0]) => "444",
        (_, [1, 0]) => "422",
        _ if packer.format.bits > 8 => "420",
        _ if packer.tags.siting.middle == [true, true] => "420jpeg",
        _ => "420mpeg2",
    };
    let range = if packer.tags.full_range { "FULL" } else { "LIMITED" };
    format!("YUV4MPEG2 W{width} H{height} F{rate}:{of} Ip A1:1 C{layout}{depth} XCOLORRANGE={range}\n")
}

#[cfg(test)]
mod tests {
    #[test]
    fn planes_become_pixels() {
        assert_eq!(super::interleaved(&[1, 2, 3, 4, 5, 6], 1), [5, 1, 3, 6, 2, 4]);
        assert_eq!(super::interleaved(&[1, 9, 3, 9, 5, 9], 2), [5, 9, 1, 9, 3, 9]);
    }
}
