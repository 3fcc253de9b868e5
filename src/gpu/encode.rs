//! Vulkan command buffers: the one place that calls `vkCmd*` around dispatches, transfers and barriers.

use std::ffi::CString;

use ash::vk;

use super::{
    device::{Gpu, Shared, during},
    frame::{Action, Bind, Command, Groups},
    memory::Image,
    reflect::Kind,
    timing::{self, Timings},
};
use crate::{Error, Result};

/// How long the device may take for one submission before it is given up: a CPU device traces for minutes.
const TIMEOUT_NS: u64 = 600_000_000_000;

/// The kinds of descriptors, in the order in which a [`Slot`] counts them.
const KINDS: [vk::DescriptorType; 4] = [
    vk::DescriptorType::STORAGE_BUFFER,
    vk::DescriptorType::UNIFORM_BUFFER,
    vk::DescriptorType::STORAGE_IMAGE,
    vk::DescriptorType::COMBINED_IMAGE_SAMPLER,
];

/// What one submission needs, kept for the next. Pools grow to what a frame asks of them.
pub(super) struct Slot {
    pool: vk::CommandPool,
    commands: vk::CommandBuffer,
    fence: vk::Fence,
    queries: vk::QueryPool,
    query_count: u32,
    descriptors: vk::DescriptorPool,
    /// Sets, then descriptors of each kind.
    descriptor_counts: [u32; 1 + KINDS.len()],
}

impl Slot {
    pub(super) fn new(shared: &Shared) -> Result<Self> {
        let device = &shared.device;
        // SAFETY: valid create infos; what was made is destroyed on failure.
        unsafe {
            let info = vk::CommandPoolCreateInfo::default()
                .flags(vk::CommandPoolCreateFlags::TRANSIENT)
                .queue_family_index(shared.queue_family);
            let pool = device.create_command_pool(&info, None).map_err(during("vkCreateCommandPool"))?;
            let info = vk::CommandBufferAllocateInfo::default().command_pool(pool).command_buffer_count(1);
            let rest = device.allocate_command_buffers(&info).map_err(during("vkAllocateCommandBuffers")).and_then(
                |commands| {
                    let fence = device.create_fence(&vk::FenceCreateInfo::default(), None);
                    fence.map(|fence| (commands[0], fence)).map_err(during("vkCreateFence"))
                },
            );
            match rest {
                Ok((commands, fence)) => {
                    shared.label(pool, "frame");
                    shared.label(fence, "frame");
                    Ok(Self {
                        pool,
                        commands,
                        fence,
                        queries: vk::QueryPool::null(),
                        query_count: 0,
                        descriptors: vk::DescriptorPool::null(),
                        descriptor_counts: [0; 1 + KINDS.len()],
                    })
                }
                Err(error) => {
                    device.destroy_command_pool(pool, None);
                    Err(error)
                }
            }
        }
    }

    /// # Safety
    /// The device does not use it any more.
    pub(super) unsafe fn destroy(self, device: &ash::Device) {
        // SAFETY: the caller's promise; null handles are ignored.
        unsafe {
            device.destroy_descriptor_pool(self.descriptors, None);
            device.destroy_query_pool(self.queries, None);
            device.destroy_fence(self.fence, None);
            device.destroy_command_pool(self.pool, None);
        }
    }

    fn begin(&self, device: &ash::Device) -> Result<()> {
        // SAFETY: the slot is idle.
        unsafe {
            device
                .reset_command_pool(self.pool, vk::CommandPoolResetFlags::empty())
                .map_err(during("vkResetCommandPool"))?;
            device.reset_fences(&[self.fence]).map_err(during("vkResetFences"))?;
            let info = vk::CommandBufferBeginInfo::default().flags(vk::CommandBufferUsageFlags::ONE_TIME_SUBMIT);
            device.begin_command_buffer(self.commands, &info).map_err(during("vkBeginCommandBuffer"))?;
        }
        // What earlier submissions wrote is finished, their fences were waited for, but not yet visible.
        barrier(device, self.commands, vk::PipelineStageFlags2::ALL_COMMANDS, vk::PipelineStageFlags2::ALL_COMMANDS);
        Ok(())
    }

    /// Submits and waits.
    fn finish(&self, shared: &Shared) -> std::result::Result<(), vk::Result> {
        let host = vk::PipelineStageFlags2::ALL_COMMANDS | vk::PipelineStageFlags2::HOST;
        barrier(&shared.device, self.commands, vk::PipelineStageFlags2::ALL_COMMANDS, host);
        // SAFETY: recording is complete.
        unsafe {
            shared.device.end_command_buffer(self.commands)?;
            shared.submit(self.commands, self.fence)?;
            shared.device.wait_for_fences(&[self.fence], true, TIMEOUT_NS)
        }
    }

