//! Runs `ffmpeg` and `ffprobe`.

use crate::{Error, Result};
use std::{
    io::{Read, Write},
    path::Path,
    process::{Child, ChildStderr, Command, ExitStatus, Stdio},
    thread::JoinHandle,
};

/// How to install the programs.
const INSTALL: &str = "install it, for example: apt-get install ffmpeg (dnf install ffmpeg, brew install ffmpeg), \
                       so that ffmpeg and ffprobe are on the PATH";

/// Makes a command that asks nothing and says only what is wrong.
pub fn command(program: &'static str) -> Command {
    let mut command = Command::new(program);
    command.stdin(Stdio::null()).stdout(Stdio::piped()).stderr(Stdio::piped());
    // Ctrl-C is for this program to answer.
    #[cfg(unix)]
    std::os::unix::process::CommandExt::process_group(&mut command, 0);
    if program == "ffmpeg" {
        command.args(["-hide_banner", "-nostdin"]);
    }
    command.args(["-v", "error"]);
    command
}

/// A local file as `ffmpeg` takes it, whatever its name begins with.
pub fn local(path: &Path) -> std::ffi::OsString {
    let mut name = std::ffi::OsString::from("file:");
    name.push(path);
    name
}

/// Starts a command. `subject` is the file that it is for.
///
/// # Errors
/// Fails if the program is not installed or cannot be started.
pub fn start(command: &mut Command, subject: &str) -> Result<Child> {
    command.spawn().map_err(|error| {
        let program = command.get_program().to_string_lossy().into_owned();
        if error.kind() == std::io::ErrorKind::NotFound {
            return Error::input(subject, format!("needs ffmpeg, and {program} is not installed"), INSTALL);
        }
        Error::input(subject, format!("{program} cannot be started: {}", error.kind()), INSTALL)
    })
}

/// Runs a command to its end and returns what it printed.
///
/// # Errors
/// Fails as [`start`] does, and with the program's own last words if it fails.
pub fn output(command: &mut Command, subject: &str, problem: &str, remedy: &str) -> Result<Vec<u8>> {
    both(command, subject, problem, remedy).map(|(printed, _)| printed)
}

/// The same, with what it said on stderr.
///
/// # Errors
/// Fails as [`output`] does.
pub fn both(command: &mut Command, subject: &str, problem: &str, remedy: &str) -> Result<(Vec<u8>, String)> {
    let output = start(command, subject)?.wait_with_output();
    let output = output.map_err(|error| Error::input(subject, format!("{problem}: {}", error.kind()), remedy))?;
    let said = String::from_utf8_lossy(&output.stderr).into_owned();
    if output.status.success() {
        return Ok((output.stdout, said));
    }
    let program = command.get_program().to_string_lossy().into_owned();
    if let Some(error) = killed(Some(output.status), &program, subject) {
        return Err(error);
    }
    let words = last_words(&said, subject);
    Err(Error::input(subject, format!("{problem}{words}"), remedy))
}

/// Collects what a child says on stderr, so that it never waits for a reader.
pub fn listen(stderr: Option<ChildStderr>) -> JoinHandle<String> {
    std::thread::spawn(move || {
        const MOST: usize = 1 << 14;
        let mut said = Vec::new();
        let mut piece = [0; 4096];
        if let Some(mut stderr) = stderr {
            while let Ok(count @ 1..) = stderr.read(&mut piece) {
                said.extend_from_slice(&piece[..count]);
                if said.len() > 2 * MOST {
                    said.drain(..said.len() - MOST);
                }
            }
        }
        String::from_utf8_lossy(&said).into_owned()
    })
}

/// The line that says most of what went wrong, as `": …"`, without the file's own name, or nothing.
pub fn last_words(said: &str, subject: &str) -> String {
    let dull = ["Conversion failed", "Error while", "Last message repeated"];
    let plain = |line: &str| {
        // "[mov,mp4 @ 0x55…] moov atom not found"
        let line = line.trim();
        let line = if line.starts_with('[') { line.split_once("] ").map_or(line, |(_, rest)| rest) } else { line };
        let line = line.replace(&format!("file:{subject}: "), "").replace(&format!("{subject}: "), "");
        line.trim_end_matches('.').to_owned()
    };
    let lines: Vec<String> = said.lines().map(plain).filter(|line| !line.is_empty()).collect();
    let telling = lines.iter().find(|line| !dull.iter().any(|dull| line.starts_with(dull)));
    telling.or(lines.last()).map(|line| format!(": {line}")).unwrap_or_default()
}

/// The error of a child that a signal ended: then neither the file nor the choice of a codec is at fault.
pub fn killed(status: Option<ExitStatus>, program: &str, subject: &str) -> Option<Error> {
    #[cfg(unix)]
    let signal = std::os::unix::process::ExitStatusExt::signal(&status?);
    #[cfg(not(unix))]
    let signal: Option<i32> = status.and(None);
    let problem = format!("{program} was ended from outside, by signal {}", signal?);
    let remedy = "run the command again; if memory ran out, free some, or give a smaller --size";
    Some(Error::input(subject, problem, remedy))
}

/// Ends a child and what it writes.
pub fn end(child: &mut Child) {
    let _ = child.kill();
    let _ = child.wait();
}

/// Writes all bytes to a child's input. Returns `false` if it does not read any more.
pub fn feed(input: &mut impl Write, bytes: &[u8]) -> bool {
    input.write_all(bytes).is_ok()
}

/// The version of `ffmpeg`, as far as it is a release's.
pub fn version() -> Option<[u32; 2]> {
    static VERSION: std::sync::OnceLock<Option<[u32; 2]>> = std::sync::OnceLock::new();
    *VERSION.get_or_init(|| {
        let output = Command::new("ffmpeg").arg("-version").stdin(Stdio::null()).output().ok()?;
        let text = String::from_utf8_lossy(&output.stdout).into_owned();
        let word = text.strip_prefix("ffmpeg version ")?.split_whitespace().next()?.trim_start_matches('n').to_owned();
        let mut numbers = word.split(['.', '-']).map_while(|part| part.parse().ok());
        Some([numbers.next()?, numbers.next().unwrap_or(0)])
    })
}

/// The flags by which frames come out as they are stored, none twice and none left out.
pub fn every_frame() -> [&'static str; 2] {
    match version() {
        Some(version) if version < [5, 1] => ["-vsync", "passthrough"],
        _ => ["-fps_mode", "passthrough"],
    }
}

#[cfg(test)]
mod tests {
    use super::last_words;

    #[test]
    fn the_first_telling_line_is_kept() {
        let said = "[mov,mp4,m4a @ 0x5581] moov atom not found\nfile:a.mp4: Invalid data found when processing input\n";
        assert_eq!(last_words(said, "a.mp4"), ": moov atom not found");
        assert_eq!(last_words("file:a.mp4: Invalid data found\n", "a.mp4"), ": Invalid data found");
        assert_eq!(last_words("Conversion failed!\n", "a.mp4"), ": Conversion failed!");
        assert_eq!(last_words("", "a.mp4"), "");
    }
}
