//! Which channels of an OpenEXR file hold the colour, and which the depth: by what their names mean, not by
//! their order. A layer can be named, too.

use super::{ExrLayer, exr_file::list};
use crate::{Error, Result};

/// Which channels were taken, and what else there was.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Taken {
    /// The channels, as `ViewLayer.Combined.R, G, B`.
    pub channels: String,
    /// Other layers or channels that could have been meant.
    pub others: Vec<String>,
    /// Whether names alone did not tell.
    pub unsure: bool,
}

impl Taken {
    /// Says it in a line, with the line to write where the choice was not clear.
    pub fn note(&self, key: &str) -> String {
        let others = match self.others.as_slice() {
            [] => return format!("{key} is its {}", self.channels),
            others => others.iter().take(8).cloned().collect::<Vec<_>>().join(", "),
        };
        let remedy =
            if self.unsure { format!(" (write {key} = {{ file = \"…\", layer = \"…\" }})") } else { String::new() };
        format!("{key} is its {}; also there: {others}{remedy}", self.channels)
    }
}

/// Words that name the finished picture.
const BEAUTY: [&str; 12] = [
    "combined",
    "beauty",
    "final",
    "effects",
    "main",
    "rgb",
    "rgba",
    "color",
    "colour",
    "composite",
    "image",
    "radiance",
];
/// Words that name something else than the finished picture or the depth.
const PARTS: [&str; 47] = [
    "ao",
    "occlusion",
    "normal",
    "normals",
    "n",
    "p",
    "position",
    "crypto",
    "uv",
    "st",
    "albedo",
    "diffuse",
    "diff",
    "glossy",
    "gloss",
    "specular",
    "spec",
    "reflection",
    "refraction",
    "transmission",
    "shadow",
    "motion",
    "vector",
    "velocity",
    "mist",
    "emit",
    "emission",
    "env",
    "environment",
    "volume",
    "denoising",
    "direct",
    "indirect",
    "sss",
    "id",
    "index",
    "mask",
    "matte",
    "variance",
    "raw",
    "gi",
    "global",
    "illumination",
    "lighting",
    "noisy",
    "confidence",
    "conf",
];
const DEPTH: [&str; 5] = ["depth", "distance", "dist", "z", "range"];

/// Says whether a name has one of these words. It is split where its case changes, and at other signs.
fn has_word(name: &str, words: &[&str]) -> bool {
    let mut parts = vec![String::new()];
    let mut lower = false;
    for letter in name.chars() {
        if !letter.is_alphabetic() || (letter.is_uppercase() && lower) {
            parts.push(String::new());
        }
        lower = letter.is_lowercase();
        if let (true, Some(part)) = (letter.is_alphabetic(), parts.last_mut()) {
            part.extend(letter.to_lowercase());
        }
    }
    // Cryptomatte's layers are numbered, and passes are called DiffCol or NormalPass.
    let known = |part: &String| words.iter().any(|word| part == word || (word.len() > 3 && part.starts_with(word)));
    parts.iter().any(known)
}

fn leaf(name: &str) -> &str {
    name.rsplit('.').next().unwrap_or(name)
}

/// Three channels of a layer that hold red, green and blue, or luminance and chroma, or one that holds grey.
fn rgb(layer: &ExrLayer) -> Option<[usize; 3]> {
    let find = |names: &[&str]| {
        layer.channels.iter().position(|(channel, _)| names.iter().any(|name| channel.eq_ignore_ascii_case(name)))
    };
    let three = [find(&["R", "red"]), find(&["G", "green"]), find(&["B", "blue"])];
    match (three, [find(&["RY"]), find(&["Y"]), find(&["BY"])]) {
        ([Some(r), Some(g), Some(b)], _) => Some([r, g, b]),
        (_, [Some(ry), Some(y), Some(by)]) => Some([ry, y, by]),
        (_, [_, y, _]) => y.map(|y| [y; 3]),
    }
}

