//! The system's OpenXR runtime and its headset.

use openxr::sys;
use openxr::{
    ApplicationInfo, Entry, EnvironmentBlendMode, ExtensionSet, FormFactor, Instance, SystemId, Version,
    ViewConfigurationType,
};

use super::error::{HeadsetError, OpenXrResult};
use crate::device::{DeviceError, HeadsetDevice, Wanted};
use crate::image::Extent;

/// View configuration with one view for each eye.
pub(super) const STEREO: ViewConfigurationType = ViewConfigurationType::PRIMARY_STEREO;

/// A runtime with a headset, before a session begins.
pub struct Runtime {
    pub(super) xr: Instance,
    pub(super) system: SystemId,
    /// Name of the runtime, with its version.
    pub name: String,
    pub headset: String,
    /// Recommended size of each eye's image.
    pub recommended: Extent,
    pub(super) blend: EnvironmentBlendMode,
    /// True if the runtime accepts depth layers.
    pub(super) takes_depth: bool,
    /// True if the runtime supports eye tracking.
    pub(super) tracks_eyes: bool,
    /// True if the runtime has a clock.
    pub(super) tells_time: bool,
}

impl Runtime {
    /// Opens the active runtime. OpenXR's loader writes its own messages to stderr as well, unless `XR_LOADER_DEBUG` is
    /// `none`.
    ///
    /// # Errors
    /// [`HeadsetError`] that names the missing part: a loader, a runtime, a headset.
    pub fn open() -> Result<Self, HeadsetError> {
        // SAFETY: the library of that name is OpenXR's loader.
        let entry = unsafe { Entry::load(&()) }.map_err(|_| HeadsetError::NoLoader)?;
        let offered = entry.enumerate_extensions().map_err(unanswered)?;
        let mut wanted = ExtensionSet::default();
        wanted.khr_vulkan_enable2 = offered.khr_vulkan_enable2;
        wanted.khr_composition_layer_depth = offered.khr_composition_layer_depth;
        wanted.ext_eye_gaze_interaction = offered.ext_eye_gaze_interaction;
        wanted.khr_convert_timespec_time = offered.khr_convert_timespec_time && cfg!(not(windows));
        let about =
            ApplicationInfo { application_name: "diptych", api_version: Version::new(1, 0, 0), ..Default::default() };
        let xr = entry.create_instance(&about, &wanted, &[], &()).map_err(unanswered)?;
        let properties = xr.properties().to("return its name")?;
        let name = format!("{} {}", properties.runtime_name, properties.runtime_version);
        let lacks = |what| HeadsetError::Lacks { runtime: name.clone(), what };
        if !wanted.khr_vulkan_enable2 {
            return Err(lacks("support for Vulkan (XR_KHR_vulkan_enable2)"));
        }
        let system = xr.system(FormFactor::HEAD_MOUNTED_DISPLAY).map_err(|error| match error {
            sys::Result::ERROR_FORM_FACTOR_UNAVAILABLE | sys::Result::ERROR_FORM_FACTOR_UNSUPPORTED => {
                HeadsetError::NoHeadset { runtime: name.clone() }
            }
            source => HeadsetError::Call { what: "find its headset", source },
        })?;
        let views = xr.enumerate_view_configuration_views(system, STEREO).to("list the headset's views")?;
        let [view, _] = views[..] else { return Err(lacks("one view for each eye")) };
        let modes = xr.enumerate_environment_blend_modes(system, STEREO).to("list its environment blend modes")?;
        let opaque = modes.iter().find(|mode| **mode == EnvironmentBlendMode::OPAQUE);
        let blend = *opaque.or(modes.first()).ok_or_else(|| lacks("an environment blend mode"))?;
        Ok(Self {
            headset: xr.system_properties(system).to("return the headset's name")?.system_name,
            recommended: Extent::new(
                view.recommended_image_rect_width.max(1),
                view.recommended_image_rect_height.max(1),
            ),
            blend,
            takes_depth: wanted.khr_composition_layer_depth,
            tracks_eyes: wanted.ext_eye_gaze_interaction,
            tells_time: wanted.khr_convert_timespec_time,
            xr,
            system,
            name,
        })
    }

    /// Opens the device from which the runtime takes images. `first` describes the first rendering device; if it is on
    /// the runtime's adapter, the opened device also serves as the first rendering device.
    ///
    /// # Errors
    /// Errors of the runtime or of the device.
    pub fn open_device(&self, first: &Wanted) -> Result<HeadsetDevice, DeviceError> {
        HeadsetDevice::open(&self.xr, self.system, first)
    }
}

/// Converts an error of starting the runtime: to [`HeadsetError::NoRuntime`] if the loader finds no runtime or the
/// runtime does not start, otherwise to [`HeadsetError::Call`].
fn unanswered(error: sys::Result) -> HeadsetError {
    match error {
        sys::Result::ERROR_RUNTIME_UNAVAILABLE
        | sys::Result::ERROR_RUNTIME_FAILURE
        | sys::Result::ERROR_INITIALIZATION_FAILED
        | sys::Result::ERROR_FILE_ACCESS_ERROR
        | sys::Result::ERROR_INSTANCE_LOST => HeadsetError::NoRuntime,
        source => HeadsetError::Call { what: "start", source },
    }
}
