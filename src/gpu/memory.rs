//! Buffers and images on the device.

use std::{
    fmt,
    sync::{Arc, atomic::Ordering},
};

use ash::vk;
use bytemuck::Pod;
use gpu_allocator::{MemoryLocation, vulkan as memory};

use super::{
    device::{Gpu, Shared, during},
    encode,
};
use crate::{Error, Result};

/// The formats of images.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Format {
    /// One 32-bit float.
    R32f,
    /// A whole number from −127 to 127, which shaders see as its 127th part.
    R8Snorm,
    /// One 16-bit float.
    R16f,
    /// Two 16-bit floats.
    Rg16f,
    /// Two 32-bit floats.
    Rg32f,
    /// Two 32-bit unsigned integers.
    Rg32u,
    /// Four 8-bit codes that stand for 0 to 1.
    Rgba8,
    /// Four 16-bit floats.
    Rgba16f,
    /// Four 32-bit floats.
    Rgba32f,
    /// One 32-bit unsigned integer.
    R32u,
    /// Four 32-bit unsigned integers.
    Rgba32u,
}

impl Format {
    pub(super) const ALL: [Self; 11] = [
        Self::R32f,
        Self::R8Snorm,
        Self::R16f,
        Self::Rg16f,
        Self::Rg32f,
        Self::Rg32u,
        Self::Rgba8,
        Self::Rgba16f,
        Self::Rgba32f,
        Self::R32u,
        Self::Rgba32u,
    ];

    /// Bytes of one texel.
    pub const fn bytes(self) -> u64 {
        match self {
            Self::R8Snorm => 1,
            Self::R16f => 2,
            Self::R32f | Self::R32u | Self::Rg16f | Self::Rgba8 => 4,
            Self::Rg32f | Self::Rg32u | Self::Rgba16f => 8,
            Self::Rgba32f | Self::Rgba32u => 16,
        }
    }

    pub(super) const fn vulkan(self) -> vk::Format {
        match self {
            Self::R32f => vk::Format::R32_SFLOAT,
            Self::R8Snorm => vk::Format::R8_SNORM,
            Self::R16f => vk::Format::R16_SFLOAT,
            Self::Rg16f => vk::Format::R16G16_SFLOAT,
            Self::Rg32f => vk::Format::R32G32_SFLOAT,
            Self::Rg32u => vk::Format::R32G32_UINT,
            Self::Rgba8 => vk::Format::R8G8B8A8_UNORM,
            Self::Rgba16f => vk::Format::R16G16B16A16_SFLOAT,
            Self::Rgba32f => vk::Format::R32G32B32A32_SFLOAT,
            Self::R32u => vk::Format::R32_UINT,
            Self::Rgba32u => vk::Format::R32G32B32A32_UINT,
        }
    }

    pub(super) const fn is_integer(self) -> bool {
        matches!(self, Self::R32u | Self::Rgba32u)
    }
}

/// A buffer for storage, uniform or indirect data on the device. A clone is the same buffer.
#[derive(Clone)]
pub struct Buffer(Arc<BufferData>);

struct BufferData {
    gpu: Gpu,
    handle: vk::Buffer,
    allocation: Option<memory::Allocation>,
    name: String,
    bytes: u64,
    id: u64,
}

impl Buffer {
    /// Its name in messages.
    pub fn name(&self) -> &str {
        &self.0.name
    }

    /// The size in bytes.
    pub fn bytes(&self) -> u64 {
        self.0.bytes
    }

    pub(super) fn handle(&self) -> vk::Buffer {
        self.0.handle
    }

    pub(super) fn id(&self) -> u64 {
        self.0.id
    }

    /// Where it is on the device. It was made by [`Gpu::addressed`].
    pub(super) fn address(&self) -> u64 {
        let info = vk::BufferDeviceAddressInfo::default().buffer(self.0.handle);
        // SAFETY: the buffer is alive and has an address.
        unsafe { self.0.gpu.0.device.get_buffer_device_address(&info) }
    }
}

impl fmt::Debug for Buffer {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "Buffer({}, {} bytes)", self.0.name, self.0.bytes)
    }
}

impl Drop for BufferData {
    fn drop(&mut self) {
        // SAFETY: frames that use the buffer hold it, and the last holder is gone.
        self.gpu.0.release(self.allocation.take(), |device| unsafe { device.destroy_buffer(self.handle, None) });
    }
}

