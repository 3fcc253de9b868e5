//! Scene truths that are stored in a folder: pictures by an independent renderer, in two halves.
//!
//! `index.json` names each picture, what it shows, what made it, and the content of its scene
//! ([`CompleteScene::content`]). A picture is taken only for a scene of that content.
//! `tests/mitsuba/truth.py` makes the pictures.

use super::cache::Truth;
use crate::{
    Error, Result,
    image_file::{
        ExrLayer,
        read::{FileImage, read, read_bytes},
        write::write_bytes,
    },
    scene::CompleteScene,
};
use serde::{Deserialize, Serialize};
use std::path::{Path, PathBuf};

const INDEX: &str = "index.json";
/// The layers of the halves.
const HALVES: [&str; 2] = ["a", "b"];

/// A stored picture.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct StoredTruth {
    /// The picture's file name.
    pub file: String,
    /// A built-in room, or a scene file within the test data.
    pub scene: String,
    /// Whether the virtual objects are in it.
    pub objects: bool,
    /// What it shows of the scene, seconds.
    pub time: f64,
    /// Width and height, pixels.
    pub size: [u32; 2],
    /// The renderer and its version.
    pub made_by: String,
    /// Samples a pixel, both halves together.
    pub samples: u32,
    /// FLIP between the halves, at the scene's exposure, over the whole picture.
    #[serde(default)]
    pub noise: f64,
    /// [`CompleteScene::content`].
    #[serde(default)]
    pub content: String,
}

/// A folder of stored truths.
#[derive(Clone, Debug)]
pub struct StoredTruths {
    folder: PathBuf,
    /// What is in the folder.
    pub list: Vec<StoredTruth>,
}

impl StoredTruths {
    /// Reads the list of a folder.
    ///
    /// # Errors
    /// Fails if the folder has no `index.json`, or if that is damaged.
    pub fn open(folder: &Path) -> Result<Self> {
        let path = folder.join(INDEX);
        let list = serde_json::from_slice(&read_bytes(&path)?).map_err(|error| {
            Error::input(
                path.display(),
                format!("is no list of truths: {error}"),
                "write it again, or name another folder",
            )
        })?;
        Ok(Self { folder: folder.to_owned(), list })
    }

    /// Writes the list.
    ///
    /// # Errors
    /// Fails if the file cannot be written.
    pub fn save(&self) -> Result<()> {
        let mut text = serde_json::to_vec_pretty(&self.list).map_err(|error| Error::Internal(error.to_string()))?;
        text.push(b'\n');
        write_bytes(&self.folder.join(INDEX), &text)
    }

    /// Returns the truth of a scene at a time in seconds, seen by its own camera in perspective, and what made
    /// it. The result is `None` if none is stored for this very scene and size.
    ///
    /// # Errors
    /// Fails if the picture is listed and cannot be read.
    pub fn find(&self, scene: &CompleteScene, size: [u32; 2], time: f64) -> Result<Option<(Truth, &str)>> {
        let fits = |stored: &&StoredTruth| {
            stored.content == scene.content && stored.size == size && scene.is_the_same_at(stored.time, time)
        };
        let Some(stored) = self.list.iter().find(fits) else { return Ok(None) };
        Ok(Some((self.read(stored)?, &stored.made_by)))
    }

    /// Reads a picture of the list.
    ///
    /// # Errors
    /// Fails if the picture cannot be read or has another size than the list says.
    pub fn read(&self, stored: &StoredTruth) -> Result<Truth> {
        let path = self.folder.join(&stored.file);
        let wrong = |problem: &str| Error::input(path.display(), problem, "make it again with tests/mitsuba/truth.py");
        let FileImage::Exr(exr) = read(&path)? else { return Err(wrong("is no EXR")) };
        let (size, halves) = halves(&exr.layers).ok_or_else(|| wrong("has no layers a and b of R, G and B"))?;
        if size != stored.size {
            return Err(wrong(&format!("is {}×{}, which index.json does not say", size[0], size[1])));
        }
        Ok(Truth { size, radiance: mean(&halves), halves, spp: stored.samples, outliers: 0.0 })
    }
}

/// Two independent pictures of the same, RGBA, row 0 on top.
pub type Halves = [Vec<[f32; 4]>; 2];

/// Returns the size and the two halves of a truth that is stored in layers `a` and `b`.
pub fn halves(layers: &[ExrLayer]) -> Option<([u32; 2], Halves)> {
    let of = |name: &str| {
        let layer = layers.iter().find(|layer| layer.name == name)?;
        let [r, g, b] = ["R", "G", "B"].map(|channel| layer.channel(channel));
        let texels = r?.iter().zip(g?).zip(b?).map(|((r, g), b)| [*r, *g, *b, 1.0]).collect();
        Some((layer.size, texels))
    };
    let [(size, a), (other, b)] = [of(HALVES[0])?, of(HALVES[1])?];
    (size == other).then_some((size, [a, b]))
}

/// Returns the mean of two halves.
pub fn mean([a, b]: &Halves) -> Vec<[f32; 4]> {
    a.iter().zip(b).map(|(a, b)| std::array::from_fn(|c| 0.5 * (a[c] + b[c]))).collect()
}
