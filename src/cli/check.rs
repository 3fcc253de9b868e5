//! `iprt check SCENE` reads everything that a scene names, and reports every problem at once.

use crate::{Error, Result, scene::Scene};
use std::path::PathBuf;

/// Arguments of `iprt check`.
#[derive(Clone, Debug, clap::Args)]
pub struct Args {
    /// The scene file.
    pub scene: PathBuf,
}

/// Prints each problem and each warning on a line of its own.
///
/// # Errors
/// Fails if the scene has problems. All but the last are printed here. The last one is the error, for the
/// caller to print.
pub fn run(args: &Args) -> Result<()> {
    let (mut problems, warnings) = Scene::problems(&args.scene);
    for warning in &warnings {
        eprintln!("warning: {warning}");
    }
    let last = problems.pop();
    for problem in &problems {
        eprintln!("error: {problem}");
    }
    match last {
        Some(Error::Input { subject, problem, remedy }) => Err(Error::Input { subject, problem, remedy }),
        Some(other) => Err(other),
        None => {
            println!("{}: no problems, {} warnings", args.scene.display(), warnings.len());
            Ok(())
        }
    }
}
