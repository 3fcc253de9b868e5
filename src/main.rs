//! Parses and prints; nothing else.

use std::process::ExitCode;

use clap::Parser;

fn main() -> ExitCode {
    // SAFETY: no thread has been started.
    unsafe { iprt::gpu::validation::enable_submit_checks() };
    match iprt::cli::Cli::parse().run() {
        Ok(()) => ExitCode::SUCCESS,
        Err(error) => {
            eprintln!("iprt: {error}");
            ExitCode::from(error.exit_code())
        }
    }
}
