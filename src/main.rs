//! Parses and prints; nothing else.

use std::process::ExitCode;

use clap::Parser;

fn main() -> ExitCode {
    let cli = iprt::cli::Cli::parse();
    // SAFETY: no thread has been started.
    match unsafe { cli.run() } {
        Ok(()) => ExitCode::SUCCESS,
        Err(error) => {
            eprintln!("iprt: {error}");
            ExitCode::from(error.exit_code())
        }
    }
}
