//! Records dispatches, transfers and barriers, checks them, and submits them as one piece of work.

use std::sync::{
    Arc,
    atomic::{AtomicBool, Ordering},
};

use ash::vk;
use bytemuck::Pod;

use super::{
    device::Gpu,
    encode,
    hazard::{Access, Resource, Tracker},
    layout::GpuStruct,
    memory::{Buffer, Image},
    pass::Pass,
    reflect::{Binding, Kind},
    slot::HeldSlot,
    ticket::Ticket,
    timing::Timings,
    transfer,
};
use crate::{Error, Result};

/// What a shader's binding is bound to.
#[derive(Clone, Debug)]
pub enum Bind {
    Buffer(Buffer),
    /// An image and the level to bind. `None` binds level 0 for stores and all levels for sampling.
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
    /// Binds one mip level.
    pub fn level(&self, level: u32) -> Bind {
        Bind::Image(self.clone(), Some(level))
    }
}

/// How many threads a dispatch runs.
#[derive(Clone, Copy, Debug)]
pub enum Threads<'a> {
    /// At least this many along each axis. Workgroups are whole, so the shader checks its bounds.
    Size([u32; 3]),
    /// The buffer holds the number of workgroups along each axis, as three `u32` from this byte on.
    Indirect(&'a Buffer, u64),
}

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

/// Submits a frame in pieces. Other work can run between them, and the frame can be stopped half way.
#[derive(Clone, Debug, Default)]
pub struct Pieces(Arc<AtomicBool>);

impl Pieces {
    /// Ends frames that are submitted in these pieces with [`Error::Interrupted`], until [`Pieces::go_on`].
    pub fn stop(&self) {
        self.0.store(true, Ordering::Relaxed);
    }

    /// Undoes [`Pieces::stop`].
    pub fn go_on(&self) {
        self.0.store(false, Ordering::Relaxed);
    }

    pub fn stopped(&self) -> bool {
        self.0.load(Ordering::Relaxed)
    }
}

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
    CopyImage {
        from: Image,
        to: Image,
    },
    CopyBuffer {
        from: Buffer,
        to: Buffer,
    },
}

#[derive(Clone)]
pub(super) enum Destination {
    /// `bytes` bytes from `offset` on.
    Buffer { buffer: Buffer, offset: u64, bytes: u64 },
    /// One layer of one level.
    Image { image: Image, layer: u32, level: u32 },
}

