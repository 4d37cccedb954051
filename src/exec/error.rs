//! Errors of execution.

use super::ranks::RankError;
use crate::quality::SettingError;
use crate::stages::StageError;

#[derive(Debug, thiserror::Error)]
pub enum ExecError {
    #[error("device {device} failed: {what}")]
    Device { device: usize, what: String },
    #[error("no device is left: the last one, device {device}, failed: {what}")]
    NoneLeft { device: usize, what: String },
    #[error("no image to read: no frame has been rendered yet, or the image was not requested")]
    NoFrame,
    #[error(transparent)]
    Setting(#[from] SettingError),
    #[error(
        "devices mix compute and hardware traversal, which do not give the same bytes: open all with one traversal"
    )]
    MixedTraversal,
    #[error("frame {frame} is unusable, because a device's driver seems to drop work: {what}")]
    Implausible { frame: u32, what: String },
    #[error("the devices did not finish, although none of them reported a failure")]
    Stuck,
    /// The flag of [`super::Builder::stop`] was set.
    #[error("stopped before the devices were done")]
    Stopped,
    #[error(transparent)]
    Stage(#[from] StageError),
    #[error(transparent)]
    Rank(#[from] RankError),
    #[error("cannot start a worker thread")]
    Thread(#[from] std::io::Error),
}
