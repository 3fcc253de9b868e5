//! Asks the Khronos validation layer for core and synchronization checks, and collects its messages.

use std::{
    ffi::{CStr, c_void},
    sync::{Mutex, PoisonError},
};

use ash::vk;

use crate::{Error, Result};

pub(super) const LAYER: &CStr = c"VK_LAYER_KHRONOS_validation";

/// Every validation message so far.
#[derive(Default)]
pub(super) struct Log(Mutex<Vec<String>>);

impl Log {
    fn push(&self, message: String) {
        self.0.lock().unwrap_or_else(PoisonError::into_inner).push(message);
    }

    pub(super) fn messages(&self) -> Vec<String> {
        self.0.lock().unwrap_or_else(PoisonError::into_inner).clone()
    }
}

unsafe extern "system" fn on_message(
    _severity: vk::DebugUtilsMessageSeverityFlagsEXT,
    _kind: vk::DebugUtilsMessageTypeFlagsEXT,
    data: *const vk::DebugUtilsMessengerCallbackDataEXT<'_>,
    log: *mut c_void,
) -> vk::Bool32 {
    // SAFETY: Vulkan passes valid message data, and the `Log` outlives the instance.
    let (id, text, log) = unsafe {
        let owned = |text: Option<&CStr>| text.map(|text| text.to_string_lossy().into_owned());
        let data = data.as_ref();
        (
            owned(data.and_then(|data| data.message_id_name_as_c_str())),
            owned(data.and_then(|data| data.message_as_c_str())),
            log.cast::<Log>().as_ref(),
        )
    };
    if let (Some(text), Some(log)) = (text, log) {
        // Newer layers leave the identifier out of the text.
        let text = match id {
            Some(id) if !text.contains(&id) => format!("{id}: {text}"),
            _ => text,
        };
        tracing::debug!("validation: {text}"); // whoever closes the device shows them all
        log.push(text);
    }
    vk::FALSE
}

/// A messenger for warnings and errors of the layer, but not of the loader. `log` must outlive the instance.
pub(super) fn messenger(log: &Log) -> vk::DebugUtilsMessengerCreateInfoEXT<'static> {
    vk::DebugUtilsMessengerCreateInfoEXT::default()
        .message_severity(vk::DebugUtilsMessageSeverityFlagsEXT::WARNING | vk::DebugUtilsMessageSeverityFlagsEXT::ERROR)
        .message_type(vk::DebugUtilsMessageTypeFlagsEXT::VALIDATION)
        .pfn_user_callback(Some(on_message))
        .user_data(std::ptr::from_ref(log).cast_mut().cast())
}

/// How the installed layer can be configured.
#[derive(Clone, Copy)]
pub(super) struct LayerSupport {
    /// It has `VK_EXT_validation_features`.
    pub features: bool,
    /// It has `VK_EXT_layer_settings`.
    pub settings: bool,
}

/// Looks for the layer.
///
/// # Errors
/// Fails with [`Error::NoDevice`] if the layer is missing. The error names the package to install.
pub(super) fn find_layer(entry: &ash::Entry) -> Result<LayerSupport> {
    // SAFETY: plain queries.
    let layers = unsafe { entry.enumerate_instance_layer_properties() }.unwrap_or_default();
    if !layers.iter().any(|layer| layer.layer_name_as_c_str() == Ok(LAYER)) {
        return Err(Error::NoDevice {
            problem: "validation was asked for and VK_LAYER_KHRONOS_validation is not installed".into(),
            remedy: "install it (Debian, Ubuntu: vulkan-validationlayers; Fedora: vulkan-validation-layers) or leave validation off".into(),
        });
    }
    // SAFETY: as above.
    let extensions = unsafe { entry.enumerate_instance_extension_properties(Some(LAYER)) }.unwrap_or_default();
    let has = |name: &CStr| extensions.iter().any(|e| e.extension_name_as_c_str() == Ok(name));
    Ok(LayerSupport {
        features: has(ash::ext::validation_features::NAME),
        settings: has(ash::ext::layer_settings::NAME),
    })
}

/// Synchronization validation for layers configured by `VkValidationFeaturesEXT`.
pub(super) const FEATURES: [vk::ValidationFeatureEnableEXT; 1] =
    [vk::ValidationFeatureEnableEXT::SYNCHRONIZATION_VALIDATION];

static ON: vk::Bool32 = vk::TRUE;

/// Synchronization validation for layers configured by `VK_EXT_layer_settings`, which also look across
/// submissions. Without the second setting, a program of compute passes alone shows no hazard.
pub(super) fn settings() -> [vk::LayerSettingEXT<'static>; 2] {
    [c"validate_sync", c"syncval_shader_accesses_heuristic"].map(|name| {
        vk::LayerSettingEXT {
            value_count: 1, // ash's setter would count bytes
            p_values: std::ptr::from_ref(&ON).cast(),
            ..vk::LayerSettingEXT::default().layer_name(LAYER).setting_name(name).ty(vk::LayerSettingTypeEXT::BOOL32)
        }
    })
}

/// The environment variable that makes older layers check hazards across submissions. They can be asked in no other way.
pub const SUBMIT_CHECKS: (&str, &str) = (
    "VK_LAYER_ENABLES",
    "VK_VALIDATION_FEATURE_ENABLE_SYNCHRONIZATION_VALIDATION_EXT:\
     VALIDATION_CHECK_ENABLE_SYNCHRONIZATION_VALIDATION_QUEUE_SUBMIT",
);

/// Sets [`SUBMIT_CHECKS`] if validation is asked for and the layer is an older one, unless the user has set that variable.
/// Newer layers are configured by `settings`, over which the user's own configuration goes.
///
/// # Safety
/// No other thread may run, so call it first in `main`. Tests use `.cargo/config.toml` instead.
pub unsafe fn enable_submit_checks() {
    let (name, value) = SUBMIT_CHECKS;
    let wanted =
        std::env::args_os().any(|word| word == "--validation") || std::env::var_os("IPRT_VALIDATION").is_some();
    let older = || super::adapter::load().and_then(|entry| find_layer(&entry)).is_ok_and(|layer| !layer.settings);
    if wanted && std::env::var_os(name).is_none() && older() {
        // SAFETY: the caller's promise.
        unsafe { std::env::set_var(name, value) };
    }
}
