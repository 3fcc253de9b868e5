//! The command line: one file a subcommand, each with an `Args` and a `run` that calls the crate's public API. A new
//! subcommand is a file here, a variant of [`Command`] and its arms below.

pub mod devices;

use std::io::{self, Write};

use clap::{ArgAction, Args, Parser, Subcommand, builder::FalseyValueParser};

use crate::{
    Error, Result,
    gpu::{Gpu, GpuOptions, validation},
};

/// Virtual objects in 360° RGBD video, lit by the video itself.
#[derive(Debug, Parser)]
#[command(name = "iprt", version, about, max_term_width = 120)]
pub struct Cli {
    /// What to do.
    #[command(subcommand)]
    pub command: Command,
    /// Says more on stderr; twice: still more
    #[arg(short, long, global = true, action = ArgAction::Count)]
    pub verbose: u8,
    /// Says only what went wrong
    #[arg(short, long, global = true, conflicts_with = "verbose")]
    pub quiet: bool,
}

/// The subcommands.
#[derive(Debug, Subcommand)]
pub enum Command {
    /// List Vulkan devices, their drivers, and which are usable or why not
    Devices(devices::Args),
}

/// Flags of every command that uses a device.
#[derive(Clone, Debug, Default, Args)]
#[command(next_help_heading = "Device")]
pub struct GpuArgs {
    /// The Vulkan device, by number or part of its name (see `iprt devices`)
    #[arg(long, value_name = "N|NAME", env = "IPRT_DEVICE")]
    pub device: Option<String>,
    /// Runs under the Vulkan validation layer
    #[arg(long, env = "IPRT_VALIDATION", action = ArgAction::SetTrue, value_parser = FalseyValueParser::new())]
    pub validation: bool,
}

impl GpuArgs {
    /// Opens the device.
    ///
    /// # Errors
    /// As [`Gpu::new`].
    pub fn open(&self) -> Result<Gpu> {
        Gpu::new(&GpuOptions { device: self.device.clone(), validation: self.validation })
    }
}

impl Command {
    /// The device flags of commands that use one.
    fn gpu(&self) -> Option<&GpuArgs> {
        match self {
            Self::Devices(_) => None,
        }
    }

    fn run(self) -> Result<()> {
        match self {
            Self::Devices(args) => devices::run(&args),
        }
    }
}

impl Cli {
    /// Does what was asked.
    ///
    /// # Safety
    /// No other thread may run yet: this may set an environment variable that the validation layer reads.
    ///
    /// # Errors
    /// What went wrong, for one line on stderr and [`Error::exit_code`].
    pub unsafe fn run(self) -> Result<()> {
        if self.command.gpu().is_some_and(|gpu| gpu.validation) {
            // SAFETY: the caller's promise.
            unsafe { validation::enable_submit_checks() };
        }
        let level = match (self.quiet, self.verbose) {
            (true, _) => tracing::Level::ERROR,
            (false, 0) => tracing::Level::WARN,
            (false, 1) => tracing::Level::INFO,
            (false, _) => tracing::Level::DEBUG,
        };
        let log = tracing_subscriber::fmt().with_max_level(level).with_writer(io::stderr).without_time();
        log.with_target(false).init();
        self.command.run()
    }
}

/// Prints to stdout. A reader that has seen enough (`| head`) is no error.
///
/// # Errors
/// [`Error::Input`] where stdout cannot be written.
pub fn print(text: &str) -> Result<()> {
    let mut out = io::stdout().lock();
    match writeln!(out, "{text}").and_then(|()| out.flush()) {
        Err(error) if error.kind() != io::ErrorKind::BrokenPipe => {
            Err(Error::input("standard output", error, "write to a file or terminal that has room"))
        }
        _ => Ok(()),
    }
}
