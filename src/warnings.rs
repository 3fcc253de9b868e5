//! Warnings reach whoever acts, each once, wherever they come up: when a scene is loaded, or later, when a
//! frame of its panorama is. The command line listens; so can a program that uses this library.

use std::{
    collections::{BTreeMap, BTreeSet},
    sync::{Mutex, OnceLock, PoisonError},
};

static LISTENER: OnceLock<fn(&str)> = OnceLock::new();
/// Warnings of scenes and their files.
static TOLD: Mutex<BTreeSet<String>> = Mutex::new(BTreeSet::new());
/// Warnings of the program's own work, by kind: the first of it, and how many there were.
static REMARKED: Mutex<BTreeMap<String, (String, usize)>> = Mutex::new(BTreeMap::new());

/// Sets who hears warnings. Only the first call counts.
pub fn listen(listener: fn(&str)) {
    let _ = LISTENER.set(listener);
}

/// Tells warnings, each of which names its file. One that was told before is not told again.
pub fn tell<'a>(warnings: impl IntoIterator<Item = &'a String>) {
    for warning in warnings {
        let new = TOLD.lock().unwrap_or_else(PoisonError::into_inner).insert(warning.clone());
        if let (true, Some(listener)) = (new, LISTENER.get()) {
            listener(warning);
        }
    }
}

/// Tells a warning of the program's own work, as of a cache that cannot be written, for which no scene is to
/// blame. Of each kind the first is told, and [`repeated`] counts the others.
pub fn remark(kind: &str, warning: &str) {
    let mut remarked = REMARKED.lock().unwrap_or_else(PoisonError::into_inner);
    let (_, times) = remarked.entry(kind.to_owned()).or_insert_with(|| (warning.to_owned(), 0));
    *times += 1;
    if let (1, Some(listener)) = (*times, LISTENER.get()) {
        listener(warning);
    }
}

/// Returns how many different warnings of scenes and their files were told.
pub fn count() -> usize {
    TOLD.lock().unwrap_or_else(PoisonError::into_inner).len()
}

/// Returns the warnings of the program's own work that came up more than once, and how often.
pub fn repeated() -> Vec<(String, usize)> {
    let remarked = REMARKED.lock().unwrap_or_else(PoisonError::into_inner);
    remarked.values().filter(|(_, times)| *times > 1).cloned().collect()
}
