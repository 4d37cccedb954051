//! Errors of execution.

use super::ranks::RankError;
use crate::stages::StageError;

#[derive(Debug, thiserror::Error)]
pub enum ExecError {
    #[error("device {device} failed: {what}")]
    Device { device: usize, what: String },
    #[error("no device is left: the last one, device {device}, failed: {what}")]
    NoneLeft { device: usize, what: String },
    #[error("there is no frame to read yet, or its image was not asked for")]
    NoFrame,
    #[error("a frame cannot have {0}")]
    Quality(String),
    #[error(
        "some devices follow rays in shaders and others by ray queries, which do not give the same bytes: open them for one traversal"
    )]
    MixedTraversal,
    #[error("the devices waited for one another until they gave up")]
    Stuck,
    #[error(transparent)]
    Stage(#[from] StageError),
    #[error(transparent)]
    Rank(#[from] RankError),
    #[error("cannot start a worker thread")]
    Thread(#[from] std::io::Error),
}
