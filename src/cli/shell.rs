//! `iprt completions` and `iprt man`: what shells and manual readers want of the command line.

use super::Cli;
use crate::{
    Error, Result,
    image_file::write::{make_folder, write_bytes},
};
use clap::CommandFactory as _;
use std::path::{Path, PathBuf};

/// Arguments of `iprt completions`.
#[derive(Clone, Debug, clap::Args)]
pub struct CompletionsArgs {
    /// The shell
    pub shell: clap_complete::Shell,
}

/// Arguments of `iprt man`.
#[derive(Clone, Debug, clap::Args)]
pub struct ManArgs {
    /// The folder; it is made if it does not exist
    #[arg(short, long, value_name = "DIR")]
    pub output: PathBuf,
}

/// Prints a script that completes commands and flags.
pub fn completions(args: &CompletionsArgs) -> Result<()> {
    let mut script = Vec::new();
    clap_complete::generate(args.shell, &mut Cli::command(), "iprt", &mut script);
    super::print_lines(String::from_utf8_lossy(&script).trim_end());
    Ok(())
}

/// Writes a manual page for each command.
pub fn man(args: &ManArgs) -> Result<()> {
    make_folder(&args.output)?;
    let mut all = Cli::command();
    all.build();
    page(&all, &args.output)
}

/// Writes the page of a command and those of its parts.
fn page(command: &clap::Command, folder: &Path) -> Result<()> {
    for part in command.get_subcommands().filter(|part| !part.is_hide_set()) {
        page(part, folder)?;
    }
    let man = clap_mangen::Man::new(command.clone());
    let mut text = Vec::new();
    man.render(&mut text).map_err(|error| Error::Internal(format!("a manual page: {error}")))?;
    write_bytes(&folder.join(man.get_filename()), &text)
}
