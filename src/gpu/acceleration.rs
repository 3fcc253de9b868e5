//! Acceleration structures, which ray queries search (`VK_KHR_acceleration_structure`, `VK_KHR_ray_query`).

use std::{ffi::CStr, fmt, sync::Arc};

use ash::vk;

use super::{
    device::{Gpu, during},
    memory::Buffer,
};
use crate::{Error, Result, gpu_struct};

/// The extensions that ray queries need.
pub(super) const EXTENSIONS: [&CStr; 3] = [
    ash::khr::ray_query::NAME,
    ash::khr::acceleration_structure::NAME,
    ash::khr::deferred_host_operations::NAME, // which the second needs
];

/// What a device of Vulkan 1.3 lacks for ray queries: extensions and features by name.
///
/// # Safety
/// `handle` belongs to `instance`.
pub(super) unsafe fn lacking(instance: &ash::Instance, handle: vk::PhysicalDevice) -> Vec<String> {
    // SAFETY: the caller's promise. The structures of extensions are chained only if the device has them.
    unsafe {
        let offered = instance.enumerate_device_extension_properties(handle).unwrap_or_default();
        let has = |name: &CStr| offered.iter().any(|e| e.extension_name_as_c_str() == Ok(name));
        let missing: Vec<_> = EXTENSIONS.into_iter().filter(|name| !has(name)).collect();
        if !missing.is_empty() {
            return missing.into_iter().map(|name| name.to_string_lossy().into_owned()).collect();
        }
        let mut v12 = vk::PhysicalDeviceVulkan12Features::default();
        let mut structures = vk::PhysicalDeviceAccelerationStructureFeaturesKHR::default();
        let mut queries = vk::PhysicalDeviceRayQueryFeaturesKHR::default();
        let mut features = vk::PhysicalDeviceFeatures2::default()
            .push_next(&mut v12)
            .push_next(&mut structures)
            .push_next(&mut queries);
        instance.get_physical_device_features2(handle, &mut features);
        let needed = [
            (v12.buffer_device_address, "bufferDeviceAddress"),
            (structures.acceleration_structure, "accelerationStructure"),
            (queries.ray_query, "rayQuery"),
        ];
        needed.into_iter().filter(|(has, _)| *has != vk::TRUE).map(|(_, name)| format!("the feature {name}")).collect()
    }
}

/// What a device that has ray queries builds structures by.
pub(super) struct Builder {
    pub functions: ash::khr::acceleration_structure::Device,
    scratch_alignment: u64,
}

impl Builder {
    /// # Safety
    /// The device belongs to `handle` and has the extensions.
    pub(super) unsafe fn new(instance: &ash::Instance, handle: vk::PhysicalDevice, device: &ash::Device) -> Self {
        let mut limits = vk::PhysicalDeviceAccelerationStructurePropertiesKHR::default();
        let mut properties = vk::PhysicalDeviceProperties2::default().push_next(&mut limits);
        // SAFETY: the caller's promise.
        unsafe { instance.get_physical_device_properties2(handle, &mut properties) };
        Self {
            functions: ash::khr::acceleration_structure::Device::new(instance, device),
            scratch_alignment: u64::from(limits.min_acceleration_structure_scratch_offset_alignment).max(1),
        }
    }
}

gpu_struct! {
    /// A structure of triangles as a structure of instances places it.
    pub struct Placed {
        /// Rows of the affine matrix from its own space.
        pub transform: [[f32; 4]; 3],
        /// What queries tell of it, 24 bits, and which rays see it, 8 bits.
        pub index_and_mask: u32,
        pub offset_and_flags: u32,
        /// [`Acceleration::address`].
        pub structure: u64,
    }
}

impl Placed {
    /// Places a structure of triangles where all rays see it. Queries tell `index`, of which 24 bits are kept.
    pub fn new(transform: [[f32; 4]; 3], index: u32, structure: &Acceleration) -> Self {
        Self {
            transform,
            index_and_mask: index & 0xff_ffff | 0xff << 24,
            offset_and_flags: 0,
            structure: structure.address(),
        }
    }
}

/// Bytes of a triangle to build of: three corners of three 32-bit floats.
const TRIANGLE: u64 = 36;

/// What ray queries search: a structure of opaque triangles, or of placed structures. A clone is the same structure.
/// It holds nothing before [`Frame::build`](super::Frame::build).
#[derive(Clone)]
pub struct Acceleration(Arc<AccelerationData>);

struct AccelerationData {
    gpu: Gpu,
    handle: vk::AccelerationStructureKHR,
    storage: Buffer,
    address: u64,
    scratch_bytes: u64,
    most: u32,
    /// The structures that it places. `None` if it is of triangles.
    places: Option<Vec<Acceleration>>,
}

impl Acceleration {
    /// Its name in messages.
    pub fn name(&self) -> &str {
        self.0.storage.name()
    }

