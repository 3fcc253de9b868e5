//! Cubemaps: pictures of the six faces of a cube about the capture point, in one image or in six files, which are
//! sampled anew as an equirectangular panorama.
//!
//! Faces are seen from inside and come in the order right, left, up, down, front, back, as +X, −X, +Y, −Y, +Z, −Z
//! of OpenGL. Up and down continue the front.

use super::mapping::texel_direction;
use crate::{
    Error, Result, budget,
    image_file::{CodeImage, ColorImage, FileImage, Samples, read},
};
use glam::{DVec3, Vec4};
use rayon::prelude::*;
use std::path::{Path, PathBuf};

/// What stands for the face in the name of six files.
const FACE: &str = "{face}";

/// The words for right, left, up, down, front and back in the names of files.
const WORDS: [[&str; 6]; 5] = [
    ["px", "nx", "py", "ny", "pz", "nz"],
    ["posx", "negx", "posy", "negy", "posz", "negz"],
    ["right", "left", "up", "down", "front", "back"],
    ["right", "left", "top", "bottom", "front", "back"],
    ["r", "l", "u", "d", "f", "b"],
];

/// Where the faces are in a picture.
#[derive(Clone, Copy, Debug, PartialEq)]
struct Layout {
    side: u32,
    /// Column and row of each face, counted in faces.
    at: [[u32; 2]; 6],
    /// Whether the back is upside down, as where a vertical cross is folded.
    back_is_turned: bool,
}

impl Layout {
    /// Tells it by the shape of the picture.
    fn of([width, height]: [u32; 2]) -> Option<Self> {
        let cross = |back: [u32; 2]| [[2, 1], [0, 1], [1, 0], [1, 2], [1, 1], back];
        let grid = |columns: u32| std::array::from_fn(|face| [face as u32 % columns, face as u32 / columns]);
        let kinds = [
            ([4, 3], cross([3, 1]), false),
            ([3, 4], cross([1, 3]), true),
            ([6, 1], grid(6), false),
            ([3, 2], grid(3), false),
            ([1, 6], grid(1), false),
        ];
        let (side, at, back_is_turned) = kinds.into_iter().find_map(|([columns, rows], at, turned)| {
            let side = width / columns;
            (side > 0 && [side * columns, side * rows] == [width, height]).then_some((side, at, turned))
        })?;
        Some(Self { side, at, back_is_turned })
    }

    /// The face that a direction of the panorama meets, and where in texels from its upper left corner.
    fn place(&self, direction: DVec3) -> (usize, [f64; 2]) {
        let DVec3 { x, y, z } = direction;
        let size = direction.abs();
        let (face, [right, down]) = match size.max_element() {
            most if most == size.z && z < 0.0 => (4, [x, -y]),
            most if most == size.z => (5, [-x, -y]),
            most if most == size.x && x > 0.0 => (0, [z, -y]),
            most if most == size.x => (1, [-z, -y]),
            _ if y > 0.0 => (2, [x, -z]),
            _ => (3, [x, z]),
        };
        let side = f64::from(self.side);
        (face, [right, down].map(|value| 0.5 * (value / size.max_element() + 1.0) * side))
    }

    /// The number of a face's texel in the picture. Beyond the edge of the face it is the last one.
    fn texel(&self, face: usize, [x, y]: [i64; 2]) -> usize {
        let last = i64::from(self.side) - 1;
        let [mut x, mut y] = [x, y].map(|value| value.clamp(0, last));
        if face == 5 && self.back_is_turned {
            [x, y] = [last - x, last - y];
        }
        let columns = self.at.map(|[column, _]| column).into_iter().max().unwrap_or(0) + 1;
        let [column, row] = self.at[face].map(|place| u64::from(place * self.side));
        ((row + y as u64) * u64::from(columns * self.side) + column + x as u64) as usize
    }

    /// Makes a panorama of what `sample` returns for a face and a place in it.
    fn panorama<T: Send>(&self, sample: impl Fn(usize, [f64; 2]) -> T + Sync) -> ([u32; 2], Vec<T>) {
        let size = [4 * self.side, 2 * self.side];
        let texel = |index: usize| {
            let direction = texel_direction(index as u32 % size[0], index as u32 / size[0], size);
            let (face, place) = self.place(direction);
            sample(face, place)
        };
        (size, (0..size[0] as usize * size[1] as usize).into_par_iter().map(texel).collect())
    }
}

