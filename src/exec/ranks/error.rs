//! Errors that end a run on several ranks.

use super::agree::DeviceMismatch;

/// Error that ends a run on several ranks.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
pub enum RankError {
    /// A rank cannot take part, or could not execute a request.
    #[error("rank {rank} on {host}: {what}")]
    Refused { rank: usize, host: String, what: String },
    /// The adapters, drivers or ray traversal of a rank's devices differ from those of rank 0.
    #[error("rank {rank} on {host}: {mismatch}")]
    Devices { rank: usize, host: String, mismatch: DeviceMismatch },
    /// A rank gives no sign of life, or no packets can be exchanged with it.
    #[error("rank {rank} on {host} is lost: {what}")]
    Lost { rank: usize, host: String, what: String },
    #[error("the ranks have {0} devices in total, but one run can drive at most 64")]
    TooMany(usize),
}
