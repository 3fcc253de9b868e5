//! The shaders on disk, in debug builds. The build script, which is the compiler, brings its cache up to date and says
//! where each shader's SPIR-V is.

use super::{DIGEST, SOURCES};
use crate::{Error, Result};
use std::{
    path::{Path, PathBuf},
    process::Command,
    sync::{Mutex, PoisonError},
};

/// Every shader that is not as it was at build time, by name, and the digest of all.
#[derive(Clone, Default)]
struct State {
    changed: Vec<(&'static str, &'static [u32])>,
    digest: Option<u64>,
}

static STATE: Mutex<Option<State>> = Mutex::new(None);

/// Where shaders are read from.
pub struct Sources {
    root: PathBuf,
}

/// What shaders on disk were compiled to.
pub struct Compiled {
    /// The SPIR-V of each shader by its path from the root, without `.comp`.
    pub shaders: Vec<(String, Vec<u32>)>,
    /// Changes with any of those that are shipped.
    pub digest: u64,
}

impl Sources {
    /// A folder that has `shaders/glsl` and `tests/glsl`.
    pub fn at(root: &Path) -> Self {
        Self { root: root.to_owned() }
    }

    /// The source that this program was built from, or what `IPRT_SHADERS` names instead.
    fn ours() -> Self {
        let root = std::env::var_os("IPRT_SHADERS").unwrap_or_else(|| env!("CARGO_MANIFEST_DIR").into());
        Self { root: root.into() }
    }

    /// Compiles what has changed since it was compiled last.
    ///
    /// # Errors
    /// Fails if a shader cannot be read or compiled; the error names its file and line.
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
            return Ok(Self::default()); // the program has left the machine that built it
        }
        let Compiled { shaders, digest } = sources.compile()?;
        let mut changed = Vec::new();
        for (name, words) in shaders {
            let Some((name, built)) = SOURCES.iter().find(|(known, _)| *known == name) else { continue };
            let known = before.changed.iter().find(|(known, spirv)| known == name && **spirv == words);
            if let Some(known) = known {
                changed.push(*known);
            } else if **built != words {
                // pipelines are found by the address of their SPIR-V, so it stays where it is
                changed.push((*name, &*words.leak()));
            }
        }
        Ok(Self { changed, digest: Some(digest) })
    }
}

/// Does something with the state, which the first to ask for reads.
fn with<T>(work: impl FnOnce(&State) -> T) -> Result<T> {
    let mut state = STATE.lock().unwrap_or_else(PoisonError::into_inner);
    if state.is_none() {
        *state = Some(State::read(&State::default())?);
    }
    Ok(work(state.as_ref().unwrap_or(&State::default())))
}

/// What a shader is now, by the constant that it was at build time.
///
/// # Errors
/// Fails if a shader on disk cannot be compiled.
pub fn current(spirv: &'static [u32]) -> Result<&'static [u32]> {
    with(|state| {
        let changed = state.changed.iter().find(|(name, _)| SOURCES.contains(&(*name, spirv)));
        changed.map_or(spirv, |(_, words)| words)
    })
}

/// Changes with any of the shaders.
///
/// # Errors
/// Fails if a shader on disk cannot be compiled.
pub fn digest() -> Result<u64> {
    with(|state| state.digest.unwrap_or(DIGEST))
}

/// Takes up the shaders on disk as they are now; passes that are made from now on have them. Says whether any has changed.
///
/// # Errors
/// Fails if a shader on disk cannot be compiled. All of them then stay as they were.
pub fn reload() -> Result<bool> {
    let before = with(State::clone)?;
    let now = State::read(&before)?;
    let other = now.digest != before.digest;
    *STATE.lock().unwrap_or_else(PoisonError::into_inner) = Some(now);
    Ok(other)
}
