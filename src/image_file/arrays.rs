//! Arrays of numbers that estimators and data sets write as depth: NumPy's NPY and NPZ, PFM, Sintel's DPT, and TIFF
//! of floats.

use super::{
    color_space::ColorSpace,
    read::{MAX_PIXELS, Raster, Samples, check_size, one_line},
};
use crate::{Error, Result, budget};
use half::f16;
use std::io::{Cursor, Read as _};
use tiff::{
    ColorType,
    decoder::{Decoder, DecodingResult, Limits},
    tags::Tag,
};

/// Decodes such a file; `None` if it is none.
pub(super) fn decode(bytes: &[u8], subject: &str) -> Option<Result<Raster>> {
    let array = match bytes {
        [0x93, b'N', b'U', b'M', b'P', b'Y', ..] => npy(bytes),
        [b'P', b'K', 3, 4, ..] => npz(bytes, None),
        [b'P', b'f' | b'F', b'\n' | b'\r' | b' ', ..] => pfm(bytes),
        [b'P', b'I', b'E', b'H', ..] => dpt(bytes),
        [b'I', b'I', 42 | 43, 0, ..] | [b'M', b'M', 0, 42 | 43, ..] => deep_tiff(bytes)?,
        _ => return None,
    };
    Some(raster(array, subject))
}

/// Decodes the array of an NPZ that is called `name`; `None` if it is no NPZ.
pub(super) fn named(bytes: &[u8], name: &str, subject: &str) -> Option<Result<Raster>> {
    matches!(bytes, [b'P', b'K', 3, 4, ..]).then(|| raster(npz(bytes, Some(name)), subject))
}

fn raster(array: Decoded, subject: &str) -> Result<Raster> {
    let damaged = |problem: String| {
        let remedy = match problem.as_str() {
            problem if problem.starts_with("has no array") => "choose one of these as layer",
            problem if problem.starts_with("would take") => budget::REMEDY,
            problem if problem.starts_with("TIFF: ") => "convert it to a TIFF or PNG of 8 or 16 bits, or to an EXR",
            _ => "write it again",
        };
        let problem = match one_line(&problem) {
            problem if problem.starts_with("has no array") => problem,
            problem => format!("cannot be decoded: {problem}"),
        };
        Error::input(subject, problem, remedy)
    };
    let array = array.map_err(damaged)?;
    check_size(array.size, subject)?;
    Ok(Raster {
        size: array.size,
        channels: array.channels,
        samples: array.samples,
        lossy: false,
        color: if array.srgb { ColorSpace::SRGB } else { ColorSpace::LINEAR },
        notes: array.note.into_iter().collect(),
    })
}

struct Array {
    size: [u32; 2],
    channels: usize,
    samples: Samples,
    /// Whether its numbers are those of a picture as it is shown, not light.
    srgb: bool,
    note: Option<String>,
}

type Decoded = std::result::Result<Array, String>;

/// Gives an array of this shape its size. Axes of length 1 in front are passed over: batches of one.
fn shaped(shape: &[usize], samples: Samples) -> Decoded {
    let ones = shape.iter().take_while(|side| **side == 1).count().min(shape.len().saturating_sub(2));
    let (height, width, channels) = match shape[ones..] {
        [height, width] => (height, width, 1),
        [height, width, channels @ (1 | 3 | 4)] => (height, width, channels),
        _ => return Err(format!("its shape is {shape:?}, not height × width")),
    };
    let side = |side: usize| u32::try_from(side).map_err(|_| format!("its shape is {shape:?}"));
    Ok(Array { size: [side(width)?, side(height)?], channels, samples, srgb: false, note: None })
}

