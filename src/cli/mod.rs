//! The command line. Each subcommand has a file with `Args` and a `run` that calls the crate's public API. A
//! new subcommand needs a file here, a variant of [`Command`] and an arm in its `run`.

pub mod bench;
pub mod capture;
pub mod chart;
pub mod check;
pub mod common;
pub mod compare;
mod compare_sequence;
pub mod devices;
pub mod join;
pub mod json;
pub mod masks;
pub mod new;
pub mod plan;
mod progress;
pub mod reference;
pub mod render;
pub mod scene;
pub mod shell;
pub mod signals;
pub mod sink;
pub mod stability;
pub mod target;
#[cfg(feature = "viewer")]
pub mod view;
#[cfg(not(feature = "viewer"))]
#[path = "no_view.rs"]
pub mod view;

use std::{io, process::ExitCode};

use clap::{ArgAction, Parser, Subcommand};

use crate::{
    Error, Result, budget,
    gpu::left_running,
    panorama::reduce,
    terminal::{self, print, print_lines, say, say_lines},
    warnings,
};

/// Virtual objects in 360° RGBD video, lit by the video itself.
#[derive(Debug, Parser)]
#[command(name = "iprt", version, about, max_term_width = 120)]
pub struct Cli {
    /// The subcommand.
    #[command(subcommand)]
    pub command: Command,
    /// Print more on standard error; give it twice for still more
    #[arg(short, long, global = true, action = ArgAction::Count)]
    pub verbose: u8,
    /// How much memory a file may take while it is read, as 512M or 4G [default: half of the machine's]
    #[arg(long, global = true, value_name = "SIZE", value_parser = budget::parse)]
    pub memory: Option<u64>,
    /// How many texels a panorama and its depth have around at most; larger ones are reduced when they are loaded
    #[arg(long, global = true, value_name = "WIDTH", value_parser = reduce::parse)]
    pub panorama_size: Option<u32>,
}

/// The subcommands.
#[derive(Debug, Subcommand)]
pub enum Command {
    /// List Vulkan devices, their drivers, and which are usable or why not
    Devices(devices::Args),
    /// Render pictures to files
    Render(render::Args),
    /// Measure the GPU time of every pass
    Bench(bench::Args),
    /// Render converged pictures: of the method's own model, or of the true scene
    Reference(reference::Args),
    /// Path-trace the RGBD panorama of a room
    Capture(capture::Args),
    /// Chart speed against accuracy: methods, and every setting
    Chart(chart::Args),
    /// Print which parts of the model a scene needs, and why
    Plan(plan::Args),
    /// Measure how far a picture is from the truth
    Compare(compare::Args),
    /// Write which pixels show objects, and which they influence
    Masks(masks::Args),
    /// Check that all frames of a render are there, and encode them as a video
    Join(join::Args),
    /// Report every problem of a scene at once, what it measures, and what can hardly be right
    Check(check::Args),
    /// Write a scene file for a panorama, its depth and models
    New(new::Args),
    /// Run cases in which such methods fail, with a number, a limit and a picture for each case and method
    Stability(stability::Args),
    /// Open a window to see a scene, move in it and compare in it
    View(view::Args),
    /// Print a script that completes commands and flags in a shell
    Completions(shell::CompletionsArgs),
    /// Write manual pages
    Man(shell::ManArgs),
    /// Write built-in rooms as files
    #[command(subcommand)]
    Scene(scene::SceneCommand),
}

impl Command {
    /// Says whether warnings are not wanted.
    fn is_quiet(&self) -> bool {
        match self {
            Self::Render(args) => args.picture.quiet,
            Self::Bench(args) => args.picture.quiet,
            Self::Reference(args) => args.picture.quiet,
            Self::Plan(args) => args.picture.quiet,
            Self::Masks(args) => args.picture.quiet,
            Self::Join(args) => args.quiet,
            Self::Capture(args) => args.quiet,
            Self::Chart(args) => args.quiet,
            Self::Check(args) => args.quiet,
            #[cfg(feature = "viewer")]
            Self::View(args) => args.quiet,
            _ => false,
        }
    }

