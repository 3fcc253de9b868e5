//! The one writer to the terminal. All that the program says goes through it, so that nothing that is said
//! can move the cursor, that a reader who leaves is no error, and that a full disk is one.

use std::{
    collections::BTreeMap,
    fmt,
    io::{self, IsTerminal, Write},
    sync::{
        Mutex, PoisonError,
        atomic::{AtomicBool, Ordering},
    },
};

use tracing::{Event, Level, Subscriber, field};
use tracing_subscriber::{
    fmt::{FmtContext, FormatEvent, FormatFields, format::Writer},
    registry::LookupSpan,
};

use crate::{Error, warnings};

/// Whether something could not be written to standard error, as on a full disk.
static UNHEARD: AtomicBool = AtomicBool::new(false);
/// Why something could not be written to standard output.
static UNWRITTEN: Mutex<Option<String>> = Mutex::new(None);
/// Paths that hold values from the environment, each with what the user wrote.
static HIDDEN: Mutex<BTreeMap<String, String>> = Mutex::new(BTreeMap::new());

/// Shows control characters as escapes, line breaks among them, and so those that turn the direction of
/// writing.
pub fn plain(text: &str) -> String {
    escaped(text, |_| false)
}

fn escaped(text: &str, stays: impl Fn(char) -> bool) -> String {
    let mut out = String::with_capacity(text.len());
    for c in text.chars() {
        let turns = matches!(c, '\u{200e}' | '\u{200f}' | '\u{2028}'..='\u{202e}' | '\u{2066}'..='\u{2069}');
        match (c.is_control() || turns) && !stays(c) {
            true => out.extend(c.escape_default()),
            false => out.push(c),
        }
    }
    out
}

/// Prints a line to standard output. A failure is kept for [`failure`], so that the work goes on.
pub fn print(text: &str) {
    write_out(&plain(text));
}

/// Prints lines to standard output. Names in them went through [`plain`].
pub fn print_lines(text: &str) {
    write_out(&escaped(text, |c| c == '\n'));
}

/// Prints lines to standard output that hold colour, and nothing that the user gave.
pub fn print_coloured(text: &str) {
    write_out(text);
}

/// Prints lines to standard error that hold colour, and nothing that the user gave.
pub fn say_coloured(text: &str) {
    say_line(text);
}

fn write_out(text: &str) {
    let mut out = io::stdout().lock();
    if let Err(error) = writeln!(out, "{text}").and_then(|()| out.flush())
        && error.kind() != io::ErrorKind::BrokenPipe
    {
        UNWRITTEN.lock().unwrap_or_else(PoisonError::into_inner).get_or_insert(error.to_string());
    }
}

/// Prints a line to standard error. Values of environment variables in it are shown as their names.
pub fn say(text: &str) {
    say_line(&plain(&hidden(text)));
}

/// Prints lines to standard error.
pub fn say_lines(text: &str) {
    say_line(&escaped(&hidden(text), |c| c == '\n'));
}

/// Prints a line that begins with a word, `error` or `warning`, coloured where that is seen.
pub fn say_as(word: &str, text: &str) {
    let text = plain(&hidden(text));
    match (is_coloured(&io::stderr()), word) {
        (false, _) => say_line(&format!("{word}: {text}")),
        (true, "warning") => say_line(&format!("\u{1b}[33m{word}:\u{1b}[0m {text}")),
        (true, _) => say_line(&format!("\u{1b}[31m{word}:\u{1b}[0m {text}")),
    }
}

fn say_line(text: &str) {
    let mut err = io::stderr().lock();
    let said = writeln!(err, "{text}").and_then(|()| err.flush());
    let lost = said.is_err_and(|error| error.kind() != io::ErrorKind::BrokenPipe);
    UNHEARD.fetch_or(lost, Ordering::Relaxed);
}

/// Says whether colour is seen and wanted: on a terminal, without `NO_COLOR`.
pub fn is_coloured(stream: &impl IsTerminal) -> bool {
    let set = |name| std::env::var_os(name).is_some_and(|value| !value.is_empty());
    let dumb = std::env::var_os("TERM").is_some_and(|term| term == "dumb");
    stream.is_terminal() && !set("NO_COLOR") && !dumb
}