/// Says whether an image is a panorama already.
fn is_panorama([width, height]: [u32; 2]) -> bool {
    width == 2 * height
}

/// Says whether an image of this size can be a cubemap.
pub(super) fn is_cube(size: [u32; 2]) -> bool {
    Layout::of(size).is_some()
}

/// Says whether an image seems to be a cubemap: it has the shape of one, and nothing beside the arms of a cross.
pub fn seems_one(image: &ColorImage) -> bool {
    let [width, height] = image.size;
    let Some(Layout { side, .. }) = Layout::of(image.size) else { return false };
    if ![[4, 3], [3, 4]].contains(&[width / side, height / side]) {
        return true;
    }
    let inner = side / 8..side - side / 8;
    let corner = inner.clone().flat_map(|y| inner.clone().map(move |x| (y * width + x) as usize));
    let texels = corner.map(|index| Vec4::from(image.texels[index]));
    let (low, high) = texels.fold((Vec4::INFINITY, Vec4::NEG_INFINITY), |(low, high), t| (low.min(t), high.max(t)));
    (high - low).max_element() < 0.02
}

fn layout(size: [u32; 2], subject: &str) -> Result<Layout> {
    let layout = Layout::of(size).ok_or_else(|| {
        let problem = format!("is {}x{}, no shape of a cubemap", size[0], size[1]);
        Error::input(subject, problem, "give a cross (4:3 or 3:4), a strip (6:1 or 1:6), or rows of three (3:2)")
    })?;
    // Eight texels of a panorama for each of a face, in 16 bytes.
    budget::ask(subject, u64::from(layout.side).pow(2) * 8 * 16)?;
    Ok(layout)
}

/// Returns the panorama that a cubemap shows, bilinear within its faces, with four faces' sides around.
///
/// # Errors
/// Fails if the image has not the shape of a cubemap.
pub(super) fn color(image: ColorImage, subject: &str) -> Result<ColorImage> {
    let layout = layout(image.size, subject)?;
    let sample = |face: usize, place: [f64; 2]| {
        let [x, y] = place.map(|value| value - 0.5);
        let (left, top) = (x.floor(), y.floor());
        let texel =
            |dx: i64, dy: i64| Vec4::from(image.texels[layout.texel(face, [left as i64 + dx, top as i64 + dy])]);
        let (right, down) = ((x - left) as f32, (y - top) as f32);
        let mixed = texel(0, 0).lerp(texel(1, 0), right).lerp(texel(0, 1).lerp(texel(1, 1), right), down);
        if mixed.w > 0.999 { mixed.truncate().extend(1.0).to_array() } else { [0.0; 4] }
    };
    let (size, texels) = layout.panorama(sample);
    Ok(ColorImage { size, texels, ..image })
}

/// The same of codes, of which the nearest is taken. A panorama stays what it is.
///
/// # Errors
/// Fails if the image has the shape of neither.
pub fn codes(image: CodeImage, subject: &str) -> Result<CodeImage> {
    if is_panorama(image.size) {
        return Ok(image);
    }
    let layout = layout(image.size, subject)?;
    let nearest =
        |face: usize, place: [f64; 2]| image.codes[layout.texel(face, place.map(|value| value.floor() as i64))];
    let (size, codes) = layout.panorama(nearest);
    Ok(CodeImage { size, codes, ..image })
}

/// Says whether a path stands for six files.
pub fn has_faces(path: &Path) -> bool {
    path.file_name().is_some_and(|name| name.to_string_lossy().contains(FACE))
}

/// The six files that a path with `{face}` stands for.
///
/// # Errors
/// Fails if there are no six files of the same kind of names.
pub(super) fn files(path: &Path) -> Result<[PathBuf; 6]> {
    let name = path.file_name().unwrap_or_default().to_string_lossy();
    let of = |words: [String; 6]| words.map(|word| path.with_file_name(name.replace(FACE, &word)));
    let capital = |word: &str| word[..1].to_uppercase() + &word[1..];
    let ways = WORDS.iter().flat_map(|words| {
        [words.map(str::to_owned), words.map(capital), words.map(str::to_uppercase)].into_iter().map(of)
    });
    ways.clone().find(|files| files.iter().all(|file| file.exists())).ok_or_else(|| {
        // The set of which most is there was meant.
        let there = |files: &[PathBuf; 6]| files.iter().filter(|file| file.exists()).count();
        let meant = ways.max_by_key(there).filter(|files| there(files) > 0);
        let missing = meant.iter().flatten().find(|file| !file.exists());
        let words = WORDS.map(|words| words.join(" ")).join("; ");
        match missing {
            Some(file) => Error::input(file.display(), "there is no such file", "give all six faces"),
            None => Error::input(path.display(), "no six files fit {face}", format!("name them by: {words}")),
        }
    })
}

