//! OpenEXR files as layers of named float channels.

use super::read::{CodeImage, ColorImage, MAX_PIXELS, check_size, one_line};
use crate::{Error, Result};
use exr::prelude::{
    FlatSamples, Image as ExrImage, MetaData, ReadChannels as _, ReadLayers as _, WritableImage as _, f16, read,
};
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

/// Decodes all layers. Channels called `layer.channel` become layers of their own, as do the parts of a
/// multi-part file.
pub(super) fn decode(bytes: &[u8], subject: &str) -> Result<Vec<ExrLayer>> {
    let damaged = |error: exr::error::Error| {
        Error::input(subject, format!("cannot be decoded: {}", one_line(&error)), "write it again")
    };
    let meta = MetaData::read_from_buffered(Cursor::new(bytes), false).map_err(damaged)?;
    let mut values = 0_u64;
    for header in &meta.headers {
        let [width, height] =
            [header.layer_size.x(), header.layer_size.y()].map(|side| u32::try_from(side).unwrap_or(u32::MAX));
        check_size([width, height], subject)?;
        values += u64::from(width) * u64::from(height) * header.channels.list.len() as u64;
    }
    // Every scan-line block, of 256 lines at most, has an entry in the file.
    let blocks: usize = meta.headers.iter().map(|header| header.chunk_count).sum();
    if values > MAX_PIXELS * 8 || blocks > bytes.len() / 8 {
        return Err(Error::input(subject, "says it holds more than the file can", "write it again"));
    }
    let image = read()
        .no_deep_data()
        .largest_resolution_level()
        .all_channels()
        .all_layers()
        .all_attributes()
        .from_buffered(Cursor::new(bytes))
        .map_err(damaged)?;
    let mut layers: Vec<ExrLayer> = Vec::new();
    for layer in image.layer_data {
        let size = [layer.size.x() as u32, layer.size.y() as u32];
        let part = layer.attributes.layer_name.map(|name| name.to_string()).unwrap_or_default();
        let first = layers.len();
        for channel in layer.channel_data.list {
            let full = channel.name.to_string();
            let (prefix, name) = full.rsplit_once('.').unwrap_or(("", &full));
            let owner = [part.as_str(), prefix].into_iter().filter(|n| !n.is_empty()).collect::<Vec<_>>().join(".");
            let values = match channel.sample_data {
                FlatSamples::F16(values) => values.into_iter().map(f16::to_f32).collect(),
                FlatSamples::F32(values) => values,
                FlatSamples::U32(values) => values.into_iter().map(|value| value as f32).collect(),
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
    Ok(layers)
}

fn list(layers: &[ExrLayer]) -> String {
    let names = layers.iter().flat_map(|layer| {
        let dot = if layer.name.is_empty() { "" } else { "." };
        layer.channels.iter().map(move |(channel, _)| format!("{}{dot}{channel}", layer.name))
    });
    names.take(20).collect::<Vec<_>>().join(", ")
}

/// Returns R, G and B of the first layer that has them, else Y as grey.
pub(super) fn color(layers: Vec<ExrLayer>, subject: &str) -> Result<ColorImage> {
    for names in [["R", "G", "B"], ["Y", "Y", "Y"]] {
        for layer in &layers {
            if let [Some(r), Some(g), Some(b)] = names.map(|name| layer.channel(name)) {
                let texels = r.iter().zip(g).zip(b).map(|((r, g), b)| [*r, *g, *b, 1.0]).collect();
                return Ok(ColorImage { size: layer.size, texels, ldr: false });
            }
        }
    }
    let problem = format!("has no R, G, B nor Y channel, but {}", list(&layers));
    Err(Error::input(subject, problem, "write the colour as channels R, G, B"))
}

/// Returns the first of Y, Z, R and depth, or the only channel.
pub(super) fn codes(mut layers: Vec<ExrLayer>, subject: &str) -> Result<CodeImage> {
    for name in ["Y", "Z", "R", "depth"] {
        for layer in &mut layers {
            if let Some((_, values)) = layer.channels.iter_mut().find(|(c, _)| c.eq_ignore_ascii_case(name)) {
                return Ok(CodeImage { size: layer.size, codes: std::mem::take(values), integer: false });
            }
        }
    }
    if let [ExrLayer { size, channels, .. }] = layers.as_mut_slice()
        && let [(_, values)] = channels.as_mut_slice()
    {
        return Ok(CodeImage { size: *size, codes: std::mem::take(values), integer: false });
    }
    let problem = format!("has no channel Y, Z, R or depth, but {}", list(&layers));
    Err(Error::input(subject, problem, "write the depth as channel Y"))
}

/// Encodes layers of one size as single-part float EXR, losslessly compressed. Channels of named layers are
/// called `layer.channel`, which every viewer understands.
pub(super) fn encode(layers: &[ExrLayer], out: &mut (impl Write + Seek)) -> Result<()> {
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
        exr::error::Error::Io(error) => Error::input("output", super::read::plain_io(&error), "free some space"),
        other => internal(one_line(&other)),
    })
}
