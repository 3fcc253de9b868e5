//! The metadata by which players know a 360° video: Spherical Video V1 (RDF in a `uuid` box) and V2 (`st3d` and `sv3d`),
//! both of Google's RFC, put into an MP4 or MOV file that is written already.

use crate::{Error, Result};
use std::{
    fs::File,
    io::{self, BufWriter, Read, Seek, SeekFrom, Write},
    path::Path,
};

/// How the views of two eyes share a picture.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Views {
    One,
    /// The left eye's on top.
    TopBottom,
}

const UUID_V1: [u8; 16] =
    [0xff, 0xcc, 0x82, 0x63, 0xf8, 0x55, 0x4a, 0x93, 0x88, 0x14, 0x58, 0x7a, 0x02, 0x52, 0x1f, 0xdd];

/// Fields of a visual sample entry before its boxes.
const VISUAL_ENTRY: usize = 78;

/// Copies a file, and says in the copy what kind of 360° video it is, if it is one. Where only QuickTime's colour box is there,
/// the range of the codes goes into it.
///
/// # Errors
/// Fails if the file is no MP4 or MOV with a video track, or if it cannot be read or written.
pub fn mark(from: &Path, to: &Path, views: Option<Views>, full_range: bool) -> Result<()> {
    let fail = |error: io::Error| {
        Error::input(to.display(), format!("cannot be written: {}", error.kind()), "free some space")
    };
    let odd = || Error::Internal(format!("{}: boxes that do not fit together", from.display()));
    let mut input = File::open(from).map_err(fail)?;
    let length = input.metadata().map_err(fail)?.len();
    let (mut moov, mut data, mut at) = (None, None, 0_u64);
    while at + 8 <= length {
        let mut header = [0; 16];
        input.seek(SeekFrom::Start(at)).map_err(fail)?;
        let read = input.read(&mut header).map_err(fail)?;
        let (size, kind) = match u32::from_be_bytes([header[0], header[1], header[2], header[3]]) {
            0 => (length - at, &header[4..8]),
            1 if read >= 16 => (u64::from_be_bytes(header[8..16].try_into().map_err(|_| odd())?), &header[4..8]),
            size => (u64::from(size), &header[4..8]),
        };
        match kind {
            b"moov" => moov = Some((at, size)),
            b"mdat" => data = data.or(Some(at)),
            _ => {}
        }
        if size < 8 {
            return Err(odd());
        }
        at += size;
    }
    let (start, size) = moov.ok_or_else(odd)?;
    if size > 1 << 30 || start + size > length {
        return Err(odd());
    }
    let mut old = vec![0; size as usize];
    input.seek(SeekFrom::Start(start)).map_err(fail)?;
    input.read_exact(&mut old).map_err(fail)?;
    let mut new = with_metadata(&old, views, full_range).ok_or_else(odd)?;
    let grown = (new.len() - old.len()) as u64;
    if data.is_some_and(|data| data > start) {
        shift_chunks(&mut new, grown).ok_or_else(odd)?;
    }
    let mut out = BufWriter::new(File::create(to).map_err(fail)?);
    let mut copy = |from: u64, count: u64, out: &mut BufWriter<File>| -> io::Result<()> {
        input.seek(SeekFrom::Start(from))?;
        io::copy(&mut (&input).take(count), out).map(|_| ())
    };
    copy(0, start, &mut out).map_err(fail)?;
    out.write_all(&new).map_err(fail)?;
    copy(start + size, length - start - size, &mut out).map_err(fail)?;
    out.flush().map_err(fail)
}

/// The kind and content of each box, or `None` if they do not fit.
fn boxes(bytes: &[u8]) -> Option<Vec<([u8; 4], &[u8])>> {
    let mut found = Vec::new();
    let mut rest = bytes;
    while rest.len() >= 8 {
        let size = u32::from_be_bytes(rest[..4].try_into().ok()?) as usize;
        let size = if size == 0 { rest.len() } else { size };
        if size < 8 || size > rest.len() {
            return None;
        }
        found.push((rest[4..8].try_into().ok()?, &rest[8..size]));
        rest = &rest[size..];
    }
    // A few bytes of zeros may end the boxes of a QuickTime entry.
    rest.iter().all(|byte| *byte == 0).then_some(found)
}

fn make(kind: [u8; 4], content: &[u8]) -> Vec<u8> {
    let size = (content.len() + 8) as u32;
    [&size.to_be_bytes()[..], &kind, content].concat()
}

fn with_metadata(moov: &[u8], views: Option<Views>, full_range: bool) -> Option<Vec<u8>> {
    let mut content = Vec::new();
    for (kind, inner) in boxes(moov.get(8..)?)? {
        let is_video = kind == *b"trak"
            && find(inner, b"mdia").and_then(|mdia| find(mdia, b"hdlr")).is_some_and(|h| h.get(8..12) == Some(b"vide"));
        if is_video {
            let mut track = rebuilt(inner, views, full_range)?;
            track.extend(
                views.into_iter().flat_map(|views| make(*b"uuid", &[&UUID_V1[..], rdf(views).as_bytes()].concat())),
            );
            content.extend(make(kind, &track));
        } else {
            content.extend(make(kind, inner));
        }
    }
    Some(make(*b"moov", &content))
}

