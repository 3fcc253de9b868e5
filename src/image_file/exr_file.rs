//! OpenEXR files as layers of named float channels.

use super::{
    color_space::{ColorSpace, Primaries},
    layers,
    placement::Placement,
    read::{CodeImage, ColorImage, MAX_STRIPS, check_size, check_strips, one_line, plain_io},
    rows::{Rows, Strips},
    write::Shown,
};
use crate::{Error, Result, budget};
use exr::{
    block::{UncompressedBlock, lines::LineRef, reader::ChunksReader as _},
    meta::attribute::ChannelList,
    prelude::{FlatSamples, Image as ExrImage, MetaData, SampleType, Vec2, WritableImage as _, f16},
};
use glam::{Mat3, Vec3};
use std::{
    collections::HashMap,
    fs::File,
    io::{BufReader, Cursor, Read, Seek, Write},
    path::Path,
};

/// A layer of an OpenEXR file. Every channel has `size[0] · size[1]` values, with row 0 on top.
#[derive(Clone, Debug, PartialEq)]
pub struct ExrLayer {
    /// The layer's name; empty for the main layer.
    pub name: String,
    pub size: [u32; 2],
    /// Names and values of the channels.
    pub channels: Vec<(String, Vec<f32>)>,
}

impl ExrLayer {
    /// Makes an RGB layer from RGBA texels.
    pub fn rgb(name: &str, size: [u32; 2], texels: &[[f32; 4]]) -> Self {
        let channel = |index: usize| texels.iter().map(|texel| texel[index]).collect();
        let channels = ["R", "G", "B"].iter().enumerate().map(|(i, name)| ((*name).to_owned(), channel(i))).collect();
        Self { name: name.to_owned(), size, channels }
    }

    /// Returns the values of a channel.
    pub fn channel(&self, name: &str) -> Option<&[f32]> {
        self.channels.iter().find(|(channel, _)| channel == name).map(|(_, values)| values.as_slice())
    }
}

/// All that an OpenEXR file holds.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Exr {
    /// The layers, each as large as the display window. What lies outside its data window is NaN.
    pub layers: Vec<ExrLayer>,
    /// From the file's primaries to Rec. 709; `None` if they are.
    pub to_rec709: Option<Mat3>,
    /// What is unusual about the file.
    pub notes: Vec<String>,
}

/// No compression of the format makes more bytes of one than deflate does.
const MOST_COMPRESSION: u64 = 1100;

/// Says whether these are the first bytes of an OpenEXR file.
pub(super) fn is_exr(bytes: &[u8]) -> bool {
    bytes.starts_with(&[0x76, 0x2f, 0x31, 0x01])
}

fn damaged(error: &exr::error::Error, subject: &str) -> Error {
    let problem = format!("cannot be decoded: {}", one_line(error));
    let remedy = match error {
        exr::error::Error::NotSupported(_) => PLAIN,
        _ => "write it again",
    };
    Error::input(subject, problem, remedy)
}

/// What every reader understands.
const PLAIN: &str = "convert it to R, G and B channels with ZIP compression";

/// What a file holds, before its pixels are decoded. A part of it may hold several layers.
struct Contents {
    /// Layers without values.
    exr: Exr,
    /// Of each layer its part, and the numbers of its channels there.
    stored: Vec<(usize, Vec<usize>)>,
    /// Where each part is in its layers.
    parts: Vec<Placement>,
}

