//! Shows frames in a window: copies finished pictures to it, draws panels over them, and presents. Two frames
//! are in flight. Drawing waits for the fences of frames, never for the whole device.

use std::sync::Arc;

use ash::vk;
use raw_window_handle::RawDisplayHandle;

use super::{
    adapter::no_instance,
    device::{Gpu, GpuOptions, during},
    encode::{barrier, image_change},
    memory::{Format, Image},
    overlay::{Overlay, Paint},
    slot::TIMEOUT_NS,
    swapchain::{Attempt, PresentMode, Surface, Swapchain, SwapchainImage, WindowHandles},
};
use crate::Result;

const IN_FLIGHT: usize = 2;

impl Gpu {
    /// Opens a device that can show pictures in windows on `display`.
    ///
    /// # Errors
    /// Fails as [`Gpu::new`] does, or with [`crate::Error::NoDevice`] if the device cannot draw or present.
    pub fn for_windows(options: &GpuOptions, display: RawDisplayHandle) -> Result<Self> {
        let extensions = ash_window::enumerate_required_extensions(display).map_err(no_instance)?;
        Self::open(options, Some(extensions))
    }
}

/// A part of a picture and the place in the window to which it is scaled: left, top, right, bottom in pixels.
#[derive(Clone)]
pub struct Blit {
    /// A finished picture of format [`Format::Rgba8`]. Nothing may write it until the frame is over.
    pub image: Image,
    /// The part of the picture.
    pub from: [f32; 4],
    /// The place in the window. What lies outside the window is left out.
    pub to: [f32; 4],
    /// Whether to interpolate between texels.
    pub smooth: bool,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Shown {
    /// It reached the window.
    Yes,
    /// The window has no area, is hidden or has just changed. Try again.
    NotNow,
}

/// The swapchain of a window, and its frames in flight.
pub struct Screen {
    gpu: Gpu,
    window: Arc<dyn WindowHandles>,
    frames: Vec<Flight>,
    next: usize,
    overlay: Overlay,
    mode: PresentMode,
    modes: Vec<PresentMode>,
    format: vk::SurfaceFormatKHR,
    swapchain: Option<Swapchain>,
    surface: Option<Surface>,
    made_for: [u32; 2],
    /// How often a swapchain was made.
    pub swapchains: u64,
}

/// One frame in flight, with the pictures that it holds.
struct Flight {
    pool: vk::CommandPool,
    commands: vk::CommandBuffer,
    fence: vk::Fence,
    /// Whether the fence belongs to a submission that nobody waited for yet.
    pending: bool,
    ready: vk::Semaphore,
    held: Vec<Image>,
}

impl Screen {
    /// Takes over a window.
    ///
    /// # Errors
    /// Fails with [`crate::Error::NoDevice`] if the device cannot show anything in it.
    pub fn new(gpu: &Gpu, window: Arc<dyn WindowHandles>) -> Result<Self> {
        let surface = Surface::new(gpu, &window)?;
        let (format, modes) = (surface.format()?, surface.modes()?);
        let overlay = Overlay::new(gpu, format.format, IN_FLIGHT)?;
        let mut screen = Self {
            gpu: gpu.clone(),
            window,
            frames: Vec::new(),
            next: 0,
            overlay,
            mode: PresentMode::Fifo,
            modes,
            format,
            swapchain: None,
            surface: Some(surface),
            made_for: [0, 0],
            swapchains: 0,
        };
        for _ in 0..IN_FLIGHT {
            screen.add_flight()?;
        }
        Ok(screen)
    }

