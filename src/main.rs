//! Parses and prints; the library does the rest.

use clap::{Parser, Subcommand};
use iprt::cli;

/// Virtual objects in 360° RGBD video, lit by the video itself.
#[derive(Parser)]
#[command(version)]
struct Cli {
    #[command(subcommand)]
    command: Command,
}

#[derive(Subcommand)]
enum Command {
    /// Render pictures
    Render(cli::render::Args),
    /// Measure the GPU time of every pass
    Bench(cli::bench::Args),
    /// Render the converged picture of the method's model
    Reference(cli::reference::Args),
    /// Report every problem of a scene
    Check(cli::check::Args),
}

fn main() -> std::process::ExitCode {
    let result = match Cli::parse().command {
        Command::Render(args) => cli::render::run(&args),
        Command::Bench(args) => cli::bench::run(&args),
        Command::Reference(args) => cli::reference::run(&args),
        Command::Check(args) => cli::check::run(&args),
    };
    match result {
        Ok(()) => std::process::ExitCode::SUCCESS,
        Err(error) => {
            eprintln!("iprt: {error}");
            std::process::ExitCode::from(error.exit_code())
        }
    }
}
