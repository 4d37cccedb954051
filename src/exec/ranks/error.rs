//! Errors that end a run on several ranks.

/// Error that ends a run on several ranks.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
pub enum RankError {
    /// A rank that cannot take part, or could not execute a request.
    #[error("rank {rank} on {host}: {what}")]
    Refused { rank: usize, host: String, what: String },
    /// A rank that is lost.
    #[error("rank {rank} on {host} is lost: {what}")]
    Lost { rank: usize, host: String, what: String },
    #[error("{0} devices on all ranks are more than the 64 that one run can drive")]
    TooMany(usize),
}
