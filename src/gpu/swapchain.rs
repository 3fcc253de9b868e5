//! The images of a window: they are made for its size, acquired, drawn to and presented.

use std::sync::Arc;

use ash::vk;
use raw_window_handle::{HasDisplayHandle, HasWindowHandle};

use super::device::{Gpu, during, unfit};
use crate::{Error, Result};

/// The handles from which a surface is made.
pub trait WindowHandles: HasWindowHandle + HasDisplayHandle + Send + Sync {}

impl<T: HasWindowHandle + HasDisplayHandle + Send + Sync> WindowHandles for T {}

/// When a finished picture reaches the screen.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum PresentMode {
    /// At the next refresh, in order.
    Fifo,
    /// At the next refresh, where only the newest picture is shown.
    Mailbox,
    /// At once. The picture may tear.
    Immediate,
}

impl PresentMode {
    /// All modes, first the one that every device has.
    pub const ALL: [Self; 3] = [Self::Fifo, Self::Mailbox, Self::Immediate];

    /// Its name.
    pub const fn name(self) -> &'static str {
        match self {
            Self::Fifo => "fifo",
            Self::Mailbox => "mailbox",
            Self::Immediate => "immediate",
        }
    }

    const fn vulkan(self) -> vk::PresentModeKHR {
        match self {
            Self::Fifo => vk::PresentModeKHR::FIFO,
            Self::Mailbox => vk::PresentModeKHR::MAILBOX,
            Self::Immediate => vk::PresentModeKHR::IMMEDIATE,
        }
    }
}

/// A window as Vulkan sees it. It holds the window, and must be dropped after its swapchain.
pub(super) struct Surface {
    gpu: Gpu,
    functions: ash::khr::surface::Instance,
    pub handle: vk::SurfaceKHR,
    _window: Arc<dyn WindowHandles>,
}

impl Surface {
    pub fn new(gpu: &Gpu, window: &Arc<dyn WindowHandles>) -> Result<Self> {
        let shared = &gpu.0;
        let gone = |_| Error::input("window", "it has no handle any more", "start again");
        let display = window.display_handle().map_err(gone)?.as_raw();
        let raw = window.window_handle().map_err(gone)?.as_raw();
        let functions = ash::khr::surface::Instance::new(&shared.entry, &shared.instance);
        // SAFETY: the surface holds the window, which therefore outlives it.
        let handle = unsafe { ash_window::create_surface(&shared.entry, &shared.instance, display, raw, None) }
            .map_err(during("making the window's surface"))?;
        let surface = Self { gpu: gpu.clone(), functions, handle, _window: Arc::clone(window) };
        // SAFETY: the surface is alive.
        let presents = unsafe {
            surface.functions.get_physical_device_surface_support(shared.physical, shared.queue_family, handle)
        };
        match presents {
            Ok(true) => Ok(surface),
            Ok(false) => Err(unfit(gpu.device_name(), "it cannot present to this window")),
            Err(result) => Err(during("vkGetPhysicalDeviceSurfaceSupportKHR")(result)),
        }
    }

    /// The modes of [`PresentMode::ALL`] that the window offers.
    pub fn modes(&self) -> Result<Vec<PresentMode>> {
        // SAFETY: the surface is alive.
        let offered =
            unsafe { self.functions.get_physical_device_surface_present_modes(self.gpu.0.physical, self.handle) }
                .map_err(during("vkGetPhysicalDeviceSurfacePresentModesKHR"))?;
        Ok(PresentMode::ALL.into_iter().filter(|mode| offered.contains(&mode.vulkan())).collect())
    }

    /// A format that shows codes as they are, so that sRGB-encoded values are written.
    pub fn format(&self) -> Result<vk::SurfaceFormatKHR> {
        // SAFETY: the surface is alive.
        let offered = unsafe { self.functions.get_physical_device_surface_formats(self.gpu.0.physical, self.handle) }
            .map_err(during("vkGetPhysicalDeviceSurfaceFormatsKHR"))?;
        let plain = [vk::Format::B8G8R8A8_UNORM, vk::Format::R8G8B8A8_UNORM, vk::Format::A8B8G8R8_UNORM_PACK32];
        let fits =
            |f: &&vk::SurfaceFormatKHR| plain.contains(&f.format) && f.color_space == vk::ColorSpaceKHR::SRGB_NONLINEAR;
        offered
            .iter()
            .find(fits)
            .copied()
            .ok_or_else(|| unfit(self.gpu.device_name(), "the window offers no 8-bit format"))
    }
}

