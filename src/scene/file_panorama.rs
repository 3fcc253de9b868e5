//! Reads the table `[panorama]` of a scene file.

use super::{fields::FieldTable, file::vec3};
use crate::{
    media,
    panorama::{
        cube,
        depth::{DepthEncoding, Rule},
        pattern::Pattern,
        preset::{PRESETS, Preset},
        source::{DepthSource, FrameRange, LampRule, Packing, PanoramaSpec},
    },
};
use glam::Vec3;
use std::path::PathBuf;
use toml::Value;

pub(super) const KEYS: &[&str] = &[
    "color",
    "depth",
    "packing",
    "layout",
    "frames",
    "fps",
    "depth_preset",
    "encoding",
    "scale",
    "offset",
    "invalid",
    "position",
    "yaw",
    "pitch",
    "roll",
    "mask",
    "exposure",
    "inverse_tonemap",
    "lamps",
];

const MAX_FRAMES: u32 = 1_000_000;

/// Reads the table. Problems are reported through `fields`.
pub(super) fn read_panorama(fields: &FieldTable, warnings: &mut Vec<String>) -> Option<PanoramaSpec> {
    if !fields.has("color") {
        fields.complain("color", "is missing", "name the panorama's image");
    }
    let (color, color_layer) = match read_file(fields, "color") {
        Some((color, layer)) => (Some(color), layer),
        None => (None, None),
    };
    let packing = match fields.word("packing", &["separate", "top-bottom", "left-right"]) {
        Some(1) => Packing::TopBottom,
        Some(2) => Packing::LeftRight,
        _ => Packing::Separate,
    };
    let position = fields.vector("position").map_or(Vec3::ZERO, vec3);
    let (depth, depth_layer) = match read_depth(fields, packing, position) {
        Some((depth, layer)) => (Some(depth), layer),
        None => (None, None),
    };
    let frames = read_frames(fields);
    let is_video = |path: &std::path::Path| media::is_video(path);
    let patterned =
        |path: &std::path::Path| is_video(path) || Pattern::parse(path).is_ok_and(|pattern| pattern.is_sequence());
    if fields.has("fps") && color.as_deref().is_some_and(is_video) {
        warnings.push(format!("{}: has no effect, as the video has its own rate", fields.subject("fps")));
    }
    let any_pattern =
        color.as_deref().is_some_and(patterned) || matches!(&depth, Some(DepthSource::Files(path)) if patterned(path));
    if frames.is_some() && color.is_some() && !any_pattern {
        warnings
            .push(format!("{}: has no effect, as color is neither a video nor a %d pattern", fields.subject("frames")));
    }
    let is_cube = fields.word("layout", &["equirect", "cube"]) == Some(1);
    let six = |path: Option<&PathBuf>| path.is_some_and(|path| cube::has_faces(path));
    let depth_path = match &depth {
        Some(DepthSource::Files(path)) => Some(path),
        _ => None,
    };
    let cubes = [is_cube || six(color.as_ref()), is_cube || six(color.as_ref()) || six(depth_path)];
    let names: Vec<&str> = PRESETS.iter().map(|preset| preset.name).collect();
    let preset = fields.word("depth_preset", &names).map(|index| &PRESETS[index]);
    if preset.is_some_and(|preset| preset.scale.is_none()) && !fields.has("scale") {
        fields.complain("depth_preset", "is relative", "give scale, too; iprt new finds one");
    }
    let base = preset.map_or_else(Rule::default, Preset::rule);
    let encoding = fields.word("encoding", &DepthEncoding::ALL.map(DepthEncoding::word));
    let positive = |key: &str| fields.number_in(key, "above 0", |v| v > 0.0);
    let rule = Rule {
        encoding: encoding.map_or(base.encoding, |index| DepthEncoding::ALL[index]),
        scale: fields.number_in("scale", "other than 0", |v| v != 0.0).unwrap_or(base.scale),
        offset: fields.number("offset").unwrap_or(base.offset),
        invalid: fields.codes("invalid").unwrap_or(base.invalid),
    };
    let angle = |key: &str| fields.number_in(key, "from -180 to 180", |v| v.abs() <= 180.0).unwrap_or(0.0) as f32;
    let inverse_tonemap = fields.number_in("inverse_tonemap", "from 1 to 1e6", |v| (1.0..=1e6).contains(&v));
    let is_whole = color.is_some() && depth.is_some();
    let spec = PanoramaSpec {
        color: color.unwrap_or_default(),
        color_layer,
        depth: depth.unwrap_or(DepthSource::Packed),
        depth_layer,
        mask: fields.file_path("mask"),
        pitch_degrees: angle("pitch"),
        roll_degrees: angle("roll"),
        packing,
        cubes,
        frames,
        fps: positive("fps").unwrap_or(30.0),
        rule,
        position,
        yaw_degrees: fields.number("yaw").unwrap_or(0.0) as f32,
        exposure: positive("exposure").unwrap_or(1.0) as f32,
        inverse_tonemap: inverse_tonemap.unwrap_or(1.0) as f32,
        // Who says how bright white is has said how bright lamps are.
        lamps: read_lamps(fields).unwrap_or(match inverse_tonemap {
            Some(_) => LampRule::AsCaptured,
            None => LampRule::Estimate,
        }),
    };
    is_whole.then_some(spec)
}

