//! Finds missing and needless barriers from declared accesses alone, without a GPU. The validation layer
//! remains a second opinion. It does not report two dispatches that write the same place; this does.

use std::{collections::HashMap, fmt};

/// How a pass or transfer accesses a resource.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Access {
    Read,
    /// Only writes. What was there before is lost.
    Write,
    /// Reads and writes in place.
    ReadWrite,
}

impl Access {
    fn writes(self) -> bool {
        self != Self::Read
    }
}

/// A buffer, or one mip level of an image.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub struct Resource {
    /// The number of the buffer or image, unique within a device.
    pub id: u64,
    /// The mip level, 0 for buffers.
    pub level: u32,
}

/// Two accesses of one resource, at least one of which writes, without a barrier between them.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Hazard {
    /// `"read after write"`, `"write after read"`, `"write after write"` or `"bound twice"`.
    pub kind: &'static str,
    /// The pass or transfer that was recorded first.
    pub first: String,
    /// The pass or transfer that was recorded later.
    pub second: String,
    /// The name of the buffer or image.
    pub resource: String,
}

impl fmt::Display for Hazard {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self { kind, first, second, resource } = self;
        if *kind == BOUND_TWICE {
            return write!(f, "{first} binds {resource} twice and writes it");
        }
        write!(f, "{kind} on {resource}: no barrier between {first} and {second}")
    }
}

const BOUND_TWICE: &str = "bound twice";

/// The last writer and the last reader of a resource, as indices of recorded entries.
#[derive(Clone, Copy, Default)]
struct Uses {
    writer: Option<usize>,
    reader: Option<usize>,
}

impl Uses {
    /// Finds the kind of hazard that an access causes, and the earlier entry that it conflicts with.
    fn conflict(&self, access: Access) -> Option<(&'static str, usize)> {
        match (access.writes(), self.writer, self.reader) {
            (false, Some(writer), _) => Some(("read after write", writer)),
            (true, Some(writer), _) => {
                Some((if access == Access::Write { "write after write" } else { "read after write" }, writer))
            }
            (true, None, Some(reader)) => Some(("write after read", reader)),
            _ => None,
        }
    }

    fn note(&mut self, access: Access, now: usize) {
        if access.writes() {
            self.writer = Some(now);
        } else {
            self.reader = Some(now);
        }
    }
}

/// Collects accesses in recording order. Finds which of the requested barriers are needed, and the hazards
/// that none of them prevents.
#[derive(Default)]
pub struct Tracker {
    entries: Vec<String>,
    /// Accesses after the last needed barrier and before the last requested one.
    before: HashMap<Resource, Uses>,
    /// Accesses after the last requested barrier.
    since: HashMap<Resource, Uses>,
    /// For each requested barrier, whether it is needed.
    needed: Vec<bool>,
    hazards: Vec<Hazard>,
}

impl Tracker {
    /// Records a pass or transfer called `name` that accesses these resources, each given with its name.
    pub fn entry(&mut self, name: &str, accesses: &[(Resource, &str, Access)]) {
        let now = self.entries.len();
        self.entries.push(name.to_owned());
        for &(resource, resource_name, access) in accesses {
            let uses = self.since.entry(resource).or_default();
            if let Some((kind, first)) = uses.conflict(access) {
                self.hazards.push(Hazard {
                    kind: if first == now { BOUND_TWICE } else { kind },
                    first: self.entries[first].clone(),
                    second: name.to_owned(),
                    resource: resource_name.to_owned(),
                });
            }
            uses.note(access, now);
            // The last requested barrier separates this access from all that came before it.
            if self.before.get(&resource).is_some_and(|uses| uses.conflict(access).is_some()) {
                self.before.clear();
                if let Some(last) = self.needed.last_mut() {
                    *last = true;
                }
            }
        }
    }

    /// Requests a barrier that separates all before it from all after it.
    pub fn barrier(&mut self) {
        self.needed.push(false);
        for (resource, uses) in self.since.drain() {
            let all = self.before.entry(resource).or_default();
            *all = Uses { writer: uses.writer.or(all.writer), reader: uses.reader.or(all.reader) };
        }
    }

    /// The hazards found so far, in recording order.
    pub fn hazards(&self) -> &[Hazard] {
        &self.hazards
    }

