//! How long a picture has not been what was asked for.

use super::state::EngineOutput;
use std::time::{Duration, Instant};

/// It is said if it takes longer.
pub const PATIENCE: Duration = Duration::from_millis(1500);

/// The last request, and since when each picture has been behind it.
pub struct Behind {
    asked: u64,
    /// Since when a picture has not changed, while a newer one was asked for.
    since: [Instant; 2],
}

impl Behind {
    /// Nothing was asked for yet.
    pub fn new() -> Self {
        Self { asked: 0, since: [Instant::now(); 2] }
    }

    /// Takes the number of a request.
    pub fn ask(&mut self, number: u64, shown: &EngineOutput) {
        for side in 0..2 {
            if !self.is_so(side, shown) {
                self.since[side] = Instant::now();
            }
        }
        self.asked = number;
    }

    /// Takes new pictures, which answer newer requests.
    pub fn see(&mut self, new: &EngineOutput, old: &EngineOutput) {
        let answers = |shown: &EngineOutput, side: usize| shown.pictures[side].as_ref().map(|p| (p.number, p.preview));
        for side in 0..2 {
            if answers(new, side) != answers(old, side) {
                self.since[side] = Instant::now();
            }
        }
    }

    /// Whether a picture is not what was asked for.
    pub fn is_so(&self, side: usize, shown: &EngineOutput) -> bool {
        shown.pictures[side].as_ref().is_none_or(|picture| picture.preview || picture.number != self.asked)
    }

    /// How long that has been so, if it is worth a word.
    pub fn long(&self, side: usize, shown: &EngineOutput) -> Option<Duration> {
        let long = self.since[side].elapsed();
        (self.is_so(side, shown) && long > PATIENCE).then_some(long)
    }
}

impl Default for Behind {
    fn default() -> Self {
        Self::new()
    }
}
