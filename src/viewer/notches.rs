//! Tells one turn of a wheel from two.
//!
//! Where an X server has no wheel but buttons (as of `xdotool`, of remote desktops and of Xvfb), `winit` reports a notch
//! for the press of the button and one for its release. The raw events say which is which.

use std::time::{Duration, Instant};

/// How long after a release its notch comes at most.
const SOON: Duration = Duration::from_millis(80);

/// Releases of wheel buttons whose notches have not come.
#[derive(Default)]
pub struct Notches {
    released: u32,
    last: Option<Instant>,
}

impl Notches {
    /// Takes the release of a button.
    pub fn release(&mut self, button: u32, now: Instant) {
        if (4..=7).contains(&button) {
            self.released = if self.is_soon(now) { self.released + 1 } else { 1 };
            self.last = Some(now);
        }
    }

    /// Says whether a notch is one of the wheel, and not that of a release.
    pub fn counts(&mut self, now: Instant) -> bool {
        if self.released == 0 || !self.is_soon(now) {
            self.released = 0;
            return true;
        }
        self.released -= 1;
        false
    }

    fn is_soon(&self, now: Instant) -> bool {
        self.last.is_some_and(|last| now.duration_since(last) < SOON)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_button_that_is_pressed_and_released_is_one_notch() {
        let start = Instant::now();
        let at = |ms: u64| start + Duration::from_millis(ms);
        let mut notches = Notches::default();
        assert!(notches.counts(at(0)), "of the press");
        notches.release(4, at(10));
        assert!(!notches.counts(at(11)), "of the release");
        assert!(notches.counts(at(12)), "of the next press");
        // Two at once, and one whose notch went to another window.
        notches.release(5, at(20));
        notches.release(5, at(21));
        assert_eq!([notches.counts(at(22)), notches.counts(at(23)), notches.counts(at(24))], [false, false, true]);
        notches.release(4, at(30));
        notches.release(1, at(30));
        assert!(notches.counts(at(200)) && notches.counts(at(201)), "a wheel that has no buttons");
    }
}