    fn run(self) -> Result<()> {
        match self {
            Self::Devices(args) => devices::run(&args),
            Self::Render(args) => render::run(&args),
            Self::Bench(args) => bench::run(&args),
            Self::Reference(args) => reference::run(&args),
            Self::Capture(args) => capture::run(&args),
            Self::Chart(args) => chart::run(&args),
            Self::Plan(args) => plan::run(&args),
            Self::Compare(args) => compare::run(&args),
            Self::Masks(args) => masks::run(&args),
            Self::Join(args) => join::run(&args),
            Self::Check(args) => check::run(&args),
            Self::New(args) => new::run(&args),
            Self::Stability(args) => stability::run(&args),
            Self::View(args) => view::run(args),
            Self::Completions(args) => shell::completions(&args),
            Self::Man(args) => shell::man(&args),
            Self::Scene(command) => scene::run(&command),
        }
    }
}

impl Cli {
    /// Runs the subcommand.
    ///
    /// # Errors
    /// Fails with what went wrong, as one line for stderr and with its [`Error::exit_code`].
    pub fn run(self) -> Result<()> {
        let quiet = self.command.is_quiet();
        budget::set(self.memory.unwrap_or(0));
        reduce::set(self.panorama_size.unwrap_or(0));
        let level = match (self.verbose, quiet) {
            (0, true) => tracing::Level::ERROR,
            (0, false) => tracing::Level::WARN,
            (1, _) => tracing::Level::INFO,
            _ => tracing::Level::DEBUG,
        };
        let log = tracing_subscriber::fmt().with_max_level(level).log_internal_errors(false);
        log.event_format(terminal::Log).with_writer(io::sink).init();
        if !quiet {
            warnings::listen(|warning| terminal::say_as("warning", warning));
        }
        signals::watch();
        let result = self.command.run();
        if !quiet {
            for (warning, times) in warnings::repeated() {
                terminal::say_as("warning", &format!("{} more like this one: {warning}", times - 1));
            }
        }
        result
    }
}

/// Reads the command line and does what it says. All that goes wrong is told, and is in the exit status.
pub fn main() -> ExitCode {
    let status = match Cli::try_parse() {
        Ok(cli) => cli.run().map_or_else(
            |error| {
                say(&format!("iprt: {error}"));
                error.exit_code()
            },
            |()| 0,
        ),
        Err(usage) => tell_usage(&usage),
    };
    let (unwritten, unheard) = terminal::failure();
    if let Some(error) = &unwritten {
        say(&format!("iprt: {error}"));
    }
    let status = if status == 0 && (unwritten.is_some() || unheard) { 2 } else { status };
    if left_running() {
        signals::leave(status.into());
    }
    ExitCode::from(status)
}

/// Prints help, the version, or what is wrong with the arguments.
fn tell_usage(usage: &clap::Error) -> u8 {
    // What was given may hold escape sequences of its own.
    let strange = std::env::args_os().any(|argument| argument.to_string_lossy().contains(char::is_control));
    let text = usage.render();
    if usage.use_stderr() {
        match terminal::is_coloured(&io::stderr()) && !strange {
            true => terminal::say_coloured(text.ansi().to_string().trim_end()),
            false => say_lines(text.to_string().trim_end()),
        }
        return 2;
    }
    match terminal::is_coloured(&io::stdout()) {
        true => terminal::print_coloured(text.ansi().to_string().trim_end()),
        false => print_lines(text.to_string().trim_end()),
    }
    0
}

/// Fails if there were warnings and `strict` makes them errors.
fn forbid_warnings(strict: bool, subject: &str) -> Result<()> {
    match warnings::count() {
        n if strict && n > 0 => {
            let problem = format!("{n} warnings, and --strict makes them errors");
            Err(Error::input(subject, problem, "mend what they name, or leave --strict out"))
        }
        _ => Ok(()),
    }
}
