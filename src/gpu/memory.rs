//! Buffers and images on the device, and the way to and from them.

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
    /// Two 32-bit floats.
    Rg32f,
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
    pub(super) const ALL: [Self; 6] =
        [Self::R32f, Self::Rg32f, Self::Rgba16f, Self::Rgba32f, Self::R32u, Self::Rgba32u];

    /// Bytes of one texel.
    pub const fn bytes(self) -> u64 {
        match self {
            Self::R32f | Self::R32u => 4,
            Self::Rg32f | Self::Rgba16f => 8,
            Self::Rgba32f | Self::Rgba32u => 16,
        }
    }

    pub(super) const fn vulkan(self) -> vk::Format {
        match self {
            Self::R32f => vk::Format::R32_SFLOAT,
            Self::Rg32f => vk::Format::R32G32_SFLOAT,
            Self::Rgba16f => vk::Format::R16G16B16A16_SFLOAT,
            Self::Rgba32f => vk::Format::R32G32B32A32_SFLOAT,
            Self::R32u => vk::Format::R32_UINT,
            Self::Rgba32u => vk::Format::R32G32B32A32_UINT,
        }
    }

    pub(super) const fn is_integer(self) -> bool {
        matches!(self, Self::R32u | Self::Rgba32u)
    }

    /// Texels as `f32`, with 0 for what the format lacks; integers above 2²⁴ are rounded.
    fn decode(self, bytes: &[u8]) -> Vec<[f32; 4]> {
        let words = || bytes.chunks_exact(4).map(|b| [b[0], b[1], b[2], b[3]]);
        let pack = |channels: usize, values: Vec<f32>| {
            let texel = |chunk: &[f32]| std::array::from_fn(|i| chunk.get(i).copied().unwrap_or(0.0));
            values.chunks_exact(channels).map(texel).collect()
        };
        match self {
            Self::R32f => pack(1, words().map(f32::from_le_bytes).collect()),
            Self::Rg32f => pack(2, words().map(f32::from_le_bytes).collect()),
            Self::Rgba32f => pack(4, words().map(f32::from_le_bytes).collect()),
            Self::Rgba16f => {
                pack(4, bytes.chunks_exact(2).map(|b| half::f16::from_le_bytes([b[0], b[1]]).to_f32()).collect())
            }
            Self::R32u => pack(1, words().map(|b| u32::from_le_bytes(b) as f32).collect()),
            Self::Rgba32u => pack(4, words().map(|b| u32::from_le_bytes(b) as f32).collect()),
        }
    }
}

/// Storage, uniform or indirect data on the device. A clone is the same buffer; the last one frees it.
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

    /// Its size.
    pub fn bytes(&self) -> u64 {
        self.0.bytes
    }

    pub(super) fn handle(&self) -> vk::Buffer {
        self.0.handle
    }

    pub(super) fn id(&self) -> u64 {
        self.0.id
    }
}

impl fmt::Debug for Buffer {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "Buffer({}, {} bytes)", self.0.name, self.0.bytes)
    }
}

impl Drop for BufferData {
    fn drop(&mut self) {
        let shared = &self.gpu.0;
        // SAFETY: frames that use the buffer hold it; the last holder is gone.
        unsafe { shared.device.destroy_buffer(self.handle, None) };
        if let Some(allocation) = self.allocation.take() {
            shared.live_bytes.fetch_sub(allocation.size(), Ordering::Relaxed);
            shared.free(allocation);
        }
    }
}

/// A 2D image with layers and mip levels, always in the `GENERAL` layout. A clone is the same image.
#[derive(Clone)]
pub struct Image(Arc<ImageData>);

struct ImageData {
    gpu: Gpu,
    handle: vk::Image,
    allocation: Option<memory::Allocation>,
    /// As (level, as an array) → view; level `levels` stands for all of them.
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

    /// Array layers.
    pub fn layers(&self) -> u32 {
        self.0.layers
    }

    /// Mip levels.
    pub fn levels(&self) -> u32 {
        self.0.levels
    }

    /// Its format.
    pub fn format(&self) -> Format {
        self.0.format
    }

    pub(super) fn handle(&self) -> vk::Image {
        self.0.handle
    }

    pub(super) fn id(&self) -> u64 {
        self.0.id
    }

    /// The view of one level, or of all; null where a plain view is asked of an image with layers.
    pub(super) fn view(&self, level: Option<u32>, array: bool) -> vk::ImageView {
        self.0.views[level.unwrap_or(self.0.levels) as usize][usize::from(array)]
    }

