//! `iprt view` in a build without the window.

use crate::{Error, Result};

/// Arguments of `iprt view`; none is read.
#[derive(Clone, Debug, clap::Args)]
#[command(disable_help_flag = true)]
pub struct Args {
    #[arg(hide = true, trailing_var_arg = true, allow_hyphen_values = true)]
    ignored: Vec<String>,
}

/// Says that there is no window.
///
/// # Errors
/// Fails always, as this build has none.
pub fn run(_: Args) -> Result<()> {
    let remedy = "build it with the feature `viewer`, which cargo leaves out only by --no-default-features";
    Err(Error::input("view", "this build has no window", remedy))
}
