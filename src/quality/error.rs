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
    #[error("{0} sources have none in the middle: give an odd number")]
    EvenSources(usize),
    #[error("{what} needs two views, the eyes")]
    NeedsTwoViews { what: &'static str },
    /// The quality of a frame is outside the [`Envelope`](super::Envelope) of its renderer.
    #[error("the renderer was not built for {0}")]
    OutsideEnvelope(String),
    #[error("there is no setting '{key}': the settings are {known}")]
    Unknown { key: String, known: String },
    #[error("'{0}' is not of the form KEY=VALUE")]
    NoAssignment(String),
    #[error("{key} cannot be {value}: {why}")]
    Invalid { key: &'static str, value: String, why: String },
    /// A setting was given that changes no frame of the run.
    #[error("{key} has no effect without {needs}")]
    NoEffect { key: &'static str, needs: &'static str },
    #[error("{key} has no effect in {command}: leave it out")]
    OtherCommand { key: &'static str, command: &'static str },
    #[error("{0} and {1} exclude each other: leave one of them out")]
    Conflict(&'static str, &'static str),
    #[error("{0} is not a setting of quality, so a shot cannot have it")]
    NotInShots(&'static str),
}
