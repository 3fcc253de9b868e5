//! Copies data to and from buffers and images, through host memory.

use ash::vk;
use bytemuck::Pod;
use gpu_allocator::{MemoryLocation, vulkan as memory};

use super::{
    device::{Gpu, Shared},
    encode,
    memory::{Buffer, Format, Image, raw_buffer},
    slot::KEPT_STAGING,
};
use crate::{Error, Result};

/// Host memory that the device copies from and to. The allocator gives only coherent memory for it, which
/// Vulkan guarantees to exist, so nothing needs to be flushed.
pub(super) struct Staging {
    handle: vk::Buffer,
    allocation: memory::Allocation,
    bytes: u64,
    used: u64,
}

/// A multiple of every texel's size.
const STAGING_ALIGNMENT: u64 = 16;

impl Staging {
    pub(super) fn new(shared: &Shared, bytes: u64) -> Result<Self> {
        let usage = vk::BufferUsageFlags::TRANSFER_SRC | vk::BufferUsageFlags::TRANSFER_DST;
        let (handle, allocation) = raw_buffer(shared, "staging", bytes, usage, MemoryLocation::GpuToCpu)?;
        let coherent = allocation.memory_properties().contains(vk::MemoryPropertyFlags::HOST_COHERENT);
        let staging = Self { handle, allocation, bytes, used: 0 };
        if coherent && staging.allocation.mapped_slice().is_some() {
            return Ok(staging);
        }
        staging.destroy(shared);
        Err(Error::Internal("staging memory is not mapped coherently".into()))
    }

    pub(super) fn bytes(&self) -> u64 {
        self.bytes
    }

    /// Appends `data`. Returns nothing if there is no room.
    pub(super) fn append(&mut self, data: &[u8]) -> Option<(vk::Buffer, u64)> {
        let start = self.used.next_multiple_of(STAGING_ALIGNMENT);
        let end = start.checked_add(data.len() as u64).filter(|end| *end <= self.bytes)?;
        self.allocation.mapped_slice_mut()?.get_mut(start as usize..end as usize)?.copy_from_slice(data);
        self.used = end;
        Some((self.handle, start))
    }

    pub(super) fn emptied(self) -> Self {
        Self { used: 0, ..self }
    }

    /// Frees the memory, which the device must not use any more.
    pub(super) fn destroy(self, shared: &Shared) {
        if !shared.may_free() {
            std::mem::forget(self.allocation);
            return;
        }
        // SAFETY: whoever holds the slot has waited for the device.
        unsafe { shared.device.destroy_buffer(self.handle, None) };
        shared.free(self.allocation);
    }
}

impl Gpu {
    /// Writes `data` to a buffer from `offset` bytes on, and waits until it is there.
    ///
    /// # Errors
    /// Fails as [`Frame::write_buffer`](super::Frame::write_buffer) does.
    pub fn write_buffer<T: Pod>(&self, buffer: &Buffer, offset: u64, data: &[T]) -> Result<()> {
        let mut frame = self.frame()?;
        frame.write_buffer(buffer, offset, data)?;
        frame.run().map(drop)
    }

    /// Writes one layer of one level as tightly packed rows in its format, and waits until it is there.
    ///
    /// # Errors
    /// Fails as [`Frame::write_image`](super::Frame::write_image) does.
    pub fn write_image<T: Pod>(&self, image: &Image, layer: u32, level: u32, data: &[T]) -> Result<()> {
        let mut frame = self.frame()?;
        frame.write_image(image, layer, level, data)?;
        frame.run().map(drop)
    }

    /// Reads the whole buffer as `T`s. Leaves out bytes at the end that do not fill one.
    ///
    /// # Errors
    /// Fails with [`Error::Vulkan`] if the copy fails.
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

    /// Reads level 0 of one layer, row by row from the top. Components that the format lacks are 0.
    ///
    /// # Errors
    /// Fails with [`Error::Internal`] if there is no such layer.
    pub fn read_image(&self, image: &Image, layer: u32) -> Result<Vec<[f32; 4]>> {
        self.read_image_level(image, layer, 0)
    }