/// The path with `{face}` that stands for this file and its five siblings, if it has them.
pub fn siblings(path: &Path) -> Option<PathBuf> {
    let stem = path.file_stem()?.to_string_lossy().into_owned();
    let extension = path.extension().map(|end| format!(".{}", end.to_string_lossy())).unwrap_or_default();
    let words = WORDS.iter().flatten().filter(|word| stem.to_lowercase().ends_with(*word));
    words
        .filter_map(|word| stem.get(..stem.len().checked_sub(word.len())?))
        .map(|start| path.with_file_name(format!("{start}{FACE}{extension}")))
        .find(|path| files(path).is_ok_and(|files| files.iter().any(|file| file.file_stem() == Some(stem.as_ref()))))
}

/// Reads an image, of six files if its path says so.
///
/// # Errors
/// Fails if a file is missing, or cannot be read, or if the six are of different kinds.
pub(super) fn read(path: &Path) -> Result<FileImage> {
    if !has_faces(path) {
        return read::read(path);
    }
    let mut images = Vec::with_capacity(6);
    for file in files(path)? {
        images.push(read::read(&file)?);
    }
    let mut images = images.into_iter();
    let first = images.next().ok_or_else(|| Error::Internal("a cube without faces".into()))?;
    images.try_fold(first, below).ok_or_else(|| {
        Error::input(path.display(), "its six faces differ in size or in kind", "write them in the same way")
    })
}

/// Puts an image below another one of the same width.
fn below(upper: FileImage, lower: FileImage) -> Option<FileImage> {
    let height = |upper: &mut [u32; 2], lower: [u32; 2]| {
        upper[1] += lower[1];
        (upper[0] == lower[0]).then_some(())
    };
    match (upper, lower) {
        (FileImage::Raster(mut upper), FileImage::Raster(lower)) => {
            height(&mut upper.size, lower.size)?;
            match (&mut upper.samples, lower.samples) {
                (Samples::U8(all), Samples::U8(more)) => all.extend(more),
                (Samples::U16(all), Samples::U16(more)) => all.extend(more),
                (Samples::F32(all), Samples::F32(more)) => all.extend(more),
                _ => return None,
            }
            (upper.channels == lower.channels && upper.color == lower.color).then_some(FileImage::Raster(upper))
        }
        (FileImage::Exr(mut upper), FileImage::Exr(lower)) => {
            for layer in &mut upper.layers {
                let other = lower.layers.iter().find(|other| other.name == layer.name)?;
                height(&mut layer.size, other.size)?;
                for (name, values) in &mut layer.channels {
                    values.extend(other.channel(name)?);
                }
            }
            Some(FileImage::Exr(upper))
        }
        _ => None,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn shapes_tell_how_faces_lie() {
        for (size, front, back) in [
            ([40, 30], 10 * 40 + 10, 10 * 40 + 30),
            ([30, 40], 10 * 30 + 10, 39 * 30 + 19),
            ([60, 10], 40, 50),
            ([30, 20], 10 * 30 + 10, 10 * 30 + 20),
            ([10, 60], 400, 500),
        ] {
            let layout = Layout::of(size).expect("a cubemap");
            assert_eq!([layout.texel(4, [0, 0]), layout.texel(5, [-3, 0])], [front, back], "{size:?}");
        }
        assert!([[20, 10], [41, 30], [0, 0], [3, 3]].into_iter().all(|size| !is_cube(size)));
    }
    #[test]
    fn names_need_not_be_ascii() {
        // The Kelvin sign is a small k in lower case, and three bytes long.
        assert_eq!(siblings(Path::new("bac\u{212a}.png")), None);
    }
}