    fn add_flight(&mut self) -> Result<()> {
        let shared = &self.gpu.0;
        let device = &shared.device;
        let mut flight = Flight {
            pool: vk::CommandPool::null(),
            commands: vk::CommandBuffer::null(),
            fence: vk::Fence::null(),
            ready: vk::Semaphore::null(),
            pending: false,
            held: Vec::new(),
        };
        // SAFETY: the create infos are valid, and what has been made is freed with the screen.
        unsafe {
            let info = vk::CommandPoolCreateInfo::default()
                .flags(vk::CommandPoolCreateFlags::TRANSIENT)
                .queue_family_index(shared.queue_family);
            flight.pool = device.create_command_pool(&info, None).map_err(during("vkCreateCommandPool"))?;
            self.frames.push(flight);
            let last = self.frames.len() - 1;
            let flight = &mut self.frames[last];
            let info = vk::CommandBufferAllocateInfo::default().command_pool(flight.pool).command_buffer_count(1);
            flight.commands = device.allocate_command_buffers(&info).map_err(during("vkAllocateCommandBuffers"))?[0];
            flight.fence =
                device.create_fence(&vk::FenceCreateInfo::default(), None).map_err(during("vkCreateFence"))?;
            flight.ready = device
                .create_semaphore(&vk::SemaphoreCreateInfo::default(), None)
                .map_err(during("vkCreateSemaphore"))?;
            shared.label(flight.pool, "window");
            shared.label(flight.fence, "window frame");
            shared.label(flight.ready, "window image is ready");
        }
        Ok(())
    }

    /// The presentation modes that this window offers.
    pub fn modes(&self) -> &[PresentMode] {
        &self.modes
    }

    /// Draws pictures and panels and presents them. `size` is the window's, in pixels.
    ///
    /// # Errors
    /// Fails if the device is lost or out of memory. A window that has changed or cannot be drawn to is not
    /// an error.
    pub fn show(&mut self, size: [u32; 2], mode: PresentMode, blits: &[Blit], mut paint: Paint) -> Result<Shown> {
        let mode = if self.modes.contains(&mode) { mode } else { PresentMode::Fifo };
        self.overlay.update(&mut paint.textures)?;
        let stale = |chain: &Swapchain| chain.suboptimal;
        if self.swapchain.as_ref().is_none_or(stale) || self.made_for != size || self.mode != mode {
            self.mode = mode;
            if !self.remake(size)? {
                return Ok(Shown::NotNow);
            }
        }
        let turn = self.next;
        let flight = &mut self.frames[turn];
        if flight.pending {
            // SAFETY: the fence belongs to this device and to a submission.
            let waited = unsafe { self.gpu.0.device.wait_for_fences(&[flight.fence], true, TIMEOUT_NS) };
            self.gpu.0.waited(waited).map_err(during("waiting for a frame of the window"))?;
            flight.pending = false;
        }
        flight.held.clear();
        let ready = flight.ready;
        let Some(chain) = &mut self.swapchain else { return Ok(Shown::NotNow) };
        let target = match chain.acquire(ready)? {
            Attempt::Done(target) => target,
            Attempt::NotReady => return Ok(Shown::NotNow),
            Attempt::OutOfDate => return self.unusable(false),
            Attempt::Lost => return self.unusable(true),
        };
        self.record(turn, target, blits, &paint)?;
        self.submit(turn, target)?;
        self.frames[turn].pending = true;
        self.frames[turn].held = blits.iter().map(|blit| blit.image.clone()).collect();
        self.next = (turn + 1) % IN_FLIGHT;
        let Some(chain) = &mut self.swapchain else { return Ok(Shown::NotNow) };
        match chain.present(target)? {
            Attempt::Done(()) | Attempt::NotReady => Ok(Shown::Yes),
            Attempt::OutOfDate => self.unusable(false),
            Attempt::Lost => self.unusable(true),
        }
    }

    /// Makes the next frame create another swapchain, and another surface if this one is `lost`.
    fn unusable(&mut self, lost: bool) -> Result<Shown> {
        self.made_for = [0, 0];
        if lost {
            self.lose()?;
        }
        Ok(Shown::NotNow)
    }

    /// Gives up the surface. The next frame makes another one.
    ///
    /// # Errors
    /// Fails if the device is lost.
    pub fn lose(&mut self) -> Result<()> {
        self.wait()?;
        self.swapchain = None;
        self.surface = None;
        Ok(())
    }

    /// Waits for this window's frames and for their presentation.
    fn wait(&self) -> Result<()> {
        let fences: Vec<_> = self.frames.iter().filter(|flight| flight.pending).map(|flight| flight.fence).collect();
        let shared = &self.gpu.0;
        // SAFETY: the fences belong to submissions on this device, and the lock serialises the queue.
        unsafe {
            if !fences.is_empty() {
                let waited = shared.device.wait_for_fences(&fences, true, TIMEOUT_NS);
                shared.waited(waited).map_err(during("vkWaitForFences"))?;
            }
            let waited = shared.device.queue_wait_idle(*shared.queue());
            shared.waited(waited).map_err(during("vkQueueWaitIdle"))
        }
    }