/// Says whether the three channels of a colour are RY, Y and BY.
pub(super) fn is_chroma(layer: &ExrLayer, channels: [usize; 3]) -> bool {
    channels[0] != channels[1] && layer.channels[channels[0]].0.eq_ignore_ascii_case("RY")
}

fn full(layer: &ExrLayer, channel: &str) -> String {
    if layer.name.is_empty() { channel.to_owned() } else { format!("{}.{channel}", layer.name) }
}

/// Says whether a layer is the one that is asked for, by its whole name or the end of it.
fn is_called(name: &str, wanted: &str) -> bool {
    let (name, wanted) = (name.to_lowercase(), wanted.to_lowercase());
    name == wanted || name.ends_with(&format!(".{wanted}"))
}

fn no_such(layers: &[ExrLayer], wanted: &str, subject: &str) -> Error {
    let mut names: Vec<String> = Vec::new();
    for layer in layers {
        names.push(layer.name.clone());
        names.extend(layer.channels.iter().map(|(channel, _)| full(layer, channel)));
    }
    let names: Vec<&str> = names.iter().map(String::as_str).filter(|name| !name.is_empty()).take(20).collect();
    let problem = format!("has no layer \"{wanted}\" that can be used");
    Error::input(subject, problem, format!("choose from {}", names.join(", ")))
}

/// Returns the layer and channels that hold the colour.
///
/// # Errors
/// Fails if there are none. The error lists what there is.
pub(super) fn color(layers: &[ExrLayer], wanted: Option<&str>, subject: &str) -> Result<(usize, [usize; 3], Taken)> {
    // The main layer is the finished picture. Grey alone is less likely to be one.
    let rank = |layer: &ExrLayer, channels: [usize; 3]| {
        let grey = usize::from(channels[0] == channels[1]);
        let name = leaf(&layer.name);
        let meaning = match () {
            () if layer.name.is_empty() => 0,
            () if has_word(name, &PARTS) || has_word(name, &DEPTH) => 6,
            () if has_word(name, &BEAUTY) => 2,
            () => 4,
        };
        meaning + grey
    };
    let mut found: Vec<(usize, usize, [usize; 3])> = layers
        .iter()
        .enumerate()
        .filter(|(_, layer)| wanted.is_none_or(|wanted| is_called(&layer.name, wanted)))
        .filter_map(|(index, layer)| rgb(layer).map(|channels| (rank(layer, channels), index, channels)))
        .collect();
    found.sort_by_key(|(rank, index, _)| (*rank, *index));
    let Some(&(best, index, channels)) = found.first() else {
        return Err(match wanted {
            Some(wanted) => no_such(layers, wanted, subject),
            None => {
                let problem = format!("has no R, G, B nor Y channel, but {}", list(layers));
                Error::input(subject, problem, "write the colour as channels R, G, B")
            }
        });
    };
    let layer = &layers[index];
    let mut names: Vec<&str> = channels.iter().map(|channel| layer.channels[*channel].0.as_str()).collect();
    names.dedup();
    let others: Vec<String> = found[1..].iter().map(|(_, index, _)| layers[*index].name.clone()).collect();
    let same_rank = found.get(1).is_some_and(|(rank, ..)| *rank == best);
    let unsure = wanted.is_none() && !others.is_empty() && (best >= 4 || same_rank);
    Ok((index, channels, Taken { channels: full(layer, &names.join(", ")), others, unsure }))
}