/// A 2D image with layers and mip levels, always in the `GENERAL` layout. A clone is the same image.
#[derive(Clone)]
pub struct Image(Arc<ImageData>);

struct ImageData {
    gpu: Gpu,
    handle: vk::Image,
    allocation: Option<memory::Allocation>,
    /// A plain view and a view as an array, for each level. Index `levels` holds the views of all levels.
    views: Vec<[vk::ImageView; 2]>,
    name: String,
    size: [u32; 2],
    layers: u32,
    levels: u32,
    format: Format,
    id: u64,
}

impl Image {
    /// Its name in messages.
    pub fn name(&self) -> &str {
        &self.0.name
    }

    /// Width and height of level 0.
    pub fn size(&self) -> [u32; 2] {
        self.0.size
    }

    /// Width and height of a mip level.
    pub fn level_size(&self, level: u32) -> [u32; 2] {
        self.0.size.map(|n| n.checked_shr(level).unwrap_or(0).max(1))
    }

    /// The number of array layers.
    pub fn layers(&self) -> u32 {
        self.0.layers
    }

    /// The number of mip levels.
    pub fn levels(&self) -> u32 {
        self.0.levels
    }

    pub fn format(&self) -> Format {
        self.0.format
    }

    /// Whether both handles are of one image.
    pub fn same(&self, other: &Self) -> bool {
        Arc::ptr_eq(&self.0, &other.0)
    }

    /// Whether there is another handle of this image.
    pub fn is_shared(&self) -> bool {
        Arc::strong_count(&self.0) > 1
    }

    pub(super) fn handle(&self) -> vk::Image {
        self.0.handle
    }

    pub(super) fn id(&self) -> u64 {
        self.0.id
    }

    /// The view of one level, or of all for `None`. It is null for a plain view of an image with layers.
    pub(super) fn view(&self, level: Option<u32>, array: bool) -> vk::ImageView {
        self.0.views[level.unwrap_or(self.0.levels) as usize][usize::from(array)]
    }

    pub(super) fn layers_of(&self, level: u32) -> vk::ImageSubresourceLayers {
        let aspect = vk::ImageAspectFlags::COLOR;
        vk::ImageSubresourceLayers::default().aspect_mask(aspect).mip_level(level).layer_count(self.0.layers)
    }

    pub(super) fn extent(&self, level: u32) -> vk::Extent3D {
        let [width, height] = self.level_size(level);
        vk::Extent3D { width, height, depth: 1 }
    }
}

impl fmt::Debug for Image {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let ImageData { name, size: [w, h], layers, levels, format, .. } = &*self.0;
        write!(f, "Image({name}, {w}x{h}, {layers} layers, {levels} levels, {format:?})")
    }
}

impl Drop for ImageData {
    fn drop(&mut self) {
        // SAFETY: frames that use the image hold it, and the last holder is gone. Null views are ignored.
        self.gpu.0.release(self.allocation.take(), |device| unsafe {
            for view in self.views.iter().flatten() {
                device.destroy_image_view(*view, None);
            }
            device.destroy_image(self.handle, None);
        });
    }
}

impl Shared {
    /// Destroys what lies in this memory, and frees that, unless the device may still use it.
    fn release(&self, memory: Option<memory::Allocation>, destroy: impl FnOnce(&ash::Device)) {
        if !self.may_free() {
            std::mem::forget(memory);
            return;
        }
        destroy(&self.device);
        if let Some(memory) = memory {
            self.live_bytes.fetch_sub(memory.size(), Ordering::Relaxed);
            self.free(memory);
        }
    }
}

/// Creates a labelled buffer and binds memory to it.
pub(super) fn raw_buffer(
    shared: &Shared,
    name: &str,
    bytes: u64,
    usage: vk::BufferUsageFlags,
    location: MemoryLocation,
) -> Result<(vk::Buffer, memory::Allocation)> {
    let info = vk::BufferCreateInfo::default().size(bytes).usage(usage).sharing_mode(vk::SharingMode::EXCLUSIVE);
    // SAFETY: the size is within the limits. On failure the buffer is destroyed.
    unsafe {
        let handle = shared.device.create_buffer(&info, None).map_err(during(format!("vkCreateBuffer for {name}")))?;
        let desc = memory::AllocationCreateDesc {
            name,
            requirements: shared.device.get_buffer_memory_requirements(handle),
            location,
            linear: true,
            allocation_scheme: memory::AllocationScheme::GpuAllocatorManaged,
        };
        let bound = shared.allocate(&desc).and_then(|allocation| {
            match shared.device.bind_buffer_memory(handle, allocation.memory(), allocation.offset()) {
                Ok(()) => Ok(allocation),
                Err(result) => {
                    shared.free(allocation);
                    Err(during(format!("vkBindBufferMemory for {name}"))(result))
                }
            }
        });
        match bound {
            Ok(allocation) => {
                shared.label(handle, name);
                Ok((handle, allocation))
            }
            Err(error) => {
                shared.device.destroy_buffer(handle, None);
                Err(error)
            }
        }
    }
}

