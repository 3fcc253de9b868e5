//! One Vulkan device and its compute queue.

use std::{
    collections::HashMap,
    ffi::{CString, c_char},
    path::{Path, PathBuf},
    sync::{
        Arc, Mutex, MutexGuard, PoisonError, Weak,
        atomic::{AtomicBool, AtomicU64, Ordering},
    },
};

use ash::vk::{self, Handle};
use gpu_allocator::{AllocationSizes, AllocatorDebugSettings, vulkan as memory};

use super::{
    acceleration::{self, Builder},
    adapter,
    memory::Format,
    pass::{Making, PassData, PassKey},
    pipeline_cache::PipelineCache,
    slot::Slot,
    timing::Clock,
    transfer::Staging,
    validation::{self, Log},
};
use crate::{Error, Result, budget};

/// Which device to open, and how closely to check what is done with it.
#[derive(Clone, Debug, Default)]
pub struct GpuOptions {
    /// An index in Vulkan's enumeration or a part of a name. `None` chooses one of the fastest kind.
    pub device: Option<String>,
    /// Runs under the validation layer, with synchronization checks.
    pub validation: bool,
    /// The folder that keeps pipelines between runs. `None` keeps them nowhere.
    pub pipeline_cache: Option<PathBuf>,
}

/// A Vulkan 1.3 device with one compute queue. Clones are cheap. Whatever is made from it keeps it alive.
#[derive(Clone)]
pub struct Gpu(pub(super) Arc<Shared>, pub(super) Making);

pub(super) struct Shared {
    pub device: ash::Device,
    pub debug: Option<ash::ext::debug_utils::Device>,
    pub limits: vk::PhysicalDeviceLimits,
    pub max_buffer_bytes: u64,
    /// Present if the device has ray queries.
    pub builder: Option<Builder>,
    pub lacks_for_ray_queries: Vec<String>,
    pub clock: Clock,
    pub samplers: [vk::Sampler; 2], // linear, nearest
    pub pipeline_cache: PipelineCache,
    pub linear_filter: [bool; Format::ALL.len()],
    pub storage: [bool; Format::ALL.len()],
    pub live_bytes: AtomicU64,
    pub next_id: AtomicU64,
    /// Whether a wait has failed, so that the device may be using anything.
    stuck: AtomicBool,
    allocator: Mutex<Option<memory::Allocator>>,
    slots: Mutex<Vec<Slot>>,
    staging: Mutex<Option<Staging>>,
    /// The living pipelines, so that renderers of one device share them.
    pub passes: Mutex<HashMap<PassKey, Weak<PassData>>>,
    queue: Mutex<vk::Queue>,
    pub queue_family: u32,
    #[cfg_attr(not(feature = "viewer"), expect(dead_code, reason = "windows alone read it"))]
    pub physical: vk::PhysicalDevice,
    name: String,
    driver: String,
    messenger: Option<(ash::ext::debug_utils::Instance, vk::DebugUtilsMessengerEXT)>,
    pub instance: ash::Instance,
    log: Arc<Log>,
    pub entry: ash::Entry,
}

/// Whether a device of this process was given up.
static STUCK: AtomicBool = AtomicBool::new(false);

/// Says whether a device could not be waited for. A driver may then be at work until the process is gone, and
/// crash if it is unloaded, so the process must end without that.
pub fn left_running() -> bool {
    STUCK.load(Ordering::Relaxed)
}

/// Turns a failed call into an [`Error::Vulkan`] that says what was being done.
pub(super) fn during(what: impl Into<String>) -> impl FnOnce(vk::Result) -> Error {
    move |result| Error::Vulkan { during: what.into(), result }
}

/// The error of a device that cannot do what is asked of it.
pub(super) fn unfit(device: &str, problem: &str) -> Error {
    Error::NoDevice {
        problem: format!("{device}: {problem}"),
        remedy: "choose another device (see `iprt devices`)".into(),
    }
}

pub(super) fn lock<T>(mutex: &Mutex<T>) -> MutexGuard<'_, T> {
    mutex.lock().unwrap_or_else(PoisonError::into_inner)
}

impl Gpu {
    /// Opens a device.
    ///
    /// # Errors
    /// Fails with [`Error::NoDevice`] if there is no loader, no driver or no usable device, or if validation
    /// was asked for and its layer is missing.
    pub fn new(options: &GpuOptions) -> Result<Self> {
        Self::open(options, None)
    }