impl Drop for Surface {
    fn drop(&mut self) {
        if self.gpu.0.may_free() {
            // SAFETY: the surface's swapchain is gone.
            unsafe { self.functions.destroy_surface(self.handle, None) };
        }
    }
}

/// One of a window's images, to be drawn to.
#[derive(Clone, Copy)]
pub(super) struct SwapchainImage {
    pub index: u32,
    pub image: vk::Image,
    pub view: vk::ImageView,
    /// Signalled when drawing has finished. Each image has its own, because its presentation waits for it.
    pub finished: vk::Semaphore,
    pub extent: vk::Extent2D,
}

/// The result of acquiring or presenting an image.
pub(super) enum Attempt<T> {
    Done(T),
    /// The window has changed, so it needs another swapchain.
    OutOfDate,
    /// The surface is gone and must be made again.
    Lost,
    /// No image came within the time allowed, or the window has no area.
    NotReady,
}

pub(super) struct Swapchain {
    gpu: Gpu,
    functions: ash::khr::swapchain::Device,
    handle: vk::SwapchainKHR,
    pub extent: vk::Extent2D,
    targets: Vec<SwapchainImage>,
    /// The images still work but no longer suit the window.
    pub suboptimal: bool,
}

/// How long to wait for an image, nanoseconds. A hidden window may give none.
const ACQUIRE_NS: u64 = 500_000_000;

impl Swapchain {
    /// Makes images for a surface, unless its window has no area or is gone. `wanted` is their
    /// size, if the surface leaves it open.
    pub fn new(
        gpu: &Gpu,
        surface: &Surface,
        format: vk::SurfaceFormatKHR,
        mode: PresentMode,
        wanted: [u32; 2],
        old: Option<Self>,
    ) -> Result<Attempt<Self>> {
        let shared = &gpu.0;
        if old.is_some() {
            // Nothing else tells when the old images have been presented. This is rare: the window has changed.
            // SAFETY: the lock serialises the queue.
            let waited = unsafe { shared.device.queue_wait_idle(*shared.queue()) };
            shared.waited(waited).map_err(during("vkQueueWaitIdle"))?;
        }
        // SAFETY: the surface is alive.
        let offered =
            unsafe { surface.functions.get_physical_device_surface_capabilities(shared.physical, surface.handle) };
        let offered = match offered {
            Ok(offered) => offered,
            Err(result) => return unusable(result, "vkGetPhysicalDeviceSurfaceCapabilitiesKHR"),
        };
        let extent = if offered.current_extent.width == u32::MAX {
            let (low, high) = (offered.min_image_extent, offered.max_image_extent);
            vk::Extent2D {
                width: wanted[0].clamp(low.width, high.width.max(low.width)),
                height: wanted[1].clamp(low.height, high.height.max(low.height)),
            }
        } else {
            offered.current_extent
        };
        if extent.width == 0 || extent.height == 0 || wanted.contains(&0) {
            return Ok(Attempt::NotReady);
        }
        let most = if offered.max_image_count == 0 { u32::MAX } else { offered.max_image_count };
        let opaque = offered.supported_composite_alpha.contains(vk::CompositeAlphaFlagsKHR::OPAQUE);
        let info = vk::SwapchainCreateInfoKHR::default()
            .surface(surface.handle)
            .min_image_count((offered.min_image_count + 1).min(most))
            .image_format(format.format)
            .image_color_space(format.color_space)
            .image_extent(extent)
            .image_array_layers(1)
            .image_usage(vk::ImageUsageFlags::COLOR_ATTACHMENT | vk::ImageUsageFlags::TRANSFER_DST)
            .image_sharing_mode(vk::SharingMode::EXCLUSIVE)
            .pre_transform(offered.current_transform)
            .composite_alpha(if opaque {
                vk::CompositeAlphaFlagsKHR::OPAQUE
            } else {
                vk::CompositeAlphaFlagsKHR::INHERIT
            })
            .present_mode(mode.vulkan())
            .clipped(true)
            .old_swapchain(old.as_ref().map_or(vk::SwapchainKHR::null(), |old| old.handle));
        let functions = ash::khr::swapchain::Device::new(&shared.instance, &shared.device);
        // SAFETY: the surface offers all that is asked for.
        let handle = match unsafe { functions.create_swapchain(&info, None) } {
            Ok(handle) => handle,
            Err(result) => return unusable(result, "vkCreateSwapchainKHR"),
        };
        drop(old);
        let mut made = Self { gpu: gpu.clone(), functions, handle, extent, targets: Vec::new(), suboptimal: false };
        made.targets(format.format)?;
        Ok(Attempt::Done(made))
    }