    /// Makes another swapchain. Says whether the window can be drawn to.
    fn remake(&mut self, size: [u32; 2]) -> Result<bool> {
        if size.contains(&0) {
            return Ok(false);
        }
        let surface = match self.surface.take() {
            Some(surface) => surface,
            None => Surface::new(&self.gpu, &self.window)?,
        };
        let surface = self.surface.insert(surface);
        match Swapchain::new(&self.gpu, surface, self.format, self.mode, size, self.swapchain.take())? {
            Attempt::Done(made) => self.swapchain = Some(made),
            Attempt::NotReady | Attempt::OutOfDate => return Ok(false),
            Attempt::Lost => {
                self.surface = None;
                return Ok(false);
            }
        }
        self.made_for = size;
        self.swapchains += 1;
        Ok(true)
    }

    fn record(&mut self, turn: usize, target: SwapchainImage, blits: &[Blit], paint: &Paint) -> Result<()> {
        let device = &self.gpu.0.device;
        let flight = &self.frames[turn];
        let commands = flight.commands;
        let area = vk::Rect2D { extent: target.extent, ..Default::default() };
        let (copied, drawn, presented) = (
            vk::ImageLayout::TRANSFER_DST_OPTIMAL,
            vk::ImageLayout::COLOR_ATTACHMENT_OPTIMAL,
            vk::ImageLayout::PRESENT_SRC_KHR,
        );
        let (copying, drawing) =
            (vk::PipelineStageFlags2::ALL_TRANSFER, vk::PipelineStageFlags2::COLOR_ATTACHMENT_OUTPUT);
        // SAFETY: this command buffer's last frame is over, and everything named here is held until this one
        // is.
        unsafe {
            device
                .reset_command_pool(flight.pool, vk::CommandPoolResetFlags::empty())
                .map_err(during("vkResetCommandPool"))?;
            let info = vk::CommandBufferBeginInfo::default().flags(vk::CommandBufferUsageFlags::ONE_TIME_SUBMIT);
            device.begin_command_buffer(commands, &info).map_err(during("vkBeginCommandBuffer"))?;
            // earlier submissions finished the pictures, and later ones may write them again
            barrier(device, commands, vk::PipelineStageFlags2::ALL_COMMANDS, vk::PipelineStageFlags2::ALL_COMMANDS);
            let change = |layouts, stages| {
                let accesses = vk::AccessFlags2::MEMORY_READ | vk::AccessFlags2::MEMORY_WRITE;
                image_change(device, commands, target.image, layouts, stages, accesses);
            };
            change([vk::ImageLayout::UNDEFINED, copied], [drawing, copying]);
            let range = super::encode::whole_image();
            let dark = vk::ClearColorValue { float32: [0.07, 0.07, 0.08, 1.0] };
            device.cmd_clear_color_image(commands, target.image, copied, &dark, &[range]);
            for blit in blits {
                let Some((region, smooth)) = region(blit, target.extent) else { continue };
                // it may lie over what was cleared or copied before
                barrier(device, commands, copying, copying);
                let filter = if smooth { vk::Filter::LINEAR } else { vk::Filter::NEAREST };
                let general = vk::ImageLayout::GENERAL;
                device.cmd_blit_image(commands, blit.image.handle(), general, target.image, copied, &[region], filter);
            }
            change([copied, drawn], [copying, drawing]);
            let attachment = [vk::RenderingAttachmentInfo::default()
                .image_view(target.view)
                .image_layout(drawn)
                .load_op(vk::AttachmentLoadOp::LOAD)
                .store_op(vk::AttachmentStoreOp::STORE)];
            let info = vk::RenderingInfo::default().render_area(area).layer_count(1).color_attachments(&attachment);
            device.cmd_begin_rendering(commands, &info);
            let result = self.overlay.draw(commands, target.extent, paint);
            device.cmd_end_rendering(commands);
            result?;
            // the semaphore that says that drawing has finished is signalled after all commands
            let last = vk::PipelineStageFlags2::ALL_COMMANDS;
            change([drawn, presented], [drawing, last]);
            device.end_command_buffer(commands).map_err(during("vkEndCommandBuffer"))
        }
    }

