//! Records dispatches, transfers and barriers, checks them, and submits them as one piece of work.

use std::sync::{
    Arc,
    atomic::{AtomicBool, Ordering},
};

use bytemuck::Pod;

use super::{
    acceleration::Acceleration,
    bind::{Bind, order},
    command::{Action, Command, Destination, Groups, cut, needed},
    device::Gpu,
    encode,
    layout::GpuStruct,
    memory::{Buffer, Image},
    pass::Pass,
    slot::HeldSlot,
    ticket::Ticket,
    timing::Timings,
    transfer,
};
use crate::{Error, Result};

/// How many threads a dispatch runs.
#[derive(Clone, Copy, Debug)]
pub enum Threads<'a> {
    /// At least this many along each axis. Workgroups are whole, so the shader checks its bounds.
    Size([u32; 3]),
    /// The buffer holds the number of workgroups along each axis, as three `u32` from this byte on.
    Indirect(&'a Buffer, u64),
}

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
        let [_, rows] = image.level_size(level);
        let to = Destination::Image { image: image.clone(), layer, level, first_row: 0, rows };
        self.record(Action::Write { from, to });
        Ok(())
    }

    /// Writes whole rows of an image's first layer and level, from `first_row` on. The data are tightly packed rows in
    /// the image's format.
    ///
    /// # Errors
    /// Fails with [`Error::Internal`] if there are no such rows, or if the data are no whole rows.
    pub fn write_rows<T: Pod>(&mut self, image: &Image, first_row: u32, data: &[T]) -> Result<()> {
        let bytes: &[u8] = bytemuck::cast_slice(data);
        let [width, height] = image.level_size(0);
        let row = u64::from(width) * image.format().bytes();
        let rows = (bytes.len() as u64 / row) as u32;
        if u64::from(rows) * row != bytes.len() as u64 || first_row.checked_add(rows).is_none_or(|end| end > height) {
            return Err(Error::Internal(format!("{} bytes are no rows of {image:?} from {first_row} on", bytes.len())));
        }
        if rows == 0 {
            return Ok(());
        }
        let from = self.slot.stage(&self.gpu.0, bytes)?;
        let to = Destination::Image { image: image.clone(), layer: 0, level: 0, first_row, rows };
        self.record(Action::Write { from, to });
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

    /// Builds a structure of items of a buffer (`range`: the first, and how many): triangles of three corners of three `f32`, or
    /// [`Placed`](super::Placed) structures. What it held before is gone.
    ///
    /// # Errors
    /// Fails with [`Error::Internal`] if the buffer has not these items, if they are too many for the structure, or if
    /// the scratch buffer is too small.
    pub fn build(&mut self, structure: &Acceleration, items: &Buffer, range: [u32; 2], scratch: &Buffer) -> Result<()> {
        structure.check(items, range, scratch).map_err(Error::Internal)?;
        let (structure, items, scratch) = (structure.clone(), items.clone(), scratch.clone());
        self.record(Action::Build { structure, items, range, scratch });
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
            Some(pieces) => encode::run_pieces(&self.gpu, cut(commands), &|| pieces.stopped()).map(Ticket::done),
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
