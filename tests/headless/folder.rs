//! A folder in which `iprt` is run as users run it.

use std::{
    path::{Path, PathBuf},
    process::{Command, Output},
};

/// A box room and a ball in it.
pub const SCENE: &str = r#"
[panorama]
color = "room.png"
depth = { box = [4, 3, 5] }
[camera]
position = [0, 0, 0]
size = [40, 30]
[[object]]
name = "ball"
shape = "sphere"
size = [0.6, 0.6, 0.6]
translation = [0, -0.2, -1.5]
"#;

pub struct Folder(tempfile::TempDir);

impl Folder {
    /// An empty one.
    pub fn empty() -> Self {
        Self(tempfile::tempdir().expect("a folder"))
    }

    /// One with [`SCENE`].
    pub fn with_scene() -> Self {
        let folder = Self::empty();
        folder.paint("room.png", |x, y| [(4 * x) as u8, (8 * y) as u8, 90]);
        folder.write("scene.toml", SCENE);
        folder
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

    /// Writes a panorama of 64×32 texels.
    pub fn paint(&self, name: &str, texel: impl Fn(u32, u32) -> [u8; 3]) {
        let panorama = image::RgbImage::from_fn(64, 32, |x, y| image::Rgb(texel(x, y)));
        panorama.save(self.path(name)).expect("writes");
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