    /// Opens a device. `windows` are the instance extensions that windows need.
    pub(super) fn open(options: &GpuOptions, windows: Option<&[*const c_char]>) -> Result<Self> {
        let entry = adapter::load()?;
        let log = Arc::new(Log::default());
        let (instance, labels) = adapter::instance(&entry, options.validation, &log, windows)?;
        // From here on, every path destroys the instance.
        match open(&entry, &instance, labels, options, &log, windows.is_some()) {
            Ok(parts) => Ok(Self(Arc::new(parts.share(entry, instance, log)), Making::default())),
            Err(error) => {
                // SAFETY: `open` has destroyed all that it made from the instance.
                unsafe { instance.destroy_instance(None) };
                Err(error)
            }
        }
    }

    /// The device's name.
    pub fn device_name(&self) -> &str {
        &self.0.name
    }

    /// The driver and its version, in words.
    pub fn driver(&self) -> &str {
        &self.0.driver
    }

    /// Bytes of device memory held by living buffers and images.
    pub fn device_bytes(&self) -> u64 {
        self.0.live_bytes.load(Ordering::Relaxed)
    }

    /// The greatest number of workgroups in one dispatch, along each axis.
    pub fn max_groups(&self) -> [u32; 3] {
        self.0.limits.max_compute_work_group_count
    }

    /// Every validation message so far. Empty without validation.
    pub fn validation_messages(&self) -> Vec<String> {
        self.0.log.messages()
    }

    /// Destroys the device and the instance. Returns every validation message, including those of the
    /// teardown, which name objects that leaked.
    ///
    /// # Errors
    /// Fails with [`Error::Internal`] if a buffer, image, pass, frame or clone still holds the device.
    pub fn destroy(self) -> Result<Vec<String>> {
        let log = Arc::clone(&self.0.log);
        let Self(shared, making) = self;
        drop(making);
        match Arc::try_unwrap(shared) {
            Ok(shared) => drop(shared),
            Err(shared) => {
                let holders = Arc::strong_count(&shared) - 1;
                return Err(Error::Internal(format!(
                    "{holders} objects still hold the device that is to be destroyed"
                )));
            }
        }
        Ok(log.messages())
    }

    /// Makes a fence and forgets it. A test checks that the leak is noticed.
    #[doc(hidden)]
    pub fn leak_for_test(&self) -> Result<()> {
        // SAFETY: this call only creates a fence. The caller asks for the leak.
        unsafe { self.0.device.create_fence(&vk::FenceCreateInfo::default(), None) }
            .map(|_| ())
            .map_err(during("vkCreateFence"))
    }
}

/// What [`open`] makes.
struct Parts {
    chosen: adapter::FoundAdapter,
    device: ash::Device,
    debug: Option<ash::ext::debug_utils::Device>,
    messenger: Option<(ash::ext::debug_utils::Instance, vk::DebugUtilsMessengerEXT)>,
    allocator: memory::Allocator,
    samplers: [vk::Sampler; 2],
    pipeline_cache: PipelineCache,
}