    fn reserve_queries(&mut self, shared: &Shared, count: u32) -> Result<()> {
        if count > self.query_count {
            let count = count.next_power_of_two().max(64);
            let info = vk::QueryPoolCreateInfo::default().query_type(vk::QueryType::TIMESTAMP).query_count(count);
            // SAFETY: the slot is idle.
            unsafe {
                let grown = shared.device.create_query_pool(&info, None).map_err(during("vkCreateQueryPool"))?;
                shared.device.destroy_query_pool(self.queries, None);
                self.queries = grown;
            }
            self.query_count = count;
            shared.label(self.queries, "timestamps");
        }
        // SAFETY: hostQueryReset is enabled and the slot is idle.
        unsafe { shared.device.reset_query_pool(self.queries, 0, self.query_count) };
        Ok(())
    }

    fn reserve_descriptors(&mut self, shared: &Shared, counts: [u32; 1 + KINDS.len()]) -> Result<()> {
        if (0..counts.len()).all(|i| counts[i] <= self.descriptor_counts[i]) {
            if self.descriptors == vk::DescriptorPool::null() {
                return Ok(());
            }
            // SAFETY: the slot is idle.
            return unsafe {
                shared.device.reset_descriptor_pool(self.descriptors, vk::DescriptorPoolResetFlags::empty())
            }
            .map_err(during("vkResetDescriptorPool"));
        }
        let grown: [u32; 1 + KINDS.len()] =
            std::array::from_fn(|i| counts[i].max(self.descriptor_counts[i]).next_power_of_two().max(16));
        let sizes: Vec<_> = KINDS
            .iter()
            .zip(&grown[1..])
            .map(|(&ty, &descriptor_count)| vk::DescriptorPoolSize { ty, descriptor_count })
            .collect();
        let info = vk::DescriptorPoolCreateInfo::default().max_sets(grown[0]).pool_sizes(&sizes);
        // SAFETY: the slot is idle.
        unsafe {
            let pool = shared.device.create_descriptor_pool(&info, None).map_err(during("vkCreateDescriptorPool"))?;
            shared.device.destroy_descriptor_pool(self.descriptors, None);
            self.descriptors = pool;
        }
        self.descriptor_counts = grown;
        shared.label(self.descriptors, "frame");
        Ok(())
    }
}

/// One global memory barrier: all that came before in `from` finishes, and is visible to what follows in `to`.
fn barrier(
    device: &ash::Device,
    commands: vk::CommandBuffer,
    from: vk::PipelineStageFlags2,
    to: vk::PipelineStageFlags2,
) {
    let memory = [vk::MemoryBarrier2::default()
        .src_stage_mask(from)
        .src_access_mask(vk::AccessFlags2::MEMORY_WRITE)
        .dst_stage_mask(to)
        .dst_access_mask(vk::AccessFlags2::MEMORY_READ | vk::AccessFlags2::MEMORY_WRITE)];
    // SAFETY: the command buffer is recording.
    unsafe { device.cmd_pipeline_barrier2(commands, &vk::DependencyInfo::default().memory_barriers(&memory)) };
}

/// The stages of everything a frame records.
const FRAME_STAGES: vk::PipelineStageFlags2 = vk::PipelineStageFlags2::from_raw(
    vk::PipelineStageFlags2::COMPUTE_SHADER.as_raw()
        | vk::PipelineStageFlags2::DRAW_INDIRECT.as_raw()
        | vk::PipelineStageFlags2::ALL_TRANSFER.as_raw(),
);

/// All levels and layers.
pub(super) fn whole_image() -> vk::ImageSubresourceRange {
    vk::ImageSubresourceRange::default()
        .aspect_mask(vk::ImageAspectFlags::COLOR)
        .level_count(vk::REMAINING_MIP_LEVELS)
        .layer_count(vk::REMAINING_ARRAY_LAYERS)
}

/// Brings a new image into the layout in which it stays.
///
/// # Safety
/// The command buffer is recording and the image alive.
pub(super) unsafe fn to_general(device: &ash::Device, commands: vk::CommandBuffer, image: vk::Image) {
    let change = [vk::ImageMemoryBarrier2::default()
        .dst_stage_mask(vk::PipelineStageFlags2::ALL_TRANSFER)
        .dst_access_mask(vk::AccessFlags2::TRANSFER_WRITE)
        .old_layout(vk::ImageLayout::UNDEFINED)
        .new_layout(vk::ImageLayout::GENERAL)
        .src_queue_family_index(vk::QUEUE_FAMILY_IGNORED)
        .dst_queue_family_index(vk::QUEUE_FAMILY_IGNORED)
        .image(image)
        .subresource_range(whole_image())];
    // SAFETY: the caller's promise.
    unsafe { device.cmd_pipeline_barrier2(commands, &vk::DependencyInfo::default().image_memory_barriers(&change)) };
}