/// Numbers of a type as NumPy names it, like `<f4`.
fn numbers(bytes: &[u8], kind: &str, count: usize) -> std::result::Result<Samples, String> {
    if let Some(problem) = budget::refusal((count as u64).saturating_mul(24)) {
        return Err(problem);
    }
    // The first character is the order of bytes. If it is wider than a byte, this is no such type.
    let (order, kind) = kind.split_at_checked(1).unwrap_or(("", kind));
    let size: usize = kind.get(1..).and_then(|size| size.parse().ok()).unwrap_or(0);
    let total = count.checked_mul(size).filter(|total| *total <= bytes.len() && size > 0);
    let Some(total) = total else {
        return Err(format!("it has {} bytes for {count} numbers of type {kind}", bytes.len()));
    };
    let big = order == ">";
    let word = |chunk: &[u8]| {
        let mut word = [0; 8];
        word[..size].copy_from_slice(chunk);
        if big {
            word[..size].reverse();
        }
        word
    };
    let chunks = bytes[..total].chunks_exact(size).map(|chunk| if size <= 8 { word(chunk) } else { [0; 8] });
    let low = |word: [u8; 8]| u64::from_le_bytes(word);
    Ok(match kind {
        "f2" => Samples::F32(chunks.map(|w| f16::from_bits(low(w) as u16).to_f32()).collect()),
        "f4" => Samples::F32(chunks.map(|w| f32::from_bits(low(w) as u32)).collect()),
        "f8" => Samples::F32(chunks.map(|w| f64::from_bits(low(w)) as f32).collect()),
        "u1" | "b1" => Samples::U8(chunks.map(|w| w[0]).collect()),
        "u2" => Samples::U16(chunks.map(|w| low(w) as u16).collect()),
        "u4" | "u8" => Samples::F32(chunks.map(|w| low(w) as f32).collect()),
        "i2" => Samples::F32(chunks.map(|w| f32::from(low(w) as i16)).collect()),
        "i4" => Samples::F32(chunks.map(|w| low(w) as i32 as f32).collect()),
        "i8" => Samples::F32(chunks.map(|w| low(w) as i64 as f32).collect()),
        _ => return Err(format!("its numbers are of type {kind}")),
    })
}

/// What the header of an NPY says.
struct Npy {
    kind: String,
    shape: Vec<usize>,
    by_columns: bool,
    /// Where the numbers begin, and how many there are.
    start: usize,
    count: usize,
}

impl Npy {
    /// How many bytes the file has, by its header.
    fn length(&self) -> u64 {
        let size: u64 = self.kind.get(2..).and_then(|size| size.parse().ok()).unwrap_or(8);
        (self.count as u64).saturating_mul(size).saturating_add(self.start as u64)
    }
}

/// NumPy's format, version 1 to 3: a header that is a Python dictionary, and the numbers.
fn npy(bytes: &[u8]) -> Decoded {
    let Npy { kind, shape, by_columns, start, count } = npy_header(bytes)?;
    let samples = numbers(&bytes[start..], &kind, count)?;
    shaped(&shape, if by_columns { by_rows(samples, &shape) } else { samples })
}

fn npy_header(bytes: &[u8]) -> std::result::Result<Npy, String> {
    let short = || "its header ends early".to_owned();
    let length = |range: std::ops::Range<usize>| {
        bytes.get(range).map(|b| b.iter().rev().fold(0_usize, |value, byte| (value << 8) | usize::from(*byte)))
    };
    let (start, length) = match bytes.get(6) {
        Some(1) => (10, length(8..10)),
        Some(2 | 3) => (12, length(8..12)),
        _ => return Err("its version is not known".into()),
    };
    let end = length.and_then(|length| length.checked_add(start)).ok_or_else(short)?;
    let header = String::from_utf8_lossy(bytes.get(start..end).ok_or_else(short)?);
    let value = |key: &str| {
        let rest = header.split_once(&format!("'{key}'"))?.1.trim_start();
        Some(rest.strip_prefix(':')?.trim_start())
    };
    let kind = value("descr").and_then(|text| text.strip_prefix('\'')?.split('\'').next()).ok_or_else(short)?;
    let shape = value("shape").and_then(|text| text.strip_prefix('(')?.split(')').next()).ok_or_else(short)?;
    let shape: Vec<usize> = shape.split(',').filter_map(|side| side.trim().parse().ok()).collect();
    let count = shape.iter().try_fold(1_usize, |product, side| product.checked_mul(*side));
    let count = count.ok_or_else(|| format!("its shape is {shape:?}"))?;
    let by_columns = value("fortran_order").is_some_and(|text| text.starts_with("True"));
    Ok(Npy { kind: kind.to_owned(), shape, by_columns, start: end, count })
}

/// Brings numbers in Fortran's order, in which the first axis is the fastest, into that of C.
fn by_rows(samples: Samples, shape: &[usize]) -> Samples {
    fn ordered<T: Copy>(values: &[T], shape: &[usize]) -> Vec<T> {
        let place = |index: usize| {
            let (mut rest, mut stride, mut at) = (index, values.len(), 0);
            for side in shape.iter().rev() {
                stride /= side;
                at += rest % side * stride;
                rest /= side;
            }
            at
        };
        (0..values.len()).map(|index| values[place(index)]).collect()
    }
    match samples {
        Samples::U8(values) => Samples::U8(ordered(&values, shape)),
        Samples::U16(values) => Samples::U16(ordered(&values, shape)),
        Samples::F32(values) => Samples::F32(ordered(&values, shape)),
    }
}