    fn targets(&mut self, format: vk::Format) -> Result<()> {
        let shared = &self.gpu.0;
        // SAFETY: the swapchain is alive, and what is made here is freed when it is dropped.
        unsafe {
            let images = self.functions.get_swapchain_images(self.handle).map_err(during("vkGetSwapchainImagesKHR"))?;
            for (index, image) in (0..).zip(images) {
                let range = vk::ImageSubresourceRange::default()
                    .aspect_mask(vk::ImageAspectFlags::COLOR)
                    .level_count(1)
                    .layer_count(1);
                let info = vk::ImageViewCreateInfo::default()
                    .image(image)
                    .view_type(vk::ImageViewType::TYPE_2D)
                    .format(format)
                    .subresource_range(range);
                let view = shared.device.create_image_view(&info, None).map_err(during("vkCreateImageView"))?;
                let finished = shared.device.create_semaphore(&vk::SemaphoreCreateInfo::default(), None);
                let finished = finished.map_err(|result| {
                    shared.device.destroy_image_view(view, None);
                    during("vkCreateSemaphore")(result)
                })?;
                shared.label(image, "window");
                shared.label(finished, "drawing has finished");
                self.targets.push(SwapchainImage { index, image, view, finished, extent: self.extent });
            }
        }
        Ok(())
    }

    /// Acquires the next image. `ready` is signalled when it may be drawn to.
    pub fn acquire(&mut self, ready: vk::Semaphore) -> Result<Attempt<SwapchainImage>> {
        // SAFETY: the semaphore is unsignalled and nothing waits for it.
        match unsafe { self.functions.acquire_next_image(self.handle, ACQUIRE_NS, ready, vk::Fence::null()) } {
            Ok((index, suboptimal)) => {
                self.suboptimal |= suboptimal;
                Ok(Attempt::Done(self.targets[index as usize]))
            }
            Err(result) => unusable(result, "vkAcquireNextImageKHR"),
        }
    }

    /// Presents an image once drawing to it has finished.
    pub fn present(&mut self, target: SwapchainImage) -> Result<Attempt<()>> {
        let (swapchains, indices, wait) = ([self.handle], [target.index], [target.finished]);
        let info = vk::PresentInfoKHR::default().swapchains(&swapchains).image_indices(&indices).wait_semaphores(&wait);
        let queue = self.gpu.0.queue();
        // SAFETY: the image was acquired, `finished` will be signalled, and the lock serialises the queue.
        match unsafe { self.functions.queue_present(*queue, &info) } {
            Ok(suboptimal) => {
                self.suboptimal |= suboptimal;
                Ok(Attempt::Done(()))
            }
            Err(result) => unusable(result, "vkQueuePresentKHR"),
        }
    }
}

fn unusable<T>(result: vk::Result, call: &str) -> Result<Attempt<T>> {
    match result {
        vk::Result::ERROR_OUT_OF_DATE_KHR => Ok(Attempt::OutOfDate),
        vk::Result::ERROR_SURFACE_LOST_KHR | vk::Result::ERROR_NATIVE_WINDOW_IN_USE_KHR => Ok(Attempt::Lost),
        vk::Result::NOT_READY | vk::Result::TIMEOUT => Ok(Attempt::NotReady),
        result => Err(during(call)(result)),
    }
}

impl Drop for Swapchain {
    fn drop(&mut self) {
        let device = &self.gpu.0.device;
        if !self.gpu.0.may_free() {
            return;
        }
        // SAFETY: whoever drops this has waited for what draws to its images and presents them.
        unsafe {
            for target in &self.targets {
                device.destroy_image_view(target.view, None);
                device.destroy_semaphore(target.finished, None);
            }
            self.functions.destroy_swapchain(self.handle, None);
        }
    }
}