/// Records, submits and waits for a transfer outside any frame.
pub(super) fn immediate(shared: &Shared, what: &str, record: impl FnOnce(vk::CommandBuffer)) -> Result<()> {
    let slot = shared.take_slot()?;
    let begun = slot.begin(&shared.device);
    if begun.is_err() {
        shared.return_slot(slot);
        return begun;
    }
    record(slot.commands);
    slot.finish(shared).map_err(during(what))?; // a slot that the device may still use is not given back
    shared.return_slot(slot);
    Ok(())
}

/// Records, submits and waits for a frame.
pub(super) fn run(gpu: &Gpu, commands: Vec<Command>) -> Result<Timings> {
    let shared = &gpu.0;
    let names: Vec<&str> = commands
        .iter()
        .filter_map(|command| match command {
            Command::Run { name, .. } => Some(name.as_str()),
            Command::Barrier(_) => None,
        })
        .collect();
    if names.is_empty() {
        return Ok(Timings::default());
    }
    let mut slot = shared.take_slot()?;
    if let Err(error) = record(shared, &mut slot, &commands, 2 * names.len() as u32) {
        shared.return_slot(slot);
        return Err(error);
    }
    let finished = slot.finish(shared);
    let stamps = read_stamps(shared, &slot, 2 * names.len());
    match (finished, stamps) {
        (Ok(()), Ok(stamps)) if stamps.iter().all(|stamp| stamp[1] != 0) => {
            shared.return_slot(slot);
            let stamps: Vec<u64> = stamps.iter().map(|stamp| stamp[0]).collect();
            Ok(shared.clock.timings(&names, &stamps))
        }
        (Ok(()), stamps) => {
            shared.return_slot(slot);
            let result = stamps.err().unwrap_or(vk::Result::NOT_READY);
            Err(during("vkGetQueryPoolResults for the timestamps of a finished frame")(result))
        }
        (Err(result), stamps) => {
            let written: Vec<bool> = stamps.unwrap_or_default().iter().map(|stamp| stamp[1] != 0).collect();
            let place = timing::where_it_stopped(&names, &written);
            // The device may still be using all this: it is never freed.
            std::mem::forget(commands);
            Err(Error::Vulkan { during: format!("the frame stopped {place}"), result })
        }
    }
}

/// Timestamps and whether each was written. Never waits.
fn read_stamps(shared: &Shared, slot: &Slot, count: usize) -> std::result::Result<Vec<[u64; 2]>, vk::Result> {
    let mut stamps = vec![[0u64; 2]; count];
    let flags = vk::QueryResultFlags::TYPE_64 | vk::QueryResultFlags::WITH_AVAILABILITY;
    // SAFETY: the pool holds at least `count` queries.
    match unsafe { shared.device.get_query_pool_results(slot.queries, 0, &mut stamps, flags) } {
        Ok(()) | Err(vk::Result::NOT_READY) => Ok(stamps),
        Err(result) => Err(result),
    }
}

fn record(shared: &Shared, slot: &mut Slot, commands: &[Command], queries: u32) -> Result<()> {
    let mut counts = [0; 1 + KINDS.len()];
    for command in commands {
        if let Command::Run { action: Action::Dispatch { pass, .. }, .. } = command {
            counts[0] += 1;
            for slot in &pass.0.slots {
                let kind = KINDS.iter().position(|kind| *kind == slot.kind.descriptor());
                counts[1 + kind.unwrap_or(0)] += 1;
            }
        }
    }
    slot.reserve_queries(shared, queries)?;
    slot.reserve_descriptors(shared, counts)?;
    slot.begin(&shared.device)?;
    let mut query = 0;
    for command in commands {
        match command {
            Command::Barrier(why) => {
                insert_label(shared, slot.commands, why);
                barrier(&shared.device, slot.commands, FRAME_STAGES, FRAME_STAGES);
            }
            Command::Run { action, .. } => {
                begin_label(shared, slot.commands, &action.label());
                let stamp = |query| {
                    let stage = vk::PipelineStageFlags2::ALL_COMMANDS;
                    // SAFETY: the pool holds two queries for each entry.
                    unsafe { shared.device.cmd_write_timestamp2(slot.commands, stage, slot.queries, query) };
                };
                stamp(query);
                perform(shared, slot, action)?;
                stamp(query + 1);
                query += 2;
                end_label(shared, slot.commands);
            }
        }
    }
    Ok(())
}

