//! Files that are written beside their target. Each is locked while its process lives, so that nothing stays
//! of those that a process left behind when it was killed.

use std::{
    collections::BTreeSet,
    fs::{self, File},
    io,
    path::{Path, PathBuf},
    sync::{Mutex, PoisonError},
    time::{Duration, SystemTime},
};

use tempfile::{Builder, NamedTempFile};

/// How the names of all of them begin.
const PREFIX: &str = ".iprt-";
/// A younger file may not be locked yet.
const GRACE: Duration = Duration::from_secs(60);

/// The files that this process has open, and the folders that it has swept.
static LIVE: Mutex<(BTreeSet<PathBuf>, BTreeSet<PathBuf>)> = Mutex::new((BTreeSet::new(), BTreeSet::new()));

/// A file that is removed unless it is [kept](Temporary::keep).
pub struct Temporary {
    path: PathBuf,
    file: Option<NamedTempFile>,
}

impl Temporary {
    /// Makes a file in the folder where it will stay, and removes what dead processes left there.
    ///
    /// # Errors
    /// Fails if the folder cannot be written.
    pub fn new(folder: &Path) -> io::Result<Self> {
        let mut builder = Builder::new();
        builder.prefix(PREFIX);
        #[cfg(unix)]
        builder.permissions(std::os::unix::fs::PermissionsExt::from_mode(0o666)); // As for any new file, the umask applies.
        // A signal finds either no file, or one that it knows.
        let mut live = LIVE.lock().unwrap_or_else(PoisonError::into_inner);
        if live.1.insert(folder.to_owned()) {
            sweep(folder);
        }
        let file = builder.tempfile_in(folder)?;
        let _ = file.as_file().try_lock(); // some file systems have no locks; then nothing is swept
        live.0.insert(file.path().to_owned());
        Ok(Self { path: file.path().to_owned(), file: Some(file) })
    }

    /// Where it is until it is kept, for another program to write.
    pub fn path(&self) -> &Path {
        &self.path
    }

    /// The file, open for writing.
    ///
    /// # Errors
    /// Never fails before [`Temporary::keep`].
    pub fn file(&mut self) -> io::Result<&mut File> {
        self.file.as_mut().map(NamedTempFile::as_file_mut).ok_or_else(|| io::ErrorKind::NotFound.into())
    }

    /// Gives the file its name.
    ///
    /// # Errors
    /// Fails if there is something of that name that cannot be replaced.
    pub fn keep(mut self, path: &Path) -> io::Result<()> {
        match self.file.take() {
            Some(file) => file.persist(path).map(drop).map_err(|error| error.error),
            None => Err(io::ErrorKind::NotFound.into()),
        }
    }
}

impl Drop for Temporary {
    fn drop(&mut self) {
        self.file = None;
        LIVE.lock().unwrap_or_else(PoisonError::into_inner).0.remove(&self.path);
    }
}

/// Removes all files of this process. No file can be made after that, so the process must end.
pub fn remove_all() {
    let live = LIVE.lock().unwrap_or_else(PoisonError::into_inner);
    for path in &live.0 {
        let _ = fs::remove_file(path);
    }
    std::mem::forget(live);
}

/// Removes the files of dead processes from a folder. That it cannot is no error.
fn sweep(folder: &Path) {
    let Ok(entries) = fs::read_dir(folder) else { return };
    for entry in entries.filter_map(Result::ok) {
        let named = entry.file_name().to_str().is_some_and(|name| name.starts_with(PREFIX));
        let old = |data: fs::Metadata| {
            data.is_file()
                && data.modified().is_ok_and(|at| SystemTime::now().duration_since(at).is_ok_and(|age| age > GRACE))
        };
        if named && entry.metadata().is_ok_and(old) && is_dead(&entry.path()) {
            let _ = fs::remove_file(entry.path());
        }
    }
}

/// Says whether nobody holds the file's lock. A file system without locks says that somebody does.
fn is_dead(path: &Path) -> bool {
    File::options().append(true).open(path).is_ok_and(|file| file.try_lock().is_ok())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn only_what_the_dead_left_is_swept() {
        let folder = tempfile::tempdir().expect("a folder");
        let old = SystemTime::now() - 2 * GRACE;
        let place = |name: &str, modified: SystemTime| {
            let file = File::create(folder.path().join(name)).expect("made");
            file.set_modified(modified).expect("set");
            file
        };
        drop(place(".iprt-dead", old));
        drop(place(".iprt-young", SystemTime::now()));
        drop(place("iprt-0001.png", old));
        let held = place(".iprt-held", old);
        held.try_lock().expect("free");
        let mut new = Temporary::new(folder.path()).expect("writable");
        io::Write::write_all(new.file().expect("open"), b"whole").expect("writes");
        let names = || {
            let mut names: Vec<_> =
                folder.path().read_dir().expect("a folder").map(|e| e.expect("readable").file_name()).collect();
            names.sort();
            names
        };
        assert_eq!(names().len(), 4, "{:?}", names());
        new.keep(&folder.path().join("kept")).expect("renamed");
        assert_eq!(names(), [".iprt-held", ".iprt-young", "iprt-0001.png", "kept"]);
        assert_eq!(fs::read(folder.path().join("kept")).expect("there"), b"whole");
    }
}