/// Names in one line, and how many more there are.
fn some_of(names: &[String]) -> String {
    const MOST: usize = 12;
    let more = names.len().saturating_sub(MOST);
    let more = if more > 0 { format!(" and {more} more") } else { String::new() };
    format!("{}{more}", names[..names.len().min(MOST)].join(", "))
}

/// What the name of an array says of it: it is depth (0), nothing (1), or something else (2).
fn meaning(name: &str) -> usize {
    let name = name.to_lowercase();
    let name = name.trim_end_matches(".npy");
    let has = |words: &[&str]| words.iter().any(|word| name.contains(word));
    let is = |words: &[&str]| name.split(|letter: char| !letter.is_alphanumeric()).any(|part| words.contains(&part));
    match () {
        () if has(&["mask", "valid", "conf", "sky", "label", "segment", "uncertain"]) => 2,
        () if has(&["depth", "distance", "disparity"]) || is(&["dist", "disp", "pred", "prediction"]) => 0,
        () if has(&["image", "rgb", "color", "colour", "trinsic", "camera", "pose", "normal", "point"]) => 2,
        () if is(&["k", "xyz", "time", "timestamp", "index", "id"]) => 2,
        () => 1,
    }
}

/// Of several arrays the one that is called `wanted`, or whose name means depth, or the only one that is an image.
fn npz(bytes: &[u8], wanted: Option<&str>) -> Decoded {
    let words = |error: zip::result::ZipError| one_line(&error);
    let mut archive = zip::ZipArchive::new(Cursor::new(bytes)).map_err(words)?;
    let names: Vec<String> = archive
        .file_names()
        .filter_map(|name| Some(name.ok()?.into_owned()))
        .filter(|name| name.ends_with(".npy"))
        .collect();
    let mut read = |name: &str| -> Decoded {
        let mut file = archive.by_name(name).map_err(words)?;
        let mut content = Vec::new();
        let mut read = |content: &mut Vec<u8>, most: u64| {
            file.by_ref().take(most).read_to_end(content).map_err(|error| one_line(&error))
        };
        read(&mut content, 1 << 16)?;
        // What the archive says of sizes is not believed. An array of another shape is not read.
        let header = npy_header(&content)?;
        shaped(&header.shape, Samples::U8(Vec::new()))?;
        let length = header.length();
        if let Some(problem) = budget::refusal(length.saturating_mul(3)) {
            return Err(problem);
        }
        let more = length.saturating_sub(content.len() as u64);
        read(&mut content, more)?;
        npy(&content)
    };
    let mut order: Vec<&String> = names.iter().collect();
    order.sort_by_key(|name| meaning(name));
    if let Some(wanted) = wanted {
        let is_wanted = |name: &&String| name.as_str() == wanted || name.strip_suffix(".npy") == Some(wanted);
        let name = names.iter().find(is_wanted);
        return read(name.ok_or_else(|| format!("has no array \"{wanted}\", but {}", some_of(&names)))?);
    }
    let mut problem = None;
    let found = order.iter().find_map(|name| match read(name) {
        Ok(array) => Some((*name, array)).filter(|(_, array)| array.channels == 1),
        Err(error) => {
            problem.get_or_insert(error);
            None
        }
    });
    let Some((name, mut array)) = found else {
        return Err(match (names.as_slice(), problem) {
            ([name], Some(problem)) => format!("{name}: {problem}"),
            _ => format!("none of its arrays is an image of one number a pixel: {}", some_of(&names)),
        });
    };
    // What says that it is something else is not worth a word.
    let rivals = |other: &&String| *other != name && (meaning(other) <= meaning(name) || meaning(name) == 2);
    let others: Vec<String> = names.iter().filter(rivals).cloned().collect();
    if !others.is_empty() {
        let remedy = "to choose, write depth = { file = \"…\", layer = \"…\" }";
        array.note = Some(format!("its array {name} was taken; also there: {} ({remedy})", some_of(&others)));
    }
    Ok(array)
}