fn perform(shared: &Shared, slot: &Slot, action: &Action) -> Result<()> {
    let (device, commands) = (&shared.device, slot.commands);
    let general = vk::ImageLayout::GENERAL;
    // SAFETY: the frame holds everything named here until it has run; sizes and kinds were checked when recorded.
    unsafe {
        match action {
            Action::Fill { buffer, value } => {
                device.cmd_fill_buffer(commands, buffer.handle(), 0, vk::WHOLE_SIZE, *value);
            }
            Action::CopyBuffer { from, to } => {
                let region = vk::BufferCopy { src_offset: 0, dst_offset: 0, size: from.bytes() };
                device.cmd_copy_buffer(commands, from.handle(), to.handle(), &[region]);
            }
            Action::CopyImage { from, to } => {
                let region = |level| {
                    vk::ImageCopy::default()
                        .src_subresource(from.layers_of(level))
                        .dst_subresource(to.layers_of(level))
                        .extent(from.extent(level))
                };
                let regions: Vec<_> = (0..from.levels()).map(region).collect();
                device.cmd_copy_image(commands, from.handle(), general, to.handle(), general, &regions);
            }
            Action::Dispatch { pass, binds, push, groups } => {
                let pass = &pass.0;
                let layouts = [pass.set_layout];
                let info =
                    vk::DescriptorSetAllocateInfo::default().descriptor_pool(slot.descriptors).set_layouts(&layouts);
                let sets = device
                    .allocate_descriptor_sets(&info)
                    .map_err(during(format!("vkAllocateDescriptorSets for {}", pass.name)))?;
                for (slot, bind) in pass.slots.iter().zip(binds) {
                    let write = vk::WriteDescriptorSet::default()
                        .dst_set(sets[0])
                        .dst_binding(slot.binding)
                        .descriptor_type(slot.kind.descriptor());
                    match bind {
                        Bind::Buffer(buffer) => {
                            let info =
                                [vk::DescriptorBufferInfo::default().buffer(buffer.handle()).range(vk::WHOLE_SIZE)];
                            device.update_descriptor_sets(&[write.buffer_info(&info)], &[]);
                        }
                        Bind::Image(image, level) => {
                            let info = [image_info(shared, slot.kind, image, *level)];
                            device.update_descriptor_sets(&[write.image_info(&info)], &[]);
                        }
                    }
                }
                let point = vk::PipelineBindPoint::COMPUTE;
                device.cmd_bind_pipeline(commands, point, pass.pipeline);
                device.cmd_bind_descriptor_sets(commands, point, pass.layout, 0, &sets, &[]);
                if !push.is_empty() {
                    device.cmd_push_constants(commands, pass.layout, vk::ShaderStageFlags::COMPUTE, 0, push);
                }
                match groups {
                    Groups::Count([x, y, z]) => device.cmd_dispatch(commands, *x, *y, *z),
                    Groups::Indirect(buffer, offset) => {
                        device.cmd_dispatch_indirect(commands, buffer.handle(), *offset);
                    }
                }
            }
        }
    }
    Ok(())
}

fn image_info(shared: &Shared, kind: Kind, image: &Image, level: Option<u32>) -> vk::DescriptorImageInfo {
    let info = vk::DescriptorImageInfo::default().image_layout(vk::ImageLayout::GENERAL);
    match kind {
        Kind::Sampled { array, .. } => {
            let linear = shared.linear_filter[image.format() as usize];
            info.image_view(image.view(level, array)).sampler(shared.samplers[usize::from(!linear)])
        }
        Kind::StorageImage { array, .. } => info.image_view(image.view(Some(level.unwrap_or(0)), array)),
        Kind::StorageBuffer | Kind::UniformBuffer => info,
    }
}

fn label_text(name: &str) -> CString {
    CString::new(name.replace('\0', " ")).unwrap_or_default()
}

fn begin_label(shared: &Shared, commands: vk::CommandBuffer, name: &str) {
    if let Some(debug) = &shared.debug {
        let name = label_text(name);
        // SAFETY: the command buffer is recording.
        unsafe {
            debug.cmd_begin_debug_utils_label(commands, &vk::DebugUtilsLabelEXT::default().label_name(&name));
        }
    }
}

fn insert_label(shared: &Shared, commands: vk::CommandBuffer, name: &str) {
    if let Some(debug) = &shared.debug {
        let name = label_text(name);
        // SAFETY: the command buffer is recording.
        unsafe {
            debug.cmd_insert_debug_utils_label(commands, &vk::DebugUtilsLabelEXT::default().label_name(&name));
        }
    }
}

fn end_label(shared: &Shared, commands: vk::CommandBuffer) {
    if let Some(debug) = &shared.debug {
        // SAFETY: the command buffer is recording, with a label begun.
        unsafe { debug.cmd_end_debug_utils_label(commands) };
    }
}
