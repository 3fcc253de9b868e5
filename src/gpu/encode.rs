//! Vulkan command buffers: the dispatches, transfers and barriers of a frame, and transfers outside of frames.

use std::{ffi::CString, time::Instant};

use ash::vk;

use super::{
    bind::Bind,
    command::{Action, Command, Destination, Groups},
    device::{Gpu, Shared, during},
    memory::Image,
    reflect::Kind,
    slot::{HeldSlot, KINDS, Slot},
    ticket::Ticket,
    timing::{Entry, Timings},
    transfer,
};
use crate::{Error, Result};

/// Records a global memory barrier: `to` waits for what came before in `from`, and sees what it wrote.
pub(super) fn barrier(
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

/// The stages of everything that a frame records.
fn frame_stages(shared: &Shared) -> vk::PipelineStageFlags2 {
    let all = vk::PipelineStageFlags2::COMPUTE_SHADER
        | vk::PipelineStageFlags2::DRAW_INDIRECT
        | vk::PipelineStageFlags2::ALL_TRANSFER;
    // a device without such structures does not know their stage
    if shared.builder.is_some() { all | vk::PipelineStageFlags2::ACCELERATION_STRUCTURE_BUILD_KHR } else { all }
}

pub(super) fn whole_image() -> vk::ImageSubresourceRange {
    vk::ImageSubresourceRange::default()
        .aspect_mask(vk::ImageAspectFlags::COLOR)
        .level_count(vk::REMAINING_MIP_LEVELS)
        .layer_count(vk::REMAINING_ARRAY_LAYERS)
}

/// Brings a new image into the layout `GENERAL`, in which it stays.
///
/// # Safety
/// The command buffer is recording, and the image is alive.
pub(super) unsafe fn to_general(device: &ash::Device, commands: vk::CommandBuffer, image: vk::Image) {
    let layouts = [vk::ImageLayout::UNDEFINED, vk::ImageLayout::GENERAL];
    // Its memory may have belonged to another image.
    let stages = [vk::PipelineStageFlags2::ALL_COMMANDS, vk::PipelineStageFlags2::ALL_TRANSFER];
    // SAFETY: the caller's promise.
    unsafe { image_change(device, commands, image, layouts, stages, vk::AccessFlags2::TRANSFER_WRITE) };
}

/// Changes an image's layout. The second stage waits for the first, and its accesses see what that wrote.
///
/// # Safety
/// The command buffer is recording. The image is alive and in the first layout, or its content may be lost.
pub(super) unsafe fn image_change(
    device: &ash::Device,
    commands: vk::CommandBuffer,
    image: vk::Image,
    [old, new]: [vk::ImageLayout; 2],
    [before, after]: [vk::PipelineStageFlags2; 2],
    accesses: vk::AccessFlags2,
) {
    let change = [vk::ImageMemoryBarrier2::default()
        .src_stage_mask(before)
        .src_access_mask(vk::AccessFlags2::MEMORY_WRITE)
        .dst_stage_mask(after)
        .dst_access_mask(accesses)
        .old_layout(old)
        .new_layout(new)
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
    let ran = slot.begin(&shared.device).and_then(|()| {
        record(slot.commands);
        slot.submit(shared).and_then(|()| slot.wait(shared)).map_err(during(what))
    });
    // The device may still use the slot if it could not be waited for.
    if shared.may_free() {
        shared.return_slot(slot);
    }
    ran
}

/// Runs the pieces of a frame in order, and asks before each whether to stop. Times are from submission to
/// fence: other work uses the queue in between, and CPU drivers take both timestamps when they have drawn.
pub(super) fn run_pieces(gpu: &Gpu, pieces: Vec<Vec<Command>>, stopped: &dyn Fn() -> bool) -> Result<Timings> {
    let start = Instant::now();
    let elapsed = || start.elapsed().as_secs_f64() * 1e3;
    let mut timings = Timings::default();
    for commands in pieces {
        if stopped() {
            return Err(Error::Interrupted {
                subject: "the frame".into(),
                at: "by something newer to show".into(),
                remedy: "render it again".into(),
            });
        }
        let start_ms = elapsed();
        let piece = Ticket::submit(gpu, HeldSlot::take(gpu)?, commands)?.wait()?;
        timings.gpu_ms = elapsed();
        timings.ended = piece.ended;
        let ms = timings.gpu_ms - start_ms;
        timings.entries.extend(piece.entries.into_iter().map(|entry| Entry { path: entry.path, start_ms, ms }));
    }
    Ok(timings)
}

/// Records a submission, with two timestamps around each entry.
pub(super) fn record(shared: &Shared, slot: &mut Slot, commands: &[Command]) -> Result<()> {
    let queries = 2 * commands.iter().filter_map(Command::path).count() as u32;
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
                let stages = frame_stages(shared);
                barrier(&shared.device, slot.commands, stages, stages);
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
    // SAFETY: the frame holds everything named here until it has run. Sizes and kinds have been checked.
    unsafe {
        match action {
            Action::Fill { buffer, value } => {
                device.cmd_fill_buffer(commands, buffer.handle(), 0, vk::WHOLE_SIZE, *value);
            }
            Action::Write { from: (staging, from), to: Destination::Buffer { buffer, offset, bytes } } => {
                let region = vk::BufferCopy { src_offset: *from, dst_offset: *offset, size: *bytes };
                device.cmd_copy_buffer(commands, *staging, buffer.handle(), &[region]);
            }
            Action::Write {
                from: (staging, from),
                to: Destination::Image { image, layer, level, first_row, rows },
            } => {
                let whole = transfer::region(image, *layer, *level)?.buffer_offset(*from);
                let extent = vk::Extent3D { height: *rows, ..whole.image_extent };
                let offset = vk::Offset3D { x: 0, y: *first_row as i32, z: 0 };
                let region = whole.image_offset(offset).image_extent(extent);
                device.cmd_copy_buffer_to_image(commands, *staging, image.handle(), general, &[region]);
            }
            Action::CopyBuffer { from, to } => {
                let region = vk::BufferCopy { src_offset: 0, dst_offset: 0, size: from.bytes() };
                device.cmd_copy_buffer(commands, from.handle(), to.handle(), &[region]);
            }
            Action::Build { structure, items, range, scratch } => structure.record(commands, items, *range, scratch),
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
                        .dst_binding(slot.number)
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
                        Bind::Acceleration(acceleration) => {
                            let handles = [acceleration.handle()];
                            let mut info = vk::WriteDescriptorSetAccelerationStructureKHR::default()
                                .acceleration_structures(&handles);
                            let write = write.descriptor_count(1).push_next(&mut info);
                            device.update_descriptor_sets(&[write], &[]);
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
                    Groups::Part { first: [0, 0, 0], count: [x, y, z] } => device.cmd_dispatch(commands, *x, *y, *z),
                    Groups::Part { first: [a, b, c], count: [x, y, z] } => {
                        device.cmd_dispatch_base(commands, *a, *b, *c, *x, *y, *z);
                    }
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
        Kind::StorageBuffer | Kind::UniformBuffer | Kind::Acceleration => info,
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
        // SAFETY: the command buffer is recording, and a label was begun.
        unsafe { debug.cmd_end_debug_utils_label(commands) };
    }
}