fn find<'a>(bytes: &'a [u8], kind: &[u8; 4]) -> Option<&'a [u8]> {
    boxes(bytes)?.into_iter().find(|(found, _)| found == kind).map(|(_, content)| content)
}

/// The boxes of a video track, with metadata in its sample entries.
fn rebuilt(bytes: &[u8], views: Option<Views>, full_range: bool) -> Option<Vec<u8>> {
    let mut out = Vec::new();
    for (kind, content) in boxes(bytes)? {
        let content = match &kind {
            b"mdia" | b"minf" | b"stbl" => rebuilt(content, views, full_range)?,
            b"stsd" => {
                let mut stsd = content.get(..8)?.to_vec();
                for (kind, entry) in boxes(&content[8..])? {
                    let mut entry_out = entry.get(..VISUAL_ENTRY)?.to_vec();
                    let known = boxes(&entry[VISUAL_ENTRY..])?;
                    let others = known.iter().filter(|(kind, _)| kind != b"st3d" && kind != b"sv3d");
                    others.for_each(|(kind, content)| match content.strip_prefix(b"nclc") {
                        Some(colors) if kind == b"colr" => {
                            let range = [if full_range { 0x80 } else { 0 }];
                            entry_out.extend(make(*kind, &[&b"nclx"[..], colors, &range].concat()));
                        }
                        _ => entry_out.extend(make(*kind, content)),
                    });
                    entry_out.extend(views.into_iter().flat_map(version_2));
                    stsd.extend(make(kind, &entry_out));
                }
                stsd
            }
            _ => content.to_vec(),
        };
        out.extend(make(kind, &content));
    }
    Some(out)
}

fn version_2(views: Views) -> Vec<u8> {
    let mode = if views == Views::TopBottom { 1 } else { 0 };
    let source = make(*b"svhd", b"\0\0\0\0iprt\0");
    let pose = make(*b"prhd", &[0; 16]);
    let bounds = make(*b"equi", &[0; 20]);
    let projection = make(*b"proj", &[pose, bounds].concat());
    [make(*b"st3d", &[0, 0, 0, 0, mode]), make(*b"sv3d", &[source, projection].concat())].concat()
}

fn rdf(views: Views) -> String {
    let stereo = match views {
        Views::One => "",
        Views::TopBottom => "<GSpherical:StereoMode>top-bottom</GSpherical:StereoMode>",
    };
    format!(
        "<?xml version=\"1.0\"?><rdf:SphericalVideo xmlns:rdf=\"http://www.w3.org/1999/02/22-rdf-syntax-ns#\" \
         xmlns:GSpherical=\"http://ns.google.com/videos/1.0/spherical/\">\
         <GSpherical:Spherical>true</GSpherical:Spherical><GSpherical:Stitched>true</GSpherical:Stitched>\
         <GSpherical:StitchingSoftware>iprt</GSpherical:StitchingSoftware>\
         <GSpherical:ProjectionType>equirectangular</GSpherical:ProjectionType>{stereo}</rdf:SphericalVideo>"
    )
}

/// Moves the offsets of all chunks, which lie behind the boxes that have grown.
fn shift_chunks(moov: &mut [u8], by: u64) -> Option<()> {
    fn walk(bytes: &mut [u8], by: u64) -> Option<()> {
        let mut at = 0;
        while at + 8 <= bytes.len() {
            let size = u32::from_be_bytes(bytes[at..at + 4].try_into().ok()?) as usize;
            let kind: [u8; 4] = bytes[at + 4..at + 8].try_into().ok()?;
            if size < 8 || at + size > bytes.len() {
                return None;
            }
            let content = &mut bytes[at + 8..at + size];
            match &kind {
                b"moov" | b"trak" | b"mdia" | b"minf" | b"stbl" => walk(content, by)?,
                b"stco" => {
                    for entry in content.get_mut(8..)?.chunks_exact_mut(4) {
                        let moved = u64::from(u32::from_be_bytes(entry.try_into().ok()?)) + by;
                        entry.copy_from_slice(&u32::try_from(moved).ok()?.to_be_bytes());
                    }
                }
                b"co64" => {
                    for entry in content.get_mut(8..)?.chunks_exact_mut(8) {
                        let moved = u64::from_be_bytes(entry.try_into().ok()?) + by;
                        entry.copy_from_slice(&moved.to_be_bytes());
                    }
                }
                _ => {}
            }
            at += size;
        }
        Some(())
    }
    walk(moov, by)
}
