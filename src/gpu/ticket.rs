//! Frames that were submitted and may not have run yet.

use std::time::Instant;

use ash::vk;

use super::{
    command::Command,
    device::{Gpu, Shared, during},
    encode,
    slot::{HeldSlot, Slot},
    timing::{self, Timings},
};
use crate::{Error, Result};

/// A submitted frame. It runs whether or not anybody waits for it. Frames of one device run one after the
/// other, in the order of submission. Dropping a ticket waits for its frame.
#[must_use = "dropping a ticket waits for its frame and loses its timings"]
pub struct Ticket(State);

enum State {
    /// The device may still use all of this.
    Running {
        gpu: Gpu,
        slot: HeldSlot,
        commands: Vec<Command>,
        ended: Option<Instant>,
    },
    Done(Timings),
}

impl Ticket {
    /// A frame that has already run.
    pub(super) fn done(timings: Timings) -> Self {
        Self(State::Done(timings))
    }

    /// Records the commands into the slot and submits them.
    pub(super) fn submit(gpu: &Gpu, mut slot: HeldSlot, commands: Vec<Command>) -> Result<Self> {
        if !commands.iter().any(|command| command.path().is_some()) {
            return Ok(Self::done(Timings::default()));
        }
        encode::record(&gpu.0, &mut slot, &commands)?;
        match slot.submit(&gpu.0) {
            Ok(()) => {
                // Some drivers draw a frame while they are given it.
                let ended = slot.is_done(&gpu.0).then(Instant::now);
                Ok(Self(State::Running { gpu: gpu.clone(), slot, commands, ended }))
            }
            Err(result) => Err(during("submitting a frame")(result)),
        }
    }

    /// Waits until the frame has run.
    ///
    /// # Errors
    /// Fails with [`Error::Vulkan`] if the device is lost or does not finish. The error names the last pass
    /// that ran.
    pub fn wait(mut self) -> Result<Timings> {
        self.finish()
    }

    fn finish(&mut self) -> Result<Timings> {
        match std::mem::replace(&mut self.0, State::Done(Timings::default())) {
            State::Done(timings) => Ok(timings),
            State::Running { gpu, slot, commands, ended } => {
                let barriers = commands.iter().filter(|command| command.path().is_none()).count();
                let finished = slot.wait(&gpu.0);
                let ended = Some(ended.unwrap_or_else(Instant::now));
                let stamps = read_stamps(&gpu.0, &slot, 2 * (commands.len() - barriers));
                match (finished, stamps) {
                    (Ok(()), Ok(stamps)) if stamps.iter().all(|stamp| stamp[1] != 0) => {
                        let stamps: Vec<_> = stamps.iter().map(|stamp| stamp[0]).collect();
                        let paths = commands.iter().filter_map(Command::path);
                        Ok(Timings { barriers, ended, ..gpu.0.clock.timings(paths, &stamps) })
                    }
                    (Ok(()), stamps) => {
                        let result = stamps.err().unwrap_or(vk::Result::NOT_READY);
                        Err(during("vkGetQueryPoolResults for the timestamps of a finished frame")(result))
                    }
                    (Err(result), stamps) => {
                        let written: Vec<bool> = stamps.unwrap_or_default().iter().map(|stamp| stamp[1] != 0).collect();
                        let names: Vec<_> =
                            commands.iter().filter_map(Command::path).map(|path| path.join(" / ")).collect();
                        let names: Vec<&str> = names.iter().map(String::as_str).collect();
                        let place = timing::where_it_stopped(&names, &written);
                        Err(Error::Vulkan { during: format!("the frame stopped {place}"), result })
                    }
                }
            }
        }
    }
}

impl Drop for Ticket {
    fn drop(&mut self) {
        // Whoever could not be waited for once is not waited for again.
        if matches!(&self.0, State::Running { gpu, .. } if !gpu.0.may_free()) {
            return;
        }
        if let Err(error) = self.finish() {
            tracing::warn!("a frame that nobody waited for: {error}");
        }
    }
}

/// Reads the timestamps, each with whether it was written. Never waits.
fn read_stamps(shared: &Shared, slot: &Slot, count: usize) -> std::result::Result<Vec<[u64; 2]>, vk::Result> {
    let mut stamps = vec![[0u64; 2]; count];
    let flags = vk::QueryResultFlags::TYPE_64 | vk::QueryResultFlags::WITH_AVAILABILITY;
    // SAFETY: the pool holds at least `count` queries.
    match unsafe { shared.device.get_query_pool_results(slot.queries, 0, &mut stamps, flags) } {
        Ok(()) | Err(vk::Result::NOT_READY) => Ok(stamps),
        Err(result) => Err(result),
    }
}
