//! Parses and prints; nothing else.

use std::process::ExitCode;

fn main() -> ExitCode {
    // SAFETY: no thread has been started.
    unsafe { iprt::gpu::validation::enable_submit_checks() };
    iprt::cli::main()
}
