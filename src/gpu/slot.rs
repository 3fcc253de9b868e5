//! What one submission needs: command buffer, fence, query pool, descriptor pool; kept for the next.

use ash::vk;

use super::{
    device::{Shared, during},
    encode::barrier,
};
use crate::Result;

/// How long the device may take for one submission before it is given up: a CPU device traces for minutes.
const TIMEOUT_NS: u64 = 600_000_000_000;

/// The kinds of descriptors, in the order in which a [`Slot`] counts them.
pub(super) const KINDS: [vk::DescriptorType; 4] = [
    vk::DescriptorType::STORAGE_BUFFER,
    vk::DescriptorType::UNIFORM_BUFFER,
    vk::DescriptorType::STORAGE_IMAGE,
    vk::DescriptorType::COMBINED_IMAGE_SAMPLER,
];

/// Sets, then descriptors of each of [`KINDS`].
pub(super) type Counts = [u32; 1 + KINDS.len()];

/// What one submission needs, kept for the next. Pools grow to what a frame asks of them.
pub(super) struct Slot {
    pool: vk::CommandPool,
    pub commands: vk::CommandBuffer,
    fence: vk::Fence,
    pub queries: vk::QueryPool,
    query_count: u32,
    pub descriptors: vk::DescriptorPool,
    descriptor_counts: Counts,
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
        // What earlier submissions wrote is finished, their fences were waited for, but not yet visible.
        barrier(device, self.commands, vk::PipelineStageFlags2::ALL_COMMANDS, vk::PipelineStageFlags2::ALL_COMMANDS);
        Ok(())
    }

    /// Submits and waits.
    pub(super) fn finish(&self, shared: &Shared) -> std::result::Result<(), vk::Result> {
        let host = vk::PipelineStageFlags2::ALL_COMMANDS | vk::PipelineStageFlags2::HOST;
        barrier(&shared.device, self.commands, vk::PipelineStageFlags2::ALL_COMMANDS, host);
        // SAFETY: recording is complete.
        unsafe {
            shared.device.end_command_buffer(self.commands)?;
            shared.submit(self.commands, self.fence)?;
            shared.device.wait_for_fences(&[self.fence], true, TIMEOUT_NS)
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