/// Returns what could not be written to standard output, as an error, and whether standard error was lost.
pub fn failure() -> (Option<Error>, bool) {
    let unwritten = UNWRITTEN.lock().unwrap_or_else(PoisonError::into_inner).clone();
    let remedy = "write to a file or terminal that has room";
    (unwritten.map(|why| Error::input("standard output", why, remedy)), UNHEARD.load(Ordering::Relaxed))
}

/// Has `path`, which holds values from the environment, shown as `written`.
pub fn hide(path: &str, written: &str) {
    // A single letter would be found everywhere.
    if path.len() > 1 && path != written {
        HIDDEN.lock().unwrap_or_else(PoisonError::into_inner).insert(path.to_owned(), written.to_owned());
    }
}

/// Replaces the paths of [`hide`], where they stand alone.
pub fn hidden(text: &str) -> String {
    let known = HIDDEN.lock().unwrap_or_else(PoisonError::into_inner);
    let mut text = text.to_owned();
    // From the longest to the shortest, as one may begin another.
    let mut known: Vec<_> = known.iter().collect();
    known.sort_by_key(|(path, _)| std::cmp::Reverse(path.len()));
    for (path, written) in known {
        let (mut out, mut rest) = (String::new(), text.as_str());
        while let Some(at) = rest.find(path.as_str()) {
            let (before, after) = (rest[..at].chars().next_back(), rest[at + path.len()..].chars().next());
            let goes_on = |c: Option<char>| c.is_some_and(|c| c.is_alphanumeric() || c == '_');
            let alone = !(goes_on(before) || before == Some('/') || goes_on(after));
            out += &rest[..at];
            out += if alone { written } else { path };
            rest = &rest[at + path.len()..];
        }
        out += rest;
        text = out;
    }
    text
}

/// Puts what the program logs into the form of all other lines. Of the warnings
/// that one place in the program gives, the first is told.
pub struct Log;

impl<S, N> FormatEvent<S, N> for Log
where
    S: Subscriber + for<'a> LookupSpan<'a>,
    N: for<'a> FormatFields<'a> + 'static,
{
    fn format_event(&self, _: &FmtContext<'_, S, N>, _: Writer<'_>, event: &Event<'_>) -> fmt::Result {
        let mut text = Message::default();
        event.record(&mut text);
        match *event.metadata().level() {
            Level::ERROR => say_as("error", &text.0),
            Level::WARN => {
                let data = event.metadata();
                let kind = format!("{}:{}", data.file().unwrap_or(data.target()), data.line().unwrap_or(0));
                warnings::remark(&kind, &text.0);
            }
            level => say(&format!("{}: {}", level.as_str().to_lowercase(), text.0)),
        }
        Ok(())
    }
}

#[derive(Default)]
struct Message(String);

impl field::Visit for Message {
    fn record_debug(&mut self, field: &field::Field, value: &dyn fmt::Debug) {
        if field.name() == "message" {
            self.0 = format!("{value:?}{}", self.0);
        } else {
            self.0 += &format!(" {}={value:?}", field.name());
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn nothing_in_a_text_moves_the_cursor() {
        assert_eq!(plain("a\u{1b}[31mb\nc\u{9b}\u{202e}é"), "a\\u{1b}[31mb\\nc\\u{9b}\\u{202e}é");
        assert_eq!(escaped("a\tb\n", |c| c == '\n'), "a\\tb\n");
    }

    #[test]
    fn values_of_the_environment_are_shown_as_names() {
        hide("/secret/place", "$PLACE");
        hide("/secret/place/in", "$PLACE/$IN");
        assert_eq!(hidden("/secret/place/a.png: gone; see /secret/places"), "$PLACE/a.png: gone; see /secret/places");
        assert_eq!(hidden("x/secret/place and /secret/place/in"), "x/secret/place and $PLACE/$IN");
    }
}
