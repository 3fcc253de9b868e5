//! OpenEXR files as layers of named float channels.

use super::{
    color_space::{ColorSpace, Primaries},
    layers,
    placement::Placement,
    read::{CodeImage, ColorImage, MAX_PIXELS, check_size, one_line},
};
use crate::{Error, Result, budget};
use exr::prelude::{
    FlatSamples, Image as ExrImage, MetaData, ReadChannels as _, ReadLayers as _, WritableImage as _, f16, read,
};
use glam::{Mat3, Vec3};
use std::io::{Cursor, Seek, Write};

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

/// Decodes all layers. Channels called `layer.channel` become layers of their own, as do the parts of a
/// multi-part file.
pub(super) fn decode(bytes: &[u8], subject: &str) -> Result<Exr> {
    let damaged = |error: exr::error::Error| {
        Error::input(subject, format!("cannot be decoded: {}", one_line(&error)), "write it again")
    };
    let meta = MetaData::read_from_buffered(Cursor::new(bytes), false).map_err(damaged)?;
    let (mut values, mut stored) = (0_u64, 0_u64);
    for header in &meta.headers {
        let [width, height] =
            [header.layer_size.x(), header.layer_size.y()].map(|side| u32::try_from(side).unwrap_or(u32::MAX));
        check_size([width, height], subject)?;
        values += u64::from(width) * u64::from(height) * header.channels.list.len() as u64;
        stored += u64::from(width) * u64::from(height) * header.channels.bytes_per_pixel as u64;
    }
    // Every scan-line block, of 256 lines at most, has an entry in the file.
    let blocks: usize = meta.headers.iter().map(|header| header.chunk_count).sum();
    let beyond = stored > bytes.len() as u64 * MOST_COMPRESSION + (1 << 20);
    if values > MAX_PIXELS * 8 || blocks > bytes.len() / 8 || beyond {
        return Err(Error::input(subject, "says it holds more than the file can", "write it again"));
    }
    // Values as they are stored and as floats, and the colours that are made of them.
    let area = |size: exr::math::Vec2<usize>| (size.x() as u64).saturating_mul(size.y() as u64);
    let window = meta.headers.iter().map(|header| area(header.shared_attributes.display_window.size)).max();
    budget::ask(subject, stored + 4 * values + 16 * window.unwrap_or(0).min(MAX_PIXELS))?;
    let image = read()
        .no_deep_data()
        .largest_resolution_level()
        .all_channels()
        .all_layers()
        .all_attributes()
        .from_buffered(Cursor::new(bytes))
        .map_err(damaged)?;
    let window = image.attributes.display_window;
    let whole = [window.size.x() as u32, window.size.y() as u32];
    let to_rec709 = image.attributes.chromaticities.and_then(|given| {
        let [red, green, blue, white] =
            [given.red, given.green, given.blue, given.white].map(|at| [f64::from(at.x()), f64::from(at.y())]);
        Primaries { red, green, blue, white }.to_rec709()
    });
    let mut exr = Exr { to_rec709, ..Exr::default() };
    let layers = &mut exr.layers;
    for layer in image.layer_data {
        let part_size = [layer.size.x() as u32, layer.size.y() as u32];
        let corner = layer.attributes.layer_position;
        let at = [corner.x() - window.position.x(), corner.y() - window.position.y()].map(i64::from);
        let placement = Some(Placement { whole, at, part: part_size }).filter(|p| !p.is_whole() && p.is_usable());
        let size = placement.map_or(part_size, |placement| placement.whole);
        if let Some(note) = placement.map(|placement| placement.note()).filter(|note| !exr.notes.contains(note)) {
            exr.notes.push(note);
        }
        let part = layer.attributes.layer_name.map(|name| name.to_string()).unwrap_or_default();
        let first = layers.len();
        for channel in layer.channel_data.list {
            let full = channel.name.to_string();
            let (prefix, name) = full.rsplit_once('.').unwrap_or(("", &full));
            let owner = [part.as_str(), prefix].into_iter().filter(|n| !n.is_empty()).collect::<Vec<_>>().join(".");
            let values: Vec<f32> = match channel.sample_data {
                FlatSamples::F16(values) => values.into_iter().map(f16::to_f32).collect(),
                FlatSamples::F32(values) => values,
                FlatSamples::U32(values) => values.into_iter().map(|value| value as f32).collect(),
            };
            let values = match placement {
                Some(placement) => placement.spread(&values, 1, f32::NAN),
                None => values,
            };
            let entry = (name.to_owned(), values);
            match layers[first..].iter_mut().find(|layer| layer.name == owner) {
                Some(layer) => layer.channels.push(entry),
                None => layers.push(ExrLayer { name: owner, size, channels: vec![entry] }),
            }
        }
    }
    // The main layer goes first, because it was most likely meant.
    layers.sort_by_key(|layer| !layer.name.is_empty());
    Ok(exr)
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
    let texel = |i: usize| {
        let color = space.rec709(Vec3::new(r[i], g[i], b[i]));
        // A premultiplied texel without coverage or light was never drawn.
        let undrawn = color == Vec3::ZERO && alpha.is_some_and(|alpha| alpha[i] == 0.0);
        let known = !(color.is_nan() || undrawn);
        color.extend(f32::from(known)).to_array()
    };
    let texels = (0..r.len()).map(texel).collect();
    Ok(ColorImage { size: layer.size, texels, ldr: false, taken: Some(taken), notes: exr.notes })
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
pub(super) fn encode(layers: &[ExrLayer], subject: &str, out: &mut (impl Write + Seek)) -> Result<()> {
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
    let layer = Layer::new(size, LayerAttributes::default(), encoding, AnyChannels::sort(channels));
    ExrImage::from_layer(layer).write().to_buffered(out).map_err(|error| match error {
        exr::error::Error::Io(error) => {
            let problem = format!("cannot be written: {}", super::read::plain_io(&error));
            Error::input(subject, problem, "free some space")
        }
        other => internal(one_line(&other)),
    })
}
