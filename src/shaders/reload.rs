//! The shaders on disk, in debug builds. The build script is the compiler. It brings its cache up to date and
//! says where the SPIR-V of each shader is.

use super::{DIGEST, SOURCES};
use crate::{Error, Result};
use std::{
    path::{Path, PathBuf},
    process::Command,
    sync::{Mutex, PoisonError},
};

/// The shaders that have changed since the build, by name, and the digest of all.
#[derive(Clone, Default)]
struct State {
    changed: Vec<(&'static str, &'static [u32])>,
    digest: Option<u64>,
}

static STATE: Mutex<Option<State>> = Mutex::new(None);

/// The folder from which shaders are read.
pub struct Sources {
    root: PathBuf,
}

/// The shaders of a folder, compiled.
pub struct Compiled {
    /// The SPIR-V of each shader by its path from the root, without `.comp`.
    pub shaders: Vec<(String, Vec<u32>)>,
    /// Changes with any of the shaders that are shipped.
    pub digest: u64,
}

impl Sources {
    /// Reads from a folder that has `shaders/glsl` and `tests/glsl`.
    pub fn at(root: &Path) -> Self {
        Self { root: root.to_owned() }
    }

    /// Reads the source that this program was built from, or the folder that `IPRT_SHADERS` names.
    fn ours() -> Self {
        let root = std::env::var_os("IPRT_SHADERS").unwrap_or_else(|| env!("CARGO_MANIFEST_DIR").into());
        Self { root: root.into() }
    }

    /// Compiles the shaders that have changed since they were last compiled.
    ///
    /// # Errors
    /// Fails if a shader cannot be read or compiled. The error names its file and line.
    pub fn compile(&self) -> Result<Compiled> {
        let compiler = env!("IPRT_SHADER_COMPILER");
        let refuse = |problem: String| {
            Error::input("the shaders", problem.trim().replace('\n', "; "), "correct them and load them again")
        };
        let output = Command::new(compiler).arg(&self.root).arg(env!("OUT_DIR")).output();
        let output = output.map_err(|error| refuse(format!("{compiler}: {error}")))?;
        if !output.status.success() {
            return Err(refuse(String::from_utf8_lossy(&output.stderr).into_owned()));
        }
        let (mut shaders, mut digest) = (Vec::new(), DIGEST);
        for line in String::from_utf8_lossy(&output.stdout).lines() {
            match line.split_once('\t') {
                Some(("digest", value)) => digest = value.parse().unwrap_or(DIGEST),
                Some((name, file)) => {
                    let bytes = std::fs::read(file).map_err(|error| refuse(format!("{file}: {error}")))?;
                    let words = bytes.as_chunks().0.iter().map(|word| u32::from_le_bytes(*word)).collect();
                    shaders.push((name.to_owned(), words));
                }
                None => {}
            }
        }
        Ok(Compiled { shaders, digest })
    }
}

impl State {
    fn read(before: &Self) -> Result<Self> {
        let sources = Sources::ours();
        if !Path::new(env!("IPRT_SHADER_COMPILER")).exists() || !sources.root.join("shaders/glsl").exists() {
            return Ok(Self::default()); // the program runs on another machine than it was built on
        }
        let Compiled { shaders, digest } = sources.compile()?;
        let mut changed = Vec::new();
        for (name, words) in shaders {
            let Some((name, built)) = SOURCES.iter().find(|(known, _)| *known == name) else { continue };
            let known = before.changed.iter().find(|(known, spirv)| known == name && **spirv == words);
            if let Some(known) = known {
                changed.push(*known);
            } else if **built != words {
                // pipelines are found by the address of their SPIR-V, so it must stay where it is
                changed.push((*name, &*words.leak()));
            }
        }
        Ok(Self { changed, digest: Some(digest) })
    }
}

/// Calls `work` with the state, which the first call reads.
fn with<T>(work: impl FnOnce(&State) -> T) -> Result<T> {
    let mut state = STATE.lock().unwrap_or_else(PoisonError::into_inner);
    if state.is_none() {
        *state = Some(State::read(&State::default())?);
    }
    Ok(work(state.as_ref().unwrap_or(&State::default())))
}

/// The SPIR-V to use in place of a build-time constant.
///
/// # Errors
/// Fails if a shader on disk cannot be compiled.
pub fn current(spirv: &'static [u32]) -> Result<&'static [u32]> {
    with(|state| {
        let changed = state.changed.iter().find(|(name, _)| SOURCES.contains(&(*name, spirv)));
        changed.map_or(spirv, |(_, words)| words)
    })
}

/// A hash that changes with any of the shaders.
///
/// # Errors
/// Fails if a shader on disk cannot be compiled.
pub fn digest() -> Result<u64> {
    with(|state| state.digest.unwrap_or(DIGEST))
}

/// Loads the shaders on disk as they are now, and makes something with them. Passes made from now on use them.
/// Nothing is made if no shader has changed.
///
/// # Errors
/// Fails if a shader on disk cannot be compiled, or if `make` fails. All shaders then stay as they were.
pub fn reload<T>(make: impl FnOnce() -> Result<T>) -> Result<Option<T>> {
    let before = with(State::clone)?;
    let now = State::read(&before)?;
    if now.digest == before.digest {
        return Ok(None);
    }
    let set = |state| *STATE.lock().unwrap_or_else(PoisonError::into_inner) = Some(state);
    set(now);
    let made = make();
    if made.is_err() {
        set(before);
    }
    made.map(Some)
}