    /// Where it is on the device.
    pub fn address(&self) -> u64 {
        self.0.address
    }

    /// Bytes of scratch memory that building it takes.
    pub fn scratch_bytes(&self) -> u64 {
        self.0.scratch_bytes
    }

    pub(super) fn handle(&self) -> vk::AccelerationStructureKHR {
        self.0.handle
    }

    pub(super) fn id(&self) -> u64 {
        self.0.storage.id()
    }

    /// The structures that it places.
    pub(super) fn places(&self) -> &[Self] {
        self.0.places.as_deref().unwrap_or_default()
    }

    /// Says what is wrong with building it of the items `first` to `first + count` of a buffer.
    pub(super) fn check(
        &self,
        items: &Buffer,
        [first, count]: [u32; 2],
        scratch: &Buffer,
    ) -> std::result::Result<(), String> {
        let (most, size) = (self.0.most, self.item_bytes());
        if count > most {
            return Err(format!("{} has room for {most} items, not {count}", self.name()));
        }
        if (u64::from(first) + u64::from(count)) * size > items.bytes() {
            return Err(format!("{items:?} does not hold {count} items from {first} on"));
        }
        if scratch.bytes() < self.0.scratch_bytes {
            return Err(format!("{scratch:?} is too small for {}", self.name()));
        }
        Ok(())
    }

    fn item_bytes(&self) -> u64 {
        if self.0.places.is_some() { size_of::<Placed>() as u64 } else { TRIANGLE }
    }

    /// Records the build.
    ///
    /// # Safety
    /// The command buffer is recording, the buffers outlive it, and [`Acceleration::check`] has no complaint.
    pub(super) unsafe fn record(
        &self,
        commands: vk::CommandBuffer,
        items: &Buffer,
        [first, count]: [u32; 2],
        scratch: &Buffer,
    ) {
        let Some(builder) = &self.0.gpu.0.builder else { return };
        let address = scratch.address().next_multiple_of(builder.scratch_alignment);
        let geometry = [geometry(self.0.places.is_some(), items.address(), self.0.most)];
        let info = build_info(self.0.places.is_some(), &geometry)
            .dst_acceleration_structure(self.0.handle)
            .scratch_data(vk::DeviceOrHostAddressKHR { device_address: address });
        let range = vk::AccelerationStructureBuildRangeInfoKHR::default()
            .primitive_count(count)
            .primitive_offset(first * self.item_bytes() as u32);
        // SAFETY: the caller's promise.
        unsafe { builder.functions.cmd_build_acceleration_structures(commands, &[info], &[&[range]]) };
    }
}

impl fmt::Debug for Acceleration {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "Acceleration({}, at most {} items)", self.name(), self.0.most)
    }
}

impl Drop for AccelerationData {
    fn drop(&mut self) {
        if let Some(builder) = self.gpu.0.builder.as_ref().filter(|_| self.gpu.0.may_free()) {
            // SAFETY: frames that use the structure hold it, and the last holder is gone.
            unsafe { builder.functions.destroy_acceleration_structure(self.handle, None) };
        }
    }
}

fn geometry(places: bool, address: u64, triangles: u32) -> vk::AccelerationStructureGeometryKHR<'static> {
    let data = vk::DeviceOrHostAddressConstKHR { device_address: address };
    let (kind, geometry) = if places {
        let instances = vk::AccelerationStructureGeometryInstancesDataKHR::default().data(data);
        (vk::GeometryTypeKHR::INSTANCES, vk::AccelerationStructureGeometryDataKHR { instances })
    } else {
        let triangles = vk::AccelerationStructureGeometryTrianglesDataKHR::default()
            .vertex_format(vk::Format::R32G32B32_SFLOAT)
            .vertex_data(data)
            .vertex_stride(TRIANGLE / 3)
            .max_vertex((3 * triangles).saturating_sub(1))
            .index_type(vk::IndexType::NONE_KHR);
        (vk::GeometryTypeKHR::TRIANGLES, vk::AccelerationStructureGeometryDataKHR { triangles })
    };
    let opaque = vk::GeometryFlagsKHR::OPAQUE;
    vk::AccelerationStructureGeometryKHR::default().geometry_type(kind).geometry(geometry).flags(opaque)
}

fn build_info<'a>(
    places: bool,
    geometry: &'a [vk::AccelerationStructureGeometryKHR<'a>; 1],
) -> vk::AccelerationStructureBuildGeometryInfoKHR<'a> {
    vk::AccelerationStructureBuildGeometryInfoKHR::default()
        .ty(kind(places))
        .flags(vk::BuildAccelerationStructureFlagsKHR::PREFER_FAST_TRACE)
        .mode(vk::BuildAccelerationStructureModeKHR::BUILD)
        .geometries(geometry)
}

fn kind(places: bool) -> vk::AccelerationStructureTypeKHR {
    let [top, bottom] = [vk::AccelerationStructureTypeKHR::TOP_LEVEL, vk::AccelerationStructureTypeKHR::BOTTOM_LEVEL];
    if places { top } else { bottom }
}