fn open(
    entry: &ash::Entry,
    instance: &ash::Instance,
    labels: bool,
    options: &GpuOptions,
    log: &Log,
    windows: bool,
) -> Result<Parts> {
    let mut candidates = adapter::candidates(instance)?;
    let adapters: Vec<_> = candidates.iter().map(|c| c.adapter.clone()).collect();
    let chosen = candidates.swap_remove(adapter::choose(&adapters, options.device.as_deref())?);
    if windows && !chosen.draws {
        return Err(unfit(&chosen.adapter.name, "it cannot draw, and a window needs that"));
    }
    // SAFETY: the chosen device has the features and the queue family that are asked for. On failure, what
    // was made is destroyed in reverse order.
    unsafe {
        let priorities = [1.0];
        let queues = [vk::DeviceQueueCreateInfo::default()
            .queue_family_index(chosen.queue_family)
            .queue_priorities(&priorities)];
        let features = vk::PhysicalDeviceFeatures::default().shader_storage_image_extended_formats(true);
        let ray_queries = chosen.lacks_for_ray_queries.is_empty();
        let mut v12 = vk::PhysicalDeviceVulkan12Features::default()
            .scalar_block_layout(true)
            .host_query_reset(true)
            .buffer_device_address(ray_queries);
        let mut v13 = vk::PhysicalDeviceVulkan13Features::default().synchronization2(true).maintenance4(true);
        v13 = v13.dynamic_rendering(windows); // every Vulkan 1.3 device has it
        let (mut structures, mut queries) = (
            vk::PhysicalDeviceAccelerationStructureFeaturesKHR::default().acceleration_structure(true),
            vk::PhysicalDeviceRayQueryFeaturesKHR::default().ray_query(true),
        );
        let mut extensions = Vec::new();
        extensions.extend(windows.then(|| ash::khr::swapchain::NAME.as_ptr()));
        extensions.extend(acceleration::EXTENSIONS.iter().filter(|_| ray_queries).map(|name| name.as_ptr()));
        let mut info = vk::DeviceCreateInfo::default()
            .enabled_extension_names(&extensions)
            .queue_create_infos(&queues)
            .enabled_features(&features)
            .push_next(&mut v12)
            .push_next(&mut v13);
        if ray_queries {
            info = info.push_next(&mut structures).push_next(&mut queries);
        }
        let device = instance
            .create_device(chosen.handle, &info, None)
            .map_err(|result| unfit(&chosen.adapter.name, &format!("vkCreateDevice: {result:?}")))?;
        let allocator = memory::Allocator::new(&memory::AllocatorCreateDesc {
            instance: instance.clone(),
            device: device.clone(),
            physical_device: chosen.handle,
            debug_settings: AllocatorDebugSettings::default(),
            buffer_device_address: ray_queries,
            allocation_sizes: AllocationSizes::new(16 << 20, 16 << 20).with_max_device_memblock_size(256 << 20),
        });
        let allocator = match allocator {
            Ok(allocator) => allocator,
            Err(error) => {
                device.destroy_device(None);
                return Err(Error::Internal(format!("the memory allocator: {error}")));
            }
        };
        let samplers = match samplers(&device) {
            Ok(samplers) => samplers,
            Err(error) => {
                drop(allocator);
                device.destroy_device(None);
                return Err(error);
            }
        };
        let folder = options.pipeline_cache.as_deref();
        let pipeline_cache = match pipeline_cache(instance, &device, chosen.handle, folder) {
            Ok(cache) => cache,
            Err(error) => {
                samplers.into_iter().for_each(|s| device.destroy_sampler(s, None));
                drop(allocator);
                device.destroy_device(None);
                return Err(error);
            }
        };
        let messenger = if options.validation {
            let debug = ash::ext::debug_utils::Instance::new(entry, instance);
            // Without a messenger there would be no messages, so a failure counts like a missing layer.
            match debug.create_debug_utils_messenger(&validation::messenger(log), None) {
                Ok(messenger) => Some((debug, messenger)),
                Err(result) => {
                    pipeline_cache.close(&device);
                    samplers.into_iter().for_each(|s| device.destroy_sampler(s, None));
                    drop(allocator);
                    device.destroy_device(None);
                    return Err(during("vkCreateDebugUtilsMessengerEXT")(result));
                }
            }
        } else {
            None
        };
        let debug = labels.then(|| ash::ext::debug_utils::Device::new(instance, &device));
        Ok(Parts { chosen, device, debug, messenger, allocator, samplers, pipeline_cache })
    }
}

fn pipeline_cache(
    instance: &ash::Instance,
    device: &ash::Device,
    physical: vk::PhysicalDevice,
    folder: Option<&Path>,
) -> Result<PipelineCache> {
    // SAFETY: the physical device belongs to `instance`.
    let properties = unsafe { instance.get_physical_device_properties(physical) };
    PipelineCache::open(device, &properties, folder)
}

