//! Slots for submissions, which are kept and used again.

use std::ops::{Deref, DerefMut};

use ash::vk;

use super::{
    device::{Gpu, Shared, during},
    encode::barrier,
    transfer::Staging,
};
use crate::Result;

/// How long one submission may take before it is given up, nanoseconds. A CPU device traces for minutes.
pub(super) const TIMEOUT_NS: u64 = 600_000_000_000;

/// The kinds of descriptors, in the order in which a [`Slot`] counts them.
pub(super) const KINDS: [vk::DescriptorType; 5] = [
    vk::DescriptorType::STORAGE_BUFFER,
    vk::DescriptorType::UNIFORM_BUFFER,
    vk::DescriptorType::STORAGE_IMAGE,
    vk::DescriptorType::COMBINED_IMAGE_SAMPLER,
    vk::DescriptorType::ACCELERATION_STRUCTURE_KHR,
];

/// How many descriptor sets, then how many descriptors of each of [`KINDS`].
pub(super) type Counts = [u32; 1 + KINDS.len()];

/// What one submission needs. The pools of a slot grow to what its frames need.
pub(super) struct Slot {
    pool: vk::CommandPool,
    pub commands: vk::CommandBuffer,
    fence: vk::Fence,
    pub queries: vk::QueryPool,
    query_count: u32,
    pub descriptors: vk::DescriptorPool,
    descriptor_counts: Counts,
    staging: Vec<Staging>,
}

/// How much staging memory an idle slot keeps, bytes: that of a video frame of 4096×2048.
pub(super) const KEPT_STAGING: u64 = 192 << 20;
/// Staging memory is allocated in chunks of at least this many bytes.
const STAGING_CHUNK: u64 = 1 << 20;

/// A slot that somebody holds. Dropping it gives it back, so its holder first waits until the device has done
/// with it.
pub(super) struct HeldSlot {
    gpu: Gpu,
    slot: Option<Slot>,
}

impl HeldSlot {
    /// Takes a slot that was used before, or makes one.
    pub(super) fn take(gpu: &Gpu) -> Result<Self> {
        Ok(Self { gpu: gpu.clone(), slot: Some(gpu.0.take_slot()?) })
    }
}

impl Deref for HeldSlot {
    type Target = Slot;

    fn deref(&self) -> &Slot {
        match &self.slot {
            Some(slot) => slot,
            None => unreachable!("a slot is only taken out when its holder goes"),
        }
    }
}

impl DerefMut for HeldSlot {
    fn deref_mut(&mut self) -> &mut Slot {
        match &mut self.slot {
            Some(slot) => slot,
            None => unreachable!("a slot is only taken out when its holder goes"),
        }
    }
}

impl Drop for HeldSlot {
    fn drop(&mut self) {
        if let Some(mut slot) = self.slot.take().filter(|_| self.gpu.0.may_free()) {
            slot.clear_staging(&self.gpu.0);
            self.gpu.0.return_slot(slot);
        }
    }
}

impl Slot {
    pub(super) fn new(shared: &Shared) -> Result<Self> {
        let device = &shared.device;
        // SAFETY: the create infos are valid, and on failure what was made is destroyed.
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
                        staging: Vec::new(),
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
    /// The device does not use the slot any more.
    pub(super) unsafe fn destroy(self, shared: &Shared) {
        self.staging.into_iter().for_each(|staging| staging.destroy(shared));
        if !shared.may_free() {
            return;
        }
        let device = &shared.device;
        // SAFETY: the caller's promise. Null handles are ignored.
        unsafe {
            device.destroy_descriptor_pool(self.descriptors, None);
            device.destroy_query_pool(self.queries, None);
            device.destroy_fence(self.fence, None);
            device.destroy_command_pool(self.pool, None);
        }
    }

    pub(super) fn begin(&self, device: &ash::Device) -> Result<()> {
        // SAFETY: the slot is idle.
        unsafe {
            device
                .reset_command_pool(self.pool, vk::CommandPoolResetFlags::empty())
                .map_err(during("vkResetCommandPool"))?;
            device.reset_fences(&[self.fence]).map_err(during("vkResetFences"))?;
            let info = vk::CommandBufferBeginInfo::default().flags(vk::CommandBufferUsageFlags::ONE_TIME_SUBMIT);
            device.begin_command_buffer(self.commands, &info).map_err(during("vkBeginCommandBuffer"))?;
        }
        // Earlier submissions may still run, and this one may overwrite what they read.
        barrier(device, self.commands, vk::PipelineStageFlags2::ALL_COMMANDS, vk::PipelineStageFlags2::ALL_COMMANDS);
        Ok(())
    }

    /// Ends the recording and submits it.
    pub(super) fn submit(&self, shared: &Shared) -> std::result::Result<(), vk::Result> {
        let host = vk::PipelineStageFlags2::ALL_COMMANDS | vk::PipelineStageFlags2::HOST;
        barrier(&shared.device, self.commands, vk::PipelineStageFlags2::ALL_COMMANDS, host);
        // SAFETY: recording is complete.
        unsafe { shared.device.end_command_buffer(self.commands)? };
        shared.submit(self.commands, self.fence)
    }

    /// Whether the device has done what was submitted.
    pub(super) fn is_done(&self, shared: &Shared) -> bool {
        // SAFETY: the fence belongs to this device.
        unsafe { shared.device.get_fence_status(self.fence) }.unwrap_or(false)
    }

    /// Waits until the device has done what was submitted.
    pub(super) fn wait(&self, shared: &Shared) -> std::result::Result<(), vk::Result> {
        // SAFETY: the fence belongs to this device and to a submission.
        shared.waited(unsafe { shared.device.wait_for_fences(&[self.fence], true, TIMEOUT_NS) })
    }

    /// Copies `bytes` to staging memory. Returns the buffer and the offset in it.
    pub(super) fn stage(&mut self, shared: &Shared, bytes: &[u8]) -> Result<(vk::Buffer, u64)> {
        if let Some(place) = self.staging.iter_mut().find_map(|staging| staging.append(bytes)) {
            return Ok(place);
        }
        let mut staging = Staging::new(shared, STAGING_CHUNK.max(bytes.len() as u64))?;
        let place = staging.append(bytes);
        self.staging.push(staging);
        place.ok_or_else(|| crate::Error::Internal("staging memory is not mapped".into()))
    }

    /// Empties the staging memory, which the device must not use any more, and frees what is beyond
    /// [`KEPT_STAGING`].
    fn clear_staging(&mut self, shared: &Shared) {
        let mut total = 0;
        for staging in std::mem::take(&mut self.staging) {
            total += staging.bytes();
            if total <= KEPT_STAGING {
                self.staging.push(staging.emptied());
            } else {
                staging.destroy(shared);
            }
        }
    }

    pub(super) fn reserve_queries(&mut self, shared: &Shared, count: u32) -> Result<()> {
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

    pub(super) fn reserve_descriptors(&mut self, shared: &Shared, counts: Counts) -> Result<()> {
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
        let grown: Counts =
            std::array::from_fn(|i| counts[i].max(self.descriptor_counts[i]).next_power_of_two().max(16));
        let sizes: Vec<_> = KINDS
            .iter()
            .zip(&grown[1..])
            .filter(|(ty, _)| **ty != vk::DescriptorType::ACCELERATION_STRUCTURE_KHR || shared.builder.is_some())
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