impl Gpu {
    /// Says whether shaders can make ray queries.
    ///
    /// # Errors
    /// Fails with [`Error::Input`] if the device lacks an extension or a feature. The error names what it lacks, after
    /// `subject`, which asks for ray queries, and before `remedy`.
    pub fn require_ray_queries(&self, subject: &str, remedy: &str) -> Result<()> {
        if self.0.builder.is_some() {
            return Ok(());
        }
        let lacks = self.0.lacks_for_ray_queries.join(", ");
        Err(Error::input(subject, format!("{} has no ray queries: it lacks {lacks}", self.device_name()), remedy))
    }

    /// Makes a structure of `count` triangles. They are built of three corners each, of three `f32`.
    ///
    /// # Errors
    /// Fails with [`Error::Internal`] if the device has no ray queries, and with [`Error::Input`] if it lacks memory.
    pub fn triangles(&self, name: &str, count: u32) -> Result<Acceleration> {
        self.acceleration(name, count, None)
    }

    /// Makes a structure of at most `most` [`Placed`] structures, all of them among `places`.
    ///
    /// # Errors
    /// Fails as [`Gpu::triangles`] does.
    pub fn instances(&self, name: &str, most: u32, places: Vec<Acceleration>) -> Result<Acceleration> {
        self.acceleration(name, most, Some(places))
    }

    /// Makes a zeroed buffer that structures are built of.
    ///
    /// # Errors
    /// Fails as [`Gpu::buffer`] does.
    pub fn build_input(&self, name: &str, bytes: u64) -> Result<Buffer> {
        self.addressed(name, bytes, vk::BufferUsageFlags::ACCELERATION_STRUCTURE_BUILD_INPUT_READ_ONLY_KHR)
    }

    /// Makes a buffer in which a structure can be built that takes so many bytes for it.
    ///
    /// # Errors
    /// Fails as [`Gpu::buffer`] does.
    pub fn build_scratch(&self, bytes: u64) -> Result<Buffer> {
        let alignment = self.0.builder.as_ref().map_or(1, |builder| builder.scratch_alignment);
        self.addressed("build scratch", bytes + alignment, vk::BufferUsageFlags::empty())
    }

    fn acceleration(&self, name: &str, most: u32, places: Option<Vec<Acceleration>>) -> Result<Acceleration> {
        let Some(builder) = &self.0.builder else {
            return Err(Error::Internal(format!("{name}: the device has no ray queries")));
        };
        let geometry = [geometry(places.is_some(), 0, most)];
        let info = build_info(places.is_some(), &geometry);
        let mut sizes = vk::AccelerationStructureBuildSizesInfoKHR::default();
        let device_build = vk::AccelerationStructureBuildTypeKHR::DEVICE;
        // SAFETY: the info describes what `record` will build.
        unsafe { builder.functions.get_acceleration_structure_build_sizes(device_build, &info, &[most], &mut sizes) };
        let usage = vk::BufferUsageFlags::ACCELERATION_STRUCTURE_STORAGE_KHR;
        let storage = self.addressed(name, sizes.acceleration_structure_size, usage)?;
        let info = vk::AccelerationStructureCreateInfoKHR::default()
            .buffer(storage.handle())
            .size(sizes.acceleration_structure_size)
            .ty(kind(places.is_some()));
        // SAFETY: the buffer is large enough, and lives as long as the structure.
        let (handle, address) = unsafe {
            let made = builder.functions.create_acceleration_structure(&info, None);
            let handle = made.map_err(during(format!("vkCreateAccelerationStructureKHR for {name}")))?;
            let info = vk::AccelerationStructureDeviceAddressInfoKHR::default().acceleration_structure(handle);
            (handle, builder.functions.get_acceleration_structure_device_address(&info))
        };
        self.0.label(handle, name);
        let scratch_bytes = sizes.build_scratch_size;
        let gpu = self.clone();
        Ok(Acceleration(Arc::new(AccelerationData { gpu, handle, storage, address, scratch_bytes, most, places })))
    }
}

#[cfg(all(test, debug_assertions))] // sources of all shaders are known in debug builds
mod tests {
    use crate::shaders;
    use rspirv::spirv::{Capability, Op};

    #[test]
    fn shaders_with_ray_queries_are_modules_of_their_own() {
        let capability = [2 << 16 | Op::Capability as u32, Capability::RayQueryKHR as u32];
        let of = |suffix: bool| shaders::SOURCES.iter().filter(move |(name, _)| name.contains("+ray_query") == suffix);
        let queries = |spirv: &[u32]| spirv.windows(2).any(|words| words == capability);
        assert!(of(false).count() > 20 && of(false).all(|(_, spirv)| !queries(spirv)));
        assert!(of(true).count() >= 4 && of(true).all(|(_, spirv)| queries(spirv)));
    }
}