    /// All layers of one level.
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
        let shared = &self.gpu.0;
        // SAFETY: frames that use the image hold it; the last holder is gone. Null views are ignored.
        unsafe {
            for view in self.views.iter().flatten() {
                shared.device.destroy_image_view(*view, None);
            }
            shared.device.destroy_image(self.handle, None);
        }
        if let Some(allocation) = self.allocation.take() {
            shared.live_bytes.fetch_sub(allocation.size(), Ordering::Relaxed);
            shared.free(allocation);
        }
    }
}

/// Host memory that the device copies from and to. The allocator gives only coherent memory for it, of which Vulkan
/// promises one type, so nothing need be flushed.
pub(super) struct Staging {
    handle: vk::Buffer,
    allocation: memory::Allocation,
    bytes: u64,
}

/// Staging buffers up to this size are kept for the next transfer.
const KEPT_STAGING: u64 = 64 << 20;

impl Staging {
    fn new(shared: &Shared, bytes: u64) -> Result<Self> {
        let usage = vk::BufferUsageFlags::TRANSFER_SRC | vk::BufferUsageFlags::TRANSFER_DST;
        let (handle, allocation) = raw_buffer(shared, "staging", bytes, usage, MemoryLocation::GpuToCpu)?;
        let coherent = allocation.memory_properties().contains(vk::MemoryPropertyFlags::HOST_COHERENT);
        let staging = Self { handle, allocation, bytes };
        if coherent && staging.allocation.mapped_slice().is_some() {
            return Ok(staging);
        }
        staging.destroy(shared);
        Err(Error::Internal("staging memory is not mapped coherently".into()))
    }

    pub(super) fn destroy(self, shared: &Shared) {
        // SAFETY: transfers are waited for; none uses it.
        unsafe { shared.device.destroy_buffer(self.handle, None) };
        shared.free(self.allocation);
    }
}

/// Runs `work` with at least `bytes` of staging memory.
fn with_staging<R>(shared: &Shared, bytes: u64, work: impl FnOnce(&mut Staging) -> Result<R>) -> Result<R> {
    let mut kept = shared.staging();
    let mut staging = match kept.take() {
        Some(staging) if staging.bytes >= bytes => staging,
        small => {
            if let Some(small) = small {
                small.destroy(shared);
            }
            Staging::new(shared, bytes)?
        }
    };
    let result = work(&mut staging);
    if matches!(result, Err(Error::Vulkan { .. })) {
        return result; // the device may still be using it: leave it alone
    }
    if staging.bytes <= KEPT_STAGING {
        *kept = Some(staging);
    } else {
        staging.destroy(shared);
    }
    result
}

