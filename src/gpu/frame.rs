//! Records dispatches, transfers and barriers, checks them, and submits them as one piece of work.

use std::sync::{
    Arc,
    atomic::{AtomicBool, Ordering},
};

use super::{
    device::Gpu,
    encode,
    hazard::{Access, Resource, Tracker},
    layout::GpuStruct,
    memory::{Buffer, Image},
    pass::Pass,
    reflect::{Binding, Kind},
    timing::Timings,
};
use crate::{Error, Result};

/// What a binding of a pass is given.
#[derive(Clone, Debug)]
pub enum Bind {
    /// A buffer.
    Buffer(Buffer),
    /// An image: one level, or, for `None`, level 0 where it is stored to and all levels where it is sampled.
    Image(Image, Option<u32>),
}

impl From<&Buffer> for Bind {
    fn from(buffer: &Buffer) -> Self {
        Self::Buffer(buffer.clone())
    }
}

impl From<&Image> for Bind {
    fn from(image: &Image) -> Self {
        Self::Image(image.clone(), None)
    }
}

impl Image {
    /// One mip level, for binding.
    pub fn level(&self, level: u32) -> Bind {
        Bind::Image(self.clone(), Some(level))
    }
}

/// How many threads a dispatch runs.
#[derive(Clone, Copy, Debug)]
pub enum Threads<'a> {
    /// At least so many along each axis: rounded up to whole workgroups, so the shader checks its bounds.
    Size([u32; 3]),
    /// As many workgroups as three `u32` in the buffer, from that byte on, say.
    Indirect(&'a Buffer, u64),
}

#[derive(Clone)]
pub(super) enum Groups {
    /// So many, from the first on.
    Part {
        first: [u32; 3],
        count: [u32; 3],
    },
    Indirect(Buffer, u64),
}

/// Workgroups of one piece of a frame that is submitted in pieces.
const PIECE: u32 = 512;

/// Lets others use the queue between the dispatches of a frame, and stops it half way.
#[derive(Clone, Debug, Default)]
pub struct Pieces(Arc<AtomicBool>);

impl Pieces {
    /// What is being submitted in these pieces ends early with [`Error::Interrupted`], until [`Pieces::go_on`].
    pub fn stop(&self) {
        self.0.store(true, Ordering::Relaxed);
    }

    /// Takes [`Pieces::stop`] back.
    pub fn go_on(&self) {
        self.0.store(false, Ordering::Relaxed);
    }

    /// Whether it is stopped.
    pub fn stopped(&self) -> bool {
        self.0.load(Ordering::Relaxed)
    }
}

#[derive(Clone)]
pub(super) enum Action {
    Dispatch { pass: Pass, binds: Vec<Bind>, push: Vec<u8>, groups: Groups },
    Fill { buffer: Buffer, value: u32 },
    CopyImage { from: Image, to: Image },
    CopyBuffer { from: Buffer, to: Buffer },
}

impl Action {
    /// What it is, for labels and hazards, whatever name it is timed under.
    pub(super) fn label(&self) -> String {
        match self {
            Self::Dispatch { pass, .. } => pass.name().to_owned(),
            Self::Fill { buffer, .. } => format!("fill {}", buffer.name()),
            Self::CopyImage { from, to } => format!("copy {} to {}", from.name(), to.name()),
            Self::CopyBuffer { from, to } => format!("copy {} to {}", from.name(), to.name()),
        }
    }

