//! Keeps what was measured for choosing. The cache folder has a file for each device, program, view and set
//! of given settings. The file has a sheet for each size.

use super::Sheet;
use crate::{
    Error, Result,
    gpu::Gpu,
    image_file::{
        checked::{read_checked, write_checked},
        read::read_bytes,
        write::make_cache_folder,
    },
    options::RenderOptions,
    reference::cache::hash_rendered,
    scene::Scene,
    settings::Settings,
};
use std::{
    env,
    path::{Path, PathBuf},
};

/// The first line of a file.
const MAGIC: &[u8] = b"iprt measured points 1\n";

/// The sheets of one view.
#[derive(Clone, Debug)]
pub struct Store {
    file: Option<PathBuf>,
}

impl Store {
    /// Opens the store for a scene's first frame, as `options` show it, with the settings that the scene and
    /// the user give. Size, method and seed do not count. Sheets are kept in `folder` (see
    /// [`cache_folder`](crate::reference::capture::cache_folder)). Without a folder nothing is kept.
    ///
    /// # Errors
    /// Fails if the panorama cannot be read.
    pub fn of(gpu: &Gpu, scene: &Scene, options: &RenderOptions, exposure: f32, folder: Option<&Path>) -> Result<Self> {
        let Some(folder) = folder else { return Ok(Self { file: None }) };
        let mut hasher = hash_rendered(scene, scene.panorama.frame_time(0))?;
        let view = (options.projection, options.without_objects, exposure.to_bits());
        let motion = (scene.moving_object(), scene.panorama.frame_count());
        let on = (gpu.device_name(), gpu.driver(), version()?);
        hasher.update(format!("{view:?} {motion:?} {on:?} {:?}", given(&options.settings)).as_bytes());
        Ok(Self { file: Some(folder.join(format!("points-{}", &hasher.finalize().to_hex()[..32]))) })
    }

    /// Reads all sheets. A damaged file is reported and ignored.
    pub fn load(&self) -> Vec<Sheet> {
        let Some(file) = self.file.as_deref().filter(|file| file.exists()) else { return Vec::new() };
        let content = read_checked(file, MAGIC).ok().flatten();
        let sheets = content.and_then(|content| serde_json::from_slice(&content).ok());
        sheets.unwrap_or_else(|| {
            tracing::warn!("{}: damaged, its points are measured again", file.display());
            Vec::new()
        })
    }

    /// Adds a sheet, in place of the one of the same size. If it cannot be written, that is reported and
    /// nothing is kept.
    pub fn put(&self, sheet: Sheet) {
        let Some(file) = &self.file else { return };
        let mut sheets = self.load();
        sheets.retain(|known| known.size != sheet.size);
        sheets.push(sheet);
        if let Err(error) = write(file, &sheets) {
            tracing::warn!("measured points are not kept: {error}");
        }
    }
}

fn write(file: &Path, sheets: &[Sheet]) -> Result<()> {
    make_cache_folder(file)?;
    write_checked(file, MAGIC, &serde_json::to_vec(sheets).map_err(|error| Error::Internal(error.to_string()))?)
}

/// The settings that the scene or the user gives, and their values.
pub fn given(settings: &Settings) -> Vec<(&'static str, String)> {
    settings.values().into_iter().filter(|(name, _)| settings.given.contains(name)).collect()
}

/// The package's version and a hash of the program itself, so that times and pictures of different builds are
/// not mixed.
///
/// # Errors
/// Fails if the program's file cannot be read.
pub fn version() -> Result<String> {
    let program = env::current_exe().map_err(|error| Error::Internal(format!("the program's own file: {error}")))?;
    let hash = blake3::hash(&read_bytes(&program)?).to_hex();
    Ok(format!("{} build {}", env!("CARGO_PKG_VERSION"), &hash[..12]))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::measure::choice::Candidate;
    use std::{collections::BTreeMap, fs};

    fn sheet(size: [u32; 2], flip: f64) -> Sheet {
        let passes = BTreeMap::from([("gbuffer".to_owned(), 0.1 + flip)]);
        let set = BTreeMap::from([("rays_per_pixel".to_owned(), "0.5".to_owned())]);
        let candidate = Candidate { method: "iprt".into(), set, passes, flip, ..Default::default() };
        Sheet {
            size,
            truth: "model truth".into(),
            noise: 0.01,
            fixed: BTreeMap::new(),
            complete: true,
            candidates: vec![candidate],
        }
    }

    #[test]
    fn sheets_are_read_as_they_were_written_and_damage_is_found() {
        let folder = tempfile::tempdir().expect("a folder");
        let file = folder.path().join("new/points");
        let store = Store { file: Some(file.clone()) };
        assert_eq!(store.load(), []);
        let (a, b) = (sheet([160, 90], 0.1), sheet([320, 180], 1.0 / 3.0));
        store.put(sheet([160, 90], 0.2));
        store.put(b.clone());
        store.put(a.clone());
        assert_eq!(store.load(), [b, a.clone()], "one a size, the later one");

        let bytes = fs::read(&file).expect("reads");
        let mut flipped = bytes.clone();
        *flipped.last_mut().expect("not empty") ^= 1;
        for damaged in [&flipped[..], &bytes[..bytes.len() - 7], &bytes[..3], b""] {
            fs::write(&file, damaged).expect("writes");
            assert_eq!(store.load(), [], "{} bytes", damaged.len());
        }
        store.put(a.clone());
        assert_eq!(store.load(), std::slice::from_ref(&a), "written anew");
        let nowhere = Store { file: None };
        nowhere.put(a);
        assert_eq!(nowhere.load(), []);
    }
}