impl Action {
    /// The name in labels, hazards and timings.
    pub(super) fn label(&self) -> String {
        match self {
            Self::Write { to: Destination::Buffer { buffer, .. }, .. } => format!("write {}", buffer.name()),
            Self::Write { to: Destination::Image { image, .. }, .. } => format!("write {}", image.name()),
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
            Self::Fill { buffer: b, .. } | Self::Write { to: Destination::Buffer { buffer: b, .. }, .. } => {
                vec![(buffer(b), b.name(), Access::Write)]
            }
            Self::Write { to: Destination::Image { image: i, level, .. }, .. } => {
                vec![(image(i, *level), i.name(), Access::Write)]
            }
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

/// How a frame is submitted.
#[derive(Clone, Debug, Default)]
pub struct FrameOptions {
    /// Submits the frame piece by piece and waits for each, so that other submissions get their turn.
    pub pieces: Option<Pieces>,
    /// For tests: leaves out the needed barrier of this number, counted from 0.
    #[doc(hidden)]
    pub skip_barrier: Option<usize>,
    /// For tests: submits the frame in spite of hazards, to see whether the validation layer reports them.
    #[doc(hidden)]
    pub ignore_hazards: bool,
    /// For tests: runs every dispatch of the pass of this name this many more times, so that it is slow.
    #[doc(hidden)]
    pub repeat: Option<(&'static str, u32)>,
}

/// One piece of GPU work, recorded in order. Nothing runs before [`Frame::submit`].
pub struct Frame {
    gpu: Gpu,
    slot: HeldSlot,
    commands: Vec<Command>,
    scopes: Vec<String>,
    options: FrameOptions,
}

impl Gpu {
    /// Starts recording.
    ///
    /// # Errors
    /// Fails with [`Error::Vulkan`] if the device gives no command buffer.
    pub fn frame(&self) -> Result<Frame> {
        self.frame_with(FrameOptions::default())
    }

    /// Starts recording a frame that is submitted as `options` say.
    ///
    /// # Errors
    /// Fails as [`Gpu::frame`] does.
    pub fn frame_with(&self, options: FrameOptions) -> Result<Frame> {
        let slot = HeldSlot::take(self)?;
        Ok(Frame { gpu: self.clone(), slot, commands: Vec::new(), scopes: Vec::new(), options })
    }
}

impl Frame {
    /// Times everything that `record` records as a part of `name`. Scopes nest.
    pub fn scope<R>(&mut self, name: &str, record: impl FnOnce(&mut Self) -> R) -> R {
        self.scopes.push(name.to_owned());
        let recorded = record(self);
        self.scopes.pop();
        recorded
    }

    /// Runs `pass` with these bindings, by GLSL name in any order, and these push constants (`&()` for none).
    /// A size with a zero in it runs nothing.
    ///
    /// # Errors
    /// Fails with [`Error::Internal`] if bindings or push constants do not fit the pass, or with
    /// [`Error::Input`] if the device cannot run that many workgroups.
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
        self.record(Action::Dispatch { pass: pass.clone(), binds: ordered, push, groups });
        Ok(())
    }

    /// Makes what follows wait for all that came before, and see it. `why` says what the barrier separates.
    /// It is left out if no accesses conflict across it, so a pass need not know what others recorded.
    pub fn barrier(&mut self, why: &str) {
        self.commands.push(Command::Barrier(why.to_owned()));
    }

    /// Fills a buffer with one 32-bit value.
    pub fn fill(&mut self, buffer: &Buffer, value: u32) {
        self.record(Action::Fill { buffer: buffer.clone(), value });
    }

    /// Writes `data` to a buffer from `offset` bytes on. The data is copied and need not outlive the call.
    ///
    /// # Errors
    /// Fails with [`Error::Internal`] if the data does not fit.
    pub fn write_buffer<T: Pod>(&mut self, buffer: &Buffer, offset: u64, data: &[T]) -> Result<()> {
        let bytes: &[u8] = bytemuck::cast_slice(data);
        let size = bytes.len() as u64;
        if offset.checked_add(size).is_none_or(|end| end > buffer.bytes()) {
            let (name, room) = (buffer.name(), buffer.bytes());
            return Err(Error::Internal(format!("{size} bytes at {offset} do not fit {name}'s {room}")));
        }
        if size == 0 {
            return Ok(());
        }
        let from = self.slot.stage(&self.gpu.0, bytes)?;
        let to = Destination::Buffer { buffer: buffer.clone(), offset, bytes: size };
        self.record(Action::Write { from, to });
        Ok(())
    }

    /// Writes one layer of one level. The data are tightly packed rows in the image's format.
    ///
    /// # Errors
    /// Fails with [`Error::Internal`] if there is no such layer or level, or if the data has another size.
    pub fn write_image<T: Pod>(&mut self, image: &Image, layer: u32, level: u32, data: &[T]) -> Result<()> {
        let bytes: &[u8] = bytemuck::cast_slice(data);
        transfer::region(image, layer, level).map(drop)?;
        let wanted = transfer::level_bytes(image, level);
        if bytes.len() as u64 != wanted {
            let problem = format!("level {level} of {image:?} takes {wanted} bytes, not {}", bytes.len());
            return Err(Error::Internal(problem));
        }
        let from = self.slot.stage(&self.gpu.0, bytes)?;
        self.record(Action::Write { from, to: Destination::Image { image: image.clone(), layer, level } });
        Ok(())
    }

    /// Copies all layers and levels of an image to another of the same shape and format.
    ///
    /// # Errors
    /// Fails with [`Error::Internal`] if their shapes or formats differ.
    pub fn copy_image(&mut self, from: &Image, to: &Image) -> Result<()> {
        let shape = |i: &Image| (i.size(), i.layers(), i.levels(), i.format());
        if shape(from) != shape(to) {
            return Err(Error::Internal(format!("{from:?} cannot be copied to {to:?}")));
        }
        self.record(Action::CopyImage { from: from.clone(), to: to.clone() });
        Ok(())
    }

    /// Copies all of a buffer to the start of another.
    ///
    /// # Errors
    /// Fails with [`Error::Internal`] if the other is smaller.
    pub fn copy_buffer(&mut self, from: &Buffer, to: &Buffer) -> Result<()> {
        if from.bytes() > to.bytes() {
            return Err(Error::Internal(format!("{from:?} does not fit {to:?}")));
        }
        self.record(Action::CopyBuffer { from: from.clone(), to: to.clone() });
        Ok(())
    }

    /// Submits the frame to the device. The ticket gives its timings.
    ///
    /// # Errors
    /// Fails with [`Error::Internal`] if a barrier is missing, and submits nothing then. Fails with
    /// [`Error::Interrupted`] if [`Pieces::stop`] was called, and with [`Error::Vulkan`] if the device
    /// refuses the frame.
    pub fn submit(self) -> Result<Ticket> {
        let commands = needed(self.commands, &self.options)?;
        match &self.options.pieces {
            Some(pieces) => match encode::run_pieces(&self.gpu, cut(commands), &|| pieces.stopped()) {
                Err(error) if !matches!(error, Error::Interrupted { .. }) => {
                    self.slot.abandon(); // a piece may still read what is staged in it
                    Err(error)
                }
                ran => ran.map(Ticket::done),
            },
            None => Ticket::submit(&self.gpu, self.slot, commands),
        }
    }

    /// Submits the frame and waits until it has run.
    ///
    /// # Errors
    /// Fails as [`Frame::submit`] and [`Ticket::wait`] do.
    pub fn run(self) -> Result<Timings> {
        self.submit()?.wait()
    }

    fn record(&mut self, action: Action) {
        let label = action.label();
        let path = self.scopes.iter().chain([&label]).cloned().collect::<Vec<_>>();
        if let Some((slow, times)) = self.options.repeat.filter(|(slow, _)| *slow == label) {
            for _ in 0..times {
                self.commands.push(Command::Run { path: path.clone(), action: action.clone() });
                self.barrier(slow);
            }
        }
        self.commands.push(Command::Run { path, action });
    }
}

/// Leaves out the barriers that separate nothing.
fn needed(commands: Vec<Command>, options: &FrameOptions) -> Result<Vec<Command>> {
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
fn cut(commands: Vec<Command>) -> Vec<Vec<Command>> {
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

/// Sorts the bindings into the order of the pass's slots, and checks each.
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
                return Err(format!("{name} is a uniform block of at most {most} bytes, but {buffer:?} is larger"));
            }
            Ok(())
        }
        (Kind::StorageImage { array, .. } | Kind::Sampled { array, .. }, Bind::Image(image, level)) => {
            if !array && image.layers() > 1 {
                return Err(format!("{name} has no layers in GLSL, but {image:?} has some"));
            }
            if level.is_some_and(|level| level >= image.levels()) {
                return Err(format!("{name}: {image:?} has no such level"));
            }
            match slot.kind {
                Kind::StorageImage { format, .. } if format != image.format() => {
                    Err(format!("{name} is {format:?} in GLSL, but {image:?} is not"))
                }
                Kind::Sampled { integer, .. } if integer != image.format().is_integer() => {
                    Err(format!("one of {name} and {image:?} holds integers, the other floats"))
                }
                _ => Ok(()),
            }
        }
        (Kind::StorageBuffer | Kind::UniformBuffer, Bind::Image(..)) => Err(format!("{name} takes a buffer")),
        (_, Bind::Buffer(_)) => Err(format!("{name} takes an image")),
    }
}
