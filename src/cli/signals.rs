//! Ctrl-C and a polite `kill`. Whatever a command is doing, no half-written file stays.

use crate::{temporary, terminal};
use std::sync::atomic::{AtomicBool, Ordering};

/// Whether the command itself ends soon after [`STOP`].
static KEEPS: AtomicBool = AtomicBool::new(false);
static STOP: AtomicBool = AtomicBool::new(false);

/// From now on, INT, TERM and HUP remove half-written files and end the program, or set the flag of
/// [`interrupted`]. A HUP that is ignored, as under `nohup`, stays ignored.
pub fn watch() {
    #[cfg(unix)]
    let hangup = hangup_action();
    let handler = || {
        // Who asks twice does not want to wait.
        if KEEPS.load(Ordering::Relaxed) && !STOP.swap(true, Ordering::Relaxed) {
            return;
        }
        temporary::remove_all();
        terminal::say("iprt: interrupted; what was not finished is not kept");
        leave(130);
    };
    if let Err(error) = ctrlc::set_handler(handler) {
        tracing::warn!("Ctrl-C will leave half-written files: {error}");
    }
    #[cfg(unix)]
    if let Some(action) = hangup.filter(|action| action.sa_sigaction == libc::SIG_IGN) {
        // SAFETY: the action is the one that was there before.
        unsafe { libc::sigaction(libc::SIGHUP, &raw const action, std::ptr::null_mut()) };
    }
}

#[cfg(unix)]
fn hangup_action() -> Option<libc::sigaction> {
    let mut action = std::mem::MaybeUninit::uninit();
    // SAFETY: the action is only read, into memory of its own.
    unsafe { (libc::sigaction(libc::SIGHUP, std::ptr::null(), action.as_mut_ptr()) == 0).then(|| action.assume_init()) }
}

/// Ends the process without running what is registered for its end: other threads may be drawing.
pub fn leave(status: i32) -> ! {
    #[cfg(unix)]
    // SAFETY: nothing is used after this.
    unsafe {
        libc::_exit(status)
    }
    #[cfg(not(unix))]
    std::process::exit(status)
}

/// A flag that Ctrl-C and a polite `kill` set. The frame in flight is then finished, and what was done is
/// kept. Asked twice, the program ends at once.
pub fn interrupted() -> &'static AtomicBool {
    KEEPS.store(true, Ordering::Relaxed);
    &STOP
}

/// Says whether the program was asked to stop.
pub fn stopped() -> bool {
    STOP.load(Ordering::Relaxed)
}

/// Lets Ctrl-C end the program at once again, as it does before [`interrupted`] is called.
pub fn nothing_to_keep() {
    KEEPS.store(false, Ordering::Relaxed);
}