    /// Reads one layer of any level, as [`Gpu::read_image`] does.
    ///
    /// # Errors
    /// Fails with [`Error::Internal`] if there is no such layer or level.
    pub fn read_image_level(&self, image: &Image, layer: u32, level: u32) -> Result<Vec<[f32; 4]>> {
        Ok(decode(image.format(), &self.read_bytes(image, layer, level)?))
    }

    /// Reads one layer as the 16-bit numbers that its texels of four 32-bit words hold, two in each word.
    ///
    /// # Errors
    /// Fails with [`Error::Internal`] if there is no such layer or the texels have another size.
    pub fn read_pairs(&self, image: &Image, layer: u32) -> Result<Vec<[u16; 8]>> {
        if image.format() != Format::Rgba32u {
            return Err(Error::Internal(format!("{image:?} holds no pairs of numbers")));
        }
        let number = |texel: &[u8], i: usize| u16::from_le_bytes([texel[2 * i], texel[2 * i + 1]]);
        let bytes = self.read_bytes(image, layer, 0)?;
        Ok(bytes.chunks_exact(16).map(|texel| std::array::from_fn(|i| number(texel, i))).collect())
    }

    /// Reads one layer of 32-bit words.
    ///
    /// # Errors
    /// Fails with [`Error::Internal`] if there is no such layer or the texels have another size.
    pub fn read_words(&self, image: &Image, layer: u32) -> Result<Vec<u32>> {
        if image.format() != Format::R32u {
            return Err(Error::Internal(format!("{image:?} holds no words")));
        }
        Ok(self
            .read_bytes(image, layer, 0)?
            .chunks_exact(4)
            .map(|b| u32::from_le_bytes([b[0], b[1], b[2], b[3]]))
            .collect())
    }

    fn read_bytes(&self, image: &Image, layer: u32, level: u32) -> Result<Vec<u8>> {
        let region = region(image, layer, level)?;
        let bytes = level_bytes(image, level);
        self.download(&format!("reading {}", image.name()), bytes, |commands, staging| {
            let layout = vk::ImageLayout::GENERAL;
            // SAFETY: both are alive until the copy is done, and the staging buffer is large enough.
            unsafe { self.0.device.cmd_copy_image_to_buffer(commands, image.handle(), layout, staging, &[region]) };
        })
    }

    fn download(&self, what: &str, bytes: u64, copy: impl FnOnce(vk::CommandBuffer, vk::Buffer)) -> Result<Vec<u8>> {
        let shared = &self.0;
        let mut kept = shared.staging();
        let staging = match kept.take() {
            Some(staging) if staging.bytes >= bytes => staging,
            small => {
                if let Some(small) = small {
                    small.destroy(shared);
                }
                Staging::new(shared, bytes)?
            }
        };
        if let Err(error) = encode::immediate(shared, what, |commands| copy(commands, staging.handle)) {
            staging.destroy(shared);
            return Err(error);
        }
        let mapped = staging.allocation.mapped_slice().and_then(|mapped| mapped.get(..bytes as usize));
        let copied = mapped.map(<[u8]>::to_vec);
        if staging.bytes <= KEPT_STAGING {
            *kept = Some(staging);
        } else {
            staging.destroy(shared);
        }
        copied.ok_or_else(|| Error::Internal("staging memory is not mapped".into()))
    }
}

pub(super) fn level_bytes(image: &Image, level: u32) -> u64 {
    let [width, height] = image.level_size(level);
    u64::from(width) * u64::from(height) * image.format().bytes()
}

