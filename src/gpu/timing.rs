//! GPU time from timestamp queries.

/// How long each dispatch and transfer of one submitted frame took.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Timings {
    /// Name and milliseconds, one a dispatch or transfer, in recording order; equal names may repeat.
    pub entries: Vec<(String, f64)>,
    /// When each entry began, milliseconds after the first.
    pub starts_ms: Vec<f64>,
    /// Milliseconds from the first timestamp to the last: the entries and the barriers between them.
    pub gpu_ms: f64,
}

/// Turns raw timestamps into milliseconds.
#[derive(Clone, Copy, Debug)]
pub(super) struct Clock {
    /// How many low bits of a timestamp mean anything (`timestampValidBits`).
    pub valid_bits: u32,
    /// Nanoseconds a tick (`timestampPeriod`).
    pub period_ns: f32,
}

impl Clock {
    /// Milliseconds from `start` to `end`, across one wrap of the valid bits.
    pub(super) fn milliseconds(self, start: u64, end: u64) -> f64 {
        let mask = if self.valid_bits >= 64 { u64::MAX } else { (1 << self.valid_bits) - 1 };
        (end.wrapping_sub(start) & mask) as f64 * f64::from(self.period_ns) * 1e-6
    }

    /// Timings of the entries called `names`, each with its start and its end in `stamps`.
    pub(super) fn timings(self, names: &[&str], stamps: &[u64]) -> Timings {
        let entries = names
            .iter()
            .zip(stamps.chunks_exact(2))
            .map(|(name, pair)| ((*name).to_owned(), self.milliseconds(pair[0], pair[1])))
            .collect();
        let gpu_ms = match (stamps.first(), stamps.last()) {
            (Some(&first), Some(&last)) => self.milliseconds(first, last),
            _ => 0.0,
        };
        let starts_ms = stamps.iter().step_by(2).map(|&stamp| self.milliseconds(stamps[0], stamp)).collect();
        Timings { entries, starts_ms, gpu_ms }
    }
}

/// Which of the recorded passes the GPU was in when it stopped, from which of their timestamps had been written.
pub(super) fn where_it_stopped(names: &[&str], written: &[bool]) -> String {
    let started = |i: usize| written.get(2 * i).copied().unwrap_or(false);
    let ended = |i: usize| written.get(2 * i + 1).copied().unwrap_or(false);
    if let Some(i) = (0..names.len()).rev().find(|&i| started(i) && !ended(i)) {
        return format!("in {}", names[i]);
    }
    match ((0..names.len()).rev().find(|&i| ended(i)), names) {
        (Some(i), _) => format!("after {}", names[i]),
        (None, [first, .., last]) => format!("somewhere from {first} to {last}"),
        (None, [only]) => format!("in {only}"),
        (None, []) => "in a frame without passes".to_owned(),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn timestamps_wrap_at_their_valid_bits() {
        let clock = Clock { valid_bits: 36, period_ns: 2.0 };
        let garbage = 0xABCD << 48;
        let (start, end) = ((1u64 << 36) - 100, 900 | garbage);
        assert_eq!(clock.milliseconds(start, end), 1000.0 * 2.0 * 1e-6);
        assert_eq!(Clock { valid_bits: 64, period_ns: 1.0 }.milliseconds(5, 1_000_005), 1.0);
    }

    #[test]
    fn the_frame_is_the_span_and_holds_the_gaps() {
        let clock = Clock { valid_bits: 64, period_ns: 1e6 };
        let timings = clock.timings(&["a", "b"], &[10, 12, 15, 20]);
        assert_eq!(timings.entries, [("a".to_owned(), 2.0), ("b".to_owned(), 5.0)]);
        assert_eq!(timings.gpu_ms, 10.0);
        assert_eq!(clock.timings(&[], &[]), Timings::default());
    }

    #[test]
    fn a_lost_device_names_the_pass_it_was_in() {
        let names = ["gbuffer", "irradiance", "composite"];
        assert_eq!(where_it_stopped(&names, &[true, true, true, false, false, false]), "in irradiance");
        assert_eq!(where_it_stopped(&names, &[true, true, false, false, false, false]), "after gbuffer");
        assert_eq!(where_it_stopped(&names, &[]), "somewhere from gbuffer to composite");
    }
}