    fn accesses(&self) -> Vec<(Resource, &str, Access)> {
        let buffer = |b: &Buffer| Resource { id: b.id(), level: 0 };
        let image = |i: &Image, level| Resource { id: i.id(), level };
        match self {
            Self::Fill { buffer: b, .. } => vec![(buffer(b), b.name(), Access::Write)],
            Self::CopyBuffer { from, to } => {
                vec![(buffer(from), from.name(), Access::Read), (buffer(to), to.name(), Access::Write)]
            }
            Self::CopyImage { from, to } => (0..from.levels())
                .flat_map(|l| [(image(from, l), from.name(), Access::Read), (image(to, l), to.name(), Access::Write)])
                .collect(),
            Self::Dispatch { pass, binds, groups, .. } => {
                let mut all = Vec::new();
                for (slot, bind) in pass.0.slots.iter().zip(binds) {
                    match bind {
                        Bind::Buffer(b) => all.push((buffer(b), b.name(), slot.access)),
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
    /// Timed under `name`.
    Run { name: String, action: Action },
    /// Says what it separates.
    Barrier(String),
}

/// One piece of GPU work, recorded in order. Nothing runs before [`Frame::submit`].
pub struct Frame {
    gpu: Gpu,
    commands: Vec<Command>,
    scopes: Vec<String>,
    skipped_barrier: Option<usize>,
    ignore_hazards: bool,
    repeated: Option<(&'static str, u32)>,
    pieces: Option<Pieces>,
}

impl Gpu {
    /// Starts recording.
    ///
    /// # Errors
    /// None at present; recording may come to need device objects.
    pub fn frame(&self) -> Result<Frame> {
        Ok(Frame {
            gpu: self.clone(),
            commands: Vec::new(),
            scopes: Vec::new(),
            skipped_barrier: None,
            ignore_hazards: false,
            repeated: None,
            pieces: None,
        })
    }
}

impl Frame {
    /// What is recorded from here to [`Frame::scope_end`] is timed under `name`. Scopes nest; the outermost names.
    pub fn scope(&mut self, name: &str) {
        self.scopes.push(name.to_owned());
    }

    /// Ends the innermost scope.
    pub fn scope_end(&mut self) {
        self.scopes.pop();
    }

    /// Runs `pass` with these bindings (by GLSL name, in any order) and push constants (`&()` for none). A size with
    /// a zero in it runs nothing.
    ///
    /// # Errors
    /// [`Error::Internal`] where bindings or push constants do not fit the pass; [`Error::Input`] where the device
    /// cannot run so many workgroups.
    pub fn dispatch<T: GpuStruct>(
        &mut self,
        pass: &Pass,
        binds: &[(&str, Bind)],
        push: &T,
        threads: Threads<'_>,
    ) -> Result<()> {
        let name = pass.name();
        let fault = |problem: String| Error::Internal(format!("dispatch of {name}: {problem}"));
        let ordered = order(pass, binds, &self.gpu).map_err(fault)?;
        let (size, fields) = pass.0.push.map_or((0, <()>::FIELDS), |push| (push.size, push.fields));
        if size_of::<T>() != size || T::FIELDS != fields {
            return Err(fault("these are not its push constants".into()));
        }
        let groups = match threads {
            Threads::Size(size) if size.contains(&0) => return Ok(()),
            Threads::Size(size) => {
                let count: [u32; 3] = std::array::from_fn(|i| size[i].div_ceil(pass.0.local_size[i]));
                let most = self.gpu.max_groups();
                if (0..3).any(|i| count[i] > most[i]) {
                    return Err(Error::input(
                        format!("pass {name}"),
                        format!("{size:?} threads make {count:?} workgroups and this device runs at most {most:?}"),
                        "use a smaller size or another device",
                    ));
                }
                Groups::Part { first: [0; 3], count }
            }
            Threads::Indirect(buffer, offset) => {
                if offset % 4 != 0 || offset.checked_add(12).is_none_or(|end| end > buffer.bytes()) {
                    return Err(fault(format!("{} holds no workgroup counts at byte {offset}", buffer.name())));
                }
                Groups::Indirect(buffer.clone(), offset)
            }
        };
        let push = bytemuck::bytes_of(push).to_vec();
        self.run(Action::Dispatch { pass: pass.clone(), binds: ordered, push, groups });
        Ok(())
    }

    /// What follows waits for, and sees, all that came before. `why` says what it separates.
    pub fn barrier(&mut self, why: &str) {
        self.commands.push(Command::Barrier(why.to_owned()));
    }

    /// Fills a buffer with one 32-bit value.
    pub fn fill(&mut self, buffer: &Buffer, value: u32) {
        self.run(Action::Fill { buffer: buffer.clone(), value });
    }

    /// Copies all layers and levels of an image to another of the same shape and format.
    ///
    /// # Errors
    /// [`Error::Internal`] where their shapes or formats differ.
    pub fn copy_image(&mut self, from: &Image, to: &Image) -> Result<()> {
        let shape = |i: &Image| (i.size(), i.layers(), i.levels(), i.format());
        if shape(from) != shape(to) {
            return Err(Error::Internal(format!("{from:?} cannot be copied to {to:?}")));
        }
        self.run(Action::CopyImage { from: from.clone(), to: to.clone() });
        Ok(())
    }

    /// Copies all of a buffer to the start of another.
    ///
    /// # Errors
    /// [`Error::Internal`] where the other is smaller.
    pub fn copy_buffer(&mut self, from: &Buffer, to: &Buffer) -> Result<()> {
        if from.bytes() > to.bytes() {
            return Err(Error::Internal(format!("{from:?} does not fit {to:?}")));
        }
        self.run(Action::CopyBuffer { from: from.clone(), to: to.clone() });
        Ok(())
    }

    /// How many barriers have been recorded.
    pub fn barriers(&self) -> usize {
        self.commands.iter().filter(|c| matches!(c, Command::Barrier(_))).count()
    }

    /// Submits it piece by piece, each waited for, so that other submissions get their turn in between.
    pub fn in_pieces(&mut self, pieces: Option<Pieces>) {
        self.pieces = pieces;
    }

    /// For tests: leaves the n-th barrier (from 0) out.
    #[doc(hidden)]
    pub fn skip_barrier(&mut self, n: Option<usize>) {
        self.skipped_barrier = n;
    }

    /// For tests: submits in spite of hazards, to see what the validation layer makes of them.
    #[doc(hidden)]
    pub fn ignore_hazards(&mut self, ignore: bool) {
        self.ignore_hazards = ignore;
    }

    /// For tests: every dispatch of the pass called `name` runs `times` more, so that it is slow.
    #[doc(hidden)]
    pub fn repeat(&mut self, repeated: Option<(&'static str, u32)>) {
        self.repeated = repeated;
    }

    /// Submits what was recorded and waits until it has run.
    ///
    /// # Errors
    /// [`Error::Internal`] where a barrier is missing, with nothing submitted; [`Error::Vulkan`] that names the last
    /// pass that ran where the device is lost or does not finish; [`Error::Interrupted`] where [`Pieces::stop`] was called.
    pub fn submit(self) -> Result<Timings> {
        let mut barriers = 0;
        let skipped = self.skipped_barrier;
        let commands: Vec<_> = self
            .commands
            .into_iter()
            .filter(|command| {
                let is_barrier = matches!(command, Command::Barrier(_));
                barriers += usize::from(is_barrier);
                !(is_barrier && Some(barriers - 1) == skipped)
            })
            .collect();
        if !self.ignore_hazards {
            find_hazards(&commands)?;
        }
        match self.pieces {
            Some(pieces) => encode::run_pieces(&self.gpu, cut(commands), &|| pieces.stopped()),
            None => encode::run(&self.gpu, commands),
        }
    }

    fn run(&mut self, action: Action) {
        let name = self.scopes.first().cloned().unwrap_or_else(|| action.label());
        if let Some((slow, times)) = self.repeated.filter(|(slow, _)| *slow == action.label()) {
            for _ in 0..times {
                self.commands.push(Command::Run { name: name.clone(), action: action.clone() });
                self.barrier(slow);
            }
        }
        self.commands.push(Command::Run { name, action });
    }
}

/// Every dispatch and transfer apart, and large dispatches cut. The beginning of a submission is a barrier too.
fn cut(commands: Vec<Command>) -> Vec<Vec<Command>> {
    let mut pieces = Vec::new();
    for command in commands {
        let Command::Run { name, action } = command else { continue };
        let Action::Dispatch { pass, binds, push, groups: Groups::Part { first, count } } = action else {
            pieces.push(vec![Command::Run { name, action }]);
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
                pieces.push(vec![Command::Run { name: name.clone(), action }]);
            }
        }
    }
    pieces
}

fn find_hazards(commands: &[Command]) -> Result<()> {
    let mut tracker = Tracker::default();
    for command in commands {
        match command {
            Command::Barrier(_) => tracker.barrier(),
            Command::Run { action, .. } => tracker.entry(&action.label(), &action.accesses()),
        }
    }
    if tracker.hazards().is_empty() {
        return Ok(());
    }
    let all: Vec<_> = tracker.hazards().iter().map(ToString::to_string).collect();
    Err(Error::Internal(all.join("; ")))
}

/// The bindings in the order of the pass's slots, each checked.
fn order(pass: &Pass, binds: &[(&str, Bind)], gpu: &Gpu) -> std::result::Result<Vec<Bind>, String> {
    let slots = &pass.0.slots;
    for (i, (name, _)) in binds.iter().enumerate() {
        if !slots.iter().any(|slot| slot.name == *name) {
            return Err(format!("it has no binding {name}"));
        }
        if binds[..i].iter().any(|(earlier, _)| earlier == name) {
            return Err(format!("binding {name} is given twice"));
        }
    }
    slots
        .iter()
        .map(|slot| {
            let (_, bind) = binds
                .iter()
                .find(|(name, _)| *name == slot.name)
                .ok_or_else(|| format!("binding {} is not given", slot.name))?;
            fits(slot, bind, gpu)?;
            Ok(bind.clone())
        })
        .collect()
}

fn fits(slot: &Binding, bind: &Bind, gpu: &Gpu) -> std::result::Result<(), String> {
    let name = &slot.name;
    match (slot.kind, bind) {
        (Kind::StorageBuffer, Bind::Buffer(_)) => Ok(()),
        (Kind::UniformBuffer, Bind::Buffer(buffer)) => {
            let most = u64::from(gpu.0.limits.max_uniform_buffer_range);
            if buffer.bytes() > most {
                return Err(format!("{name} is a uniform block of at most {most} bytes, {buffer:?} is larger"));
            }
            Ok(())
        }
        (Kind::StorageImage { array, .. } | Kind::Sampled { array, .. }, Bind::Image(image, level)) => {
            if !array && image.layers() > 1 {
                return Err(format!("{name} has no layers in GLSL, {image:?} has"));
            }
            if level.is_some_and(|level| level >= image.levels()) {
                return Err(format!("{name}: {image:?} has no such level"));
            }
            match slot.kind {
                Kind::StorageImage { format, .. } if format != image.format() => {
                    Err(format!("{name} is {format:?} in GLSL, {image:?} is not"))
                }
                Kind::Sampled { integer, .. } if integer != image.format().is_integer() => {
                    Err(format!("{name} and {image:?} are not both of integers or both of floats"))
                }
                _ => Ok(()),
            }
        }
        (Kind::StorageBuffer | Kind::UniformBuffer, Bind::Image(..)) => Err(format!("{name} takes a buffer")),
        (_, Bind::Buffer(_)) => Err(format!("{name} takes an image")),
    }
}