    /// For each requested barrier, whether anything after it needs it.
    pub fn needed(&self) -> &[bool] {
        &self.needed
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use Access::{Read, ReadWrite, Write};

    fn resource(id: u64) -> Resource {
        Resource { id, level: 0 }
    }

    fn kinds(record: impl FnOnce(&mut Tracker)) -> Vec<&'static str> {
        let mut tracker = Tracker::default();
        record(&mut tracker);
        tracker.hazards().iter().map(|h| h.kind).collect()
    }

    #[test]
    fn each_kind_is_found_and_a_barrier_clears_it() {
        for (first, second, kind) in [
            (Write, Read, "read after write"),
            (Read, Write, "write after read"),
            (Write, Write, "write after write"),
            (ReadWrite, ReadWrite, "read after write"),
            (ReadWrite, Read, "read after write"),
            (Read, ReadWrite, "write after read"),
        ] {
            let run = |barrier: bool| {
                kinds(|t| {
                    t.entry("a", &[(resource(1), "x", first)]);
                    if barrier {
                        t.barrier();
                    }
                    t.entry("b", &[(resource(1), "x", second)]);
                })
            };
            assert_eq!(run(false), [kind], "{first:?} then {second:?}");
            assert!(run(true).is_empty(), "{first:?} then {second:?}");
        }
    }

    #[test]
    fn reads_share_and_other_resources_and_levels_do_not_conflict() {
        let found = kinds(|t| {
            t.entry("a", &[(resource(1), "x", Read), (resource(2), "y", Write)]);
            t.entry("b", &[(resource(1), "x", Read), (Resource { id: 2, level: 1 }, "y", Write)]);
            t.entry("c", &[(resource(3), "z", Write)]);
        });
        assert!(found.is_empty());
    }

    #[test]
    fn both_passes_and_the_resource_are_named_across_an_unrelated_pass() {
        let mut tracker = Tracker::default();
        tracker.entry("irradiance", &[(resource(7), "sample list", Write)]);
        tracker.entry("gbuffer", &[(resource(8), "normals", Write)]);
        tracker.entry("interpolate", &[(resource(7), "sample list", Read)]);
        assert_eq!(
            tracker.hazards()[0].to_string(),
            "read after write on sample list: no barrier between irradiance and interpolate"
        );
    }

    #[test]
    fn one_resource_bound_for_reading_and_for_writing_in_one_pass() {
        for order in [[Read, Write], [Write, Read], [Write, Write]] {
            let found = kinds(|t| t.entry("a", &order.map(|access| (resource(1), "x", access))));
            assert_eq!(found, ["bound twice"]);
        }
    }

    #[test]
    fn a_read_after_an_earlier_write_does_not_hide_the_writer() {
        let found = kinds(|t| {
            t.entry("a", &[(resource(1), "x", Write)]);
            t.entry("b", &[(resource(1), "x", Read)]);
            t.entry("c", &[(resource(1), "x", Write)]);
        });
        assert_eq!(found, ["read after write", "write after write"]);
    }

    /// Says which barriers (`|`) of a recording are needed. A capital letter is a pass that writes
    /// the resource of that letter, and a small one is a pass that reads it.
    fn needed(recording: &str) -> Vec<bool> {
        let mut tracker = Tracker::default();
        for c in recording.chars() {
            match c {
                '|' => tracker.barrier(),
                _ => {
                    let access = if c.is_uppercase() { Write } else { Read };
                    tracker.entry("pass", &[(resource(u64::from(c.to_ascii_lowercase())), "x", access)]);
                }
            }
        }
        assert!(tracker.hazards().is_empty(), "{recording}: {:?}", tracker.hazards());
        tracker.needed().to_vec()
    }

    #[test]
    fn a_barrier_that_separates_nothing_is_not_needed() {
        assert_eq!(needed("|A|a|a|"), [false, true, false, false]);
        assert_eq!(needed("A|B|a"), [false, true], "the last one that serves");
        assert_eq!(needed("A|B|ab"), [false, true], "one barrier serves both");
        assert_eq!(needed("A|aB|b|A"), [true, true, false], "the read of a lies before the second barrier");
        assert_eq!(needed("A|b|a|A"), [false, true, true]);
        assert_eq!(needed("A||a"), [false, true]);
    }
}
