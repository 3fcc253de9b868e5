//! What a frame holds: dispatches, transfers and barriers. Barriers that separate nothing are left out here, missing ones are
//! refused, and large frames are cut into pieces.

use ash::vk;

use super::{
    acceleration::Acceleration,
    bind::Bind,
    frame::FrameOptions,
    hazard::{Access, Resource, Tracker},
    memory::{Buffer, Image},
    pass::Pass,
    reflect::Kind,
};
use crate::{Error, Result};

#[derive(Clone)]
pub(super) enum Groups {
    /// `count` workgroups, from `first` on.
    Part {
        first: [u32; 3],
        count: [u32; 3],
    },
    Indirect(Buffer, u64),
}

/// Workgroups in one piece, if a frame is submitted in pieces.
const PIECE: u32 = 512;

#[derive(Clone)]
pub(super) enum Action {
    Dispatch {
        pass: Pass,
        binds: Vec<Bind>,
        push: Vec<u8>,
        groups: Groups,
    },
    Fill {
        buffer: Buffer,
        value: u32,
    },
    /// Copies from the slot's staging memory, given as a buffer and the offset of the bytes in it.
    Write {
        from: (vk::Buffer, u64),
        to: Destination,
    },
    CopyBuffer {
        from: Buffer,
        to: Buffer,
    },
    /// Builds a structure of `count` items, from `first` on.
    Build {
        structure: Acceleration,
        items: Buffer,
        range: [u32; 2],
        scratch: Buffer,
    },
}

#[derive(Clone)]
pub(super) enum Destination {
    /// `bytes` bytes from `offset` on.
    Buffer { buffer: Buffer, offset: u64, bytes: u64 },
    /// `rows` rows of one layer of one level, from `first_row` on.
    Image { image: Image, layer: u32, level: u32, first_row: u32, rows: u32 },
}

impl Action {
    /// The name in labels, hazards and timings.
    pub(super) fn label(&self) -> String {
        match self {
            Self::Write { to: Destination::Buffer { buffer, .. }, .. } => format!("write {}", buffer.name()),
            Self::Write { to: Destination::Image { image, .. }, .. } => format!("write {}", image.name()),
            Self::Dispatch { pass, .. } => pass.name().to_owned(),
            Self::Fill { buffer, .. } => format!("fill {}", buffer.name()),
            Self::CopyBuffer { from, to } => format!("copy {} to {}", from.name(), to.name()),
            Self::Build { structure, .. } => format!("build {}", structure.name()),
        }
    }

    fn accesses(&self) -> Vec<(Resource, &str, Access)> {
        let buffer = |b: &Buffer| Resource { id: b.id(), level: 0 };
        let image = |i: &Image, level| Resource { id: i.id(), level };
        let structure = |a: &Acceleration| Resource { id: a.id(), level: 0 };
        match self {
            Self::Fill { buffer: b, .. } | Self::Write { to: Destination::Buffer { buffer: b, .. }, .. } => {
                vec![(buffer(b), b.name(), Access::Write)]
            }
            Self::Write { to: Destination::Image { image: i, level, .. }, .. } => {
                vec![(image(i, *level), i.name(), Access::Write)]
            }
            Self::CopyBuffer { from, to } => {
                vec![(buffer(from), from.name(), Access::Read), (buffer(to), to.name(), Access::Write)]
            }
            Self::Build { structure: built, items, scratch, .. } => {
                let mut all = vec![
                    (buffer(items), items.name(), Access::Read),
                    (buffer(scratch), scratch.name(), Access::ReadWrite),
                    (structure(built), built.name(), Access::Write),
                ];
                all.extend(built.places().iter().map(|below| (structure(below), below.name(), Access::Read)));
                all
            }
            Self::Dispatch { pass, binds, groups, .. } => {
                let mut all = Vec::new();
                for (slot, bind) in pass.0.slots.iter().zip(binds) {
                    match bind {
                        Bind::Buffer(b) => all.push((buffer(b), b.name(), slot.access)),
                        // Queries go on into the structures that are placed.
                        Bind::Acceleration(a) => {
                            let both = std::iter::once(a).chain(a.places());
                            all.extend(both.map(|a| (structure(a), a.name(), slot.access)));
                        }
                        Bind::Image(i, level) => {
                            let levels = match (level, slot.kind) {
                                (Some(level), _) => *level..*level + 1,
                                (None, Kind::Sampled { .. }) => 0..i.levels(),
                                (None, _) => 0..1,
                            };
                            all.extend(levels.map(|l| (image(i, l), i.name(), slot.access)));
                        }
                    }
                }
                if let Groups::Indirect(b, _) = groups {
                    all.push((buffer(b), b.name(), Access::Read));
                }
                all
            }
        }
    }
}

pub(super) enum Command {
    /// An action that is timed under `path`: its scopes, the outermost first, then its own name.
    Run { path: Vec<String>, action: Action },
    /// A barrier, with the text that says what it separates.
    Barrier(String),
}

impl Command {
    pub(super) fn path(&self) -> Option<&[String]> {
        match self {
            Self::Run { path, .. } => Some(path),
            Self::Barrier(_) => None,
        }
    }
}

/// Leaves out the barriers that separate nothing.
pub(super) fn needed(commands: Vec<Command>, options: &FrameOptions) -> Result<Vec<Command>> {
    let tracked = track(&commands);
    let (mut asked, mut issued) = (0, 0);
    let mut without = |command: &Command| {
        if matches!(command, Command::Run { .. }) {
            return true;
        }
        asked += 1;
        if !tracked.needed()[asked - 1] {
            return false;
        }
        issued += 1;
        options.skip_barrier != Some(issued - 1)
    };
    let kept: Vec<_> = commands.into_iter().filter(|command| without(command)).collect();
    let tracked = if options.skip_barrier.is_some() { track(&kept) } else { tracked };
    if tracked.hazards().is_empty() || options.ignore_hazards {
        return Ok(kept);
    }
    let all: Vec<_> = tracked.hazards().iter().map(ToString::to_string).collect();
    Err(Error::Internal(all.join("; ")))
}

fn track(commands: &[Command]) -> Tracker {
    let mut tracker = Tracker::default();
    for command in commands {
        match command {
            Command::Barrier(_) => tracker.barrier(),
            Command::Run { action, .. } => tracker.entry(&action.label(), &action.accesses()),
        }
    }
    tracker
}

/// Makes each dispatch and transfer a piece, and cuts large dispatches. Every submission begins with a
/// barrier.
pub(super) fn cut(commands: Vec<Command>) -> Vec<Vec<Command>> {
    let mut pieces = Vec::new();
    for command in commands {
        let Command::Run { path, action } = command else { continue };
        let Action::Dispatch { pass, binds, push, groups: Groups::Part { first, count } } = action else {
            pieces.push(vec![Command::Run { path, action }]);
            continue;
        };
        let rows = (PIECE / count[0].max(1)).max(1);
        for z in 0..count[2] {
            for y in (0..count[1]).step_by(rows as usize) {
                let groups = Groups::Part {
                    first: [first[0], first[1] + y, first[2] + z],
                    count: [count[0], rows.min(count[1] - y), 1],
                };
                let action = Action::Dispatch { pass: pass.clone(), binds: binds.clone(), push: push.clone(), groups };
                pieces.push(vec![Command::Run { path: path.clone(), action }]);
            }
        }
    }
    pieces
}