impl Contents {
    /// Reads the header. Channels called `layer.channel` become layers of their own, as do the parts of a multi-part
    /// file.
    fn read(file: &mut (impl Read + Seek), subject: &str) -> Result<Self> {
        let length = file.seek(std::io::SeekFrom::End(0)).and_then(|length| file.rewind().map(|()| length));
        let length = length.map_err(|error| Error::input(subject, plain_io(&error), "check the file"))?;
        let meta = MetaData::read_from_buffered(&mut *file, false).map_err(|error| damaged(&error, subject))?;
        file.rewind().map_err(|error| Error::input(subject, plain_io(&error), "check the file"))?;
        let (mut values, mut stored) = (0_u64, 0_u64);
        for header in &meta.headers {
            let [width, height] =
                [header.layer_size.x(), header.layer_size.y()].map(|side| u32::try_from(side).unwrap_or(u32::MAX));
            check_strips([width, height], subject)?;
            values += u64::from(width) * u64::from(height) * header.channels.list.len() as u64;
            stored += u64::from(width) * u64::from(height) * header.channels.bytes_per_pixel as u64;
        }
        // Every scan-line block, of 256 lines at most, has an entry in the file.
        let blocks: usize = meta.headers.iter().map(|header| header.chunk_count).sum();
        let beyond = stored > length * MOST_COMPRESSION + (1 << 20);
        if values > MAX_STRIPS * 8 || blocks as u64 > length / 8 || beyond {
            return Err(Error::input(subject, "says it holds more than the file can", "write it again"));
        }
        let Some(shared) = meta.headers.first().map(|header| &header.shared_attributes) else {
            return Err(Error::input(subject, "holds no layers", "write it again"));
        };
        let window = shared.display_window;
        let whole = [window.size.x() as u32, window.size.y() as u32];
        let to_rec709 = shared.chromaticities.and_then(|given| {
            let [red, green, blue, white] =
                [given.red, given.green, given.blue, given.white].map(|at| [f64::from(at.x()), f64::from(at.y())]);
            Primaries { red, green, blue, white }.to_rec709()
        });
        let (mut notes, mut layers, mut parts) =
            (Vec::new(), Vec::<(ExrLayer, (usize, Vec<usize>))>::new(), Vec::new());
        for (number, header) in meta.headers.iter().enumerate() {
            let part = [header.layer_size.x() as u32, header.layer_size.y() as u32];
            let corner = header.own_attributes.layer_position;
            let at = [corner.x() - window.position.x(), corner.y() - window.position.y()].map(i64::from);
            let placement = Some(Placement { whole, at, part }).filter(Placement::is_usable);
            let placement = placement.unwrap_or(Placement { whole: part, at: [0, 0], part });
            if !placement.is_whole() && !notes.contains(&placement.note()) {
                notes.push(placement.note());
            }
            let name = header.own_attributes.layer_name.as_ref().map(ToString::to_string).unwrap_or_default();
            let first = layers.len();
            for (channel, description) in header.channels.list.iter().enumerate() {
                let full = description.name.to_string();
                let (prefix, own) = full.rsplit_once('.').unwrap_or(("", &full));
                let owner = [name.as_str(), prefix].into_iter().filter(|n| !n.is_empty()).collect::<Vec<_>>().join(".");
                let entry = (own.to_owned(), Vec::new());
                match layers[first..].iter_mut().find(|(layer, _)| layer.name == owner) {
                    Some((layer, (_, stored))) => {
                        layer.channels.push(entry);
                        stored.push(channel);
                    }
                    None => {
                        let layer = ExrLayer { name: owner, size: placement.whole, channels: vec![entry] };
                        layers.push((layer, (number, vec![channel])));
                    }
                }
            }
            parts.push(placement);
        }
        // The main layer goes first, because it was most likely meant.
        layers.sort_by_key(|(layer, _)| !layer.name.is_empty());
        let (layers, stored) = layers.into_iter().unzip();
        Ok(Self { exr: Exr { layers, to_rec709, notes }, stored, parts })
    }

