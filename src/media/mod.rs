//! Video files, by the programs `ffmpeg` and `ffprobe`, which are run as children and write to pipes.
//!
//! They are not linked: so any version of them serves, hardware decoders and licences stay its own matter, and a
//! damaged file cannot take this program with it. A pipe costs half of the decoding again: 700 frames of
//! 2160×2160 took 6.4 s to decode, and 9.6 s with a reader at the end of a pipe, on two busy cores.

pub mod decode;
pub mod encode;
pub mod film;
pub mod format;
pub mod pack;
pub mod planes;
pub mod probe;
pub mod rate;
pub mod spherical;
pub mod stream;
pub mod tool;

pub use decode::Decoder;
pub use probe::VideoInfo;

use std::{io::Read, path::Path};

/// Says whether a file is a video, by its first bytes or, where they do not tell, by its name. Sequences and files that
/// do not exist are told by their names alone.
pub fn is_video(path: &Path) -> bool {
    let mut first = [0_u8; 16];
    // A pipe would be waited for, and what is read of it is gone.
    let is_file = path.metadata().is_ok_and(|metadata| metadata.is_file());
    let mut open = || std::fs::File::open(path).and_then(|mut file| file.read(&mut first));
    let read = if is_file { open().unwrap_or(0) } else { 0 };
    has_video_bytes(&first[..read]) || (has_video_name(path) && !is_image(&first[..read]))
}

/// Says what an AVIF asks for that `ffmpeg` does not do, by the boxes before its pixels.
fn not_done(path: &Path) -> Option<&'static str> {
    let mut first = Vec::new();
    std::fs::File::open(path).ok()?.take(4096).read_to_end(&mut first).ok()?;
    let has = |name: &[u8]| first.windows(4).take_while(|word| *word != b"mdat").any(|word| word == name);
    match first.get(8..12)? {
        b"avif" | b"avis" if has(b"irot") || has(b"imir") => Some("asks to be turned or mirrored, which is not done"),
        b"avif" | b"avis" if has(b"grid") => Some("is made of tiles, which are not put together"),
        _ => None,
    }
}

fn has_video_name(path: &Path) -> bool {
    const NAMES: [&str; 26] = [
        "mp4", "mov", "m4v", "mkv", "webm", "avi", "ts", "m2ts", "mts", "mpg", "mpeg", "gif", "wmv", "flv", "y4m",
        "mxf", "ogv", "3gp", "nut", "ivf", "h264", "264", "h265", "265", "hevc", "insv",
    ];
    let extension = path.extension().map(|e| e.to_string_lossy().to_lowercase()).unwrap_or_default();
    NAMES.contains(&extension.as_str())
}

/// Says whether these are the first bytes of a video file.
pub fn has_video_bytes(bytes: &[u8]) -> bool {
    // An AVIF is read as a video of one frame. A HEIC of a phone is made of tiles, which ffmpeg does not put together.
    let still = [&b"heic"[..], b"heix", b"mif1"];
    (bytes.get(4..8) == Some(b"ftyp") && bytes.get(8..12).is_none_or(|brand| !still.contains(&brand)))
        || bytes.starts_with(&[0x1a, 0x45, 0xdf, 0xa3])
        || (bytes.starts_with(b"RIFF") && bytes.get(8..12) == Some(b"AVI "))
        || bytes.starts_with(b"YUV4MPEG2")
        || bytes.starts_with(b"GIF8")
        || bytes.starts_with(b"nut/multimedia")
        || bytes.starts_with(b"DKIF")
        || bytes.starts_with(b"OggS")
        || bytes.starts_with(b"FLV\x01")
}

fn is_image(bytes: &[u8]) -> bool {
    let starts = [&b"\x89PNG"[..], b"\xff\xd8\xff", b"II*\0", b"MM\0*", b"#?RA", b"#?RGBE", &[0x76, 0x2f, 0x31, 0x01]];
    starts.iter().any(|start| bytes.starts_with(start)) || bytes.get(8..12) == Some(b"WEBP")
}
