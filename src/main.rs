//! Parses and prints; nothing else.

use std::process::ExitCode;

use clap::Parser;

fn main() -> ExitCode {
    // SAFETY: no thread has been started.
    unsafe { iprt::gpu::validation::enable_submit_checks() };
    match iprt::cli::Cli::parse().run() {
        Ok(()) if iprt::cli::was_not_heard() => ExitCode::from(2),
        Ok(()) => ExitCode::SUCCESS,
        Err(error) => {
            iprt::cli::say(&format!("iprt: {error}"));
            ExitCode::from(error.exit_code())
        }
    }
}
