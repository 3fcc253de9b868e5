//! How far a long command is: a bar on a terminal, plain lines on a pipe.

use crate::terminal;
use indicatif::{HumanDuration, ProgressBar, ProgressDrawTarget, ProgressStyle};
use std::{
    io::{self, IsTerminal},
    ops::Deref,
    thread,
    time::{Duration, Instant},
};

/// How often a line is printed.
const EVERY: Duration = Duration::from_secs(10);

/// A progress bar on standard error. Where that is no terminal, lines at the start, every ten seconds and at
/// the end stand for it.
pub struct Progress {
    bar: ProgressBar,
    what: Option<String>,
}

/// Starts a progress of `length` steps, which nobody sees if `quiet` is set.
pub fn progress(quiet: bool, length: u64, what: &str) -> Progress {
    if quiet {
        return Progress { bar: ProgressBar::hidden(), what: None };
    }
    if io::stderr().is_terminal() {
        let bar = ProgressBar::new(length).with_message(what.to_owned());
        if let Ok(style) = ProgressStyle::with_template("{msg} {wide_bar} {pos}/{len} {eta}") {
            bar.set_style(style);
        }
        return Progress { bar, what: None };
    }
    let bar = ProgressBar::with_draw_target(Some(length), ProgressDrawTarget::hidden());
    terminal::say(&line(what, 0, length, None));
    let (watched, what_for) = (bar.clone(), what.to_owned());
    thread::spawn(move || {
        let start = Instant::now();
        // The first step is often the slowest, so that speed is measured from the first line on.
        let mut first: Option<(u64, Duration)> = None;
        loop {
            thread::sleep(EVERY);
            if watched.is_finished() {
                return;
            }
            let (done, all) = (watched.position(), watched.length().unwrap_or(0));
            let now = start.elapsed();
            let left = first.and_then(|(before, then)| {
                let speed = done.saturating_sub(before) as f64 / (now - then).as_secs_f64();
                (speed > 0.0).then(|| Duration::from_secs_f64((all.saturating_sub(done) as f64 / speed).min(1e9)))
            });
            terminal::say(&line(&what_for, done, all, left));
            if done > 0 {
                first.get_or_insert((done, now));
            }
        }
    });
    Progress { bar, what: Some(what.to_owned()) }
}

fn line(what: &str, done: u64, all: u64, left: Option<Duration>) -> String {
    let left = left.map_or(String::new(), |left| format!(", {} left", HumanDuration(left)));
    format!("{what}: {done} of {all}{left}")
}

impl Progress {
    /// Ends it, and removes the bar.
    pub fn finish_and_clear(&self) {
        if let (Some(what), false) = (&self.what, self.bar.is_finished()) {
            terminal::say(&line(what, self.bar.position(), self.bar.length().unwrap_or(0), None));
        }
        self.bar.finish_and_clear();
    }
}

impl Drop for Progress {
    fn drop(&mut self) {
        // Nothing more is said after an error.
        self.bar.finish_and_clear();
    }
}

impl Deref for Progress {
    type Target = ProgressBar;

    fn deref(&self) -> &ProgressBar {
        &self.bar
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn lines_say_how_far_it_is() {
        assert_eq!(line("rendering", 3, 16, None), "rendering: 3 of 16");
        assert_eq!(line("rendering", 3, 16, Some(Duration::from_secs(130))), "rendering: 3 of 16, 2 minutes left");
    }
}