fn raw_buffer(
    shared: &Shared,
    name: &str,
    bytes: u64,
    usage: vk::BufferUsageFlags,
    location: MemoryLocation,
) -> Result<(vk::Buffer, memory::Allocation)> {
    let info = vk::BufferCreateInfo::default().size(bytes).usage(usage).sharing_mode(vk::SharingMode::EXCLUSIVE);
    // SAFETY: the size is within the limits; on failure the buffer is destroyed.
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
    /// A zeroed buffer for storage, uniform, indirect and transfer use. Sizes are rounded up to a multiple of 4, and
    /// 0 to 16, so that what is empty can be bound.
    ///
    /// # Errors
    /// [`Error::Input`] where it exceeds the device's limits or memory.
    pub fn buffer(&self, name: &str, bytes: u64) -> Result<Buffer> {
        let shared = &self.0;
        let bytes = if bytes == 0 { 16 } else { bytes.next_multiple_of(4) };
        let limit = u64::from(shared.limits.max_storage_buffer_range).min(shared.max_buffer_bytes);
        if bytes > limit {
            return Err(Error::input(
                name,
                format!("it takes {bytes} bytes and this device binds at most {limit}"),
                "use a smaller scene or image, or another device",
            ));
        }
        let usage = vk::BufferUsageFlags::STORAGE_BUFFER
            | vk::BufferUsageFlags::UNIFORM_BUFFER
            | vk::BufferUsageFlags::INDIRECT_BUFFER
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

    /// A buffer that holds `data`.
    ///
    /// # Errors
    /// As [`Gpu::buffer`].
    pub fn buffer_with<T: Pod>(&self, name: &str, data: &[T]) -> Result<Buffer> {
        let buffer = self.buffer(name, size_of_val(data) as u64)?;
        self.write_buffer(&buffer, 0, data)?;
        Ok(buffer)
    }

    /// A zeroed image for storage, sampling and transfer.
    ///
    /// # Errors
    /// [`Error::Input`] where it exceeds the device's limits or memory, or the device cannot store that format.
    pub fn image(&self, name: &str, size: [u32; 2], layers: u32, levels: u32, format: Format) -> Result<Image> {
        let shared = &self.0;
        let [width, height] = size;
        let (limit, most_layers) = (shared.limits.max_image_dimension2_d, shared.limits.max_image_array_layers);
        let refuse = |problem: String| Err(Error::input(name, problem, "use another size or another device"));
        if width == 0 || height == 0 || layers == 0 || levels == 0 || levels > 32 - width.max(height).leading_zeros() {
            return refuse(format!("{width}x{height} with {layers} layers and {levels} levels is no image"));
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
        // From here on dropping `data` frees whatever has been made.
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
        // SAFETY: the memory fits the image's requirements and is not bound to anything else.
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

    /// Writes `data` from `offset` bytes on. Waits until it is there.
    ///
    /// # Errors
    /// [`Error::Internal`] where it does not fit.
    pub fn write_buffer<T: Pod>(&self, buffer: &Buffer, offset: u64, data: &[T]) -> Result<()> {
        let bytes: &[u8] = bytemuck::cast_slice(data);
        let size = bytes.len() as u64;
        if offset.checked_add(size).is_none_or(|end| end > buffer.bytes()) {
            return Err(Error::Internal(format!(
                "{size} bytes at {offset} do not fit {}'s {}",
                buffer.name(),
                buffer.bytes()
            )));
        }
        if size == 0 {
            return Ok(());
        }
        self.upload(&format!("writing {}", buffer.name()), bytes, |commands, staging| {
            let region = vk::BufferCopy { src_offset: 0, dst_offset: offset, size };
            // SAFETY: both buffers are alive until the copy is done, and the ranges were checked.
            unsafe { self.0.device.cmd_copy_buffer(commands, staging, buffer.handle(), &[region]) };
        })
    }

    /// Writes one layer of one level: tightly packed rows in the image's format. Waits until it is there.
    ///
    /// # Errors
    /// [`Error::Internal`] where the data has another size than the level, or there is no such layer or level.
    pub fn write_image<T: Pod>(&self, image: &Image, layer: u32, level: u32, data: &[T]) -> Result<()> {
        let bytes: &[u8] = bytemuck::cast_slice(data);
        let region = region(image, layer, level)?;
        let wanted = level_bytes(image, level);
        if bytes.len() as u64 != wanted {
            return Err(Error::Internal(format!(
                "level {level} of {image:?} takes {wanted} bytes, not {}",
                bytes.len()
            )));
        }
        self.upload(&format!("writing {}", image.name()), bytes, |commands, staging| {
            let layout = vk::ImageLayout::GENERAL;
            // SAFETY: both are alive until the copy is done, and the size was checked.
            unsafe { self.0.device.cmd_copy_buffer_to_image(commands, staging, image.handle(), layout, &[region]) };
        })
    }

    /// The whole buffer as `T`s; bytes that do not fill one are left out.
    ///
    /// # Errors
    /// [`Error::Vulkan`] where the copy fails.
    pub fn read_buffer<T: Pod>(&self, buffer: &Buffer) -> Result<Vec<T>> {
        let count = buffer.bytes() as usize / size_of::<T>().max(1);
        let bytes = self.download(&format!("reading {}", buffer.name()), buffer.bytes(), |commands, staging| {
            let region = vk::BufferCopy { src_offset: 0, dst_offset: 0, size: buffer.bytes() };
            // SAFETY: both buffers are alive until the copy is done.
            unsafe { self.0.device.cmd_copy_buffer(commands, buffer.handle(), staging, &[region]) };
        })?;
        let mut values = vec![T::zeroed(); count];
        let into: &mut [u8] = bytemuck::cast_slice_mut(&mut values);
        into.copy_from_slice(&bytes[..into.len()]);
        Ok(values)
    }

    /// Level 0 of one layer as `f32`, row by row from the top, with 0 for components the format lacks.
    ///
    /// # Errors
    /// [`Error::Internal`] where there is no such layer.
    pub fn read_image(&self, image: &Image, layer: u32) -> Result<Vec<[f32; 4]>> {
        self.read_image_level(image, layer, 0)
    }

    /// As [`Gpu::read_image`], of any level.
    ///
    /// # Errors
    /// [`Error::Internal`] where there is no such layer or level.
    pub fn read_image_level(&self, image: &Image, layer: u32, level: u32) -> Result<Vec<[f32; 4]>> {
        let region = region(image, layer, level)?;
        let bytes = level_bytes(image, level);
        let bytes = self.download(&format!("reading {}", image.name()), bytes, |commands, staging| {
            let layout = vk::ImageLayout::GENERAL;
            // SAFETY: both are alive until the copy is done, and the staging buffer is large enough.
            unsafe { self.0.device.cmd_copy_image_to_buffer(commands, image.handle(), layout, staging, &[region]) };
        })?;
        Ok(image.format().decode(&bytes))
    }

    fn upload(&self, what: &str, bytes: &[u8], copy: impl FnOnce(vk::CommandBuffer, vk::Buffer)) -> Result<()> {
        with_staging(&self.0, bytes.len() as u64, |staging| {
            let mapped = staging.allocation.mapped_slice_mut().and_then(|mapped| mapped.get_mut(..bytes.len()));
            mapped.ok_or_else(|| Error::Internal("staging memory is not mapped".into()))?.copy_from_slice(bytes);
            encode::immediate(&self.0, what, |commands| copy(commands, staging.handle))
        })
    }

    fn download(&self, what: &str, bytes: u64, copy: impl FnOnce(vk::CommandBuffer, vk::Buffer)) -> Result<Vec<u8>> {
        with_staging(&self.0, bytes, |staging| {
            encode::immediate(&self.0, what, |commands| copy(commands, staging.handle))?;
            let mapped = staging.allocation.mapped_slice().and_then(|mapped| mapped.get(..bytes as usize));
            Ok(mapped.ok_or_else(|| Error::Internal("staging memory is not mapped".into()))?.to_vec())
        })
    }
}

/// Level `image.levels` stands for all of them.
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
    // SAFETY: the image is alive and bound, the range within it.
    let view = unsafe { shared.device.create_image_view(&info, None) }
        .map_err(during(format!("vkCreateImageView for {}", image.name)))?;
    shared.label(view, &image.name);
    Ok(view)
}

fn level_bytes(image: &Image, level: u32) -> u64 {
    let [width, height] = image.level_size(level);
    u64::from(width) * u64::from(height) * image.format().bytes()
}

fn region(image: &Image, layer: u32, level: u32) -> Result<vk::BufferImageCopy> {
    if layer >= image.layers() || level >= image.levels() {
        return Err(Error::Internal(format!("{image:?} has no layer {layer} of level {level}")));
    }
    let part = vk::ImageSubresourceLayers { base_array_layer: layer, layer_count: 1, ..image.layers_of(level) };
    Ok(vk::BufferImageCopy::default().image_subresource(part).image_extent(image.extent(level)))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_format_decodes_to_rgba() {
        let f = |v: &[f32]| bytemuck::cast_slice::<f32, u8>(v).to_vec();
        let u = |v: &[u32]| bytemuck::cast_slice::<u32, u8>(v).to_vec();
        let h: Vec<u8> = [1.0, -2.0, 0.5, 4.0].iter().flat_map(|&x| half::f16::from_f32(x).to_le_bytes()).collect();
        assert_eq!(Format::R32f.decode(&f(&[1.5, 2.0])), [[1.5, 0.0, 0.0, 0.0], [2.0, 0.0, 0.0, 0.0]]);
        assert_eq!(Format::Rg32f.decode(&f(&[1.5, 2.0])), [[1.5, 2.0, 0.0, 0.0]]);
        assert_eq!(Format::Rgba32f.decode(&f(&[1.0, 2.0, 3.0, 4.0])), [[1.0, 2.0, 3.0, 4.0]]);
        assert_eq!(Format::Rgba16f.decode(&h), [[1.0, -2.0, 0.5, 4.0]]);
        assert_eq!(Format::R32u.decode(&u(&[7])), [[7.0, 0.0, 0.0, 0.0]]);
        assert_eq!(Format::Rgba32u.decode(&u(&[1, 2, 3, 4])), [[1.0, 2.0, 3.0, 4.0]]);
    }
}