    fn submit(&self, turn: usize, target: SwapchainImage) -> Result<()> {
        let shared = &self.gpu.0;
        let flight = &self.frames[turn];
        let everything = vk::PipelineStageFlags2::ALL_COMMANDS;
        let drawing = vk::PipelineStageFlags2::COLOR_ATTACHMENT_OUTPUT;
        let semaphore = |handle, stage| [vk::SemaphoreSubmitInfo::default().semaphore(handle).stage_mask(stage)];
        let (wait, signal) = (semaphore(flight.ready, drawing), semaphore(target.finished, everything));
        let buffers = [vk::CommandBufferSubmitInfo::default().command_buffer(flight.commands)];
        let submits = [vk::SubmitInfo2::default()
            .wait_semaphore_infos(&wait)
            .command_buffer_infos(&buffers)
            .signal_semaphore_infos(&signal)];
        // SAFETY: the commands are complete, the fence's frame is over, and the lock serialises the queue.
        unsafe {
            shared.device.reset_fences(&[flight.fence]).map_err(during("vkResetFences"))?;
            let queue = shared.queue();
            shared.device.queue_submit2(*queue, &submits, flight.fence).map_err(during("drawing the window"))
        }
    }
}

/// The region of a blit without what lies outside the window. `None` if nothing is left.
fn region(blit: &Blit, extent: vk::Extent2D) -> Option<(vk::ImageBlit, bool)> {
    let most = [extent.width as f32, extent.height as f32];
    let (mut from, mut to) = (blit.from, blit.to);
    for (axis, most) in most.into_iter().enumerate() {
        let (low, high) = (axis, axis + 2);
        let scale = (from[high] - from[low]) / (to[high] - to[low]);
        if !scale.is_finite() {
            return None;
        }
        let cut = [to[low].clamp(0.0, most).round(), to[high].clamp(0.0, most).round()];
        from = {
            let mut part = from;
            part[low] = from[low] + (cut[0] - to[low]) * scale;
            part[high] = from[high] + (cut[1] - to[high]) * scale;
            part
        };
        (to[low], to[high]) = (cut[0], cut[1]);
    }
    let size = blit.image.size();
    let corner = |r: [f32; 4], i: usize, limit: [u32; 2]| vk::Offset3D {
        x: (r[i].round() as i32).clamp(0, limit[0] as i32),
        y: (r[i + 1].round() as i32).clamp(0, limit[1] as i32),
        z: i32::from(i > 0),
    };
    let place = [extent.width, extent.height];
    let ends = |r, limit| [corner(r, 0, limit), corner(r, 2, limit)];
    let (source, goal) = (ends(from, size), ends(to, place));
    let empty = |[a, b]: [vk::Offset3D; 2]| a.x >= b.x || a.y >= b.y;
    if empty(source) || empty(goal) || blit.image.format() != Format::Rgba8 {
        return None;
    }
    let layers = vk::ImageSubresourceLayers::default().aspect_mask(vk::ImageAspectFlags::COLOR).layer_count(1);
    let region =
        vk::ImageBlit { src_subresource: layers, src_offsets: source, dst_subresource: layers, dst_offsets: goal };
    Some((region, blit.smooth))
}

impl Drop for Screen {
    fn drop(&mut self) {
        if !self.gpu.0.may_free() {
            return;
        }
        if let Err(error) = self.wait() {
            // All that was asked for has been done or has failed by now.
            tracing::warn!("closing the window: {error}");
            return;
        }
        self.swapchain = None;
        let device = &self.gpu.0.device;
        for flight in &self.frames {
            // SAFETY: all frames are over, and null handles are ignored.
            unsafe {
                device.destroy_semaphore(flight.ready, None);
                device.destroy_fence(flight.fence, None);
                device.destroy_command_pool(flight.pool, None);
            }
        }
    }
}