    /// Decodes the values of all channels, or of one channel of a layer.
    fn fill(mut self, file: impl Read + Seek, only: Option<(usize, usize)>, subject: &str) -> Result<Exr> {
        let mut targets: HashMap<[usize; 2], &mut Vec<f32>> = HashMap::new();
        let (mut held, mut most) = (0, 0);
        for (layer, (values, (part, stored))) in self.exr.layers.iter_mut().zip(&self.stored).enumerate() {
            for (place, ((_, values), channel)) in values.channels.iter_mut().zip(stored).enumerate() {
                if only.is_none_or(|only| only == (layer, place)) {
                    let whole = self.parts[*part].whole;
                    check_size(whole, subject)?;
                    let pixels = u64::from(whole[0]) * u64::from(whole[1]);
                    (held, most) = (held + pixels, most.max(pixels));
                    targets.insert([*part, *channel], values);
                }
            }
        }
        // And the colours that may be made of them.
        budget::ask(subject, 4 * held + if only.is_none() { 16 * most } else { 0 })?;
        for ([part, _], values) in &mut targets {
            let [width, height] = self.parts[*part].whole.map(|side| side as usize);
            **values = vec![f32::NAN; width * height];
        }
        let wanted: Vec<usize> = targets.keys().map(|[part, _]| *part).collect();
        blocks(file, &wanted, subject, |channels, block| {
            let placement = &self.parts[block.index.layer];
            for line in block.lines(channels) {
                let Some(values) = targets.get_mut(&[block.index.layer, line.location.channel]) else { continue };
                let Some((start, skip, count)) = placement
                    .line([line.location.position.x(), line.location.position.y()], line.location.sample_count)
                else {
                    continue;
                };
                let out = &mut values[start..start + count];
                each(&line, channels, |index, value| {
                    if let Some(out) = index.checked_sub(skip).and_then(|index| out.get_mut(index)) {
                        *out = value;
                    }
                });
            }
        })?;
        Ok(self.exr)
    }
}

/// Decodes the blocks of some parts, in any order.
fn blocks(
    file: impl Read + Seek,
    parts: &[usize],
    subject: &str,
    mut each: impl FnMut(&ChannelList, &UncompressedBlock),
) -> Result<()> {
    let file = exr::block::read(file, false);
    let chunks = file.and_then(|file| {
        file.filter_chunks(false, |_, _, block| block.level == Vec2(0, 0) && parts.contains(&block.layer))
    });
    let done = chunks.and_then(|chunks| {
        chunks.decompress_parallel(false, |meta, block| {
            each(&meta.headers[block.index.layer].channels, &block);
            Ok(())
        })
    });
    done.map_err(|error| damaged(&error, subject))
}

/// Calls with the number and the value of each sample of a line.
fn each(line: &LineRef<'_>, channels: &ChannelList, mut with: impl FnMut(usize, f32)) {
    let Some(channel) = channels.list.get(line.location.channel) else { return };
    match channel.sample_type {
        SampleType::F16 => (line.value.as_chunks().0.iter().enumerate())
            .for_each(|(index, bytes)| with(index, f16::from_ne_bytes(*bytes).to_f32())),
        SampleType::F32 => (line.value.as_chunks().0.iter().enumerate())
            .for_each(|(index, bytes)| with(index, f32::from_ne_bytes(*bytes))),
        SampleType::U32 => (line.value.as_chunks().0.iter().enumerate())
            .for_each(|(index, bytes)| with(index, u32::from_ne_bytes(*bytes) as f32)),
    }
}

/// Decodes all layers.
pub(super) fn decode(bytes: &[u8], subject: &str) -> Result<Exr> {
    Contents::read(&mut Cursor::new(bytes), subject)?.fill(Cursor::new(bytes), None, subject)
}

/// How large the whole picture is.
pub(super) fn size(mut file: BufReader<File>, subject: &str) -> Result<[u32; 2]> {
    let contents = Contents::read(&mut file, subject)?;
    let layer = contents.exr.layers.first();
    layer.map(|layer| layer.size).ok_or_else(|| Error::input(subject, "holds no channels", "write it again"))
}