/// Returns the layer and channel that hold the depth.
///
/// # Errors
/// Fails if there is none. The error lists what there is.
pub(super) fn depth(layers: &[ExrLayer], wanted: Option<&str>, subject: &str) -> Result<(usize, usize, Taken)> {
    let count: usize = layers.iter().map(|layer| layer.channels.len()).sum();
    let rank = |layer: &ExrLayer, channel: &str| -> Option<usize> {
        let name = leaf(&layer.name);
        let (is_part, single, main) = (has_word(name, &PARTS), layer.channels.len() == 1, layer.name.is_empty());
        let in_depth_layer = has_word(name, &DEPTH);
        // What is taken for a colour is depth only where there is nothing else.
        let in_color = rgb(layer).is_some_and(|all| all[0] != all[1]);
        let has = |wanted: &str| layer.channels.iter().any(|(channel, _)| channel.eq_ignore_ascii_case(wanted));
        let is_vector = ["x", "y", "z"].into_iter().all(has);
        let lower = channel.to_lowercase();
        Some(match lower.as_str() {
            "a" => return None,
            "z" | "v" | "y" | "r" | "x" | "d" | "t" if in_depth_layer => {
                if is_part {
                    6
                } else {
                    0
                }
            }
            _ if in_depth_layer && single && !is_part => 0,
            "z" if main || (single && !is_part) => 0,
            _ if has_word(channel, &DEPTH[..2]) => {
                if is_part || has_word(channel, &PARTS) {
                    6
                } else {
                    1
                }
            }
            _ if count == 1 => 1,
            "d" | "pz" if main => 2,
            "y" if main && !in_color => 2,
            // X, Y and Z are a position or a normal.
            "x" | "y" if is_vector => return None,
            "z" if is_vector && !is_part => 8,
            "z" | "y" | "v" if !is_part && !in_color => 3,
            "z" if !is_part => 3,
            "r" if in_color && (main || !is_part) => 9,
            "r" if main => 4,
            "r" if !is_part => 5,
            "g" | "b" | "y" | "ry" | "by" | "red" | "green" | "blue" => return None,
            _ if (main || single) && !is_part && !has_word(channel, &PARTS) => 7,
            _ => return None,
        })
    };
    let mut found: Vec<(usize, usize, usize)> = Vec::new();
    for (index, layer) in layers.iter().enumerate() {
        for (place, (channel, _)) in layer.channels.iter().enumerate() {
            let rank = match wanted {
                None => rank(layer, channel),
                Some(wanted) if is_called(&full(layer, channel), wanted) => Some(0),
                Some(wanted) if is_called(&layer.name, wanted) => {
                    Some(rank(layer, channel).map_or(10, |rank| rank + 1))
                }
                Some(_) => None,
            };
            found.extend(rank.map(|rank| (rank, index, place)));
        }
    }
    // Of channels of a layer that could be meant alike, Z.
    let is_other = |layer: usize, place: usize| !layers[layer].channels[place].0.eq_ignore_ascii_case("z");
    found.sort_by_key(|&(rank, layer, place)| (rank, layer, is_other(layer, place), place));
    let Some(&(best, index, place)) = found.first() else {
        return Err(match wanted {
            Some(wanted) => no_such(layers, wanted, subject),
            None => {
                let problem = format!("has no channel Y, Z, R or depth, but {}", list(layers));
                Error::input(subject, problem, "write the depth as channel Y")
            }
        });
    };
    let others: Vec<String> =
        found[1..].iter().map(|(_, index, place)| full(&layers[*index], &layers[*index].channels[*place].0)).collect();
    // Channels of one depth layer hold the same.
    let rival = |&(rank, layer, _): &(usize, usize, usize)| rank == best && (best > 0 || layer != index);
    let unsure = wanted.is_none() && (best >= 4 || found.get(1).is_some_and(rival)) && count > 1;
    let channels = full(&layers[index], &layers[index].channels[place].0);
    Ok((index, place, Taken { channels, others, unsure }))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn layers(names: &[&str]) -> Vec<ExrLayer> {
        let mut layers: Vec<ExrLayer> = Vec::new();
        for name in names {
            let (owner, channel) = name.rsplit_once('.').unwrap_or(("", name));
            let entry = (channel.to_owned(), vec![0.0]);
            match layers.iter_mut().find(|layer| layer.name == owner) {
                Some(layer) => layer.channels.push(entry),
                None => layers.push(ExrLayer { name: owner.to_owned(), size: [1, 1], channels: vec![entry] }),
            }
        }
        layers
    }

    #[test]
    fn colour_is_what_names_mean() {
        for (names, right) in [
            (
                &[
                    "ViewLayer.AO.R",
                    "ViewLayer.AO.G",
                    "ViewLayer.AO.B",
                    "ViewLayer.Combined.R",
                    "ViewLayer.Combined.G",
                    "ViewLayer.Combined.B",
                ][..],
                "ViewLayer.Combined.R, G, B",
            ),
            (&["albedo.R", "albedo.G", "albedo.B", "R", "G", "B"], "R, G, B"),
            (
                &[
                    "CryptoObject00.r",
                    "CryptoObject00.g",
                    "CryptoObject00.b",
                    "beauty.red",
                    "beauty.green",
                    "beauty.blue",
                ],
                "beauty.red, green, blue",
            ),
            (
                &[
                    "RenderLayer.DiffCol.R",
                    "RenderLayer.DiffCol.G",
                    "RenderLayer.DiffCol.B",
                    "left.R",
                    "left.G",
                    "left.B",
                ],
                "left.R, G, B",
            ),
            (&["Y"], "Y"),
            (&["RY", "Y", "BY"], "RY, Y, BY"),
            (
                &["aaa_raw.R", "aaa_raw.G", "aaa_raw.B", "final_render.R", "final_render.G", "final_render.B"],
                "final_render.R, G, B",
            ),
            (
                &["GI.R", "GI.G", "GI.B", "effectsResult.R", "effectsResult.G", "effectsResult.B"],
                "effectsResult.R, G, B",
            ),
        ] {
            let found = color(&layers(names), None, "f").map(|(.., taken)| taken.channels);
            assert_eq!(found.expect("found"), right, "{names:?}");
        }
        let two = layers(&["a.R", "a.G", "a.B", "b.R", "b.G", "b.B"]);
        let (index, _, taken) = color(&two, None, "f").expect("found");
        assert!(index == 0 && taken.unsure && taken.note("color").contains("also there: b (write color = {"));
        assert_eq!(color(&two, Some("B"), "f").expect("found").0, 1);
        assert!(color(&two, Some("c"), "f").expect_err("refused").to_string().contains("choose from a, a.R"));
    }

    #[test]
    fn depth_is_what_names_mean() {
        for (names, right) in [
            (
                &["ViewLayer.Depth.Z", "ViewLayer.Normal.X", "ViewLayer.Normal.Y", "ViewLayer.Normal.Z"][..],
                "ViewLayer.Depth.Z",
            ),
            (&["ViewLayer.Combined.R", "ViewLayer.Depth.V"], "ViewLayer.Depth.V"),
            (&["R", "G", "B", "Z"], "Z"),
            (&["R", "G", "B", "distance"], "distance"),
            (&["depth"], "depth"),
            (&["T"], "T"),
            (&["Y"], "Y"),
            (&["P.X", "P.Y", "P.Z", "main.Z"], "main.Z"),
            (&["ViewLayer.Denoising Depth.V", "ViewLayer.Depth.V"], "ViewLayer.Depth.V"),
            (
                &["Z_normal.x", "Z_normal.y", "Z_normal.z", "combined.r", "combined.g", "combined.b", "depth.z"],
                "depth.z",
            ),
            (&["R", "G", "B", "depth.T"], "depth.T"),
            (&["R", "G", "B", "D"], "D"),
            (&["C.r", "C.g", "C.b", "Pz", "N.x", "N.y", "N.z"], "Pz"),
            (&["R", "G", "B", "dd"], "dd"),
            (&["R", "G", "B"], "R"),
            (&["depth_confidence", "depth"], "depth"),
        ] {
            let found = depth(&layers(names), None, "f").map(|(.., taken)| taken.channels);
            assert_eq!(found.expect("found"), right, "{names:?}");
        }
        for names in [&["R", "G", "B", "dd"][..], &["a.Depth.V", "b.Depth.V"], &["left.Z", "right.Z"]] {
            let (.., taken) = depth(&layers(names), None, "f").expect("found");
            assert!(taken.unsure, "{names:?}");
        }
        let normals = layers(&["N.X", "N.Y", "N.Z"]);
        assert!(depth(&normals, None, "f").is_err());
        assert_eq!(depth(&normals, Some("N.Z"), "f").expect("found").1, 2);
    }
}