/// Makes a linear and a nearest sampler. Both wrap around the panorama and are clamped at its poles.
fn samplers(device: &ash::Device) -> Result<[vk::Sampler; 2]> {
    let info = |filter, mipmap_mode| {
        vk::SamplerCreateInfo::default()
            .mag_filter(filter)
            .min_filter(filter)
            .mipmap_mode(mipmap_mode)
            .address_mode_u(vk::SamplerAddressMode::REPEAT)
            .address_mode_v(vk::SamplerAddressMode::CLAMP_TO_EDGE)
            .address_mode_w(vk::SamplerAddressMode::CLAMP_TO_EDGE)
            .max_lod(vk::LOD_CLAMP_NONE)
    };
    // SAFETY: the create infos are valid. The first sampler is destroyed if the second cannot be made.
    unsafe {
        let linear = device
            .create_sampler(&info(vk::Filter::LINEAR, vk::SamplerMipmapMode::LINEAR), None)
            .map_err(during("vkCreateSampler"))?;
        match device.create_sampler(&info(vk::Filter::NEAREST, vk::SamplerMipmapMode::NEAREST), None) {
            Ok(nearest) => Ok([linear, nearest]),
            Err(result) => {
                device.destroy_sampler(linear, None);
                Err(during("vkCreateSampler")(result))
            }
        }
    }
}

impl Parts {
    fn share(self, entry: ash::Entry, instance: ash::Instance, log: Arc<Log>) -> Shared {
        let handle = self.chosen.handle;
        let mut v11 = vk::PhysicalDeviceVulkan11Properties::default();
        let mut v13 = vk::PhysicalDeviceVulkan13Properties::default();
        let mut properties = vk::PhysicalDeviceProperties2::default().push_next(&mut v11).push_next(&mut v13);
        // SAFETY: the physical device belongs to `instance`, and the device was created with this queue.
        let (limits, features, queue) = unsafe {
            instance.get_physical_device_properties2(handle, &mut properties);
            let limits = properties.properties.limits;
            let features = Format::ALL.map(|format| {
                instance.get_physical_device_format_properties(handle, format.vulkan()).optimal_tiling_features
            });
            (limits, features, self.device.get_device_queue(self.chosen.queue_family, 0))
        };
        // SAFETY: the physical device belongs to `instance`.
        let heaps = unsafe { instance.get_physical_device_memory_properties(handle) };
        let local =
            heaps.memory_heaps_as_slice().iter().filter(|heap| heap.flags.contains(vk::MemoryHeapFlags::DEVICE_LOCAL));
        budget::set_device(budget::Device {
            name: self.chosen.adapter.name.clone(),
            side: limits.max_image_dimension2_d,
            image: v11.max_memory_allocation_size,
            all: local.map(|heap| heap.size).max().unwrap_or(u64::MAX),
        });
        // SAFETY: the device belongs to this physical device, and was created with the extensions if it has them.
        let builder = || unsafe { Builder::new(&instance, handle, &self.device) };
        let builder = self.chosen.lacks_for_ray_queries.is_empty().then(builder);
        let shared = Shared {
            clock: Clock { valid_bits: self.chosen.timestamp_bits, period_ns: limits.timestamp_period },
            limits,
            max_buffer_bytes: v13.max_buffer_size,
            builder,
            lacks_for_ray_queries: self.chosen.lacks_for_ray_queries,
            linear_filter: features.map(|f| f.contains(vk::FormatFeatureFlags::SAMPLED_IMAGE_FILTER_LINEAR)),
            storage: features.map(|f| f.contains(vk::FormatFeatureFlags::STORAGE_IMAGE)),
            device: self.device,
            debug: self.debug,
            samplers: self.samplers,
            pipeline_cache: self.pipeline_cache,
            live_bytes: AtomicU64::new(0),
            next_id: AtomicU64::new(0),
            stuck: AtomicBool::new(false),
            allocator: Mutex::new(Some(self.allocator)),
            slots: Mutex::new(Vec::new()),
            staging: Mutex::new(None),
            passes: Mutex::new(HashMap::new()),
            queue: Mutex::new(queue),
            queue_family: self.chosen.queue_family,
            physical: handle,
            name: self.chosen.adapter.name,
            driver: self.chosen.adapter.driver,
            messenger: self.messenger,
            instance,
            log,
            entry,
        };
        shared.label(shared.samplers[0], "linear sampler");
        shared.label(shared.samplers[1], "nearest sampler");
        shared.label(shared.pipeline_cache.handle(), "pipelines");
        shared
    }
}

impl Shared {
    /// Names an object for debuggers and validation messages.
    pub(super) fn label<H: Handle>(&self, handle: H, name: &str) {
        let (Some(debug), Ok(name)) = (&self.debug, CString::new(name.replace('\0', " "))) else { return };
        let info = vk::DebugUtilsObjectNameInfoEXT::default().object_handle(handle).object_name(&name);
        // SAFETY: the handle is alive. The result is ignored because a missing name does no harm.
        let _ = unsafe { debug.set_debug_utils_object_name(&info) };
    }