/// The colour of the layer `wanted`, or of the one whose name means colour, by strips of rows.
pub(super) fn rows(mut file: BufReader<File>, wanted: Option<&str>, subject: String) -> Result<Rows> {
    let contents = Contents::read(&mut file, &subject)?;
    let (index, channels, taken) = layers::color(&contents.exr.layers, wanted, &subject)?;
    let (layer, (part, stored)) = (&contents.exr.layers[index], &contents.stored[index]);
    let alpha = layer.channels.iter().position(|(name, _)| name == "A").map(|alpha| (stored[alpha], 3));
    let slots: Vec<(usize, usize)> =
        channels.iter().enumerate().map(|(slot, channel)| (stored[*channel], slot)).chain(alpha).collect();
    let (part, placement) = (*part, contents.parts[*part]);
    let space = ColorSpace { to_rec709: contents.exr.to_rec709, ..ColorSpace::LINEAR };
    let chroma = Chroma::of(layer, channels, &space);
    let decode = move |out: &mut Strips<'_>| {
        let [width, height] = placement.whole.map(|side| side as usize);
        // Rows of blocks that are not complete, by their first row in the file: pixels that lack, and texels.
        let mut bands: HashMap<usize, (usize, Vec<[f32; 4]>)> = HashMap::new();
        blocks(file, &[part], &subject, |list, block| {
            let (first, size) = (block.index.pixel_position.y(), block.index.pixel_size);
            let (lacks, band) = bands.entry(first).or_insert_with(|| {
                let rows = size.height();
                (rows * placement.part[0] as usize, vec![[f32::NAN, f32::NAN, f32::NAN, 1.0]; rows * width])
            });
            let band_placement = Placement {
                whole: [placement.whole[0], (band.len() / width) as u32],
                at: [placement.at[0], -(first as i64)],
                part: placement.part,
            };
            for line in block.lines(list) {
                for (_, slot) in slots.iter().filter(|(channel, _)| *channel == line.location.channel) {
                    let place = band_placement
                        .line([line.location.position.x(), line.location.position.y()], line.location.sample_count);
                    let Some((start, skip, count)) = place else { continue };
                    let out = &mut band[start..start + count];
                    each(&line, list, |index, value| {
                        if let Some(texel) = index.checked_sub(skip).and_then(|index| out.get_mut(index)) {
                            texel[*slot] = value;
                        }
                    });
                }
            }
            *lacks = lacks.saturating_sub(size.area());
            if *lacks > 0 {
                return;
            }
            let Some((_, mut band)) = bands.remove(&first) else { return };
            for texel in &mut band {
                *texel = color_of(chroma.rgb(*texel), &space, alpha.is_some());
            }
            let at = placement.at[1] + first as i64;
            let (skip, end) = ((-at).max(0) as usize, (height as i64 - at).max(0) as usize);
            let end = end.min(band.len() / width);
            if skip < end {
                out((at + skip as i64) as u32, &mut band[skip * width..end * width]);
            }
        })
    };
    let (size, notes) = (placement.whole, contents.exr.notes);
    Ok(Rows { size, ldr: false, taken: Some(taken), notes, held: 0, decode: Box::new(decode) })
}

/// The depth of the layer or channel `wanted`, or of the one whose name means depth; `None` if this is no OpenEXR file.
pub(super) fn codes_of_file(path: &Path, wanted: Option<&str>, subject: &str) -> Result<Option<CodeImage>> {
    let (mut file, start) = super::rows::begin(path)?;
    if !is_exr(&start) {
        return Ok(None);
    }
    let contents = Contents::read(&mut file, subject)?;
    let (layer, channel, _) = layers::depth(&contents.exr.layers, wanted, subject)?;
    codes(contents.fill(file, Some((layer, channel)), subject)?, wanted, subject).map(Some)
}

pub(super) fn list(layers: &[ExrLayer]) -> String {
    let names = layers.iter().flat_map(|layer| {
        let dot = if layer.name.is_empty() { "" } else { "." };
        layer.channels.iter().map(move |(channel, _)| format!("{}{dot}{channel}", layer.name))
    });
    names.take(20).collect::<Vec<_>>().join(", ")
}

