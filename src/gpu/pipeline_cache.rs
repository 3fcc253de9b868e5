//! Keeps compiled pipelines on disk, so that a driver need not compile a shader again.
//!
//! Drivers may crash on cache data that is not theirs. So a file is used only if its check sum is right and
//! its header names this device and driver. Any other file is ignored, and replaced when the cache is closed.

use std::{
    fs,
    io::Write,
    path::{Path, PathBuf},
};

use ash::vk;

use super::device::during;
use crate::{Result, temporary::Temporary};

/// A larger cache is deleted. It holds many versions of the shaders.
const LARGEST: usize = 64 << 20;
/// Bytes of the check sum before the driver's own data.
const CHECK: usize = blake3::OUT_LEN;
/// Bytes of `VkPipelineCacheHeaderVersionOne`: length, version, vendor, device, and the driver's identifier.
const HEADER: usize = 16 + vk::UUID_SIZE;

pub(super) struct PipelineCache {
    handle: vk::PipelineCache,
    file: Option<PathBuf>,
    /// What the file held, to tell whether there is anything new.
    loaded: Vec<u8>,
}

impl PipelineCache {
    /// Loads the file in `folder` of this device and driver. Without a folder, nothing is kept on disk.
    pub(super) fn open(
        device: &ash::Device,
        properties: &vk::PhysicalDeviceProperties,
        folder: Option<&Path>,
    ) -> Result<Self> {
        let header = header(properties);
        let name = blake3::hash(&[&header[..], &properties.driver_version.to_le_bytes()].concat()).to_hex();
        let file = folder.map(|folder| folder.join(format!("{}.bin", &name[..16])));
        let loaded = file.as_deref().map_or(Vec::new(), |file| load(file, &header));
        // SAFETY: the data is empty, or this driver wrote it and it is undamaged.
        let handle = unsafe {
            let info = vk::PipelineCacheCreateInfo::default().initial_data(&loaded);
            device.create_pipeline_cache(&info, None).map_err(during("vkCreatePipelineCache"))?
        };
        Ok(Self { handle, file, loaded })
    }

    pub(super) fn handle(&self) -> vk::PipelineCache {
        self.handle
    }

    /// Writes the file if there is something new, and destroys the cache.
    ///
    /// # Safety
    /// The device is alive, and nobody makes pipelines any more.
    pub(super) unsafe fn close(&self, device: &ash::Device) {
        // SAFETY: the caller's promise.
        let data = unsafe { device.get_pipeline_cache_data(self.handle) };
        // SAFETY: as above.
        unsafe { device.destroy_pipeline_cache(self.handle, None) };
        if let (Some(file), Ok(data)) = (&self.file, data)
            && data != self.loaded
            && let Err(error) = if data.len() <= LARGEST { store(file, &data) } else { fs::remove_file(file) }
        {
            tracing::warn!("{}: pipelines are not kept, and are compiled again next time: {error}", file.display());
        }
    }
}

/// The header of a cache of this device and driver.
fn header(properties: &vk::PhysicalDeviceProperties) -> [u8; HEADER] {
    let words = [
        HEADER as u32,
        vk::PipelineCacheHeaderVersion::ONE.as_raw() as u32,
        properties.vendor_id,
        properties.device_id,
    ];
    let mut header = [0; HEADER];
    let (numbers, identifier) = header.split_at_mut(16);
    numbers.copy_from_slice(&words.map(u32::to_le_bytes).concat());
    identifier.copy_from_slice(&properties.pipeline_cache_uuid);
    header
}

/// Returns the driver's data, or nothing if the file is missing, damaged or of another device.
fn load(file: &Path, header: &[u8]) -> Vec<u8> {
    let Ok(content) = fs::read(file) else { return Vec::new() };
    let data = content.split_at_checked(CHECK).filter(|(check, data)| {
        blake3::hash(data).as_bytes() == check && data.starts_with(header) && data.len() <= LARGEST
    });
    match data {
        Some((_, data)) => data.to_vec(),
        None => {
            tracing::debug!("{}: no cache of this device's pipelines, it is ignored", file.display());
            Vec::new()
        }
    }
}

/// Writes the file so that it appears whole or not at all.
fn store(file: &Path, data: &[u8]) -> std::io::Result<()> {
    let folder = file.parent().unwrap_or(Path::new("."));
    fs::create_dir_all(folder)?;
    let mut new = Temporary::new(folder)?;
    new.file()?.write_all(blake3::hash(data).as_bytes())?;
    new.file()?.write_all(data)?;
    new.keep(file)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn only_what_was_written_for_this_device_is_read() {
        let folder = tempfile::tempdir().unwrap();
        let file = folder.path().join("deep").join("cache.bin");
        let header = |device_id| {
            let properties = vk::PhysicalDeviceProperties { vendor_id: 7, device_id, ..Default::default() };
            super::header(&properties)
        };
        assert!(load(&file, &header(1)).is_empty(), "there is no file yet");
        let data = [&header(1)[..], b"pipelines"].concat();
        store(&file, &data).unwrap();
        assert_eq!(load(&file, &header(1)), data);
        assert!(load(&file, &header(2)).is_empty(), "of another device");
        let whole = fs::read(&file).unwrap();
        for length in [0, 10, CHECK, CHECK + 20, whole.len() - 1] {
            fs::write(&file, &whole[..length]).unwrap();
            assert!(load(&file, &header(1)).is_empty(), "cut to {length} bytes");
        }
        for at in [0, CHECK, CHECK + HEADER, whole.len() - 1] {
            let mut damaged = whole.clone();
            damaged[at] ^= 1;
            fs::write(&file, &damaged).unwrap();
            assert!(load(&file, &header(1)).is_empty(), "a bit of byte {at} is wrong");
        }
        store(&file, &data).unwrap();
        assert_eq!(load(&file, &header(1)), data, "replaced by a good one");
    }
}