/// Debevec's format: three lines of text, and rows from the bottom.
fn pfm(bytes: &[u8]) -> Decoded {
    let mut words = Vec::new();
    let mut at = 0;
    while words.len() < 4 {
        let rest = bytes.get(at..).filter(|rest| !rest.is_empty()).ok_or("its header ends early")?;
        let length = rest.iter().take(64).position(u8::is_ascii_whitespace).ok_or("its header ends early")?;
        if length > 0 {
            words.push(String::from_utf8_lossy(&rest[..length]).into_owned());
        }
        at += length + 1;
    }
    let number = |word: &str| word.parse::<u32>().map_err(|_| format!("\"{word}\" is no size"));
    let (width, height) = (number(&words[1])?, number(&words[2])?);
    let channels = if words[0] == "PF" { 3 } else { 1 };
    let scale: f32 = words[3].parse().map_err(|_| format!("\"{}\" is no scale", words[3]))?;
    let row = (width as usize).saturating_mul(channels);
    let count = row.saturating_mul(height as usize);
    let Samples::F32(upwards) = numbers(&bytes[at..], if scale < 0.0 { "<f4" } else { ">f4" }, count)? else {
        return Err("its numbers are no floats".into());
    };
    let samples = Samples::F32(upwards.chunks_exact(row.max(1)).rev().flatten().copied().collect());
    Ok(Array { size: [width, height], channels, samples, srgb: false, note: None })
}

/// MPI Sintel's depth: "PIEH", width and height as 32-bit numbers, and floats.
fn dpt(bytes: &[u8]) -> Decoded {
    let side = |at: usize| bytes.get(at..at + 4).map(|b| u32::from_le_bytes([b[0], b[1], b[2], b[3]]));
    let (Some(width), Some(height)) = (side(4), side(8)) else { return Err("its header ends early".into()) };
    let count = (width as usize).saturating_mul(height as usize);
    Ok(Array {
        size: [width, height],
        channels: 1,
        samples: numbers(&bytes[12..], "<f4", count)?,
        srgb: false,
        note: None,
    })
}

