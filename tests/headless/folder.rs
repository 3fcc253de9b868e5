//! A folder in which `iprt` is run as users run it.

use std::{
    path::{Path, PathBuf},
    process::{Command, Output},
};

pub struct Folder(tempfile::TempDir);

impl Folder {
    /// An empty one.
    pub fn empty() -> Self {
        Self(tempfile::tempdir().expect("a folder"))
    }

    pub fn root(&self) -> &Path {
        self.0.path()
    }

    pub fn path(&self, name: &str) -> PathBuf {
        self.0.path().join(name)
    }

    pub fn write(&self, name: &str, text: &str) {
        std::fs::write(self.path(name), text).expect("writes");
    }

    /// Runs `iprt` in it, with words parted by blanks; it must not panic.
    pub fn run(&self, arguments: &str) -> Output {
        self.run_with(&arguments.split_whitespace().collect::<Vec<_>>())
    }

    /// The same with arguments that may hold blanks.
    pub fn run_with(&self, arguments: &[&str]) -> Output {
        let output = self.command().args(arguments).output().expect("runs");
        let stderr = String::from_utf8_lossy(&output.stderr);
        assert!(!stderr.contains("panicked"), "iprt {arguments:?}: {stderr}");
        output
    }

    /// `iprt`, to be run in it.
    pub fn command(&self) -> Command {
        let mut command = Command::new(env!("CARGO_BIN_EXE_iprt"));
        command.current_dir(&self.0).env_remove("IPRT_VALIDATION");
        command
    }

    /// What a run that succeeds prints.
    pub fn succeeds(&self, arguments: &str) -> String {
        self.succeeds_with(&arguments.split_whitespace().collect::<Vec<_>>())
    }

    pub fn succeeds_with(&self, arguments: &[&str]) -> String {
        let output = self.run_with(arguments);
        let stderr = String::from_utf8_lossy(&output.stderr);
        assert_eq!(output.status.code(), Some(0), "iprt {arguments:?}: {stderr}");
        String::from_utf8(output.stdout).expect("UTF-8")
    }

    /// Demands exit status 2, what the user gave, and one line on stderr that holds these words.
    pub fn fails(&self, arguments: &str, words: &[&str]) {
        self.fails_by(arguments, 2, words);
    }

    /// The same with another exit status.
    pub fn fails_by(&self, arguments: &str, status: i32, words: &[&str]) {
        let output = self.run(arguments);
        let stderr = String::from_utf8_lossy(&output.stderr);
        assert_eq!(output.status.code(), Some(status), "iprt {arguments}: {stderr}");
        assert_eq!(stderr.trim_end().lines().count(), 1, "iprt {arguments}: {stderr}");
        for word in words {
            assert!(stderr.contains(word), "iprt {arguments}: no \"{word}\" in {stderr}");
        }
    }
}
