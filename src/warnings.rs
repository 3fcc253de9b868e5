//! Warnings reach whoever acts, each once, wherever they come up: when a scene is loaded, or later, when a
//! frame of its panorama is. The command line listens; so can a program that uses this library.

use std::{
    collections::BTreeSet,
    sync::{Mutex, OnceLock, PoisonError},
};

static LISTENER: OnceLock<fn(&str)> = OnceLock::new();
static TOLD: Mutex<BTreeSet<String>> = Mutex::new(BTreeSet::new());

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

/// Returns how many different warnings were told.
pub fn count() -> usize {
    TOLD.lock().unwrap_or_else(PoisonError::into_inner).len()
}