/// Returns the colour of the layer `wanted`, or of the one whose name means colour.
pub(super) fn color(exr: Exr, wanted: Option<&str>, subject: &str) -> Result<ColorImage> {
    let (index, channels, taken) = layers::color(&exr.layers, wanted, subject)?;
    let layer = &exr.layers[index];
    let [r, g, b] = channels.map(|channel| layer.channels[channel].1.as_slice());
    let alpha = layer.channel("A");
    let space = ColorSpace { to_rec709: exr.to_rec709, ..ColorSpace::LINEAR };
    let chroma = Chroma::of(layer, channels, &space);
    let texel = |i: usize| {
        let stored = [r[i], g[i], b[i], alpha.map_or(1.0, |alpha| alpha[i])];
        color_of(chroma.rgb(stored), &space, alpha.is_some())
    };
    let texels = (0..r.len()).map(texel).collect();
    Ok(ColorImage { size: layer.size, texels, ldr: false, taken: Some(taken), notes: exr.notes })
}

/// How three stored channels become red, green and blue.
#[derive(Clone, Copy)]
struct Chroma {
    /// The luminance of red, green and blue, if the channels are RY, Y and BY: `RY = (R − Y) / Y`, and `BY` likewise
    /// (OpenEXR's `RgbaYca`). `None` if they are red, green and blue themselves.
    weights: Option<Vec3>,
}

impl Chroma {
    fn of(layer: &ExrLayer, channels: [usize; 3], space: &ColorSpace) -> Self {
        let rec709 = Vec3::new(0.2126, 0.7152, 0.0722);
        let weights = space.to_rec709.map_or(rec709, |matrix| matrix.transpose() * rec709);
        Self { weights: layers::is_chroma(layer, channels).then_some(weights) }
    }

    fn rgb(self, [first, second, third, alpha]: [f32; 4]) -> [f32; 4] {
        let Some(weights) = self.weights else { return [first, second, third, alpha] };
        let (red, blue) = ((first + 1.0) * second, (third + 1.0) * second);
        [red, (second - red * weights.x - blue * weights.z) / weights.y, blue, alpha]
    }
}

/// A colour whose alpha says whether it is known.
fn color_of([r, g, b, alpha]: [f32; 4], space: &ColorSpace, has_alpha: bool) -> [f32; 4] {
    let color = space.rec709(Vec3::new(r, g, b));
    // A premultiplied texel without coverage or light was never drawn.
    let undrawn = has_alpha && alpha == 0.0 && color == Vec3::ZERO;
    color.extend(f32::from(!(color.is_nan() || undrawn))).to_array()
}

/// Returns the depth of the layer or channel `wanted`, or of the one whose name means depth.
pub(super) fn codes(mut exr: Exr, wanted: Option<&str>, subject: &str) -> Result<CodeImage> {
    let (index, channel, taken) = layers::depth(&exr.layers, wanted, subject)?;
    let layer = &mut exr.layers[index];
    let codes = std::mem::take(&mut layer.channels[channel].1);
    Ok(CodeImage { size: layer.size, codes, integer: false, taken: Some(taken), notes: exr.notes })
}