/// A TIFF that the `image` crate does not read: of one deep number a pixel, of half floats, or a BigTIFF. `None` if it is
/// another.
fn deep_tiff(bytes: &[u8]) -> Option<Decoded> {
    let mut decoder = Decoder::new(Cursor::new(bytes)).ok()?;
    let is_big = matches!(bytes, [b'I', b'I', 43, ..] | [b'M', b'M', 0, 43, ..]);
    let (Ok(color), Ok((width, height))) = (decoder.colortype(), decoder.dimensions()) else {
        return None;
    };
    const FLOATS: u16 = 3; // of the tag SampleFormat
    let format = decoder.find_tag_unsigned_vec::<u16>(Tag::SampleFormat).ok().flatten();
    let halves = color.bit_depth() == 16 && format.is_some_and(|format| format.first() == Some(&FLOATS));
    let channels = match color {
        ColorType::Gray(32 | 64) => 1,
        ColorType::Gray(_) if is_big || halves => 1,
        ColorType::GrayA(_) if is_big || halves => 2,
        ColorType::RGB(_) if is_big || halves => 3,
        ColorType::RGBA(_) if is_big || halves => 4,
        _ if is_big => return Some(Err(format!("TIFF: its colours are {color:?}"))),
        _ => return None,
    };
    let count = u64::from(width) * u64::from(height);
    if count > MAX_PIXELS {
        return Some(Err(format!("says it has {width}x{height} pixels")));
    }
    if let Some(problem) = budget::refusal(count * (20 + 4 * channels as u64)) {
        return Some(Err(problem));
    }
    // The whole was just asked for.
    let mut limits = Limits::default();
    limits.decoding_buffer_size = usize::MAX;
    limits.intermediate_buffer_size = usize::MAX;
    let mut decoder = decoder.with_limits(limits);
    fn floats<T: Copy>(values: &[T], value: impl Fn(T) -> f32) -> Samples {
        Samples::F32(values.iter().map(|given| value(*given)).collect())
    }
    let samples = decoder.read_image().map_err(|error| format!("TIFF: {}", one_line(&error))).and_then(|read| {
        Ok(match read {
            DecodingResult::U8(values) => Samples::U8(values),
            DecodingResult::U16(values) => Samples::U16(values),
            DecodingResult::F16(values) => floats(&values, f16::to_f32),
            DecodingResult::F32(values) => Samples::F32(values),
            DecodingResult::F64(values) => floats(&values, |value| value as f32),
            DecodingResult::U32(values) => floats(&values, |value| value as f32),
            DecodingResult::I32(values) => floats(&values, |value| value as f32),
            _ => return Err("TIFF: its numbers are of a type that is not read".to_owned()),
        })
    });
    Some(samples.and_then(|samples| {
        let found = match &samples {
            Samples::U8(values) => values.len(),
            Samples::U16(values) => values.len(),
            Samples::F32(values) => values.len(),
        };
        if found != count as usize * channels {
            return Err("TIFF: its channels are in planes of their own".to_owned());
        }
        let srgb = matches!(samples, Samples::U8(_) | Samples::U16(_));
        Ok(Array { size: [width, height], channels, samples, srgb, note: None })
    }))
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::io::Write as _;

    fn npy_file(kind: &str, shape: &str, data: &[u8]) -> Vec<u8> {
        let header = format!("{{'descr': '{kind}', 'fortran_order': False, 'shape': {shape}, }}");
        let mut bytes = b"\x93NUMPY\x01\x00".to_vec();
        bytes.extend((header.len() as u16).to_le_bytes());
        bytes.extend(header.as_bytes());
        bytes.extend(data);
        bytes
    }

    fn floats(values: &[f32]) -> Vec<u8> {
        values.iter().flat_map(|value| value.to_le_bytes()).collect()
    }

    fn read(bytes: &[u8]) -> std::result::Result<([u32; 2], Samples), String> {
        decode(bytes, "f").expect("known").map(|r| (r.size, r.samples)).map_err(|error| error.to_string())
    }

    #[test]
    fn arrays_are_read() {
        let values = [1.0, 2.0, 3.0, 4.0, 5.0, 6.0];
        let right = Ok(([3, 2], Samples::F32(values.to_vec())));
        assert_eq!(read(&npy_file("<f4", "(2, 3)", &floats(&values))), right);
        assert_eq!(read(&npy_file("<f4", "(1, 2, 3, 1)", &floats(&values))), right);
        let big: Vec<u8> = values.iter().flat_map(|value| f64::from(*value).to_be_bytes()).collect();
        assert_eq!(read(&npy_file(">f8", "(2, 3)", &big)), right);
        let by_columns = floats(&[1.0, 4.0, 2.0, 5.0, 3.0, 6.0]);
        let fortran = |shape: &str| {
            let file = npy_file("<f4", shape, &by_columns);
            let text: Vec<u8> = file
                .windows(5)
                .position(|w| w == b"False")
                .map(|at| [&file[..at], b"True ", &file[at + 5..]].concat())
                .expect("says so");
            read(&text)
        };
        assert_eq!(
            [fortran("(2, 3)"), fortran("(1, 2, 3)")],
            [right.clone(), right.clone()],
            "the first axis is the fastest"
        );
        assert_eq!(read(&npy_file("<u2", "(1, 2)", &[1, 2, 3, 4])), Ok(([2, 1], Samples::U16(vec![513, 1027]))));
        let pfm = [b"Pf\n3 2\n-1.0\n".to_vec(), floats(&[4.0, 5.0, 6.0, 1.0, 2.0, 3.0])].concat();
        assert_eq!(read(&pfm), right, "its rows go upwards");
        let dpt = [b"PIEH\x03\0\0\0\x02\0\0\0".to_vec(), floats(&values)].concat();
        assert_eq!(read(&dpt), right);

        let mut tiff = Cursor::new(Vec::new());
        let mut encoder = tiff::encoder::TiffEncoder::new(&mut tiff).expect("starts");
        encoder.write_image::<tiff::encoder::colortype::Gray32Float>(3, 2, &values).expect("writes");
        assert_eq!(read(&tiff.into_inner()), right);

        let mut big = Cursor::new(Vec::new());
        let mut encoder = tiff::encoder::TiffEncoder::new_big(&mut big).expect("starts");
        encoder.write_image::<tiff::encoder::colortype::RGB8>(1, 2, &[1, 2, 3, 4, 5, 6]).expect("writes");
        let raster = decode(&big.into_inner(), "f").expect("known").expect("read");
        assert_eq!(
            (raster.channels, raster.samples, raster.color),
            (3, Samples::U8(vec![1, 2, 3, 4, 5, 6]), ColorSpace::SRGB)
        );

        let npz = npz_file(&[
            ("points.npy", npy_file("<f4", "(1, 2, 3)", &floats(&values))),
            ("depth.npy", npy_file("<f4", "(2, 3)", &floats(&values))),
        ]);
        assert_eq!(read(&npz), right);
        for length in 0..npz.len() {
            let _ = decode(&npz[..length], "f");
        }
    }

    fn npz_file(arrays: &[(&str, Vec<u8>)]) -> Vec<u8> {
        let mut npz = zip::ZipWriter::new(Cursor::new(Vec::new()));
        for (name, content) in arrays {
            npz.start_file(*name, zip::write::SimpleFileOptions::default()).expect("starts");
            npz.write_all(content).expect("writes");
        }
        npz.finish().expect("ends").into_inner()
    }

    #[test]
    fn an_array_that_says_what_is_known_is_no_depth() {
        let array = |value: f32| npy_file("<f4", "(1, 2)", &floats(&[value; 2]));
        for names in [
            ["depth_mask.npy", "pred.npy"],
            ["confidence.npy", "arr_1.npy"],
            ["image.npy", "distance.npy"],
            ["K.npy", "disp.npy"],
            ["arr_0.npy", "prediction.npy"],
        ] {
            let npz = npz_file(&[(names[0], array(1.0)), (names[1], array(2.0))]);
            let raster = decode(&npz, "f").expect("known").expect("read");
            assert_eq!(raster.samples, Samples::F32(vec![2.0; 2]), "{names:?}");
            assert!(raster.notes.is_empty(), "{:?}", raster.notes);
            let first = named(&npz, names[0].trim_end_matches(".npy"), "f").expect("an NPZ").expect("read");
            assert_eq!(first.samples, Samples::F32(vec![1.0; 2]), "{names:?}");
            let line = named(&npz, "none", "f").expect("an NPZ").expect_err("refused").to_string();
            assert!(line.starts_with("f: has no array \"none\"") && line.contains(names[1]), "{line}");
        }
        let two = npz_file(&[("depth_a.npy", array(1.0)), ("depth_b.npy", array(2.0))]);
        let raster = decode(&two, "f").expect("known").expect("read");
        assert!(raster.notes[0].contains("also there: depth_b.npy (to choose, write depth = {"), "{:?}", raster.notes);
    }

    #[test]
    fn an_archive_is_not_unpacked_for_what_it_claims() {
        let zeros = vec![0; 64 << 20];
        let claim = |shape: &str| {
            let npz = npz_file(&[("depth.npy", [npy_file("<f4", shape, &[]), zeros.clone()].concat())]);
            read(&npz).expect_err("refused")
        };
        assert!(claim("(400000, 800000)").contains("depth.npy: would take"), "{}", claim("(400000, 800000)"));
        assert!(claim("(40000000,)").contains("not height × width"), "{}", claim("(40000000,)"));
        let many: Vec<String> = (0..300).map(|i| format!("a{i}.npy")).collect();
        let many: Vec<(&str, Vec<u8>)> =
            many.iter().map(|name| (name.as_str(), npy_file("<f4", "(2, 1, 3)", &[0; 24]))).collect();
        let line = read(&npz_file(&many)).expect_err("refused");
        assert!(line.contains(" and 288 more") && line.len() < 300, "{line}");
    }

    #[test]
    fn damaged_arrays_are_refused() {
        for bytes in [
            npy_file("<f4", "(2, 3)", &[0; 8]),
            npy_file("<f4", "(99999999999, 99999999999)", &[]),
            npy_file("<c8", "(1, 1)", &[0; 8]),
            npy_file("<f4", "(2,)", &[0; 8]),
            npy_file("<f4", "(2, 3)", &[0; 24])[..20].to_vec(),
            b"Pf\n3 x\n-1\n".to_vec(),
            b"Pf\n0 0\n-1\n".to_vec(),
            b"PIEH\xff\xff\xff\xff\xff\xff\xff\xff".to_vec(),
            b"PK\x03\x04".to_vec(),
            npy_file("\u{e9}f4", "(1, 1)", &[0; 8]),
            npy_file("<f4\n\r", "(1, 1)", &[0; 8]),
            npy_file("<f4", "(4294967296, 4294967295)", &[0; 8]),
        ] {
            let line = read(&bytes).expect_err("refused");
            assert!(line.starts_with("f: ") && !line.contains('\n'), "{line}");
        }
    }
}
