//! What cameras, data sets and estimators write as depth, by name.

use super::depth::{DepthEncoding, Rule};
use std::fmt::Write as _;

/// A row of the table.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Preset {
    pub name: &'static str,
    pub encoding: DepthEncoding,
    /// `None` if the depth is relative.
    pub scale: Option<f64>,
    /// Codes that are holes.
    pub invalid: &'static [f64],
    /// What is written.
    pub stores: &'static str,
    /// Who says so.
    pub source: &'static str,
}

use DepthEncoding::{Disparity, Planar, Radial};

/// All presets.
pub const PRESETS: &[Preset] = &[
    Preset {
        name: "kandao",
        encoding: Disparity,
        scale: Some(255.0),
        invalid: &[0.0],
        stores: "8-bit disparity; metres are 255/v",
        source: "the captures of juniorxsound/THREE.SixDOF, whose floors it makes level",
    },
    Preset {
        name: "dap",
        encoding: Radial,
        scale: Some(100.0),
        invalid: &[0.0],
        stores: "NPY: distance as a share of 100 m",
        source: "Depth Any Panoramas: `test/infer.py` clamps to 1, the paper's ranges end at 100 m",
    },
    Preset {
        name: "moge",
        encoding: Radial,
        scale: None,
        invalid: &[0.0],
        stores: "`depth.exr` of `infer_panorama.py`: relative distance; its `mask.png` fits `mask`",
        source: "microsoft/MoGe, `moge/scripts/infer_panorama.py`",
    },
    Preset {
        name: "depth-anything",
        encoding: Disparity,
        scale: None,
        invalid: &[],
        stores: "`run.py --grayscale --pred-only`: relative disparity, stretched to 0…255",
        source: "DepthAnything/Depth-Anything-V2, `run.py`",
    },
    Preset {
        name: "stanford2d3d",
        encoding: Radial,
        scale: Some(1.0 / 512.0),
        invalid: &[0.0, 65535.0],
        stores: "16-bit PNG: distance, 512 steps a metre, 65535 where it is missing",
        source: "alexsax/2D-3D-Semantics, README",
    },
    Preset {
        name: "structured3d",
        encoding: Radial,
        scale: Some(0.001),
        invalid: &[0.0],
        stores: "16-bit PNG: millimetres",
        source: "bertjiazheng/Structured3D, `data_organization.md`",
    },
    Preset {
        name: "matterport",
        encoding: Radial,
        scale: Some(0.000_25),
        invalid: &[0.0],
        stores: "16-bit PNG: 4000 steps a metre. Its own six views hold depth along their axes: `encoding = \"planar\"`",
        source: "niessner/Matterport, `data_organization.md`",
    },
    Preset {
        name: "replica",
        encoding: Planar,
        scale: Some(1.0 / 6553.5),
        invalid: &[0.0],
        stores: "16-bit PNG of the faces of a cube: depth along the axis, 6553.5 steps a metre",
        source: "facebookresearch/Replica-Dataset, `ReplicaSDK/src/render.cpp`",
    },
];

impl Preset {
    /// Returns the preset of this name.
    pub fn named(name: &str) -> Option<&'static Self> {
        PRESETS.iter().find(|preset| preset.name == name)
    }

    /// Returns the rule; relative depth gets the scale 1.
    pub fn rule(&self) -> Rule {
        let (encoding, scale) = (self.encoding, self.scale.unwrap_or(1.0));
        Rule { encoding, scale, offset: 0.0, invalid: self.invalid.to_vec() }
    }

    /// Returns the table of all presets for the documents.
    pub fn markdown() -> String {
        let mut text =
            "| `depth_preset` | is written | `encoding` | `scale` | source |\n|---|---|---|---|---|\n".to_owned();
        for preset in PRESETS {
            let scale = preset.scale.map_or("to be given".to_owned(), |scale| format!("{scale:.9}"));
            let scale = if scale.contains('.') { scale.trim_end_matches('0').trim_end_matches('.') } else { &scale };
            let Preset { name, stores, source, .. } = preset;
            let _ = writeln!(text, "| `\"{name}\"` | {stores} | {} | {scale} | {source} |", preset.encoding.word());
        }
        text
    }
}
