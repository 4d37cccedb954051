//! Errors that keep frames from reaching a headset.

use openxr::sys;

use crate::device::DeviceError;

#[derive(Debug, thiserror::Error)]
pub enum HeadsetError {
    #[error("no OpenXR loader was found: install one (Debian or Ubuntu: `apt-get install libopenxr-loader1`)")]
    NoLoader,
    #[error(
        "no OpenXR runtime answers: start the headset's runtime (Monado: `monado-service`) and make it the active one (point XR_RUNTIME_JSON, or openxr/1/active_runtime.json in a configuration folder, at its manifest)"
    )]
    NoRuntime,
    #[error("the OpenXR runtime {runtime} finds no headset: connect one and switch it on")]
    NoHeadset { runtime: String },
    #[error("the OpenXR runtime {runtime} lacks {what}")]
    Lacks { runtime: String, what: &'static str },
    #[error("the headset's runtime failed to {what}: {source}")]
    Call { what: &'static str, source: sys::Result },
    #[error("the headset's eyes cannot be rendered: {0}")]
    Eyes(String),
    #[error("the headset was lost")]
    Lost,
    #[error("the headset's device failed: {0}")]
    Failed(String),
    #[error(transparent)]
    Device(#[from] DeviceError),
}

/// Converts the error of an OpenXR call to a [`HeadsetError`] that names the attempted action.
pub(super) trait OpenXrResult<T> {
    fn to(self, what: &'static str) -> Result<T, HeadsetError>;
}

impl<T> OpenXrResult<T> for Result<T, sys::Result> {
    fn to(self, what: &'static str) -> Result<T, HeadsetError> {
        self.map_err(|source| match source {
            sys::Result::ERROR_SESSION_LOST | sys::Result::ERROR_INSTANCE_LOST => HeadsetError::Lost,
            source => HeadsetError::Call { what, source },
        })
    }
}
