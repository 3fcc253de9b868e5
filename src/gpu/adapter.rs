//! The physical devices of this machine: which can run this program, why others cannot, and which to choose.

use std::ffi::{CStr, c_char};

use ash::vk;
use serde::Serialize;

use super::{acceleration, validation};
use crate::{Error, Result};

/// One physical device.
#[derive(Clone, Debug, Serialize)]
pub struct Adapter {
    /// The device's number in Vulkan's enumeration. `--device` accepts it.
    pub index: usize,
    /// The device's name, from its driver.
    pub name: String,
    /// The driver's name and version.
    pub driver: String,
    /// The Vulkan version it implements.
    pub api_version: String,
    /// `"discrete"`, `"integrated"`, `"virtual"`, `"cpu"` or `"other"`.
    pub kind: &'static str,
    /// Whether this program can run on it.
    pub usable: bool,
    /// Why the program cannot run on it. Empty if it can.
    pub problems: Vec<String>,
}

/// What [`super::Gpu`] needs to know of an adapter.
pub(super) struct FoundAdapter {
    pub handle: vk::PhysicalDevice,
    pub adapter: Adapter,
    pub queue_family: u32,
    pub timestamp_bits: u32,
    pub draws: bool,
    /// What it lacks for ray queries.
    pub lacks_for_ray_queries: Vec<String>,
}

/// Every physical device, usable or not.
///
/// # Errors
/// Fails with [`Error::NoDevice`] if there is no Vulkan loader or no driver.
pub fn list() -> Result<Vec<Adapter>> {
    let entry = load()?;
    let info = vk::ApplicationInfo::default().api_version(vk::API_VERSION_1_3);
    // SAFETY: a plain instance. It is destroyed below, and nothing made from it survives.
    unsafe {
        let instance = entry
            .create_instance(&vk::InstanceCreateInfo::default().application_info(&info), None)
            .map_err(no_instance)?;
        let adapters = candidates(&instance).map(|all| all.into_iter().map(|c| c.adapter).collect());
        instance.destroy_instance(None);
        adapters
    }
}

const INSTALL: &str = "install a Vulkan loader and driver (Debian, Ubuntu: libvulkan1 mesa-vulkan-drivers)";

/// Loads the Vulkan loader.
pub(super) fn load() -> Result<ash::Entry> {
    // SAFETY: the loader library runs its initialisers, as in any Vulkan program.
    unsafe { ash::Entry::load() }.map_err(|error| Error::NoDevice {
        problem: format!("the Vulkan loader cannot be loaded: {}", error.to_string().replace('\n', " ")),
        remedy: INSTALL.into(),
    })
}

pub(super) fn no_instance(result: vk::Result) -> Error {
    Error::NoDevice { problem: format!("no Vulkan instance can be made: {result:?}"), remedy: INSTALL.into() }
}

/// Every physical device of `instance`.
pub(super) fn candidates(instance: &ash::Instance) -> Result<Vec<FoundAdapter>> {
    // SAFETY: `instance` is alive.
    let handles = unsafe { instance.enumerate_physical_devices() }.map_err(no_instance)?;
    // SAFETY: the handles come from `instance`.
    Ok(handles.into_iter().enumerate().map(|(index, handle)| unsafe { examine(instance, index, handle) }).collect())
}