    pub(super) fn allocate(&self, desc: &memory::AllocationCreateDesc<'_>) -> Result<memory::Allocation> {
        let mut allocator = lock(&self.allocator);
        let allocator = allocator.as_mut().ok_or_else(|| Error::Internal("allocation during teardown".into()))?;
        allocator.allocate(desc).map_err(|error| {
            Error::input(
                "device memory",
                format!("{} MiB for {}: {error}", desc.requirements.size.div_ceil(1 << 20), desc.name),
                "use smaller images or a smaller scene, or another device",
            )
        })
    }

    /// Says whether what the device used may be freed: not once it could not be waited for.
    pub(super) fn may_free(&self) -> bool {
        !self.stuck.load(Ordering::Relaxed)
    }

    /// Has everything that was made on this device stay, because a wait for it has failed: it is lost, or
    /// still at work.
    pub(super) fn give_up(&self) {
        self.stuck.store(true, Ordering::Relaxed);
        STUCK.store(true, Ordering::Relaxed);
    }

    /// Keeps an answer to a wait or a submission, and gives up the device if it says that work may go on.
    pub(super) fn waited<T>(&self, answer: std::result::Result<T, vk::Result>) -> std::result::Result<T, vk::Result> {
        answer.inspect_err(|_| self.give_up())
    }

    pub(super) fn free(&self, allocation: memory::Allocation) {
        if let Some(Err(error)) = lock(&self.allocator).as_mut().map(|allocator| allocator.free(allocation)) {
            tracing::error!("freeing device memory: {error}");
        }
    }

    /// Takes a slot to record into: one that was used before, if there is one.
    pub(super) fn take_slot(&self) -> Result<Slot> {
        let idle = lock(&self.slots).pop();
        idle.map_or_else(|| Slot::new(self), Ok)
    }

    /// Gives an idle slot back.
    pub(super) fn return_slot(&self, slot: Slot) {
        lock(&self.slots).push(slot);
    }

    pub(super) fn staging(&self) -> MutexGuard<'_, Option<Staging>> {
        lock(&self.staging)
    }

    pub(super) fn submit(&self, commands: vk::CommandBuffer, fence: vk::Fence) -> std::result::Result<(), vk::Result> {
        let buffers = [vk::CommandBufferSubmitInfo::default().command_buffer(commands)];
        let submits = [vk::SubmitInfo2::default().command_buffer_infos(&buffers)];
        let queue = self.queue();
        // SAFETY: the command buffer is complete and the fence unsignalled, and the lock serialises the
        // queue.
        let submitted = unsafe { self.device.queue_submit2(*queue, &submits, fence) };
        // A device that is lost may have begun. One that lacks memory has not.
        if submitted == Err(vk::Result::ERROR_DEVICE_LOST) { self.waited(submitted) } else { submitted }
    }

    /// Locks the queue, as one thread at a time may use it.
    pub(super) fn queue(&self) -> MutexGuard<'_, vk::Queue> {
        lock(&self.queue)
    }
}

impl Drop for Shared {
    fn drop(&mut self) {
        // SAFETY: every buffer, image and pass held this, and none is left. The allocator is dropped first.
        unsafe {
            if !self.may_free() || self.waited(self.device.device_wait_idle()).is_err() {
                // What still runs needs the driver, the memory, and where messages go.
                std::mem::forget((lock(&self.allocator).take(), self.entry.clone(), Arc::clone(&self.log)));
                return;
            }
            let slots = std::mem::take(&mut *lock(&self.slots));
            for slot in slots {
                slot.destroy(self);
            }
            let staging = lock(&self.staging).take();
            if let Some(staging) = staging {
                staging.destroy(self);
            }
            for sampler in self.samplers {
                self.device.destroy_sampler(sampler, None);
            }
            self.pipeline_cache.close(&self.device);
            drop(lock(&self.allocator).take());
            self.device.destroy_device(None);
            if let Some((debug, messenger)) = &self.messenger {
                debug.destroy_debug_utils_messenger(*messenger, None);
            }
            self.instance.destroy_instance(None);
        }
    }
}