impl Gpu {
    /// Makes a zeroed buffer for storage, uniform, indirect and transfer use. Sizes are rounded up to a
    /// multiple of 4. A size of 0 becomes 16, so that an empty buffer can be bound.
    ///
    /// # Errors
    /// Fails with [`Error::Input`] if the size exceeds the device's limits or memory.
    pub fn buffer(&self, name: &str, bytes: u64) -> Result<Buffer> {
        let limit = u64::from(self.0.limits.max_storage_buffer_range).min(self.0.max_buffer_bytes);
        let usage = vk::BufferUsageFlags::UNIFORM_BUFFER | vk::BufferUsageFlags::INDIRECT_BUFFER;
        self.buffer_within(limit, name, bytes, usage)
    }

    /// Makes a zeroed buffer that is found by its address, and never bound.
    pub(super) fn addressed(&self, name: &str, bytes: u64, usage: vk::BufferUsageFlags) -> Result<Buffer> {
        self.buffer_within(self.0.max_buffer_bytes, name, bytes, usage | vk::BufferUsageFlags::SHADER_DEVICE_ADDRESS)
    }

    fn buffer_within(&self, limit: u64, name: &str, bytes: u64, usage: vk::BufferUsageFlags) -> Result<Buffer> {
        let shared = &self.0;
        let bytes = if bytes == 0 { 16 } else { bytes.next_multiple_of(4) };
        if bytes > limit {
            return Err(Error::input(
                name,
                format!("it takes {bytes} bytes and this device allows at most {limit}"),
                "use a smaller scene or image, or another device",
            ));
        }
        let usage = usage
            | vk::BufferUsageFlags::STORAGE_BUFFER
            | vk::BufferUsageFlags::TRANSFER_SRC
            | vk::BufferUsageFlags::TRANSFER_DST;
        let (handle, allocation) = raw_buffer(shared, name, bytes, usage, MemoryLocation::GpuOnly)?;
        shared.live_bytes.fetch_add(allocation.size(), Ordering::Relaxed);
        let id = shared.next_id.fetch_add(1, Ordering::Relaxed);
        let buffer = Buffer(Arc::new(BufferData {
            gpu: self.clone(),
            handle,
            allocation: Some(allocation),
            name: name.to_owned(),
            bytes,
            id,
        }));
        // SAFETY: the buffer is alive until the commands have run.
        encode::immediate(shared, &format!("zeroing {name}"), |commands| unsafe {
            shared.device.cmd_fill_buffer(commands, handle, 0, vk::WHOLE_SIZE, 0);
        })?;
        Ok(buffer)
    }

    /// Makes a buffer that holds `data`.
    ///
    /// # Errors
    /// Fails as [`Gpu::buffer`] does.
    pub fn buffer_with<T: Pod>(&self, name: &str, data: &[T]) -> Result<Buffer> {
        let buffer = self.buffer(name, size_of_val(data) as u64)?;
        self.write_buffer(&buffer, 0, data)?;
        Ok(buffer)
    }

