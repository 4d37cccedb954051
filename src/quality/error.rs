//! Settings that a renderer refuses.

use crate::projection::OutOfRange;

/// A setting that is invalid, or that a renderer was not built for.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum SettingError {
    #[error(transparent)]
    OutOfRange(#[from] OutOfRange),
    #[error("polar and fovea cannot be combined")]
    PolarWithFovea,
    #[error("a render scale below 1 needs a denoiser to fill in the pixels that are not traced")]
    ScaleWithoutDenoiser,
    /// The quality of a frame is outside the [`Envelope`](super::Envelope) of its renderer.
    #[error("the renderer was not built for {0}")]
    OutsideEnvelope(String),
}
