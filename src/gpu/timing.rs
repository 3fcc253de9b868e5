//! GPU time from timestamp queries.

use std::{collections::HashSet, sync::Arc, time::Instant};

/// How long one dispatch or transfer took.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Entry {
    /// The scopes in which it was recorded, the outermost first, and then its own name.
    pub path: Arc<[String]>,
    /// When it began, milliseconds after the first entry.
    pub start_ms: f64,
    /// How long it took, milliseconds.
    pub ms: f64,
}

impl Entry {
    /// The pass to which it belongs: its outermost scope, or its own name.
    pub fn pass(&self) -> &str {
        self.path.first().map_or("", String::as_str)
    }
}

/// How long each dispatch and transfer of one submitted frame took.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Timings {
    /// One entry for each dispatch or transfer, in recording order. Paths may repeat.
    pub entries: Vec<Entry>,
    /// Milliseconds from the first timestamp to the last, including the barriers between entries.
    pub gpu_ms: f64,
    /// How many barriers were issued, not counting the one at the beginning.
    pub barriers: usize,
    /// When the frame was known to have ended: after its submission, if the driver had drawn it by then, or
    /// else when it was waited for.
    pub ended: Option<Instant>,
}

/// A scope, a dispatch or a transfer, with what was recorded within it.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Node {
    pub name: String,
    /// When its first entry began, milliseconds after the frame's first.
    pub start_ms: f64,
    /// The sum of its entries, milliseconds.
    pub ms: f64,
    /// The scopes, dispatches and transfers in it. Empty for a scope that holds a single entry.
    pub children: Vec<Node>,
}

impl Timings {
    /// The sum of a pass's entries, milliseconds. `None` if the pass did not run.
    pub fn pass(&self, name: &str) -> Option<f64> {
        let mut times = self.entries.iter().filter(|entry| entry.pass() == name).map(|entry| entry.ms).peekable();
        times.peek()?;
        Some(times.sum())
    }

    /// The sum of all entries, milliseconds.
    pub fn sum(&self) -> f64 {
        self.entries.iter().map(|entry| entry.ms).sum()
    }

    /// Takes paths from `known`, so that the times of many frames hold each once.
    pub fn share_paths(&mut self, known: &mut HashSet<Arc<[String]>>) {
        for entry in &mut self.entries {
            match known.get(&entry.path) {
                Some(path) => entry.path = Arc::clone(path),
                None => drop(known.insert(Arc::clone(&entry.path))),
            }
        }
    }

    /// Builds the tree of scopes. Entries of the same path are summed.
    pub fn tree(&self) -> Vec<Node> {
        let mut tree = Vec::new();
        for entry in &self.entries {
            let mut level = &mut tree;
            for name in &*entry.path {
                let known = level.iter().position(|node: &Node| node.name == *name);
                let at = known.unwrap_or_else(|| {
                    level.push(Node { name: name.clone(), start_ms: entry.start_ms, ..Node::default() });
                    level.len() - 1
                });
                level[at].ms += entry.ms;
                level = &mut level[at].children;
            }
        }
        tree.iter_mut().for_each(Node::simplify);
        tree
    }
}

impl Node {
    /// Drops the only child of a scope if it has no children, as both say the same.
    fn simplify(&mut self) {
        self.children.iter_mut().for_each(Self::simplify);
        if let [only] = &self.children[..]
            && only.children.is_empty()
        {
            self.children.clear();
        }
    }
}

/// Turns raw timestamps into milliseconds.
#[derive(Clone, Copy, Debug)]
pub(super) struct Clock {
    /// How many low bits of a timestamp are valid (`timestampValidBits`).
    pub valid_bits: u32,
    /// Nanoseconds in one tick (`timestampPeriod`).
    pub period_ns: f32,
}

impl Clock {
    /// Milliseconds from `start` to `end`, which may wrap around the valid bits once.
    pub(super) fn milliseconds(self, start: u64, end: u64) -> f64 {
        let mask = if self.valid_bits >= 64 { u64::MAX } else { (1 << self.valid_bits) - 1 };
        (end.wrapping_sub(start) & mask) as f64 * f64::from(self.period_ns) * 1e-6
    }

    /// Timings of the entries of these paths. `stamps` holds the start and the end of each.
    pub(super) fn timings<'a>(self, paths: impl Iterator<Item = &'a [String]>, stamps: &[u64]) -> Timings {
        let since_first = |stamp| stamps.first().map_or(0.0, |&first| self.milliseconds(first, stamp));
        let entries = paths.zip(stamps.chunks_exact(2)).map(|(path, pair)| Entry {
            path: path.into(),
            start_ms: since_first(pair[0]),
            ms: self.milliseconds(pair[0], pair[1]),
        });
        Timings {
            entries: entries.collect(),
            gpu_ms: stamps.last().map_or(0.0, |&last| since_first(last)),
            ..Timings::default()
        }
    }
}

/// Says in which of the recorded passes the GPU stopped, from which of their timestamps were written.
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

    fn entry(path: &[&str], start_ms: f64, ms: f64) -> Entry {
        Entry { path: path.iter().map(|name| (*name).to_owned()).collect(), start_ms, ms }
    }

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
        let paths = [vec!["a".to_owned()], vec!["b".to_owned(), "c".to_owned()]];
        let timings = clock.timings(paths.iter().map(Vec::as_slice), &[10, 12, 15, 20]);
        assert_eq!(timings.entries, [entry(&["a"], 0.0, 2.0), entry(&["b", "c"], 5.0, 5.0)]);
        assert_eq!((timings.gpu_ms, timings.sum()), (10.0, 7.0));
        assert_eq!((timings.pass("b"), timings.pass("c")), (Some(5.0), None));
        assert_eq!(clock.timings(std::iter::empty(), &[]), Timings::default());
    }

    #[test]
    fn scopes_make_a_tree() {
        let entries = vec![
            entry(&["gbuffer", "visibility"], 0.0, 1.0),
            entry(&["gbuffer", "coverage"], 1.0, 2.0),
            entry(&["atrous", "level 1", "atrous"], 3.0, 4.0),
            entry(&["atrous", "level 2", "atrous"], 7.0, 8.0),
            entry(&["composite"], 15.0, 16.0),
            entry(&["gbuffer", "coverage"], 31.0, 32.0),
        ];
        let node = |name: &str, start_ms, ms, children| Node { name: name.to_owned(), start_ms, ms, children };
        let leaf = |name: &str, start_ms, ms| node(name, start_ms, ms, vec![]);
        assert_eq!(
            Timings { entries, ..Timings::default() }.tree(),
            [
                node("gbuffer", 0.0, 35.0, vec![leaf("visibility", 0.0, 1.0), leaf("coverage", 1.0, 34.0)]),
                node("atrous", 3.0, 12.0, vec![leaf("level 1", 3.0, 4.0), leaf("level 2", 7.0, 8.0)]),
                leaf("composite", 15.0, 16.0),
            ]
        );
    }

    #[test]
    fn a_lost_device_names_the_pass_it_was_in() {
        let names = ["gbuffer", "irradiance", "composite"];
        assert_eq!(where_it_stopped(&names, &[true, true, true, false, false, false]), "in irradiance");
        assert_eq!(where_it_stopped(&names, &[true, true, false, false, false, false]), "after gbuffer");
        assert_eq!(where_it_stopped(&names, &[]), "somewhere from gbuffer to composite");
    }
}