    /// Makes a zeroed image for storage, sampling and transfer.
    ///
    /// # Errors
    /// Fails with [`Error::Input`] if the image exceeds the device's limits or memory, or if the device
    /// cannot store this format.
    pub fn image(&self, name: &str, size: [u32; 2], layers: u32, levels: u32, format: Format) -> Result<Image> {
        let shared = &self.0;
        let [width, height] = size;
        let (limit, most_layers) = (shared.limits.max_image_dimension2_d, shared.limits.max_image_array_layers);
        let refuse = |problem: String| Err(Error::input(name, problem, "use another size or another device"));
        if width == 0 || height == 0 || layers == 0 || levels == 0 || levels > 32 - width.max(height).leading_zeros() {
            return refuse(format!("no image can be {width}x{height} with {layers} layers and {levels} levels"));
        }
        if width > limit || height > limit || layers > most_layers {
            return refuse(format!(
                "{width}x{height} with {layers} layers exceeds this device's {limit}x{limit} with {most_layers}"
            ));
        }
        if !shared.storage[format as usize] {
            return refuse(format!("this device has no storage images of format {format:?}"));
        }
        let info = vk::ImageCreateInfo::default()
            .image_type(vk::ImageType::TYPE_2D)
            .format(format.vulkan())
            .extent(vk::Extent3D { width, height, depth: 1 })
            .mip_levels(levels)
            .array_layers(layers)
            .samples(vk::SampleCountFlags::TYPE_1)
            .tiling(vk::ImageTiling::OPTIMAL)
            .usage(
                vk::ImageUsageFlags::STORAGE
                    | vk::ImageUsageFlags::SAMPLED
                    | vk::ImageUsageFlags::TRANSFER_SRC
                    | vk::ImageUsageFlags::TRANSFER_DST,
            )
            .sharing_mode(vk::SharingMode::EXCLUSIVE)
            .initial_layout(vk::ImageLayout::UNDEFINED);
        // SAFETY: the create info is within the limits checked above.
        let handle =
            unsafe { shared.device.create_image(&info, None) }.map_err(during(format!("vkCreateImage for {name}")))?;
        // From here on, dropping `data` frees what has been made.
        let mut data = ImageData {
            gpu: self.clone(),
            handle,
            allocation: None,
            views: Vec::new(),
            name: name.to_owned(),
            size,
            layers,
            levels,
            format,
            id: shared.next_id.fetch_add(1, Ordering::Relaxed),
        };
        shared.label(handle, name);
        let desc = memory::AllocationCreateDesc {
            name,
            // SAFETY: the image is alive.
            requirements: unsafe { shared.device.get_image_memory_requirements(handle) },
            location: MemoryLocation::GpuOnly,
            linear: false,
            allocation_scheme: memory::AllocationScheme::GpuAllocatorManaged,
        };
        let allocation = shared.allocate(&desc)?;
        shared.live_bytes.fetch_add(allocation.size(), Ordering::Relaxed);
        let allocation = data.allocation.insert(allocation);
        // SAFETY: the memory fits the image's requirements and is bound to nothing else.
        unsafe { shared.device.bind_image_memory(handle, allocation.memory(), allocation.offset()) }
            .map_err(during(format!("vkBindImageMemory for {name}")))?;
        for level in 0..=levels {
            data.views.push([vk::ImageView::null(); 2]);
            for array in [false, true] {
                if array || layers == 1 {
                    data.views[level as usize][usize::from(array)] = view(shared, &data, level, array)?;
                }
            }
        }
        // SAFETY: the image is alive until the commands have run.
        encode::immediate(shared, &format!("clearing {name}"), |commands| unsafe {
            encode::to_general(&shared.device, commands, handle);
            let range = encode::whole_image();
            let zero = vk::ClearColorValue::default();
            shared.device.cmd_clear_color_image(commands, handle, vk::ImageLayout::GENERAL, &zero, &[range]);
        })?;
        Ok(Image(Arc::new(data)))
    }
}

/// Makes the view of a level, or of all levels if `level` is the image's number of levels.
fn view(shared: &Shared, image: &ImageData, level: u32, array: bool) -> Result<vk::ImageView> {
    let (base, count) = if level == image.levels { (0, image.levels) } else { (level, 1) };
    let info = vk::ImageViewCreateInfo::default()
        .image(image.handle)
        .view_type(if array { vk::ImageViewType::TYPE_2D_ARRAY } else { vk::ImageViewType::TYPE_2D })
        .format(image.format.vulkan())
        .subresource_range(
            vk::ImageSubresourceRange::default()
                .aspect_mask(vk::ImageAspectFlags::COLOR)
                .base_mip_level(base)
                .level_count(count)
                .layer_count(image.layers),
        );
    // SAFETY: the image is alive and bound, and the range is within it.
    let view = unsafe { shared.device.create_image_view(&info, None) }
        .map_err(during(format!("vkCreateImageView for {}", image.name)))?;
    shared.label(view, &image.name);
    Ok(view)
}
