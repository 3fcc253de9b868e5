//! `--json`, which means the same in every command that has it.

use super::render::require_folder;
use crate::{Error, Result, image_file::write::write_bytes, terminal};
use std::path::{Path, PathBuf};

/// The flag.
#[derive(Clone, Debug, clap::Args)]
pub struct JsonArgs {
    /// Print the numbers as JSON and nothing else, or write them to a file
    #[arg(long, value_name = "FILE", num_args = 0..=1, require_equals = true, default_missing_value = "-")]
    pub json: Option<PathBuf>,
}

/// The flag of commands whose file may also follow after a blank.
#[derive(Clone, Debug, clap::Args)]
pub struct JsonFileArgs {
    /// Print the numbers as JSON and nothing else, or write them to a file (also as --json FILE)
    #[arg(long, value_name = "FILE", num_args = 0..=1, default_missing_value = "-")]
    pub json: Option<PathBuf>,
}

impl From<JsonFileArgs> for JsonArgs {
    fn from(JsonFileArgs { json }: JsonFileArgs) -> Self {
        Self { json }
    }
}

impl JsonArgs {
    /// Fails early if the file cannot be written.
    pub fn require(&self) -> Result<()> {
        self.json.iter().filter(|path| path.as_path() != Path::new("-")).try_for_each(|path| require_folder(path))
    }

    /// Says whether JSON takes the place of what is printed for people.
    pub fn is_printed(&self) -> bool {
        self.json.as_deref() == Some(Path::new("-"))
    }

    /// Prints or writes a value, if that is asked for.
    pub fn write(&self, value: &impl serde::Serialize) -> Result<()> {
        let Some(path) = &self.json else { return Ok(()) };
        let fault = |error: serde_json::Error| Error::Internal(error.to_string());
        if self.is_printed() {
            terminal::print(&terminal::hidden(&serde_json::to_string(value).map_err(fault)?));
            return Ok(());
        }
        write_bytes(path, &serde_json::to_vec_pretty(value).map_err(fault)?)
    }
}
