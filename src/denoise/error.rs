//! Errors of the denoiser.

use crate::device::{DeviceError, DeviceFailure};
use crate::projection::OutOfRange;
use crate::stages::StageError;

/// An error of a [`FrameDenoiser`](super::FrameDenoiser).
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum DenoiseError {
    /// A setting is outside its range.
    #[error(transparent)]
    Setting(#[from] OutOfRange),
    /// The arrays of a frame do not fit the settings, or have values that no image has.
    #[error("{0}")]
    Given(String),
    /// No device can be opened.
    #[error(transparent)]
    Open(#[from] DeviceError),
    /// The device cannot run the passes.
    #[error(transparent)]
    Stage(#[from] StageError),
    /// The device failed. It cannot be used any longer.
    #[error("the device failed: {0}")]
    Device(DeviceFailure),
}

impl From<DeviceFailure> for DenoiseError {
    fn from(failure: DeviceFailure) -> Self {
        Self::Device(failure)
    }
}