/// Encodes layers of one size as single-part float EXR, losslessly compressed. Channels of named layers are
/// called `layer.channel`, which every viewer understands.
pub(super) fn encode(layers: &[ExrLayer], shown: Shown, subject: &str, out: &mut (impl Write + Seek)) -> Result<()> {
    use exr::meta::attribute::EnvironmentMap;
    use exr::prelude::{AnyChannel, AnyChannels, Blocks, Compression, Encoding, Layer, LayerAttributes, LineOrder};
    let internal = |problem: String| Error::Internal(format!("writing EXR: {problem}"));
    let Some(size) = layers.first().map(|layer| layer.size) else {
        return Err(internal("no layers".into()));
    };
    let mut channels = exr::prelude::SmallVec::new();
    for layer in layers {
        let pixels = size[0] as usize * size[1] as usize;
        if layer.size != size || layer.channels.iter().any(|(_, values)| values.len() != pixels) || pixels == 0 {
            return Err(internal(format!("layer {} is not {}x{}", layer.name, size[0], size[1])));
        }
        for (channel, values) in &layer.channels {
            let name = if layer.name.is_empty() { channel.clone() } else { format!("{}.{channel}", layer.name) };
            channels.push(AnyChannel::new(name.as_str(), FlatSamples::F32(values.clone())));
        }
    }
    let encoding =
        Encoding { compression: Compression::ZIP16, blocks: Blocks::ScanLines, line_order: LineOrder::Increasing };
    let size = (size[0] as usize, size[1] as usize);
    let environment_map = (shown == Shown::Around).then_some(EnvironmentMap::LatitudeLongitude);
    let attributes = LayerAttributes { environment_map, ..LayerAttributes::default() };
    let layer = Layer::new(size, attributes, encoding, AnyChannels::sort(channels));
    ExrImage::from_layer(layer).write().to_buffered(out).map_err(|error| match error {
        exr::error::Error::Io(error) => {
            let problem = format!("cannot be written: {}", plain_io(&error));
            Error::input(subject, problem, "free some space")
        }
        other => internal(one_line(&other)),
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use exr::prelude::{AnyChannel, AnyChannels, Layer};

    /// A file of two pixels with these channels.
    fn file(channels: Vec<AnyChannel<FlatSamples>>) -> Vec<u8> {
        let mut bytes = Cursor::new(Vec::new());
        let channels = AnyChannels::sort(channels.into_iter().collect());
        let layer = Layer::new((2, 1), Default::default(), Default::default(), channels);
        ExrImage::from_layer(layer).write().to_buffered(&mut bytes).expect("written");
        bytes.into_inner()
    }

    #[test]
    fn luminance_and_chroma_are_colours() {
        let (r, g, b) = (0.5, 0.25, 2.0);
        let y = 0.2126 * r + 0.7152 * g + 0.0722 * b;
        let channel = |name: &str, value: f32| AnyChannel::new(name, FlatSamples::F32(vec![value; 2]));
        let bytes = file(vec![channel("Y", y), channel("RY", (r - y) / y), channel("BY", (b - y) / y)]);
        let read = color(decode(&bytes, "f").expect("read"), None, "f").expect("colour");
        let near = |found: f32, right: f32| (found - right).abs() < 1e-4;
        let [red, green, blue, known] = read.texels[1];
        assert!(near(red, r) && near(green, g) && near(blue, b) && known == 1.0, "{:?}", read.texels);
        let folder = tempfile::tempdir().expect("a folder");
        let path = folder.path().join("f.exr");
        std::fs::write(&path, &bytes).expect("written");
        let mut strips = Vec::new();
        let by_rows = Rows::open(&path, None).expect("opened");
        by_rows.each(&mut |_, strip| strips.extend_from_slice(strip)).expect("read");
        assert_eq!(strips, read.texels);
    }

    #[test]
    fn coarser_channels_are_refused_with_a_remedy() {
        let mut bytes = file(vec![AnyChannel::new("Y", FlatSamples::F32(vec![1.0; 2]))]);
        // The channel's name, a zero, the type, linearity, and then the sampling along x.
        let at = bytes.windows(2).position(|pair| pair == b"Y\0").expect("a channel") + 2 + 4 + 4;
        assert_eq!(bytes[at..at + 4], [1, 0, 0, 0]);
        bytes[at] = 2;
        let line = decode(&bytes, "f").expect_err("refused").to_string();
        assert!(line.contains("subsampling") && line.ends_with(PLAIN), "{line}");
    }
}