/// # Safety
/// `handle` belongs to `instance`.
unsafe fn examine(instance: &ash::Instance, index: usize, handle: vk::PhysicalDevice) -> FoundAdapter {
    // SAFETY: `handle` belongs to `instance`, and structures of Vulkan 1.2 and later are chained only if
    // known.
    unsafe {
        let plain = instance.get_physical_device_properties(handle);
        let mut problems = Vec::new();
        let version = plain.api_version;
        let api_version = format!(
            "{}.{}.{}",
            vk::api_version_major(version),
            vk::api_version_minor(version),
            vk::api_version_patch(version)
        );
        let mut driver = format!("driver {:#x}", plain.driver_version);
        let mut lacks_for_ray_queries = vec!["Vulkan 1.3".to_owned()];
        if version < vk::API_VERSION_1_3 {
            problems.push(format!("it implements Vulkan {api_version} and 1.3 is needed"));
        } else {
            let mut words = vk::PhysicalDeviceDriverProperties::default();
            let mut subgroups = vk::PhysicalDeviceSubgroupProperties::default();
            let mut properties =
                vk::PhysicalDeviceProperties2::default().push_next(&mut words).push_next(&mut subgroups);
            instance.get_physical_device_properties2(handle, &mut properties);
            driver = format!("{} ({})", text(&words.driver_name), text(&words.driver_info));
            let mut v12 = vk::PhysicalDeviceVulkan12Features::default();
            let mut v13 = vk::PhysicalDeviceVulkan13Features::default();
            let mut features = vk::PhysicalDeviceFeatures2::default().push_next(&mut v12).push_next(&mut v13);
            instance.get_physical_device_features2(handle, &mut features);
            lacks_for_ray_queries = acceleration::lacking(instance, handle);
            let extended_formats = features.features.shader_storage_image_extended_formats;
            let ballots = vk::SubgroupFeatureFlags::BASIC | vk::SubgroupFeatureFlags::BALLOT;
            if !subgroups.supported_operations.contains(ballots)
                || !subgroups.supported_stages.contains(vk::ShaderStageFlags::COMPUTE)
            {
                problems.push("it lacks subgroup ballots in compute shaders".to_owned());
            }
            for (has, name) in [
                (extended_formats, "shaderStorageImageExtendedFormats"),
                (v12.scalar_block_layout, "scalarBlockLayout"),
                (v12.host_query_reset, "hostQueryReset"),
                (v13.synchronization2, "synchronization2"),
                (v13.maintenance4, "maintenance4"),
            ] {
                if has != vk::TRUE {
                    problems.push(format!("it lacks the feature {name}"));
                }
            }
        }
        let families = instance.get_physical_device_queue_family_properties(handle);
        let computes = |family: &vk::QueueFamilyProperties| family.queue_flags.contains(vk::QueueFlags::COMPUTE);
        let timed = |family: &vk::QueueFamilyProperties| computes(family) && family.timestamp_valid_bits > 0;
        // A queue that can also draw is preferred, as it can present by a blit. Any other compute queue will
        // do.
        let family = families
            .iter()
            .position(|f| timed(f) && f.queue_flags.contains(vk::QueueFlags::GRAPHICS))
            .or_else(|| families.iter().position(timed));
        if family.is_none() {
            problems.push(if families.iter().any(computes) {
                "its compute queues have no timestamps".into()
            } else {
                "it has no compute queue".into()
            });
        }
        FoundAdapter {
            handle,
            queue_family: family.unwrap_or(0) as u32,
            timestamp_bits: family.map_or(0, |i| families[i].timestamp_valid_bits),
            lacks_for_ray_queries,
            draws: family.is_some_and(|i| families[i].queue_flags.contains(vk::QueueFlags::GRAPHICS)),
            adapter: Adapter {
                index,
                name: text(&plain.device_name),
                driver,
                api_version,
                kind: match plain.device_type {
                    vk::PhysicalDeviceType::DISCRETE_GPU => "discrete",
                    vk::PhysicalDeviceType::INTEGRATED_GPU => "integrated",
                    vk::PhysicalDeviceType::VIRTUAL_GPU => "virtual",
                    vk::PhysicalDeviceType::CPU => "cpu",
                    _ => "other",
                },
                usable: problems.is_empty(),
                problems,
            },
        }
    }
}

fn text(raw: &[std::ffi::c_char]) -> String {
    let bytes: &[u8] = bytemuck::cast_slice(raw);
    CStr::from_bytes_until_nul(bytes).map_or_else(|_| String::new(), |c| c.to_string_lossy().into_owned())
}

/// Finds an adapter by its index or a part of its name, ignoring case. `None` is one of the fastest kind.
///
/// # Errors
/// Fails with [`Error::NoDevice`] if no usable adapter matches. The error lists the adapters of this machine.
pub fn choose(adapters: &[Adapter], wanted: Option<&str>) -> Result<usize> {
    if adapters.is_empty() {
        return Err(Error::NoDevice {
            problem: "the Vulkan loader finds no driver".into(),
            remedy: "install one (Debian, Ubuntu: mesa-vulkan-drivers, which also renders on the CPU)".into(),
        });
    }
    let there_are = || {
        let names: Vec<_> = adapters.iter().map(|a| format!("{} {}", a.index, a.name)).collect();
        format!("there are: {}", names.join(", "))
    };
    let Some(wanted) = wanted else {
        let rank = |a: &Adapter| ["discrete", "integrated", "virtual", "cpu"].iter().position(|k| *k == a.kind);
        let best = adapters.iter().filter(|a| a.usable).min_by_key(|a| (rank(a).unwrap_or(usize::MAX), a.index));
        return best.map(|a| a.index).ok_or_else(|| Error::NoDevice {
            problem: adapters
                .iter()
                .map(|a| format!("{}: {}", a.name, a.problems.join(", ")))
                .collect::<Vec<_>>()
                .join("; "),
            remedy: "update its driver or install another (Debian, Ubuntu: mesa-vulkan-drivers)".into(),
        });
    };
    let found = match wanted.parse::<usize>() {
        Ok(index) => adapters.iter().find(|a| a.index == index),
        Err(_) => adapters.iter().find(|a| a.name.to_lowercase().contains(&wanted.to_lowercase())),
    };
    match found {
        Some(adapter) if adapter.usable => Ok(adapter.index),
        Some(adapter) => Err(Error::NoDevice {
            problem: format!("{}: {}", adapter.name, adapter.problems.join(", ")),
            remedy: format!("choose another device; {}", there_are()),
        }),
        None => Err(Error::NoDevice {
            problem: format!("no device matches {wanted:?}"),
            remedy: format!("choose one by number or name; {}", there_are()),
        }),
    }
}