/// Reads `"estimate"`, `"as captured"` or a factor.
fn read_lamps(fields: &FieldTable) -> Option<LampRule> {
    match fields.value("lamps")? {
        Value::String(_) => match fields.word("lamps", &["estimate", "as captured"])? {
            0 => Some(LampRule::Estimate),
            _ => Some(LampRule::AsCaptured),
        },
        _ => {
            let factor = fields
                .number_in("lamps", "from 1 to 1e6, \"estimate\" or \"as captured\"", |v| (1.0..=1e6).contains(&v));
            factor.map(|factor| LampRule::Factor(factor as f32))
        }
    }
}

/// Reads `"file"` or `{ file = "…", layer = "…" }`.
fn read_file(fields: &FieldTable, key: &str) -> Option<(PathBuf, Option<String>)> {
    let (path, layer) = match fields.value(key)? {
        Value::Table(_) => {
            let table = fields.table(key, &["file", "layer"])?;
            if !table.has("file") {
                table.complain("file", "is missing", "name the image");
            }
            (table.file_path("file")?, table.string("layer").map(str::to_owned))
        }
        _ => (fields.file_path(key)?, None),
    };
    Some((path, layer))
}

fn read_depth(fields: &FieldTable, packing: Packing, position: Vec3) -> Option<(DepthSource, Option<String>)> {
    if packing != Packing::Separate {
        if fields.has("depth") {
            fields.complain("depth", "the colour image already holds the depth", "leave depth out, or packing");
        }
        return Some((DepthSource::Packed, None));
    }
    match fields.value("depth") {
        None => {
            fields.complain("depth", "is missing", "name the depth image, or give a radius or a box");
            None
        }
        Some(Value::Table(table)) if table.contains_key("file") => {
            read_file(fields, "depth").map(|(path, layer)| (DepthSource::Files(path), layer))
        }
        Some(Value::String(_)) => read_file(fields, "depth").map(|(path, _)| (DepthSource::Files(path), None)),
        Some(Value::Integer(_) | Value::Float(_)) => {
            let radius = fields.number_in("depth", "above 0 (metres)", |v| v > 0.0 && v < 1e9)?;
            Some((DepthSource::Sphere(radius as f32), None))
        }
        Some(Value::Table(_)) => {
            let table = fields.table("depth", &["box", "center"])?;
            if !table.has("box") {
                table.complain("box", "is missing", "give the box's full extents in metres");
            }
            let size = vec3(table.vector("box")?);
            let center = table.vector("center").map_or(position, vec3);
            if size.min_element() <= 0.0 {
                table.complain("box", "is not positive", "give the box's full extents in metres");
            } else if ((position - center).abs() - 0.5 * size).max_element() >= 0.0 {
                table.complain("box", "the capture point lies outside the box", "check box, center and position");
            }
            Some((DepthSource::Box { size, center }, None))
        }
        Some(_) => {
            let remedy = "give a file, { file = \"…\", layer = \"…\" }, a radius in metres, or { box = [x, y, z], center = [x, y, z] }";
            fields.complain("depth", "is neither file, number nor box", remedy);
            None
        }
    }
}

fn read_frames(fields: &FieldTable) -> Option<FrameRange> {
    let range = match fields.integers("frames")?[..] {
        [first, last] => FrameRange { first, last, step: 1 },
        [first, last, step] => FrameRange { first, last, step },
        _ => FrameRange { first: 1, last: 0, step: 1 },
    };
    let remedy = "write [first, last] or [first, last, step], last included";
    if range.first > range.last || range.step == 0 {
        fields.complain("frames", "is no range", remedy);
        return None;
    }
    if (range.last - range.first) / range.step >= MAX_FRAMES {
        fields.complain("frames", format!("has more than {MAX_FRAMES} frames"), "give a shorter range");
        return None;
    }
    Some(range)
}