/// The region of one layer of one level.
///
/// # Errors
/// Fails with [`Error::Internal`] if there is no such layer or level.
pub(super) fn region(image: &Image, layer: u32, level: u32) -> Result<vk::BufferImageCopy> {
    if layer >= image.layers() || level >= image.levels() {
        return Err(Error::Internal(format!("{image:?} has no layer {layer} of level {level}")));
    }
    let part = vk::ImageSubresourceLayers { base_array_layer: layer, layer_count: 1, ..image.layers_of(level) };
    Ok(vk::BufferImageCopy::default().image_subresource(part).image_extent(image.extent(level)))
}

/// Converts texels to `f32`. Components that the format lacks are 0, and integers above 2²⁴ are rounded.
fn decode(format: Format, bytes: &[u8]) -> Vec<[f32; 4]> {
    let words = || bytes.chunks_exact(4).map(|b| [b[0], b[1], b[2], b[3]]);
    let halves = || bytes.chunks_exact(2).map(|b| half::f16::from_le_bytes([b[0], b[1]]).to_f32());
    let pack = |channels: usize, values: Vec<f32>| {
        let texel = |chunk: &[f32]| std::array::from_fn(|i| chunk.get(i).copied().unwrap_or(0.0));
        values.chunks_exact(channels).map(texel).collect()
    };
    match format {
        Format::R32f => pack(1, words().map(f32::from_le_bytes).collect()),
        Format::Rg32f => pack(2, words().map(f32::from_le_bytes).collect()),
        Format::Rgba32f => pack(4, words().map(f32::from_le_bytes).collect()),
        Format::Rgba8 => pack(4, bytes.iter().map(|&code| f32::from(code) / 255.0).collect()),
        Format::R8Snorm => pack(1, bytes.iter().map(|&code| f32::from(code as i8)).collect()),
        Format::R16f => pack(1, halves().collect()),
        Format::Rg16f => pack(2, halves().collect()),
        Format::Rgba16f => pack(4, halves().collect()),
        Format::Rg32u => pack(2, words().map(|b| u32::from_le_bytes(b) as f32).collect()),
        Format::R32u => pack(1, words().map(|b| u32::from_le_bytes(b) as f32).collect()),
        Format::Rgba32u => pack(4, words().map(|b| u32::from_le_bytes(b) as f32).collect()),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_format_decodes_to_rgba() {
        let f = |v: &[f32]| bytemuck::cast_slice::<f32, u8>(v).to_vec();
        let u = |v: &[u32]| bytemuck::cast_slice::<u32, u8>(v).to_vec();
        let h: Vec<u8> = [1.0, -2.0, 0.5, 4.0].iter().flat_map(|&x| half::f16::from_f32(x).to_le_bytes()).collect();
        assert_eq!(decode(Format::R32f, &f(&[1.5, 2.0])), [[1.5, 0.0, 0.0, 0.0], [2.0, 0.0, 0.0, 0.0]]);
        assert_eq!(decode(Format::Rg32f, &f(&[1.5, 2.0])), [[1.5, 2.0, 0.0, 0.0]]);
        assert_eq!(decode(Format::Rgba32f, &f(&[1.0, 2.0, 3.0, 4.0])), [[1.0, 2.0, 3.0, 4.0]]);
        assert_eq!(decode(Format::Rgba16f, &h), [[1.0, -2.0, 0.5, 4.0]]);
        assert_eq!(decode(Format::R8Snorm, &[3, 255]), [[3.0, 0.0, 0.0, 0.0], [-1.0, 0.0, 0.0, 0.0]]);
        assert_eq!(decode(Format::R16f, &h[..2]), [[1.0, 0.0, 0.0, 0.0]]);
        assert_eq!(decode(Format::Rgba8, &[255, 0, 51, 255]), [[1.0, 0.0, 0.2, 1.0]]);
        assert_eq!(decode(Format::R32u, &u(&[7])), [[7.0, 0.0, 0.0, 0.0]]);
        assert_eq!(decode(Format::Rg32u, &u(&[7, 8])), [[7.0, 8.0, 0.0, 0.0]]);
        assert_eq!(decode(Format::Rgba32u, &u(&[1, 2, 3, 4])), [[1.0, 2.0, 3.0, 4.0]]);
    }
}