/// Creates the instance with extensions for `windows`, and with the validation layer if it is wanted.
pub(super) fn instance(
    entry: &ash::Entry,
    validation: bool,
    log: &validation::Log,
    windows: Option<&[*const c_char]>,
) -> Result<(ash::Instance, bool /* debug utils */)> {
    // SAFETY: these are plain queries, and what the create info points at outlives the call.
    unsafe {
        let layer = if validation { Some(validation::find_layer(entry)?) } else { None };
        let offered = entry.enumerate_instance_extension_properties(None).map_err(no_instance)?;
        let labels = offered.iter().any(|e| e.extension_name_as_c_str() == Ok(ash::ext::debug_utils::NAME));
        let mut extensions = windows.unwrap_or_default().to_vec();
        if labels || validation {
            extensions.push(ash::ext::debug_utils::NAME.as_ptr());
        }
        let app = vk::ApplicationInfo::default().application_name(c"iprt").api_version(vk::API_VERSION_1_3);
        let mut messenger = validation::messenger(log);
        let mut features = vk::ValidationFeaturesEXT::default().enabled_validation_features(&validation::FEATURES);
        let list = validation::settings();
        let mut settings = vk::LayerSettingsCreateInfoEXT::default().settings(&list);
        let layers = [validation::LAYER.as_ptr()];
        let mut info = vk::InstanceCreateInfo::default().application_info(&app);
        if let Some(support) = layer {
            info = info.enabled_layer_names(&layers).push_next(&mut messenger);
            if support.settings {
                extensions.push(ash::ext::layer_settings::NAME.as_ptr());
                info = info.push_next(&mut settings);
            } else if support.features {
                extensions.push(ash::ext::validation_features::NAME.as_ptr());
                info = info.push_next(&mut features);
            }
        }
        let made = match entry.create_instance(&info.enabled_extension_names(&extensions), None) {
            // Loaders that are older than their layer refuse this name, but the layer understands it.
            Err(vk::Result::ERROR_EXTENSION_NOT_PRESENT) if layer.is_some_and(|support| support.settings) => {
                extensions.pop();
                entry.create_instance(&info.enabled_extension_names(&extensions), None)
            }
            made => made,
        };
        let instance = made.map_err(no_instance)?;
        Ok((instance, labels || validation))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn adapter(index: usize, name: &str, kind: &'static str, usable: bool) -> Adapter {
        let problems = if usable { vec![] } else { vec!["it lacks the feature maintenance4".to_owned()] };
        Adapter { index, name: name.into(), driver: String::new(), api_version: "1.3.0".into(), kind, usable, problems }
    }

    #[test]
    fn the_fastest_usable_kind_is_chosen_unless_one_is_named() {
        let all = [
            adapter(0, "llvmpipe", "cpu", true),
            adapter(1, "Old Card", "discrete", false),
            adapter(2, "Iris", "integrated", true),
        ];
        assert_eq!(choose(&all, None).unwrap(), 2);
        assert_eq!(choose(&all, Some("0")).unwrap(), 0);
        assert_eq!(choose(&all, Some("LLVM")).unwrap(), 0);
        for (wanted, says) in [("old", "maintenance4"), ("7", "\"7\""), ("nvidia", "0 llvmpipe, 1 Old Card, 2 Iris")] {
            let error = choose(&all, Some(wanted)).unwrap_err();
            assert_eq!(error.exit_code(), 3);
            assert!(error.to_string().contains(says), "{error}");
        }
        assert_eq!(choose(&[], None).unwrap_err().exit_code(), 3);
        assert_eq!(choose(&all[1..2], None).unwrap_err().exit_code(), 3);
    }
}
